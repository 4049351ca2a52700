//! The log run again: the recorded commands, at the recorded ticks, given to fresh machines, and every answer compared
//! with what those machines say. Pure: it takes frames and a configuration, and knows no file, no clock and no bus.
//!
//! ```text
//!   CCU's frames ──► commands by number ───┐ take(frame)
//!                                          ▼
//!   a card's answers ──► life ──► advance(acted_at) ──► fresh Card ──► what it says
//!        │                                                                  │
//!        └────────────────── encode, compare byte for byte ◄────────────────┘
//! ```
//!
//! That works because nothing reaches a card but what is on the bus: the CCU's frames, and what the card itself tells of:
//! that frames are missing, that the CCU is gone. Each answer is bound to such a stimulus, or the machine brings it forth
//! by itself; see `life`.

mod commands;
mod life;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use axis_worker::{AxisError, Card};
use supersigma_config::Config;
use supersigma_protocol::{
    Address, Answer, Body, CardKind, Frame, FrameError, Sender, Sequence, Tick, Ticks,
};

use self::commands::Commands;
use self::life::{Halt, Held, Life};
use crate::log::{AxisNames, LogError, Twinned, twin_of};

/// What a verification needs besides the frames.
#[derive(Debug, Clone, Copy)]
pub struct Setting<'a> {
    /// Of what the machines are made.
    pub config: &'a Config,
    /// The axes' names in the twins.
    pub names: &'a AxisNames,
    /// Whether the frames come with their twins, which are then compared too.
    pub twins: bool,
}

/// What a verification has found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verification {
    /// Frames read.
    pub frames: u64,
    /// Bytes on the bus that were no frame, which nobody understood.
    pub undecodable: u64,
    /// Answers that are what the machines say.
    pub answers: u64,
    /// Cards that have spoken.
    pub cards: usize,
    /// Lives of these cards: a process that is started anew is a new machine.
    pub lives: u64,
    /// The last tick at which a card acted.
    pub reached: Tick,
    /// Where the log and the machines disagree first; nothing was compared after that.
    pub difference: Option<Difference>,
    /// Cards that could not be verified to their end.
    pub unverifiable: Vec<Unverifiable>,
}

impl Verification {
    /// Every answer is what the machines say.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.difference.is_none() && self.unverifiable.is_empty()
    }

    /// The machine time that was run through.
    #[must_use]
    pub fn machine_time(&self) -> Ticks {
        self.reached.since(Tick(0))
    }
}

/// A frame that is not what it should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Its place among the log's frames; the first one is 1.
    pub number: u64,
    /// The frame's tick; of the frame before it if it has none.
    pub tick: Tick,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The frame in them.
    pub recorded: Result<Frame, FrameError>,
    /// What is wrong with it.
    pub kind: DifferenceKind,
}

/// What is wrong with a frame.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DifferenceKind {
    /// The machine says something else.
    #[error("the machine says something else")]
    Answer(Box<Frame>),
    /// The machine says nothing.
    #[error("the machine says nothing like it")]
    Silence,
    /// The twin beside it tells of another frame.
    #[error("the raw frame and its JSON twin are not of the same frame")]
    Twin {
        /// The twin in the log.
        recorded: String,
        /// The twin that belongs to the frame, if it decodes.
        due: Option<String>,
    },
    /// The twin is not there.
    #[error("the JSON twin of the frame is missing")]
    NoTwin,
    /// A card acts, then speaks.
    #[error("it was sent before the card acted")]
    SentBeforeActing,
    /// The frames of one sender are in the order of their ticks.
    #[error("it was sent before the one that its sender sent before it ({0})")]
    SentBackwards(Tick),
    /// A card acts when the command has been sent.
    #[error("the card acted before the command was sent that it answers ({0})")]
    ActedTooSoon(Tick),
    /// A card's time does not run backwards.
    #[error("the card acted before it did what it has told already ({0})")]
    ActedBackwards(Tick),
}

/// Why a card cannot be verified from some point on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unverifiable {
    /// The card's process.
    pub card: Address,
    /// The first frame that could not be verified.
    pub number: u64,
    /// When that frame was sent.
    pub tick: Tick,
    /// Why.
    pub why: Why,
}

