//! A log's raw frames side by side with their JSON twins. The twin of a frame follows from the frame alone, so either of
//! the two tells whether the other one is still what was written.

use std::path::{Path, PathBuf};

use mcap::records::Channel;
use supersigma_protocol::Frame;

use super::LogError;
use super::channels::{EVENTS, JOINTS, MICROBUS};
use super::header::{LogHeader, WallTime};
use super::messages::Messages;
use super::reader::{LoggedFrame, lane};
use super::rotation::part_path;

/// A frame of a log, and what stands beside it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Twinned {
    /// Its place among the log's frames; the first one is 1.
    pub number: u64,
    /// The frame.
    pub logged: LoggedFrame,
    /// Its twin as it stands in the log.
    pub twin: Option<Vec<u8>>,
}

/// A log that is being read with its twins, on into the files in which it goes on.
pub struct TwinReader {
    path: PathBuf,
    /// Of the file that is being read, from 1.
    part: u32,
    messages: Messages,
    /// A frame whose twin is still to come.
    held: Option<LoggedFrame>,
    number: u64,
    ended: bool,
}

impl TwinReader {
    /// Opens a log and reads what stands before its first frame.
    ///
    /// # Errors
    /// As [`LogReader::open`](super::LogReader::open).
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let messages = Messages::open(path, wanted)?;
        Ok(Self { path: path.to_owned(), part: 1, messages, held: None, number: 0, ended: false })
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

    fn give(&mut self, twin: Option<Vec<u8>>) -> Option<Twinned> {
        let logged = self.held.take()?;
        self.number += 1;
        Some(Twinned { number: self.number, logged, twin })
    }

    /// The file in which the log goes on although the one before it is cut: its recorder was killed, and another took its
    /// place. It is not read, for nobody knows what is missing between the two. Known when the iteration has ended.
    ///
    /// # Errors
    /// If a file that may be the one cannot be read.
    pub fn next_file(&self) -> Result<Option<PathBuf>, LogError> {
        Ok(self.next_part()?.map(|(part, _)| part_path(&self.path, part)))
    }

    /// The log's next file that is of the same set's life: in between may stand what was there before.
    fn next_part(&self) -> Result<Option<(u32, Messages)>, LogError> {
        let life = |header: &LogHeader| (header.set.clone(), header.timeline);
        let own = self.header().map(life);
        for part in self.part + 1.. {
            let next = part_path(&self.path, part);
            if !next.exists() {
                break;
            }
            let messages = Messages::open(&next, wanted)?;
            if messages.header().map(life) == own {
                return Ok(Some((part, messages)));
            }
        }
        Ok(None)
    }

    /// Goes on with the log's next file, if there is one.
    fn go_on(&mut self) -> Result<bool, LogError> {
        if self.truncated() {
            return Ok(false);
        }
        let Some((part, messages)) = self.next_part()? else { return Ok(false) };
        (self.messages, self.part) = (messages, part);
        Ok(true)
    }

    fn step(&mut self) -> Result<Option<Twinned>, LogError> {
        while !self.ended {
            let Some((header, bytes)) = self.messages.next()? else {
                self.ended = !self.go_on()?;
                continue;
            };
            let Some(listed) = self.messages.channels().get(&header.channel_id) else { continue };
            let twinned = if listed.channel.topic == MICROBUS {
                let lane = lane(&listed.channel);
                let alone = self.give(None);
                self.held = lane.map(|lane| LoggedFrame {
                    log_time: WallTime(header.log_time),
                    lane,
                    frame: Frame::decode(&bytes),
                    bytes,
                });
                alone
            } else {
                self.give(Some(bytes))
            };
            if twinned.is_some() {
                return Ok(twinned);
            }
        }
        Ok(self.give(None))
    }
}

impl Iterator for TwinReader {
    type Item = Result<Twinned, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let step = self.step();
        self.ended |= step.is_err();
        step.transpose()
    }
}

/// Everything but what follows from several frames, or tells of them in words.
fn wanted(channel: &Channel) -> bool {
    ![EVENTS, JOINTS].contains(&channel.topic.as_str())
}
