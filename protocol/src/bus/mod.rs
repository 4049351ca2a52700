//! The MICROBUS itself: frames' bytes from one process to others. It knows senders and addresses, not meanings.
//!
//! Two carriers stand behind the same three traits: [`shared_memory`] (iceoryx2) between processes and
//! [`in_process`] inside one. Nobody spins: a port that waits, sleeps in the kernel until its line
//! (DATA READY for cards, ANSWER READY for the CCU) is raised or the time is over.
//!
//! ```text
//!               commands (publish-subscribe, one to all)
//!      CCU ────────────┬───────────┬───────────┬──────────► recorder (tap)
//!       ▲   DATA READY │1        … │7          │8 and 9
//!       │              ▼           ▼           ▼
//!       │            card 1  …   card 7   digital cards
//!       └──────────────┴───────────┴───────────┴──────────► recorder (tap)
//!               answers (publish-subscribe, all to the CCU), ANSWER READY
//! ```
//!
//! No reader, dead, stopped or slow, can stop a sender: a full buffer loses frames, the receiver sees the gap in
//! the sequence numbers, and that is an alarm.
//!
//! Every frame comes with its [`Origin`], the process that has sent it. Whom to believe is for whoever receives.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use crate::MAX_FRAME_BYTES;
use crate::units::Address;

pub mod in_process;
mod line;
mod origin;
pub mod shared_memory;
mod strangers;

pub use origin::Origin;
pub use strangers::{Stranger, Strangers};

/// How many frames a reader may leave unread before further ones are lost to it.
pub const BUFFER_FRAMES: usize = 4096;

/// One set's bus, as seen by a process that wants ports on it. Ports live on when this value is dropped; frames
/// sent before a port was made are not heard by it.
pub trait Bus {
    /// A port's sending half.
    type Transmit: Transmit;
    /// A port's receiving half.
    type Receive: Receive;
    /// The recorder's end.
    type Tap: Tap;

    /// The CCU's port: sends commands, hears answers. A set has one.
    ///
    /// # Errors
    /// If the carrier cannot make the port.
    fn ccu(&self) -> Result<(Self::Transmit, Self::Receive), BusError>;

    /// A card's port: hears all commands, sends answers. Addresses 8 and 9 are one process and share one line.
    ///
    /// # Errors
    /// If `address` is not that of one card (1 ..= 9), or the carrier cannot make the port.
    fn card(&self, address: Address) -> Result<(Self::Transmit, Self::Receive), BusError>;

    /// A silent reader of commands and answers.
    ///
    /// # Errors
    /// If the carrier cannot make the port.
    fn tap(&self) -> Result<Self::Tap, BusError>;
}

/// Whom a sent frame wakes. A frame reaches everybody; waking is only for whom it concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// It can wait until the readers look for themselves.
    Nobody,
    /// DATA READY of the card with this address, of the seven axes for [`Address::EVERYONE`], of nobody for an
    /// address that no card has.
    Card(Address),
    /// DATA READY of every card. A card has one line to raise, ANSWER READY, and raises it by anything but `Nobody`.
    Everyone,
}

/// The sending half of a port.
pub trait Transmit: Send {
    /// Puts the bytes of one frame on the bus; never blocks on a reader.
    ///
    /// # Errors
    /// If the frame is longer than [`MAX_FRAME_BYTES`], or the bus itself fails; a reader that misses the frame is
    /// not an error here.
    fn send(&mut self, frame: &[u8], wake: Wake) -> Result<(), BusError>;
}

/// A frame that has come, undecoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Received {
    /// The process that has sent it.
    pub origin: Origin,
    /// Its bytes, [`MAX_FRAME_BYTES`] at most.
    pub bytes: Vec<u8>,
}

/// The receiving half of a port.
pub trait Receive: Send {
    /// The next frame that is already here; `None` if there is none. Never waits.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn receive(&mut self) -> Result<Option<Received>, BusError>;

    /// Sleeps until this port's line is raised, or `limit` is over. May return early; never spins.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn wait(&mut self, limit: Duration) -> Result<(), BusError>;

    /// What ends this port's `wait` from another thread of the same process.
    fn waker(&self) -> Waker;
}

/// Ends the `wait` of one port, or the next one if the port is not waiting now.
#[derive(Clone)]
pub struct Waker(Arc<dyn Fn() + Send + Sync>);

impl Waker {
    fn new(raise: impl Fn() + Send + Sync + 'static) -> Self {
        Self(Arc::new(raise))
    }

    /// Raises the port's line. Does nothing when the port is gone.
    pub fn wake(&self) {
        (self.0)();
    }
}

impl fmt::Debug for Waker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Waker")
    }
}

/// Which of the two services a frame was seen on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Lane {
    /// CCU to all.
    Commands,
    /// Cards to the CCU.
    Answers,
}

/// A silent reader of both services: the recorder's end.
pub trait Tap: Send {
    /// Hands over the frames that are here now and returns how many there were; those that are too many for one look
    /// wait for the next one. Frames of one sender come in the order in which they were sent; a command is handed over
    /// before the answers to it.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError>;
}

/// The bus itself failed.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// A port, service or node could not be made.
    #[error("cannot {what}: {reason}")]
    Open {
        /// What was tried.
        what: &'static str,
        /// What the carrier said.
        reason: String,
    },
    /// A port that was open does not work any more.
    #[error("the bus failed: cannot {what}: {reason}")]
    Broken {
        /// What was tried.
        what: &'static str,
        /// What the carrier said.
        reason: String,
    },
    /// The machine's shared memory cannot take the bus.
    #[error("there is no room for the bus in {}: {reason}", folder.display())]
    NoRoom {
        /// Where.
        folder: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// A frame that is longer than any frame may be.
    #[error("{bytes} bytes are too many for a frame (at most {max})", max = MAX_FRAME_BYTES)]
    TooLong {
        /// Its length.
        bytes: usize,
    },
}

impl BusError {
    fn open(what: &'static str, reason: impl fmt::Display) -> Self {
        Self::Open { what, reason: reason.to_string() }
    }

    fn broken(what: &'static str, reason: impl fmt::Display) -> Self {
        Self::Broken { what, reason: reason.to_string() }
    }
}

/// Both carriers refuse what no receiver would take.
fn check_length(frame: &[u8]) -> Result<(), BusError> {
    if frame.len() > MAX_FRAME_BYTES { Err(BusError::TooLong { bytes: frame.len() }) } else { Ok(()) }
}
