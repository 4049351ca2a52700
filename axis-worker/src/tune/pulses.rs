//! Pulse trains as lists of periods: what a motor sees, whatever made them.

use supersigma_protocol::{Tick, Ticks};

use crate::bench::Train;
use crate::ramp::Plan;

/// The pulses of one movement.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pulses(Vec<u32>);

impl Pulses {
    /// One pulse at the end of each of these periods, in ticks.
    #[must_use]
    pub const fn new(periods: Vec<u32>) -> Self {
        Self(periods)
    }

    /// The period before each pulse, in ticks.
    #[must_use]
    pub fn periods(&self) -> &[u32] {
        &self.0
    }

    /// How many pulses.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// From the start to the last pulse.
    #[must_use]
    pub fn duration(&self) -> Ticks {
        Ticks(self.0.iter().map(|period| u64::from(*period)).sum())
    }

    /// The largest frequency, half steps/s.
    #[must_use]
    pub fn top_speed(&self) -> f64 {
        self.0.iter().min().map_or(0.0, |period| speed(*period))
    }
}

impl From<&Plan> for Pulses {
    fn from(plan: &Plan) -> Self {
        Self(plan.periods().collect())
    }
}

impl From<&Train> for Pulses {
    fn from(train: &Train) -> Self {
        // A clock of the bench is two ticks.
        Self(train.periods().map(|period| period.clocks() * 2).collect())
    }
}

/// Half steps/s of a period in ticks.
#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
pub(super) fn speed(period: u32) -> f64 {
    Tick::PER_SECOND as f64 / f64::from(period)
}
