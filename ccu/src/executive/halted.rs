//! What becomes of a movement that somebody halts: its rest is known, kept, and made when somebody resumes it. A program
//! waits for that; a single command ends, and leaves its rest behind. So does one that an alarm has ended and that could go
//! on: when the alarm has been cleared.

use std::collections::BTreeMap;
use std::time::Duration;

use supersigma_protocol::{
    Activity, Alarm, Answer, AxisNumber, AxisReport, Broadcast, Command, Operation, Report, Steps,
};

use super::failure::Failure;
use super::link::{Heard, Link};
use super::request::{AxisState, Displacement, Leg, Movement, Outcome, Remainder, Request};
use super::{Executive, Operate};

/// A program that waits to be resumed sleeps for so long at a time.
const NAP: Duration = Duration::from_secs(3_600);
/// Whoever waits for an axis to stand looks at least so often; its end is told unasked.
const LOOK: Duration = Duration::from_millis(100);

impl<L: Link> Executive<L> {
    /// Carries out a request of a program: if it is halted, waits until it is resumed, and makes the rest.
    ///
    /// # Errors
    /// As [`Operate::operate`]; a halt alone is none.
    pub fn operate_or_wait(&mut self, request: Request) -> Result<Outcome, Failure> {
        let result = match request {
            Request::Await { begun, until } => {
                self.heard.clear();
                self.await_begun(&begun, until, true)
            }
            request => self.see_through(request),
        };
        self.paused = None;
        if result == Err(Failure::Cancelled) {
            self.abandon();
        }
        result
    }

    fn see_through(&mut self, request: Request) -> Result<Outcome, Failure> {
        let asked = request.moving();
        let axes: Vec<_> = asked.keys().copied().collect();
        let mut made: BTreeMap<AxisNumber, Steps> = BTreeMap::new();
        let mut result = self.operate(request);
        while let Err(Failure::Stopped { .. }) = result {
            let Some(rest) = self.link.common().take_left_of(&axes) else { break };
            for axis in &axes {
                let so_far = made.entry(*axis).or_default();
                *so_far = *so_far + self.stand(*axis)?.steps;
            }
            self.wait_for_resume()?;
            self.check_places(&rest)?;
            result = self.operate(rest.request);
        }
        match result? {
            Outcome::Moved(movements) => {
                Ok(Outcome::Moved(movements.into_iter().map(|rest| whole(rest, &asked, &made)).collect()))
            }
            other => Ok(other),
        }
    }

    /// Makes the rest of what was halted, and lets the programs that wait go on.
    pub(super) fn resume(&mut self) -> Result<Outcome, Failure> {
        let (remainders, paused) = self.link.common().take();
        if remainders.is_empty() && paused == 0 {
            return Err(Failure::NothingToResume);
        }
        self.link.tell_resume();
        let mut movements = Vec::new();
        let mut remainders = remainders.into_iter();
        while let Some(rest) = remainders.next() {
            let result = self.check_places(&rest).and_then(|()| self.operate(rest.request.clone()));
            match result {
                Ok(Outcome::Moved(moved)) => movements.extend(moved),
                Ok(_) => {}
                Err(failure) => {
                    let nothing_moved = matches!(failure, Failure::Refused { .. } | Failure::NoLog(_));
                    let this = nothing_moved.then_some(rest);
                    this.into_iter().chain(remainders).for_each(|rest| self.link.common().leave(rest));
                    return Err(failure);
                }
            }
        }
        Ok(Outcome::Moved(movements))
    }

    /// Acknowledges alarms. What they have ended while nobody waited for it is known from now on.
    pub(super) fn clear(&mut self, axes: &[AxisNumber]) -> Result<Outcome, Failure> {
        if let Outcome::Axes(states) = self.tell(axes, Operation::Status)? {
            let in_alarm = |state: &AxisState| state.report.and_then(|report| report.alarm);
            let can_go_on = |state: &&AxisState| in_alarm(state).is_some_and(can_go_on_after);
            let ended: Vec<_> = states.iter().filter(can_go_on).map(|state| state.axis).collect();
            for request in self.link.common().take_unwatched(&ended) {
                self.leave_rest(&request)?;
            }
        }
        self.tell(axes, Operation::Clear)
    }

    /// Stops axes, and whoever moves on a line with them: those at one tick, so that they stay on it. Returns when all stand.
    pub(super) fn stop(&mut self, axes: &[AxisNumber], operation: Operation) -> Result<Outcome, Failure> {
        let knowledge = self.link.knowledge();
        let named = knowledge.axes(axes)?;
        let lead = Duration::from_millis(knowledge.config.line.lead_ms.into());
        let at = self.link.now() + self.link.ticks(lead / 2);
        let common = self.link.common();
        let (mut told, mut gone) = (Vec::new(), Vec::new());
        for line in named.into_iter().map(|axis| self.moving_together(axis)).collect::<Vec<_>>() {
            let alone = line.len() == 1;
            for axis in line {
                if told.contains(&axis) {
                    continue;
                }
                told.push(axis);
                let command = Command::new(axis.address(), operation);
                match self.link.send(Broadcast { at: (!alone).then_some(at), ..command.into() }) {
                    Ok(_) => {}
                    Err(Failure::WorkerGone { .. }) => gone.push(axis),
                    Err(failure) => return Err(failure),
                }
            }
        }
        self.give_up(&told);
        let mut states = Vec::with_capacity(told.len());
        for axis in told {
            let report = if gone.contains(&axis) { None } else { Some(self.stand(axis)?) };
            states.push(AxisState { axis, report });
        }
        let stopped: Vec<_> =
            states.iter().filter(|state| state.report.is_some()).map(|state| state.axis).collect();
        for request in common.take_unwatched(&stopped) {
            self.leave_rest(&request)?;
        }
        Ok(Outcome::Axes(states))
    }

