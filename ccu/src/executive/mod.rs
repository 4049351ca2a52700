//! The executive of \[F\]: sense, control, wait. It turns a [`Request`] into commands on the bus, knows from the plan
//! when each movement is due, and judges by the sense points whether it has come true. It moves nothing itself and
//! reads no clock but its [`Link`]'s; a live set and a dry run are driven by this very code.

pub mod advice;
mod failure;
mod halted;
mod link;
mod path;
mod recovery;
mod request;
#[cfg(test)]
mod tests;

use std::time::Duration;

use axis_worker::ramp::Plan;
use supersigma_protocol::{
    About, Activity, Address, Answer, AxisNumber, AxisReport, Broadcast, CardKind, Command, CommandBytes,
    Fault, Operation, Refusal, Report, Sequence, SpeedIndex, Tick, Ticks,
};

pub use failure::{Failure, LogTrouble};
pub use link::{Common, Heard, Knowledge, Link};
pub use request::{
    AxisState, Displacement, Leg, Movement, MovementKind, Outcome, RawAnswer, Recovery, Remainder, Request,
};

/// Somebody who carries out requests: an executive, or a client of one.
pub trait Operate {
    /// Carries out one request, and returns when it is done.
    ///
    /// # Errors
    /// Why it could not be done.
    fn operate(&mut self, request: Request) -> Result<Outcome, Failure>;
}

/// Sense, control, wait, over one link.
#[derive(Debug)]
pub struct Executive<L> {
    link: L,
    /// What was heard while waiting for something else.
    heard: Vec<Heard>,
}

/// How many times the sense points are looked at between the due time of a movement and the time at which it is overdue.
const LOOKS: u64 = 8;

/// A movement that has been commanded.
#[derive(Debug, Clone, Copy)]
struct Underway {
    axis: AxisNumber,
    kind: MovementKind,
    asked: Option<Displacement>,
    /// Pulses that make it complete, if that can be known.
    steps: Option<u64>,
    /// When the card consented: what it says of a time before is not about this movement.
    since: Tick,
    start: Tick,
    due: Tick,
}

impl<L: Link> Operate for Executive<L> {
    fn operate(&mut self, request: Request) -> Result<Outcome, Failure> {
        self.heard.clear();
        let result = self.carry_out(&request).or_else(|failure| self.recover(&request, failure));
        match &result {
            Err(Failure::Stopped { .. }) => self.leave_rest(&request)?,
            Ok(_) if request.is_unwatched() => self.link.common().leave_unwatched(request),
            _ => {}
        }
        result
    }
}

impl<L: Link> Executive<L> {
    /// An executive over `link`.
    pub fn new(link: L) -> Self {
        Self { link, heard: Vec::new() }
    }

    fn carry_out(&mut self, request: &Request) -> Result<Outcome, Failure> {
        match request {
            Request::Originate { axes } => {
                let axes = self.link.knowledge().axes(axes)?;
                self.search(&axes, Operation::Originate, MovementKind::Origin)
            }
            Request::SeekReference { axis } => {
                self.search(&[*axis], Operation::SeekReference, MovementKind::Reference)
            }
            Request::Move { axis, by, speed, constant, wait } => {
                self.movement(*axis, *by, *speed, *constant, *wait)
            }
            Request::Line { parts, speed, wait } => {
                let leg = Leg { parts: parts.clone(), speed: *speed };
                self.path(&[leg], MovementKind::Line, *wait)
            }
            Request::Path { legs, wait } => self.path(legs, MovementKind::Path, *wait),
            Request::Resume => self.resume(),
            Request::Halt { axes } => self.stop(axes, Operation::Halt),
            Request::Brake { axes } => self.stop(axes, Operation::Brake),
            Request::Clear { axes } => self.tell(axes, Operation::Clear),
            Request::Status { axes } => self.tell(axes, Operation::Status),
            Request::Output { bit, on } => self.output(*bit, *on),
            Request::Digital { card } => self.digital(*card, Operation::Status).map(Outcome::Digital),
            Request::Inject { axis, fault } => self.inject(*axis, *fault),
            Request::Wait { ticks } => self.wait(*ticks),
            Request::Send { bytes } => self.raw(bytes.clone()),
        }
    }

