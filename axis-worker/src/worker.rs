//! The worker process: a card, its port on the bus, and real time. A thin shell: it gives the card ticks and frames,
//! puts its answers on the bus, and sleeps until the card's next event or the next frame.
//!
//! Its standard input is its lifeline: a pipe whose other end only the CCU holds. A byte on it asks the card to say that it
//! leaves, and to stay silent from then on. End of file ends the process. If it comes unasked, the CCU is gone, however it
//! went: the card brakes, says that it leaves, and gives the recorder a moment to read that.

use std::io::{self, Read};
use std::panic::{self, AssertUnwindSafe};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use supersigma_config::{Config, ConfigError};
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{Bus, BusError, Origin, Receive, Strangers, Transmit, Wake, Waker};
use supersigma_protocol::{
    About, Address, Alarm, Answer, AxisReport, Body, CardKind, Frame, Occasion, Report, Sender, Sequence,
    Tick, Ticks,
};

use crate::axis::AxisError;
use crate::card::Card;
use crate::clock::{Clock, Monotonic, TimeScale};
use crate::real_time::{self, Missing};

/// What a worker is told by whoever starts it.
#[derive(Debug, Clone, Args)]
pub struct WorkerArgs {
    /// The address of its card: 1 to 7, or 8 for the digital cards
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub card: u8,
    /// The set's runtime folder
    #[arg(long, value_name = "DIR")]
    pub runtime: PathBuf,
    /// The set's configuration
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The CCU's process; nobody else is listened to
    #[arg(long, value_name = "PID")]
    pub ccu: u32,
    /// The set's tick 0, in nanoseconds of the machine's monotonic clock
    #[arg(long, value_name = "NS")]
    pub epoch: u64,
    /// How many times faster than real time
    #[arg(long, value_name = "K", default_value_t = TimeScale::REAL)]
    pub time_scale: TimeScale,
}

/// What a sender has sent is gone with its port, so the port outlives the last frame by this. The recorder looks several
/// times in it.
const GRACE: Duration = Duration::from_millis(200);

/// So many frames are heard at once, before the card is asked whether it has something to do.
const AT_ONCE: usize = 256;

/// The states of a lifeline.
const HELD: u8 = 0;
const ASKED_TO_LEAVE: u8 = 1;
const ENDED: u8 = 2;

/// Why a worker could not work.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Its axis.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// The configuration has no such axis.
    #[error("the configuration has no axis with address {0}")]
    NoSuchAxis(u8),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A thread could not be started.
    #[error("cannot watch the lifeline: {0}")]
    Lifeline(#[source] io::Error),
}

/// Works until the lifeline ends.
///
/// # Errors
/// If it cannot start, or the bus fails; then the card has braked.
pub fn run(args: &WorkerArgs) -> Result<(), WorkerError> {
    let config = Config::load(&args.config)?;
    let card = match Address(args.card).kind() {
        CardKind::Axis(number) => Card::axis(&config, number)?.ok_or(WorkerError::NoSuchAxis(args.card))?,
        _ => Card::digital(&config),
    };
    let clock = Clock::new(Monotonic::from_nanos(args.epoch), args.time_scale);
    let bus = SharedBus::join(&Place::new(&args.runtime)?)?;
    let (transmit, receive) = bus.card(card.address())?;
    for Missing { what, reason, advice } in real_time::ask_for(&config.real_time) {
        tracing::warn!(card = %card.address(), missing = what, reason, advice, "the system refuses real time");
    }
    let lifeline = watch_lifeline(receive.waker())?;
    let heartbeat = Duration::from_millis(config.supervision.heartbeat_ms.into());
    let heartbeat = clock.scale().ticks(heartbeat).max(Ticks(1));
    let mut worker = Worker {
        card,
        clock,
        transmit,
        receive,
        ccu: Origin(args.ccu),
        strangers: Strangers::default(),
        heartbeat,
        sequence: Sequence(0),
        said: Vec::new(),
        alarm: None,
    };
    worker.guard(|worker| worker.work(&lifeline))
}

/// Keeps the state of the lifeline, and raises the port's own line when it changes.
fn watch_lifeline(waker: Waker) -> Result<Arc<AtomicU8>, WorkerError> {
    let state = Arc::new(AtomicU8::new(HELD));
    let kept = Arc::clone(&state);
    let watch = move || {
        let mut buffer = [0; 64];
        while matches!(io::stdin().read(&mut buffer), Ok(1..)) {
            kept.store(ASKED_TO_LEAVE, Ordering::Release);
            waker.wake();
        }
        kept.store(ENDED, Ordering::Release);
        waker.wake();
    };
    thread::Builder::new().name("lifeline".into()).spawn(watch).map_err(WorkerError::Lifeline)?;
    Ok(state)
}

struct Worker<T, R> {
    card: Card,
    clock: Clock,
    transmit: T,
    receive: R,
    /// Whose commands are obeyed.
    ccu: Origin,
    strangers: Strangers,
    heartbeat: Ticks,
    sequence: Sequence,
    /// What the card has said and the bus has not got yet; kept to reuse its memory.
    said: Vec<Answer>,
    /// Of which the journal was told.
    alarm: Option<Alarm>,
}

