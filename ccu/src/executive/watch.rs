//! What has been commanded and is not over yet. Every piece of news from the bus passes through here, whatever the executive
//! waits for at the moment, so that the end of a movement is known even if nobody was waiting for it when it came.

use std::collections::BTreeMap;
use std::time::Duration;

use supersigma_protocol::{Activity, Answer, AxisNumber, Command, Operation, Report, Steps, Tick, Ticks};

use super::failure::Failure;
use super::link::{Heard, Link};
use super::request::{Begun, Displacement, Movement, MovementKind, Outcome, Remainder, Request};
use super::{Executive, Underway, judge};

/// How many times the sense points are looked at between the due time of a movement and the time at which it is overdue.
const LOOKS: u64 = 8;
/// Who waits for nothing but to be resumed sleeps for so long at a time.
const NAP: Duration = Duration::from_secs(3_600);

/// Movements that were commanded with one request, and what has become of them.
#[derive(Debug)]
pub(super) struct Watch {
    pub(super) id: Begun,
    /// What was begun, or what is left of it; `None` if the executive waits for it by itself.
    pub(super) request: Option<Request>,
    /// How far each axis goes in all.
    pub(super) asked: BTreeMap<AxisNumber, Displacement>,
    /// What was made of it before it was halted.
    pub(super) made: BTreeMap<AxisNumber, Steps>,
    underway: Vec<Underway>,
    over: Vec<Option<Movement>>,
    pub(super) failure: Option<Failure>,
    /// What is left of it; it waits to be resumed.
    pub(super) parked: Option<Remainder>,
    /// Whoever began it halted it too, so nobody will resume it.
    pub(super) given_up: bool,
    /// It has been told to stop, because another one that it belongs to has failed.
    pub(super) halting: bool,
    /// What could be done about its failure has been done.
    pub(super) mended: bool,
}

impl Watch {
    /// Whether all of its movements have ended, or one has failed.
    pub(super) fn is_over(&self) -> bool {
        self.parked.is_none() && (self.failure.is_some() || self.over.iter().all(Option::is_some))
    }

    /// The movements that have not ended.
    pub(super) fn open(&self) -> impl Iterator<Item = &Underway> {
        let open = self.underway.iter().zip(&self.over).filter(|(_, over)| over.is_none());
        open.map(|(one, _)| one).filter(|_| self.failure.is_none())
    }

    /// Whether it moves one of these axes.
    pub(super) fn concerns(&self, axes: &[AxisNumber]) -> bool {
        self.underway.iter().any(|one| axes.contains(&one.axis))
    }

    /// What came of it.
    pub(super) fn result(self) -> Result<Vec<Movement>, Failure> {
        self.failure.map_or_else(|| Ok(self.over.into_iter().flatten().collect()), Err)
    }

    /// These movements are its own from now on.
    pub(super) fn put(&mut self, underway: Vec<Underway>) {
        self.over = vec![None; underway.len()];
        self.underway = underway;
        self.failure = None;
    }

    /// It has ended so, whatever became of it before.
    pub(super) fn settle(&mut self, movements: Vec<Movement>) {
        self.over = movements.into_iter().map(Some).collect();
        self.failure = None;
    }

    /// What it makes of news, and what its other axes must do then.
    fn note(&mut self, heard: &Heard) -> Option<Operation> {
        if self.failure.is_some() {
            return None;
        }
        let failure = match heard {
            Heard::Answer(Answer { card, report: Report::Axis(report), acted_at, .. }) => {
                let mut failure = None;
                for (one, over) in self.underway.iter().zip(&mut self.over) {
                    if over.is_none() && one.axis.address() == *card && *acted_at > one.since {
                        match judge(one, report, *acted_at) {
                            Ok(movement) => *over = movement,
                            Err(why) => failure = Some(why),
                        }
                    }
                }
                failure?
            }
            _ if self.is_over() => return None,
            Heard::WorkerGone(card) if self.underway.iter().any(|one| one.axis.address() == *card) => {
                Failure::WorkerGone { card: *card }
            }
            Heard::NoLog(trouble) => Failure::NoLog((**trouble).clone()),
            Heard::FramesLost(card, lost) => Failure::FramesLost { card: *card, lost: *lost },
            Heard::GoingDown => Failure::GoingDown,
            Heard::WorkerGone(_) | Heard::Answer(_) | Heard::Resume => return None,
        };
        self.fail(failure)
    }

    /// One of its axes has failed.
    fn fail(&mut self, failure: Failure) -> Option<Operation> {
        let together = |one: &Underway| matches!(one.kind, MovementKind::Line | MovementKind::Path);
        let operation = match &failure {
            // Whoever halts one axis of a line without the others would have these run on alone.
            Failure::Stopped { .. } => Some(Operation::Halt),
            // One axis of a line that stops by itself has left it; the others must not run on alone.
            _ if self.underway.len() > 1 && self.underway.iter().all(together) => Some(Operation::Brake),
            _ => None,
        };
        self.failure = Some(failure);
        operation
    }
}

impl<L: Link> Executive<L> {
    /// Looks after these movements from now on. What was heard since they were commanded counts.
    pub(super) fn watch(
        &mut self,
        request: Option<Request>,
        underway: Vec<Underway>,
    ) -> Result<Begun, Failure> {
        let id = Begun(self.next);
        self.next += 1;
        self.watched.push(Watch {
            id,
            asked: request.as_ref().map(Request::moving).unwrap_or_default(),
            request,
            made: BTreeMap::new(),
            underway: vec![],
            over: vec![],
            failure: None,
            parked: None,
            given_up: false,
            halting: false,
            mended: false,
        });
        self.put(id, underway)?;
        Ok(id)
    }

