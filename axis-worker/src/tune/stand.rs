//! Movements on rotors: does the motor follow, how well, and with how much in hand?

use std::sync::atomic::{AtomicU32, Ordering};

use supersigma_config::{MotorConfig, MotorError};
use supersigma_protocol::{Direction, Ticks};

use super::pulses::{Pulses, speed};
use super::{Margin, TuneError};
use crate::motor::{Load, PATIENCE, Rotor, pull_out, start_stop};

/// How often the settling is looked at: every 50 µs.
const LOOK: Ticks = Ticks(100);
/// Half steps from its place at which a rotor counts as settled.
const SETTLED: f64 = 0.5;
/// The margin of a movement is found to this part of the holding torque.
const FINE: f64 = 0.005;
/// Half steps/s; no 8253 of this house is meant to go beyond.
const FASTEST: f64 = 100_000.0;

/// What became of a movement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// Every pulse is a step, and the rotor is at rest in the right place. It has stayed within half of a half step of it
    /// since so long after the last pulse.
    Follows {
        /// After the last pulse.
        settled: Ticks,
    },
    /// It has lost steps.
    Slips(Slip),
}

/// Where a motor fell out of step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slip {
    /// The pulse, from 1, after which it was past the point of no return; the last one's number if that came later.
    pub pulse: usize,
    /// When that pulse was, from the start.
    pub at: Ticks,
    /// The speed of the field there, half steps/s.
    pub speed: f64,
    /// Half steps between where the pulses led and where the rotor came to rest; positive if it lags behind. May be 0: it
    /// has slipped and caught itself.
    pub lost: i64,
}

/// A movement on a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// From the start to the last pulse.
    pub duration: Ticks,
    /// The largest frequency, half steps/s.
    pub top_speed: f64,
    /// On the motor as it is.
    pub nominal: Outcome,
    /// On the rung, of those of the margin, that fares worst; as `nominal` if all follow.
    pub at_margin: Outcome,
    /// The largest margin with which it holds: down to it all tried weakenings did. `None` if it does not even hold without.
    pub margin: Option<Margin>,
}

/// Plays pulses on a motor that stands at rest, forwards.
///
/// # Errors
/// If such a motor cannot be.
pub fn play(motor: &MotorConfig, pulses: &Pulses) -> Result<Outcome, MotorError> {
    Ok(run(Rotor::standing(motor)?, pulses))
}

/// How far the rotor is behind the field, in half steps, just before each pulse and, from the last one on, every 50 µs until
/// it is at rest, but a tenth of a second at most: what [`play`] makes of a motor, to look at. A lag of more than 4 is
/// past the unstable point.
///
/// # Errors
/// If such a motor cannot be.
pub fn lags(motor: &MotorConfig, pulses: &Pulses) -> Result<Vec<(Ticks, f64)>, MotorError> {
    let mut rotor = Rotor::standing(motor)?;
    let mut now = Ticks(0);
    let mut lags = Vec::with_capacity(pulses.len());
    let mut look = |rotor: &mut Rotor, span: Ticks| {
        rotor.advance(span);
        now.0 += span.0;
        #[expect(clippy::cast_precision_loss, reason = "at most 65 535 half steps")]
        lags.push((now, rotor.field().0 as f64 - rotor.motion().half_steps));
    };
    for period in pulses.periods() {
        look(&mut rotor, Ticks(u64::from(*period)));
        rotor.pulse(Direction::Forward);
    }
    let mut left = 100 * Ticks::from_millis(1).0;
    while !rotor.is_at_rest() && left > 0 {
        look(&mut rotor, LOOK);
        left -= LOOK.0;
    }
    Ok(lags)
}

/// All that there is to say about a movement.
///
/// # Errors
/// If the motor cannot be, or not with that margin.
pub fn assess(motor: &MotorConfig, margin: Margin, pulses: &Pulses) -> Result<Assessment, TuneError> {
    let stand = Stand::new(motor, margin)?;
    let nominal = play(motor, pulses)?;
    let outcomes = stand.rungs.iter().map(|rung| run(rung.rotor.clone(), pulses));
    let slips = outcomes.into_iter().find(|outcome| matches!(outcome, Outcome::Slips(_)));
    Ok(Assessment {
        duration: pulses.duration(),
        top_speed: pulses.top_speed(),
        nominal,
        at_margin: slips.unwrap_or(nominal),
        margin: margin_of(motor, pulses, slips.is_none().then_some(margin))?,
    })
}

/// The largest margin of a movement, which is known to hold with `known`.
fn margin_of(
    motor: &MotorConfig,
    pulses: &Pulses,
    known: Option<Margin>,
) -> Result<Option<Margin>, TuneError> {
    let holds = |part: f64| match Stand::at(motor, part) {
        Ok(stand) => Ok(stand.holds(pulses)),
        Err(TuneError::NoMargin { .. }) => Ok(false),
        Err(error) => Err(error),
    };
    let (mut good, mut bad) = (known.map_or(0.0, Margin::part), 1.0);
    if known.is_none() && !holds(0.0)? {
        return Ok(None);
    }
    while bad - good > FINE {
        let between = f64::midpoint(good, bad);
        if holds(between)? {
            good = between;
        } else {
            bad = between;
        }
    }
    Ok(Margin::new(good))
}

