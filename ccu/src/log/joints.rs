//! All axes in one message, for plots and 3D: `/joint_states`, in the shape `foxglove.JointStates`. What it says follows
//! from the frames, in the log's order, and from the attached configuration alone, so that a dry run's log has it too.
//!
//! A joint is the motor's shaft: the configuration knows how many half steps a turn has, and no lengths. Moving axes
//! report on one grid in machine time; a point of the grid gets one message, once all that move have reported for it.
//! Between two messages few joints change, so each keeps its own text.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use serde::Serialize;
use supersigma_config::{Config, MotorConfig};
use supersigma_protocol::{About, Activity, Answer, AxisNumber, CardKind, Occasion, Pace, Report, Tick};

use super::events::Timestamp;
use super::header::{LogHeader, Timeline, WallTime};
use super::schema::twin_into;

/// One joint of `foxglove.JointStates`, as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct JointState {
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
    /// The message that is being told; kept to reuse its memory.
    text: Vec<u8>,
}

#[derive(Debug)]
struct Joint {
    radians_per_step: f64,
    state: JointState,
    /// The state as it stands in a message.
    text: Vec<u8>,
    activity: Option<Activity>,
    sampled: Option<Tick>,
}

impl Joint {
    fn moves(&self) -> bool {
        !matches!(self.activity, None | Some(Activity::Standing | Activity::Armed))
    }

    fn put_in_words(&mut self) {
        self.text.clear();
        twin_into(&self.state, &mut self.text);
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
            let mut joint =
                Joint { radians_per_step, state, text: Vec::new(), activity: None, sampled: None };
            joint.put_in_words();
            (axis, joint)
        };
        let axes = header.names.iter().map(joint).collect();
        Self { timeline: header.timeline, axes, open: None, done: None, complete: false, text: Vec::new() }
    }

    /// Takes an answer; what is to be written because of it goes to `tell`, with its time.
    pub(super) fn hear(&mut self, answer: &Answer, tell: &mut impl FnMut(WallTime, &[u8])) {
        let (Report::Axis(report), CardKind::Axis(axis)) = (answer.report, answer.card.kind()) else {
            return;
        };
        if !self.axes.contains_key(&axis) {
            return;
        }
        let at = answer.acted_at;
        let sampled = answer.about == About::Unasked(Occasion::Sampled);
        let stands = report.activity == Activity::Standing;
        // Before anything of a later moment is taken in.
        if (sampled || stands) && self.open.is_some_and(|open| open < at) {
            self.rest(tell);
        }
        let Some(joint) = self.axes.get_mut(&axis) else { return };
        let has_come_to_stand = stands && joint.activity.is_some_and(|before| before != Activity::Standing);
        joint.activity = Some(report.activity);
        joint.state.position = report.position.map(|position| f64::from(position.0) * joint.radians_per_step);
        joint.state.velocity = Some(report.pace.map_or(0.0, Pace::steps_per_second) * joint.radians_per_step);
        joint.put_in_words();
        if sampled {
            joint.sampled = Some(at);
        }
        let was_complete =
            std::mem::replace(&mut self.complete, self.axes.values().all(|joint| joint.activity.is_some()));
        if has_come_to_stand || (self.complete && !was_complete) {
            self.open = None;
            self.tell_of(at, tell);
        } else if sampled && self.done.is_none_or(|done| done < at) {
            self.open = Some(at);
            if self.axes.values().all(|joint| !joint.moves() || joint.sampled == Some(at)) {
                self.rest(tell);
            }
        }
    }

    /// What waits for axes that have not reported.
    pub(super) fn rest(&mut self, tell: &mut impl FnMut(WallTime, &[u8])) {
        if let Some(open) = self.open.take() {
            self.tell_of(open, tell);
        }
    }

    /// `foxglove.JointStates` of this moment, as JSON.
    fn tell_of(&mut self, at: Tick, tell: &mut impl FnMut(WallTime, &[u8])) {
        self.done = Some(at);
        let time = self.timeline.wall(at);
        let text = &mut self.text;
        text.clear();
        text.extend_from_slice(b"{\"timestamp\":");
        twin_into(&Timestamp::from(time), text);
        text.extend_from_slice(b",\"joints\":");
        let mut before = b'[';
        for joint in self.axes.values() {
            text.push(before);
            text.extend_from_slice(&joint.text);
            before = b',';
        }
        text.extend_from_slice(b"]}");
        tell(time, text);
    }
}