    /// These are the movements of a watch from now on.
    pub(super) fn put(&mut self, id: Begun, underway: Vec<Underway>) -> Result<(), Failure> {
        let Some(watch) = self.watched.iter_mut().find(|watch| watch.id == id) else { return Ok(()) };
        watch.put(underway);
        let others = self.heard.iter().find_map(|heard| watch.note(heard));
        let axes = watch.underway.iter().map(|one| one.axis).collect::<Vec<_>>();
        others.map_or(Ok(()), |operation| self.stop_each(&axes, operation))
    }

    /// Waits until all of these movements are over, and judges them.
    pub(super) fn complete(&mut self, underway: Vec<Underway>) -> Result<Outcome, Failure> {
        let id = self.watch(None, underway)?;
        while self.is_open(id) {
            match self.look_after(&[id], None) {
                Ok(()) => {}
                // Whatever is watched is halted then, this too.
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                Err(failure) => {
                    self.take_watch(id);
                    return Err(failure);
                }
            }
        }
        self.take_watch(id).map_or(Ok(vec![]), Watch::result).map(Outcome::Moved)
    }

    fn is_open(&self, id: Begun) -> bool {
        self.watched.iter().any(|watch| watch.id == id && !watch.is_over())
    }

    /// Nobody waits for these movements any more.
    pub(super) fn take_watch(&mut self, id: Begun) -> Option<Watch> {
        let index = self.watched.iter().position(|watch| watch.id == id)?;
        Some(self.watched.remove(index))
    }

    /// Waits for the next news, until a tick at most. When some of these movements should be over by now, it asks for them.
    pub(super) fn look_after(&mut self, ids: &[Begun], until: Option<Tick>) -> Result<(), Failure> {
        let margin_ms = self.link.knowledge().config.executive.overdue_ms;
        let margin = self.link.ticks(Duration::from_millis(margin_ms.into()));
        let waiting = self.watched.iter().filter(|watch| ids.contains(&watch.id) && watch.parked.is_none());
        let next = waiting.flat_map(|watch| watch.open().map(|one| (watch.id, *one)));
        let Some((id, next)) = next.min_by_key(|(_, one)| one.due) else {
            let nap = self.link.now() + self.link.ticks(NAP);
            return self.listen(until.map_or(nap, |until| until.min(nap))).map(drop);
        };
        // Its end is told unasked. Once it is due, the sense points are looked at too, in equal parts of the margin.
        let deadline = next.due + margin;
        let look = (self.link.now().max(next.due) + Ticks(margin.0 / LOOKS)).min(deadline);
        let until = until.filter(|until| *until < look);
        if self.listen(until.unwrap_or(look))?.is_some() || until.is_some() {
            return Ok(());
        }
        // It may have ended and the news got lost: ask.
        let overdue = self.link.now() >= deadline;
        let failure = match self.command(next.axis, Operation::Status) {
            Ok(Answer { report: Report::Axis(report), acted_at, .. })
                if overdue && report.activity != Activity::Standing =>
            {
                Failure::Overdue {
                    axis: next.axis,
                    milliseconds: margin_ms,
                    done: report.steps,
                    at: Some(acted_at),
                }
            }
            Ok(_) => return Ok(()),
            Err(Failure::NoAnswer { .. }) if !overdue => return Ok(()),
            Err(
                failure @ (Failure::Cancelled
                | Failure::GoingDown
                | Failure::BusGone { .. }
                | Failure::Pulses { .. }),
            ) => return Err(failure),
            Err(failure) => failure,
        };
        let Some(watch) = self.watched.iter_mut().find(|watch| watch.id == id) else { return Ok(()) };
        if watch.failure.is_some() {
            return Ok(());
        }
        let others = watch.fail(failure);
        let axes = watch.underway.iter().map(|one| one.axis).collect::<Vec<_>>();
        others.map_or(Ok(()), |operation| self.stop_each(&axes, operation))
    }

    /// The next thing heard; whatever is watched takes note of it.
    pub(super) fn listen(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        let Some(heard) = self.link.hear(until)? else { return Ok(None) };
        self.resumed |= heard == Heard::Resume;
        let mut stops = Vec::new();
        for watch in &mut self.watched {
            if let Some(operation) = watch.note(&heard) {
                stops.push((watch.underway.iter().map(|one| one.axis).collect::<Vec<_>>(), operation));
            }
        }
        for (axes, operation) in stops {
            self.stop_each(&axes, operation)?;
        }
        Ok(Some(heard))
    }

    /// Takes note of what was said since the last request. For the next one nothing else of it counts.
    ///
    /// # Errors
    /// If the bus fails, or whoever asks has gone.
    pub fn catch_up(&mut self) -> Result<(), Failure> {
        let now = self.link.now();
        while self.listen(now)?.is_some() {}
        Ok(())
    }

    /// Halts whatever was begun and is not over, and forgets it: whoever began it has gone.
    pub fn abandon(&mut self) {
        let watched = std::mem::take(&mut self.watched);
        let open = watched.iter().flat_map(Watch::open).map(|one| one.axis).collect::<Vec<_>>();
        if let Err(failure) = self.stop_each(&open, Operation::Halt) {
            tracing::warn!(%failure, "what a client had begun could not be halted");
        }
    }

    /// Stops axes one by one, without waiting for them. Where nobody plays the card, nobody needs to stop.
    pub(super) fn stop_each(&mut self, axes: &[AxisNumber], operation: Operation) -> Result<(), Failure> {
        for axis in axes {
            match self.link.send(Command::new(axis.address(), operation).into()) {
                Ok(_) | Err(Failure::WorkerGone { .. }) => {}
                Err(failure) => return Err(failure),
            }
        }
        Ok(())
    }
}
