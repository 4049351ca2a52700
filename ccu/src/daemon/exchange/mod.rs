//! The CCU's end of the bus: all that is heard, and what is known of the cards from it. Whoever waits for something
//! subscribes; whoever commands goes through the one sending half. Who listens, the [`ear`] decides. No process is started
//! in here.

mod ear;
mod link;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender as Subscriber};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axis_worker::clock::Clock;
use supersigma_protocol::bus::{BusError, Lane, Receive, Transmit, Wake, Waker};
use supersigma_protocol::{
    About, Activity, Address, Answer, Body, Broadcast, Command, Frame, Occasion, Operation, Report, Sender,
    Sequence, Tick, Ticks,
};
use tokio::sync::broadcast;

use self::ear::{Ear, Talks};
pub use self::link::LiveLink;
use super::feed::{Feed, Overheard};
use super::members::Members;
use crate::executive::{Common, Heard, Knowledge, LogTrouble};

/// How often the thread looks for what nobody woke it for, while somebody wants to see it: the way of axes that move.
const LOOK: Duration = Duration::from_millis(50);

/// What is known of one card's process.
#[derive(Debug, Clone)]
pub(super) struct CardLife {
    /// Whether somebody plays the card.
    pub(super) alive: bool,
    /// What it said last.
    pub(super) report: Report,
    /// When it last spoke, by its own account.
    spoke: Tick,
    /// The number that its next frame must have.
    expected: Sequence,
}

/// What the exchange counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Frames that the CCU has sent.
    pub(super) commands: u64,
    /// Frames of cards that have come here.
    pub(super) answers: u64,
    /// Frames of cards that are missing.
    pub(super) lost: u64,
}

/// The bus and what is known of its cards; shared by everybody in the daemon.
pub(super) struct Exchange {
    knowledge: Arc<Knowledge>,
    common: Arc<Common>,
    clock: Clock,
    members: Members,
    port: Mutex<Port>,
    /// Goes when the exchange stops, as the sending half does.
    ear: Mutex<Option<Ear>>,
    talks: Talks,
    state: Mutex<State>,
    feed: Feed,
    over: AtomicBool,
}

/// The sending half and what wakes the receiving one. Both go when the exchange stops, whoever else still holds it: a bus
/// can only be removed without a trace when nobody has a port on it.
struct Port {
    ends: Option<(Box<dyn Transmit>, Waker)>,
    sequence: Sequence,
}

#[derive(Default)]
struct State {
    cards: BTreeMap<Address, CardLife>,
    /// Cards whose process has ended unasked. What they said before may still come from the bus.
    ended: BTreeSet<Address>,
    /// What each digital card said last.
    words: BTreeMap<Address, u16>,
    subscribers: Vec<Subscriber<Heard>>,
    counts: Counts,
    no_log: Option<Arc<LogTrouble>>,
    going_down: bool,
}

