//! The sin² ramp of \[C\]: the constants of the curve behind the table.

use std::f64::consts::FRAC_PI_2;

use supersigma_config::{MotorConfig, RampConfig, RampError, ShortMoves};
use supersigma_protocol::{Distance, SpeedIndex, Tick};

use super::search::{Found, search, shortest};
use super::stand::Stand;
use super::train::Train;
use super::{Margin, TuneError};
use crate::ramp::{Plan, Stop, Table};

/// Intervals of the table.
const INTERVALS: f64 = SpeedIndex::TOP.get() as f64;
/// Pulses at the top speed before the emergency stop is tried.
const CRUISE: u32 = 200;

/// A sin² ramp that holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Sin2Proposal {
    /// What was found: amplitude, omega, phase and both intervals are new, the rest is as it was.
    pub ramp: RampConfig,
    /// The pulses of the movement.
    pub train: Train,
    /// Lengths of shorter movements along the same ramp that were played with the margin, and those of them that slip.
    pub shorter: Shorter,
    /// Trains that were played to find it.
    pub trials: u32,
}

/// Shorter movements along a ramp that was made for a longer one.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Shorter {
    /// How many lengths were played.
    pub played: u32,
    /// Those that lose steps.
    pub slips: Vec<Distance>,
}

/// The fastest movement of `distance` half steps along a sin² ramp that holds with `margin`. The ramp is reached to its
/// top, so that longer movements are as safe; its emergency stop is made as steep as holds.
///
/// # Errors
/// If the motor cannot be, cannot hold its load with that margin, or does not start; or if the card can play no such ramp.
pub fn sin2(
    motor: &MotorConfig,
    distance: Distance,
    margin: Margin,
    current: &RampConfig,
) -> Result<Sin2Proposal, TuneError> {
    let stand = Stand::new(motor, margin)?;
    let start_stop = stand.start_stop()?.ok_or(TuneError::WillNotStart { margin })?;
    let mut reason = RampError::NoInterval;
    let best_ramp = |start: f64, top: f64| -> Option<Found<RampConfig>> {
        let made = |interval| curve(start, top, interval, current);
        let least = 1;
        // So long that both ramps are as long as the movement: half of it, at the mean speed.
        let most = interval_of(f64::from(distance.get()) / (start + top));
        let holds = |interval| {
            let train = whole(&made(interval), distance).ok()??;
            stand.holds(&train).then_some(())
        };
        let interval = shortest(least, most, |interval| holds(interval).is_some())?;
        let ramp = made(interval);
        let train = whole(&ramp, distance).ok()??;
        Some(Found { ticks: train.duration().0, ramp })
    };
    todo!()
}

/// The curve from `start` to `top` steps/s, which is reached with the last entry.
fn curve(start: f64, top: f64, interval: u32, current: &RampConfig) -> RampConfig {
    let phase = rounded((start / top).sqrt().asin(), 1e6);
    let seconds = f64::from(interval) * INTERVALS / super::train::speed(1);
    // The last entry lies before the crest, not behind it.
    let omega = ((FRAC_PI_2 - phase) / seconds * 1e5).floor() / 1e5;
    RampConfig {
        amplitude: top,
        omega,
        phase,
        interval_ticks: interval,
        brake_interval_ticks: interval,
        ..current.clone()
    }
}
