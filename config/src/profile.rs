//! The shape of a ramp: the profile that its speed follows, and what every profile has besides. How the keys stand in a
//! text is here too; the numbers N are made in `ramp`.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use supersigma_protocol::{SpeedIndex, Tick};

use crate::SPEEDS;

/// Intervals of a whole ramp, from entry 0 to entry 232.
const INTERVALS: u8 = SpeedIndex::TOP.get();
/// The paper's 1.29 ms.
const PAPER_INTERVAL: u32 = 2_580;
/// Three times as steep.
const PAPER_BRAKE_INTERVAL: u32 = 860;

/// How an axis starts and stops: a profile of speed over time, of which the firmware has a table of 233 entries, and how
/// it is played.
///
/// In a text all keys stand side by side; `profile` says which of them there are ([`Profile`]).
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(into = "Written")]
pub struct RampConfig {
    /// Speed over time.
    pub profile: Profile,
    /// Ticks from one entry to the next in an emergency stop: fewer than in the ramp, so that the same table makes a steeper
    /// one.
    pub brake_interval_ticks: u32,
    /// Steps kept in reserve between the computed end of the deceleration and the target, 65 535 at most.
    pub offset: u32,
    /// How movements too short for the whole ramp are made.
    pub short_moves: ShortMoves,
    /// How large a difference between two entries may be.
    pub differences: Differences,
}

/// Speed over time while an axis accelerates.
///
/// ```text
///   sin2                       linear                     table
///     │      ╭───               │       ╭────              │        ╭───
///     │    ╱                    │     ╱                    │     ╭──╯
///     │  ╱                      │   ╱                      │  ╭──╯   counts, a fixed
///     │─╯  [C] eq. (3)          │ ╱    [M] eq. (1), (3)    │──╯      time apart
///     └──────────── t           └──────────── t            └──────────── t
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// `profile = "sin2"`, the default.
    Sin2(Sin2),
    /// `profile = "linear"`.
    Linear(Linear),
    /// `profile = "table"`.
    Table(CountTable),
}

/// V(t) = amplitude · sin²(omega · t + phase), \[C\] eq. (3).
///
/// The paper prints an amplitude of 14 000, which contradicts its own text (650 steps/s at t = 0, 15 000 at
/// t = 0.3 s); with 15 000 every other figure of the paper agrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sin2 {
    /// Steps per second.
    pub amplitude: f64,
    /// Radians per second.
    pub omega: f64,
    /// Radians.
    pub phase: f64,
    /// Ticks of 0.5 µs from one entry of the table to the next.
    pub interval_ticks: u32,
}

/// f(t) = m · t + `f_start` with m = (`f_max` − `f_start`) / `t_a`, \[M\] eq. (1) and (3).
///
/// Where \[M\] computes a period for every step, the card has 233 speeds, equally far apart in time and in speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    /// The starting frequency, steps per second.
    pub f_start: f64,
    /// The constant frequency that is reached, steps per second.
    pub f_max: f64,
    /// The acceleration time, seconds.
    pub t_a: f64,
}

/// The numbers N themselves, a fixed time apart.
#[derive(Debug, Clone, PartialEq)]
pub struct CountTable {
    /// N(0), N(1), …: 2 to 233 of them. The last one holds for all further entries.
    pub counts: Vec<u16>,
    /// Ticks of 0.5 µs from one entry to the next.
    pub interval_ticks: u32,
}

/// How movements are made that are too short for the whole ramp.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShortMoves {
    /// Up the curve and, half-way, back down it.
    #[default]
    Optimal,
    /// \[C\]: the same differences with a larger initial N, constant speed below 200 steps.
    Paper,
}

/// What the card keeps of the difference between two entries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Differences {
    /// One byte, 0 to 255, as in Table 2 of \[C\].
    #[default]
    Byte,
    /// Two bytes: any difference.
    Wide,
}

impl Differences {
    /// As it is written.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Byte => "byte",
            Self::Wide => "wide",
        }
    }
}

/// The word for a profile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ProfileName {
    /// \[C\]: amplitude · sin²(omega · t + phase).
    #[default]
    Sin2,
    /// \[M\]: from `f_start` to `f_max` in `t_a`.
    Linear,
    /// The numbers N themselves.
    Table,
}

impl Default for RampConfig {
    fn default() -> Self {
        Sin2::default().into()
    }
}

