//! The log: every frame of the bus in one MCAP file, unchanged, with JSON twins that any MCAP viewer can show.
//!
//! ```text
//!   tap ─► recorder ─► writer ──► set.mcap ──► reader ──► frames (people, --json)
//!                      │ senders   gaps in the sequence numbers
//!                      │ order     one time order out of two services and eight senders
//!                      │ view      frames decoded for JSON
//!                      └ schema    what the channels hold
//! ```
//!
//! Topics: `/microbus` (the bytes as they travelled, one channel for each of the two services), `/command`,
//! `/axis/<name>/status`, `/digital/status` and `/events`. The writer and the reader know no clock and no bus; the
//! recorder's loop is the only room in here that sleeps. Nothing in here commands, or interprets motion.

mod channels;
mod events;
mod frames;
mod header;
mod line;
mod order;
mod reader;
mod recorder;
mod schema;
mod senders;
mod view;
mod writer;

#[cfg(test)]
mod tests;

use std::io;
use std::path::PathBuf;

use supersigma_protocol::bus::BusError;

pub(crate) use events::{Event, Level, Watch as EventWatch};
pub(crate) use frames::concerns;
pub use frames::{FramesCount, frames};
pub use header::{AxisNames, LogHeader, Timeline, WallTime};
pub use line::Lines;
pub use reader::{LogReader, LoggedFrame};
pub use recorder::run;
pub use senders::Gap;
pub(crate) use view::sender_name;
pub use view::{
    AboutView, AlarmView, AnswerView, AxisView, CommandView, DigitalView, FrameView, RefusalView, ReportView,
    UndecodableView,
};
pub use writer::{LogSummary, LogWriter};

/// What can go wrong with a log.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A log is never overwritten.
    #[error("the log {} exists already; choose another name or move the file away", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be made.
    #[error("cannot create the log {}: {source}", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A full disk, for example. What was written before is readable.
    #[error("cannot write the log {}: {}", .path.display(), reason(.source))]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system or the format said.
        source: mcap::McapError,
    },
    /// The file cannot be opened or read.
    #[error("cannot read the log {}: {source}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another kind of file.
    #[error("{} is not a log of this program: {what}", .path.display())]
    NotALog {
        /// The file.
        path: PathBuf,
        /// What is missing in it.
        what: &'static str,
    },
    /// Bytes inside the file were changed. Everything before them has been read.
    #[error("the log {} is damaged after frame {frames}: {}", .path.display(), reason(.source))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How many frames were read before.
        frames: u64,
        /// What the format said.
        source: mcap::McapError,
    },
    /// No axis of the logged set is called so.
    #[error("the log {} knows no axis `{name}`; it has {known}", .path.display())]
    NoSuchAxis {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// The bus failed while it was recorded; the log is complete up to then.
    #[error("recording ended early: {0}")]
    Bus(#[from] BusError),
    /// The frames cannot be printed.
    #[error("cannot write the frames: {0}")]
    Output(io::Error),
}

/// The system's words rather than the format library's "I/O error".
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
