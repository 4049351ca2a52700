//! The ports of the shared-memory bus: iceoryx2's publishers, subscribers, notifiers and listeners behind the bus's
//! traits. They move bytes and raise lines; which service is which, the parent module decides.

use std::hint;
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc_threadsafe;
use iceoryx2::service::header::payload_header::PayloadHeader;
use iceoryx2_bb_posix::file_descriptor_set::{FileDescriptorSet, FileDescriptorSetWaitError, FileEvent};

use super::super::line::Line;
use super::super::{
    BUFFER_FRAMES, BusError, Lane, Origin, Receive, Received, Tap, Transmit, Wake, Waker, check_length,
};
use super::habit::{AWAKE, Habit};
use crate::MAX_FRAME_BYTES;

/// iceoryx2 between processes, with ports that may move between threads.
pub(super) type Carrier = ipc_threadsafe::Service;

/// The longest single sleep in the kernel; `wait` may return early.
const LONGEST_SLEEP: Duration = Duration::from_secs(3600);
/// So many answers a tap takes at once: more than the cards say in any while, and an end to what a stranger may say.
const AT_ONCE: usize = 2 * BUFFER_FRAMES;

/// The sending half of a port.
#[derive(Debug)]
pub struct SharedTransmit {
    /// In the order in which their readers get a frame.
    pub(super) publishers: Vec<Publisher<Carrier, [u8], ()>>,
    /// The lines that this port may raise.
    pub(super) lines: Vec<(Line, Notifier<Carrier>)>,
}

impl Transmit for SharedTransmit {
    fn send(&mut self, frame: &[u8], wake: Wake) -> Result<(), BusError> {
        check_length(frame)?;
        for publisher in &self.publishers {
            let sample = publisher
                .loan_slice_uninit(frame.len())
                .map_err(|error| BusError::broken("find room for a frame", error))?;
            sample.write_from_slice(frame).send().map_err(|error| BusError::broken("send a frame", error))?;
        }
        for (line, notifier) in &self.lines {
            if line.is_raised_by(wake) {
                notifier.notify().map_err(|error| BusError::broken("raise a line", error))?;
            }
        }
        Ok(())
    }
}

/// The receiving half of a port.
#[derive(Debug)]
pub struct SharedReceive {
    pub(super) subscriber: Subscriber<Carrier, [u8], ()>,
    pub(super) listener: Listener<Carrier>,
    pub(super) waker: Waker,
    pub(super) habit: Habit,
}

impl SharedReceive {
    /// Takes back what has been raised.
    fn lower(&self) -> Result<(), BusError> {
        self.listener.try_wait(|_| ()).map(drop).map_err(|error| BusError::broken("read a line", error))
    }

    /// Looks for a frame without sleeping; says whether there is one.
    fn stay_awake(&self, limit: Duration) -> Result<bool, BusError> {
        let (began, limit) = (Instant::now(), limit.min(AWAKE));
        while began.elapsed() < limit {
            if self.subscriber.has_samples().map_err(|error| BusError::broken("look for a frame", error))? {
                return Ok(true);
            }
            hint::spin_loop();
        }
        Ok(false)
    }

    /// Sleeps until the line is raised; says whether it was.
    fn sleep(&self, limit: Duration) -> Result<bool, BusError> {
        // The listener's own timed wait counts in the kernel's ticks, 4 ms and more; `select` counts in microseconds.
        // Its descriptor is among the process's first, well below the 1024 that `select` can take.
        let set = FileDescriptorSet::new();
        let _attached = set
            .add(&self.listener)
            .map_err(|error| BusError::broken("watch a line", format!("{error:?}")))?;
        match set.timed_wait(limit.min(LONGEST_SLEEP), FileEvent::Read, |_| ()) {
            Ok(raised) => Ok(raised > 0),
            Err(FileDescriptorSetWaitError::Interrupt) => Ok(true),
            Err(error) => Err(BusError::broken("wait for a line", format!("{error:?}"))),
        }
    }
}

impl Receive for SharedReceive {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        next(&self.subscriber)
    }

    fn wait(&mut self, limit: Duration) -> Result<(), BusError> {
        if self.habit.stays_awake() {
            if self.stay_awake(limit)? {
                return self.lower();
            }
            self.habit.was_in_vain();
        }
        let began = Instant::now();
        let raised = self.sleep(limit)?;
        self.habit.slept(raised.then(|| began.elapsed()));
        if raised { self.lower() } else { Ok(()) }
    }

    fn waker(&self) -> Waker {
        self.waker.clone()
    }
}

/// A silent reader of both lanes.
#[derive(Debug)]
pub struct SharedTap {
    pub(super) commands: Subscriber<Carrier, [u8], ()>,
    pub(super) answers: Subscriber<Carrier, [u8], ()>,
}

impl Tap for SharedTap {
    fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError> {
        // Answers are taken first and handed over last: whatever they answer is among the commands taken after them,
        // because the CCU gives a command to the taps before any card.
        let mut answers = Vec::new();
        while answers.len() < AT_ONCE
            && let Some(answer) = next(&self.answers)?
        {
            answers.push(answer);
        }
        let mut commands = 0;
        while let Some(command) = next(&self.commands)? {
            each(Lane::Commands, command.origin, &command.bytes);
            commands += 1;
        }
        for answer in &answers {
            each(Lane::Answers, answer.origin, &answer.bytes);
        }
        Ok(commands + answers.len())
    }
}

fn next(subscriber: &Subscriber<Carrier, [u8], ()>) -> Result<Option<Received>, BusError> {
    let sample = subscriber.receive().map_err(|error| BusError::broken("receive a frame", error))?;
    Ok(sample.map(|sample| {
        let payload = sample.payload();
        // No member of the set sends more; others may.
        let bytes = payload[..payload.len().min(MAX_FRAME_BYTES)].to_vec();
        Received { origin: origin_of(sample.header().node_id()), bytes }
    }))
}

/// The process that has made a node.
pub(super) fn origin_of(node: UniqueNodeId) -> Origin {
    let process = node.pid::<Carrier>().ok().and_then(|process| u32::try_from(process.value()).ok());
    process.map_or(Origin::UNKNOWN, Origin)
}
