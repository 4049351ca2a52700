//! The dry run: a whole set in one process, in virtual time. The cards are the machines that the workers run, the bus
//! is the in-process carrier, the executive is the live one; only the clock is made up. It goes as fast as it can, and
//! two runs of one program are the same to the last pulse.

use std::io::{self, Write};
use std::mem;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axis_worker::clock::TimeScale;
use axis_worker::{AxisError, Card, Sink};
use supersigma_protocol::bus::in_process::{InProcessBus, InProcessReceive, InProcessTap, InProcessTransmit};
use supersigma_protocol::bus::{Bus, BusError, Receive, Tap, Transmit, Wake};
use supersigma_protocol::{
    About, Activity, Answer, AxisNumber, Body, Broadcast, Fault, Frame, Occasion, Position, Sender, Sequence,
    Tick, Ticks,
};

use crate::executive::{Common, Failure, Heard, Knowledge, Link};
use crate::log::{LogError, LogHeader, LogSummary, LogWriter, Rotation};
use crate::plot::Timing;

/// Where pulses go.
pub trait PulseWriter {
    /// Whether there is anything to write at all.
    const WANTED: bool;

    /// Takes one pulse; they come in the order of their ticks.
    ///
    /// # Errors
    /// If it cannot be written.
    fn pulse(&mut self, tick: Tick, axis: AxisNumber, position: Position) -> io::Result<()>;
}

/// Nobody wants pulses.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoPulses;

impl PulseWriter for NoPulses {
    const WANTED: bool = false;
    fn pulse(&mut self, _: Tick, _: AxisNumber, _: Position) -> io::Result<()> {
        Ok(())
    }
}

/// A line `tick,axis,position` a pulse, after a line of titles. The position is that of the carriage, in steps from the
/// point where its limit switch opens.
#[derive(Debug)]
pub struct PulseCsv<W>(W);

impl<W: Write> PulseCsv<W> {
    /// Begins the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn new(mut out: W) -> io::Result<Self> {
        writeln!(out, "tick,axis,position")?;
        Ok(Self(out))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// If what was buffered cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl<W: Write> PulseWriter for PulseCsv<W> {
    const WANTED: bool = true;
    fn pulse(&mut self, tick: Tick, axis: AxisNumber, position: Position) -> io::Result<()> {
        writeln!(self.0, "{},{},{}", tick.0, axis.get(), position.0)
    }
}

/// A set in virtual time.
pub struct DrySet<P> {
    knowledge: Arc<Knowledge>,
    common: Arc<Common>,
    now: Tick,
    transmit: InProcessTransmit,
    receive: InProcessReceive,
    sequence: Sequence,
    cards: Vec<Seat<P>>,
    pulses: P,
    log: Option<(InProcessTap, LogWriter)>,
    timing: Timing,
}

/// A card and its port.
#[derive(Debug)]
struct Seat<P> {
    card: Card,
    transmit: InProcessTransmit,
    receive: InProcessReceive,
    sequence: Sequence,
    said: Said<P>,
}

/// What a card has brought forth and nobody has taken yet.
#[derive(Debug)]
struct Said<P> {
    answers: Vec<Answer>,
    pulses: Vec<(Tick, Position)>,
    wanted: std::marker::PhantomData<P>,
}

impl<P: PulseWriter> Sink for Said<P> {
    const PULSES: bool = P::WANTED;
    fn answer(&mut self, answer: Answer) {
        self.answers.push(answer);
    }
    fn pulse(&mut self, tick: Tick, position: Position) {
        self.pulses.push((tick, position));
    }
}

/// Why a dry run cannot begin or end.
#[derive(Debug, thiserror::Error)]
pub enum DryError {
    /// An axis.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// The in-process bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
}

impl<P: PulseWriter> DrySet<P> {
    /// A set just switched on. Pulses go to `pulses`, and every frame to a log if one is named.
    ///
    /// # Errors
    /// If a ramp does not give a table, or the log cannot be made.
    pub fn new(
        knowledge: Arc<Knowledge>,
        pulses: P,
        log: Option<(&Path, LogHeader)>,
    ) -> Result<Self, DryError> {
        let bus = InProcessBus::new();
        let log = match log {
            Some((path, header)) => {
                let flush = Duration::from_millis(knowledge.config.log.flush_ms.into());
                let writer = LogWriter::create(path, header, flush)?;
                Some((bus.tap()?, writer.rotating(Rotation::from(&knowledge.config.log))))
            }
            None => None,
        };
        let mut timing = Timing::default();
        let (transmit, receive) = bus.ccu()?;
        let mut cards = Vec::new();
        for axis in &knowledge.config.axes {
            // Samples are for logs.
            let card = Card::axis(&knowledge.config, axis.address)?;
            cards.extend(card.map(|card| if log.is_some() { card } else { card.without_samples() }));
        }
        cards.push(Card::digital(&knowledge.config));
        let seats = cards.into_iter().map(|card| {
            let (transmit, receive) = bus.card(card.address())?;
            let said = Said { answers: vec![], pulses: vec![], wanted: std::marker::PhantomData };
            let mut seat = Seat { card, transmit, receive, sequence: Sequence(0), said };
            let joined = seat.card.speak(Occasion::Joined);
            seat.said.answers.push(joined);
            seat.flush(&mut timing)?;
            Ok(seat)
        });
        let cards = seats.collect::<Result<_, BusError>>()?;
        let common = Arc::default();
        Ok(Self {
            knowledge,
            common,
            now: Tick(0),
            transmit,
            receive,
            sequence: Sequence(0),
            cards,
            pulses,
            log,
            timing,
        })
    }