impl Default for Sin2 {
    fn default() -> Self {
        Self { amplitude: 15_000.0, omega: 4.544_26, phase: 0.209_7, interval_ticks: PAPER_INTERVAL }
    }
}

impl From<Profile> for RampConfig {
    /// The ramp of a profile, all else as it is if nobody says otherwise.
    fn from(profile: Profile) -> Self {
        let brake_interval_ticks = match profile {
            Profile::Sin2(_) => PAPER_BRAKE_INTERVAL,
            Profile::Linear(_) | Profile::Table(_) => (profile.interval_ticks() / 3).max(1),
        };
        Self {
            profile,
            brake_interval_ticks,
            offset: 10,
            short_moves: ShortMoves::default(),
            differences: Differences::default(),
        }
    }
}

impl From<Sin2> for RampConfig {
    fn from(sin2: Sin2) -> Self {
        Profile::Sin2(sin2).into()
    }
}

impl From<Linear> for RampConfig {
    fn from(linear: Linear) -> Self {
        Profile::Linear(linear).into()
    }
}

impl From<CountTable> for RampConfig {
    fn from(table: CountTable) -> Self {
        Profile::Table(table).into()
    }
}

impl RampConfig {
    /// Ticks from one entry of the table to the next in a normal ramp.
    #[must_use]
    pub fn interval_ticks(&self) -> u32 {
        self.profile.interval_ticks()
    }
}

impl Profile {
    /// Its word.
    #[must_use]
    pub const fn name(&self) -> ProfileName {
        match self {
            Self::Sin2(_) => ProfileName::Sin2,
            Self::Linear(_) => ProfileName::Linear,
            Self::Table(_) => ProfileName::Table,
        }
    }

    /// Ticks from one entry of the table to the next. Of a linear profile they follow from its time:
    ///
    /// ```text
    /// interval = t_a / 232, to the nearest tick: over a whole ramp 58 µs are the most that this misses t_a by
    /// ```
    #[must_use]
    pub fn interval_ticks(&self) -> u32 {
        match self {
            Self::Sin2(sin2) => sin2.interval_ticks,
            Self::Linear(linear) => linear.interval_ticks(),
            Self::Table(table) => table.interval_ticks,
        }
    }

    /// The last entry at which the speed still rises, but for rounding: 232, or less of a table with fewer entries.
    #[must_use]
    pub fn last_entry(&self) -> u8 {
        let given = match self {
            Self::Sin2(_) | Self::Linear(_) => SPEEDS,
            Self::Table(table) => table.counts.len(),
        };
        u8::try_from(given.clamp(1, SPEEDS) - 1).unwrap_or(u8::MAX)
    }
}

impl Linear {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "what is no time is 0")]
    #[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
    fn interval_ticks(&self) -> u32 {
        (self.t_a * Tick::PER_SECOND as f64 / f64::from(INTERVALS)).round() as u32
    }

    /// Steps per second at `entry` of the table.
    pub(crate) fn speed(&self, entry: u8) -> f64 {
        self.f_start + (self.f_max - self.f_start) * f64::from(entry) / f64::from(INTERVALS)
    }
}

impl ProfileName {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Sin2, Self::Linear, Self::Table];

    /// As it is written.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Sin2 => "sin2",
            Self::Linear => "linear",
            Self::Table => "table",
        }
    }

    /// The profile of this word.
    #[must_use]
    pub fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|name| name.word() == word)
    }

    /// Whose key this is, in words, as in `` `sin2` or `table` ``.
    pub(crate) fn owners(key: &str) -> String {
        let owners = Self::ALL.into_iter().filter(|name| name.keys().contains(&key));
        owners.map(|name| format!("`{}`", name.word())).collect::<Vec<_>>().join(" or ")
    }

    /// The keys that a ramp with this profile has, besides those of all ramps.
    #[must_use]
    pub const fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Sin2 => &["amplitude", "omega", "phase", "interval_ticks"],
            Self::Linear => &["f_start", "f_max", "t_a"],
            Self::Table => &["file", "counts", "interval_ticks"],
        }
    }
}

