//! Ramps for the card's table: the constants of the curve behind it. A ramp of the card is not for one movement: what is
//! proposed for one length has been tried with others, and with the emergency stop.

use std::f64::consts::FRAC_PI_2;
use std::sync::OnceLock;

use supersigma_config::{Differences, Linear, MotorConfig, Profile, RampConfig, RampError, Sin2};
use supersigma_protocol::{Distance, SpeedIndex, Tick};

use super::pulses::Pulses;
use super::search::{Made, Shape, search, shortest};
use super::stand::Stand;
use super::{Margin, TuneError};
use crate::ramp::{Plan, Stop, Table};

/// Intervals of the table.
const INTERVALS: f64 = SpeedIndex::TOP.get() as f64;
/// Pulses at the top speed before the emergency stop is tried, or the descent of a whole ramp.
const CRUISE: u32 = 200;
/// Shorter movements of every length up to this are tried, and beyond it each a quarter longer than the one before.
const EVERY_LENGTH_TO: u16 = 48;
/// A ramp on which a shorter movement slips is made longer by a tenth, so many times at most: 10 times as long in all.
pub(super) const STRETCHES: u32 = 24;
/// At most so many lengths are tried: 48, and 33 up to 65 535, the whole ramp and the movement itself.
pub(super) const LENGTHS: u32 = 48 + 33 + 2;

#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
const TICKS_PER_SECOND: f64 = Tick::PER_SECOND as f64;

/// A ramp of the card that holds.
#[derive(Debug, Clone, PartialEq)]
pub struct CardProposal {
    /// What was found: curve and intervals are new, the rest is as it was.
    pub ramp: RampConfig,
    /// The pulses of the movement.
    pub pulses: Pulses,
    /// Movements that were played to find it.
    pub trials: u32,
}

/// The shapes that are proposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CardShape {
    /// \[M\]: one slope from the start to the top.
    Linear,
    /// \[C\]: steepest half-way.
    Sin2,
}

/// The fastest movement of `distance` half steps along a ramp of this shape that holds with `margin`, for shorter movements
/// too, and for its whole length; its emergency stop is made as steep as holds. If the differences of the table do not
/// fit into bytes, it is a wide one.
///
/// # Errors
/// If the motor cannot be, cannot hold its load with that margin, or does not start; or if the card can play no such ramp.
pub fn card(
    motor: &MotorConfig,
    distance: Distance,
    margin: Margin,
    shape: CardShape,
    current: &RampConfig,
) -> Result<CardProposal, TuneError> {
    let stand = Stand::new(motor, margin)?;
    let start_stop = stand.start_stop()?.ok_or(TuneError::WillNotStart { margin })?;
    let curve = Curve { shape, distance, current, stand: &stand, unplayable: OnceLock::new() };
    let made = match search(&curve, start_stop, &stand)? {
        Some(made) => made,
        None => curve.slow(start_stop, margin)?,
    };
    let ramp = with_brake(&made.ramp, &stand);
    Ok(CardProposal { ramp, pulses: made.pulses, trials: stand.trials() })
}

struct Curve<'a> {
    shape: CardShape,
    distance: Distance,
    current: &'a RampConfig,
    stand: &'a Stand,
    /// Why a table could not be.
    unplayable: OnceLock<RampError>,
}

