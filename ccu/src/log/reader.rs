//! The log's reader: the frames of a file, in its order, and what the log says about itself.
//!
//! A complete log that is asked for a span of time is read through its index, any other from its beginning; `messages`
//! does both. This room finds the frames among the messages.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::Path;

use mcap::records::Channel;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{Frame, FrameError};

use super::LogError;
use super::channels::{LANE, MICROBUS, lane_name};
use super::header::{LogHeader, WallTime};
use super::messages::Messages;

/// What was on the bus once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoggedFrame {
    /// Its place in the log.
    pub log_time: WallTime,
    /// The service that carried it.
    pub lane: Lane,
    /// The bytes as they travelled.
    pub bytes: Vec<u8>,
    /// The frame in them.
    pub frame: Result<Frame, FrameError>,
}

/// A log that is being read. Iterates over the frames of `/microbus`.
pub struct LogReader {
    messages: Messages,
    lanes: HashMap<u16, Option<Lane>>,
}

impl LogReader {
    /// Opens a log and reads what stands before its first frame.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a log of this program. A log that is cut short is not an error.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let messages = Messages::open(path, |channel| channel.topic == MICROBUS)?;
        Ok(Self { messages, lanes: HashMap::new() })
    }

    /// Of a complete log, reads only the chunks with frames whose log times are within `times`; which is a matter of
    /// milliseconds, however long the log is. A log without its index is read from its beginning, all of it. Comes before
    /// the iteration.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn narrow(&mut self, times: &RangeInclusive<WallTime>) -> Result<bool, LogError> {
        self.messages.narrow(times)
    }

    /// What the log says about itself; `None` if it is cut before it says so, and then it holds no frames either.
    #[must_use]
    pub const fn header(&self) -> Option<&LogHeader> {
        self.messages.header()
    }

    /// Whether the log ends before its footer. Known when the iteration has ended.
    #[must_use]
    pub const fn truncated(&self) -> bool {
        self.messages.truncated()
    }
}

impl Iterator for LogReader {
    type Item = Result<LoggedFrame, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (header, bytes) = match self.messages.next() {
                Ok(Some(message)) => message,
                Ok(None) => return None,
                Err(error) => return Some(Err(error)),
            };
            let channels = self.messages.channels();
            let lane = *self
                .lanes
                .entry(header.channel_id)
                .or_insert_with(|| channels.get(&header.channel_id).and_then(|listed| lane(&listed.channel)));
            if let Some(lane) = lane {
                let frame = Frame::decode(&bytes);
                return Some(Ok(LoggedFrame { log_time: WallTime(header.log_time), lane, bytes, frame }));
            }
        }
    }
}

/// The service that a channel of `/microbus` carries.
pub(super) fn lane(channel: &Channel) -> Option<Lane> {
    let name = channel.metadata.get(LANE)?;
    [Lane::Commands, Lane::Answers].into_iter().find(|&lane| name == lane_name(lane))
}
