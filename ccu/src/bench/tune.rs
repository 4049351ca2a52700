//! A movement by the ramp that an axis has and by those that are proposed for it, side by side.

use axis_worker::ramp::{Plan, Table};
use axis_worker::tune::{
    Assessment, CardShape, LinearProposal, Margin, Pulses, TuneError, assess, card, linear,
};
use supersigma_config::{CountTable, Linear, MotorConfig, Profile, RampConfig, Sin2};
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
    /// The shapes to propose: a linear one both for the bench and for the card.
    pub shapes: &'a [CardShape],
}

/// Whose movement it is.
#[derive(Debug, Clone, PartialEq)]
pub enum Maker {
    /// The ramp that the axis has.
    Current(RampConfig),
    /// The bench's positioning with a linear profile, for this movement alone.
    Bench(Box<LinearProposal>),
    /// A new ramp for the card.
    Card(CardShape, RampConfig),
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
            Self::Card(CardShape::Linear, _) => "card, linear",
            Self::Card(CardShape::Sin2, _) => "card, sin²",
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
    let Wanted { motor, current, distance, margin, shapes } = *wanted;
    let way = |maker, pulses: Pulses, trials| {
        assess(motor, margin, &pulses).map(|assessment| Way { maker, pulses, assessment, trials })
    };
    let table = Table::new(current).map_err(|reason| TuneError::NoTable { reason })?;
    let made = Pulses::from(&Plan::ramped(&table, distance, SpeedIndex::TOP));
    let mut ways = vec![way(Maker::Current(current.clone()), made, 0)?];
    for &shape in shapes {
        if shape == CardShape::Linear {
            let found = linear(motor, distance, margin)?;
            let (pulses, trials) = (found.pulses.clone(), found.trials);
            ways.push(way(Maker::Bench(Box::new(found)), pulses, trials)?);
        }
        let found = card(motor, distance, margin, shape, current)?;
        ways.push(way(Maker::Card(shape, found.ramp), found.pulses, found.trials)?);
    }
    Ok(ways)
}

/// The fastest of the card's new ramps.
#[must_use]
pub fn best_ramp(ways: &[Way]) -> Option<&RampConfig> {
    let ramps = ways.iter().filter_map(|way| Some((way.maker.ramp()?, way.assessment.duration)));
    ramps.min_by_key(|(_, duration)| *duration).map(|(ramp, _)| ramp)
}

/// A ramp as it stands in a configuration: of the set, or of an axis, below whose table it then belongs.
#[must_use]
pub fn toml(ramp: &RampConfig, axis: Option<&str>) -> String {
    let mut text = match axis {
        None => "[ramp]\n".to_owned(),
        Some(axis) => format!("[axis.ramp]   # below the [[axis]] of {axis}\n"),
    };
    let mut key = |name: &str, value: String| text.extend([name, " = ", &value, "\n"]);
    key("profile", format!("\"{}\"", ramp.profile.name().word()));
    match &ramp.profile {
        Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks }) => {
            key("amplitude", format!("{amplitude:?}"));
            key("omega", format!("{omega:?}"));
            key("phase", format!("{phase:?}"));
            key("interval_ticks", interval_ticks.to_string());
        }
        Profile::Linear(Linear { f_start, f_max, t_a }) => {
            key("f_start", format!("{f_start:?}"));
            key("f_max", format!("{f_max:?}"));
            key("t_a", format!("{t_a:?}"));
        }
        Profile::Table(CountTable { counts, interval_ticks }) => {
            key("counts", format!("{counts:?}"));
            key("interval_ticks", interval_ticks.to_string());
        }
    }
    key("brake_interval_ticks", ramp.brake_interval_ticks.to_string());
    key("differences", format!("\"{}\"", ramp.differences.word()));
    text
}

#[cfg(test)]
mod tests {
    use supersigma_config::{Config, Differences};

    use super::*;

    #[test]
    fn the_proposed_toml_is_the_proposed_ramp() {
        let axis = "[[axis]]\naddress = 1\nname = \"x\"\n\
            rail = { length = 68_000, lower_zone = 600, reference = 800, upper_zone = 67_000, start = 4_500 }\ntravel = { min = 0, max = 66_000 }\n";
        let linear = Linear { f_start: 980.0, f_max: 12_345.0, t_a: 0.087_654 };
        let sin2 = Sin2 { amplitude: 9_000.0, omega: 11.0, phase: 0.25, interval_ticks: 971 };
        for profile in [Profile::Linear(linear), Profile::Sin2(sin2)] {
            for differences in [Differences::Byte, Differences::Wide] {
                let ramp = RampConfig { brake_interval_ticks: 77, differences, ..profile.clone().into() };
                let of_the_set = format!("{}\n{axis}", toml(&ramp, None));
                let config = Config::from_toml(&of_the_set, "a.toml").expect("a good configuration");
                assert_eq!(config.ramp, ramp);
                let of_the_axis = format!("{axis}\n{}", toml(&ramp, Some("x")));
                let config = Config::from_toml(&of_the_axis, "b.toml").expect("a good configuration");
                assert_eq!(config.ramp_of(&config.axes[0]), &ramp);
                assert_eq!(config.ramp, RampConfig::default());
            }
        }
    }
}
