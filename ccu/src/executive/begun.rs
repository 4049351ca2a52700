//! Movements that are begun now and waited for later, by whoever began them: several at once, each with its own end. What
//! somebody else halts is made to its end when it is resumed, as with any movement of a program.

use std::time::Duration;

use supersigma_protocol::{Operation, Ticks};

use super::Executive;
use super::failure::Failure;
use super::halted::whole;
use super::link::Link;
use super::request::{Begun, Ended, Outcome, Request, Until};
use super::watch::Watch;

/// Looking whether something is over takes a moment, so that a program that does nothing else lets time pass.
const GLANCE: Duration = Duration::from_millis(1);

impl<L: Link> Executive<L> {
    /// Begins a movement.
    pub(super) fn begin(&mut self, request: &Request) -> Result<Outcome, Failure> {
        let Some(underway) = self.set_going(request)? else { return Err(Failure::NotAMovement) };
        self.watch(Some(request.clone()), underway).map(Outcome::Begun)
    }

    /// Waits for movements that were begun. With `pauses`, what somebody else halts is not over: it waits to be resumed.
    pub(super) fn await_begun(
        &mut self,
        ids: &[Begun],
        until: Until,
        pauses: bool,
    ) -> Result<Outcome, Failure> {
        if let Some(begun) = ids.iter().find(|id| !self.watched.iter().any(|watch| watch.id == **id)) {
            return Err(Failure::NoSuchMovement { begun: *begun });
        }
        let glance = self.link.now() + Ticks(self.link.ticks(GLANCE).0.max(1));
        loop {
            self.mend(ids)?;
            if pauses {
                self.park(ids)?;
            }
            if until == Until::AllOrFailure {
                self.stop_together(ids)?;
            }
            if std::mem::take(&mut self.resumed) {
                self.unpark(ids)?;
            }
            let over = self.of(ids).filter(|watch| watch.is_over()).count();
            let enough = match until {
                Until::Now => over == ids.len() || self.link.now() >= glance,
                Until::Any => over > 0 || ids.is_empty(),
                Until::All | Until::AllOrFailure => over == ids.len(),
            };
            if enough {
                break;
            }
            self.look_after(ids, (until == Until::Now).then_some(glance))?;
        }
        let over: Vec<Begun> = ids.iter().copied().filter(|id| self.of(&[*id]).all(Watch::is_over)).collect();
        let ended = over.into_iter().filter_map(|id| self.take_watch(id)).map(|watch| {
            let (begun, asked, made) = (watch.id, watch.asked.clone(), watch.made.clone());
            let moved =
                |movements: Vec<_>| movements.into_iter().map(|rest| whole(rest, &asked, &made)).collect();
            Ended { begun, result: watch.result().map(moved) }
        });
        Ok(Outcome::Ended(ended.collect()))
    }

    /// These axes are stopped by whoever began what moves them.
    pub(super) fn give_up(&mut self, axes: &[supersigma_protocol::AxisNumber]) {
        for watch in self.watched.iter_mut().filter(|watch| watch.concerns(axes)) {
            watch.given_up = true;
        }
    }

    fn of(&self, ids: &[Begun]) -> impl Iterator<Item = &Watch> {
        self.watched.iter().filter(|watch| ids.contains(&watch.id))
    }

    fn of_mut(&mut self, ids: &[Begun]) -> impl Iterator<Item = &mut Watch> {
        self.watched.iter_mut().filter(|watch| ids.contains(&watch.id))
    }

    /// Does what can be done about a failure without people.
    fn mend(&mut self, ids: &[Begun]) -> Result<(), Failure> {
        let failed = self.of_mut(ids).filter(|watch| watch.failure.is_some() && !watch.mended);
        let failed: Vec<(Begun, Option<Request>, Option<Failure>)> = failed
            .map(|watch| {
                watch.mended = true;
                (watch.id, watch.request.clone(), watch.failure.clone())
            })
            .collect();
        for (id, request, failure) in failed {
            let (Some(request), Some(failure)) = (request, failure) else { continue };
            let result = match self.recover(&request, failure) {
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                result => result,
            };
            for watch in self.of_mut(&[id]) {
                match &result {
                    Ok(Outcome::Moved(movements)) => watch.settle(movements.clone()),
                    Ok(_) => {}
                    Err(failure) => watch.failure = Some(failure.clone()),
                }
            }
        }
        Ok(())
    }

    /// Has what somebody else halted wait to be resumed.
    fn park(&mut self, ids: &[Begun]) -> Result<(), Failure> {
        let stopped = |watch: &&Watch| {
            let stopped = matches!(watch.failure, Some(Failure::Stopped { .. }));
            stopped && !watch.given_up && watch.parked.is_none()
        };
        let stopped: Vec<Begun> = self.of(ids).filter(stopped).map(|watch| watch.id).collect();
        for id in stopped {
            let Some(request) = self.of(&[id]).find_map(|watch| watch.request.clone()) else { continue };
            self.leave_rest(&request)?;
            let axes: Vec<_> = request.moving().into_keys().collect();
            let rest = self.link.common().take_left_of(&axes);
            let mut made = Vec::with_capacity(axes.len());
            for axis in axes {
                made.push((axis, self.stand(axis)?.steps));
            }
            if self.paused.is_none() && rest.is_some() {
                self.resumed = false;
                self.paused = Some(self.link.common().pause());
            }
            for watch in self.of_mut(&[id]) {
                watch.given_up = rest.is_none();
                watch.parked.clone_from(&rest);
                for (axis, steps) in &made {
                    let so_far = watch.made.entry(*axis).or_default();
                    *so_far = *so_far + *steps;
                }
            }
        }
        Ok(())
    }

    /// Goes on with what waits to be resumed.
    fn unpark(&mut self, ids: &[Begun]) -> Result<(), Failure> {
        self.paused = None;
        let parked: Vec<_> =
            self.of_mut(ids).filter_map(|watch| Some((watch.id, watch.parked.take()?))).collect();
        for (id, rest) in parked {
            let underway = match self.check_places(&rest).and_then(|()| self.set_going(&rest.request)) {
                Ok(underway) => underway.unwrap_or_default(),
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                Err(failure) => {
                    self.of_mut(&[id]).for_each(|watch| watch.failure = Some(failure.clone()));
                    continue;
                }
            };
            self.of_mut(&[id]).for_each(|watch| {
                watch.request = Some(rest.request.clone());
                (watch.mended, watch.halting) = (false, false);
            });
            self.put(id, underway)?;
        }
        Ok(())
    }

    /// When one of these has failed, or waits to be resumed, the others stop too; after a failure none of them goes on.
    fn stop_together(&mut self, ids: &[Begun]) -> Result<(), Failure> {
        let failed = self.of(ids).any(|watch| watch.is_over() && watch.failure.is_some());
        let halted = self.of(ids).any(|watch| watch.parked.is_some());
        if !failed && !halted {
            return Ok(());
        }
        let mut axes = Vec::new();
        for watch in self.of_mut(ids) {
            if failed {
                watch.given_up = true;
                watch.parked = None;
            }
            if !std::mem::replace(&mut watch.halting, true) {
                axes.extend(watch.open().map(|one| one.axis));
            }
        }
        if failed {
            self.paused = None;
        }
        self.stop_each(&axes, Operation::Halt)
    }
}
