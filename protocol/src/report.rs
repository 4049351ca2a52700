//! What a card tells about itself: the status word X1..X5 and the axis' state. Values only, no behaviour.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::{Deviation, Direction, Position, Steps, Tick, Ticks};

/// The sense points of \[F\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SensePoint {
    /// In the lower limit zone, 0 < e ≤ e1.
    X1,
    /// In the upper limit zone, e2 ≤ e < em.
    X2,
    /// At the reference step.
    X3,
    /// Motion complete. Open loop: the pulse train has ended. Closed loop: e = target.
    X4,
    /// Measured speed below S1; never claimed in open loop, which measures nothing.
    X5,
}

impl SensePoint {
    /// All five, in order.
    pub const ALL: [Self; 5] = [Self::X1, Self::X2, Self::X3, Self::X4, Self::X5];
}

/// X1..X5 as one byte: X1 is bit 0, X5 is bit 4. Prints as the papers write it, X1 first: `00010`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct StatusWord(u8);

impl StatusWord {
    /// The same with `point` set or cleared.
    #[must_use]
    pub const fn with(self, point: SensePoint, on: bool) -> Self {
        let bit = 1 << point as u8;
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    /// Whether `point` is on.
    #[must_use]
    pub const fn has(self, point: SensePoint) -> bool {
        self.0 & (1 << point as u8) != 0
    }

    /// Success of an open-loop movement, (X1..X4) = 0001.
    #[must_use]
    pub const fn is_open_loop_success(self) -> bool {
        self.0 & 0b01111 == 0b01000
    }

    /// Success of a closed-loop movement, (X1..X5) = 00011.
    #[must_use]
    pub const fn is_closed_loop_success(self) -> bool {
        self.0 & 0b11111 == 0b11000
    }
}

impl fmt::Display for StatusWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut digits = [b'0'; 5];
        for (digit, point) in digits.iter_mut().zip(SensePoint::ALL) {
            *digit += u8::from(self.has(point));
        }
        f.pad(std::str::from_utf8(&digits).unwrap_or("?????"))
    }
}

impl fmt::Debug for StatusWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "X{self}")
    }
}

/// What a card reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Report {
    /// A motor card.
    Axis(AxisReport),
    /// A digital card: its sixteen inputs or outputs, bit n is line n.
    Digital(u16),
}

/// The state of a motor card.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AxisReport {
    /// X1..X5.
    pub sense: StatusWord,
    /// Steps done in this movement, or in the last one if the axis stands still.
    pub steps: Steps,
    /// Where the card believes the axis to be; `None` until it has been originated.
    pub position: Option<Position>,
    /// What it is doing.
    pub activity: Activity,
    /// Why it does nothing more until it is cleared.
    pub alarm: Option<Alarm>,
    /// What the last origination found: by how much the axis stood off from where the card believed it to be. `None` if
    /// the card did not believe anything.
    pub lost: Option<Deviation>,
    /// How fast it goes; `None` if no pulse is to come.
    pub pace: Option<Pace>,
}

/// How fast an axis goes, and where to: the pulse period that is running.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Pace {
    /// From the last pulse to the next; never 0.
    pub period: Ticks,
    /// Where to.
    pub direction: Direction,
}

impl Pace {
    /// The speed in steps per second; towards the origin it is negative.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a pulse period is far below 2^53 ticks")]
    pub fn steps_per_second(self) -> f64 {
        let speed = Tick::PER_SECOND as f64 / self.period.0.max(1) as f64;
        match self.direction {
            Direction::Forward => speed,
            Direction::TowardsOrigin => -speed,
        }
    }
}

/// What an axis is doing. The order is on the wire: new ones come last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activity {
    /// No pulses; a movement may be commanded (unless an alarm holds the axis).
    Standing,
    /// A line is armed and waits for its start.
    Armed,
    /// Up the ramp.
    Accelerating,
    /// At one speed: the top of the ramp, a ceiling, or a constant-speed movement.
    Cruising,
    /// Down the ramp.
    Decelerating,
    /// The last steps at start speed, until the step counter has reached its count.
    Creeping,
    /// Down the steep ramp.
    Braking,
    /// Looking for the limit switch.
    Originating,
    /// Looking for the reference step.
    SeekingReference,
    /// The pulses are out; in closed loop, the shaft comes to rest and is looked at.
    Settling,
}

