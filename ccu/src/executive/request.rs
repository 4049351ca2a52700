//! What can be asked of a set, and what comes of it: plain data, the same for a live set behind its control socket and
//! for a dry run. Nothing is carried out in here.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use supersigma_protocol::{
    Address, Alarm, AxisNumber, AxisReport, CommandBytes, Deviation, Direction, Distance, Fault, Position,
    Refusal, StatusWord, Steps, Tick, Ticks,
};

use super::again::{Again, Shift};
use super::failure::Failure;

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
    /// Begin a movement; it is waited for with [`Request::Await`], by whoever began it.
    Begin {
        /// A movement or a search.
        request: Box<Request>,
    },
    /// Wait for what was begun.
    Await {
        /// Which.
        begun: Vec<Begun>,
        /// Until when.
        until: Until,
    },
    /// Halt what was begun and is not over, and forget it.
    Abandon,
    /// What tick is it?
    Now,
    /// Let machine time pass.
    Wait {
        /// How much.
        ticks: Ticks,
    },
    /// Recorded frames on the bus again.
    Replay {
        /// In the order in which they were sent.
        frames: Vec<Again>,
        /// Where the record's time lies; the first request of a replay leaves that open.
        shift: Option<Shift>,
        /// Alarms that the record has too.
        known: Vec<(AxisNumber, Alarm)>,
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

/// The number of something that was begun, on one connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Begun(pub u64);

/// How long what was begun is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Until {
    /// Only look, for a moment.
    Now,
    /// Until one is over.
    Any,
    /// Until all are over.
    All,
    /// Until all are over; as soon as one has failed, the others are halted.
    AllOrFailure,
}

/// Something that was begun and is over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// Which.
    pub begun: Begun,
    /// Its movements, or why they are not complete.
    pub result: Result<Vec<Movement>, Failure>,
}

/// One line of a path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Leg {
    /// How far each axis goes; an axis that is not named stands.
    pub parts: Vec<(AxisNumber, Displacement)>,
    /// The ceiling of the leading axis in steps per second.
    pub speed: Option<f64>,
}

/// What is left of a movement that was halted, or ended by an alarm.
#[derive(Debug, Clone, PartialEq)]
pub struct Remainder {
    /// What finishes it.
    pub request: Request,
    /// Where the axes stood then; if they stand elsewhere, it makes no sense any more.
    pub from: Vec<(AxisNumber, Option<Position>)>,
    /// An axis that has begun another movement since, so that it makes no sense even where the axis has come back.
    pub moved: Option<AxisNumber>,
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
    /// Recorded frames are on the bus again.
    Replayed {
        /// Where the record's time lies by now.
        shift: Shift,
    },
    /// The cards' answers to raw bytes.
    Answers(Vec<RawAnswer>),
    /// A movement has been begun.
    Begun(Begun),
    /// Those of the movements asked for that are over, in the order asked; they are forgotten.
    Ended(Vec<Ended>),
    /// The tick.
    Tick(Tick),
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
    /// When the card took the command (a line: when it started).
    pub start: Tick,
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
