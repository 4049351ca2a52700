//! The linear profile of \[M\] for the test bench: two slopes, each as steep as the motor follows.

use supersigma_config::MotorConfig;
use supersigma_protocol::Distance;

use super::pulses::Pulses;
use super::search::{Made, Shape, search, shortest};
use super::stand::Stand;
use super::{Margin, TuneError};
use crate::bench::{CLOCK_HERTZ, Clocks, Frequency, Hold, PartSteps, Positioning, Train};

/// Ramp times are multiples of this, 0.1 ms.
const GRAIN: u32 = 100;
/// Pulses by which two ramps may be longer than their mean speed says: each ends with the first pulse after its time.
const SPARE: f64 = 4.0;
/// How much shorter than the other one a slope is tried at most.
const SHORTER: u32 = 8;

/// A linear profile that holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinearProposal {
    /// What was found; a movement that is too short for ramps has none.
    pub profile: Positioning,
    /// The pulses of its parts.
    pub steps: PartSteps,
    /// All of them.
    pub pulses: Pulses,
    /// Movements that were played to find it.
    pub trials: u32,
}

impl LinearProposal {
    /// `t_b`: with it instead of the number of pulses the profile is the same.
    #[must_use]
    pub fn t_b(&self) -> Clocks {
        let millihertz = self.profile.max.millihertz();
        let exact = u64::from(self.steps.b) * 1_000 * CLOCK_HERTZ;
        Clocks((exact + millihertz / 2) / millihertz)
    }
}

/// The fastest linear profile of `distance` half steps that holds with `margin`; one frequency if the movement is too
/// short for a ramp.
///
/// # Errors
/// If the motor cannot be, cannot hold its load with that margin, or does not start.
pub fn linear(motor: &MotorConfig, distance: Distance, margin: Margin) -> Result<LinearProposal, TuneError> {
    let stand = Stand::new(motor, margin)?;
    let not_started = || TuneError::WillNotStart { margin };
    let start_stop = stand.start_stop()?.ok_or_else(not_started)?;
    let slopes = Slopes { motor, distance, stand: &stand };
    let slow = slopes.made(start_stop, start_stop, 0, 0).ok_or_else(not_started)?;
    let found = search(&slopes, start_stop, &stand)?;
    let Made { ramp, pulses } =
        found.filter(|found| found.pulses.duration() < slow.pulses.duration()).unwrap_or(slow);
    let steps = Train::positioning(ramp).map_or(PartSteps::default(), |train| train.steps());
    Ok(LinearProposal { profile: ramp, steps, pulses, trials: stand.trials() })
}

struct Slopes<'a> {
    motor: &'a MotorConfig,
    distance: Distance,
    stand: &'a Stand,
}

impl Slopes<'_> {
    /// The movement with ramps of so many grains; `None` if those alone have more pulses, or the chip cannot make it.
    fn made(&self, start: f64, max: f64, up: u32, down: u32) -> Option<Made<Positioning>> {
        let [start, max] = [start, max].map(whole_frequency);
        let [t_a, t_c] = [up, down].map(|grains| Clocks(u64::from(grains * GRAIN)));
        let hold = Hold::ForTotal(self.distance.steps().0);
        let ramp = Positioning { start: start?, max: max?, t_a, hold, t_c };
        let train = Train::positioning(ramp).ok()?;
        Some(Made { ramp, pulses: Pulses::from(&train) })
    }

    fn holding(&self, start: f64, max: f64, up: u32, down: u32) -> bool {
        self.made(start, max, up, down).is_some_and(|made| self.stand.holds(&made.pulses))
    }

    /// The shortest and the longest ramp worth a look, in grains: no motor accelerates its rotor with more than its holding
    /// torque, and both ramps must fit into the movement.
    fn bounds(&self, start: f64, max: f64) -> (u32, u32) {
        let per_radian = f64::from(self.motor.half_steps_per_turn) / std::f64::consts::TAU;
        let steepest = self.motor.holding_torque / self.motor.inertia() * per_radian;
        let least = ((max - start) / steepest).max(1.0 / max);
        let most = (f64::from(self.distance.get()) - SPARE) / (start + max);
        (grains(least), grains(most))
    }
}

impl Shape for Slopes<'_> {
    type Ramp = Positioning;

    fn shortest(&self, start: f64, max: f64) -> Option<Made<Positioning>> {
        let (least, most) = self.bounds(start, max);
        let both = shortest(least, most, |grains| self.holding(start, max, grains, grains))?;
        self.made(start, max, both, both)
    }

    /// Makes the deceleration as short as holds, and then the acceleration: a load that hinders the one helps the other.
    fn finish(&self, made: Made<Positioning>) -> Option<Made<Positioning>> {
        let [start, max] = [made.ramp.start, made.ramp.max].map(Frequency::hertz);
        let both = u32::try_from(made.ramp.t_a.0 / u64::from(GRAIN)).ok()?;
        let least = (both / SHORTER).max(1);
        let down = shortest(least, both, |down| self.holding(start, max, both, down))?;
        let up = shortest(least, both, |up| self.holding(start, max, up, down))?;
        self.made(start, max, up, down)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn grains(seconds: f64) -> u32 {
    (seconds * 1e6 / f64::from(GRAIN)).clamp(1.0, 1e6) as u32
}

/// Rounded down to a whole pulse per second; `None` if the chip cannot make it.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "30 to 100 000")]
fn whole_frequency(hertz: f64) -> Option<Frequency> {
    Frequency::from_millihertz(hertz as u64 * 1_000).ok()
}
