//! The card's hardware as the firmware sees it: the 8253, the two wires to the motor (pulses and sense of rotation),
//! the detectors, and the time. It obeys; it decides nothing.

use std::num::{NonZeroU32, NonZeroU64};

use supersigma_protocol::{Answer, Count, Direction, Position, Tick, Ticks};

use crate::mechanism::{Detectors, Mechanism};
use crate::pit8253::{CounterId, Mode, Pit8253};

/// Where everything goes that an axis brings forth.
pub trait Sink {
    /// Whether every pulse and every count is wanted: then each is visited. If not, [`Sink::pulse`] and [`Sink::load`] are
    /// called for some of them, or none.
    const PULSES: bool = false;

    /// The card says something on the bus.
    fn answer(&mut self, answer: Answer);

    /// The firmware wrote `count` to counter 0.
    fn load(&mut self, tick: Tick, count: Count) {
        let _ = (tick, count);
    }

    /// OUT0 fell; the carriage is now at `position`, steps from where the limit switch opens.
    fn pulse(&mut self, tick: Tick, position: Position) {
        let _ = (tick, position);
    }
}

impl Sink for Vec<Answer> {
    fn answer(&mut self, answer: Answer) {
        self.push(answer);
    }
}

/// 8253, motor and detectors of one card, at one tick.
#[derive(Debug, Clone)]
pub struct Board {
    now: Tick,
    pit: Pit8253,
    mechanism: Mechanism,
    direction: Direction,
}

impl Board {
    /// A card just switched on, at tick 0.
    #[must_use]
    pub fn new(mechanism: Mechanism) -> Self {
        let mut pit = Pit8253::new();
        pit.set_gate(CounterId::Zero, false);
        pit.set_gate(CounterId::One, true);
        pit.set_gate(CounterId::Two, false);
        Self { now: Tick(0), pit, mechanism, direction: Direction::Forward }
    }

    /// The time that the card has reached.
    #[must_use]
    pub fn now(&self) -> Tick {
        self.now
    }

    /// What the detectors say.
    #[must_use]
    pub fn detectors(&self) -> Detectors {
        self.mechanism.detectors()
    }

    /// The motor and the rail.
    #[must_use]
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    /// The sense wire of the motor.
    pub(crate) fn set_direction(&mut self, direction: Direction) {
        self.direction = direction;
    }

    /// Gets both step counters ready for a movement of `total` steps, with OUT0 silent.
    ///
    /// Counter 2 is a one-shot, triggered here: OUT2 falls with the first step. In a movement of one or two steps it
    /// rises again with the second, and that is all the counting there is. In a longer one it stays low, which says
    /// that counter 1 has taken over its count and may be read. See [`crate::pit8253`] for the chip's rule behind this.
    pub(crate) fn arm_step_counters(&mut self, total: u32) {
        self.pit.set_gate(CounterId::Zero, false);
        self.pit.program(CounterId::One, Mode::RateGenerator, Count(0));
        self.pit.set_gate(CounterId::Two, false);
        self.pit.program(CounterId::Two, Mode::OneShot, Count(u16::from(total <= 2)));
        self.pit.set_gate(CounterId::Two, true);
    }

    /// Steps of this movement, by counter 1: right from the first step of a movement of three or more.
    pub(crate) fn read_long_counter(&mut self) -> u32 {
        if self.pit.output(CounterId::Two) {
            return 0;
        }
        u32::from(self.pit.latch_and_read(CounterId::One).wrapping_neg()) + 1
    }

    /// OUT2: low from the first step of a movement of one or two to the second.
    pub(crate) fn first_of_two(&self) -> bool {
        !self.pit.output(CounterId::Two)
    }

    /// Programs counter 0 as a rate generator; the first pulse comes `count` ticks after the gate has been opened.
    pub(crate) fn program_rate(&mut self, count: Count, sink: &mut impl Sink) {
        self.pit.program(CounterId::Zero, Mode::RateGenerator, count);
        sink.load(self.now, count);
    }

    /// Writes a count to counter 0; it rules from the end of the running period on.
    pub(crate) fn load_rate(&mut self, count: Count, sink: &mut impl Sink) {
        self.pit.load(CounterId::Zero, count);
        sink.load(self.now, count);
    }

