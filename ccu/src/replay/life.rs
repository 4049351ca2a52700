//! One card's process from its first frame to its last, against a machine just switched on.
//!
//! An answer is *bound* to a stimulus: the CCU's frame that it answers; the process' own occasions (joined, heartbeat,
//! leaving), which only show the state; frames that never came, the CCU's end. Or the machine has brought it forth *by
//! itself*: changes and samples. A stimulus may be told after what it has caused (a fault: first the alarm, then the
//! answer), so answers are held until a bound one comes; then the machine is brought to its tick and given the stimulus,
//! and what it has said by then is what was held, in this order.
//!
//! ```text
//!   log      changed   sampled   changed │ takes #17          changed …
//!   machine  ───── advance(acted_at) ────┼─ take(#17) ──────► …
//! ```
//!
//! How often the process brought its machine up to date in between does not matter: `advance(a)` and then `advance(b)` is
//! `advance(b)`.

use std::collections::VecDeque;

use axis_worker::{Card, Sink};
use supersigma_protocol::{About, Address, Answer, Occasion, Sequence, Tick, Ticks};

use super::commands::Commands;
use super::{Difference, DifferenceKind, Unverifiable, Verification, Why, frame_of};

/// A machine that moves is looked at so often.
const SLICE: Ticks = Ticks(Tick::PER_SECOND);

/// An answer that waits to be compared.
#[derive(Debug)]
pub(super) struct Held {
    pub(super) number: u64,
    pub(super) sequence: Sequence,
    pub(super) tick: Tick,
    pub(super) answer: Answer,
    pub(super) bytes: Vec<u8>,
}

impl Held {
    pub(super) fn begins_a_life(&self) -> bool {
        self.sequence == Sequence(0) && self.answer.about == About::Unasked(Occasion::Joined)
    }

    pub(super) fn unverifiable(&self, card: Address, why: Why) -> Unverifiable {
        Unverifiable { card, number: self.number, tick: self.tick, why }
    }

    fn is_bound(&self) -> bool {
        !matches!(self.answer.about, About::Unasked(Occasion::Changed | Occasion::Sampled))
    }

    fn different(self, card: Address, kind: DifferenceKind) -> Halt {
        Halt::Different(Box::new(Difference {
            number: self.number,
            tick: self.tick,
            recorded: Ok(frame_of(card, self.sequence, self.tick, self.answer)),
            bytes: self.bytes,
            kind,
        }))
    }
}

/// Why a card is not compared any further.
#[derive(Debug)]
pub(super) enum Halt {
    Different(Box<Difference>),
    Unverifiable(Unverifiable),
}

/// What a machine has said and the log has not been found to say yet.
#[derive(Debug, Default)]
struct Said(VecDeque<Answer>);

impl Sink for Said {
    fn answer(&mut self, answer: Answer) {
        self.0.push_back(answer);
    }
}

/// One life of a card's process.
#[derive(Debug)]
pub(super) struct Life {
    address: Address,
    card: Card,
    next: Sequence,
    /// When the last frame was sent, and when the card acted last.
    sent: Tick,
    acted: Tick,
    /// The number after that of the last frame of the CCU that it took.
    taken: Sequence,
    held: VecDeque<Held>,
    /// So many of those held, from the first one on, are the machine's own.
    own: usize,
    /// The last stimulus was that frames are missing.
    missed: bool,
    said: Said,
}

impl Life {
    pub(super) fn new(address: Address, card: Card) -> Self {
        Self {
            address,
            card,
            next: Sequence(0),
            sent: Tick(0),
            acted: Tick(0),
            taken: Sequence(0),
            held: VecDeque::new(),
            own: 0,
            missed: false,
            said: Said::default(),
        }
    }

    /// Takes the next answer in, if it can be the next one.
    pub(super) fn take(&mut self, held: Held) -> Result<(), Halt> {
        let Held { sequence, tick, answer, .. } = &held;
        let (got, expected) = (*sequence, self.next);
        if got != expected {
            let why = if got > expected { Why::Gap { expected, got } } else { Why::NoBeginning(got) };
            return Err(Halt::Unverifiable(held.unverifiable(self.address, why)));
        }
        if *tick < self.sent {
            return Err(held.different(self.address, DifferenceKind::SentBackwards(self.sent)));
        }
        if answer.acted_at > *tick {
            return Err(held.different(self.address, DifferenceKind::SentBeforeActing));
        }
        if answer.acted_at < self.acted {
            return Err(held.different(self.address, DifferenceKind::ActedBackwards(self.acted)));
        }
        (self.sent, self.acted, self.next) = (*tick, answer.acted_at, got.next());
        self.held.push_back(held);
        Ok(())
    }

