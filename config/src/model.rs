//! The shape of the configuration. Rules that need more than one value are in `rules`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use supersigma_protocol::{AxisNumber, Position, SpeedIndex, Steps};

use crate::{MotorConfig, RampConfig};

/// A whole set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The ramp of every axis that has none of its own.
    #[serde(default)]
    pub ramp: RampConfig,
    /// Lines: several axes that start at one tick.
    #[serde(default)]
    pub line: LineConfig,
    /// The executive: sense, control, wait.
    #[serde(default)]
    pub executive: ExecutiveConfig,
    /// How the CCU knows that a process is alive.
    #[serde(default)]
    pub supervision: SupervisionConfig,
    /// What the cards' processes ask of the system, to be in time on a busy machine.
    #[serde(default)]
    pub real_time: RealTimeConfig,
    /// The MCAP log.
    #[serde(default)]
    pub log: LogConfig,
    /// One to seven axes, each with its own address and name.
    #[serde(rename = "axis")]
    #[schemars(length(min = 1, max = 7))]
    pub axes: Vec<AxisConfig>,
    /// The digital input and output cards.
    #[serde(default)]
    pub digital: DigitalConfig,
}

/// Lines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LineConfig {
    /// Real milliseconds from the start command to the common start tick.
    #[schemars(range(min = 1))]
    pub lead_ms: u32,
}

impl Default for LineConfig {
    fn default() -> Self {
        Self { lead_ms: 40 }
    }
}

/// The executive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExecutiveConfig {
    /// Real milliseconds within which a card must answer a command.
    #[schemars(range(min = 1))]
    pub answer_ms: u32,
    /// Real milliseconds beyond the planned end after which a movement is overdue.
    #[schemars(range(min = 1))]
    pub overdue_ms: u32,
    /// Whether a movement that is overdue, or whose shaft did not follow, is tried again, and then once more from the
    /// reference step.
    pub recover: bool,
}

impl Default for ExecutiveConfig {
    fn default() -> Self {
        Self { answer_ms: 500, overdue_ms: 500, recover: true }
    }
}

/// How the CCU knows that a process is alive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SupervisionConfig {
    /// Real milliseconds between two heartbeats of a card.
    #[schemars(range(min = 1))]
    pub heartbeat_ms: u32,
    /// Real milliseconds of silence after which a card counts as hung: more than two heartbeats.
    #[schemars(range(min = 1))]
    pub silent_ms: u32,
    /// Whether a worker, or the recorder, that ends unasked is started again.
    pub restart: bool,
}

impl Default for SupervisionConfig {
    fn default() -> Self {
        Self { heartbeat_ms: 100, silent_ms: 450, restart: true }
    }
}

/// What the cards' processes ask of the system, to be in time on a busy machine. What they do not get, they do without, and
/// say so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RealTimeConfig {
    /// By which of the system's rules they get a processor.
    pub policy: SchedulingPolicy,
    /// Their priority under `fifo`, 1 to 99, the highest.
    #[schemars(range(min = 1, max = 99))]
    pub priority: u8,
    /// Whether their memory is locked, so that no page of it is ever fetched from disk.
    pub lock_memory: bool,
    /// The numbers of the processors on which alone they run, 0 to 1023; none for all.
    #[schemars(inner(range(max = 1_023)))]
    pub cpus: Vec<u16>,
}

impl Default for RealTimeConfig {
    fn default() -> Self {
        Self { policy: SchedulingPolicy::Normal, priority: 50, lock_memory: false, cpus: Vec::new() }
    }
}

/// By which of the system's rules a process gets a processor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SchedulingPolicy {
    /// As all others.
    Normal,
    /// Before all that are `normal`, and as long as it wants: Linux' `SCHED_FIFO`.
    Fifo,
}

/// The MCAP log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LogConfig {
    /// Real milliseconds after which what was recorded is on disk, readable.
    #[schemars(range(min = 1))]
    pub flush_ms: u32,
    /// Milliseconds of machine time from one report of a moving axis' position and speed to the next; 0 for none.
    pub sample_ms: u32,
    /// What follows when frames are missing in the log.
    pub on_loss: OnLoss,
    /// The length in megabytes, 0.1 or more, at which the log goes on in another file. Without it, length does not matter.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1))]
    pub rotate_mb: Option<f64>,
    /// The real minutes, 0.01 or more, after which the log goes on in another file. Without it, time does not matter.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.01))]
    pub rotate_min: Option<f64>,
}

impl Default for LogConfig {
    fn default() -> Self {
        Self { flush_ms: 100, sample_ms: 10, on_loss: OnLoss::Warn, rotate_mb: None, rotate_min: None }
    }
}

/// What follows when frames are missing in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnLoss {
    /// They are counted and told; motion goes on.
    Warn,
    /// All axes brake, and nothing moves until the set is taken down and up again.
    Stop,
}

