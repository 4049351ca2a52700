//! What the executive does about a movement that has failed, \[F\]: try again; if that does not help, find the reference
//! step anew and resume the program's step from there; if nothing succeeds, say what was tried and call the operator.
//!
//! Only what the machine can mend by itself is mended: a movement that is overdue, and a shaft that did not follow its
//! pulses. Force, the end of a rail or a commanded brake are for people to look at.

use std::collections::BTreeMap;

use supersigma_protocol::{Alarm, AxisNumber, Command, Operation, Position, Steps};

use super::Executive;
use super::failure::Failure;
use super::link::Link;
use super::request::{Displacement, Leg, Movement, MovementKind, Outcome, Recovery, Request};

/// A movement that has failed, and where its axes should be by now.
struct Step {
    kind: MovementKind,
    speed: Option<f64>,
    asked: BTreeMap<AxisNumber, Displacement>,
    targets: BTreeMap<AxisNumber, Position>,
}

impl<L: Link> Executive<L> {
    /// Mends what can be mended; otherwise the failure stays what it is.
    pub(super) fn recover(&mut self, request: &Request, failure: Failure) -> Result<Outcome, Failure> {
        let (Some(axis), Some((kind, leg))) = (mendable(&failure), one_step(request)) else {
            return Err(failure);
        };
        if !self.link.knowledge().config.executive.recover {
            return Err(failure);
        }
        let Some(step) = self.step(kind, &leg)? else { return Err(failure) };
        let mut reason = failure;
        for how in [Recovery::TriedAgain, Recovery::SoughtReference] {
            match self.attempt(how, axis, &step) {
                Ok(movements) => return Ok(Outcome::Moved(movements)),
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                Err(failure @ (Failure::BusGone { .. } | Failure::GoingDown | Failure::NoLog(_))) => {
                    return Err(failure);
                }
                Err(failure) => reason = failure,
            }
        }
        let tried = format!("{}, and {}", Recovery::TriedAgain, Recovery::SoughtReference);
        Err(Failure::GaveUp { axis, reason: reason.told(self.link.knowledge()), tried })
    }

    /// Brings all axes of the movement to a stand, and finds out where they should have gone.
    fn step(&mut self, kind: MovementKind, leg: &Leg) -> Result<Option<Step>, Failure> {
        let (mut asked, mut targets) = (BTreeMap::new(), BTreeMap::new());
        for (axis, by) in leg.parts.iter().filter(|(_, by)| by.0 != 0) {
            self.link.send(Command::new(axis.address(), Operation::Halt).into())?;
            let report = self.stand(*axis)?;
            let Some(Position(position)) = report.position else { return Ok(None) };
            let made = i64::from(report.steps.0) * by.0.signum();
            let target = i64::from(position) - made + by.0;
            let Ok(target) = i32::try_from(target) else { return Ok(None) };
            asked.insert(*axis, *by);
            targets.insert(*axis, Position(target));
        }
        Ok(Some(Step { kind, speed: leg.speed, asked, targets }))
    }

    fn attempt(&mut self, how: Recovery, axis: AxisNumber, step: &Step) -> Result<Vec<Movement>, Failure> {
        for other in step.targets.keys() {
            self.stand(*other)?;
            self.command(*other, Operation::Clear)?;
        }
        let began = self.link.now();
        if how == Recovery::SoughtReference {
            let search = self.search(&[axis], Operation::SeekReference, MovementKind::Reference)?;
            self.complete(search)?;
        }
        let mut parts = Vec::with_capacity(step.targets.len());
        for (axis, target) in &step.targets {
            let report = self.stand(*axis)?;
            let position = report.position.ok_or(Failure::Stopped {
                axis: *axis,
                done: report.steps,
                position: None,
                at: Some(self.link.now()),
            })?;
            let left = i64::from(target.deviation_from(position).0);
            if left != 0 {
                parts.push((*axis, Displacement(left)));
            }
        }
        if !parts.is_empty() {
            let rest = self.path(&[Leg { parts, speed: step.speed }], step.kind)?;
            self.complete(rest)?;
        }
        let mut movements = Vec::with_capacity(step.targets.len());
        for (axis, target) in &step.targets {
            let report = self.stand(*axis)?;
            if report.position != Some(*target) {
                return Err(Failure::Stopped {
                    axis: *axis,
                    done: report.steps,
                    position: report.position,
                    at: Some(self.link.now()),
                });
            }
            let asked = step.asked.get(axis).copied();
            movements.push(Movement {
                axis: *axis,
                kind: step.kind,
                asked,
                done: asked
                    .map_or(report.steps, |by| Steps(u32::try_from(by.0.unsigned_abs()).unwrap_or(u32::MAX))),
                sense: report.sense,
                took: self.link.now().since(began),
                position: report.position,
                lost: None,
                start: began,
                recovered: Some(how),
            });
        }
        Ok(movements)
    }
}

/// The axis of a failure that can be mended without people.
fn mendable(failure: &Failure) -> Option<AxisNumber> {
    match failure {
        Failure::Overdue { axis, .. } | Failure::Alarm { axis, alarm: Alarm::FollowingError(_), .. } => {
            Some(*axis)
        }
        _ => None,
    }
}

/// The movement that a request asks for, if it is a single one that somebody waits for.
fn one_step(request: &Request) -> Option<(MovementKind, Leg)> {
    match request {
        Request::Move { axis, by, speed, constant: false, wait: true } => {
            Some((MovementKind::Move, Leg { parts: vec![(*axis, *by)], speed: *speed }))
        }
        Request::Line { parts, speed, wait: true } => {
            Some((MovementKind::Line, Leg { parts: parts.clone(), speed: *speed }))
        }
        _ => None,
    }
}
