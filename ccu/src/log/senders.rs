//! Who speaks on the bus, and whether every frame of theirs arrived. It counts; what a gap leads to is decided elsewhere.

use std::collections::BTreeMap;

use supersigma_protocol::{About, Body, Frame, Occasion, Sender, Sequence, Tick};

/// Frames of one sender that never arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// Whose they were.
    pub sender: Sender,
    /// The sequence number that was due.
    pub expected: Sequence,
    /// The one that came.
    pub got: Sequence,
}

impl Gap {
    /// How many frames are missing at least. A number below the one that was due belongs to a new life of the sender,
    /// whose first frames are missing.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        if self.got.0 > self.expected.0 { self.got.0 - self.expected.0 } else { self.got.0 }
    }
}

/// Everybody who has spoken.
#[derive(Debug, Default)]
pub(super) struct Senders {
    lives: BTreeMap<Sender, Life>,
    /// Whether they may have spoken before; then nothing is known to be missing before the first frame of each.
    joined_late: bool,
}

#[derive(Debug, Default)]
struct Life {
    next: Sequence,
    /// The latest place in time that a frame of this sender was given.
    placed: Tick,
    left: bool,
}

impl Senders {
    /// Everybody, for one who comes when they may have spoken before.
    pub(super) fn joined_late() -> Self {
        Self { joined_late: true, ..Self::default() }
    }

    /// Takes note of a frame: the gap before it, if there is one, and its place in time, which is `wanted` or, so
    /// that a sender's frames keep their order, the place of the one before.
    pub(super) fn note(&mut self, frame: &Frame, wanted: Tick) -> (Option<Gap>, Tick) {
        let first = if self.joined_late { frame.sequence } else { Sequence(0) };
        let life = self.lives.entry(frame.sender).or_insert(Life { next: first, ..Life::default() });
        let expected = life.next;
        life.next = frame.sequence.next();
        life.placed = life.placed.max(wanted);
        life.left =
            matches!(&frame.body, Body::Answer(answer) if answer.about == About::Unasked(Occasion::Leaving));
        let gap = (frame.sequence != expected && frame.sequence != Sequence(0)).then_some(Gap {
            sender: frame.sender,
            expected,
            got: frame.sequence,
        });
        (gap, life.placed)
    }

    /// Whether cards have spoken and each of them has said that it leaves. The CCU does not announce its end.
    pub(super) fn all_cards_left(&self) -> bool {
        let mut cards = self.lives.iter().filter(|(sender, _)| matches!(sender, Sender::Card(_))).peekable();
        cards.peek().is_some() && cards.all(|(_, life)| life.left)
    }
}
