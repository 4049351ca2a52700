//! A frame as one row of a table, for spreadsheets and data frames. The columns and their order are a contract.

use serde::Serialize;
use supersigma_protocol::{
    Activity, Address, Deviation, Direction, Position, Sequence, SpeedIndex, Steps, Tick, Ticks,
};

use super::view::{
    AboutView, AlarmView, AnswerView, AxisView, CommandView, FrameView, ReportView, UndecodableView,
};

/// The columns' titles, in the order of [`Row`]'s fields.
pub(super) const COLUMNS: [&str; 29] = [
    "kind",
    "time_s",
    "tick",
    "sender",
    "sequence",
    "address",
    "name",
    "bytes",
    "operation",
    "direction",
    "steps",
    "speed",
    "word",
    "fault",
    "at",
    "about",
    "command",
    "refusal",
    "acted_at",
    "sense",
    "position",
    "activity",
    "steps_per_s",
    "period",
    "alarm",
    "lost",
    "reason",
    "cause",
    "error",
];

/// One frame. What it does not say is left empty.
#[derive(Debug, Default, Serialize)]
pub(super) struct Row<'a> {
    /// `command`, `answer` or `undecodable`.
    kind: &'static str,
    time_s: Option<f64>,
    tick: Option<Tick>,
    sender: Option<&'a str>,
    sequence: Option<Sequence>,
    /// Whom a command is for; whose an answer is.
    address: Option<Address>,
    name: Option<&'a str>,
    bytes: Option<&'a str>,
    operation: Option<&'static str>,
    direction: Option<Direction>,
    /// Of a command, how far; of an answer, the steps done.
    steps: Option<Steps>,
    speed: Option<SpeedIndex>,
    word: Option<u16>,
    fault: Option<&'a str>,
    at: Option<Tick>,
    /// `command`, or what an unasked answer is about.
    about: Option<&'static str>,
    /// The command that is answered.
    command: Option<Sequence>,
    /// Why bytes are no command, or why a card does not carry one out, for people.
    refusal: Option<&'a str>,
    acted_at: Option<Tick>,
    sense: Option<&'a str>,
    position: Option<Position>,
    activity: Option<Activity>,
    /// How fast an axis goes, negative towards the origin.
    steps_per_s: Option<f64>,
    /// Its pulse period in ticks.
    period: Option<Ticks>,
    /// For people.
    alarm: Option<&'a str>,
    lost: Option<Deviation>,
    /// Why a card does not carry a command out, for programs.
    reason: Option<&'a str>,
    /// The alarm for programs.
    cause: Option<&'a str>,
    error: Option<&'a str>,
}

impl<'a> From<&'a FrameView<'_>> for Row<'a> {
    fn from(view: &'a FrameView<'_>) -> Self {
        match view {
            FrameView::Command(command) => Self::command(command),
            FrameView::Answer(answer) => Self::answer(answer),
            FrameView::Undecodable(UndecodableView { bytes, error }) => {
                Self { kind: "undecodable", bytes: Some(bytes), error: Some(error), ..Self::default() }
            }
        }
    }
}

impl<'a> Row<'a> {
    fn command(view: &'a CommandView<'_>) -> Self {
        Self {
            kind: "command",
            time_s: Some(view.time_s),
            tick: Some(view.tick),
            sender: Some(&view.sender),
            sequence: Some(view.sequence),
            address: view.to,
            name: Some(&view.name),
            bytes: Some(&view.bytes),
            operation: view.operation,
            direction: view.direction,
            steps: view.steps,
            speed: view.speed,
            word: view.word,
            fault: view.fault.as_deref(),
            at: view.at,
            refusal: view.refusal.as_deref(),
            ..Self::default()
        }
    }

    fn answer(view: &'a AnswerView<'_>) -> Self {
        let (about, command, refusal) = match &view.about {
            AboutView::Command { command, refusal } => ("command", Some(*command), refusal.as_ref()),
            AboutView::Unasked { unasked } => (*unasked, None, None),
        };
        let row = Self {
            kind: "answer",
            time_s: Some(view.time_s),
            tick: Some(view.tick),
            sender: Some(&view.sender),
            sequence: Some(view.sequence),
            address: Some(view.axis),
            name: Some(&view.name),
            about: Some(about),
            command,
            refusal: refusal.map(|refusal| refusal.message.as_str()),
            reason: refusal.map(|refusal| refusal.reason.as_str()),
            acted_at: Some(view.acted_at),
            ..Self::default()
        };
        match &view.report {
            ReportView::Digital(digital) => Self { word: Some(digital.word), ..row },
            ReportView::Axis(AxisView {
                sense,
                steps,
                position,
                activity,
                alarm,
                lost,
                speed,
                period,
                ..
            }) => Self {
                sense: Some(sense),
                steps: Some(*steps),
                position: *position,
                activity: Some(*activity),
                steps_per_s: Some(*speed),
                period: *period,
                alarm: alarm.as_ref().map(|AlarmView { message, .. }| message.as_str()),
                cause: alarm.as_ref().map(|AlarmView { cause, .. }| cause.as_str()),
                lost: *lost,
                ..row
            },
        }
    }
}
