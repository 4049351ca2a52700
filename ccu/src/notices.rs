//! What the daemon's process says through `tracing`, at the level of info and above, for the recorder and other listeners:
//! a line of JSON each, along their lifelines.
//!
//! Whoever says something never waits: an event goes into a bounded queue, and if there is no room, it is counted and the
//! number is told when there is. A thread of each listener's own writes; a listener that is gone is forgotten. The last
//! events are kept, for a listener that takes the place of one that has gone.

use std::collections::VecDeque;
use std::fmt::{self, Write as _};
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use axis_worker::clock::Monotonic;
use serde::{Deserialize, Serialize};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

use crate::log::{Event, Level};

/// Events that may wait for a listener.
const QUEUE: usize = 256;

/// Events that are kept for a listener to come.
const KEPT: usize = 64;

/// An event on its way.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Notice {
    /// When it happened, in nanoseconds of the machine's monotonic clock.
    pub at_ns: u64,
    /// What happened.
    #[serde(flatten)]
    pub event: Event,
}

/// The listeners of this process. `tracing` has one subscriber a process, so this too is the process'.
static LISTENERS: Mutex<Listeners> =
    Mutex::new(Listeners { all: Vec::new(), next: 0, recent: VecDeque::new() });

struct Listeners {
    all: Vec<Listener>,
    /// The number of the next one.
    next: u64,
    recent: VecDeque<Notice>,
}

struct Listener {
    number: u64,
    queue: SyncSender<Notice>,
    /// Events for which there was no room.
    dropped: u64,
}

/// A listener's stream of events. It ends when this is dropped, after what is queued.
#[derive(Debug)]
#[must_use = "the stream ends when this is dropped"]
pub struct Stream(u64);

/// Begins to print what `RUST_LOG` names, warnings by default, and to hand events to listeners.
pub fn start_logging() {
    let fmt = axis_worker::stderr_layer();
    tracing_subscriber::registry().with(fmt).with(Tee.with_filter(heard())).init();
}

/// Hands all events from now on to `listener`; first the latest of those since `since`, if it comes late.
///
/// # Errors
/// If the thread that writes cannot be started.
pub fn stream_to(listener: impl Write + Send + 'static, since: Option<Monotonic>) -> io::Result<Stream> {
    let (queue, notices) = mpsc::sync_channel(QUEUE);
    thread::Builder::new().name("notices".into()).spawn(move || write_all(&notices, listener))?;
    let mut listeners = listeners();
    let number = listeners.next;
    let mut listener = Listener { number, queue, dropped: 0 };
    if let Some(since) = since {
        let missed = listeners.recent.iter().rev().filter(|notice| notice.at_ns >= since.as_nanos());
        missed.for_each(|notice| {
            listener.hand(notice);
        });
    }
    listeners.all.push(listener);
    listeners.next += 1;
    Ok(Stream(number))
}

impl Drop for Stream {
    fn drop(&mut self) {
        listeners().all.retain(|listener| listener.number != self.0);
    }
}

/// What is worth keeping: everything of this program; of others, warnings.
fn heard() -> Targets {
    Targets::new()
        .with_default(LevelFilter::WARN)
        .with_targets(["ccu", "axis_worker", "supersigma"].map(|target| (target, LevelFilter::INFO)))
        .with_target("iceoryx2", LevelFilter::ERROR)
}

fn write_all(notices: &Receiver<Notice>, mut listener: impl Write) {
    for notice in notices {
        let Ok(mut line) = serde_json::to_vec(&notice) else { continue };
        line.push(b'\n');
        if listener.write_all(&line).and_then(|()| listener.flush()).is_err() {
            return;
        }
    }
}

fn listeners() -> MutexGuard<'static, Listeners> {
    LISTENERS.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Listener {
    /// Whether there is still somebody to hand this to.
    fn hand(&mut self, notice: &Notice) -> bool {
        let queue = |notice| match self.queue.try_send(notice) {
            Ok(()) => Some(true),
            Err(TrySendError::Full(_)) => Some(false),
            Err(TrySendError::Disconnected(_)) => None,
        };
        if self.dropped > 0 {
            match queue(missing(self.dropped, notice.at_ns)) {
                Some(true) => self.dropped = 0,
                Some(false) => {}
                None => return false,
            }
        }
        match queue(notice.clone()) {
            Some(queued) => {
                self.dropped += u64::from(!queued);
                true
            }
            None => false,
        }
    }
}

/// What stands for events for which there was no room.
fn missing(events: u64, at_ns: u64) -> Notice {
    Notice {
        at_ns,
        event: Event {
            level: Level::Warning,
            name: module_path!().to_owned(),
            message: format!("{events} events are missing here: more came than could be taken"),
            file: String::new(),
            line: 0,
        },
    }
}

