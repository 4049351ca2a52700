//! The continuous curve behind the table, and the time that a movement along it takes: the yardstick for plans. Floating
//! point, for people and tests only; no plan is made with it.

use supersigma_config::RampConfig;
use supersigma_protocol::{Distance, SpeedIndex, Tick};

use super::Table;

/// V(t) = A · sin²(ωt + φ), \[C\] eq. (3), from t = 0 to the last entry of the table.
///
/// ```text
///   speed
///   ceiling ┤ · · · · · ╭────────╮         A movement of n steps that begins and ends at V(0) is shortest if it
///           │         ╱ ·        · ╲       leaves the curve at the ceiling, cruises there, and comes back along the
///           │       ╱   ·        ·   ╲     same curve: the area is n. If n is so small that it never gets there, it
///      V(0) ┤────╯      ·        ·     ╰── leaves the curve half-way, where s(T/2) = n/2.
///           └───────────┴────────┴──────── t
///           0           u      T − u     T
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curve {
    amplitude: f64,
    omega: f64,
    phase: f64,
    /// Seconds from entry 0 to entry 232.
    end: f64,
}

impl Curve {
    /// The curve of `ramp`, which must be one that gives a [`Table`]: its speed never falls.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "the clock's frequency is exact in an f64")]
    pub fn new(ramp: &RampConfig) -> Self {
        let ticks = f64::from(ramp.interval_ticks) * f64::from(SpeedIndex::TOP.get());
        Self {
            amplitude: ramp.amplitude,
            omega: ramp.omega,
            phase: ramp.phase,
            end: ticks / Tick::PER_SECOND as f64,
        }
    }

    /// Seconds from entry 0 of the table to its last one.
    #[must_use]
    pub fn end(&self) -> f64 {
        self.end
    }

    /// Steps per second, `seconds` after the start.
    #[must_use]
    pub fn speed(&self, seconds: f64) -> f64 {
        self.amplitude * (self.omega * seconds + self.phase).sin().powi(2)
    }

    /// Steps made by then: the integral of [`Curve::speed`], A/2 · (t − cos(ωt + 2φ) · sin(ωt)/ω).
    #[must_use]
    pub fn steps(&self, seconds: f64) -> f64 {
        let angle = self.omega * seconds;
        let sinc = if angle == 0.0 { 1.0 } else { angle.sin() / angle };
        self.amplitude / 2.0 * seconds * (1.0 - (angle + 2.0 * self.phase).cos() * sinc)
    }

    /// The seconds that a movement of `distance` takes along the curve, under the speed with which the chip plays entry
    /// `limit` of the `table` of this curve. The card may be ahead of it by an interval of the table in all: it reads
    /// the table half an interval early on average, on both ramps.
    #[must_use]
    pub fn seconds(&self, table: &Table, distance: Distance, limit: SpeedIndex) -> f64 {
        let distance = f64::from(distance.get());
        let ceiling = table.speed(limit);
        let leave = self.first(|seconds| self.speed(seconds) >= ceiling);
        let cruise = distance - 2.0 * self.steps(leave);
        if cruise >= 0.0 {
            2.0 * leave + cruise / ceiling
        } else {
            2.0 * self.first(|seconds| self.steps(seconds) >= distance / 2.0)
        }
    }

    /// The first moment of the curve at which `reached` holds; its end if it never does. By bisection.
    fn first(&self, reached: impl Fn(f64) -> bool) -> f64 {
        let (mut before, mut after) = (0.0, self.end);
        if reached(before) {
            return before;
        }
        // 0.3 s in 2^60 parts is finer than an f64.
        for _ in 0..60 {
            let middle = f64::midpoint(before, after);
            if reached(middle) {
                after = middle;
            } else {
                before = middle;
            }
        }
        after
    }
}
