//! A log's raw frames side by side with their JSON twins. The twin of a frame follows from the frame alone, so either of
//! the two tells whether the other one is still what was written.

use std::path::{Path, PathBuf};

use mcap::records::Channel;
use supersigma_protocol::{Body, CardKind, Frame, Report};

use super::LogError;
use super::channels::{EVENTS, JOINTS, MICROBUS};
use super::header::{AxisNames, LogHeader, WallTime};
use super::messages::Messages;
use super::reader::{LoggedFrame, lane};
use super::rotation::part_path;
use super::schema::twin_into;
use super::view::FrameView;

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

    /// Goes on with the log's next file, if there is one and it is of the same set's life.
    fn go_on(&mut self) -> Result<bool, LogError> {
        let next = part_path(&self.path, self.part + 1);
        if self.truncated() || !next.exists() {
            return Ok(false);
        }
        let messages = Messages::open(&next, wanted)?;
        let life = |header: &LogHeader| (header.set.clone(), header.timeline);
        if messages.header().map(life) != self.header().map(life) {
            return Ok(false);
        }
        (self.messages, self.part) = (messages, self.part + 1);
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

/// Writes the twin that belongs to a frame. Returns whether it has one: a motor's state under an address that is no axis'
/// has none.
pub fn twin_of(frame: &Frame, bytes: &[u8], names: &AxisNames, into: &mut Vec<u8>) -> bool {
    into.clear();
    if let Body::Answer(answer) = &frame.body
        && matches!(answer.report, Report::Axis(_))
        && !matches!(answer.card.kind(), CardKind::Axis(_))
    {
        return false;
    }
    match FrameView::new(bytes, Ok(frame), names) {
        FrameView::Command(view) => twin_into(&view, into),
        FrameView::Answer(view) => twin_into(&view, into),
        FrameView::Undecodable(_) => return false,
    }
    true
}
