//! Who listens to the bus. There is one ear, and whoever has it passes on what it hears to all. As long as somebody asks and
//! waits for answers, that one listens itself: an answer that came to another thread first would wake twice, and to be
//! woken is nearly all that an answer costs. Otherwise the exchange's own thread listens.
//!
//! ```text
//!   the thread   waits on the bus ──┐ somebody waits for an answer      nobody has for a while ┌── waits on the bus
//!                                   └─► only glances at the bus now and then ──────────────────┘
//!   a link                              waits on the bus, then computes, waits again, …
//! ```

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread;
use std::time::{Duration, Instant};

use supersigma_protocol::bus::{BusError, Lane, Receive, Received, Strangers};
use supersigma_protocol::{Body, Frame, Sender};

use super::{Exchange, LOOK};

/// So many frames are taken at once, before silence is looked for.
const AT_ONCE: usize = 1_024;
/// So many times more may have to be taken at the end; a stranger may not hold it up.
const LAST_LOOKS: usize = 64;
/// How long after somebody has waited for an answer the thread expects that the next one is waited for.
const TALK: Duration = Duration::from_millis(100);
/// How often it glances at the bus meanwhile: nobody may be listening at the moment.
const GLANCE: Duration = Duration::from_millis(10);

/// The receiving half.
pub(super) struct Ear {
    receive: Box<dyn Receive>,
    strangers: Strangers,
    /// Whether more is on the bus than was taken at once.
    more: bool,
}

impl Ear {
    pub(super) fn new(receive: impl Receive + 'static) -> Self {
        Self { receive: Box::new(receive), strangers: Strangers::default(), more: false }
    }
}

/// Who wants the ear.
#[derive(Default)]
pub(super) struct Talks {
    /// When somebody last waited for an answer.
    last: Mutex<Option<Instant>>,
    /// Whether the thread waits on the bus.
    thread_waits: AtomicBool,
}

impl Talks {
    fn go_on(&self) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    fn are_going_on(&self) -> bool {
        let last = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
        last.is_some_and(|last| last.elapsed() < TALK)
    }
}

/// The ear of somebody who has it; `None` in it once the set is down.
pub(super) type Borrowed<'a> = MutexGuard<'a, Option<Ear>>;

impl Exchange {
    /// The ear, for somebody who waits for an answer; `None` if another has it.
    pub(super) fn borrow_ear(&self) -> Option<Borrowed<'_>> {
        self.talks.go_on();
        self.free_ear()
    }

    /// Has the thread let go of the ear, if it is the one that has it.
    pub(super) fn ask_for_ear(&self) {
        if self.talks.thread_waits.load(Ordering::Acquire) {
            self.wake();
        }
    }

    fn free_ear(&self) -> Option<Borrowed<'_>> {
        match self.ear.try_lock() {
            Ok(ear) => Some(ear),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// Waits until something comes, for at most `limit`, takes what is there, and looks whose silence is too long: never
    /// before what has been said is known, even if this process has stood still for a while.
    ///
    /// # Errors
    /// If the bus fails; then nobody hears any more.
    pub(super) fn listen_with(&self, borrowed: &mut Borrowed<'_>, limit: Duration) -> Result<(), BusError> {
        let Some(ear) = borrowed.as_mut() else { return Ok(()) };
        let waited = if ear.more || limit.is_zero() { Ok(()) } else { ear.receive.wait(limit) };
        let result = waited.and_then(|()| self.drain(ear));
        if let Err(error) = &result {
            tracing::error!(%error, "the CCU does not hear any more");
            **borrowed = None;
            self.going_down();
        } else {
            self.look_for_silence();
        }
        result
    }

    /// The thread: listens while nobody else does.
    pub(super) fn listen(&self) {
        while !self.over.load(Ordering::Acquire) {
            let others_talk = self.talks.are_going_on();
            if others_talk {
                thread::sleep(GLANCE);
            }
            match self.free_ear() {
                Some(borrowed) if borrowed.is_none() => return,
                Some(mut borrowed) => {
                    let limit = if others_talk { Duration::ZERO } else { self.patience() };
                    self.talks.thread_waits.store(!others_talk, Ordering::Release);
                    let heard = self.listen_with(&mut borrowed, limit);
                    self.talks.thread_waits.store(false, Ordering::Release);
                    if heard.is_err() {
                        return;
                    }
                }
                // Whoever has it listens.
                None => thread::sleep(LOOK),
            }
        }
        let ear = self.ear.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(mut ear) = ear {
            self.hear_the_last(&mut ear);
        }
        self.feed.end();
    }

    fn hear_the_last(&self, ear: &mut Ear) {
        for _ in 0..LAST_LOOKS {
            match self.drain(ear) {
                Ok(()) if ear.more => {}
                Ok(()) => break,
                Err(error) => {
                    tracing::error!(%error, "the last frames could not be heard");
                    break;
                }
            }
        }
    }

    /// Takes what is on the bus.
    fn drain(&self, ear: &mut Ear) -> Result<(), BusError> {
        let mut taken = 0;
        while taken < AT_ONCE
            && let Some(received) = ear.receive.receive()?
        {
            taken += 1;
            self.hear(&received, &mut ear.strangers);
        }
        for stranger in ear.strangers.news(Instant::now()) {
            tracing::error!(
                frames = stranger.frames,
                "{stranger} is no part of the set and speaks on its bus; nobody listens to it"
            );
        }
        ear.more = taken == AT_ONCE;
        Ok(())
    }

    fn hear(&self, Received { origin, bytes }: &Received, strangers: &mut Strangers) {
        let Some(plays) = self.members.card_of(*origin) else {
            strangers.note(*origin);
            return;
        };
        self.feed.tell(Lane::Answers, bytes);
        match Frame::decode(bytes) {
            Ok(Frame { sender: Sender::Card(card), sequence, tick, body: Body::Answer(answer) })
                if card == plays =>
            {
                // No clock is ahead of this one: they are one.
                let spoke = tick.min(self.clock.now());
                self.take(card, sequence, spoke, answer);
            }
            Ok(frame) => tracing::warn!(sender = %frame.sender, %plays, "a card says what is not its own"),
            Err(error) => tracing::warn!(%error, %plays, "what the bus brought is not a frame"),
        }
    }
}
