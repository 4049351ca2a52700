//! What the CCU has sent, by number, for as long as a card may still have to take it.

use std::collections::BTreeMap;

use supersigma_config::Config;
use supersigma_protocol::{Address, AxisNumber, Body, CardKind, Frame, Sequence, Tick};

/// The CCU's frames.
#[derive(Debug)]
pub(super) struct Commands {
    axes: Vec<AxisNumber>,
    /// The number after the last one.
    next: Sequence,
    gaps: bool,
    kept: BTreeMap<Sequence, Kept>,
}

#[derive(Debug)]
struct Kept {
    frame: Frame,
    /// How many cards have not taken it yet.
    waiting: usize,
}

impl Commands {
    pub(super) fn new(config: &Config) -> Self {
        let axes = config.axes.iter().map(|axis| axis.address).collect();
        Self { axes, next: Sequence(0), gaps: false, kept: BTreeMap::new() }
    }

    /// Keeps a frame of the CCU, if there is a card that it is for.
    pub(super) fn note(&mut self, frame: Frame) {
        self.gaps |= frame.sequence != self.next;
        self.next = self.next.max(frame.sequence.next());
        let waiting = match &frame.body {
            Body::Fault(axis, _) => usize::from(self.axes.contains(axis)),
            Body::Command(broadcast) => {
                match broadcast.bytes.as_slice().first().map(|to| Address(*to).kind()) {
                    Some(CardKind::Everyone) => self.axes.len(),
                    Some(CardKind::Axis(axis)) => usize::from(self.axes.contains(&axis)),
                    Some(CardKind::DigitalInput | CardKind::DigitalOutput) => 1,
                    Some(CardKind::Unknown(_)) | None => 0,
                }
            }
            Body::Answer(_) => 0,
        };
        if waiting > 0 {
            self.kept.insert(frame.sequence, Kept { frame, waiting });
        }
    }

    /// The frame with this number, for one card that takes it.
    pub(super) fn take(&mut self, sequence: Sequence) -> Option<Frame> {
        let kept = self.kept.get_mut(&sequence)?;
        kept.waiting -= 1;
        if kept.waiting > 0 {
            return Some(kept.frame.clone());
        }
        self.kept.remove(&sequence).map(|kept| kept.frame)
    }

    /// When the frame with this number was sent, if it is here.
    pub(super) fn sent(&self, sequence: Sequence) -> Option<Tick> {
        self.kept.get(&sequence).map(|kept| kept.frame.tick)
    }

    /// Whether the frame with this number may still come.
    pub(super) fn may_come(&self, sequence: Sequence) -> bool {
        sequence >= self.next
    }

    /// Whether frames are missing.
    pub(super) fn has_gaps(&self) -> bool {
        self.gaps
    }

    /// The first fault of `card` with a number not below `from`.
    pub(super) fn fault(&self, card: Address, from: Sequence) -> Option<Sequence> {
        let of_the_card =
            |kept: &Kept| matches!(kept.frame.body, Body::Fault(axis, _) if axis.address() == card);
        self.kept.range(from..).find(|(_, kept)| of_the_card(kept)).map(|(sequence, _)| *sequence)
    }
}
