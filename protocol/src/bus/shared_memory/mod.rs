//! The bus between processes, carried by iceoryx2: which services there are, who creates them, who joins.
//!
//! ```text
//!   service    publishers        subscribers       a full buffer
//!   record     CCU               taps              loses the frame for that reader alone;
//!   commands   CCU               cards             the sender never waits
//!   answers    cards             CCU and taps
//!   line 0     cards             CCU               ANSWER READY
//!   line 1..7  CCU               that motor card   DATA READY
//!   line 8     CCU               digital cards     DATA READY
//! ```
//!
//! A command goes to `record` before it goes to `commands`: a tap has it before any card can answer it. Each line is
//! an event service of its own with one listener, so raising it wakes one process.
//!
//! The CCU creates everything, after removing whatever an earlier life of the set left behind; the others open it.
//! A process killed at any moment leaves files and slots behind; the next one that joins returns them.
//!
//! There are exactly as many publishers as the set has processes that speak, so while they live, nobody else can. Whoever
//! takes the place of one that has died is known by the origin of its frames.

use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    BackpressureStrategy, CallbackProgression, Node, NodeBuilder, ServiceName, SignalHandlingMode,
};
use iceoryx2::service::port_factory::{PortFactory, event, publish_subscribe};
use iceoryx2_log::LogLevel;
use tracing::level_filters::LevelFilter;

use super::line::Line;
use super::{BUFFER_FRAMES, Bus, BusError, Waker};
use crate::MAX_FRAME_BYTES;
use crate::units::{Address, AxisNumber};

mod habit;
mod place;
mod ports;
mod room;

use habit::Habit;
pub use place::Place;
use ports::{Carrier, origin_of};
pub use ports::{SharedReceive, SharedTap, SharedTransmit};

/// CCU, eight card processes, some taps, and as many again that died and have not been cleared away yet.
const NODES: usize = 32;
/// Those that speak to the CCU: a process a motor card, and one for both digital cards. A dead one's place is free once it
/// has been cleared away.
const SPEAKERS: usize = AxisNumber::COUNT + 1;
/// Eight card processes that hear, and some dead ones. Each is room in shared memory that is kept free for it.
const CARDS: usize = 12;
/// Recorder, live view, and two more, people's readers or dead ones.
const TAPS: usize = 4;
/// A line has one listener; a card that was killed and started again may meet its own remains.
const LISTENERS: usize = 4;
/// Whoever raises a line, and its owner's waker; ANSWER READY is raised by all cards.
const NOTIFIERS: usize = 2 * SPEAKERS + 4;
/// How long clearing away the dead may take when others are at it too.
const CLEANING: Duration = Duration::from_secs(1);

type Frames = publish_subscribe::PortFactory<Carrier, [u8], ()>;
type Event = event::PortFactory<Carrier>;

/// One process's hold on its set's bus.
#[derive(Debug)]
pub struct SharedBus {
    record: Frames,
    commands: Frames,
    answers: Frames,
    /// By [`Line::index`].
    lines: Vec<Event>,
    node: Node<Carrier>,
    place: Place,
}

impl SharedBus {
    /// The bus of a set that nobody lives in, for its CCU, which holds the set's lock. Everything that an earlier
    /// life left at this place is removed first. The bus stays joinable as long as this value or a port of it lives.
    ///
    /// # Errors
    /// If a left-over cannot be removed, or iceoryx2 cannot make its files.
    pub fn create(place: &Place) -> Result<Self, BusError> {
        place.sweep()?;
        Place::look_for(room::OF_A_SET)?;
        let bus = Self::begin(place);
        if bus.is_err()
            && let Err(error) = place.sweep()
        {
            tracing::warn!(%error, "something of a bus that could not be made is left on the machine");
        }
        bus
    }

    fn begin(place: &Place) -> Result<Self, BusError> {
        place.settle()?;
        let bus = Self::enter(place, Entry::Create)?;
        place.seal()?;
        place.take_room()?;
        Ok(bus)
    }