    /// Its link.
    pub fn link(&self) -> &L {
        &self.link
    }

    /// Its link, for tests that make trouble on it.
    #[cfg(test)]
    pub(crate) fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// Its link, back.
    pub fn into_link(self) -> L {
        self.link
    }

    fn movement(
        &mut self,
        axis: AxisNumber,
        by: Displacement,
        speed: Option<f64>,
        constant: bool,
        wait: bool,
    ) -> Result<Outcome, Failure> {
        let limit = speed.map(|speed| self.link.knowledge().speed(axis, speed)).transpose()?;
        let Some((direction, distance)) = by.split()? else {
            self.link.knowledge().table(axis)?;
            return Ok(Outcome::Moved(vec![]));
        };
        let kind = if constant { MovementKind::Slew } else { MovementKind::Move };
        let operation = match (limit, constant) {
            (None, false) => Operation::Move { direction, distance },
            (Some(limit), false) => Operation::MoveLimited { direction, distance, limit },
            (speed, true) => {
                Operation::Slew { direction, distance, speed: speed.unwrap_or(SpeedIndex::START) }
            }
        };
        let table = self.link.knowledge().table(axis)?;
        let plan = match operation {
            Operation::Slew { speed, .. } => Plan::constant(table, distance, speed),
            _ => Plan::ramped(table, distance, limit.unwrap_or(SpeedIndex::TOP)),
        };
        let answer = self.command(axis, operation)?;
        self.link.common().begin(&[axis]);
        if !wait {
            return Ok(Outcome::Done);
        }
        let start = answer.acted_at;
        let due = start + Ticks(plan.duration());
        self.complete(&[Underway {
            axis,
            kind,
            asked: Some(by),
            steps: Some(by.0.unsigned_abs()),
            since: start,
            start,
            due,
        }])
    }

    /// Origination or search for the reference step, of several axes at once.
    fn search(
        &mut self,
        axes: &[AxisNumber],
        operation: Operation,
        kind: MovementKind,
    ) -> Result<Outcome, Failure> {
        let mut underway = Vec::with_capacity(axes.len());
        for axis in axes {
            let knowledge = self.link.knowledge();
            let table = knowledge.table(*axis)?;
            let Some(config) = knowledge.config.axis(*axis) else {
                return Err(Failure::NoSuchAxis { axis: *axis });
            };
            // Nobody knows how long a search takes; it is bounded by its steps: the whole rail at the ceiling of the
            // approach, and the short legs, which may be twice as long as expected, at start speed.
            let rail = &config.rail;
            let approach = u64::from(rail.length.0) * u64::from(table.period(config.origination.speed));
            let slow = 2
                * u64::from((rail.lower_zone + rail.reference).0)
                * u64::from(table.period(SpeedIndex::START));
            let ramps = 2 * table.interval().0 * u64::from(SpeedIndex::TOP.get());
            let start = match self.command(*axis, operation) {
                Ok(answer) => {
                    self.link.common().begin(&[*axis]);
                    answer.acted_at
                }
                Err(failure) => {
                    self.halt(&underway)?;
                    return Err(failure);
                }
            };
            let due = start + Ticks(approach + slow + ramps);
            underway.push(Underway { axis: *axis, kind, asked: None, steps: None, since: start, start, due });
        }
        self.complete(&underway)
    }

    fn halt(&mut self, underway: &[Underway]) -> Result<(), Failure> {
        for underway in underway {
            self.link.send(Command::new(underway.axis.address(), Operation::Halt).into())?;
        }
        Ok(())
    }

