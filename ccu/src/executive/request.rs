//! What can be asked of a set, what comes of it, and why it does not: plain data, the same for a live set behind its
//! control socket and for a dry run. Nothing is carried out in here.

use std::collections::BTreeMap;

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use supersigma_protocol::{
    Address, Alarm, AxisNumber, AxisReport, CommandBytes, Deviation, Direction, Distance, Fault, Position,
    Refusal, StatusWord, Steps, Ticks,
};

/// Signed steps: positive is away from the origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Displacement(pub i64);

impl Displacement {
    /// Direction and distance; `None` for no steps at all.
    ///
    /// # Errors
    /// If it is more than one movement can be.
    pub fn split(self) -> Result<Option<(Direction, Distance)>, Failure> {
        let direction = if self.0 < 0 { Direction::TowardsOrigin } else { Direction::Forward };
        let steps = u16::try_from(self.0.unsigned_abs()).map_err(|_| Failure::TooFar { steps: self.0 })?;
        Ok(Distance::new(steps).map(|distance| (direction, distance)))
    }
}

/// Something to be done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// Find the origin of these axes, all at once.
    Originate {
        /// Which; none means all.
        axes: Vec<AxisNumber>,
    },
    /// Find the reference step.
    SeekReference {
        /// Of which axis.
        axis: AxisNumber,
    },
    /// One movement.
    Move {
        /// Of which axis.
        axis: AxisNumber,
        /// How far.
        by: Displacement,
        /// The ceiling in steps per second; with `constant`, the speed.
        speed: Option<f64>,
        /// Without a ramp.
        constant: bool,
        /// Until it is complete.
        wait: bool,
    },
    /// Several axes on a straight line, together.
    Line {
        /// How far each goes.
        parts: Vec<(AxisNumber, Displacement)>,
        /// The ceiling of the leading axis in steps per second.
        speed: Option<f64>,
        /// Until it is complete.
        wait: bool,
    },
    /// One line after the other, running on over the joints where the curve allows it.
    Path {
        /// The lines.
        legs: Vec<Leg>,
        /// Until it is complete.
        wait: bool,
    },
    /// Finish what was halted.
    Resume,
    /// Stop with the normal ramp.
    Halt {
        /// Which; none means all.
        axes: Vec<AxisNumber>,
    },
    /// Stop with the steep ramp and lock.
    Brake {
        /// Which; none means all.
        axes: Vec<AxisNumber>,
    },
    /// Acknowledge alarms.
    Clear {
        /// Which; none means all.
        axes: Vec<AxisNumber>,
    },
    /// The state of these axes, asked of their cards.
    Status {
        /// Which; none means all.
        axes: Vec<AxisNumber>,
    },
    /// Switch one digital output.
    Output {
        /// 0 to 15.
        bit: u8,
        /// On or off.
        on: bool,
    },
    /// The sixteen lines of a digital card.
    Digital {
        /// 8 or 9.
        card: Address,
    },
    /// Make a fault on purpose.
    Inject {
        /// On which axis.
        axis: AxisNumber,
        /// Which.
        fault: Fault,
    },
    /// Let machine time pass.
    Wait {
        /// How much.
        ticks: Ticks,
    },
    /// Raw bytes on the bus.
    Send {
        /// They need not be right.
        bytes: CommandBytes,
    },
}

impl Request {
    /// The axes that it moves, and how far in all, if its rest can be made later. A search has no rest: it is begun anew.
    #[must_use]
    pub fn moving(&self) -> BTreeMap<AxisNumber, Displacement> {
        let mut axes = BTreeMap::new();
        let mut add = |parts: &[(AxisNumber, Displacement)]| {
            for (axis, by) in parts.iter().filter(|(_, by)| by.0 != 0) {
                axes.entry(*axis).or_insert(Displacement(0)).0 += by.0;
            }
        };
        match self {
            Self::Move { axis, by, .. } => add(&[(*axis, *by)]),
            Self::Line { parts, .. } => add(parts),
            Self::Path { legs, .. } => legs.iter().for_each(|leg| add(&leg.parts)),
            _ => {}
        }
        axes
    }

    /// Whether it is a movement that nobody waits for.
    #[must_use]
    pub fn is_unwatched(&self) -> bool {
        matches!(
            self,
            Self::Move { wait: false, .. } | Self::Line { wait: false, .. } | Self::Path { wait: false, .. }
        )
    }
}

/// One line of a path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Leg {
    /// How far each axis goes; an axis that is not named stands.
    pub parts: Vec<(AxisNumber, Displacement)>,
    /// The ceiling of the leading axis in steps per second.
    pub speed: Option<f64>,
}

/// What is left of a movement that was halted.
#[derive(Debug, Clone, PartialEq)]
pub struct Remainder {
    /// What finishes it.
    pub request: Request,
    /// Where the axes stood then; if they stand elsewhere, it makes no sense any more.
    pub from: Vec<(AxisNumber, Option<Position>)>,
}

/// What came of a [`Request`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It is done, and there is no more to say.
    Done,
    /// Movements, complete.
    Moved(Vec<Movement>),
    /// The state of axes.
    Axes(Vec<AxisState>),
    /// The lines of a digital card.
    Digital(u16),
    /// The cards' answers to raw bytes.
    Answers(Vec<RawAnswer>),
}

/// A movement that is over.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Movement {
    /// Which axis.
    pub axis: AxisNumber,
    /// What it was.
    pub kind: MovementKind,
    /// What was asked; `None` for a search, which knows no distance.
    pub asked: Option<Displacement>,
    /// Pulses made.
    pub done: Steps,
    /// X1..X5 at its end.
    pub sense: StatusWord,
    /// From the tick at which the card took the command (a line: at which it started) to the last pulse.
    pub took: Ticks,
    /// Where the axis stands now.
    pub position: Option<Position>,
    /// For a search: by how much the axis stood off from where it was believed to be.
    pub lost: Option<Deviation>,
    /// What it took to get there, if it did not go well at once.
    pub recovered: Option<Recovery>,
}

/// What the executive did about a movement that had failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recovery {
    /// It made the rest of the movement.
    TriedAgain,
    /// It found the reference step anew, and went to the target from there.
    SoughtReference,
}

impl std::fmt::Display for Recovery {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::TriedAgain => "tried again",
            Self::SoughtReference => "sought the reference step",
        })
    }
}

/// Kinds of movements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MovementKind {
    /// With a ramp.
    Move,
    /// At constant speed.
    Slew,
    /// As a part of a line.
    Line,
    /// As a part of a path.
    Path,
    /// Looking for the origin.
    Origin,
    /// Looking for the reference step.
    Reference,
}

impl std::fmt::Display for MovementKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Move => "move",
            Self::Slew => "slew",
            Self::Line => "line",
            Self::Path => "path",
            Self::Origin => "origin",
            Self::Reference => "reference",
        })
    }
}

/// An axis and what its card says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct AxisState {
    /// Which axis.
    pub axis: AxisNumber,
    /// What its card says; `None` if nobody plays the card.
    pub report: Option<AxisReport>,
}

/// What a card said to raw bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RawAnswer {
    /// The card; `None` if no card has the address, and the CCU says so itself.
    pub card: Option<Address>,
    /// Whether it was carried out.
    pub result: Result<(), Refusal>,
    /// The card's state.
    pub report: Option<supersigma_protocol::Report>,
}

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
