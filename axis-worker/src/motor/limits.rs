//! The limits of a motor, found as on a test bench: load it, feed it pulses, see whether it keeps up. Nothing is
//! computed from the motor's data but by moving its rotor.

use std::ops::RangeInclusive;

use supersigma_config::{MotorConfig, MotorError};
use supersigma_protocol::{Direction, Tick, Ticks};

use super::rotor::Rotor;

/// Half steps/s: the search begins with the first, and does not go beyond the second.
const SLOWEST: f64 = 50.0;
const FASTEST: f64 = 100_000.0;
/// Long trains last this many seconds, but have six cycles at least.
const TRAIN_SECONDS: f64 = 0.25;
const LEAST_PULSES: f64 = 48.0;
/// Every train up to this length is tried on its own: where it ends, the swing of the start has any phase.
const EVERY_TRAIN_TO: u32 = 48;
/// The limit is found to this part of itself.
const PRECISION: f64 = 0.005;
/// What the slow acceleration of the pull-out test takes of the holding torque.
const GENTLE: f64 = 0.01;
/// And by which part of itself it may change the speed from pulse to pulse.
const GENTLE_RISE: f64 = 0.01;

#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
const TICKS_PER_SECOND: f64 = Tick::PER_SECOND as f64;

/// What is put on the shaft, besides what the motor has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Of a brake: against the motion, whatever its sense; newton metres, 0 or more.
    pub torque: f64,
    /// Of a disc; kg·m², 0 or more.
    pub inertia: f64,
}

impl Load {
    /// The motor with this load as a part of it.
    #[must_use]
    pub fn on(self, config: &MotorConfig) -> MotorConfig {
        MotorConfig {
            friction: config.friction + self.torque,
            load_inertia: config.load_inertia + self.inertia,
            ..config.clone()
        }
    }
}

/// One point of the characteristic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Characteristic {
    /// Of the brake, newton metres.
    pub torque: f64,
    /// See [`start_stop`].
    pub start_stop: Option<f64>,
    /// See [`pull_in`].
    pub pull_in: Option<f64>,
    /// See [`pull_out`].
    pub pull_out: Option<f64>,
}

/// The largest frequency, in half steps per second, with which the loaded motor starts from standstill and runs without
/// a slip, until the swing of the start has faded and the train may end; `None` if it does not follow even 50 half
/// steps/s. Above the first frequency found at which it slips nothing is tried.
///
/// # Errors
/// If such a motor cannot be.
pub fn pull_in(config: &MotorConfig, load: Load) -> Result<Option<f64>, MotorError> {
    largest(config, load, starts)
}

/// As [`pull_in`], but the train may end after any number of pulses. One that ends while the rotor swings ahead is harder
/// to stop from: so this lies below the pull-in, and a brake may even raise it.
///
/// # Errors
/// If such a motor cannot be.
pub fn start_stop(config: &MotorConfig, load: Load) -> Result<Option<f64>, MotorError> {
    largest(config, load, starts_and_stops)
}

/// The speed, in half steps per second, at which the loaded motor falls out of step when it is gently accelerated
/// through `speeds`; `None` if it holds to their end. Their start should lie below the pull-in, or that is all
/// that is seen; 0 if the motor cannot even hold the load.
///
/// # Errors
/// If such a motor cannot be.
pub fn pull_out(
    config: &MotorConfig,
    load: Load,
    speeds: RangeInclusive<f64>,
) -> Result<Option<f64>, MotorError> {
    let Some(mut rotor) = loaded(config, load)? else {
        return Ok(Some(0.0));
    };
    let half_steps_per_radian = f64::from(config.half_steps_per_turn) / std::f64::consts::TAU;
    let acceleration =
        GENTLE * config.holding_torque / (config.inertia() + load.inertia) * half_steps_per_radian;
    let (mut speed, top) = (speeds.start().max(SLOWEST), speeds.end().min(FASTEST));
    let mut train = Train::default();
    while speed < top {
        let period = 1.0 / speed;
        train.pulse(&mut rotor, period);
        if rotor.slips() > 0 {
            return Ok(Some(speed));
        }
        speed += (acceleration * period).min(GENTLE_RISE * speed);
    }
    Ok(None)
}

/// All limits for each torque of a brake, with a disc of `inertia` on the shaft; pull-out up to `top` half steps/s.
///
/// # Errors
/// If such a motor cannot be.
pub fn characteristic(
    config: &MotorConfig,
    inertia: f64,
    torques: impl IntoIterator<Item = f64>,
    top: f64,
) -> Result<Vec<Characteristic>, MotorError> {
    let point = |torque| {
        let load = Load { torque, inertia };
        let start_stop = start_stop(config, load)?;
        let pull_in = pull_in(config, load)?;
        let pull_out = pull_out(config, load, pull_in.unwrap_or(0.0) / 2.0..=top)?;
        Ok(Characteristic { torque, start_stop, pull_in, pull_out })
    };
    torques.into_iter().map(point).collect()
}

/// At rest with its load; `None` if that is more than the motor can hold.
fn loaded(config: &MotorConfig, load: Load) -> Result<Option<Rotor>, MotorError> {
    match Rotor::standing(&load.on(config)) {
        Ok(rotor) => Ok(Some(rotor)),
        Err(MotorError::Overloaded { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The largest frequency at which `follows` is true of the loaded motor, if it is of all that are smaller.
fn largest(
    config: &MotorConfig,
    load: Load,
    follows: impl Fn(&Rotor, f64) -> bool,
) -> Result<Option<f64>, MotorError> {
    let Some(rotor) = loaded(config, load)? else {
        return Ok(None);
    };
    let (mut good, mut bad) = (0.0, SLOWEST);
    while follows(&rotor, bad) {
        good = bad;
        bad *= 1.25;
        if bad > FASTEST {
            return Ok(Some(good));
        }
    }
    if good == 0.0 {
        return Ok(None);
    }
    while bad - good > PRECISION * good {
        let between = f64::midpoint(good, bad);
        if follows(&rotor, between) {
            good = between;
        } else {
            bad = between;
        }
    }
    Ok(Some(good))
}

/// Whether a long train moves the rotor by all of its pulses.
fn starts(rotor: &Rotor, frequency: f64) -> bool {
    let mut rotor = rotor.clone();
    let mut train = Train::default();
    let mut left = (frequency * TRAIN_SECONDS).max(LEAST_PULSES);
    while left > 0.0 && rotor.slips() == 0 {
        train.pulse(&mut rotor, 1.0 / frequency);
        left -= 1.0;
    }
    rotor.arrives()
}

/// Whether every train does.
fn starts_and_stops(rotor: &Rotor, frequency: f64) -> bool {
    let mut running = rotor.clone();
    let mut train = Train::default();
    let mut stops_after_every = || {
        train.pulse(&mut running, 1.0 / frequency);
        running.clone().arrives()
    };
    (0..EVERY_TRAIN_TO).all(|_| stops_after_every()) && starts(rotor, frequency)
}

/// Pulses at the whole ticks that are nearest to their times.
#[derive(Default)]
struct Train {
    /// What the last tick is early by, in ticks.
    early: f64,
}

impl Train {
    /// Lets `period` seconds pass and then makes a step forward.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a period is positive and short"
    )]
    fn pulse(&mut self, rotor: &mut Rotor, period: f64) {
        let exact = period * TICKS_PER_SECOND + self.early;
        let ticks = exact.round();
        self.early = exact - ticks;
        rotor.advance(Ticks(ticks as u64));
        rotor.pulse(Direction::Forward);
    }
}