impl Curve<'_> {
    /// From `start` to `top` steps/s, which is reached with the last entry.
    fn ramp(&self, start: f64, top: f64, interval: u32) -> RampConfig {
        let seconds = f64::from(interval) * INTERVALS / TICKS_PER_SECOND;
        let profile = match self.shape {
            CardShape::Linear => {
                // Rounded to a microsecond, which is less than would change the interval.
                let t_a = (seconds * 1e6).round() / 1e6;
                Profile::Linear(Linear { f_start: start, f_max: top, t_a })
            }
            CardShape::Sin2 => {
                let phase = ((start / top).sqrt().asin() * 1e6).round() / 1e6;
                // The last entry lies before the crest, not behind it.
                let omega = ((FRAC_PI_2 - phase) / seconds * 1e5).floor() / 1e5;
                Profile::Sin2(Sin2 { amplitude: top, omega, phase, interval_ticks: interval })
            }
        };
        let ramp = RampConfig { profile, brake_interval_ticks: interval, ..self.current.clone() };
        match ramp.counts() {
            Err(RampError::TooSteep { .. }) => RampConfig { differences: Differences::Wide, ..ramp },
            _ => ramp,
        }
    }

    fn table(&self, ramp: &RampConfig) -> Option<Table> {
        let refused = |reason| {
            // Which of several reasons it is does not matter.
            let _ = self.unplayable.set(reason);
        };
        Table::new(ramp).map_err(refused).ok()
    }

    /// The movement along a ramp; `None` if it is too short to reach the top and to leave it again.
    fn whole(&self, ramp: RampConfig) -> Option<Made<RampConfig>> {
        let table = self.table(&ramp)?;
        let fits = 2 * table.normal().pulses().0 <= self.distance.steps().0;
        fits.then(|| Made { pulses: movement(&table, self.distance), ramp })
    }

    /// Whether the movement holds, and the shorter ones, and one that is as long as the ramp needs.
    fn holds_throughout(&self, table: &Table) -> bool {
        let whole = 2 * table.normal().pulses().0 + CRUISE;
        let whole = u16::try_from(whole).ok().and_then(Distance::new);
        let shorter = lengths().take_while(|length| length < &self.distance);
        let mut every = shorter.chain([self.distance]).chain(whole);
        every.all(|distance| self.stand.holds(&movement(table, distance)))
    }

    /// For movements that are too short for a ramp: none of its speeds needs one.
    fn slow(&self, start_stop: f64, margin: Margin) -> Result<Made<RampConfig>, TuneError> {
        let ramp = self.ramp((start_stop * 0.9).floor(), start_stop.floor(), 1);
        let table = self.table(&ramp);
        match (self.unplayable.get(), table) {
            (None, Some(table)) if self.holds_throughout(&table) => {
                Ok(Made { pulses: movement(&table, self.distance), ramp })
            }
            (Some(reason), _) => Err(TuneError::NoTable { reason: reason.clone() }),
            (None, _) => Err(TuneError::WillNotStart { margin }),
        }
    }
}

impl Shape for Curve<'_> {
    type Ramp = RampConfig;

    fn shortest(&self, start: f64, top: f64) -> Option<Made<RampConfig>> {
        let made = |interval| self.whole(self.ramp(start, top, interval));
        // At most so long that both ramps are the movement. The mean speed of a sin² is a little above half of both,
        // and the last period of a ramp is whole.
        let longest = interval(f64::from(self.distance.get()) / (start + top));
        let longest =
            (0..20).map(|less| longest - longest / 40 * less).find(|longest| made(*longest).is_some())?;
        let holds = |interval| made(interval).is_some_and(|made| self.stand.holds(&made.pulses));
        made(shortest(1, longest, holds)?)
    }

    /// Makes the ramp so long that every shorter movement holds as well.
    fn finish(&self, made: Made<RampConfig>) -> Option<Made<RampConfig>> {
        let (start, top) = ends(&made.ramp.profile)?;
        let mut interval = made.ramp.interval_ticks();
        for _ in 0..=STRETCHES {
            let ramp = self.ramp(start, top, interval);
            let table = self.table(&ramp)?;
            if self.holds_throughout(&table) {
                return Some(Made { pulses: movement(&table, self.distance), ramp });
            }
            interval += interval / 10 + 1;
        }
        None
    }
}

/// Start and top of what [`Curve::ramp`] makes.
fn ends(profile: &Profile) -> Option<(f64, f64)> {
    match *profile {
        Profile::Sin2(Sin2 { amplitude, phase, .. }) => {
            Some(((amplitude * phase.sin().powi(2)).round(), amplitude))
        }
        Profile::Linear(Linear { f_start, f_max, .. }) => Some((f_start, f_max)),
        Profile::Table(_) => None,
    }
}

/// The interval of a ramp of so many seconds.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn interval(seconds: f64) -> u32 {
    (seconds * TICKS_PER_SECOND / INTERVALS).clamp(1.0, 1e8) as u32
}

fn movement(table: &Table, distance: Distance) -> Pulses {
    Pulses::from(&Plan::ramped(table, distance, SpeedIndex::TOP))
}

/// 1, 2, 3 … 48, 60, 75, 93 …
fn lengths() -> impl Iterator<Item = Distance> {
    let next = |length: &u16| {
        if *length < EVERY_LENGTH_TO { Some(length + 1) } else { length.checked_add(length / 4) }
    };
    std::iter::successors(Some(1), next).filter_map(Distance::new)
}

/// The ramp with the steepest emergency stop from its top that holds; the normal descent if none is steeper.
fn with_brake(ramp: &RampConfig, stand: &Stand) -> RampConfig {
    let braked = |brake_interval_ticks| RampConfig { brake_interval_ticks, ..ramp.clone() };
    let holds = |interval| {
        let Ok(table) = Table::new(&braked(interval)) else { return false };
        let mut plan = Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP);
        let told = plan.tick_of(table.normal().pulses().0 + CRUISE);
        plan.stop(&table, told, Stop::Brake);
        stand.holds(&Pulses::from(&plan))
    };
    braked(shortest(1, ramp.interval_ticks(), holds).unwrap_or(ramp.interval_ticks()))
}
