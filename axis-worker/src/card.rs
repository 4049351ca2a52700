//! One card as the bus sees it: frames in, answers out. Whether it is called at all, and when, is the shell's business;
//! the worker process, the dry run and the tests drive this very type.

use supersigma_config::Config;
use supersigma_protocol::{
    About, Address, Alarm, Answer, AxisNumber, Body, Broadcast, CardKind, Command, Frame, Occasion, Refusal,
    Report, Sender, Sequence, Tick, Ticks,
};

use crate::axis::{Axis, AxisError};
use crate::board::Sink;
use crate::digital::Digital;

/// Ticks in a millisecond of machine time.
const TICKS_PER_MS: u64 = Tick::PER_SECOND / 1_000;

/// A motor card, or the two digital cards that share a process.
#[derive(Debug)]
pub struct Card {
    kind: Kind,
    /// The sequence number that the CCU's next frame must have.
    expected: Option<Sequence>,
    /// From one sample of a moving axis to the next; samples lie on multiples of it, whoever moves when.
    sampling: Option<Ticks>,
}

#[derive(Debug)]
enum Kind {
    Axis(Box<Axis>),
    Digital(Digital),
}

impl Card {
    /// The motor card `number` of a set; `None` if the set has none.
    ///
    /// # Errors
    /// If the axis cannot be made of its configuration.
    pub fn axis(config: &Config, number: AxisNumber) -> Result<Option<Self>, AxisError> {
        config
            .axis(number)
            .map(|axis| {
                let axis = Axis::new(axis, config.ramp_of(axis))?;
                let period = Ticks(u64::from(config.log.sample_ms) * TICKS_PER_MS);
                let sampling = Some(period).filter(|period| *period > Ticks(0));
                Ok(Self { kind: Kind::Axis(Box::new(axis)), expected: None, sampling })
            })
            .transpose()
    }

    /// The digital cards of a set.
    #[must_use]
    pub fn digital(config: &Config) -> Self {
        Self { kind: Kind::Digital(Digital::new(&config.digital)), expected: None, sampling: None }
    }

    /// The same card, which says nothing while it moves but what changes.
    #[must_use]
    pub fn without_samples(self) -> Self {
        Self { sampling: None, ..self }
    }

    /// The address under which it sends.
    #[must_use]
    pub fn address(&self) -> Address {
        match &self.kind {
            Kind::Axis(axis) => axis.number().address(),
            Kind::Digital(_) => Address::DIGITAL_INPUT,
        }
    }

    /// The motor card's machine.
    #[must_use]
    pub fn as_axis(&self) -> Option<&Axis> {
        match &self.kind {
            Kind::Axis(axis) => Some(axis),
            Kind::Digital(_) => None,
        }
    }

    /// The time that it has reached.
    #[must_use]
    pub fn now(&self) -> Tick {
        match &self.kind {
            Kind::Axis(axis) => axis.now(),
            Kind::Digital(digital) => digital.now(),
        }
    }

    /// The next tick at which anything happens by itself.
    #[must_use]
    pub fn next_event(&self) -> Option<Tick> {
        match &self.kind {
            Kind::Axis(axis) => {
                let event = axis.next_event()?;
                let sample = self.next_sample().filter(|_| axis.is_under_way());
                Some(sample.map_or(event, |sample| event.min(sample)))
            }
            Kind::Digital(digital) => digital.next_event(),
        }
    }

    /// The next tick at which it may have something to say by itself; all that happens before goes unnoticed. It may turn
    /// out that it has nothing to say then.
    #[must_use]
    pub fn next_news(&self) -> Option<Tick> {
        match &self.kind {
            Kind::Axis(axis) => {
                let news = axis.next_news()?;
                let sample = self.next_sample().filter(|_| axis.is_under_way());
                Some(sample.map_or(news, |sample| news.min(sample)))
            }
            Kind::Digital(digital) => digital.next_event(),
        }
    }

    /// Lets time pass up to and including `to`.
    pub fn advance(&mut self, to: Tick, sink: &mut impl Sink) {
        while let Some(sample) = self.next_sample().filter(|sample| *sample <= to) {
            let Kind::Axis(axis) = &mut self.kind else { break };
            axis.advance(sample, sink);
            if axis.is_under_way() {
                let answer = self.speak(Occasion::Sampled);
                sink.answer(answer);
            }
        }
        match &mut self.kind {
            Kind::Axis(axis) => axis.advance(to, sink),
            Kind::Digital(digital) => digital.advance(to, sink),
        }
    }

