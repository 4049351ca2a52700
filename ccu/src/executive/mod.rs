//! The executive of \[F\]: sense, control, wait. It turns a [`Request`] into commands on the bus, knows from the plan
//! when each movement is due, and judges by the sense points whether it has come true. It moves nothing itself and
//! reads no clock but its [`Link`]'s; a live set and a dry run are driven by this very code.

pub mod advice;
mod again;
mod begun;
mod failure;
mod halted;
mod link;
mod path;
mod recovery;
mod request;
#[cfg(test)]
mod tests;
mod watch;

use std::time::Duration;

use axis_worker::ramp::Plan;
use supersigma_protocol::{
    About, Activity, Address, Answer, AxisNumber, AxisReport, Broadcast, CardKind, Command, CommandBytes,
    Fault, Operation, Refusal, Report, Sequence, SpeedIndex, Tick, Ticks,
};

pub use again::{Again, Sent, Shift};
pub use failure::{Failure, LogTrouble};
use halted::can_go_on_after;
use link::Paused;
pub use link::{Common, Heard, Knowledge, Link};
pub use request::{
    AxisState, Begun, Displacement, Ended, Leg, Movement, MovementKind, Outcome, RawAnswer, Recovery,
    Remainder, Request, Until,
};
use watch::Watch;

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
    /// What has been commanded and is not over, or whose end nobody has asked for yet.
    watched: Vec<Watch>,
    /// The number of the next watch.
    next: u64,
    /// While something that was begun waits to be resumed.
    paused: Option<Paused>,
    /// Somebody has said that what was halted may go on.
    resumed: bool,
}

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
            Err(Failure::Alarm { alarm, .. }) if can_go_on_after(*alarm) => {
                // The alarm is what must be told, whatever becomes of the rest.
                if let Err(failure) = self.leave_rest(&request) {
                    tracing::debug!(%failure, "the rest of the movement is not known");
                }
            }
            Ok(_) if request.is_unwatched() => self.link.common().leave_unwatched(request),
            // Whoever asked has gone, and with him whoever would wait for what he has begun.
            Err(Failure::Cancelled) => self.abandon(),
            _ => {}
        }
        result
    }
}

impl<L: Link> Executive<L> {
    /// An executive over `link`.
    pub fn new(link: L) -> Self {
        Self { link, heard: vec![], watched: vec![], next: 0, paused: None, resumed: false }
    }

    fn carry_out(&mut self, request: &Request) -> Result<Outcome, Failure> {
        match request {
            Request::Originate { .. }
            | Request::SeekReference { .. }
            | Request::Move { .. }
            | Request::Line { .. }
            | Request::Path { .. } => {
                let underway = self.set_going(request)?.unwrap_or_default();
                if request.is_unwatched() { Ok(Outcome::Done) } else { self.complete(underway) }
            }
            Request::Begin { request } => self.begin(request),
            Request::Await { begun, until } => self.await_begun(begun, *until, false),
            Request::Abandon => {
                self.abandon();
                Ok(Outcome::Done)
            }
            Request::Now => Ok(Outcome::Tick(self.link.now())),
            Request::Resume => self.resume(),
            Request::Halt { axes } => self.stop(axes, Operation::Halt),
            Request::Brake { axes } => self.stop(axes, Operation::Brake),
            Request::Clear { axes } => self.clear(axes),
            Request::Status { axes } => self.tell(axes, Operation::Status),
            Request::Output { bit, on } => self.output(*bit, *on),
            Request::Digital { card } => self.digital(*card, Operation::Status).map(Outcome::Digital),
            Request::Inject { axis, fault } => self.inject(*axis, *fault),
            Request::Wait { ticks } => self.wait(*ticks),
            Request::Replay { frames, shift, known } => self.again(frames, *shift, known),
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

    /// Commands the movements of a request; `None` if it is none.
    fn set_going(&mut self, request: &Request) -> Result<Option<Vec<Underway>>, Failure> {
        let underway = match request {
            Request::Originate { axes } => {
                let axes = self.link.knowledge().axes(axes)?;
                self.search(&axes, Operation::Originate, MovementKind::Origin)
            }
            Request::SeekReference { axis } => {
                self.search(&[*axis], Operation::SeekReference, MovementKind::Reference)
            }
            Request::Move { axis, by, speed, constant, .. } => self.movement(*axis, *by, *speed, *constant),
            Request::Line { parts, speed, .. } => {
                let leg = Leg { parts: parts.clone(), speed: *speed };
                self.path(&[leg], MovementKind::Line)
            }
            Request::Path { legs, .. } => self.path(legs, MovementKind::Path),
            _ => return Ok(None),
        };
        underway.map(Some)
    }

    fn movement(
        &mut self,
        axis: AxisNumber,
        by: Displacement,
        speed: Option<f64>,
        constant: bool,
    ) -> Result<Vec<Underway>, Failure> {
        let limit = speed.map(|speed| self.link.knowledge().speed(axis, speed)).transpose()?;
        let Some((direction, distance)) = by.split()? else {
            self.link.knowledge().table(axis)?;
            return Ok(vec![]);
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
        let start = answer.acted_at;
        let due = start + Ticks(plan.duration());
        let steps = Some(by.0.unsigned_abs());
        Ok(vec![Underway { axis, kind, asked: Some(by), steps, since: start, start, due }])
    }

    /// Origination or search for the reference step, of several axes at once.
    fn search(
        &mut self,
        axes: &[AxisNumber],
        operation: Operation,
        kind: MovementKind,
    ) -> Result<Vec<Underway>, Failure> {
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
        Ok(underway)
    }

    fn halt(&mut self, underway: &[Underway]) -> Result<(), Failure> {
        for underway in underway {
            self.link.send(Command::new(underway.axis.address(), Operation::Halt).into())?;
        }
        Ok(())
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
        while let Some(heard) = self.listen(until)? {
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
        while let Some(heard) = self.listen(until)? {
            match heard {
                Heard::Answer(answer) if wanted(&heard) => return Ok(Some(answer)),
                Heard::GoingDown => return Err(Failure::GoingDown),
                Heard::WorkerGone(card) if from.contains(&card) => return Err(Failure::WorkerGone { card }),
                other => self.heard.push(other),
            }
        }
        Ok(None)
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
        start: one.start,
        recovered: None,
    }))
}
