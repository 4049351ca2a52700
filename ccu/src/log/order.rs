//! One time order out of several sources: a buffer that holds values back until nothing older can be expected.
//!
//! Frames come from two services and eight senders, drained in turns, so that a frame may be handed over a little
//! after a younger one of somebody else. Held back for a while, they leave by tick, and by arrival within a tick.
//! Who hands over values of one source in the order of their ticks gets them back in that order.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use supersigma_protocol::{Tick, Ticks};

/// Values on their way into time order.
#[derive(Debug)]
pub(super) struct HoldBack<T> {
    held: BinaryHeap<Held<T>>,
    arrivals: u64,
    hold: Ticks,
}

impl<T> HoldBack<T> {
    /// Nothing leaves before it is `hold` old.
    pub(super) fn new(hold: Ticks) -> Self {
        Self { held: BinaryHeap::new(), arrivals: 0, hold }
    }

    /// Takes a value that belongs at tick `at`.
    pub(super) fn push(&mut self, at: Tick, value: T) {
        self.held.push(Held { at, arrival: self.arrivals, value });
        self.arrivals += 1;
    }

    /// The next value that is old enough at `now`.
    pub(super) fn pop_due(&mut self, now: Tick) -> Option<(Tick, T)> {
        let oldest = self.held.peek()?;
        if oldest.at <= now && now.since(oldest.at) >= self.hold { self.pop() } else { None }
    }

    /// The next value, however young.
    pub(super) fn pop(&mut self) -> Option<(Tick, T)> {
        self.held.pop().map(|held| (held.at, held.value))
    }

    /// Everything in here, in no order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        self.held.iter().map(|held| &held.value)
    }
}

#[derive(Debug)]
struct Held<T> {
    at: Tick,
    arrival: u64,
    value: T,
}

/// `BinaryHeap` gives the greatest first: the earliest is the greatest here.
impl<T> Ord for Held<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        (other.at, other.arrival).cmp(&(self.at, self.arrival))
    }
}

impl<T> PartialOrd for Held<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> PartialEq for Held<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T> Eq for Held<T> {}
