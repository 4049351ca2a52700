//! A log's raw frames side by side with their JSON twins. The twin of a frame follows from the frame alone, so either of
//! the two tells whether the other one is still what was written.

use std::path::Path;

use supersigma_protocol::{CardKind, Frame, Report};

use super::LogError;
use super::header::{AxisNames, LogHeader};
use super::reader::{LogReader, LoggedFrame, Step};
use super::schema::twin;
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

/// A log that is being read with its twins.
pub struct TwinReader {
    reader: LogReader,
    /// A frame whose twin is still to come.
    held: Option<LoggedFrame>,
    number: u64,
}

impl TwinReader {
    /// Opens a log and reads what stands before its first frame.
    ///
    /// # Errors
    /// As [`LogReader::open`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        Ok(Self { reader: LogReader::open(path)?.with_twins(), held: None, number: 0 })
    }

    /// As [`LogReader::header`].
    #[must_use]
    pub const fn header(&self) -> Option<&LogHeader> {
        self.reader.header()
    }

    /// As [`LogReader::truncated`].
    #[must_use]
    pub const fn truncated(&self) -> bool {
        self.reader.truncated()
    }

    fn give(&mut self, twin: Option<Vec<u8>>) -> Option<Twinned> {
        let logged = self.held.take()?;
        self.number += 1;
        Some(Twinned { number: self.number, logged, twin })
    }
}

impl Iterator for TwinReader {
    type Item = Result<Twinned, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.reader.step() {
                Ok(Step::Frame(frame)) => {
                    let alone = self.give(None);
                    self.held = Some(frame);
                    if let Some(alone) = alone {
                        return Some(Ok(alone));
                    }
                }
                Ok(Step::Twin(twin)) => {
                    if let Some(twinned) = self.give(Some(twin)) {
                        return Some(Ok(twinned));
                    }
                }
                Ok(Step::Message | Step::Other) => {}
                Ok(Step::End) => return self.give(None).map(Ok),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// The twin that belongs to a frame; `None` for a motor's state under an address that is no axis', which has none.
#[must_use]
pub fn twin_of(frame: &Frame, bytes: &[u8], names: &AxisNames) -> Option<Vec<u8>> {
    match FrameView::new(bytes, Ok(frame), names) {
        FrameView::Answer(view) => match &frame.body {
            supersigma_protocol::Body::Answer(answer)
                if matches!(answer.report, Report::Axis(_))
                    && !matches!(answer.card.kind(), CardKind::Axis(_)) =>
            {
                None
            }
            _ => Some(twin(&view)),
        },
        FrameView::Command(view) => Some(twin(&view)),
        FrameView::Undecodable(_) => None,
    }
}