impl fmt::Display for Activity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Standing => "standing",
            Self::Armed => "armed",
            Self::Accelerating => "accelerating",
            Self::Cruising => "cruising",
            Self::Decelerating => "decelerating",
            Self::Creeping => "creeping",
            Self::Braking => "braking",
            Self::Originating => "originating",
            Self::SeekingReference => "seeking reference",
            Self::Settling => "settling",
        })
    }
}

/// One end of a rail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The end where the origin lies.
    Lower,
    /// The far end.
    Upper,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Lower => "lower",
            Self::Upper => "upper",
        })
    }
}

/// Why an axis is locked until it is cleared. The order is on the wire: new ones come last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Alarm {
    /// A Brake command.
    #[error("braked on command")]
    Braked,
    /// The end-of-rail emergency input.
    #[error("{0} end of the rail")]
    EndOfRail(End),
    /// The excessive-force emergency input.
    #[error("excessive force")]
    ExcessiveForce,
    /// Origination went as far as it may and the limit switch never closed.
    #[error("the limit switch did not close within {0} steps")]
    SwitchNeverClosed(Steps),
    /// Origination went as far as it may and the limit switch never opened.
    #[error("the limit switch did not open within {0} steps")]
    SwitchNeverOpened(Steps),
    /// The reference step was not found where it must be.
    #[error("the reference step was not found within {0} steps")]
    ReferenceNotFound(Steps),
    /// Nobody holds the other end of the card's lifeline any more.
    #[error("the CCU is gone")]
    CcuLost,
    /// Frames for this card were lost on the bus.
    #[error("{0} command frames were lost on the bus")]
    FramesLost(u32),
    /// In closed loop the encoder is too far from where the pulses should have brought the shaft.
    #[error("the shaft is {0} steps from where it should be")]
    FollowingError(Steps),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(points: &[SensePoint]) -> StatusWord {
        points.iter().fold(StatusWord::default(), |word, &point| word.with(point, true))
    }

    #[test]
    fn a_status_word_prints_x1_first() {
        assert_eq!(word(&[]).to_string(), "00000");
        assert_eq!(word(&[SensePoint::X1]).to_string(), "10000");
        assert_eq!(word(&[SensePoint::X4]).to_string(), "00010");
        assert_eq!(word(&[SensePoint::X2, SensePoint::X5]).to_string(), "01001");
        assert_eq!(word(&SensePoint::ALL).to_string(), "11111");
        assert_eq!(format!("{:?}", word(&[SensePoint::X3])), "X00100");
        assert_eq!(format!("{:>7}", word(&[SensePoint::X3])), "  00100");
    }

    #[test]
    fn success_is_0001_open_loop_and_00011_closed_loop() {
        for bits in 0..32_u8 {
            let points: Vec<_> =
                SensePoint::ALL.into_iter().filter(|&point| bits & (1 << point as u8) != 0).collect();
            let word = word(&points);
            let printed = word.to_string();
            assert_eq!(word.is_open_loop_success(), printed.starts_with("0001"), "{printed}");
            assert_eq!(word.is_closed_loop_success(), printed == "00011", "{printed}");
        }
    }

    #[test]
    fn a_sense_point_can_be_cleared_alone() {
        let word = word(&SensePoint::ALL).with(SensePoint::X2, false);
        assert!(!word.has(SensePoint::X2));
        assert_eq!(word.to_string(), "10111");
    }

    #[test]
    fn alarms_say_what_happened_in_figures() {
        assert_eq!(Alarm::EndOfRail(End::Upper).to_string(), "upper end of the rail");
        assert_eq!(
            Alarm::SwitchNeverClosed(Steps(60_000)).to_string(),
            "the limit switch did not close within 60000 steps"
        );
        assert_eq!(Alarm::FramesLost(3).to_string(), "3 command frames were lost on the bus");
    }
}