    /// The bus that the CCU of this set has created. Clears away what killed processes left in it.
    ///
    /// # Errors
    /// If there is none, or iceoryx2 cannot open it.
    pub fn join(place: &Place) -> Result<Self, BusError> {
        if !place.is_inhabited()? {
            return Err(BusError::open(
                "join the bus",
                format!("there is none in {}; start the set first", place.root().display()),
            ));
        }
        Place::look_for(room::OF_A_PROCESS)?;
        Self::enter(place, Entry::Open)
    }

    /// Returns the files and slots of killed processes. Joining does it too.
    pub fn clean_dead(&self) {
        let state = self.node.blocking_cleanup_dead_nodes(CLEANING);
        if state.failed_cleanups > 0 {
            tracing::warn!(failed = state.failed_cleanups, "the remains of killed processes stay on the bus");
        } else if state.cleanups > 0 {
            tracing::debug!(cleaned = state.cleanups, "cleared away killed processes");
        }
    }

    /// Removes every file of a bus that nobody uses any more, so that nothing stays in the machine's shared memory.
    ///
    /// # Errors
    /// If a file cannot be removed; the message names it.
    pub fn sweep(place: &Place) -> Result<(), BusError> {
        place.sweep()
    }

    fn enter(place: &Place, entry: Entry) -> Result<Self, BusError> {
        follow_log_level();
        let node = NodeBuilder::new()
            .config(&place.config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Carrier>()
            .map_err(|error| BusError::open("enter the bus", error))?;
        let bus = Self {
            record: frames(&node, entry, "record", 1, TAPS)?,
            commands: frames(&node, entry, "commands", 1, CARDS)?,
            answers: frames(&node, entry, "answers", SPEAKERS, 1 + TAPS)?,
            lines: Line::all().map(|line| event(&node, entry, line)).collect::<Result<_, _>>()?,
            node,
            place: place.clone(),
        };
        place.close_folders()?;
        Ok(bus)
    }

    /// A place to speak. If all are taken, one may be a dead process', which somebody else is just clearing away.
    fn speaker(&self, frames: &Frames) -> Result<Publisher<Carrier, [u8], ()>, BusError> {
        let begun = Instant::now();
        loop {
            match create_publisher(frames) {
                Err(PublisherCreateError::ExceedsMaxSupportedPublishers) if begun.elapsed() < CLEANING => {
                    self.clean_dead();
                    thread::sleep(CLEANING / 50);
                }
                result => return result.map_err(|error| no_place(frames, error)),
            }
        }
    }

    fn notifier(&self, line: Line) -> Result<Notifier<Carrier>, BusError> {
        self.lines[line.index()]
            .notifier_builder()
            .create()
            .map_err(|error| BusError::open("make a line's sending end", error))
    }

    fn listener(&self, line: Line) -> Result<Listener<Carrier>, BusError> {
        self.lines[line.index()]
            .listener_builder()
            .create()
            .map_err(|error| BusError::open("make a line's receiving end", error))
    }

    fn receive(&self, frames: &Frames, line: Line) -> Result<SharedReceive, BusError> {
        let own_line = self.notifier(line)?;
        let waker = Waker::new(move || {
            if let Err(error) = own_line.notify() {
                tracing::warn!(%error, "a port could not be woken");
            }
        });
        Ok(SharedReceive {
            subscriber: subscriber(frames)?,
            listener: self.listener(line)?,
            waker,
            habit: Habit::new(),
        })
    }
}

impl Bus for SharedBus {
    type Transmit = SharedTransmit;
    type Receive = SharedReceive;
    type Tap = SharedTap;

    fn ccu(&self) -> Result<(SharedTransmit, SharedReceive), BusError> {
        let lines =
            Line::cards().map(|line| Ok((line, self.notifier(line)?))).collect::<Result<_, BusError>>()?;
        let publisher = |frames| create_publisher(frames).map_err(|error| no_place(frames, error));
        let publishers = vec![publisher(&self.record)?, publisher(&self.commands)?];
        let receive = self.receive(&self.answers, Line::AnswerReady)?;
        self.place.take_room()?;
        Ok((SharedTransmit { publishers, lines }, receive))
    }