impl<T: Transmit, R: Receive> Worker<T, R> {
    /// Whatever goes wrong in `work`, the bus or this program itself: the motor is not left at speed. It brakes as if nobody
    /// commanded it any more, and what it says of that is told if anybody can still be told.
    fn guard(&mut self, work: impl FnOnce(&mut Self) -> Result<(), WorkerError>) -> Result<(), WorkerError> {
        let result = panic::catch_unwind(AssertUnwindSafe(|| work(self)));
        if !matches!(result, Ok(Ok(()))) {
            tracing::error!(card = %self.card.address(), "the worker fails; its card brakes first");
            // If it is the card's own program that has failed, it may do so again.
            let braked = panic::catch_unwind(AssertUnwindSafe(|| self.brake_alone()));
            if braked.is_err() {
                tracing::error!(card = %self.card.address(), "the card could not brake");
            }
        }
        result.unwrap_or_else(|cause| panic::resume_unwind(cause))
    }

    fn brake_alone(&mut self) {
        self.card.orphan(&mut self.said);
        let mut told = self.flush();
        while let Some(event) = self.card.next_event() {
            thread::sleep(self.clock.until(event));
            self.advance_to_now();
            if told.is_ok() {
                told = self.flush();
            } else {
                self.said.clear();
            }
        }
    }

    fn work(&mut self, lifeline: &AtomicU8) -> Result<(), WorkerError> {
        self.card.advance(self.clock.now(), &mut self.said);
        self.speak(Occasion::Joined)?;
        let mut heartbeat = self.next_heartbeat();
        let mut braked = false;
        loop {
            // Read before the bus: a command that came before the end is then still carried out.
            let lifeline = lifeline.load(Ordering::Acquire);
            let more = self.catch_up()?;
            if lifeline == ENDED && !braked && self.card.next_event().is_some() {
                braked = true;
                self.card.orphan(&mut self.said);
                self.flush()?;
            }
            if lifeline != HELD && self.card.next_event().is_none() {
                break;
            }
            if self.card.now() >= heartbeat {
                self.speak(Occasion::Heartbeat)?;
                heartbeat = self.next_heartbeat();
            }
            let next = self.card.next_event().map_or(heartbeat, |event| event.min(heartbeat));
            if !more {
                self.receive.wait(self.clock.until(next))?;
            }
        }
        self.leave(lifeline)
    }

    /// All cards' fall together: processes of one program that wake up one after the other find its code in the caches.
    fn next_heartbeat(&self) -> Tick {
        Tick((self.card.now().0 / self.heartbeat.0 + 1).saturating_mul(self.heartbeat.0))
    }

    fn leave(&mut self, lifeline: &AtomicU8) -> Result<(), WorkerError> {
        self.speak(Occasion::Leaving)?;
        if lifeline.load(Ordering::Acquire) == ENDED {
            thread::sleep(GRACE);
        }
        while lifeline.load(Ordering::Acquire) != ENDED {
            self.receive.wait(Duration::from_secs(1))?;
        }
        Ok(())
    }

    /// Brings the card to the present and lets it hear what is on the bus; says whether there may be more.
    fn catch_up(&mut self) -> Result<bool, WorkerError> {
        self.advance_to_now();
        let mut heard = 0;
        while heard < AT_ONCE
            && let Some(received) = self.receive.receive()?
        {
            heard += 1;
            if received.origin != self.ccu {
                self.strangers.note(received.origin);
                continue;
            }
            match Frame::decode(&received.bytes) {
                Ok(frame) => {
                    self.advance_to_now();
                    self.card.hear(&frame, &mut self.said);
                }
                Err(error) => tracing::warn!(%error, "what the bus brought is not a frame"),
            }
        }
        for stranger in self.strangers.news(Instant::now()) {
            let (card, frames) = (self.card.address(), stranger.frames);
            tracing::error!(%card, frames, "{stranger} is not the CCU and sends commands; nobody hears them");
        }
        self.flush()?;
        Ok(heard == AT_ONCE)
    }

    fn advance_to_now(&mut self) {
        let now: Tick = self.clock.now().max(self.card.now());
        self.card.advance(now, &mut self.said);
    }

    fn speak(&mut self, occasion: Occasion) -> Result<(), WorkerError> {
        let answer = self.card.speak(occasion);
        self.said.push(answer);
        self.flush()
    }

    /// Puts on the bus what the card has said.
    fn flush(&mut self) -> Result<(), WorkerError> {
        for answer in self.said.drain(..) {
            let wake = match answer.about {
                // The CCU looks for these by its own clock.
                About::Unasked(Occasion::Heartbeat | Occasion::Sampled) => Wake::Nobody,
                _ => Wake::Everyone,
            };
            journal(&mut self.alarm, &answer);
            let frame = Frame {
                sender: Sender::Card(self.card.address()),
                sequence: self.sequence,
                tick: self.clock.now(),
                body: Body::Answer(answer),
            };
            self.sequence = self.sequence.next();
            self.transmit.send(&frame.encode(), wake)?;
        }
        Ok(())
    }
}

/// Tells the journal of an alarm, once, when the card tells of it unasked.
fn journal(told: &mut Option<Alarm>, answer: &Answer) {
    let Report::Axis(AxisReport { alarm, .. }) = answer.report else { return };
    if alarm.is_none() {
        *told = None;
    } else if alarm != *told && answer.about == About::Unasked(Occasion::Changed) {
        *told = alarm;
        let (card, tick) = (answer.card, answer.acted_at.0);
        tracing::warn!(%card, alarm = alarm.map(tracing::field::display), tick, "alarm");
    }
}

#[cfg(test)]
#[path = "tests/worker.rs"]
mod tests;
