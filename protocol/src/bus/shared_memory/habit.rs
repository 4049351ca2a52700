//! Whether a port looks for the next frame for a moment before it sleeps. To be woken costs more than all else that a frame
//! costs, so where question and answer follow each other closely it pays to stay awake; where they do not, it is waste. So a
//! port stays awake only as long as experience says that something comes at once.

use std::num::NonZero;
use std::thread;
use std::time::Duration;

/// How long it stays awake.
pub(super) const AWAKE: Duration = Duration::from_micros(100);
/// So many sleeps, one after the other, have to be shorter than that.
const SHORT_SLEEPS: i8 = 8;
/// So many more, once it has stayed awake for nothing.
const SETBACK: i8 = 32;

/// What a port has experienced.
#[derive(Debug)]
pub(super) struct Habit {
    /// Short sleeps of late.
    short: i8,
    /// Whether others can run meanwhile.
    has_company: bool,
}

impl Habit {
    /// None yet.
    pub(super) fn new() -> Self {
        Self {
            short: 0,
            has_company: thread::available_parallelism().is_ok_and(|cores| cores > NonZero::<usize>::MIN),
        }
    }

    /// Whether to stay awake.
    pub(super) const fn stays_awake(&self) -> bool {
        self.has_company && self.short >= SHORT_SLEEPS
    }

    /// It stayed awake, and nothing came.
    pub(super) const fn was_in_vain(&mut self) {
        self.short = -SETBACK;
    }

    /// It slept for so long until it was woken, or for nothing.
    pub(super) fn slept(&mut self, woken_after: Option<Duration>) {
        self.short = match woken_after {
            Some(time) if time < AWAKE => self.short.saturating_add(1).min(SHORT_SLEEPS),
            _ => self.short.min(0),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Option<Duration> = Some(Duration::from_micros(40));

    fn after(habit: &mut Habit, sleeps: i8) -> bool {
        (0..sleeps).for_each(|_| habit.slept(SHORT));
        habit.stays_awake()
    }

    #[test]
    fn only_short_sleeps_one_after_the_other_keep_a_port_awake() {
        let mut habit = Habit { short: 0, has_company: true };
        assert!(!after(&mut habit, SHORT_SLEEPS - 1));
        assert!(after(&mut habit, 1));
        habit.slept(None);
        assert!(!after(&mut habit, SHORT_SLEEPS - 1));
        habit.slept(Some(Duration::from_millis(2)));
        assert!(!after(&mut habit, SHORT_SLEEPS - 1));
        assert!(after(&mut habit, 1));
        habit.was_in_vain();
        assert!(!after(&mut habit, SETBACK + SHORT_SLEEPS - 1));
        assert!(after(&mut habit, 1));
    }

    #[test]
    fn alone_on_its_processor_a_port_sleeps() {
        assert!(!after(&mut Habit { short: 0, has_company: false }, SHORT_SLEEPS));
    }
}
