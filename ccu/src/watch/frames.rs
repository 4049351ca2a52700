//! The last frames that went by: kept as bytes, decoded and laid out only when somebody looks.

use std::collections::VecDeque;

use supersigma_protocol::bus::Lane;
use supersigma_protocol::{About, AxisNumber, Body, Frame, FrameError, Occasion};

use super::snapshot::FrameLine;
use crate::log::{AxisNames, FrameView, Lines, concerns};

/// How many frames are kept that say something, and how many of all.
const KEPT: usize = 1_000;

/// Which frames are wanted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Filter {
    /// Only those for this axis or from it.
    pub axis: Option<AxisNumber>,
    /// Only those in whose line this stands, in whatever case.
    pub text: String,
    /// Also samples and heartbeats, which repeat what is on the screen already.
    pub all: bool,
}

/// The last frames.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    names: AxisNames,
    lines: Lines,
    all: VecDeque<Kept>,
    telling: VecDeque<Kept>,
    count: u64,
}

#[derive(Debug, Clone)]
struct Kept {
    number: u64,
    lane: Lane,
    bytes: Vec<u8>,
}

impl Frames {
    pub(super) fn new(names: AxisNames) -> Self {
        let lines = Lines::narrow(&names);
        Self { names, lines, all: VecDeque::new(), telling: VecDeque::new(), count: 0 }
    }

    /// The titles over the lines.
    pub(super) fn title(&self) -> String {
        self.lines.title()
    }

    pub(super) fn keep(&mut self, lane: Lane, bytes: &[u8], frame: Result<&Frame, &FrameError>) {
        self.count += 1;
        let kept = Kept { number: self.count, lane, bytes: bytes.to_vec() };
        if tells_something(frame) {
            push(&mut self.telling, kept.clone());
        }
        push(&mut self.all, kept);
    }

    /// The last `many` frames that are wanted, oldest first.
    pub(super) fn last(&self, filter: &Filter, many: usize) -> Vec<FrameLine> {
        let text = filter.text.to_lowercase();
        let kept = if filter.all { &self.all } else { &self.telling };
        let mut lines: Vec<FrameLine> = kept
            .iter()
            .rev()
            .filter_map(|kept| self.line(kept, filter.axis))
            .filter(|line| text.is_empty() || line.text.to_lowercase().contains(&text))
            .take(many)
            .collect();
        lines.reverse();
        lines
    }

    fn line(&self, kept: &Kept, axis: Option<AxisNumber>) -> Option<FrameLine> {
        let frame = Frame::decode(&kept.bytes);
        if axis.is_some_and(|axis| !frame.as_ref().is_ok_and(|frame| concerns(frame, axis))) {
            return None;
        }
        let view = FrameView::new(&kept.bytes, frame.as_ref(), &self.names);
        Some(FrameLine { number: kept.number, lane: kept.lane.into(), text: self.lines.line(&view) })
    }
}

fn push(ring: &mut VecDeque<Kept>, kept: Kept) {
    if ring.len() == KEPT {
        ring.pop_front();
    }
    ring.push_back(kept);
}

fn tells_something(frame: Result<&Frame, &FrameError>) -> bool {
    let about = match frame {
        Ok(Frame { body: Body::Answer(answer), .. }) => answer.about,
        _ => return true,
    };
    !matches!(about, About::Unasked(Occasion::Sampled | Occasion::Heartbeat))
}
