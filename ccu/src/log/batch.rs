//! Messages on their way into the file, many at a time, in memory that is used again. It knows neither what they say nor
//! how a file is made.

use supersigma_protocol::Sequence;
use supersigma_protocol::bus::Lane;

use super::header::WallTime;
use super::told::Topic;

/// The length from which a batch is handed over: long enough that handing over costs nothing, short enough that whoever
/// waits for the last one does not wait long.
const FULL: usize = 32 << 10;

/// Where a message belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// The raw frames of one service.
    Microbus(Lane),
    /// A topic of JSON messages.
    Topic(Topic),
}

/// What stands on a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Label {
    pub(super) place: Place,
    /// Its number on the channel; without one, messages are counted.
    pub(super) number: Option<Sequence>,
    pub(super) log_time: WallTime,
    pub(super) publish_time: WallTime,
}

/// Some messages, in the order of the log.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// With the place in `data` at which each message ends.
    labels: Vec<(Label, usize)>,
    data: Vec<u8>,
}

impl Batch {
    /// Appends a message.
    pub(super) fn put(&mut self, label: Label, data: &[u8]) {
        self.data.extend_from_slice(data);
        self.labels.push((label, self.data.len()));
    }

    pub(super) fn is_full(&self) -> bool {
        self.data.len() >= FULL
    }

    pub(super) fn messages(&self) -> impl Iterator<Item = (&Label, &[u8])> {
        let mut begin = 0;
        self.labels.iter().map(move |(label, end)| {
            let begin = std::mem::replace(&mut begin, *end);
            (label, &self.data[begin..*end])
        })
    }

    /// Takes everything out; the memory stays.
    pub(super) fn clear(&mut self) {
        self.labels.clear();
        self.data.clear();
    }
}
