//! Ticks and real time: one epoch on `CLOCK_MONOTONIC`, shared by every process of a set, and one time scale. The only
//! place where a clock is read. Floating point is good enough here: it paces, it does not count pulses.

use std::str::FromStr;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use supersigma_protocol::{Tick, Ticks};

/// How many times faster than real time the machine's time runs: 0.01 to 1 000.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct TimeScale(f64);

/// A time scale that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no time scale; it is a number from 0.01 to 1000, how many times faster than real time")]
pub struct NoTimeScale(String);

impl TimeScale {
    /// Machine time is real time.
    pub const REAL: Self = Self(1.0);

    /// `None` outside 0.01 ..= 1 000.
    #[must_use]
    pub fn new(factor: f64) -> Option<Self> {
        (0.01..=1_000.0).contains(&factor).then_some(Self(factor))
    }

    /// The factor.
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }

    /// The machine time that passes during a span of real time.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and the cast saturates"
    )]
    pub fn ticks(self, real: Duration) -> Ticks {
        Ticks((real.as_secs_f64() * PER_SECOND * self.0) as u64)
    }

    /// The real time that `ticks` of machine time take.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "2^53 ticks are 142 years")]
    pub fn real(self, ticks: Ticks) -> Duration {
        Duration::from_secs_f64(ticks.0 as f64 / PER_SECOND / self.0)
    }
}

#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
const PER_SECOND: f64 = Tick::PER_SECOND as f64;

impl FromStr for TimeScale {
    type Err = NoTimeScale;
    fn from_str(text: &str) -> Result<Self, NoTimeScale> {
        text.parse().ok().and_then(Self::new).ok_or_else(|| NoTimeScale(text.to_owned()))
    }
}

impl std::fmt::Display for TimeScale {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// A point on `CLOCK_MONOTONIC`, which all processes of one machine share and no change of the date touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Monotonic(Duration);

impl Monotonic {
    /// Now.
    #[must_use]
    pub fn now() -> Self {
        let now = clock_gettime(ClockId::Monotonic);
        Self(Duration::try_from(now).unwrap_or_default())
    }

    /// As passed from process to process.
    #[must_use]
    pub fn from_nanos(nanos: u64) -> Self {
        Self(Duration::from_nanos(nanos))
    }

    /// As passed from process to process.
    #[must_use]
    pub fn as_nanos(self) -> u64 {
        u64::try_from(self.0.as_nanos()).unwrap_or(u64::MAX)
    }
}

/// The set's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    epoch: Monotonic,
    scale: TimeScale,
}

impl Clock {
    /// The clock whose tick 0 is at `epoch`.
    #[must_use]
    pub fn new(epoch: Monotonic, scale: TimeScale) -> Self {
        Self { epoch, scale }
    }

    /// When tick 0 was.
    #[must_use]
    pub fn epoch(&self) -> Monotonic {
        self.epoch
    }

    /// How fast machine time runs.
    #[must_use]
    pub fn scale(&self) -> TimeScale {
        self.scale
    }

    /// The tick now.
    #[must_use]
    pub fn now(&self) -> Tick {
        self.tick(Monotonic::now())
    }

    /// The tick at a point in time; 0 before the epoch.
    #[must_use]
    pub fn tick(&self, at: Monotonic) -> Tick {
        Tick(0) + self.scale.ticks(at.0.saturating_sub(self.epoch.0))
    }

    /// The real time from now to `tick`; zero if it has passed.
    #[must_use]
    pub fn until(&self, tick: Tick) -> Duration {
        self.scale.real(tick.since(self.now()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_half_a_microsecond_of_machine_time() {
        assert_eq!(TimeScale::REAL.ticks(Duration::from_secs(1)), Ticks(2_000_000));
        let fast = TimeScale::new(20.0).expect("in range");
        assert_eq!(fast.ticks(Duration::from_secs(1)), Ticks(40_000_000));
        assert_eq!(fast.real(Ticks(40_000_000)), Duration::from_secs(1));
    }

    #[test]
    fn nonsense_is_no_time_scale() {
        for text in ["0", "-1", "NaN", "inf", "1001", "", "two"] {
            let error = text.parse::<TimeScale>().expect_err(text).to_string();
            assert!(error.contains(text) && error.contains("0.01 to 1000"), "{error}");
        }
        assert_eq!("2.5".parse(), Ok(TimeScale(2.5)));
    }
}
