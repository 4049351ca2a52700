//! The continuous curve behind the table, and the time that a movement along it takes: the yardstick for plans. Floating
//! point, for people and tests only; no plan is made with it.

use supersigma_config::{Linear, Profile, RampConfig, Sin2};
use supersigma_protocol::{Distance, SpeedIndex, Tick};

use super::Table;

#[expect(clippy::cast_precision_loss, reason = "the clock's frequency is exact in an f64")]
const TICKS_PER_SECOND: f64 = Tick::PER_SECOND as f64;

/// V(t) from t = 0 to the last entry of the table.
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
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    shape: Shape,
    /// Seconds from entry 0 to the last one.
    end: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Shape {
    /// A · sin²(ωt + φ), \[C\] eq. (3).
    Sin2 { amplitude: f64, omega: f64, phase: f64 },
    /// f + m · t, \[M\] eq. (3).
    Linear { start: f64, slope: f64 },
    /// Straight from each entry to the next.
    Table {
        interval: f64,
        speeds: Vec<f64>,
        /// Steps made by each entry.
        steps: Vec<f64>,
    },
}

impl Curve {
    /// The curve of `ramp`, which must be one that gives a [`Table`]: its speed never falls.
    #[must_use]
    pub fn new(ramp: &RampConfig) -> Self {
        let interval = f64::from(ramp.interval_ticks()) / TICKS_PER_SECOND;
        let end = interval * f64::from(ramp.profile.last_entry());
        let shape = match &ramp.profile {
            Profile::Sin2(Sin2 { amplitude, omega, phase, .. }) => {
                Shape::Sin2 { amplitude: *amplitude, omega: *omega, phase: *phase }
            }
            // As it is played: t_a is a whole number of ticks from entry to entry.
            Profile::Linear(Linear { f_start, f_max, .. }) => {
                Shape::Linear { start: *f_start, slope: (f_max - f_start) / end }
            }
            Profile::Table(table) => {
                let speeds: Vec<_> =
                    table.counts.iter().map(|n| TICKS_PER_SECOND / (f64::from(*n) + 1.0)).collect();
                let pieces = speeds.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]) * interval);
                let steps = std::iter::once(0.0).chain(pieces.scan(0.0, |sum, piece| {
                    *sum += piece;
                    Some(*sum)
                }));
                Shape::Table { interval, steps: steps.collect(), speeds }
            }
        };
        Self { shape, end }
    }

    /// Seconds from entry 0 of the table to the last one that its profile has of its own.
    #[must_use]
    pub fn end(&self) -> f64 {
        self.end
    }

    /// Steps per second, `seconds` after the start.
    #[must_use]
    pub fn speed(&self, seconds: f64) -> f64 {
        match &self.shape {
            Shape::Sin2 { amplitude, omega, phase } => amplitude * (omega * seconds + phase).sin().powi(2),
            Shape::Linear { start, slope } => start + slope * seconds.min(self.end),
            Shape::Table { interval, speeds, .. } => {
                let (entry, part) = piece(seconds, *interval, speeds.len());
                speeds[entry] + (speeds[entry + 1] - speeds[entry]) * part
            }
        }
    }

    /// Steps made by then: the integral of [`Curve::speed`]. Of the sin² curve A/2 · (t − cos(ωt + 2φ) · sin(ωt)/ω), of the
    /// linear one f·t + m/2 · t².
    #[must_use]
    pub fn steps(&self, seconds: f64) -> f64 {
        match &self.shape {
            Shape::Sin2 { amplitude, omega, phase } => {
                let angle = omega * seconds;
                let sinc = if angle == 0.0 { 1.0 } else { angle.sin() / angle };
                amplitude / 2.0 * seconds * (1.0 - (angle + 2.0 * phase).cos() * sinc)
            }
            Shape::Linear { start, slope } => {
                let within = seconds.min(self.end);
                let beyond = seconds - within;
                start * within + slope / 2.0 * within.powi(2) + self.speed(self.end) * beyond
            }
            Shape::Table { interval, speeds, steps } => {
                let (entry, part) = piece(seconds, *interval, speeds.len());
                let middle = speeds[entry] + (speeds[entry + 1] - speeds[entry]) * part / 2.0;
                let beyond = (seconds - self.end).max(0.0);
                steps[entry] + middle * part * interval + self.speed(self.end) * beyond
            }
        }
    }

    /// Steps per second per second, `seconds` after the start.
    #[must_use]
    pub fn acceleration(&self, seconds: f64) -> f64 {
        if seconds > self.end {
            return 0.0;
        }
        match &self.shape {
            Shape::Sin2 { amplitude, omega, phase } => {
                amplitude * omega * (2.0 * (omega * seconds + phase)).sin()
            }
            Shape::Linear { slope, .. } => *slope,
            Shape::Table { interval, speeds, .. } => {
                let (entry, _) = piece(seconds, *interval, speeds.len());
                (speeds[entry + 1] - speeds[entry]) / interval
            }
        }
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

/// The entry after which `seconds` lie, and which part of the way to the next one; the end for all beyond.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "no curve has 2^32 entries")]
fn piece(seconds: f64, interval: f64, entries: usize) -> (usize, f64) {
    let entry = ((seconds / interval) as usize).min(entries - 2);
    #[expect(clippy::cast_precision_loss, reason = "at most 232")]
    let part = seconds / interval - entry as f64;
    (entry, part.clamp(0.0, 1.0))
}
