//! The picture at one moment, as plain data: what a dashboard draws and what programs read as JSON. The keys are a
//! contract. Nothing is computed in here that the frames do not say.

use serde::Serialize;
use supersigma_config::AxisConfig;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{Activity, AxisNumber, Deviation, Position, Steps, Tick};

use super::frames::Filter;
use crate::control::{Description, ProcessView, RecorderView};
pub use crate::log::AlarmView;

/// How much of everything a snapshot shall have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Detail {
    /// The last so many frames…
    pub frames: usize,
    /// … of these.
    pub filter: Filter,
    /// The last so many events.
    pub events: usize,
    /// The last so many slots, of 100 ms real time, of each axis' speed and position; 600 at most.
    pub history: usize,
}

impl Default for Detail {
    fn default() -> Self {
        Self { frames: 20, filter: Filter::default(), events: 10, history: 100 }
    }
}

/// A set at one moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot {
    /// What the set says of itself; null if only frames are known, as in a replay.
    pub set: Option<SetView>,
    /// The latest tick that was seen, in units of 0.5 µs of machine time.
    pub tick: Tick,
    /// The same in seconds of machine time.
    pub time_s: f64,
    /// Frames of the CCU.
    pub commands: LaneCounts,
    /// Frames of cards.
    pub answers: LaneCounts,
    /// Frames that never came here, by the gaps in the sequence numbers.
    pub lost: u64,
    /// Frames that this watcher was too slow to read; the set has not lost them.
    pub dropped: u64,
    /// The axes, by number.
    pub axes: Vec<AxisSnapshot>,
    /// The digital inputs.
    pub inputs: DigitalSnapshot,
    /// The digital outputs.
    pub outputs: DigitalSnapshot,
    /// The last frames, oldest first.
    pub frames: Vec<FrameLine>,
    /// The titles over their lines.
    pub frames_title: String,
    /// The last events, oldest first.
    pub events: Vec<EventView>,
}

/// What a set says of itself.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SetView {
    /// Its name.
    pub name: String,
    /// The daemon's process.
    pub pid: u32,
    /// Seconds of real time since it is up.
    pub up_s: f64,
    /// How many times faster than real time.
    pub time_scale: f64,
    /// The recorder, and its log.
    pub recorder: RecorderView,
    /// Its processes.
    pub processes: Vec<ProcessView>,
    /// Frames on its bus since it is up.
    pub frames: u64,
    /// Frames that were lost since it is up.
    pub lost: u64,
}

/// The frames of one direction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LaneCounts {
    /// Since the watching began.
    pub total: u64,
    /// In the last second of real time.
    pub per_second: u64,
}

/// An axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisSnapshot {
    /// Its number.
    pub axis: AxisNumber,
    /// Its name.
    pub name: String,
    /// Whether somebody plays its card.
    pub alive: bool,
    /// What it is doing; null if it has not been heard.
    pub activity: Option<Activity>,
    /// X1..X5, X1 first, as in `00010`.
    pub sense: Option<String>,
    /// Steps done in this movement, or in the last one.
    pub steps: Option<Steps>,
    /// Steps from the origin; null if the card does not know.
    pub position: Option<Position>,
    /// Steps per second, negative towards the origin.
    pub speed: f64,
    /// By how many steps the last origination found it off.
    pub lost: Option<Deviation>,
    /// Why it is locked; null if it is not.
    pub alarm: Option<AlarmView>,
    /// Its rail, in steps from the origin.
    pub rail: RailView,
    /// Speed over time: the fastest in each slot, oldest first.
    pub speed_history: Vec<f64>,
    /// Position over time: the last in each slot, oldest first.
    pub position_history: Vec<Option<Position>>,
}

/// A rail, in steps from the origin: what lies below it is negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct RailView {
    /// The lower stop, e = 0.
    pub lower_stop: Position,
    /// The last step of the lower limit zone, e = e1.
    pub lower_zone: Position,
    /// The first step of the upper limit zone, e = e2.
    pub upper_zone: Position,
    /// The upper stop, e = em.
    pub upper_stop: Position,
    /// The reference step, e = eR.
    pub reference: Position,
    /// The lowest permitted position.
    pub travel_min: Position,
    /// The highest permitted position.
    pub travel_max: Position,
}

/// A digital card.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DigitalSnapshot {
    /// Bit n is line n; null if the card has not told.
    pub word: Option<u16>,
    /// The lines that have names.
    pub lines: Vec<LineView>,
}

/// A named line of a digital card.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LineView {
    /// 0 to 15.
    pub bit: u8,
    /// Its name.
    pub name: String,
    /// Whether it is on; null if the card has not told.
    pub on: Option<bool>,
}

/// A frame in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FrameLine {
    /// Its number among those that were seen, from 1.
    pub number: u64,
    /// `commands` or `answers`.
    pub lane: LaneName,
    /// For people; aligned below [`Snapshot::frames_title`].
    pub text: String,
}

/// Which way a frame goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LaneName {
    /// From the CCU.
    Commands,
    /// From a card.
    Answers,
}

/// What somebody should look at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EventView {
    /// Its number, from 1.
    pub number: u64,
    /// When, in seconds of machine time.
    pub time_s: f64,
    /// Whether it is an error; a warning if not.
    pub error: bool,
    /// Whom it is about.
    pub name: String,
    /// What happened.
    pub message: String,
}

impl From<Lane> for LaneName {
    fn from(lane: Lane) -> Self {
        match lane {
            Lane::Commands => Self::Commands,
            Lane::Answers => Self::Answers,
        }
    }
}

impl From<&Description> for SetView {
    fn from(set: &Description) -> Self {
        Self {
            name: set.name.clone(),
            pid: set.pid,
            up_s: set.up_s,
            time_scale: set.time_scale,
            recorder: set.recorder.clone(),
            processes: set.processes.clone(),
            frames: set.frames,
            lost: set.lost,
        }
    }
}

impl From<&AxisConfig> for RailView {
    fn from(axis: &AxisConfig) -> Self {
        // The origin is e1 + 1; a rail is 1 000 000 steps at most.
        let origin = i64::from(axis.rail.lower_zone.0) + 1;
        let at = |e: Steps| Position(i32::try_from(i64::from(e.0) - origin).unwrap_or(i32::MAX));
        let rail = &axis.rail;
        Self {
            lower_stop: at(Steps(0)),
            lower_zone: at(rail.lower_zone),
            upper_zone: at(rail.upper_zone),
            upper_stop: at(rail.length),
            reference: at(rail.reference),
            travel_min: axis.travel.min,
            travel_max: axis.travel.max,
        }
    }
}
