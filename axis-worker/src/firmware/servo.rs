//! Closed loop (\[F\]): what the encoder says of the shaft, and whether a movement has reached its target. It commands no
//! pulses itself.
//!
//! The motor is still driven by pulse trains; the encoder tells what became of them. A shaft that has slipped by a
//! few steps gets there with a few more pulses before the movement counts as complete; one that is too far off raises
//! an alarm, on the way or at the end.

use supersigma_config::{AxisConfig, Feedback};
use supersigma_protocol::{Direction, Distance, Position, Steps, Tick, Ticks};

use crate::board::Board;

/// How often the shaft is looked at on the way.
const ON_THE_WAY: Ticks = Ticks::from_millis(5);
/// How often it is looked at while it comes to rest.
const AT_THE_END: Ticks = Ticks::from_millis(1);
/// How long it may take to come to rest.
const PATIENCE: Ticks = Ticks::from_millis(2_000);
/// How often lost steps are made good within one movement.
const CORRECTIONS: u8 = 3;

/// The encoder's zero, and what may be tolerated.
#[derive(Debug)]
pub(super) struct Servo {
    limit: Steps,
    /// The encoder's reading at position 0; unknown before origination.
    zero: Option<i64>,
    /// Where the movement began, by the encoder.
    began: i64,
    looked: Tick,
    corrections: u8,
}

impl Servo {
    /// For an axis in closed loop.
    pub(super) fn new(axis: &AxisConfig) -> Option<Self> {
        let limit = axis.following.limit;
        let closed = axis.feedback == Feedback::Closed;
        closed.then_some(Self { limit, zero: None, began: 0, looked: Tick(0), corrections: 0 })
    }

    /// The position is unknown from now on.
    pub(super) fn forget(&mut self) {
        self.zero = None;
    }

    /// The axis is at position 0 now.
    pub(super) fn set_zero(&mut self, board: &mut Board) {
        self.zero = board.measure();
        self.began = self.zero.unwrap_or_default();
    }

    /// A movement begins at `base`.
    pub(super) fn begin(&mut self, base: Option<Position>, board: &Board) {
        self.began = self.zero.unwrap_or_default() + base.map_or(0, |base| i64::from(base.0));
        self.looked = board.now();
        self.corrections = 0;
    }

    /// When the shaft is looked at next on the way.
    pub(super) fn look_at(&self) -> Tick {
        self.looked + ON_THE_WAY
    }

    /// The steps that the shaft has made in this movement, and where it is; `None` before origination.
    pub(super) fn measured(&self, board: &mut Board) -> Option<(Steps, Position)> {
        let zero = self.zero?;
        let steps = board.measure()?;
        let made = u32::try_from(steps.abs_diff(self.began)).unwrap_or(u32::MAX);
        Some((Steps(made), Position(i32::try_from(steps - zero).ok()?)))
    }

    /// By how much the shaft is off, if that is too much; looks only when it is time.
    pub(super) fn error(&mut self, commanded: Position, board: &mut Board) -> Option<Steps> {
        if board.now() < self.look_at() {
            return None;
        }
        self.looked = board.now();
        let (_, position) = self.measured(board)?;
        Some(Steps(position.0.abs_diff(commanded.0))).filter(|error| *error > self.limit)
    }
}

/// A shaft that comes to rest at a target.
#[derive(Debug)]
pub(super) struct Settling {
    target: Position,
    since: Tick,
    looked: Tick,
}

/// What becomes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It still moves.
    Wait,
    /// It stands where it should.
    There,
    /// It stands elsewhere, and some more pulses bring it there.
    Correct(Direction, Distance),
    /// It stands elsewhere, and nothing helps.
    Off(Steps),
}

impl Settling {
    /// At `target`, from now on.
    pub(super) fn new(target: Position, now: Tick) -> Self {
        Self { target, since: now, looked: now }
    }

    /// When the shaft is looked at next.
    pub(super) fn look_at(&self) -> Tick {
        self.looked + AT_THE_END
    }

    /// Whether the shaft is at rest, or will not be in time; looks only when it is time.
    pub(super) fn is_over(&mut self, board: &Board) -> bool {
        let now = board.now();
        if now < self.look_at() {
            return false;
        }
        self.looked = now;
        board.mechanism().next_look(now).is_none() || now.since(self.since) >= PATIENCE
    }

    /// Looks at the shaft.
    pub(super) fn look(&mut self, servo: &mut Servo, board: &mut Board) -> Verdict {
        if !self.is_over(board) {
            return Verdict::Wait;
        }
        let Some((_, position)) = servo.measured(board) else { return Verdict::There };
        let off = Steps(position.0.abs_diff(self.target.0));
        let distance = u16::try_from(off.0).ok().and_then(Distance::new);
        match distance {
            None if off == Steps(0) => Verdict::There,
            Some(distance) if off <= servo.limit && servo.corrections < CORRECTIONS => {
                servo.corrections += 1;
                let direction =
                    if position < self.target { Direction::Forward } else { Direction::TowardsOrigin };
                Verdict::Correct(direction, distance)
            }
            _ => Verdict::Off(off),
        }
    }
}