    /// Waits until all of these movements are over, and judges them.
    fn complete(&mut self, underway: &[Underway]) -> Result<Outcome, Failure> {
        let result = self.watch(underway);
        match &result {
            // Whoever halts one axis of a line without the others would have these run on alone.
            Err(Failure::Cancelled | Failure::Stopped { .. }) => self.halt(underway)?,
            // One axis of a line that stops by itself has left it; the others must not run on alone.
            Err(_)
                if underway.len() > 1
                    && underway
                        .iter()
                        .all(|one| matches!(one.kind, MovementKind::Line | MovementKind::Path)) =>
            {
                for other in underway {
                    self.link.send(Command::new(other.axis.address(), Operation::Brake).into())?;
                }
            }
            _ => {}
        }
        result
    }

    fn watch(&mut self, underway: &[Underway]) -> Result<Outcome, Failure> {
        let margin_ms = self.link.knowledge().config.executive.overdue_ms;
        let margin = self.link.ticks(Duration::from_millis(margin_ms.into()));
        let margin_part = Ticks(margin.0 / LOOKS);
        let mut over: Vec<Option<Movement>> = vec![None; underway.len()];
        loop {
            let waiting = underway.iter().zip(&over).filter(|(_, over)| over.is_none());
            let Some((next, deadline)) =
                waiting.map(|(one, _)| (*one, one.due + margin)).min_by_key(|(_, deadline)| *deadline)
            else {
                return Ok(Outcome::Moved(over.into_iter().flatten().collect()));
            };
            // Its end is told unasked. Once it is due, the sense points are looked at too, in equal parts of the margin.
            let look = self.link.now().max(next.due) + margin_part;
            let Some(heard) = self.hear(look.min(deadline))? else {
                // It may have ended and the news got lost: ask.
                let overdue = self.link.now() >= deadline;
                let answer = match self.command(next.axis, Operation::Status) {
                    Ok(answer) => answer,
                    Err(Failure::NoAnswer { .. }) if !overdue => continue,
                    Err(failure) => return Err(failure),
                };
                if let Report::Axis(report) = answer.report
                    && report.activity != Activity::Standing
                {
                    if !overdue {
                        continue;
                    }
                    return Err(Failure::Overdue {
                        axis: next.axis,
                        milliseconds: margin_ms,
                        done: report.steps,
                        at: Some(answer.acted_at),
                    });
                }
                self.heard.push(Heard::Answer(answer));
                continue;
            };
            let Heard::Answer(Answer { card, report: Report::Axis(report), acted_at, .. }) = heard else {
                bad_news(heard, underway)?;
                continue;
            };
            for (one, over) in underway.iter().zip(&mut over) {
                if over.is_none() && one.axis.address() == card && acted_at > one.since {
                    *over = judge(one, &report, acted_at)?;
                }
            }
        }
    }

    /// The same command to several axes; all are told before any answer is waited for.
    fn tell(&mut self, axes: &[AxisNumber], operation: Operation) -> Result<Outcome, Failure> {
        let axes = self.link.knowledge().axes(axes)?;
        let mut sent = Vec::with_capacity(axes.len());
        for axis in &axes {
            sent.push((*axis, self.link.send(Command::new(axis.address(), operation).into())));
        }
        let mut states = Vec::with_capacity(axes.len());
        for (axis, sequence) in sent {
            let report = match sequence {
                Ok(sequence) => {
                    let answer = self.answer(axis.address(), sequence)?;
                    refused(axis, &answer)?;
                    axis_report(&answer)
                }
                Err(Failure::WorkerGone { .. }) => None,
                Err(failure) => return Err(failure),
            };
            states.push(AxisState { axis, report });
        }
        Ok(Outcome::Axes(states))
    }

