//! Why something did not come about, how that is told, and with which exit code a command ends. What to do about it is in
//! [`advice`].

use std::fmt;

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use supersigma_protocol::{Address, Alarm, AxisNumber, CardKind, Position, Refusal, Steps, Tick};

use super::advice;
use super::link::Knowledge;
use super::request::Begun;

/// Why something did not come about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Failure {
    /// A card refused.
    Refused {
        /// The axis.
        axis: AxisNumber,
        /// Its reason.
        refusal: Refusal,
        /// When the card refused; `None` if it was not asked, because the answer was known.
        #[serde(default)]
        at: Option<Tick>,
    },
    /// A digital card refused.
    DigitalRefused {
        /// The card.
        card: Address,
        /// Its reason.
        refusal: Refusal,
    },
    /// An alarm ended the movement.
    Alarm {
        /// The axis.
        axis: AxisNumber,
        /// The cause.
        alarm: Alarm,
        /// Pulses made.
        done: Steps,
        /// Where it stands.
        position: Option<Position>,
        /// The tick of the report that says so.
        #[serde(default)]
        at: Option<Tick>,
    },
    /// Somebody stopped the movement.
    Stopped {
        /// The axis.
        axis: AxisNumber,
        /// Pulses made.
        done: Steps,
        /// Where it stands.
        position: Option<Position>,
        /// The tick of the report that says so.
        #[serde(default)]
        at: Option<Tick>,
    },
    /// The card did not answer in time.
    NoAnswer {
        /// The card.
        card: Address,
        /// How long it was given, in real time.
        milliseconds: u32,
    },
    /// The movement did not end when it should have.
    Overdue {
        /// The axis.
        axis: AxisNumber,
        /// Real time beyond the due time.
        milliseconds: u32,
        /// Pulses made.
        done: Steps,
        /// When it was given up.
        #[serde(default)]
        at: Option<Tick>,
    },
    /// Nothing that the executive tried has helped.
    GaveUp {
        /// The axis.
        axis: AxisNumber,
        /// What went wrong in the end.
        reason: String,
        /// What was tried, in order.
        tried: String,
    },
    /// In a replay, an axis still moves that stood in the record.
    NotAsRecorded {
        /// The axis.
        axis: AxisNumber,
        /// How long it was given, in real time.
        milliseconds: u32,
    },
    /// A line could not be started on all axes in time.
    NotConfirmed {
        /// The axis.
        axis: AxisNumber,
    },
    /// The process that plays the card is gone.
    WorkerGone {
        /// The card.
        card: Address,
    },
    /// There is no log any more.
    NoLog(LogTrouble),
    /// Frames were lost between cards and CCU.
    FramesLost {
        /// The sender.
        card: Address,
        /// How many.
        lost: u64,
    },
    /// Whoever asked does not want it any more.
    Cancelled,
    /// The set is being taken down.
    GoingDown,
    /// No such axis in this set.
    NoSuchAxis {
        /// The axis.
        axis: AxisNumber,
    },
    /// A movement that one command cannot ask for.
    TooFar {
        /// What was asked.
        steps: i64,
    },
    /// A line of nothing.
    EmptyLine,
    /// A line of axes that accelerate differently.
    DifferentRamps {
        /// An axis.
        one: AxisNumber,
        /// Another one.
        other: AxisNumber,
    },
    /// Several movements that were waited for together have failed.
    Several {
        /// Why, each.
        failures: Vec<Failure>,
    },
    /// Something was to be begun that does not go on for a while.
    NotAMovement,
    /// Something was to be waited for that was not begun, or has been waited for already.
    NoSuchMovement {
        /// Its number.
        begun: Begun,
    },
    /// Nothing was halted.
    NothingToResume,
    /// An axis was moved since it was halted.
    MovedMeanwhile {
        /// The axis.
        axis: AxisNumber,
    },
    /// A speed that the axis' ramp does not have.
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
    BusGone {
        /// What it said.
        reason: String,
    },
    /// The pulses of a dry run could not be written.
    Pulses {
        /// What the system said.
        reason: String,
    },
    /// Nobody at the other end of the control socket.
    NoSet {
        /// The set.
        name: String,
    },
    /// The other end of the control socket does not speak our language.
    Control {
        /// What happened.
        reason: String,
    },
}