    /// Whether it waits for a command that may still come.
    pub(super) fn waits(&self) -> bool {
        self.own < self.held.len()
    }

    /// Compares as much as can be compared by now. With `over`, nothing more comes.
    pub(super) fn run(
        &mut self,
        commands: &mut Commands,
        found: &mut Verification,
        over: bool,
    ) -> Result<(), Halt> {
        loop {
            self.own += self.held.iter().skip(self.own).take_while(|held| !held.is_bound()).count();
            let Some(bound) = self.held.get(self.own) else { return Ok(()) };
            let Answer { about, acted_at, .. } = bound.answer;
            if let About::Command(sequence, _) = about {
                match commands.sent(sequence) {
                    Some(sent) if sent <= acted_at => {}
                    Some(sent) => {
                        let Some(bound) = self.held.remove(self.own) else { return Ok(()) };
                        return Err(bound.different(self.address, DifferenceKind::ActedTooSoon(sent)));
                    }
                    None if !over && commands.may_come(sequence) => return Ok(()),
                    None => {
                        let why = Why::NoCommand(sequence);
                        return Err(Halt::Unverifiable(bound.unverifiable(self.address, why)));
                    }
                }
            }
            // The frame that shows that others are missing is taken at once.
            let at_once = std::mem::take(&mut self.missed) && acted_at == self.card.now();
            let there = at_once || self.bring_to(acted_at, self.own);
            match about {
                // The machine has said too much already, which shows below.
                _ if !there => {}
                About::Command(sequence, _) => self.obey(sequence, commands),
                About::Unasked(Occasion::Orphaned) => self.card.orphan(&mut self.said),
                About::Unasked(Occasion::Missed(frames)) => {
                    self.card.miss(frames, &mut self.said);
                    self.missed = true;
                }
                About::Unasked(occasion) => {
                    let answer = self.card.speak(occasion);
                    self.said.answer(answer);
                }
            }
            for _ in 0..=self.own {
                self.compare(found)?;
            }
            self.own = 0;
        }
    }

    /// Compares what is left when nothing more comes. The process may have been killed, or the log cut, so the machine
    /// may have more to say.
    pub(super) fn run_out(&mut self, commands: &mut Commands, found: &mut Verification) -> Result<(), Halt> {
        self.run(commands, found, true)?;
        let Some(last) = self.held.back() else { return Ok(()) };
        self.bring_to(last.answer.acted_at, self.held.len());
        if self.said.0.len() < self.held.len()
            && let Some(fault) = commands.fault(self.address, self.taken)
        {
            // What a fault causes is told before the fault itself is answered.
            self.obey(fault, commands);
        }
        while let Some(held) = self.held.front() {
            if self.said.0.is_empty() && commands.has_gaps() {
                return Err(Halt::Unverifiable(held.unverifiable(self.address, Why::CommandsMissing)));
            }
            self.compare(found)?;
        }
        Ok(())
    }

    /// Lets the machine's time pass, unless it says more than `most` by then: a tick that was changed in the log may lie
    /// years ahead. Returns whether it is there.
    fn bring_to(&mut self, to: Tick, most: usize) -> bool {
        loop {
            // Also when it is there already: what falls due with what it was told last is then done.
            let now = self.card.now();
            // A start may be set for years ahead, and until then nothing happens.
            let next = self.card.next_event().map_or(to, |event| to.min(event.max(now) + SLICE));
            self.card.advance(next, &mut self.said);
            if self.card.now() >= to {
                return true;
            }
            if self.said.0.len() > most {
                return false;
            }
        }
    }

    fn obey(&mut self, sequence: Sequence, commands: &mut Commands) {
        if let Some(frame) = commands.take(sequence) {
            self.card.take(&frame, &mut self.said);
            self.taken = sequence.next();
        }
    }

    /// Compares the first answer that is held with the first that the machine has said.
    fn compare(&mut self, found: &mut Verification) -> Result<(), Halt> {
        let (Some(held), said) = (self.held.pop_front(), self.said.0.pop_front()) else { return Ok(()) };
        let Some(said) = said else {
            return Err(held.different(self.address, DifferenceKind::Silence));
        };
        let frame = frame_of(self.address, held.sequence, held.tick, said);
        if frame.encode() != held.bytes {
            return Err(held.different(self.address, DifferenceKind::Answer(Box::new(frame))));
        }
        found.answers += 1;
        found.reached = found.reached.max(held.answer.acted_at);
        Ok(())
    }
}