/// The motor, weakened and turned as the margin wants it.
pub(super) struct Stand {
    rungs: Vec<Rung>,
    trials: AtomicU32,
}

struct Rung {
    config: MotorConfig,
    /// At rest, with its load.
    rotor: Rotor,
}

impl Stand {
    /// The rungs of `margin`, the weakest first: it is the most likely to slip.
    pub(super) fn new(motor: &MotorConfig, margin: Margin) -> Result<Self, TuneError> {
        let mut stand = Self::at(motor, margin.part())?;
        if margin > Margin::NONE {
            for part in [margin.part() / 2.0, 0.0] {
                stand.rungs.extend(Self::at(motor, part)?.rungs);
            }
        }
        Ok(stand)
    }

    /// The motor without `part` of its torque, its load torque both ways.
    fn at(motor: &MotorConfig, part: f64) -> Result<Self, TuneError> {
        motor.check()?;
        let weak = weakened(motor, part);
        let load = motor.friction + motor.load_torque.abs();
        if load >= weak.holding_torque {
            // A part that is not a margin has left nothing at all.
            let margin = Margin::new(part).unwrap_or(Margin::NONE);
            return Err(TuneError::NoMargin { load, weakened: weak.holding_torque, margin });
        }
        let turned = MotorConfig { load_torque: -weak.load_torque, ..weak.clone() };
        let both = if weak.load_torque == 0.0 { vec![weak] } else { vec![weak, turned] };
        let rung = |config: MotorConfig| Ok(Rung { rotor: Rotor::standing(&config)?, config });
        Ok(Self {
            rungs: both.into_iter().map(rung).collect::<Result<_, MotorError>>()?,
            trials: AtomicU32::new(0),
        })
    }

    /// Whether every rung follows the pulses.
    pub(super) fn holds(&self, pulses: &Pulses) -> bool {
        self.trials.fetch_add(1, Ordering::Relaxed);
        self.rungs.iter().all(|rung| follows(rung.rotor.clone(), pulses))
    }

    /// Movements played so far.
    pub(super) fn trials(&self) -> u32 {
        self.trials.load(Ordering::Relaxed)
    }

    /// The smallest start-stop frequency of all rungs; `None` if one does not start.
    pub(super) fn start_stop(&self) -> Result<Option<f64>, MotorError> {
        self.worst(|config| start_stop(config, Load::default()))
    }

    /// The smallest pull-out frequency of all rungs, of those that begin at `start`.
    pub(super) fn pull_out(&self, start: f64) -> Result<f64, MotorError> {
        let worst = self.worst(|config| {
            pull_out(config, Load::default(), start..=FASTEST).map(|limit| limit.or(Some(FASTEST)))
        })?;
        Ok(worst.unwrap_or(FASTEST))
    }

    fn worst(
        &self,
        limit: impl Fn(&MotorConfig) -> Result<Option<f64>, MotorError>,
    ) -> Result<Option<f64>, MotorError> {
        let mut worst = f64::INFINITY;
        for rung in &self.rungs {
            match limit(&rung.config)? {
                Some(limit) => worst = worst.min(limit),
                None => return Ok(None),
            }
        }
        Ok(Some(worst))
    }
}

/// The motor without `part` of its torque.
pub(super) fn weakened(motor: &MotorConfig, part: f64) -> MotorConfig {
    MotorConfig { holding_torque: motor.holding_torque * (1.0 - part), ..motor.clone() }
}

/// Whether the rotor follows; it is not played to the end if it does not.
fn follows(mut rotor: Rotor, pulses: &Pulses) -> bool {
    rotor.follow(pulses.periods().iter().copied(), Direction::Forward).is_none() && rotor.arrives()
}

/// All pulses, and until the rotor is at rest.
fn run(mut rotor: Rotor, pulses: &Pulses) -> Outcome {
    let (mut now, mut slip) = (0, None);
    for (pulse, period) in (1..).zip(pulses.periods()) {
        rotor.advance(Ticks(u64::from(*period)));
        now += u64::from(*period);
        rotor.pulse(Direction::Forward);
        if slip.is_none() && rotor.slips() > 0 {
            slip = Some(Slip { pulse, at: Ticks(now), speed: speed(*period), lost: 0 });
        }
    }
    let (mut settled, mut waited) = (Ticks(0), Ticks(0));
    // A rest before which the rotor swung is looked at from its own rest position: a hanging weight has moved it.
    let mut resting = rotor.clone();
    resting.settle(PATIENCE);
    while !rotor.is_at_rest() && waited < PATIENCE {
        rotor.advance(LOOK);
        waited.0 += LOOK.0;
        if (rotor.motion().half_steps - resting.motion().half_steps).abs() > SETTLED {
            settled = waited;
        }
    }
    if rotor.is_at_rest() && rotor.is_in_place() {
        return Outcome::Follows { settled };
    }
    let last = pulses.periods().last().map_or(0.0, |period| speed(*period));
    let late = Slip { pulse: pulses.len(), at: Ticks(now), speed: last, lost: 0 };
    Outcome::Slips(Slip { lost: rotor.field().0 - rotor.detent().0, ..slip.unwrap_or(late) })
}