/// One axis: a card, its motor and its rail.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisConfig {
    /// The address of its card, 1 to 7.
    #[schemars(extend("minimum" = 1, "maximum" = 7))]
    pub address: AxisNumber,
    /// What people call it: lower-case letters, digits and `_`, beginning with a letter.
    #[schemars(regex(pattern = "^[a-z][a-z0-9_]*$"))]
    pub name: String,
    /// The rail that the motor drives.
    pub rail: RailConfig,
    /// Where movements may end.
    pub travel: TravelConfig,
    /// How the origin is found.
    #[serde(default)]
    pub origination: OriginationConfig,
    /// A ramp of its own. What it leaves out is as in the set's ramp, if both have the same profile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ramp: Option<RampConfig>,
    /// Whether the card believes its pulses, or measures the shaft; closed loop needs a `motor` with its encoder.
    #[serde(default, rename = "loop")]
    pub feedback: Feedback,
    /// Closed loop: how far the shaft may lag, and when it counts as standing.
    #[serde(default)]
    pub following: FollowingConfig,
    /// A motor that can lose steps. Without it the carriage makes every step that it is told to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<MotorConfig>,
}

/// A rail, in steps e from its lower stop (e = 0) to its upper one (e = length), as in \[F\] Fig 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RailConfig {
    /// em, the last step: 1 000 000 at most.
    #[schemars(extend("maximum" = 1_000_000))]
    pub length: Steps,
    /// e1: the lower limit zone is 0 < e ≤ e1. Its detector is the limit switch of the origination, so the origin is e1 + 1.
    pub lower_zone: Steps,
    /// e2: the upper limit zone is e2 ≤ e < em.
    pub upper_zone: Steps,
    /// eR, the reference step; about half a turn of the shaft from the lower zone.
    pub reference: Steps,
    /// Where the carriage stands when the set is switched on. The firmware does not know it.
    pub start: Steps,
}

/// The permitted positions, in steps from the origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TravelConfig {
    /// The lowest: 0, the origin, or more.
    #[schemars(extend("minimum" = 0))]
    pub min: Position,
    /// The highest: not in the upper limit zone.
    pub max: Position,
}

/// How a card knows where its axis is, \[F\].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Feedback {
    /// It counts its pulses: X4 when they have ended, X5 never.
    #[default]
    Open,
    /// It reads the encoder: X4 when the target is reached, X5 when the shaft is slower than S1.
    Closed,
}

/// What closed loop tolerates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FollowingConfig {
    /// Steps between pulses and shaft from which on it is an alarm.
    pub limit: Steps,
    /// S1: below so many steps per second the shaft counts as standing.
    pub s1: f64,
}

impl Default for FollowingConfig {
    fn default() -> Self {
        Self { limit: Steps(64), s1: 50.0 }
    }
}

/// How the origin is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OriginationConfig {
    /// The ceiling of the approach to the limit switch, an index into the ramp table, 0 to 232. The carriage must be
    /// able to stop inside the lower limit zone.
    #[schemars(extend("maximum" = 232))]
    pub speed: SpeedIndex,
}

impl Default for OriginationConfig {
    fn default() -> Self {
        Self { speed: SpeedIndex::new(90).unwrap_or(SpeedIndex::START) }
    }
}

/// The digital cards and what is wired to them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DigitalConfig {
    /// Named lines of the output card.
    #[serde(rename = "output")]
    pub outputs: Vec<OutputConfig>,
    /// Named lines of the input card.
    #[serde(rename = "input")]
    pub inputs: Vec<InputConfig>,
}

/// A line of the output card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutputConfig {
    /// The line's place on the card, 0 to 15.
    #[schemars(range(max = 15))]
    pub bit: u8,
    /// What people call it: lower-case letters, digits and `_`, beginning with a letter.
    #[schemars(regex(pattern = "^[a-z][a-z0-9_]*$"))]
    pub name: String,
}

/// A line of the input card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputConfig {
    /// The line's place on the card, 0 to 15.
    #[schemars(range(max = 15))]
    pub bit: u8,
    /// What people call it: lower-case letters, digits and `_`, beginning with a letter.
    #[schemars(regex(pattern = "^[a-z][a-z0-9_]*$"))]
    pub name: String,
    /// The output that this input follows, as a gripper's closed contact follows its valve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub follows: Option<String>,
    /// Milliseconds of machine time from the output to the input; only with `follows`.
    #[serde(default)]
    pub delay_ms: u32,
    /// The level at switch-on.
    #[serde(default)]
    pub initial: bool,
}

impl Config {
    /// The axis with this number.
    #[must_use]
    pub fn axis(&self, number: AxisNumber) -> Option<&AxisConfig> {
        self.axes.iter().find(|axis| axis.address == number)
    }

    /// The axis that people name so: by its name, or by its number in digits.
    #[must_use]
    pub fn find_axis(&self, name: &str) -> Option<&AxisConfig> {
        let number = name.parse::<u8>().ok().and_then(AxisNumber::new);
        self.axes.iter().find(|axis| axis.name == name || Some(axis.address) == number)
    }

    /// The ramp of an axis: its own, or the set's.
    #[must_use]
    pub fn ramp_of<'a>(&'a self, axis: &'a AxisConfig) -> &'a RampConfig {
        axis.ramp.as_ref().unwrap_or(&self.ramp)
    }
}
