//! All axes in one message, for plots and 3D: `/joint_states`, in the shape `foxglove.JointStates`. What it says follows
//! from the frames, in the log's order, and from the attached configuration alone, so that a dry run's log has it too.
//!
//! A joint is the motor's shaft: the configuration knows how many half steps a turn has, and no lengths. Moving axes
//! report on one grid in machine time; a point of the grid gets one message, once all that move have reported for it.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use serde::Serialize;
use supersigma_config::{Config, MotorConfig};
use supersigma_protocol::{About, Activity, Answer, AxisNumber, CardKind, Occasion, Pace, Report, Tick};

use super::events::Timestamp;
use super::header::{LogHeader, Timeline, WallTime};

/// `foxglove.JointStates` as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct JointStates {
    timestamp: Timestamp,
    joints: Vec<JointState>,
}

impl JointStates {
    /// When the axes were so.
    pub(super) fn time(&self) -> WallTime {
        self.timestamp.into()
    }
}

/// One joint of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct JointState {
    name: String,
    /// Radians from the origin, as far as it is known.
    position: Option<f64>,
    /// Radians per second, negative towards the origin, once the card has spoken.
    velocity: Option<f64>,
}

/// What the axes said last, and which points of the grid are done.
#[derive(Debug)]
pub(super) struct Joints {
    timeline: Timeline,
    axes: BTreeMap<AxisNumber, Joint>,
    /// A point of the grid for which some axes have reported and others, which move too, have not.
    open: Option<Tick>,
    /// The last moment that has its message; nothing is written for earlier ones any more.
    done: Option<Tick>,
    /// Whether every axis has spoken.
    complete: bool,
}

#[derive(Debug)]
struct Joint {
    radians_per_step: f64,
    state: JointState,
    activity: Option<Activity>,
    sampled: Option<Tick>,
}

impl Joint {
    fn moves(&self) -> bool {
        !matches!(self.activity, None | Some(Activity::Standing | Activity::Armed))
    }
}

impl Joints {
    /// The set's axes. Without a `motor` in the configuration, an axis has the bench motor's turn, 400 half steps.
    pub(super) fn new(header: &LogHeader) -> Self {
        let config = Config::from_toml(&header.config, "the log's configuration").ok();
        let motor = |axis| config.as_ref().and_then(|config| config.axis(axis)?.motor.as_ref());
        let half_steps = |axis| {
            motor(axis).map_or(MotorConfig::bench().half_steps_per_turn, |motor| motor.half_steps_per_turn)
        };
        let joint = |(axis, name): (AxisNumber, &str)| {
            let state = JointState { name: name.to_owned(), position: None, velocity: None };
            let radians_per_step = TAU / f64::from(half_steps(axis));
            (axis, Joint { radians_per_step, state, activity: None, sampled: None })
        };
        let axes = header.names.iter().map(joint).collect();
        Self { timeline: header.timeline, axes, open: None, done: None, complete: false }
    }

    /// Takes an answer; gives what is to be written because of it.
    pub(super) fn hear(&mut self, answer: &Answer) -> Vec<JointStates> {
        let (Report::Axis(report), CardKind::Axis(axis)) = (answer.report, answer.card.kind()) else {
            return Vec::new();
        };
        if !self.axes.contains_key(&axis) {
            return Vec::new();
        }
        let at = answer.acted_at;
        let sampled = answer.about == About::Unasked(Occasion::Sampled);
        let stands = report.activity == Activity::Standing;
        let mut due = Vec::new();
        // Before anything of a later moment is taken in.
        if (sampled || stands) && self.open.is_some_and(|open| open < at) {
            due.extend(self.rest());
        }
        let Some(joint) = self.axes.get_mut(&axis) else { return due };
        let has_come_to_stand = stands && joint.activity.is_some_and(|before| before != Activity::Standing);
        joint.activity = Some(report.activity);
        joint.state.position = report.position.map(|position| f64::from(position.0) * joint.radians_per_step);
        joint.state.velocity = Some(report.pace.map_or(0.0, Pace::steps_per_second) * joint.radians_per_step);
        if sampled {
            joint.sampled = Some(at);
        }
        let was_complete =
            std::mem::replace(&mut self.complete, self.axes.values().all(|joint| joint.activity.is_some()));
        if has_come_to_stand || (self.complete && !was_complete) {
            (self.open, self.done) = (None, Some(at));
            due.push(self.snapshot(at));
        } else if sampled && self.done.is_none_or(|done| done < at) {
            self.open = Some(at);
            if self.axes.values().all(|joint| !joint.moves() || joint.sampled == Some(at)) {
                due.extend(self.rest());
            }
        }
        due
    }

    /// What waits for axes that have not reported.
    pub(super) fn rest(&mut self) -> Option<JointStates> {
        let open = self.open.take()?;
        self.done = Some(open);
        Some(self.snapshot(open))
    }

    fn snapshot(&self, at: Tick) -> JointStates {
        JointStates {
            timestamp: self.timeline.wall(at).into(),
            joints: self.axes.values().map(|joint| joint.state.clone()).collect(),
        }
    }
}
