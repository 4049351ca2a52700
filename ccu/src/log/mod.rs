//! The log: every frame of the bus in one MCAP file, unchanged, with JSON twins that any MCAP viewer can show.
//!
//! ```text
//!   tap ─► recorder ─► writer ──► set.mcap ──► messages ──► reader ──► frames (people, --json, --csv)
//!                      │              │           │ index     └ filter
//!                      │              │           └──► info
//!                      │              └──► salvage ──► recover ──► a complete log again
//!                      │ rotation  when the next file begins
//!                      │ batch     messages on their way to the thread `press`, which compresses and writes them
//!                      │ part      one MCAP file; file: the bytes of it that are whole
//!                      │ senders   gaps in the sequence numbers
//!                      │ order     one time order out of two services and eight senders
//!                      │ told      what viewers are told, in JSON; shared with `live`, the view of a running set
//!                      │ limits    how much of a file readers take into memory
//!                      │ view      frames decoded for JSON
//!                      │ joints    all axes in one message
//!                      └ schema    what the channels hold
//! ```
//!
//! Topics: `/microbus` (the bytes as they travelled, one channel for each of the two services), `/command`,
//! `/axis/<name>/status`, `/digital/status`, `/joint_states` and `/events`. The writer and the reader know no clock and
//! no bus; the recorder's loop is the only room in here that sleeps. Nothing in here commands, or interprets motion.

mod batch;
mod channels;
mod events;
mod file;
mod filter;
mod frames;
mod header;
mod index;
mod info;
mod joints;
mod limits;
mod line;
mod live;
mod messages;
mod order;
mod part;
mod press;
mod reader;
mod recorder;
mod recover;
mod rotation;
mod salvage;
mod schema;
mod senders;
mod table;
mod told;
mod twins;
mod view;
mod writer;

#[cfg(test)]
mod tests;

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::process::geteuid;
use supersigma_protocol::bus::BusError;

pub(crate) use events::Watch as EventWatch;
pub use events::{Event, Level};
pub(crate) use file::LogFile;
pub(crate) use filter::concerns;
pub use filter::{Filter, Judge, operation};
pub use frames::{Form, FramesAsked, FramesCount, frames};
pub use header::{AxisNames, LogHeader, Timeline, WallTime};
pub use info::{AlarmInfo, ChannelInfo, FramesInfo, GapInfo, LogInfo, LogState, info};
pub use line::Lines;
pub use live::LiveView;
pub use part::COMPRESSION_LEVEL;
pub use reader::{LogReader, LoggedFrame};
pub use recorder::{RecorderStatus, run};
pub use recover::{Lost, Recovery, recover};
pub use rotation::Rotation;
pub(crate) use schema::view_schema;
pub use senders::Gap;
pub use told::{ENCODING, Message, SCHEMA_ENCODING, Topic, twin_of};
pub use twins::{TwinReader, Twinned};
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
    #[error("cannot create the log {}: {error}", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A full disk, for example. What was written before is readable.
    #[error("cannot write the log {}: {}", .path.display(), reason(.error))]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system or the format said.
        error: mcap::McapError,
    },
    /// There is no room for more than the end of the log. It was written: nothing is missing in it up to there.
    #[error("no room is left for the log {}", .path.display())]
    Full {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be opened or read.
    #[error("cannot read the log {}: {source}{}", .path.display(), whose(.path, .source))]
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
    /// No operation is called so.
    #[error("there is no operation `{name}`: {known}")]
    NoSuchOperation {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// The log ends before it says whose it is.
    #[error("the log {} ends before its first frame: there is nothing to recover", .path.display())]
    NothingIn {
        /// The file.
        path: PathBuf,
    },
    /// What was recovered, read again, is not what was written. The file has been removed.
    #[error("{} was not written as it should be: {what}; nothing was kept of it", .path.display())]
    NotAsWritten {
        /// The file.
        path: PathBuf,
        /// How it differs.
        what: &'static str,
    },
    /// The bus failed while it was recorded; the log is complete up to then.
    #[error("recording ended early: {0}")]
    Bus(#[from] BusError),
    /// The frames cannot be printed.
    #[error("cannot write the frames: {0}")]
    Output(io::Error),
}

impl LogError {
    /// Whether there is no more room: on the disk, in the quota, or for one file.
    #[must_use]
    pub fn is_full(&self) -> bool {
        match self {
            Self::Full { .. } => true,
            Self::Create { error, .. } | Self::Write { error: mcap::McapError::Io(error), .. } => {
                file::is_full(error)
            }
            _ => false,
        }
    }
}

/// Whose a log is that this user may not read.
fn whose(path: &Path, error: &io::Error) -> String {
    let owner = fs::metadata(path).map(|found| found.uid());
    match owner {
        Ok(owner) if error.kind() == io::ErrorKind::PermissionDenied && owner != geteuid().as_raw() => {
            format!("; logs are their owner's alone: ask user {owner}")
        }
        _ => String::new(),
    }
}

/// The system's words rather than the format library's "I/O error".
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