/// Why nothing can be said about a frame and those after it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Why {
    /// The log does not have what the card said before.
    #[error("{} of its frames are missing before #{}", .got.0 - .expected.0, .got.0)]
    Gap {
        /// The number that was due.
        expected: Sequence,
        /// The one that came.
        got: Sequence,
    },
    /// The beginning of a life is not in the log.
    #[error("the beginning is missing: its first frame has the number #{}", .0.0)]
    NoBeginning(Sequence),
    /// The log does not have what the card was told.
    #[error("command #{} that it answers is not in the log", .0.0)]
    NoCommand(Sequence),
    /// What has caused it may be one of the CCU's frames that are missing.
    #[error("frames of the CCU are missing from the log, and one of them may be what it tells of")]
    CommandsMissing,
    /// The log's configuration has no such card.
    #[error("the log's configuration has no such card")]
    NoSuchCard,
}

/// Why a verification cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A machine cannot be made of the log's configuration.
    #[error("{0} of the log's configuration cannot be made: {1}")]
    Axis(Address, #[source] AxisError),
}

/// Compares every frame of a log with what fresh machines say. Ends at the first difference, or with the frames.
///
/// # Errors
/// If the log cannot be read, or no machine can be made.
pub fn verify<E>(
    setting: &Setting<'_>,
    frames: impl IntoIterator<Item = Result<Twinned, E>>,
) -> Result<Verification, ReplayError>
where
    ReplayError: From<E>,
{
    let mut verifier = Verifier::new(*setting);
    for twinned in frames {
        if !verifier.take(twinned?)? {
            break;
        }
    }
    Ok(verifier.finish())
}

/// A verification under way, for whoever wants to see how far it is.
#[derive(Debug)]
pub struct Verifier<'a> {
    setting: Setting<'a>,
    commands: Commands,
    cards: BTreeMap<Address, Seat>,
    ccu_tick: Tick,
    last_tick: Tick,
    /// The twin that is being compared; kept to reuse its memory.
    twin: Vec<u8>,
    found: Verification,
}

/// A card's process.
#[derive(Debug, Default)]
struct Seat {
    /// `None` from a point on after which it cannot be verified, until it is started anew.
    life: Option<Life>,
}

impl<'a> Verifier<'a> {
    /// Before the first frame.
    #[must_use]
    pub fn new(setting: Setting<'a>) -> Self {
        Self {
            commands: Commands::new(setting.config),
            setting,
            cards: BTreeMap::new(),
            ccu_tick: Tick(0),
            last_tick: Tick(0),
            twin: Vec::new(),
            found: Verification::default(),
        }
    }

    /// What has been found so far.
    #[must_use]
    pub fn found(&self) -> &Verification {
        &self.found
    }

    /// Takes the next frame of the log. Returns whether it makes sense to go on.
    ///
    /// # Errors
    /// If a machine cannot be made.
    pub fn take(&mut self, twinned: Twinned) -> Result<bool, ReplayError> {
        let Twinned { number, logged, twin } = twinned;
        self.found.frames += 1;
        if self.setting.twins
            && let Some(kind) = self.wrong_twin(&logged.frame, &logged.bytes, twin.as_deref())
        {
            return Ok(self.differs(number, logged.bytes, logged.frame, kind));
        }
        let Ok(frame) = logged.frame else {
            self.found.undecodable += 1;
            return Ok(true);
        };
        self.last_tick = frame.tick;
        match (frame.sender, &frame.body) {
            (Sender::Ccu, Body::Command(_) | Body::Fault(..)) => {
                if frame.tick < self.ccu_tick {
                    let kind = DifferenceKind::SentBackwards(self.ccu_tick);
                    return Ok(self.differs(number, logged.bytes, Ok(frame), kind));
                }
                self.ccu_tick = frame.tick;
                self.commands.note(frame);
                // Whoever has answered it already can go on.
                Ok(self.run())
            }
            (Sender::Card(card), &Body::Answer(answer)) => {
                let held =
                    Held { number, sequence: frame.sequence, tick: frame.tick, answer, bytes: logged.bytes };
                self.hear(card, held)
            }
            // A card that commands, or a CCU that answers: nobody listens to that.
            _ => {
                self.found.undecodable += 1;
                Ok(true)
            }
        }
    }

    /// Verifies what is left when there are no more frames.
    #[must_use]
    pub fn finish(mut self) -> Verification {
        if self.found.difference.is_none() {
            self.run_out();
        }
        self.found
    }

