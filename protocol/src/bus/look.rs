//! When it is worth a processor's time to look for a frame before sleeping. To be woken costs some 25 µs; a frame that is
//! expected sooner than that, and for which somebody looks, is there in one. Whoever looks in vain takes the processor from
//! those who work, so it is done for some tens of microseconds only, in the middle of a conversation, where there are
//! processors to spare, and not any more as soon as it does not pay.

use std::thread;
use std::time::{Duration, Instant};

use super::{BusError, Receive};

/// What being woken may take: a frame that ends a sleep has come so much earlier.
const WAKING: Duration = Duration::from_micros(40);
/// After so many looks in vain, one after the other, none is taken for a while.
const PATIENCE: u32 = 3;
/// How many occasions are then let pass; after each further look in vain twice as many.
const FEWEST_PASSED: u32 = 32;
const MOST_PASSED: u32 = 4096;

/// One reader's decision whether to look or to sleep.
#[derive(Debug, Clone)]
pub struct Look {
    longest: Duration,
    /// The last frame came so soon that looking for it would have paid.
    conversing: bool,
    /// Looks in vain, one after the other.
    missed: u32,
    /// Occasions that are still to be let pass.
    pass: u32,
}

impl Look {
    /// Looks for `longest` at most at a time; never, if that is zero or this process has one processor alone.
    #[must_use]
    pub fn new(longest: Duration) -> Self {
        let several = thread::available_parallelism().is_ok_and(|processors| processors.get() > 1);
        Self::with(if several { longest } else { Duration::ZERO })
    }

    fn with(longest: Duration) -> Self {
        Self { longest, conversing: false, missed: 0, pass: 0 }
    }

    /// Looks for a frame that must come soon, because it was asked for just now; whether there is one.
    ///
    /// # Errors
    /// If the bus itself fails.
    pub fn for_answer<R: Receive + ?Sized>(&mut self, port: &R) -> Result<bool, BusError> {
        self.take(|longest| port.look(longest))
    }

    /// Like [`Receive::wait`], and looks before if the last frame came so soon that the next one may as well.
    ///
    /// # Errors
    /// If the bus itself fails.
    pub fn wait<R: Receive + ?Sized>(&mut self, port: &R, limit: Duration) -> Result<(), BusError> {
        if self.longest.is_zero() {
            return port.wait(limit);
        }
        let began = Instant::now();
        if self.conversing && self.take(|longest| port.look(longest.min(limit)))? {
            return Ok(());
        }
        port.wait(limit.saturating_sub(began.elapsed()))?;
        let waited = began.elapsed();
        self.woken(waited, port.look(Duration::ZERO)?);
        Ok(())
    }

    /// Takes note of a sleep and of whether a frame has ended it. A line that was raised for a frame already taken ends a
    /// sleep too; that says nothing.
    fn woken(&mut self, waited: Duration, frame: bool) {
        if waited > self.longest + WAKING {
            self.conversing = false;
        } else if frame {
            self.conversing = true;
        }
    }

    fn take(&mut self, look: impl FnOnce(Duration) -> Result<bool, BusError>) -> Result<bool, BusError> {
        if self.longest.is_zero() {
            return Ok(false);
        }
        if self.pass > 0 {
            self.pass -= 1;
            return Ok(false);
        }
        let found = look(self.longest)?;
        if found {
            self.missed = 0;
        } else {
            self.missed += 1;
            if let Some(excess) = self.missed.checked_sub(PATIENCE) {
                self.pass = FEWEST_PASSED.saturating_mul(1 << excess.min(16)).min(MOST_PASSED);
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONGEST: Duration = Duration::from_micros(50);

    /// How many of so many occasions are taken, if every look ends as `found` says.
    fn taken(look: &mut Look, occasions: usize, found: bool) -> usize {
        let mut taken = 0;
        for _ in 0..occasions {
            let _ = look.take(|longest| {
                assert_eq!(longest, LONGEST);
                taken += 1;
                Ok(found)
            });
        }
        taken
    }

    #[test]
    fn looks_that_pay_are_all_taken() {
        assert_eq!(taken(&mut Look::with(LONGEST), 100, true), 100);
    }

    #[test]
    fn looks_in_vain_become_rare() {
        let mut look = Look::with(LONGEST);
        assert_eq!(taken(&mut look, 3 + 32, false), 3);
        assert_eq!(taken(&mut look, 1 + 64, false), 1);
        assert_eq!(taken(&mut look, 1 + 128, false), 1);
        // One that pays makes up for all.
        assert_eq!(taken(&mut look, 10, true), 10);
        assert_eq!(taken(&mut look, 3, false), 3);
        let many = usize::try_from(MOST_PASSED).expect("small") * 10;
        assert!(taken(&mut look, many, false) < 20);
    }

    #[test]
    fn who_may_not_look_never_does() {
        assert_eq!(taken(&mut Look::with(Duration::ZERO), 10, false), 0);
    }

    #[test]
    fn a_conversation_begins_with_a_frame_that_came_soon_and_ends_with_silence() {
        let mut look = Look::with(LONGEST);
        look.woken(LONGEST, true);
        assert!(look.conversing);
        look.woken(LONGEST, false);
        assert!(look.conversing, "a line raised for an earlier frame");
        look.woken(Duration::from_millis(100), true);
        assert!(!look.conversing);
    }
}