    /// What has taken how long, up to now.
    #[must_use]
    pub fn timing(&self) -> Timing {
        let mut timing = self.timing.clone();
        timing.close(self.now);
        timing
    }

    /// The virtual time.
    #[must_use]
    pub fn elapsed(&self) -> Ticks {
        self.now.since(Tick(0))
    }

    /// Ends the run: the pulses' writer, and what the log holds.
    ///
    /// # Errors
    /// If the log cannot be finished.
    pub fn finish(mut self) -> Result<(P, Option<LogSummary>), DryError> {
        for seat in &mut self.cards {
            let answer = seat.card.speak(Occasion::Leaving);
            seat.said.answers.push(answer);
            seat.flush(&mut self.timing)?;
        }
        self.log_frames()?;
        let summary = self.log.map(|(_, writer)| writer.finish()).transpose()?;
        Ok((self.pulses, summary))
    }

    /// Lets all cards hear what is on the bus, and puts on it what they say.
    fn exchange(&mut self) -> Result<(), Failure> {
        for seat in &mut self.cards {
            seat.card.advance(self.now, &mut seat.said);
            while let Some(received) = seat.receive.receive().map_err(Failure::bus_gone)? {
                if let Ok(frame) = Frame::decode(&received.bytes) {
                    seat.card.hear(&frame, &mut seat.said);
                }
            }
            seat.flush(&mut self.timing).map_err(Failure::bus_gone)?;
        }
        self.write_pulses()?;
        self.log_frames().map_err(Failure::bus_gone)
    }

    fn put(&mut self, body: Body) -> Result<Sequence, Failure> {
        let sequence = self.sequence;
        self.sequence = sequence.next();
        let frame = Frame { sender: Sender::Ccu, sequence, tick: self.now, body };
        self.timing.hear(&frame);
        self.transmit.send(&frame.encode(), Wake::Everyone).map_err(Failure::bus_gone)?;
        self.exchange()?;
        Ok(sequence)
    }

    fn write_pulses(&mut self) -> Result<(), Failure> {
        if !P::WANTED {
            return Ok(());
        }
        let mut pulses: Vec<(Tick, AxisNumber, Position)> = Vec::new();
        for seat in &mut self.cards {
            if let Some(axis) = seat.card.as_axis().map(axis_worker::Axis::number) {
                pulses
                    .extend(mem::take(&mut seat.said.pulses).into_iter().map(|(tick, at)| (tick, axis, at)));
            }
        }
        pulses.sort_by_key(|(tick, axis, _)| (*tick, *axis));
        for (tick, axis, position) in pulses {
            self.pulses
                .pulse(tick, axis, position)
                .map_err(|error| Failure::Pulses { reason: error.to_string() })?;
        }
        Ok(())
    }

    fn log_frames(&mut self) -> Result<(), DryError> {
        if let Some((tap, writer)) = &mut self.log {
            let now = self.now;
            tap.drain(&mut |lane, _, bytes| {
                // In one process nothing is lost, and the writer counts and logs gaps by itself.
                let _ = writer.record(lane, bytes, now);
            })?;
            writer.advance(now)?;
        }
        Ok(())
    }
}

impl<P> Seat<P> {
    fn flush(&mut self, timing: &mut Timing) -> Result<(), BusError> {
        for answer in self.said.answers.drain(..) {
            let frame = Frame {
                sender: Sender::Card(self.card.address()),
                sequence: self.sequence,
                tick: self.card.now(),
                body: Body::Answer(answer),
            };
            self.sequence = self.sequence.next();
            timing.hear(&frame);
            self.transmit.send(&frame.encode(), Wake::Everyone)?;
        }
        Ok(())
    }
}

impl<P: PulseWriter> Link for DrySet<P> {
    fn knowledge(&self) -> &Arc<Knowledge> {
        &self.knowledge
    }

    fn now(&self) -> Tick {
        self.now
    }

    fn ticks(&self, real: Duration) -> Ticks {
        TimeScale::REAL.ticks(real)
    }

    fn common(&self) -> Arc<Common> {
        Arc::clone(&self.common)
    }

    fn activity(&self, axis: AxisNumber) -> Option<Activity> {
        let mut machines = self.cards.iter().filter_map(|seat| seat.card.as_axis());
        machines.find(|one| one.number() == axis).map(axis_worker::Axis::activity)
    }

    /// Nobody else is there.
    fn tell_resume(&self) {}

    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        self.put(Body::Command(broadcast))
    }

    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure> {
        self.put(Body::Fault(axis, fault))
    }

    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        loop {
            if let Some(received) = self.receive.receive().map_err(Failure::bus_gone)? {
                let frame = Frame::decode(&received.bytes).map_err(Failure::bus_gone)?;
                let Body::Answer(answer) = frame.body else { continue };
                if answer.about == About::Unasked(Occasion::Sampled) {
                    continue;
                }
                return Ok(Some(Heard::Answer(answer)));
            }
            if self.now >= until {
                return Ok(None);
            }
            let next = self.cards.iter().filter_map(|seat| seat.card.next_news()).min();
            self.now = next.map_or(until, |next| next.clamp(self.now, until));
            self.exchange()?;
        }
    }
}
