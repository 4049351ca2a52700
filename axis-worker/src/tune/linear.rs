//! The linear profile of \[M\]: two slopes, each as steep as the motor follows.

use supersigma_config::MotorConfig;
use supersigma_protocol::{Distance, Tick};

use super::search::{Found, search, shortest};
use super::stand::Stand;
use super::train::Train;
use super::{Margin, TuneError};

/// Ramp times are whole parts of a second, so many of them: what is printed is what was played.
const PARTS: u32 = 10_000;

/// The five parameters of \[M\] for a movement of so many steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    /// The starting frequency, half steps/s.
    pub f_start: f64,
    /// The constant frequency, half steps/s.
    pub f_max: f64,
    /// Acceleration, seconds; 0 if `f_max` is `f_start`.
    pub t_a: f64,
    /// At the constant frequency, seconds.
    pub t_b: f64,
    /// Deceleration, seconds; 0 if `f_max` is `f_start`.
    pub t_c: f64,
}

/// A linear profile that holds.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearProposal {
    /// What was found.
    pub profile: Linear,
    /// Its pulses.
    pub train: Train,
    /// Trains that were played to find it.
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
    let best_ramp = |f_start: f64, f_max: f64| {
        let made = |parts| Shape { f_start, f_max, up: parts, down: parts }.train(distance);
        let (least, most) = bounds(motor, f_start, f_max, distance);
        let parts = shortest(least, most, |parts| made(parts).is_some_and(|train| stand.holds(&train)))?;
        let ramp = Shape { f_start, f_max, up: parts, down: parts };
        Some(Found { ticks: ramp.train(distance)?.duration().0, ramp })
    };
    let found = search(start_stop, &stand, best_ramp)?;
    let constant = Train::new(vec![period(start_stop.floor()); distance.get().into()]);
    let proposal = match found {
        Some(found) if found.ticks < constant.duration().0 => finish(found.ramp, distance, &stand),
        _ => None,
    };
    let (profile, train) = proposal.unwrap_or_else(|| {
        let frequency = start_stop.floor();
        let seconds = f64::from(distance.get()) / frequency;
        (Linear { f_start: frequency, f_max: frequency, t_a: 0.0, t_b: seconds, t_c: 0.0 }, constant)
    });
    Ok(LinearProposal { profile, train, trials: stand.trials() })
}

/// Makes the deceleration as short as holds, and then the acceleration: a load that hinders the one helps the other.
fn finish(mut shape: Shape, distance: Distance, stand: &Stand) -> Option<(Linear, Train)> {
    let holds = |shape: Shape| shape.train(distance).is_some_and(|train| stand.holds(&train));
    let least = |parts: u32| (parts / 8).max(1);
    shape.down = shortest(least(shape.down), shape.down, |down| holds(Shape { down, ..shape }))?;
    shape.up = shortest(least(shape.up), shape.up, |up| holds(Shape { up, ..shape }))?;
    Some((shape.profile(distance)?, shape.train(distance)?))
}

/// The shortest and the longest ramp worth a look, in parts: no motor accelerates its rotor with more than its holding
/// torque, and both ramps must fit into the movement.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn bounds(motor: &MotorConfig, f_start: f64, f_max: f64, distance: Distance) -> (u32, u32) {
    let per_radian = f64::from(motor.half_steps_per_turn) / std::f64::consts::TAU;
    let steepest = motor.holding_torque / motor.inertia() * per_radian;
    let least = ((f_max - f_start) / steepest).max(1.0 / f_max);
    let most = f64::from(distance.get()) / (f_start + f_max);
    let parts = |seconds: f64| (seconds * f64::from(PARTS)).clamp(1.0, 1e8) as u32;
    (parts(least), parts(most))
}

/// A profile in whole parts.
#[derive(Debug, Clone, Copy)]
struct Shape {
    f_start: f64,
    f_max: f64,
    up: u32,
    down: u32,
}

impl Shape {
    fn train(&self, distance: Distance) -> Option<Train> {
        let seconds = |parts: u32| f64::from(parts) / f64::from(PARTS);
        let mut periods = slope(self.f_start, self.f_max, seconds(self.up));
        let mut down = slope(self.f_start, self.f_max, seconds(self.down));
        down.reverse();
        let cruise = usize::from(distance.get()).checked_sub(periods.len() + down.len())?;
        periods.extend(std::iter::repeat_n(period(self.f_max), cruise));
        periods.extend(down);
        Some(Train::new(periods))
    }

    fn profile(&self, distance: Distance) -> Option<Linear> {
        todo!()
    }
}
