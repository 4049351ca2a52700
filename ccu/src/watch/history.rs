//! Values over time in equal steps, and how many of something there were in the last second. No clock: time is given.

use std::collections::VecDeque;
use std::time::Duration;

/// How many slots are kept: a minute.
pub(super) const SLOTS: usize = 600;
/// The length of a slot, in real time.
pub(super) const SLOT: Duration = Duration::from_millis(100);

/// The slot in which `at` lies.
pub(super) fn slot(at: Duration) -> u64 {
    u64::try_from(at.as_millis() / SLOT.as_millis()).unwrap_or(u64::MAX)
}

/// A value a slot, the newest last. A slot in which nothing new was told goes on with the value before.
#[derive(Debug, Clone)]
pub(super) struct History<T> {
    slots: VecDeque<T>,
    /// The number of the newest slot.
    newest: u64,
    /// What holds now.
    value: T,
}

impl<T: Copy> History<T> {
    pub(super) fn new(value: T) -> Self {
        Self { slots: VecDeque::from([value]), newest: 0, value }
    }

    /// Lets time pass, up to the slot `to`; time that stands still, or goes back, changes nothing.
    pub(super) fn advance(&mut self, to: u64) {
        let missing = usize::try_from(to.saturating_sub(self.newest)).unwrap_or(SLOTS).min(SLOTS);
        for _ in 0..missing {
            if self.slots.len() == SLOTS {
                self.slots.pop_front();
            }
            self.slots.push_back(self.value);
        }
        self.newest = self.newest.max(to);
    }

    /// A new value; the newest slot shows it if `prevails` says so of what the slot has and of the new one.
    pub(super) fn put(&mut self, value: T, prevails: impl Fn(T, T) -> bool) {
        self.value = value;
        if let Some(newest) = self.slots.back_mut()
            && prevails(*newest, value)
        {
            *newest = value;
        }
    }

    /// The last `many` slots, oldest first.
    pub(super) fn last(&self, many: usize) -> impl Iterator<Item = T> {
        self.slots.iter().skip(self.slots.len().saturating_sub(many)).copied()
    }
}

/// How many there were in the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct Rate {
    /// The slots of the second before the running one, and the running one last.
    slots: VecDeque<u64>,
    newest: u64,
}

impl Rate {
    /// Slots in a second.
    const SECOND: usize = 10;

    pub(super) fn advance(&mut self, to: u64) {
        let missing = usize::try_from(to.saturating_sub(self.newest)).unwrap_or(usize::MAX);
        for _ in 0..missing.min(Self::SECOND + 1) {
            self.slots.push_back(0);
        }
        while self.slots.len() > Self::SECOND + 1 {
            self.slots.pop_front();
        }
        self.newest = self.newest.max(to);
    }

    pub(super) fn count(&mut self) {
        match self.slots.back_mut() {
            Some(newest) => *newest += 1,
            None => self.slots.push_back(1),
        }
    }

    /// The count in the last whole second; the running slot is not over and does not count yet.
    pub(super) fn per_second(&self) -> u64 {
        self.slots.iter().rev().skip(1).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_shows_what_prevails_and_the_next_what_is() {
        let mut speed = History::new(0);
        let peak = |old: i32, new: i32| new.abs() >= old.abs();
        speed.advance(1);
        speed.put(-700, peak);
        speed.put(20, peak);
        speed.advance(3);
        assert_eq!(speed.last(10).collect::<Vec<_>>(), [0, -700, 20, 20]);
        speed.advance(2);
        assert_eq!(speed.last(2).collect::<Vec<_>>(), [20, 20]);
    }

    #[test]
    fn a_history_is_a_minute_however_long_nothing_came() {
        let mut values = History::new(1_u8);
        values.put(2, |_, _| true);
        values.advance(u64::MAX);
        assert_eq!(values.last(usize::MAX).count(), SLOTS);
        assert!(values.last(usize::MAX).all(|value| value == 2));
    }

    #[test]
    fn a_rate_is_that_of_the_last_whole_second() {
        let mut rate = Rate::default();
        for slot in 1..=30 {
            rate.advance(slot);
            for _ in 0..slot {
                rate.count();
            }
        }
        // Slots 20 to 29: (20 + 29) * 5.
        assert_eq!(rate.per_second(), 245);
        rate.advance(36);
        // Of slots 26 to 35 four had something, and then the thirtieth: 26 + 27 + 28 + 29 + 30.
        assert_eq!(rate.per_second(), 140);
        rate.advance(1_000_000);
        assert_eq!(rate.per_second(), 0);
    }
}
