//! Origination (\[C\]) and the search for the reference step (\[F\]): which stage comes next, and what it must find.
//! It moves nothing itself.
//!
//! ```text
//!   rail      ╟──── X1 = 1 ────┤────────┼─────────────────────
//!   approach                ◄──│────────────────────────────  backward and fast, until the limit switch closes
//!   overshoot            ◄─────│                              down the ramp
//!   back off             ──────│──►                           forward by the overshoot and a little more
//!   return                    ◄│────                          backward and slowly, until it closes again
//!   release                   ─►                              forward and slowly, until it opens: position 0
//!   lock in                    ──────────►                    forward and slowly, to the reference step (X3)
//! ```
//!
//! Whatever the speed of the approach, the point is found slowly and from one side. Whoever begins on the switch begins
//! with the release. Every stage is bounded in steps, so that a dead or stuck switch ends in an alarm and not at the stop.

use supersigma_config::{AxisConfig, RailConfig};
use supersigma_protocol::{Activity, Alarm, Direction, Distance, Position, SpeedIndex, Steps};

use crate::mechanism::Detectors;
use crate::ramp::{Plan, Table};

/// What is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// The point where the limit switch opens.
    Origin,
    /// The reference step.
    Reference,
}

/// One stage of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Backward, until the limit switch closes.
    Approach,
    /// Backward, down the ramp.
    Overshoot,
    /// Forward, by so many steps.
    BackOff(Steps),
    /// Backward, until the limit switch closes again.
    Return,
    /// Forward, until the limit switch opens.
    Release,
    /// Forward, to the reference step.
    LockIn,
}

/// What a detector's change means to a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// Nothing.
    Nothing,
    /// Slow down, then turn round.
    Switch,
    /// Stop here: this is what the stage looks for.
    Goal,
}

/// A search under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Search {
    pub(super) goal: Goal,
    pub(super) stage: Stage,
    /// Where the card believes to be, if it believed anything when the search began.
    pub(super) believed: Option<Position>,
    /// Steps of the movements before this one that belong to this stage: a rail may be longer than one movement.
    pub(super) of_stage: Steps,
}

impl Search {
    /// The search for `goal`, from where the detectors say this.
    pub(super) fn new(goal: Goal, detectors: Detectors, believed: Option<Position>) -> Self {
        let stage = if detectors.lower { Stage::Release } else { Stage::Approach };
        Self { goal, stage, believed, of_stage: Steps(0) }
    }

    /// How the status names it.
    pub(super) fn activity(&self) -> Activity {
        match self.goal {
            Goal::Origin => Activity::Originating,
            Goal::Reference => Activity::SeekingReference,
        }
    }

    /// What the detectors, just changed, mean to this stage.
    pub(super) fn judge(&self, detectors: Detectors) -> Found {
        match self.stage {
            Stage::Approach if detectors.lower => Found::Switch,
            Stage::Return if detectors.lower => Found::Goal,
            Stage::Release if !detectors.lower => Found::Goal,
            Stage::LockIn if detectors.reference => Found::Goal,
            _ => Found::Nothing,
        }
    }

    /// The alarm if the stage has made all its steps without finding what it looks for.
    pub(super) fn failure(&self) -> Alarm {
        match self.stage {
            Stage::Approach | Stage::Overshoot | Stage::Return => Alarm::SwitchNeverClosed(self.of_stage),
            Stage::BackOff(_) | Stage::Release => Alarm::SwitchNeverOpened(self.of_stage),
            Stage::LockIn => Alarm::ReferenceNotFound(self.of_stage),
        }
    }
}

/// How far the carriage backs off beyond the point at which the switch closed.
pub(super) const MARGIN: Steps = Steps(16);

/// The bounds of the stages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    speed: SpeedIndex,
    approach: Steps,
    release: Steps,
    lock_in: Steps,
}

impl Bounds {
    /// Of an axis: the whole rail for the approach, twice what is expected for the short stages.
    pub(super) fn new(axis: &AxisConfig) -> Self {
        let RailConfig { length, lower_zone, reference, .. } = axis.rail;
        let twice = |steps| steps + steps;
        Self {
            speed: axis.origination.speed,
            approach: length,
            release: twice(lower_zone),
            lock_in: twice(reference - lower_zone),
        }
    }

    /// The movement of `stage`, of which `made` steps have been made already; `None` if that is all it may make.
    pub(super) fn plan(&self, stage: Stage, made: Steps, table: &Table) -> Option<(Direction, Plan)> {
        let (direction, bound, speed) = match stage {
            Stage::Approach | Stage::Overshoot => (Direction::TowardsOrigin, self.approach, self.speed),
            Stage::BackOff(steps) => (Direction::Forward, steps, self.speed),
            Stage::Return => (Direction::TowardsOrigin, MARGIN + MARGIN, SpeedIndex::START),
            Stage::Release => (Direction::Forward, self.release, SpeedIndex::START),
            Stage::LockIn => (Direction::Forward, self.lock_in, SpeedIndex::START),
        };
        let left = bound.0.checked_sub(made.0)?.min(Distance::MAX.steps().0);
        let distance = Distance::new(u16::try_from(left).ok()?)?;
        Some((direction, Plan::ramped(table, distance, speed)))
    }
}