    /// The axes that move on a line with `axis`, this one among them. A line that has ended holds nobody together.
    fn moving_together(&self, axis: AxisNumber) -> Vec<AxisNumber> {
        let line = self.link.common().line_of(axis);
        let moves = |axis: &AxisNumber| {
            self.link.activity(*axis).is_some_and(|activity| activity != Activity::Standing)
        };
        if line.iter().any(moves) { line } else { vec![axis] }
    }

    /// Keeps what is left of a movement that has been halted, if anything is.
    pub(super) fn leave_rest(&mut self, request: &Request) -> Result<(), Failure> {
        let (mut from, mut done) = (Vec::new(), BTreeMap::new());
        for axis in request.moving().into_keys() {
            let report = self.stand(axis)?;
            from.push((axis, report.position));
            done.insert(axis, report.steps);
        }
        let legs = |legs: &[Leg]| remaining(legs, done.clone());
        let request = match request {
            Request::Move { axis, by, speed, constant, .. } => {
                let whole = Leg { parts: vec![(*axis, *by)], speed: *speed };
                let Some(by) = legs(&[whole]).pop().and_then(|leg| Some(leg.parts.first()?.1)) else {
                    return Ok(());
                };
                Request::Move { axis: *axis, by, speed: *speed, constant: *constant, wait: true }
            }
            Request::Line { parts, speed, .. } => {
                let whole = Leg { parts: parts.clone(), speed: *speed };
                let Some(Leg { parts, speed }) = legs(&[whole]).pop() else { return Ok(()) };
                Request::Line { parts, speed, wait: true }
            }
            Request::Path { legs: all, .. } => match legs(all) {
                nothing if nothing.is_empty() => return Ok(()),
                rest => Request::Path { legs: rest, wait: true },
            },
            _ => return Ok(()),
        };
        self.link.common().leave(Remainder { request, from, moved: None });
        Ok(())
    }

    /// Waits until an axis stands.
    pub(super) fn stand(&mut self, axis: AxisNumber) -> Result<AxisReport, Failure> {
        loop {
            let answer = self.command(axis, Operation::Status)?;
            if let Some(report) = standing(axis, &answer) {
                return Ok(report);
            }
            let until = self.link.now() + self.link.ticks(LOOK);
            while let Some(heard) = self.listen(until)? {
                if let Heard::Answer(answer) = heard
                    && let Some(report) = standing(axis, &answer)
                {
                    return Ok(report);
                }
            }
        }
    }

    fn wait_for_resume(&mut self) -> Result<(), Failure> {
        let _paused = self.link.common().pause();
        loop {
            let until = self.link.now() + self.link.ticks(NAP);
            match self.listen(until)? {
                Some(Heard::Resume) => return Ok(()),
                Some(Heard::GoingDown) => return Err(Failure::GoingDown),
                Some(Heard::NoLog(trouble)) => return Err(Failure::NoLog((*trouble).clone())),
                _ => {}
            }
        }
    }

    pub(super) fn check_places(&mut self, rest: &Remainder) -> Result<(), Failure> {
        if let Some(axis) = rest.moved {
            return Err(Failure::MovedMeanwhile { axis });
        }
        for (axis, position) in &rest.from {
            if self.stand(*axis)?.position != *position {
                return Err(Failure::MovedMeanwhile { axis: *axis });
            }
        }
        Ok(())
    }
}

/// Whether the steps that an alarm has cut off may still be made: nothing has been lost, and nothing stands in their way that
/// the operator could not have removed.
pub(super) fn can_go_on_after(alarm: Alarm) -> bool {
    matches!(alarm, Alarm::ExcessiveForce | Alarm::Braked)
}

/// What an answer says of an axis, if it is this one and stands.
fn standing(axis: AxisNumber, answer: &Answer) -> Option<AxisReport> {
    match answer.report {
        Report::Axis(report) if answer.card == axis.address() && report.activity == Activity::Standing => {
            Some(report)
        }
        _ => None,
    }
}

/// The legs without what has been made of them.
fn remaining(legs: &[Leg], mut done: BTreeMap<AxisNumber, Steps>) -> Vec<Leg> {
    let mut left_of = |axis: AxisNumber, by: Displacement| {
        let done = done.entry(axis).or_default();
        let made = u32::try_from(by.0.unsigned_abs()).unwrap_or(u32::MAX).min(done.0);
        *done = *done - Steps(made);
        (axis, Displacement(by.0 - i64::from(made) * by.0.signum()))
    };
    let rest = legs.iter().map(|leg| Leg {
        parts: leg.parts.iter().map(|(axis, by)| left_of(*axis, *by)).collect(),
        speed: leg.speed,
    });
    rest.filter(|leg| leg.parts.iter().any(|(_, by)| by.0 != 0)).collect()
}

/// A movement together with what was made of it before it was halted.
pub(super) fn whole(
    rest: Movement,
    asked: &BTreeMap<AxisNumber, Displacement>,
    made: &BTreeMap<AxisNumber, Steps>,
) -> Movement {
    let before = made.get(&rest.axis).copied().unwrap_or_default();
    Movement { asked: asked.get(&rest.axis).copied().or(rest.asked), done: rest.done + before, ..rest }
}