impl Exchange {
    /// Begins to listen.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn start(
        knowledge: Arc<Knowledge>,
        clock: Clock,
        members: Members,
        transmit: impl Transmit + 'static,
        receive: impl Receive + 'static,
    ) -> Result<(Arc<Self>, JoinHandle<()>), BusError> {
        let exchange = Arc::new(Self {
            knowledge,
            common: Arc::default(),
            clock,
            members,
            port: Mutex::new(Port {
                ends: Some((Box::new(transmit), receive.waker())),
                sequence: Sequence(0),
            }),
            ear: Mutex::new(Some(Ear::new(receive))),
            talks: Talks::default(),
            state: Mutex::default(),
            feed: Feed::default(),
            over: AtomicBool::new(false),
        });
        let listening = Arc::clone(&exchange);
        let thread =
            thread::Builder::new().name("exchange".into()).spawn(move || listening.listen()).map_err(
                |error| BusError::Open { what: "start the exchange's thread", reason: error.to_string() },
            )?;
        Ok((exchange, thread))
    }

    /// Ends the thread, after it has taken what is on the bus, and leaves the bus.
    pub(super) fn stop(&self) {
        self.over.store(true, Ordering::Release);
        self.wake();
        self.port().ends = None;
    }

    /// A link for one executive. It hears everything from now on, until `cancelled` is set.
    pub(super) fn link(self: &Arc<Self>, cancelled: Arc<AtomicBool>) -> LiveLink {
        LiveLink::new(self, cancelled)
    }

    /// Everything that is heard from now on.
    pub(super) fn subscribe(&self) -> Receiver<Heard> {
        let (subscriber, heard) = mpsc::channel();
        let mut state = self.state();
        if state.going_down {
            let _ = subscriber.send(Heard::GoingDown);
        }
        state.subscribers.push(subscriber);
        heard
    }

    /// Every frame from now on, for a watcher; `None` once the set is down.
    pub(super) fn overhear(&self) -> Option<broadcast::Receiver<Overheard>> {
        self.feed.subscribe()
    }

    /// The set.
    pub(super) fn knowledge(&self) -> &Arc<Knowledge> {
        &self.knowledge
    }

    /// What is known of each card that has joined.
    pub(super) fn cards(&self) -> BTreeMap<Address, CardLife> {
        self.state().cards.clone()
    }

    /// The lines of a digital card, as it said last.
    pub(super) fn word(&self, card: Address) -> Option<u16> {
        self.state().words.get(&card).copied()
    }

    /// What has been counted so far.
    pub(super) fn counts(&self) -> Counts {
        let commands = self.port().sequence.0;
        Counts { commands, ..self.state().counts }
    }

    /// Puts a command on the bus.
    ///
    /// # Errors
    /// If the bus fails.
    pub(super) fn send(&self, broadcast: Broadcast) -> Result<Sequence, BusError> {
        let wake =
            broadcast.bytes.as_slice().first().map_or(Wake::Nobody, |address| Wake::Card(Address(*address)));
        self.put(Body::Command(broadcast), wake)
    }

    fn put(&self, body: Body, wake: Wake) -> Result<Sequence, BusError> {
        let mut port = self.port();
        let sequence = port.sequence;
        let frame = Frame { sender: Sender::Ccu, sequence, tick: self.clock.now(), body };
        let Some((transmit, _)) = &mut port.ends else {
            return Err(BusError::Broken { what: "send", reason: "the CCU has left the bus".into() });
        };
        let bytes = frame.encode();
        // Before any card can answer, so that watchers hear the question first.
        self.feed.tell(Lane::Commands, &bytes);
        transmit.send(&bytes, wake)?;
        port.sequence = sequence.next();
        Ok(sequence)
    }

    /// Stops all axes with the steep ramp, because something is wrong.
    pub(super) fn brake_all(&self) {
        if let Err(error) = self.send(Command::new(Address::EVERYONE, Operation::Brake).into()) {
            tracing::error!(%error, "the brake command could not be sent");
        }
    }

    /// The process that played `card` has ended unasked.
    pub(super) fn worker_gone(&self, card: Address) {
        self.state().ended.insert(card);
        self.card_gone(card);
    }

    /// The process that plays `card` is started again: what comes from the bus is its own.
    pub(super) fn born_again(&self, card: Address) {
        self.state().ended.remove(&card);
    }

    fn card_gone(&self, card: Address) {
        {
            let mut state = self.state();
            if let Some(life) = state.cards.get_mut(&card) {
                life.alive = false;
            }
            state.tell(&Heard::WorkerGone(card));
        }
        self.wake();
        self.brake_all();
    }

    /// There is no log any more.
    pub(super) fn no_log(&self, trouble: LogTrouble) {
        {
            let mut state = self.state();
            let trouble = Arc::new(trouble);
            state.no_log = Some(Arc::clone(&trouble));
            state.tell(&Heard::NoLog(trouble));
        }
        self.wake();
        self.brake_all();
    }

    /// There is a log again.
    pub(super) fn log_again(&self) {
        self.state().no_log = None;
    }

    /// Nobody shall begin anything any more.
    pub(super) fn going_down(&self) {
        {
            let mut state = self.state();
            state.going_down = true;
            state.tell(&Heard::GoingDown);
        }
        self.wake();
    }

    /// Whoever listens to the bus looks up: somebody has been told what did not come from there.
    fn wake(&self) {
        if let Some((_, waker)) = &self.port().ends {
            waker.wake();
        }
    }

    fn take(&self, sender: Address, sequence: Sequence, spoke: Tick, answer: Answer) {
        let lost = {
            let mut state = self.state();
            state.counts.answers += 1;
            let alive = answer.about != About::Unasked(Occasion::Leaving) && !state.ended.contains(&sender);
            let expected = state.cards.get(&sender).map(|life| life.expected);
            let life = CardLife { alive, report: answer.report, spoke, expected: sequence.next() };
            state.cards.insert(sender, life);
            if let Report::Digital(word) = answer.report {
                state.words.insert(answer.card, word);
            }
            let lost = match expected {
                Some(expected) if sequence != Sequence(0) => sequence.0.saturating_sub(expected.0),
                _ => 0,
            };
            state.counts.lost += lost;
            if lost > 0 {
                state.tell(&Heard::FramesLost(sender, lost));
            }
            // Nobody waits for samples: what matters comes as a change.
            if answer.about != About::Unasked(Occasion::Sampled) {
                state.tell(&Heard::Answer(answer));
            }
            lost
        };
        if lost > 0 {
            tracing::error!(%sender, lost, "frames were lost on the bus");
            self.brake_all();
        }
    }

    /// How long the thread may sleep. What matters wakes it; heartbeats wait on the bus until a card could have been silent
    /// for too long.
    fn patience(&self) -> Duration {
        let state = self.state();
        let rests = |life: &CardLife| {
            let moves = matches!(life.report, Report::Axis(axis) if axis.activity != Activity::Standing);
            life.alive && !moves
        };
        if self.feed.is_watched() || !state.cards.values().all(rests) {
            return LOOK;
        }
        let first = state.cards.values().map(|life| life.spoke).min();
        first.map_or(LOOK, |spoke| self.clock.until(spoke + self.silence()))
    }

    /// The machine time after which a card that says nothing hangs.
    fn silence(&self) -> Ticks {
        let real = Duration::from_millis(self.knowledge.config.supervision.silent_ms.into());
        self.clock.scale().ticks(real)
    }

    /// A card that has said nothing for too long hangs; the others must not run on.
    fn look_for_silence(&self) {
        let (now, limit) = (self.clock.now(), self.silence());
        let hung: Vec<Address> = {
            let mut state = self.state();
            let silent =
                state.cards.iter_mut().filter(|(_, life)| life.alive && now.since(life.spoke) >= limit);
            silent
                .map(|(card, life)| {
                    life.alive = false;
                    *card
                })
                .collect()
        };
        for card in hung {
            let limit_ms = self.knowledge.config.supervision.silent_ms;
            tracing::error!(%card, limit_ms, "the card is silent; all axes brake");
            self.card_gone(card);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is in there is whole after every statement, even if a thread has panicked while it held the lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn port(&self) -> MutexGuard<'_, Port> {
        self.port.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn tell(&mut self, heard: &Heard) {
        self.subscribers.retain(|subscriber| subscriber.send(heard.clone()).is_ok());
    }
}

#[cfg(test)]
mod tests;