/// A ramp as it stands in a text. A key that is none of its profile's is refused before, where its place is known.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "RampConfig", deny_unknown_fields, default)]
struct Written {
    /// Speed over time: `sin2`, the curve of \[C\], with `amplitude`, `omega`, `phase` and `interval_ticks`; `linear`, that of
    /// \[M\], with `f_start`, `f_max` and `t_a`; or `table`, with `file` or `counts`, and `interval_ticks`.
    profile: ProfileName,
    /// Steps per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    amplitude: Option<f64>,
    /// Radians per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    omega: Option<f64>,
    /// Radians.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    phase: Option<f64>,
    /// Of a linear ramp: the starting frequency, steps per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    f_start: Option<f64>,
    /// Of a linear ramp: the constant frequency that is reached, steps per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    f_max: Option<f64>,
    /// Of a linear ramp: the acceleration time, seconds. An entry of the table follows the other after a 232nd of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", extend("exclusiveMinimum" = 0))]
    t_a: Option<f64>,
    /// A file with the numbers N of the table, one a line, largest first; what follows a `#` is a comment. It is looked for
    /// beside the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String")]
    file: Option<String>,
    /// The numbers N of the table, largest first; instead of `file`. The last one holds to the end of the ramp.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Vec<u16>", length(min = 2, max = 233))]
    counts: Option<Vec<u16>>,
    /// Ticks of 0.5 µs from one entry of the table to the next: 2 580 is the paper's 1.29 ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1, max = 2_000_000))]
    interval_ticks: Option<u32>,
    /// The same for an emergency stop: shorter, so that the same table makes a steeper ramp. 860 of a `sin2` ramp if not
    /// given, a third of the interval of the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1))]
    brake_interval_ticks: Option<u32>,
    /// Steps kept in reserve between the computed end of the deceleration and the target, 65 535 at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(max = 65_535))]
    offset: Option<u32>,
    /// How movements too short for the whole ramp are made.
    short_moves: ShortMoves,
    /// How large a difference between two entries may be: one `byte`, as in \[C\], or `wide`.
    differences: Differences,
}

impl Written {
    /// The ramp that is meant; `Err` is the key that is missing.
    fn ramp(self) -> Result<RampConfig, &'static str> {
        let interval_ticks = self.interval_ticks.unwrap_or(PAPER_INTERVAL);
        let profile = match self.profile {
            ProfileName::Sin2 => {
                let usual = Sin2::default();
                Profile::Sin2(Sin2 {
                    amplitude: self.amplitude.unwrap_or(usual.amplitude),
                    omega: self.omega.unwrap_or(usual.omega),
                    phase: self.phase.unwrap_or(usual.phase),
                    interval_ticks,
                })
            }
            ProfileName::Linear => Profile::Linear(Linear {
                f_start: self.f_start.ok_or("f_start")?,
                f_max: self.f_max.ok_or("f_max")?,
                t_a: self.t_a.ok_or("t_a")?,
            }),
            ProfileName::Table => {
                Profile::Table(CountTable { counts: self.counts.ok_or("file")?, interval_ticks })
            }
        };
        let usual = RampConfig::from(profile);
        Ok(RampConfig {
            brake_interval_ticks: self.brake_interval_ticks.unwrap_or(usual.brake_interval_ticks),
            offset: self.offset.unwrap_or(usual.offset),
            short_moves: self.short_moves,
            differences: self.differences,
            profile: usual.profile,
        })
    }
}

impl From<RampConfig> for Written {
    fn from(ramp: RampConfig) -> Self {
        let common = Self {
            profile: ramp.profile.name(),
            brake_interval_ticks: Some(ramp.brake_interval_ticks),
            offset: Some(ramp.offset),
            short_moves: ramp.short_moves,
            differences: ramp.differences,
            ..Self::default()
        };
        match ramp.profile {
            Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks }) => Self {
                amplitude: Some(amplitude),
                omega: Some(omega),
                phase: Some(phase),
                interval_ticks: Some(interval_ticks),
                ..common
            },
            Profile::Linear(Linear { f_start, f_max, t_a }) => {
                Self { f_start: Some(f_start), f_max: Some(f_max), t_a: Some(t_a), ..common }
            }
            Profile::Table(CountTable { counts, interval_ticks }) => {
                Self { counts: Some(counts), interval_ticks: Some(interval_ticks), ..common }
            }
        }
    }
}

impl<'de> Deserialize<'de> for RampConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Written::deserialize(deserializer)?.ramp().map_err(D::Error::missing_field)
    }
}

impl JsonSchema for RampConfig {
    fn schema_name() -> Cow<'static, str> {
        "RampConfig".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Written::json_schema(generator)
    }
}
