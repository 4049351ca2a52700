//! What must hold before a movement begins, and the legs of a path that waits for its start.

use supersigma_config::TravelConfig;
use supersigma_protocol::{Direction, Distance, Refusal, SpeedIndex, Steps, Tick};

use super::{Firmware, State, ahead};
use crate::board::Board;
use crate::ramp::{Leg, Plan, Schedule, Share, Table};

/// What a `Lead` command said.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lead {
    pub(super) distance: Distance,
    pub(super) limit: SpeedIndex,
}

/// A path that waits for its start: what the leading axis makes of each leg, and what this one does.
#[derive(Debug, Default)]
pub(super) struct Armed {
    legs: Vec<Leg>,
    shares: Vec<Share>,
    pub(super) start: Option<Tick>,
}

/// How many legs a path may have.
const LEGS: usize = 32;

impl Armed {
    /// When each pulse is due.
    pub(super) fn schedule(&self, table: &Table) -> Schedule {
        let plan = match self.legs[..] {
            // A single line is a movement like any other, and made by the axis' method.
            [Leg { distance, limit, .. }] => Plan::ramped(table, distance, limit),
            _ => Plan::path(table, &self.legs),
        };
        Schedule::shared(plan, &self.shares)
    }
}

impl Firmware {
    pub(super) fn standing(&self) -> Result<(), Refusal> {
        match (&self.state, self.alarm) {
            (State::Standing, None) => Ok(()),
            (State::Standing, Some(_)) => Err(Refusal::InAlarm),
            _ => Err(Refusal::Moving),
        }
    }

    pub(super) fn ready_for(
        &self,
        direction: Direction,
        distance: Distance,
        board: &Board,
    ) -> Result<(), Refusal> {
        self.standing()?;
        self.within_travel(&[], direction, distance, board)
    }

    /// Whether the axis may go on by `distance` after `shares`.
    pub(super) fn within_travel(
        &self,
        shares: &[Share],
        direction: Direction,
        distance: Distance,
        board: &Board,
    ) -> Result<(), Refusal> {
        let base = self.base.ok_or(Refusal::NotOriginated)?;
        let mut moves = shares.iter().filter_map(|share| share.own);
        let end = ahead(direction);
        if board.detectors().zone() == Some(end) && moves.clone().next().is_none() {
            return Err(Refusal::AtEnd { end });
        }
        let from = moves.try_fold(base, |position, (direction, distance)| {
            Ok(position.moved(direction, distance.steps()))
        })?;
        let target = from.moved(direction, distance.steps());
        let TravelConfig { min, max } = self.travel;
        let leaves = match direction {
            Direction::Forward => target > max,
            Direction::TowardsOrigin => target < min,
        };
        if leaves { Err(Refusal::OutOfTravel { target, min, max }) } else { Ok(()) }
    }

    /// Whether a leg may be armed: standing free, or armed and not yet about to start.
    pub(super) fn armable(&self) -> Result<(), Refusal> {
        match &self.state {
            State::Armed(armed) if armed.start.is_none() => {
                if armed.legs.len() < LEGS {
                    Ok(())
                } else {
                    Err(Refusal::PathFull)
                }
            }
            _ => self.standing(),
        }
    }

    /// Takes the axis' own part of the leg whose leading axis is set; `None` means that it stands.
    pub(super) fn arm(&mut self, own: Option<(Direction, Distance)>, board: &Board) -> Result<(), Refusal> {
        self.armable()?;
        let lead = self.lead.ok_or(Refusal::NoLead)?;
        let armed = match &self.state {
            State::Armed(armed) => armed,
            _ => &Armed::default(),
        };
        if let Some((direction, distance)) = own {
            if distance > lead.distance {
                return Err(Refusal::LongerThanLead { steps: distance.get(), lead: lead.distance.get() });
            }
            self.within_travel(&armed.shares, direction, distance, board)?;
            let before: u32 =
                armed.shares.iter().filter_map(|share| share.own).map(|own| own.1.steps().0).sum();
            let total = before + distance.steps().0;
            if total > Distance::MAX.steps().0 {
                return Err(Refusal::PathTooLong { steps: total });
            }
        } else if self.base.is_none() {
            return Err(Refusal::NotOriginated);
        }
        if matches!(self.state, State::Standing) {
            self.steps = Steps(0);
            self.state = State::Armed(Armed::default());
        }
        if let State::Armed(armed) = &mut self.state {
            let Lead { distance, limit } = lead;
            armed.legs.push(Leg { distance, limit, joint: SpeedIndex::START });
            armed.shares.push(Share { lead: distance, own });
        }
        self.lead = None;
        Ok(())
    }

    /// Says how fast the joint after the last armed leg may be passed.
    pub(super) fn join(&mut self, limit: SpeedIndex) -> Result<(), Refusal> {
        match &mut self.state {
            State::Armed(Armed { legs, start: None, .. }) => {
                if let Some(last) = legs.last_mut() {
                    last.joint = limit;
                }
                Ok(())
            }
            State::Standing | State::Armed(_) => Err(Refusal::NotArmed),
            _ => Err(Refusal::Moving),
        }
    }

    pub(super) fn go(&mut self, at: Option<Tick>, alone: bool, board: &Board) -> Result<(), Refusal> {
        let State::Armed(Armed { start, .. }) = &mut self.state else {
            // Said to everyone, it concerns those that are armed.
            return if alone { Err(Refusal::NotArmed) } else { Ok(()) };
        };
        let at = at.ok_or(Refusal::NoStartTick)?;
        if at < board.now() {
            return Err(Refusal::Late { by: board.now().since(at) });
        }
        *start = Some(at);
        Ok(())
    }
}
