//! One executive's end of the exchange: what it may send, and how it waits for what is heard.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::time::Duration;

use supersigma_protocol::bus::Wake;
use supersigma_protocol::{
    Activity, Address, AxisNumber, Body, Broadcast, CardKind, Command, Fault, Report, Sequence, Tick, Ticks,
};

use super::{CardLife, Exchange, LOOK};
use crate::executive::{Common, Failure, Heard, Knowledge, Link};

/// How long somebody else is left to listen, until the ear is asked for.
const FOLLOW: Duration = Duration::from_millis(5);

/// One executive's link to the live set.
pub struct LiveLink {
    exchange: Arc<Exchange>,
    heard: Receiver<Heard>,
    cancelled: Arc<AtomicBool>,
}

impl LiveLink {
    pub(super) fn new(exchange: &Arc<Exchange>, cancelled: Arc<AtomicBool>) -> Self {
        Self { heard: exchange.subscribe(), exchange: Arc::clone(exchange), cancelled }
    }

    /// What has been passed on to this link.
    fn told(&self) -> Result<Option<Heard>, Failure> {
        match self.heard.try_recv() {
            Ok(heard) => Ok(Some(heard)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(Failure::GoingDown),
        }
    }

    /// Listens for at most `limit`, or lets another do so.
    fn listen(&self, limit: Duration) -> Result<Option<Heard>, Failure> {
        if let Some(mut ear) = self.exchange.borrow_ear() {
            // Whoever had it before may have heard what is waited for.
            if let Some(heard) = self.told()? {
                return Ok(Some(heard));
            }
            self.exchange.listen_with(&mut ear, limit).map_err(Failure::bus_gone)?;
            drop(ear);
            return self.told();
        }
        match self.heard.recv_timeout(limit.min(FOLLOW)) {
            Ok(heard) => Ok(Some(heard)),
            Err(RecvTimeoutError::Timeout) => {
                self.exchange.ask_for_ear();
                Ok(None)
            }
            Err(RecvTimeoutError::Disconnected) => Err(Failure::GoingDown),
        }
    }

    /// Moves need a log and living cards; stopping and asking do not.
    fn check(&self, broadcast: &Broadcast) -> Result<(), Failure> {
        let Ok(command) = Command::decode(broadcast.bytes.as_slice()) else {
            return Ok(());
        };
        let state = self.exchange.state();
        let moves = command.operation.sets_going();
        if moves && state.going_down {
            return Err(Failure::GoingDown);
        }
        if moves && let Some(trouble) = &state.no_log {
            return Err(Failure::NoLog((**trouble).clone()));
        }
        let process = match command.to.kind() {
            CardKind::DigitalOutput => Address::DIGITAL_INPUT,
            _ => command.to,
        };
        match state.cards.get(&process) {
            Some(life) if !life.alive => Err(Failure::WorkerGone { card: command.to }),
            _ => Ok(()),
        }
    }
}

impl Link for LiveLink {
    fn knowledge(&self) -> &Arc<Knowledge> {
        &self.exchange.knowledge
    }

    fn now(&self) -> Tick {
        self.exchange.clock.now()
    }

    fn ticks(&self, real: Duration) -> Ticks {
        self.exchange.clock.scale().ticks(real)
    }

    fn common(&self) -> Arc<Common> {
        Arc::clone(&self.exchange.common)
    }

    fn activity(&self, axis: AxisNumber) -> Option<Activity> {
        match self.exchange.state().cards.get(&axis.address())? {
            CardLife { alive: true, report: Report::Axis(report), .. } => Some(report.activity),
            _ => None,
        }
    }

    fn tell_resume(&self) {
        self.exchange.state().tell(&Heard::Resume);
        self.exchange.wake();
    }

    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        self.check(&broadcast)?;
        self.exchange.send(broadcast).map_err(Failure::bus_gone)
    }

    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure> {
        let card = axis.address();
        if self.exchange.state().cards.get(&card).is_some_and(|life| !life.alive) {
            return Err(Failure::WorkerGone { card });
        }
        let sent = self.exchange.put(Body::Fault(axis, fault), Wake::Card(card));
        sent.map_err(Failure::bus_gone)
    }

    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        loop {
            if self.cancelled.swap(false, Ordering::AcqRel) {
                return Err(Failure::Cancelled);
            }
            let left = self.exchange.clock.until(until);
            if let Some(heard) = self.listen(left.min(LOOK))? {
                return Ok(Some(heard));
            }
            if self.exchange.clock.until(until).is_zero() {
                return Ok(None);
            }
            // It may have been told, and forgotten, just before the request began.
            if self.exchange.state().going_down {
                return Err(Failure::GoingDown);
            }
        }
    }
}