/// Why there is no log, or none any more.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogTrouble {
    /// What happened, to which file, and how much is in it.
    pub reason: String,
    /// What to do.
    pub advice: String,
}

impl Failure {
    /// The carrier of the frames failed, and says why.
    pub(crate) fn bus_gone(error: impl fmt::Display) -> Self {
        Self::BusGone { reason: error.to_string() }
    }

    /// The exit code of the command line: 1 the robot could not, 2 wrongly asked, 3 nobody there.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::NoSuchAxis { .. }
            | Self::TooFar { .. }
            | Self::EmptyLine
            | Self::NotAMovement
            | Self::NoSuchMovement { .. }
            | Self::DifferentRamps { .. }
            | Self::SpeedOutOfRange { .. } => 2,
            Self::BusGone { .. } | Self::NoSet { .. } | Self::Control { .. } | Self::GoingDown => 3,
            Self::Several { failures } => failures.first().map_or(1, Self::exit_code),
            _ => 1,
        }
    }

    /// What it is called, on the control socket, in scripts and in JSON.
    #[must_use]
    pub fn kind(&self) -> String {
        match serde_json::to_value(self) {
            Ok(Value::String(kind)) => kind,
            Ok(Value::Object(fields)) => fields.into_iter().next().map_or_else(String::new, |(kind, _)| kind),
            _ => String::new(),
        }
    }

    /// The axis that it concerns, if that is one.
    #[must_use]
    pub fn axis(&self) -> Option<AxisNumber> {
        match self {
            Self::Refused { axis, .. }
            | Self::Alarm { axis, .. }
            | Self::Stopped { axis, .. }
            | Self::Overdue { axis, .. }
            | Self::GaveUp { axis, .. }
            | Self::NotConfirmed { axis }
            | Self::NoSuchAxis { axis }
            | Self::MovedMeanwhile { axis }
            | Self::SpeedOutOfRange { axis, .. } => Some(*axis),
            Self::Several { failures } => failures.first().and_then(Self::axis),
            Self::DigitalRefused { card, .. }
            | Self::NoAnswer { card, .. }
            | Self::WorkerGone { card }
            | Self::FramesLost { card, .. } => match card.kind() {
                CardKind::Axis(axis) => Some(axis),
                _ => None,
            },
            _ => None,
        }
    }

    /// When it happened, in machine time, if a card has said so.
    #[must_use]
    pub fn at(&self) -> Option<Tick> {
        match self {
            Self::Refused { at, .. }
            | Self::Alarm { at, .. }
            | Self::Stopped { at, .. }
            | Self::Overdue { at, .. } => *at,
            Self::Several { failures } => failures.first().and_then(Self::at),
            _ => None,
        }
    }

    /// The message, in which axes have the names of this set, and with the machine time.
    #[must_use]
    pub fn told(&self, knowledge: &Knowledge) -> String {
        let mut text = String::new();
        let named = |axis: AxisNumber| knowledge.number_and_name(axis);
        let time =
            self.at().map_or_else(String::new, |at| format!(" at {:.7} s", at.since(Tick(0)).as_seconds()));
        // Writing into a string cannot fail.
        let _ = self.tell(&mut text, &named, &time);
        text
    }

    /// `time`, if it is not empty, begins with a space.
    fn tell(&self, f: &mut dyn fmt::Write, name: &dyn Fn(AxisNumber) -> String, time: &str) -> fmt::Result {
        let card_name = |card: &Address| match card.kind() {
            CardKind::Axis(axis) => name(axis),
            _ => card.to_string(),
        };
        match self {
            Self::Refused { axis, refusal, .. } => write!(f, "{} refused{time}: {refusal}", name(*axis)),
            Self::DigitalRefused { card, refusal } => write!(f, "{} refused: {refusal}", card_name(card)),
            Self::Alarm { axis, alarm, done, position, .. } => {
                write!(
                    f,
                    "{} is in alarm{time}: {alarm}; {done} steps done, {}",
                    name(*axis),
                    place(*position)
                )
            }
            Self::Stopped { axis, done, position, .. } => {
                write!(f, "{} was stopped{time} after {done} steps, {}", name(*axis), place(*position))
            }
            Self::NoAnswer { card, milliseconds } => {
                write!(f, "{} did not answer within {milliseconds} ms", card_name(card))
            }
            Self::Overdue { axis, milliseconds, done, .. } => write!(
                f,
                "{} is overdue{time}: its movement should have ended {milliseconds} ms ago; {done} steps done",
                name(*axis)
            ),
            Self::GaveUp { axis, reason, tried } => {
                write!(f, "{} does not get there: {reason}; the executive {tried}", name(*axis))
            }
            Self::NotAsRecorded { axis, milliseconds } => write!(
                f,
                "{} still moves {milliseconds} ms after the moment at which it stood in the record",
                name(*axis)
            ),
            Self::NotConfirmed { axis } => write!(
                f,
                "the line was not started: {} did not confirm the start in time; nobody moved",
                name(*axis)
            ),
            Self::WorkerGone { card } => write!(f, "the worker of {} is gone", card_name(card)),
            Self::NoLog(trouble) => write!(f, "{}; nothing moves without a log", trouble.reason),
            Self::FramesLost { card, lost } => {
                write!(f, "{lost} frames of {} were lost on the bus", card_name(card))
            }
            Self::Cancelled => f.write_str("interrupted; what was moving has been halted"),
            Self::GoingDown => f.write_str("the set is going down"),
            Self::NoSuchAxis { axis } => write!(f, "this set has no {axis}"),
            Self::TooFar { steps } => {
                write!(f, "{steps} steps are too many for one movement (at most 65535)")
            }
            Self::EmptyLine => f.write_str("no axis of the line has any steps to make"),
            Self::DifferentRamps { one, other } => write!(
                f,
                "{} and {} have different ramps, so they cannot go on a line together",
                name(*one),
                name(*other)
            ),
            Self::Several { failures } => {
                write!(f, "{} movements failed", failures.len())?;
                for (index, failure) in failures.iter().enumerate() {
                    f.write_str(if index == 0 { ": " } else { "; " })?;
                    failure.tell(f, name, "")?;
                }
                Ok(())
            }
            Self::NotAMovement => f.write_str("only a movement can be begun"),
            Self::NoSuchMovement { begun } => {
                write!(f, "no movement {} was begun here that nobody has waited for", begun.0)
            }
            Self::NothingToResume => f.write_str("nothing was halted that could be resumed"),
            Self::MovedMeanwhile { axis } => write!(
                f,
                "{} has been moved since it was halted, so the rest of its movement makes no sense",
                name(*axis)
            ),
            Self::SpeedOutOfRange { axis, asked, slowest, fastest } => write!(
                f,
                "{} cannot run at {asked} steps/s; its ramp goes from {slowest:.1} to {fastest:.1}",
                name(*axis)
            ),
            Self::BusGone { reason } => write!(f, "the bus failed: {reason}"),
            Self::Pulses { reason } => write!(f, "cannot write the pulses: {reason}"),
            Self::NoSet { name } => write!(f, "no set named {name:?} is up"),
            Self::Control { reason } => {
                write!(f, "the set's daemon is gone or speaks another version: {reason}")
            }
        }
    }
}

/// Without names: whoever knows the set has [`told`](Failure::told).
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tell(f, &|axis| axis.to_string(), "")
    }
}

impl std::error::Error for Failure {}

impl Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(advice::failure(self)))
    }
}

fn place(position: Option<Position>) -> String {
    position.map_or_else(|| "position unknown".into(), |position| format!("at {position}"))
}
