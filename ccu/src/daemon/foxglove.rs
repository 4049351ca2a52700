//! The live view's process: a tap on the bus, and a WebSocket server for Foxglove with the log's twin channels. It is a
//! process of its own, which nothing waits for: whatever a viewer or its network does, no axis notices. Viewers look; the
//! server takes no commands.
//!
//! The server is Foxglove's own, behind the cargo feature `foxglove`. It prints its URL when it listens.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::str::FromStr;

use clap::Args;
use miette::Diagnostic;

use super::listener::ListenerArgs;

/// Where a live view is served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ViewAddress(SocketAddr);

impl FromStr for ViewAddress {
    type Err = NoAddress;

    /// A port alone is on this machine's own address, which others cannot reach.
    fn from_str(text: &str) -> Result<Self, NoAddress> {
        let own = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
        let address = text.parse().map(own).or_else(|_| text.parse());
        address.map(Self).map_err(|_| NoAddress(text.to_owned()))
    }
}

impl fmt::Display for ViewAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// What is not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no port and no address with a port, as 8765, 0.0.0.0:8765 or [::1]:8765 are")]
pub struct NoAddress(String);

/// The server is not in this program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Diagnostic)]
#[error("this build has no Foxglove server")]
#[diagnostic(help("build with `--features foxglove`, or leave out --foxglove"))]
pub struct NotBuilt;

/// Whether this program can serve what is asked for.
pub(super) const fn check(wanted: Option<ViewAddress>) -> Result<(), NotBuilt> {
    if wanted.is_some() && !cfg!(feature = "foxglove") { Err(NotBuilt) } else { Ok(()) }
}

/// What the server is told by the daemon.
#[derive(Debug, Clone, Args)]
pub struct ViewArgs {
    /// The set.
    #[command(flatten)]
    pub listener: ListenerArgs,
    /// Where to listen
    #[arg(long, value_name = "ADDR:PORT")]
    pub address: ViewAddress,
}

/// Serves the view until the lifeline ends.
///
/// # Errors
/// If this program was built without it.
#[cfg(not(feature = "foxglove"))]
pub fn serve(_: &ViewArgs) -> miette::Result<()> {
    Err(NotBuilt.into())
}

#[cfg(feature = "foxglove")]
pub use self::server::serve;

#[cfg(feature = "foxglove")]
mod server {
    use std::collections::BTreeMap;
    use std::collections::btree_map::Entry;
    use std::io::{self, Write};
    use std::net::SocketAddr;
    use std::sync::Arc;
    use std::sync::atomic::Ordering;
    use std::thread;
    use std::time::Duration;

    use foxglove::{
        ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer,
    };
    use miette::{IntoDiagnostic, WrapErr};
    use supersigma_protocol::bus::Tap;

    use super::super::lifeline::Lifeline;
    use super::ViewArgs;
    use crate::log::{ENCODING, LiveView, LogHeader, Message, SCHEMA_ENCODING, Topic, WallTime};

    /// How often it looks at the bus.
    const LOOK: Duration = Duration::from_millis(10);

    /// Serves the view until the lifeline ends.
    ///
    /// # Errors
    /// If the bus fails, or nobody can listen at the address.
    pub fn serve(args: &ViewArgs) -> miette::Result<()> {
        let (_, header) = args.listener.read(None)?;
        let bus = args.listener.bus()?;
        let mut tap = args.listener.tap(&bus)?;
        let clock = args.listener.clock();
        let lifeline = Lifeline::watch(clock).into_diagnostic()?;

        let context = Context::new();
        let mut channels = Channels::new(&context, &header).into_diagnostic()?;
        let server = WebSocketServer::new()
            .name(format!("SUPERSIGMA {}", args.listener.set))
            .bind(args.address.0.ip().to_string(), args.address.0.port())
            .context(&context)
            .start_blocking()
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot listen at {}", args.address))?;
        let url = SocketAddr::new(args.address.0.ip(), server.port());
        say(&format!("ws://{url}")).into_diagnostic()?;

        let mut view = None;
        while !lifeline.ended.load(Ordering::Acquire) {
            // While nobody looks, nothing is made ready; who comes begins with what the axes say next.
            if server.client_count() == 0 {
                view = None;
                tap.drain(&mut |_, _, _| {}).into_diagnostic()?;
                lifeline.events.try_iter().for_each(drop);
            } else {
                let view = view.get_or_insert_with(|| LiveView::new(&header));
                tap.drain(&mut |_, _, bytes| view.record(bytes, clock.now())).into_diagnostic()?;
                for (at, event) in lifeline.events.try_iter() {
                    view.note(at, event, clock.now());
                }
                view.advance(clock.now(), &mut |time, message| channels.send(time, message));
            }
            thread::sleep(LOOK);
        }
        // Its tasks end with this process.
        drop(server.stop());
        Ok(())
    }

    /// The set's channels, by topic.
    struct Channels<'a> {
        context: &'a Arc<Context>,
        header: &'a LogHeader,
        open: BTreeMap<Topic, Arc<RawChannel>>,
    }

    impl<'a> Channels<'a> {
        fn new(context: &'a Arc<Context>, header: &'a LogHeader) -> Result<Self, FoxgloveError> {
            let mut channels = Self { context, header, open: BTreeMap::new() };
            Topic::of_set(&header.names).try_for_each(|topic| channels.of(topic).map(drop))?;
            Ok(channels)
        }

        fn of(&mut self, topic: Topic) -> Result<&RawChannel, FoxgloveError> {
            match self.open.entry(topic) {
                Entry::Occupied(open) => Ok(open.into_mut()),
                Entry::Vacant(place) => {
                    let schema = topic.schema().into_bytes();
                    let channel = ChannelBuilder::new(topic.name(&self.header.names))
                        .context(self.context)
                        .message_encoding(ENCODING)
                        .schema(Schema::new(topic.schema_name(), SCHEMA_ENCODING, schema))
                        .build_raw()?;
                    Ok(place.insert(channel))
                }
            }
        }

        fn send(&mut self, time: WallTime, message: Message<'_>) {
            match self.of(message.topic) {
                Ok(channel) => channel.log_with_meta(message.data, PartialMetadata::with_log_time(time.0)),
                Err(error) => tracing::warn!(%error, "a channel cannot be opened"),
            }
        }
    }

    fn say(line: &str) -> io::Result<()> {
        let mut out = io::stdout().lock();
        writeln!(out, "{line}")?;
        out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_this_machine_s() {
        let parse = |text: &str| text.parse::<ViewAddress>().map(|address| address.to_string());
        assert_eq!(parse("8765").as_deref(), Ok("127.0.0.1:8765"));
        assert_eq!(parse("0").as_deref(), Ok("127.0.0.1:0"));
        assert_eq!(parse("0.0.0.0:8765").as_deref(), Ok("0.0.0.0:8765"));
        assert_eq!(parse("[::1]:80").as_deref(), Ok("[::1]:80"));
        for wrong in ["", "70000", "localhost", "1.2.3.4", ":8765"] {
            let error = parse(wrong).expect_err("no address").to_string();
            assert!(error.starts_with(&format!("`{wrong}` is no port")), "{error}");
        }
    }

    #[test]
    fn what_is_not_built_is_refused() {
        let wanted = "8765".parse().expect("a port");
        assert_eq!(check(None), Ok(()));
        assert_eq!(check(Some(wanted)).is_ok(), cfg!(feature = "foxglove"));
    }
}