    fn wrong_twin(
        &mut self,
        frame: &Result<Frame, FrameError>,
        bytes: &[u8],
        recorded: Option<&[u8]>,
    ) -> Option<DifferenceKind> {
        let (due, names) = (&mut self.twin, self.setting.names);
        let has_one = frame.as_ref().is_ok_and(|frame| twin_of(frame, bytes, names, due).is_some());
        match recorded {
            None if has_one => Some(DifferenceKind::NoTwin),
            None => None,
            Some(recorded) if has_one && recorded == due.as_slice() => None,
            Some(recorded) => Some(DifferenceKind::Twin {
                recorded: String::from_utf8_lossy(recorded).into_owned(),
                due: has_one.then(|| String::from_utf8_lossy(due).into_owned()),
            }),
        }
    }

    fn differs(
        &mut self,
        number: u64,
        bytes: Vec<u8>,
        recorded: Result<Frame, FrameError>,
        kind: DifferenceKind,
    ) -> bool {
        let tick = recorded.as_ref().map_or(self.last_tick, |frame| frame.tick);
        self.found.difference = Some(Difference { number, tick, bytes, recorded, kind });
        false
    }

    fn hear(&mut self, card: Address, held: Held) -> Result<bool, ReplayError> {
        if !self.cards.contains_key(&card) {
            self.found.cards += 1;
        }
        let known = self.cards.entry(card).or_default();
        if held.begins_a_life() {
            // What the last life has left unsaid is compared as far as it goes.
            let before = known.life.take();
            if let Some(mut life) = before
                && let Err(halt) = life.run_out(&mut self.commands, &mut self.found)
                && !self.stop(card, halt)
            {
                return Ok(false);
            }
            let Some(machine) = self.machine(card)? else {
                self.found.unverifiable.push(held.unverifiable(card, Why::NoSuchCard));
                return Ok(true);
            };
            self.found.lives += 1;
            self.cards.entry(card).or_default().life = Some(Life::new(card, machine));
        }
        let seat = self.cards.entry(card).or_default();
        let Some(life) = &mut seat.life else {
            if !self.found.unverifiable.iter().any(|one| one.card == card) {
                let why = Why::NoBeginning(held.sequence);
                self.found.unverifiable.push(held.unverifiable(card, why));
            }
            return Ok(true);
        };
        let result = match life.take(held) {
            Ok(()) => life.run(&mut self.commands, &mut self.found, false),
            // What stands before a gap is still the machine's.
            Err(Halt::Unverifiable(gap)) => {
                life.run_out(&mut self.commands, &mut self.found).and(Err(Halt::Unverifiable(gap)))
            }
            Err(halt) => Err(halt),
        };
        Ok(result.map_or_else(|halt| self.stop(card, halt), |()| true))
    }

    /// Cards that had to wait for a command.
    fn run(&mut self) -> bool {
        let waiting: Vec<Address> = self
            .cards
            .iter()
            .filter(|(_, seat)| seat.life.as_ref().is_some_and(Life::waits))
            .map(|(card, _)| *card)
            .collect();
        for card in waiting {
            let Some(life) = self.cards.get_mut(&card).and_then(|seat| seat.life.as_mut()) else { continue };
            if let Err(halt) = life.run(&mut self.commands, &mut self.found, false)
                && !self.stop(card, halt)
            {
                return false;
            }
        }
        true
    }

    fn run_out(&mut self) {
        for card in self.cards.keys().copied().collect::<Vec<_>>() {
            let Some(life) = self.cards.get_mut(&card).and_then(|seat| seat.life.as_mut()) else { continue };
            if let Err(halt) = life.run_out(&mut self.commands, &mut self.found)
                && !self.stop(card, halt)
            {
                return;
            }
        }
    }

    /// Returns whether the others can go on.
    fn stop(&mut self, card: Address, halt: Halt) -> bool {
        match halt {
            Halt::Unverifiable(unverifiable) => {
                if let Some(seat) = self.cards.get_mut(&card) {
                    seat.life = None;
                }
                self.found.unverifiable.push(unverifiable);
                true
            }
            Halt::Different(difference) => {
                self.found.difference = Some(*difference);
                false
            }
        }
    }

    fn machine(&self, card: Address) -> Result<Option<Card>, ReplayError> {
        match card.kind() {
            CardKind::Axis(number) => {
                Card::axis(self.setting.config, number).map_err(|error| ReplayError::Axis(card, error))
            }
            CardKind::DigitalInput => Ok(Some(Card::digital(self.setting.config))),
            _ => Ok(None),
        }
    }
}

/// The frame that a card with this answer would have put on the bus.
fn frame_of(card: Address, sequence: Sequence, tick: Tick, answer: Answer) -> Frame {
    Frame { sender: Sender::Card(card), sequence, tick, body: Body::Answer(answer) }
}