    fn output(&mut self, bit: u8, on: bool) -> Result<Outcome, Failure> {
        let word = self.digital(Address::DIGITAL_OUTPUT, Operation::Status)?;
        let mask = 1_u16.checked_shl(bit.into()).unwrap_or(0);
        let word = if on { word | mask } else { word & !mask };
        self.digital(Address::DIGITAL_OUTPUT, Operation::WriteOutputs { word }).map(Outcome::Digital)
    }

    fn digital(&mut self, card: Address, operation: Operation) -> Result<u16, Failure> {
        let sequence = self.link.send(Command::new(card, operation).into())?;
        let answer = self.answer(card, sequence)?;
        match (answer.about, answer.report) {
            (About::Command(_, Err(refusal)), _) => Err(Failure::DigitalRefused { card, refusal }),
            (_, Report::Digital(word)) => Ok(word),
            (_, Report::Axis(_)) => Err(Failure::BusGone { reason: format!("{card} answers like an axis") }),
        }
    }

    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Outcome, Failure> {
        self.link.knowledge().table(axis)?;
        let sequence = self.link.inject(axis, fault)?;
        let answer = self.answer(axis.address(), sequence)?;
        Ok(Outcome::Axes(vec![AxisState { axis, report: axis_report(&answer) }]))
    }

    fn wait(&mut self, ticks: Ticks) -> Result<Outcome, Failure> {
        let until = self.link.now() + ticks;
        while let Some(heard) = self.hear(until)? {
            if heard == Heard::GoingDown {
                return Err(Failure::GoingDown);
            }
        }
        Ok(Outcome::Done)
    }

    /// Raw bytes, and what every card that they are for says to them.
    fn raw(&mut self, bytes: CommandBytes) -> Result<Outcome, Failure> {
        let knowledge = self.link.knowledge();
        let address = bytes.as_slice().first().copied().map(Address);
        let concerned = match address.map(Address::kind) {
            Some(CardKind::Everyone) => knowledge.axes(&[])?.len(),
            Some(CardKind::Axis(axis)) => usize::from(knowledge.table(axis).is_ok()),
            Some(CardKind::DigitalInput | CardKind::DigitalOutput) => 1,
            Some(CardKind::Unknown(_)) | None => 0,
        };
        let unheard = match address {
            Some(Address(address)) => Refusal::UnknownAddress { address },
            None => Refusal::TooShort { bytes: 0 },
        };
        let sequence = self.link.send(Broadcast { bytes, at: None })?;
        if concerned == 0 {
            return Ok(Outcome::Answers(vec![RawAnswer { card: None, result: Err(unheard), report: None }]));
        }
        let mut answers = Vec::with_capacity(concerned);
        let deadline = self.link.now() + self.link.ticks(self.patience());
        while answers.len() < concerned {
            let Some(answer) = self.answer_to(sequence, &[], deadline)? else { break };
            let result = match answer.about {
                About::Command(_, result) => result,
                About::Unasked(_) => Ok(()),
            };
            answers.push(RawAnswer { card: Some(answer.card), result, report: Some(answer.report) });
        }
        match (answers.is_empty(), address) {
            (true, Some(card)) => Err(self.no_answer(card)),
            _ => Ok(Outcome::Answers(answers)),
        }
    }

    /// Commands one axis and waits for its consent. If whoever asked goes away meanwhile, what the axis has consented to is
    /// halted.
    fn command(&mut self, axis: AxisNumber, operation: Operation) -> Result<Answer, Failure> {
        self.link.knowledge().table(axis)?;
        let sequence = self.link.send(Command::new(axis.address(), operation).into())?;
        let answer = match self.answer(axis.address(), sequence) {
            Err(Failure::Cancelled) if operation.sets_going() => {
                let answer = self.answer(axis.address(), sequence)?;
                if refused(axis, &answer).is_ok() {
                    self.link.send(Command::new(axis.address(), Operation::Halt).into())?;
                }
                return Err(Failure::Cancelled);
            }
            answer => answer?,
        };
        refused(axis, &answer)?;
        Ok(answer)
    }

