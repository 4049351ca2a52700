//! A movement by the ramp that an axis has and by those that are proposed for it, side by side.

use axis_worker::bench::Positioning;
use axis_worker::ramp::{Plan, Table};
use axis_worker::tune::{
    Assessment, LinearProposal, Margin, Pulses, TuneError, assess, linear, sin2,
};
use supersigma_config::{MotorConfig, RampConfig};
use supersigma_protocol::{Distance, SpeedIndex};

/// What is to be found.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// The motor with its load.
    pub motor: &'a MotorConfig,
    /// The ramp that it has.
    pub current: &'a RampConfig,
    /// The movement.
    pub distance: Distance,
    /// What is to be kept in hand.
    pub margin: Margin,
    /// The kinds of proposals.
    pub kinds: &'a [Kind],
}

/// What can be proposed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// A linear profile.
    Linear,
    /// A sin² ramp.
    Sin2,
}

/// Whose movement it is.
#[derive(Debug, Clone, PartialEq)]
pub enum Maker {
    /// The ramp that the axis has.
    Current(RampConfig),
    /// The bench's positioning with a linear profile, for this movement alone.
    Bench(Box<LinearProposal>),
    /// A new ramp for the card.
    Card(Kind, RampConfig),
}

/// One way to make the movement.
#[derive(Debug, Clone, PartialEq)]
pub struct Way {
    /// Who makes it.
    pub maker: Maker,
    /// Its pulses.
    pub pulses: Pulses,
    /// How the motor follows them.
    pub assessment: Assessment,
    /// Movements that were played to find it; none for the current one.
    pub trials: u32,
}

impl Maker {
    /// A word for it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Current(_) => "current",
            Self::Bench(_) => "bench, linear",
            Self::Card(Kind::Linear, _) => "card, linear",
            Self::Card(Kind::Sin2, _) => "card, sin²",
        }
    }

    /// The profile of the bench.
    #[must_use]
    pub fn positioning(&self) -> Option<Positioning> {
        match self {
            Self::Bench(proposal) => Some(proposal.profile),
            Self::Current(_) | Self::Card(..) => None,
        }
    }

    /// The new ramp of the card.
    #[must_use]
    pub const fn ramp(&self) -> Option<&RampConfig> {
        match self {
            Self::Card(_, ramp) => Some(ramp),
            Self::Current(_) | Self::Bench(_) => None,
        }
    }
}

/// All ways: the current one first.
///
/// # Errors
/// If the motor cannot do it at all, or the card can play no ramp of a kind.
pub fn compare(wanted: &Wanted<'_>) -> Result<Vec<Way>, TuneError> {
    let Wanted { motor, current, distance, margin, kinds } = *wanted;
    let way = |maker, pulses: Pulses, trials| {
        assess(motor, margin, &pulses).map(|assessment| Way { maker, pulses, assessment, trials })
    };
    let table = Table::new(current).map_err(|reason| TuneError::NoTable { reason })?;
    let made = Pulses::from(&Plan::ramped(&table, distance, SpeedIndex::TOP));
    let mut ways = vec![way(Maker::Current(current.clone()), made, 0)?];
    if kinds.contains(&Kind::Linear) {
        let found = linear(motor, distance, margin)?;
        let (pulses, trials) = (found.pulses.clone(), found.trials);
        ways.push(way(Maker::Bench(Box::new(found)), pulses, trials)?);
    }
    if kinds.contains(&Kind::Sin2) {
        let found = sin2(motor, distance, margin, current)?;
        ways.push(way(Maker::Card(Kind::Sin2, found.ramp), found.pulses, found.trials)?);
    }
    Ok(ways)
}
