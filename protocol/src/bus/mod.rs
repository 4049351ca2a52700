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

use std::time::Duration;

use crate::units::Address;

/// Whom a sent frame wakes. A frame reaches everybody; waking is only for whom it concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// It can wait until the readers look for themselves.
    Nobody,
    /// DATA READY of one card.
    Card(Address),
    /// DATA READY of every card; for a card, ANSWER READY.
    Everyone,
}

/// The sending half of a port.
pub trait Transmit: Send {
    /// Puts the bytes of one frame on the bus; never blocks on a reader.
    ///
    /// # Errors
    /// If the bus itself fails; a reader that misses the frame is not an error here.
    fn send(&mut self, frame: &[u8], wake: Wake) -> Result<(), BusError>;
}

/// The receiving half of a port.
pub trait Receive: Send {
    /// The bytes of the next frame that is already here; `None` if there is none. Never waits.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn receive(&mut self) -> Result<Option<Vec<u8>>, BusError>;

    /// Sleeps until this port's line is raised, or `limit` is over. May return early; never spins.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn wait(&mut self, limit: Duration) -> Result<(), BusError>;
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
    /// Hands over every frame that is here now and returns how many there were. Frames of one sender come in the
    /// order in which they were sent; a command is handed over before the answers to it.
    ///
    /// # Errors
    /// If the bus itself fails.
    fn drain(&mut self, each: &mut dyn FnMut(Lane, &[u8])) -> Result<usize, BusError>;
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
    /// A frame that is longer than any frame may be.
    #[error("{bytes} bytes are too many for a frame (at most {max})", max = crate::MAX_FRAME_BYTES)]
    TooLong {
        /// Its length.
        bytes: usize,
    },
}