    /// GATE0: high lets counter 0 count, low stops it; a rising edge begins a new period.
    pub(crate) fn gate_rate(&mut self, open: bool) {
        self.pit.set_gate(CounterId::Zero, open);
    }

    /// Where the encoder says that the shaft is now, in steps; `None` without one.
    pub(crate) fn measure(&mut self) -> Option<i64> {
        self.mechanism.measure(self.now)
    }

    /// Where faults are made on purpose.
    pub(crate) fn mechanism_mut(&mut self) -> &mut Mechanism {
        &mut self.mechanism
    }

    /// Lets time pass until `until`, or until the tick at which a detector changes; says whether one did.
    pub(crate) fn run(&mut self, until: Tick, sink: &mut impl Sink) -> bool {
        if self.mechanism.has_rotor() {
            return self.run_with_rotor(until, sink);
        }
        let change = self.next_change().filter(|change| *change <= until);
        let pulses = self.clock(change.unwrap_or(until), sink);
        self.mechanism.step(self.direction, pulses, self.now);
        change.is_some()
    }

    /// The same pulse by pulse: what a rotor makes of one is seen only afterwards.
    fn run_with_rotor(&mut self, until: Tick, sink: &mut impl Sink) -> bool {
        let before = self.mechanism.detectors();
        loop {
            let pulse = self.pit.clocks_until_falling(CounterId::Zero, NonZeroU64::MIN);
            let pulse = pulse.map(|clocks| self.now + Ticks(clocks)).filter(|pulse| *pulse <= until);
            let look = self.mechanism.next_look(self.now).filter(|look| *look <= until);
            let Some(next) = pulse.into_iter().chain(look).min() else {
                self.pit.clock_card(until.since(self.now).0);
                self.now = self.now.max(until);
                return false;
            };
            self.pit.clock_card(next.since(self.now).0);
            self.now = next;
            if pulse == Some(next) {
                self.mechanism.step(self.direction, 1, next);
                sink.pulse(next, self.mechanism.position());
            } else {
                self.mechanism.look(next);
            }
            if self.mechanism.detectors() != before {
                return true;
            }
        }
    }

    /// Goes to `to` at once: since the last tick OUT0 has fallen `steps` times, counter 0 has `left` ticks to a reload, and
    /// `next` is in its count register. Only while the gate is open, on a mechanism without a rotor, and if no detector
    /// changes on the way.
    pub(crate) fn leap(&mut self, to: Tick, steps: u32, left: NonZeroU32, next: Count) {
        self.pit.leap_card(steps.into(), left, next);
        self.now = to;
        self.mechanism.step(self.direction, steps, to);
    }

    /// The steps to the next change of a detector, in the direction of the sense wire.
    pub(crate) fn steps_to_change(&self) -> Option<u32> {
        self.mechanism.steps_to_change(self.direction)
    }

    /// When a detector changes, if the chip goes on as it does now; with a rotor, when it is looked at next.
    pub(crate) fn next_change(&self) -> Option<Tick> {
        if self.mechanism.has_rotor() {
            return self.mechanism.next_look(self.now);
        }
        let steps = self.mechanism.steps_to_change(self.direction)?;
        let clocks = self.pit.clocks_until_falling(CounterId::Zero, NonZeroU64::new(steps.into())?)?;
        Some(self.now + Ticks(clocks))
    }

    /// Clocks the chip and returns the steps made.
    #[expect(clippy::cast_possible_truncation, reason = "a movement has at most 65 535 pulses")]
    fn clock(&mut self, until: Tick, sink: &mut impl Sink) -> u32 {
        let mut pulses = 0;
        if Self::wants_pulses(sink) {
            let mut mechanism = self.mechanism.clone();
            while let Some(clocks) = self.pit.clocks_until_falling(CounterId::Zero, NonZeroU64::MIN) {
                if self.now + Ticks(clocks) > until {
                    break;
                }
                pulses += self.pit.clock_card(clocks) as u32;
                self.now += Ticks(clocks);
                mechanism.step(self.direction, 1, self.now);
                sink.pulse(self.now, mechanism.position());
            }
        }
        pulses += self.pit.clock_card(until.since(self.now).0) as u32;
        self.now = self.now.max(until);
        pulses
    }

    fn wants_pulses<S: Sink>(_: &S) -> bool {
        S::PULSES
    }
}
