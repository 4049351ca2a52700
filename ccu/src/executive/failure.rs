//! Why something did not come about, what to do about it, and with which exit code a command ends.

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use supersigma_protocol::{Address, Alarm, AxisNumber, Position, Refusal, Steps};

/// Why something did not come about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error, Diagnostic)]
#[serde(rename_all = "snake_case")]
pub enum Failure {
    /// A card refused.
    #[error("{axis} refused: {refusal}")]
    #[diagnostic(help("{}", advice(refusal)))]
    Refused {
        /// The axis.
        axis: AxisNumber,
        /// Its reason.
        refusal: Refusal,
    },
    /// A digital card refused.
    #[error("{card} refused: {refusal}")]
    DigitalRefused {
        /// The card.
        card: Address,
        /// Its reason.
        refusal: Refusal,
    },
    /// An alarm ended the movement.
    #[error("{axis} is in alarm: {alarm}; {done} steps done, {}", place(*position))]
    #[diagnostic(help("look at the axis, then `ccu clear`; {}", if position.is_some() { "its position is kept" } else { "originate it, its position is lost" }))]
    Alarm {
        /// The axis.
        axis: AxisNumber,
        /// The cause.
        alarm: Alarm,
        /// Pulses made.
        done: Steps,
        /// Where it stands.
        position: Option<Position>,
    },
    /// Somebody stopped the movement.
    #[error("{axis} was stopped after {done} steps, {}", place(*position))]
    #[diagnostic(help("{}", if position.is_some() { "`ccu resume` makes the remaining steps" } else { "originate it, its position is lost" }))]
    Stopped {
        /// The axis.
        axis: AxisNumber,
        /// Pulses made.
        done: Steps,
        /// Where it stands.
        position: Option<Position>,
    },
    /// The card did not answer in time.
    #[error("{card} did not answer within {milliseconds} ms")]
    #[diagnostic(help("see `ccu status`; if the card's process hangs, take the set down and up again"))]
    NoAnswer {
        /// The card.
        card: Address,
        /// How long it was given, in real time.
        milliseconds: u32,
    },
    /// The movement did not end when it should have.
    #[error("{axis} is overdue: its movement should have ended {milliseconds} ms ago; {done} steps done")]
    #[diagnostic(help("the machine may be too busy; raise `executive.overdue_ms`, or lower the time scale"))]
    Overdue {
        /// The axis.
        axis: AxisNumber,
        /// Real time beyond the due time.
        milliseconds: u32,
        /// Pulses made.
        done: Steps,
    },
    /// Nothing that the executive tried has helped.
    #[error("{axis} does not get there: {reason}; the executive {tried}")]
    #[diagnostic(help(
        "look at the axis; nothing moves it until it is cleared (`ccu clear`) and originated (`ccu origin`)"
    ))]
    GaveUp {
        /// The axis.
        axis: AxisNumber,
        /// What went wrong in the end.
        reason: String,
        /// What was tried, in order.
        tried: String,
    },
    /// In a replay, an axis still moves that stood in the record.
    #[error("{axis} still moves {milliseconds} ms after the moment at which it stood in the record")]
    #[diagnostic(help("the set does not do what the recorded one did; compare the two logs with `ccu frames`"))]
    NotAsRecorded {
        /// The axis.
        axis: AxisNumber,
        /// How long it was given, in real time.
        milliseconds: u32,
    },
    /// A line could not be started on all axes in time.
    #[error("the line was not started: {axis} did not confirm the start in time; nobody moved")]
    #[diagnostic(help("raise `line.lead_ms`"))]
    NotConfirmed {
        /// The axis.
        axis: AxisNumber,
    },
    /// The process that plays the card is gone.
    #[error("the worker of {card} is gone")]
    #[diagnostic(help("take the set down and up again"))]
    WorkerGone {
        /// The card.
        card: Address,
    },
    /// The recorder is gone.
    #[error("the recorder is gone, and nothing moves without a log")]
    #[diagnostic(help("look at the free space where the log is, then take the set down and up again"))]
    NoLog,
    /// Frames were lost between cards and CCU.
    #[error("{lost} frames of {card} were lost on the bus")]
    FramesLost {
        /// The sender.
        card: Address,
        /// How many.
        lost: u64,
    },
    /// Whoever asked does not want it any more.
    #[error("interrupted; what was moving has been halted")]
    Cancelled,
    /// The set is being taken down.
    #[error("the set is going down")]
    GoingDown,
    /// No such axis in this set.
    #[error("this set has no {axis}")]
    NoSuchAxis {
        /// The axis.
        axis: AxisNumber,
    },
    /// A movement that one command cannot ask for.
    #[error("{steps} steps are too many for one movement (at most 65535)")]
    #[diagnostic(help("make it in parts"))]
    TooFar {
        /// What was asked.
        steps: i64,
    },
    /// A line of nothing.
    #[error("no axis of the line has any steps to make")]
    EmptyLine,
    /// A line of axes that accelerate differently.
    #[error("{one} and {other} have different ramps, so they cannot go on a line together")]
    #[diagnostic(help("give them the same ramp in the configuration"))]
    DifferentRamps {
        /// An axis.
        one: AxisNumber,
        /// Another one.
        other: AxisNumber,
    },
    /// Nothing was halted.
    #[error("nothing was halted that could be resumed")]
    NothingToResume,
    /// An axis was moved since it was halted.
    #[error("{axis} has been moved since it was halted, so the rest of its movement makes no sense")]
    MovedMeanwhile {
        /// The axis.
        axis: AxisNumber,
    },
    /// A speed that the axis' ramp does not have.
    #[error("{axis} cannot run at {asked} steps/s; its ramp goes from {slowest:.1} to {fastest:.1}")]
    SpeedOutOfRange {
        /// The axis.
        axis: AxisNumber,
        /// What was asked.
        asked: f64,
        /// Entry 0 of the ramp.
        slowest: f64,
        /// Entry 232.
        fastest: f64,
    },
    /// The carrier of the frames failed.
    #[error("the bus failed: {reason}")]
    BusGone {
        /// What it said.
        reason: String,
    },
    /// The pulses of a dry run could not be written.
    #[error("cannot write the pulses: {reason}")]
    Pulses {
        /// What the system said.
        reason: String,
    },
    /// Nobody at the other end of the control socket.
    #[error("no set named {name:?} is up")]
    #[diagnostic(help("start one with `ccu up --name {name}`"))]
    NoSet {
        /// The set.
        name: String,
    },
    /// The other end of the control socket does not speak our language.
    #[error("the set's daemon is gone or speaks another version: {reason}")]
    #[diagnostic(help("take the set down with the version that started it"))]
    Control {
        /// What happened.
        reason: String,
    },
}

impl Failure {
    /// The exit code of the command line: 1 the robot could not, 2 wrongly asked, 3 nobody there.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::NoSuchAxis { .. }
            | Self::TooFar { .. }
            | Self::EmptyLine
            | Self::DifferentRamps { .. }
            | Self::SpeedOutOfRange { .. } => 2,
            Self::BusGone { .. } | Self::NoSet { .. } | Self::Control { .. } | Self::GoingDown => 3,
            _ => 1,
        }
    }
}

fn place(position: Option<Position>) -> String {
    position.map_or_else(|| "position unknown".into(), |position| format!("at {position}"))
}

/// What to do about a refusal.
fn advice(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::NotOriginated => "originate the axis first: `ccu origin`",
        Refusal::InAlarm => "look at the axis, then acknowledge the alarm: `ccu clear`",
        Refusal::Moving => "wait until it stands (X4), or halt it first: `ccu halt`",
        Refusal::OutOfTravel { .. } => "the permitted travel is in the configuration: `ccu config show`",
        Refusal::Late { .. } => "raise `line.lead_ms` in the configuration",
        Refusal::AtEnd { .. } => "move away from that end",
        _ => "nothing has changed on the axis",
    }
}
