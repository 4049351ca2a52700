//! Keeps the cards' processes alive. One that ends unasked is started again, after a pause that grows while it keeps
//! ending; its card comes back as a card just switched on, which does not know where its axis is.

use std::collections::BTreeMap;
use std::io;
use std::process::ExitStatus;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use supersigma_protocol::{About, Address, Occasion};

use super::StartError;
use super::births::{BIRTH, Births, pause_after};
use super::process::Process;
use crate::control::{ProcessRole, ProcessState, ProcessView};
use crate::executive::Heard;

/// A process that has lived so long has not ended because it cannot live.
const SETTLED: Duration = Duration::from_secs(10);

/// The processes of all cards; shared with the threads that watch them.
pub(super) struct Keeper {
    births: Births,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// Until all have joined, one that ends is not started again: the set cannot be.
    settled: bool,
    seats: BTreeMap<Address, Seat>,
}

struct Seat {
    /// None while the next one has not been started yet.
    process: Option<Process>,
    since: Instant,
    restarts: u32,
    /// Ends in a row, each soon after the start.
    failures: u32,
}

/// What there is to tell about one card's process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sitting {
    pub(super) card: Address,
    /// None while it waits to be started again.
    pub(super) pid: Option<u32>,
    /// Since it was started, or since it ended.
    pub(super) since: Instant,
    pub(super) restarts: u32,
}

impl Sitting {
    /// The same for clients; `alive` is whether the card has been heard lately, `restarts` whether what ends is started
    /// again.
    pub(super) fn view(self, alive: bool, restarts: bool) -> ProcessView {
        ProcessView {
            role: ProcessRole::Worker,
            card: Some(self.card),
            pid: self.pid,
            state: match self.pid {
                Some(_) if alive => ProcessState::Running,
                Some(_) => ProcessState::Silent,
                None if restarts => ProcessState::Restarting,
                None => ProcessState::Ended,
            },
            since_ms: self.since.elapsed().as_millis().try_into().unwrap_or(u64::MAX),
            restarts: self.restarts,
        }
    }
}

impl Keeper {
    /// Starts all cards at once, and waits until all have joined.
    ///
    /// # Errors
    /// If one does not come to life.
    pub(super) fn start(births: Births, cards: Vec<Address>) -> Result<Arc<Self>, StartError> {
        let heard = births.exchange.subscribe();
        let keeper = Arc::new(Self { births, state: Mutex::default() });
        match keeper.bring_up(cards, &heard) {
            Ok(()) => Ok(keeper),
            Err(error) => {
                keeper.finish(BIRTH);
                Err(error)
            }
        }
    }

    fn bring_up(self: &Arc<Self>, cards: Vec<Address>, heard: &Receiver<Heard>) -> Result<(), StartError> {
        for card in &cards {
            let process = self.begin(*card);
            let process = process.map_err(|source| StartError::Io { what: "start a worker", source })?;
            let seat = Seat { process: Some(process), since: Instant::now(), restarts: 0, failures: 0 };
            self.state().seats.insert(*card, seat);
        }
        let mut missing = cards;
        let deadline = Instant::now() + BIRTH;
        while let Some(first) = missing.first().copied() {
            match heard.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Heard::Answer(answer)) if answer.about == About::Unasked(Occasion::Joined) => {
                    missing.retain(|card| *card != answer.card);
                }
                Ok(Heard::WorkerGone(card)) => return Err(StartError::NoWorker(card)),
                Ok(_) => {}
                Err(_) => return Err(StartError::NoWorker(first)),
            }
        }
        self.state().settled = true;
        Ok(())
    }

    /// How many cards there are.
    pub(super) fn cards(&self) -> usize {
        self.state().seats.len()
    }

    /// What there is to tell, by card.
    pub(super) fn sittings(&self) -> Vec<Sitting> {
        let state = self.state();
        let sitting = |(card, seat): (&Address, &Seat)| Sitting {
            card: *card,
            pid: seat.process.as_ref().map(Process::pid),
            since: seat.since,
            restarts: seat.restarts,
        };
        state.seats.iter().map(sitting).collect()
    }

    /// From now on nothing is started any more; all are asked to say that they leave.
    pub(super) fn ask_to_leave(&self) {
        self.births.leaving.set();
        for process in self.state().seats.values_mut().filter_map(|seat| seat.process.as_mut()) {
            process.ask_to_leave();
        }
    }

    /// Ends all lifelines, and waits until all have ended; those that do not within `limit` are killed.
    pub(super) fn finish(&self, limit: Duration) {
        self.births.leaving.set();
        // Whoever watches them may want the lock, so it is not held while they end.
        let take = |seat: &mut Seat| seat.process.take();
        let mut processes: Vec<Process> = self.state().seats.values_mut().filter_map(take).collect();
        for process in &mut processes {
            process.let_go();
        }
        for process in &mut processes {
            process.finish(limit);
        }
    }

    fn begin(self: &Arc<Self>, card: Address) -> io::Result<Process> {
        let keeper = Arc::clone(self);
        self.births.worker(card, move |status| keeper.ended(card, status))
    }

    /// On the thread that has watched the process.
    fn ended(self: &Arc<Self>, card: Address, status: ExitStatus) {
        if self.births.leaving.is_set() {
            return;
        }
        tracing::error!(%card, %status, "a worker has ended; all axes brake");
        self.births.exchange.worker_gone(card);
        loop {
            let Some(failures) = self.vacate(card) else { return };
            if self.births.leaving.wait(pause_after(failures)) {
                return;
            }
            match self.begin_again(card) {
                Ok(Some(restarts)) => {
                    tracing::warn!(
                        %card,
                        restarts,
                        "the worker is started again; where its axis is, is not known: originate it"
                    );
                    return;
                }
                Ok(None) => return,
                Err(error) => tracing::error!(%card, %error, "a worker cannot be started again"),
            }
        }
    }

    /// Takes note that nobody plays the card; says how often that has happened in a row. `None` if it stays so.
    fn vacate(&self, card: Address) -> Option<u32> {
        let mut state = self.state();
        let again = state.settled && self.restarts();
        let seat = state.seats.get_mut(&card)?;
        seat.process = None;
        seat.failures = if seat.since.elapsed() < SETTLED { seat.failures + 1 } else { 1 };
        seat.since = Instant::now();
        again.then_some(seat.failures)
    }

    fn restarts(&self) -> bool {
        self.births.exchange.knowledge().config.supervision.restart
    }

    /// Says how often the card's process has been started again, with this time; `None` if nothing shall be started.
    fn begin_again(self: &Arc<Self>, card: Address) -> io::Result<Option<u32>> {
        let mut state = self.state();
        // Asked under the lock: whoever takes the set down sets it, and then takes what is in the seats.
        let Some(seat) = state.seats.get_mut(&card).filter(|_| !self.births.leaving.is_set()) else {
            return Ok(None);
        };
        self.births.exchange.born_again(card);
        seat.process = Some(self.begin(card)?);
        seat.since = Instant::now();
        seat.restarts += 1;
        Ok(Some(seat.restarts))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is in there is whole after every statement.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
