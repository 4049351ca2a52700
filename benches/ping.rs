//! What a round trip between two processes costs with nothing around it: through iceoryx2, with an event that wakes the
//! other, and through a pair of datagram sockets. References only; nothing of the set is in here.

use std::error::Error;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{FileName, Node, NodeBuilder, SemanticString, SignalHandlingMode, ipc};

use supersigma_protocol::bus::shared_memory::{Place, SharedBus};

use crate::peers::{self, Peer};

/// As long as a card's answer.
const MESSAGE: [u8; 40] = [0x55; 40];

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// One end of two iceoryx2 services, one for each direction, each with its event.
pub(crate) struct SharedMemory {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
    _node: Node<ipc::Service>,
}

impl SharedMemory {
    /// This end, and the other in a process of its own.
    pub(crate) fn pair(folder: &Path) -> Result<(Self, Peer)> {
        let near = Self::enter(folder, "there", "back")?;
        let far = Peer::start(peers::SHARED_MEMORY, folder.as_os_str())?;
        Ok((near, far))
    }

    /// Removes what a pair in this folder leaves in the machine's shared memory. Both must have ended.
    pub(crate) fn sweep(folder: &Path) -> Result<()> {
        Ok(SharedBus::sweep(&Place::new(folder)?)?)
    }

    /// The other end: sends back what comes.
    pub(crate) fn echo(folder: &Path, ready: impl FnOnce()) -> Result<()> {
        let far = Self::enter(folder, "back", "there")?;
        ready();
        loop {
            far.take()?;
            far.send()?;
        }
    }

    /// There and back.
    pub(crate) fn trip(&mut self) -> Result<Duration> {
        let began = Instant::now();
        self.send()?;
        self.take()?;
        Ok(began.elapsed())
    }

    fn send(&self) -> Result<()> {
        self.publisher.loan_slice_uninit(MESSAGE.len())?.write_from_slice(&MESSAGE).send()?;
        self.notifier.notify()?;
        Ok(())
    }

    fn take(&self) -> Result<()> {
        loop {
            if self.subscriber.receive()?.is_some_and(|sample| sample.payload() == MESSAGE) {
                return Ok(());
            }
            self.listener.blocking_wait(|_| ())?;
        }
    }

    fn enter(folder: &Path, speaks: &str, hears: &str) -> Result<Self> {
        let mut config = Config::default();
        let root = iceoryx2::prelude::Path::new(folder.as_os_str().as_encoded_bytes())
            .map_err(|error| format!("{error:?}"))?;
        config.global.set_root_path(&root);
        let prefix = Place::new(folder)?.prefix().to_owned();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|error| format!("{error:?}"))?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()?;
        let frames = |service: &str| -> Result<_> {
            Ok(node.service_builder(&service.try_into()?).publish_subscribe::<[u8]>().open_or_create()?)
        };
        let events = |service: &str| -> Result<_> {
            Ok(node
                .service_builder(&format!("{service} event").as_str().try_into()?)
                .event()
                .open_or_create()?)
        };
        Ok(Self {
            publisher: frames(speaks)?.publisher_builder().initial_max_slice_len(MESSAGE.len()).create()?,
            notifier: events(speaks)?.notifier_builder().create()?,
            subscriber: frames(hears)?.subscriber_builder().create()?,
            listener: events(hears)?.listener_builder().create()?,
            _node: node,
        })
    }
}

/// One of two datagram sockets.
pub(crate) struct Sockets(UnixDatagram);

impl Sockets {
    /// This end, and the other in a process of its own.
    pub(crate) fn pair(folder: &Path) -> Result<(Self, Peer)> {
        let near = UnixDatagram::bind(folder.join("near"))?;
        let far = Peer::start(peers::SOCKET, folder.as_os_str())?;
        near.connect(folder.join("far"))?;
        Ok((Self(near), far))
    }

    /// The other end: sends back what comes.
    pub(crate) fn echo(folder: &Path, ready: impl FnOnce()) -> Result<()> {
        let far = UnixDatagram::bind(folder.join("far"))?;
        far.connect(folder.join("near"))?;
        ready();
        let mut message = MESSAGE;
        loop {
            let length = far.recv(&mut message)?;
            far.send(&message[..length])?;
        }
    }

    /// There and back.
    pub(crate) fn trip(&mut self) -> Result<Duration> {
        let mut message = MESSAGE;
        let began = Instant::now();
        self.0.send(&message)?;
        self.0.recv(&mut message)?;
        Ok(began.elapsed())
    }
}