/// Takes events to the listeners.
struct Tee;

impl<S: Subscriber> Layer<S> for Tee {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        let at_ns = Monotonic::now().as_nanos();
        let mut text = Text::default();
        event.record(&mut text);
        let notice = Notice { at_ns, event: describe(event.metadata(), &text) };
        let mut listeners = listeners();
        listeners.all.retain_mut(|listener| listener.hand(&notice));
        listeners.recent.truncate(KEPT - 1);
        listeners.recent.push_front(notice);
    }
}

fn describe(metadata: &Metadata<'_>, text: &Text) -> Event {
    Event {
        level: match *metadata.level() {
            tracing::Level::ERROR => Level::Error,
            tracing::Level::WARN => Level::Warning,
            _ => Level::Info,
        },
        name: metadata.target().to_owned(),
        message: format!("{}{}", text.message, text.fields),
        file: metadata.file().unwrap_or_default().to_owned(),
        line: metadata.line().unwrap_or_default(),
    }
}

/// An event's message, and its fields as ` key=value`.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing into a string does not fail.
        let _ = match field.name() {
            "message" => write!(self.message, "{value:?}"),
            name => write!(self.fields, " {name}={value:?}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::Sender;

    use super::*;

    /// A listener that takes a line only when it is let.
    struct Slow {
        lines: Sender<Notice>,
        may: Receiver<()>,
    }

    impl Write for Slow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.may.recv().map_err(|_| io::ErrorKind::BrokenPipe)?;
            let notice = serde_json::from_slice(bytes)?;
            self.lines.send(notice).map_err(|_| io::ErrorKind::BrokenPipe)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn subscriber() -> impl Subscriber {
        tracing_subscriber::registry().with(Tee.with_filter(heard()))
    }

    /// One test for all, because the listeners are the process'.
    #[test]
    fn events_go_to_listeners_and_nobody_waits() {
        let (lines, heard) = mpsc::channel();
        let (let_go, may) = mpsc::channel();
        let stream = stream_to(Slow { lines, may }, None).expect("a thread");
        let queued = QUEUE + 1;
        let begun = Monotonic::now().as_nanos();
        tracing::subscriber::with_default(subscriber(), || {
            tracing::error!(card = 3, status = %"killed", "a worker has ended");
            tracing::debug!("not kept");
            tracing::info!(target: "tokio", "not kept either");
            // The listener does not take anything; the queue fills, and this ends all the same.
            (0..2 * QUEUE).for_each(|number| tracing::info!(number, "said"));
        });
        (0..queued).for_each(|_| let_go.send(()).expect("it listens"));
        let first = heard.recv().expect("said");
        assert!(first.at_ns >= begun);
        let Event { level, name, message, file, line } = first.event;
        assert_eq!((level, name.as_str()), (Level::Error, "ccu::notices::tests"));
        assert_eq!(message, "a worker has ended card=3 status=killed");
        assert!(file.ends_with("notices.rs") && line > 0, "{file}:{line}");
        let messages: Vec<String> = heard.iter().take(QUEUE - 1).map(|notice| notice.event.message).collect();
        assert_eq!(messages[QUEUE - 2], format!("said number={}", QUEUE - 2));

        // There is room again, and what is missing is told first; at the end of the stream, everything queued is written.
        tracing::subscriber::with_default(subscriber(), || tracing::warn!("at last"));
        drop(stream);
        tracing::subscriber::with_default(subscriber(), || tracing::warn!("nobody listens"));
        while let_go.send(()).is_ok() {}
        // One that comes late is told what has been said since the other was gone.
        let (lines, late) = mpsc::channel();
        let (let_go, may) = mpsc::channel();
        let_go.send(()).expect("it listens");
        let since = Monotonic::now();
        tracing::subscriber::with_default(subscriber(), || tracing::warn!("nobody listens yet"));
        let stream = stream_to(Slow { lines, may }, Some(since)).expect("a thread");
        assert_eq!(late.recv().expect("said").event.message, "nobody listens yet");
        drop(stream);
        let rest: Vec<String> = heard.iter().map(|notice| notice.event.message).collect();
        let [.., missing, last] = &rest[..] else { panic!("{rest:?}") };
        assert!(missing.ends_with("events are missing here: more came than could be taken"), "{rest:?}");
        assert_eq!(last, "at last");
        let number: usize = missing.split(' ').next().and_then(|word| word.parse().ok()).expect("a number");
        let told = 1 + messages.len() + rest.len() - 2;
        assert_eq!(told + number, 1 + 2 * QUEUE, "told and missing make up all");
    }
}
