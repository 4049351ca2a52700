//! The linear profile of \[M\] for the test bench: two slopes, each as steep as the motor follows.

use supersigma_config::MotorConfig;
use supersigma_protocol::Distance;

use super::pulses::Pulses;
use super::search::{Made, Shape, search, shortest};
use super::stand::Stand;
use super::{Margin, TuneError};

/// Ramp times are whole parts of a second, so many of them: what is printed is what was played.
const PARTS: u32 = 10_000;
/// How much shorter than the other one a slope is tried at most.
const SHORTER: u32 = 8;

/// The parameters of \[M\] for a movement of so many steps; `t_b` follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    /// The starting frequency, half steps/s, whole.
    pub f_start: f64,
    /// The constant frequency, half steps/s, whole.
    pub f_max: f64,
    /// Acceleration, seconds in whole tenths of milliseconds; 0 if `f_max` is `f_start`.
    pub t_a: f64,
    /// Deceleration, as `t_a`.
    pub t_c: f64,
}

/// A linear profile that holds.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearProposal {
    /// What was found.
    pub profile: Linear,
    /// `t_b`, seconds: what is left of the movement, at `f_max`.
    pub t_b: f64,
    /// Its pulses.
    pub pulses: Pulses,
    /// Movements that were played to find it.
    pub trials: u32,
}

/// The fastest linear profile of `distance` half steps that holds with `margin`; one frequency if the movement is too
/// short for a ramp.
///
/// # Errors
/// If the motor cannot be, cannot hold its load with that margin, or does not start.
pub fn linear(motor: &MotorConfig, distance: Distance, margin: Margin) -> Result<LinearProposal, TuneError> {
    let stand = Stand::new(motor, margin)?;
    let start_stop = stand.start_stop()?.ok_or(TuneError::WillNotStart { margin })?;
    let slow = Whole { f_start: start_stop.floor(), f_max: start_stop.floor(), up: 0, down: 0 };
    let slow = slow.made(distance).ok_or(TuneError::WillNotStart { margin })?;
    let found = search(&Slopes { motor, distance, stand: &stand }, start_stop, &stand)?;
    let Made { ramp, pulses } =
        found.filter(|found| found.pulses.duration() < slow.pulses.duration()).unwrap_or(slow);
    let t_b = ramp.t_b(distance);
    Ok(LinearProposal { profile: ramp.profile(), t_b, pulses, trials: stand.trials() })
}

struct Slopes<'a> {
    motor: &'a MotorConfig,
    distance: Distance,
    stand: &'a Stand,
}

impl Slopes<'_> {
    fn holds(&self, whole: Whole) -> bool {
        whole.made(self.distance).is_some_and(|made| self.stand.holds(&made.pulses))
    }

    /// The shortest and the longest ramp worth a look, in parts: no motor accelerates its rotor with more than its holding
    /// torque, and both ramps must fit into the movement.
    fn bounds(&self, f_start: f64, f_max: f64) -> (u32, u32) {
        let per_radian = f64::from(self.motor.half_steps_per_turn) / std::f64::consts::TAU;
        let steepest = self.motor.holding_torque / self.motor.inertia() * per_radian;
        let least = ((f_max - f_start) / steepest).max(1.0 / f_max);
        let most = f64::from(self.distance.get()) / (f_start + f_max);
        (parts(least), parts(most))
    }
}

impl Shape for Slopes<'_> {
    type Ramp = Whole;

    fn shortest(&self, f_start: f64, f_max: f64) -> Option<Made<Whole>> {
        let both = |parts| Whole { f_start, f_max, up: parts, down: parts };
        let (least, most) = self.bounds(f_start, f_max);
        both(shortest(least, most, |parts| self.holds(both(parts)))?).made(self.distance)
    }

    /// Makes the deceleration as short as holds, and then the acceleration: a load that hinders the one helps the other.
    fn finish(&self, made: Made<Whole>) -> Option<Made<Whole>> {
        let mut whole = made.ramp;
        let least = |parts: u32| (parts / SHORTER).max(1);
        whole.down = shortest(least(whole.down), whole.down, |down| self.holds(Whole { down, ..whole }))?;
        whole.up = shortest(least(whole.up), whole.up, |up| self.holds(Whole { up, ..whole }))?;
        whole.made(self.distance)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn parts(seconds: f64) -> u32 {
    (seconds * f64::from(PARTS)).clamp(1.0, 1e6) as u32
}

/// A profile in whole parts.
#[derive(Debug, Clone, Copy)]
struct Whole {
    f_start: f64,
    f_max: f64,
    up: u32,
    down: u32,
}

impl Whole {
    fn profile(&self) -> Linear {
        let [t_a, t_c] = self.ramps();
        Linear { f_start: self.f_start, f_max: self.f_max, t_a, t_c }
    }

    /// The movement; `None` if the ramps alone have more pulses.
    fn made(&self, distance: Distance) -> Option<Made<Self>> {
        let cruise = self.cruise(distance)?;
        let [mut periods, mut down] = self.slopes();
        down.reverse();
        periods.extend(std::iter::repeat_n(period(self.f_max), cruise));
        periods.extend(down);
        Some(Made { ramp: *self, pulses: Pulses::new(periods) })
    }

    #[expect(clippy::cast_precision_loss, reason = "at most 65 535")]
    fn t_b(&self, distance: Distance) -> f64 {
        self.cruise(distance).unwrap_or(0) as f64 / self.f_max
    }

    /// Pulses between the ramps.
    fn cruise(&self, distance: Distance) -> Option<usize> {
        let [up, down] = self.slopes();
        usize::from(distance.get()).checked_sub(up.len() + down.len())
    }

    /// The periods of both ramps, upwards.
    fn slopes(&self) -> [Vec<u32>; 2] {
        self.ramps().map(|seconds| slope(self.f_start, self.f_max, seconds))
    }

    /// In seconds.
    fn ramps(&self) -> [f64; 2] {
        [self.up, self.down].map(|parts| f64::from(parts) / f64::from(PARTS))
    }
}

/// The periods of one slope, \[M\] eq. (1) to (6).
fn slope(f_start: f64, f_max: f64, seconds: f64) -> Vec<u32> {
    let (mut periods, mut elapsed) = (vec![], 0.0);
    while seconds > 0.0 && elapsed <= seconds {
        let frequency = (f_max - f_start) / seconds * elapsed + f_start;
        periods.push(period(frequency));
        elapsed += 1.0 / frequency;
    }
    periods
}

/// Of a frequency, in ticks: whole clocks of 1 MHz.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "10 to 20 000 clocks")]
fn period(frequency: f64) -> u32 {
    (1e6 / frequency).round() as u32 * 2
}
