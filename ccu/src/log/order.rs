//! One time order out of several sources: a buffer that holds values back until nothing older can be expected.
//!
//! Frames come from two services and eight senders, drained in turns, so that a frame may be handed over a little
//! after a younger one of somebody else. Held back for a while, they leave by tick, and by arrival within a tick.
//! Who hands over values of one source in the order of their ticks gets them back in that order.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use supersigma_protocol::{Tick, Ticks};

/// Values on their way into time order. The heap sorts small keys; the values stay where they are.
#[derive(Debug)]
pub(super) struct HoldBack<T> {
    /// By tick, then by arrival; the last is the value's slot.
    keys: BinaryHeap<Reverse<(Tick, u64, usize)>>,
    slots: Vec<Option<T>>,
    free: Vec<usize>,
    arrivals: u64,
    hold: Ticks,
}

impl<T> HoldBack<T> {
    /// Nothing leaves before it is `hold` old.
    pub(super) fn new(hold: Ticks) -> Self {
        Self { keys: BinaryHeap::new(), slots: Vec::new(), free: Vec::new(), arrivals: 0, hold }
    }

    /// Takes a value that belongs at tick `at`.
    pub(super) fn push(&mut self, at: Tick, value: T) {
        let slot = if let Some(slot) = self.free.pop() {
            self.slots[slot] = Some(value);
            slot
        } else {
            self.slots.push(Some(value));
            self.slots.len() - 1
        };
        self.keys.push(Reverse((at, self.arrivals, slot)));
        self.arrivals += 1;
    }

    /// The next value that is old enough at `now`.
    pub(super) fn pop_due(&mut self, now: Tick) -> Option<(Tick, T)> {
        let &Reverse((oldest, ..)) = self.keys.peek()?;
        if oldest <= now && now.since(oldest) >= self.hold { self.pop() } else { None }
    }

    /// The next value, however young.
    pub(super) fn pop(&mut self) -> Option<(Tick, T)> {
        let Reverse((at, _, slot)) = self.keys.pop()?;
        let value = self.slots[slot].take()?;
        self.free.push(slot);
        Some((at, value))
    }

    /// Everything in here, in no order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        self.slots.iter().flatten()
    }
}
