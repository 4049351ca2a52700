//! What a log says about itself before its first frame: the set, its axes' names, how ticks become wall time, the
//! configuration and the script. Values only; `writer` puts them into the file, `reader` finds them there.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use axis_worker::clock::TimeScale;
use supersigma_config::Config;
use supersigma_protocol::{AxisNumber, Tick};

/// The name of the metadata record, and the first part of the schemas' names.
pub(super) const METADATA_NAME: &str = "supersigma";
/// The name of the attachment that holds the configuration.
pub(super) const CONFIG_NAME: &str = "config.toml";
/// The name of the attachment that holds the script.
pub(super) const SCRIPT_NAME: &str = "script.rhai";
/// One tick in nanoseconds of machine time.
const TICK_NS: u64 = 1_000_000_000 / Tick::PER_SECOND;

/// What stands before the first frame.
#[derive(Debug, Clone, PartialEq)]
pub struct LogHeader {
    /// The version of the program that wrote it.
    pub version: String,
    /// The set's name, as in `--name`.
    pub set: String,
    /// The axes.
    pub names: AxisNames,
    /// From ticks to wall time.
    pub timeline: Timeline,
    /// The configuration as TOML.
    pub config: String,
    /// The script that moved the set, if one did.
    pub script: Option<String>,
}

impl LogHeader {
    /// The version of this program.
    pub const VERSION: &str = env!("CARGO_PKG_VERSION");

    /// The entries of the metadata record.
    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut entries = BTreeMap::from([
            ("version".to_owned(), self.version.clone()),
            ("set".to_owned(), self.set.clone()),
            ("epoch_ns".to_owned(), self.timeline.epoch.0.to_string()),
            ("time_scale".to_owned(), self.timeline.scale.to_string()),
            ("tick_ns".to_owned(), TICK_NS.to_string()),
        ]);
        entries.extend(self.names.iter().map(|(axis, name)| (axis_key(axis), name.to_owned())));
        entries
    }

    /// The header in a metadata record, still without configuration and script; `None` if an entry is missing.
    pub(super) fn from_metadata(entries: &BTreeMap<String, String>) -> Option<Self> {
        Some(Self {
            version: entries.get("version")?.clone(),
            set: entries.get("set")?.clone(),
            names: AxisNumber::all()
                .filter_map(|axis| Some((axis, entries.get(&axis_key(axis))?.clone())))
                .collect(),
            timeline: Timeline {
                epoch: WallTime(entries.get("epoch_ns")?.parse().ok()?),
                scale: entries.get("time_scale")?.parse().ok()?,
            },
            config: String::new(),
            script: None,
        })
    }
}

fn axis_key(axis: AxisNumber) -> String {
    format!("axis.{}", axis.get())
}

/// What people call the axes of a set.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AxisNames([Option<String>; AxisNumber::COUNT]);

impl AxisNames {
    /// The axis' name; its number in digits if the set has no such axis.
    #[must_use]
    pub fn of(&self, axis: AxisNumber) -> Cow<'_, str> {
        match &self.0[axis.index()] {
            Some(name) => Cow::Borrowed(name),
            None => Cow::Owned(axis.get().to_string()),
        }
    }

    /// The axis with this name, or with this number in digits.
    #[must_use]
    pub fn find(&self, text: &str) -> Option<AxisNumber> {
        let number = text.parse().ok().and_then(AxisNumber::new);
        self.iter().find(|&(axis, name)| name == text || Some(axis) == number).map(|(axis, _)| axis)
    }

    /// The axes of the set, by number.
    pub fn iter(&self) -> impl Iterator<Item = (AxisNumber, &str)> {
        AxisNumber::all().filter_map(|axis| Some((axis, self.0[axis.index()].as_deref()?)))
    }
}

impl FromIterator<(AxisNumber, String)> for AxisNames {
    fn from_iter<I: IntoIterator<Item = (AxisNumber, String)>>(names: I) -> Self {
        let mut all = Self::default();
        for (axis, name) in names {
            all.0[axis.index()] = Some(name);
        }
        all
    }
}

impl From<&Config> for AxisNames {
    fn from(config: &Config) -> Self {
        config.axes.iter().map(|axis| (axis.address, axis.name.clone())).collect()
    }
}

/// Nanoseconds since 1970-01-01 UTC, as MCAP counts them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct WallTime(pub u64);

impl WallTime {
    /// The system's clock; 1970 if it stands before that.
    #[must_use]
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self(since.as_nanos().try_into().unwrap_or(u64::MAX))
    }
}

/// Where the set's epoch lies in wall time, and how fast its ticks run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timeline {
    /// The wall time of tick 0.
    pub epoch: WallTime,
    /// How fast the ticks run.
    pub scale: TimeScale,
}

impl Timeline {
    /// The wall time of a tick: epoch + tick · 500 ns / scale. Exact in real time for the first hundred days.
    #[must_use]
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, below 2^53 for a hundred days, and the cast saturates"
    )]
    pub fn wall(&self, tick: Tick) -> WallTime {
        let since = tick.0 as f64 * TICK_NS as f64 / self.scale.get();
        WallTime(self.epoch.0.saturating_add(since as u64))
    }

    /// The tick at a wall time, the nearest one; 0 before the epoch. It gives back what [`Timeline::wall`] was given as
    /// long as a tick is longer than a nanosecond, which is up to 500 times real time.
    #[must_use]
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, below 2^53 for a hundred days, and the cast saturates"
    )]
    pub fn tick(&self, wall: WallTime) -> Tick {
        let since = wall.0.saturating_sub(self.epoch.0);
        Tick((since as f64 * self.scale.get() / TICK_NS as f64).round() as u64)
    }
}