    fn answer(&mut self, card: Address, sequence: Sequence) -> Result<Answer, Failure> {
        let deadline = self.link.now() + self.link.ticks(self.patience());
        self.answer_to(sequence, &[card], deadline)?.ok_or_else(|| self.no_answer(card))
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(self.link.knowledge().config.executive.answer_ms.into())
    }

    fn no_answer(&self, card: Address) -> Failure {
        Failure::NoAnswer { card, milliseconds: self.link.knowledge().config.executive.answer_ms }
    }

    /// The next answer to the command with this number. Whatever else is heard is kept for later.
    /// If one of `from` dies meanwhile, there will be none.
    fn answer_to(
        &mut self,
        sequence: Sequence,
        from: &[Address],
        until: Tick,
    ) -> Result<Option<Answer>, Failure> {
        let wanted = |heard: &Heard| matches!(heard, Heard::Answer(answer) if matches!(answer.about, About::Command(to, _) if to == sequence));
        if let Some(index) = self.heard.iter().position(wanted)
            && let Heard::Answer(answer) = self.heard.remove(index)
        {
            return Ok(Some(answer));
        }
        while let Some(heard) = self.link.hear(until)? {
            match heard {
                Heard::Answer(answer) if wanted(&heard) => return Ok(Some(answer)),
                Heard::GoingDown => return Err(Failure::GoingDown),
                Heard::WorkerGone(card) if from.contains(&card) => return Err(Failure::WorkerGone { card }),
                other => self.heard.push(other),
            }
        }
        Ok(None)
    }

    /// The next thing heard, first of what was kept.
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        if self.heard.is_empty() { self.link.hear(until) } else { Ok(Some(self.heard.remove(0))) }
    }
}

fn axis_report(answer: &Answer) -> Option<AxisReport> {
    match answer.report {
        Report::Axis(report) => Some(report),
        Report::Digital(_) => None,
    }
}

fn refused(axis: AxisNumber, answer: &Answer) -> Result<(), Failure> {
    match answer.about {
        About::Command(_, Err(refusal)) => Err(Failure::Refused { axis, refusal, at: Some(answer.acted_at) }),
        _ => Ok(()),
    }
}

/// What an axis' report means to its movement: under way, complete, or ended otherwise.
fn judge(one: &Underway, report: &AxisReport, acted_at: Tick) -> Result<Option<Movement>, Failure> {
    if report.activity != Activity::Standing {
        return Ok(None);
    }
    let AxisReport { sense, steps: done, position, alarm, lost, .. } = *report;
    let lost = lost.filter(|_| one.steps.is_none());
    let axis = one.axis;
    if let Some(alarm) = alarm {
        return Err(Failure::Alarm { axis, alarm, done, position, at: Some(acted_at) });
    }
    let complete = match one.steps {
        Some(steps) => u64::from(done.0) == steps,
        None => position.is_some(),
    };
    if !complete {
        return Err(Failure::Stopped { axis, done, position, at: Some(acted_at) });
    }
    let took = acted_at.since(one.start);
    Ok(Some(Movement {
        axis,
        kind: one.kind,
        asked: one.asked,
        done,
        sense,
        took,
        position,
        lost,
        recovered: None,
    }))
}

/// What is not an answer ends the waiting if it concerns one of these movements.
fn bad_news(heard: Heard, underway: &[Underway]) -> Result<(), Failure> {
    match heard {
        Heard::WorkerGone(card) if underway.iter().any(|one| one.axis.address() == card) => {
            Err(Failure::WorkerGone { card })
        }
        Heard::NoLog(trouble) => Err(Failure::NoLog((*trouble).clone())),
        Heard::FramesLost(card, lost) => Err(Failure::FramesLost { card, lost }),
        Heard::GoingDown => Err(Failure::GoingDown),
        Heard::WorkerGone(_) | Heard::Answer(_) | Heard::Resume => Ok(()),
    }
}
