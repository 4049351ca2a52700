//! TEST-NS of \[M\]: whether the motor made its steps, judged by nothing but pulses given and counts read.
//!
//! A motor never loses one step: it falls back by whole electrical cycles, eight half steps ([`crate::motor`]). So a rotor at rest
//! made that number of steps, a multiple of eight from those commanded, which is nearest to where it stands; friction and
//! load may hold it some way off. While it runs it lags. At half a cycle the torque is zero; beyond that it may still be
//! caught by the next pulses' swing, but not past three quarters. So the place at which a step was lost is where the lag
//! last went over half a cycle before it reached three quarters.
//!
//! ```text
//!  lag   0        2        4        6        8   half steps
//!        ├────────┴────────┼────────┼────────┤
//!          pulled forward    back?    lost
//! ```

use supersigma_protocol::Tick;

use super::units::Period;
use crate::motor::Counts;
use supersigma_config::{HALF_STEPS_PER_CYCLE, MotorConfig};

const CYCLE: i64 = HALF_STEPS_PER_CYCLE as i64;

/// A place in a pulse train.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// The last pulse given until then, from 1; 0 is before the first.
    pub pulse: u64,
    /// When it was noticed: at a sample.
    pub at: Tick,
    /// The period that ended with that pulse; `None` before the first.
    pub period: Option<Period>,
}

/// Steps given and steps made; both negative towards the origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Confirmed {
    /// Pulses.
    pub commanded: i64,
    /// What the encoder says.
    pub measured: i64,
    /// Where the first steps were lost, or gained; it may be that later ones made up for them.
    pub first_lost: Option<Place>,
}

impl Confirmed {
    /// Steps that were given and not made; negative if more were made than given.
    #[must_use]
    pub fn lost(&self) -> i64 {
        (self.commanded - self.measured) * if self.commanded < 0 { -1 } else { 1 }
    }
}

/// The comparison, sample by sample.
#[derive(Debug, Clone)]
pub(super) struct Confirmation {
    counts_per_turn: i64,
    half_steps_per_turn: i64,
    /// Where the lag went over half a cycle, while it is.
    suspected: Option<Place>,
    first_lost: Option<Place>,
}

impl Confirmation {
    pub(super) fn new(motor: &MotorConfig) -> Self {
        Self {
            counts_per_turn: 4 * i64::from(motor.encoder_lines),
            half_steps_per_turn: i64::from(motor.half_steps_per_turn),
            suspected: None,
            first_lost: None,
        }
    }

    pub(super) fn see(&mut self, commanded: i64, position: Counts, place: Place) {
        if self.first_lost.is_some() {
            return;
        }
        let lag = self.lag(commanded, position).abs();
        if lag <= self.counts_per_turn * CYCLE / 2 {
            self.suspected = None;
            return;
        }
        let suspected = *self.suspected.get_or_insert(place);
        if lag >= self.counts_per_turn * CYCLE * 3 / 4 {
            self.first_lost = Some(suspected);
        }
    }

    pub(super) fn finish(&self, commanded: i64, position: Counts) -> Confirmed {
        let cycle = self.counts_per_turn * CYCLE;
        let cycles = (self.lag(commanded, position) + cycle / 2).div_euclid(cycle);
        Confirmed { commanded, measured: commanded - CYCLE * cycles, first_lost: self.first_lost }
    }

    /// How far the rotor is behind, in half steps times counts per turn, which is a whole number.
    fn lag(&self, commanded: i64, position: Counts) -> i64 {
        commanded * self.counts_per_turn - position.0 * self.half_steps_per_turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(pulse: u64) -> Place {
        Place { pulse, at: Tick(pulse * 100), period: Period::new(50) }
    }

    /// Twenty counts to a half step.
    fn confirmation() -> Confirmation {
        Confirmation::new(&MotorConfig::bench())
    }

    #[test]
    fn a_lag_that_is_made_good_is_no_loss() {
        let mut confirmation = confirmation();
        for (pulse, commanded, counts) in [(1, 1, 0), (5, 5, 0), (6, 6, 1), (6, 6, 40), (6, 6, 120)] {
            confirmation.see(commanded, Counts(counts), place(pulse));
        }
        let confirmed = confirmation.finish(6, Counts(118));
        assert_eq!(confirmed, Confirmed { commanded: 6, measured: 6, first_lost: None });
    }

    #[test]
    fn the_first_loss_is_where_the_lag_went_over_half_a_cycle_for_good() {
        for sense in [1, -1] {
            let mut confirmation = confirmation();
            // 5 behind, back to 3, 5 again, 7.
            for (pulse, steps, counts) in [(6, 6, 20), (6, 6, 60), (9, 9, 80), (10, 10, 60), (20, 20, 0)] {
                confirmation.see(sense * steps, Counts(sense * counts), place(pulse));
            }
            let confirmed = confirmation.finish(sense * 20, Counts(sense * 83));
            assert_eq!(confirmed.measured, sense * 4);
            assert_eq!(confirmed.lost(), 16);
            assert_eq!(confirmed.first_lost, Some(place(9)));
        }
    }

    #[test]
    fn steps_can_be_gained() {
        let mut confirmation = confirmation();
        confirmation.see(10, Counts(285), place(10));
        confirmation.see(10, Counts(330), place(10));
        let confirmed = confirmation.finish(10, Counts(361));
        assert_eq!((confirmed.measured, confirmed.lost()), (18, -8));
        assert_eq!(confirmed.first_lost, Some(place(10)));
    }
}
