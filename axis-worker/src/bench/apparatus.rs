//! The apparatus: everything on the board, advanced from event to event. An event is a pulse, a sample, or a look at the
//! encoder's edges in between, so often that a swing cannot turn unseen.

use std::ops::ControlFlow;

use supersigma_config::{MotorConfig, MotorError};
use supersigma_protocol::{Direction, Tick, Ticks};

use super::confirmation::{Confirmation, Confirmed, Place};
use super::counters::{Counters, Reading};
use super::sampling::Sampling;
use super::timing::{Periods, Train};
use super::units::{Period, TICKS_PER_CLOCK};
use crate::motor::{Counts, Encoder, PATIENCE, Rotor, SenseDiscriminator};

/// The time between two looks at most: 20 µs.
const LOOK: Ticks = Ticks(40);

/// A pulse of channel 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pulse {
    /// From 1.
    pub number: u64,
    /// When; the train begins at 0.
    pub at: Tick,
    /// The period that ends with it.
    pub period: Period,
}

/// What the interrupt reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// From 0.
    pub number: u64,
    /// When; the train begins at 0.
    pub at: Tick,
    /// Pulses on L since the beginning.
    pub l: u64,
    /// Pulses on R.
    pub r: u64,
    /// Pulses given to the motor, negative towards the origin.
    pub commanded: i64,
    /// The period that ended with the last of them; `None` before the first.
    pub period: Option<Period>,
}

impl Sample {
    /// L less R: 1/8000 turns with a disc of 2 000 lines.
    #[must_use]
    pub fn position(&self) -> Counts {
        Reading { l: self.l, r: self.r }.position()
    }
}

/// Who is told of a run as it goes. Nothing of it is kept here.
pub trait Observer {
    /// A pulse was given.
    fn pulse(&mut self, _pulse: Pulse) {}

    /// A sample was taken. The run ends early with [`ControlFlow::Break`].
    fn sample(&mut self, sample: Sample) -> ControlFlow<()>;
}

/// What came of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// TEST-NS.
    pub confirmed: Confirmed,
    /// Pulses on L.
    pub l: u64,
    /// Pulses on R.
    pub r: u64,
    /// How often the sense of rotation changed.
    pub reversals: u64,
    /// How often the discriminator saw both signals change in one clock; the counts are wrong from then on.
    pub illegal: u64,
    /// Samples taken.
    pub samples: u64,
    /// When the last pulse was given.
    pub last_pulse: Tick,
    /// When the run ended, with the rotor at rest if nobody ended it before.
    pub ended: Tick,
    /// Whether the rotor was at rest then; if not, the confirmation is of where it just was.
    pub at_rest: bool,
    /// Whether the observer ended it.
    pub interrupted: bool,
}

/// A motor with its load and its encoder, the discriminator and the 8253; at rest, with all counters at 0.
#[derive(Debug, Clone)]
pub struct Bench {
    rotor: Rotor,
    encoder: Encoder,
    discriminator: SenseDiscriminator,
    counters: Counters,
    confirmation: Confirmation,
    now: Tick,
    /// The clock at which the discriminator has last taken its signals.
    looked: u64,
}

impl Bench {
    /// The bench with this motor, its load included.
    ///
    /// # Errors
    /// If such a motor cannot be.
    pub fn new(motor: &MotorConfig) -> Result<Self, MotorError> {
        let rotor = Rotor::standing(motor)?;
        let encoder = Encoder::new(motor, rotor.motion().half_steps);
        Ok(Self {
            discriminator: SenseDiscriminator::new(encoder.levels()),
            rotor,
            encoder,
            counters: Counters::new(),
            confirmation: Confirmation::new(motor),
            now: Tick(0),
            looked: 0,
        })
    }

    /// Runs a train and waits until the rotor is at rest. The bench is used up by it.
    pub fn run(
        mut self,
        train: &Train,
        direction: Direction,
        sampling: Sampling,
        observer: &mut impl Observer,
    ) -> Outcome {
        let mut queue = Queue::new(train.periods());
        if let Some(first) = queue.current {
            self.counters.start(first, queue.next);
        }
        let sign = if direction == Direction::Forward { 1 } else { -1 };
        let (mut given, mut period, mut last_pulse, mut samples) = (0_u64, None, Tick(0), 0_u64);
        loop {
            let pulse_at = self.counters.next_pulse();
            let sample_at = sampling.tick_of(samples);
            let event = pulse_at.map_or(sample_at, |pulse| pulse.min(sample_at));
            self.advance(event);
            if pulse_at == Some(event)
                && let Some(ended) = queue.current
            {
                self.rotor.pulse(direction);
                queue.advance();
                self.counters.pulse(queue.current.is_some(), queue.next);
                given += 1;
                (period, last_pulse) = (Some(ended), event);
                observer.pulse(Pulse { number: given, at: event, period: ended });
            }
            if event < sample_at {
                continue;
            }
            let Reading { l, r } = self.counters.read();
            let commanded = sign * given.cast_signed();
            let sample = Sample { number: samples, at: event, l, r, commanded, period };
            samples += 1;
            self.confirmation.see(commanded, sample.position(), Place { pulse: given, at: event, period });
            let interrupted = observer.sample(sample).is_break();
            let at_rest = queue.current.is_none() && self.rotor.is_at_rest();
            let impatient = queue.current.is_none() && event.since(last_pulse) > PATIENCE;
            if interrupted || at_rest || impatient {
                return Outcome {
                    confirmed: self.confirmation.finish(commanded, sample.position()),
                    l,
                    r,
                    reversals: self.discriminator.reversals(),
                    illegal: self.discriminator.illegal(),
                    samples,
                    last_pulse,
                    ended: event,
                    at_rest,
                    interrupted,
                };
            }
        }
    }

    /// Lets time pass, with a look at the encoder now and then, and at the end.
    fn advance(&mut self, until: Tick) {
        while self.now < until {
            let left = until.since(self.now);
            let span = if self.rotor.is_at_rest() { left } else { left.min(LOOK) };
            self.rotor.advance(span);
            self.now += span;
            self.look();
        }
    }

    /// The discriminator takes its signals once a clock. The edges since the last look lie evenly in time; where there are
    /// several in a clock, it sees only what is left after the last of them, as the real one would.
    fn look(&mut self) {
        let clock = self.now.0 / TICKS_PER_CLOCK;
        let clocks = clock - self.looked;
        if clocks == 0 {
            return;
        }
        self.looked = clock;
        let passed = self.encoder.turn_to(self.rotor.motion().half_steps);
        let edges = passed.edges();
        for (edge, levels) in (1..).zip(passed) {
            let clock_of = |edge: u64| (edge * clocks).div_ceil(edges);
            let is_overtaken = edge < edges && clock_of(edge + 1) == clock_of(edge);
            if !is_overtaken && let Some(sense) = self.discriminator.sample(levels) {
                self.counters.count(sense);
            }
        }
    }
}

/// The period under way and the one after it, which the chip has already.
#[derive(Debug, Clone)]
struct Queue {
    current: Option<Period>,
    next: Option<Period>,
    rest: Periods,
}

impl Queue {
    fn new(mut rest: Periods) -> Self {
        Self { current: rest.next(), next: rest.next(), rest }
    }

    fn advance(&mut self) {
        self.current = self.next;
        self.next = self.rest.next();
    }
}