    /// The next tick at which an axis may have to be sampled; `None` while nothing happens by itself.
    fn next_sample(&self) -> Option<Tick> {
        let (Kind::Axis(axis), Some(period)) = (&self.kind, self.sampling) else { return None };
        let event = axis.next_event()?;
        // A start may be set for years ahead, and until then there is nothing to sample.
        let last =
            if axis.is_under_way() { axis.now() } else { axis.now().max(Tick(event.0.saturating_sub(1))) };
        Some(Tick((last.0 / period.0 + 1).saturating_mul(period.0)))
    }

    /// Hears a frame, now. Every card hears every frame of the CCU; a card answers those that are for it, and if it
    /// has missed some, an axis brakes: nobody knows what they would have said.
    pub fn hear(&mut self, frame: &Frame, sink: &mut impl Sink) {
        if frame.sender != Sender::Ccu {
            return;
        }
        if let Some(missing) = self.missing_before(frame.sequence) {
            self.miss(missing, sink);
        }
        self.take(frame, sink);
    }

    /// Carries out a frame of the CCU, now, if it is for this card, and answers it; what came before it does not matter.
    pub fn take(&mut self, frame: &Frame, sink: &mut impl Sink) {
        let (address, result) = match &frame.body {
            Body::Command(broadcast) => {
                let Some(address) = self.concerned(broadcast) else { return };
                (address, self.obey(broadcast, sink))
            }
            Body::Fault(number, fault) => match &mut self.kind {
                Kind::Axis(axis) if axis.number() == *number => {
                    axis.fail(*fault, sink);
                    (number.address(), Ok(()))
                }
                _ => return,
            },
            Body::Answer(_) => return,
        };
        let answer = self.answer(address, About::Command(frame.sequence, result));
        sink.answer(answer);
    }

    /// Takes note, now, that so many of the CCU's frames never came here: says so, and brakes.
    pub fn miss(&mut self, frames: u32, sink: &mut impl Sink) {
        let answer = self.speak(Occasion::Missed(frames));
        sink.answer(answer);
        self.emergency(Alarm::FramesLost(frames), sink);
    }

    /// Takes note, now, that the CCU is gone: says so, and brakes.
    pub fn orphan(&mut self, sink: &mut impl Sink) {
        let answer = self.speak(Occasion::Orphaned);
        sink.answer(answer);
        self.emergency(Alarm::CcuLost, sink);
    }

    fn obey(&mut self, broadcast: &Broadcast, sink: &mut impl Sink) -> Result<(), Refusal> {
        match Command::decode(broadcast.bytes.as_slice()) {
            Ok(command) => self.carry_out(command, broadcast.at, sink),
            Err(refusal) => Err(refusal),
        }
    }

    fn emergency(&mut self, alarm: Alarm, sink: &mut impl Sink) {
        if let Kind::Axis(axis) = &mut self.kind {
            axis.emergency(alarm, sink);
        }
    }

    /// An unasked answer with the state now.
    pub fn speak(&mut self, occasion: Occasion) -> Answer {
        self.answer(self.address(), About::Unasked(occasion))
    }

    fn answer(&mut self, address: Address, about: About) -> Answer {
        let report = match &mut self.kind {
            Kind::Axis(axis) => Report::Axis(axis.report()),
            Kind::Digital(digital) => digital.report(address),
        };
        Answer { card: address, about, acted_at: self.now(), report }
    }

    fn carry_out(&mut self, command: Command, at: Option<Tick>, sink: &mut impl Sink) -> Result<(), Refusal> {
        match &mut self.kind {
            Kind::Axis(axis) => axis.deliver(command, at, sink),
            Kind::Digital(digital) => digital.deliver(command),
        }
    }

    /// How many of the CCU's frames are missing before `sequence`.
    fn missing_before(&mut self, sequence: Sequence) -> Option<u32> {
        let expected = self.expected.replace(sequence.next())?;
        let new_life = sequence == Sequence(0);
        let missing = if new_life { 0 } else { sequence.0.saturating_sub(expected.0) };
        u32::try_from(missing).ok().filter(|missing| *missing > 0)
    }

    /// The address, of those that this process plays, that a command is for.
    fn concerned(&self, broadcast: &Broadcast) -> Option<Address> {
        let address = Address(*broadcast.bytes.as_slice().first()?);
        match (&self.kind, address.kind()) {
            (Kind::Axis(axis), CardKind::Everyone) => Some(axis.number().address()),
            (Kind::Axis(axis), CardKind::Axis(number)) => (axis.number() == number).then_some(address),
            (Kind::Digital(_), CardKind::DigitalInput | CardKind::DigitalOutput) => Some(address),
            _ => None,
        }
    }
}