    fn card(&self, address: Address) -> Result<(SharedTransmit, SharedReceive), BusError> {
        let line = Line::of_card(address)?;
        let lines = vec![(Line::AnswerReady, self.notifier(Line::AnswerReady)?)];
        let publishers = vec![self.speaker(&self.answers)?];
        let receive = self.receive(&self.commands, line)?;
        self.place.take_room()?;
        Ok((SharedTransmit { publishers, lines }, receive))
    }

    fn tap(&self) -> Result<SharedTap, BusError> {
        let tap = SharedTap { commands: subscriber(&self.record)?, answers: subscriber(&self.answers)? };
        self.place.take_room()?;
        Ok(tap)
    }
}

/// How a process comes to the services.
#[derive(Debug, Clone, Copy)]
enum Entry {
    Create,
    Open,
}

fn name(of: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(of).map_err(|error| BusError::open("name a service", format!("{error:?}")))
}

fn frames(
    node: &Node<Carrier>,
    entry: Entry,
    service: &str,
    publishers: usize,
    subscribers: usize,
) -> Result<Frames, BusError> {
    let builder = node
        .service_builder(&name(service)?)
        .publish_subscribe::<[u8]>()
        .enable_safe_overflow(false)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER_FRAMES)
        .subscriber_max_borrowed_samples(1)
        .max_publishers(publishers)
        .max_subscribers(subscribers)
        .max_nodes(NODES);
    match entry {
        Entry::Create => builder.create().map_err(|error| refused(entry, service, &error)),
        Entry::Open => builder.open().map_err(|error| refused(entry, service, &error)),
    }
}

fn event(node: &Node<Carrier>, entry: Entry, line: Line) -> Result<Event, BusError> {
    let service = format!("line {}", line.index());
    let builder = node
        .service_builder(&name(&service)?)
        .event()
        .event_id_max_value(0)
        .max_notifiers(NOTIFIERS)
        .max_listeners(LISTENERS)
        .max_nodes(NODES);
    match entry {
        Entry::Create => builder.create().map_err(|error| refused(entry, &service, &error)),
        Entry::Open => builder.open().map_err(|error| refused(entry, &service, &error)),
    }
}

fn refused(entry: Entry, service: &str, error: &dyn std::fmt::Display) -> BusError {
    let what = match entry {
        Entry::Create => "create the bus",
        Entry::Open => "join the bus",
    };
    BusError::open(what, format!("service \"{service}\": {error}"))
}

fn create_publisher(frames: &Frames) -> Result<Publisher<Carrier, [u8], ()>, PublisherCreateError> {
    frames
        .publisher_builder()
        .initial_max_slice_len(MAX_FRAME_BYTES)
        .max_loaned_samples(1)
        // The default retries until delivered: one reader that has stopped would stop the sender for ever.
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
}

/// Says who has the places, if that is what is wrong.
fn no_place(frames: &Frames, error: PublisherCreateError) -> BusError {
    const WHAT: &str = "make a sending port";
    if error != PublisherCreateError::ExceedsMaxSupportedPublishers {
        return BusError::open(WHAT, error);
    }
    let mut holders = Vec::new();
    frames.dynamic_config().list_publishers(|publisher| {
        holders.push(origin_of(publisher.node_id).to_string());
        CallbackProgression::Continue
    });
    BusError::open(WHAT, format!("every place is taken, by {}", holders.join(", ")))
}

fn subscriber(frames: &Frames) -> Result<Subscriber<Carrier, [u8], ()>, BusError> {
    frames.subscriber_builder().create().map_err(|error| BusError::open("make a receiving port", error))
}

/// iceoryx2 speaks through `tracing`; this spares it the making of messages that nobody listens to.
fn follow_log_level() {
    iceoryx2_log::set_log_level(match LevelFilter::current() {
        LevelFilter::TRACE => LogLevel::Trace,
        LevelFilter::DEBUG => LogLevel::Debug,
        LevelFilter::INFO => LogLevel::Info,
        LevelFilter::WARN => LogLevel::Warn,
        LevelFilter::ERROR => LogLevel::Error,
        _ => LogLevel::Fatal,
    });
}
