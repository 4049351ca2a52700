//! The 8253 of the bench, and what its program reads out of it. Channel 2 makes the pulses of the motor, channels 0 and 1
//! count L and R.
//!
//! # Channel 2
//!
//! Mode 2. A count written while it runs is taken over when the period ends, so the program is always one ahead: TC(j+1) is
//! written when period j has begun. After the last pulse the gate goes low.
//!
//! ```text
//! write   TC(1) TC(2)              TC(3)
//! count     ╰──TC(1)──────────────╮╭─TC(2)────────╮╭─ …
//! OUT2   ─────────────────────────╮╭──────────────╮╭───
//! pulse                           1               2
//! ```
//!
//! # Channels 0 and 1
//!
//! Mode 0, 16 bits, down, on and round past zero. The chip has two peculiarities for a counter of pulses. The first pulse
//! after a write is spent on transferring the count: so 65 535 is written, and the transfer takes the counting element
//! from the 0 of power-up to 65 535, just as counting would, and no pulse is missing. And 65 536 pulses look like none:
//! so the program adds up differences, and reads often enough. (The encoder would have to turn eight times in a sample.)

use core::num::NonZeroU64;

use supersigma_protocol::{Count, Tick};

use super::units::{Period, TICKS_PER_CLOCK};
use crate::motor::{Counts, Sense};
use crate::pit8253::{CounterId, Mode, Pit8253};

const PULSES: CounterId = CounterId::Two;
const L: CounterId = CounterId::Zero;
const R: CounterId = CounterId::One;

/// The chip and the program's variables.
#[derive(Debug, Clone)]
pub(super) struct Counters {
    pit: Pit8253,
    /// CLK pulses that channel 2 has had.
    clocked: u64,
    l: Tally,
    r: Tally,
}

/// What a counter has counted since the beginning.
#[derive(Debug, Clone, Copy)]
struct Tally {
    channel: CounterId,
    last: u16,
    sum: u64,
}

/// L and R since the beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Reading {
    pub(super) l: u64,
    pub(super) r: u64,
}

impl Reading {
    /// How far the shaft has turned.
    pub(super) fn position(self) -> Counts {
        Counts(self.l.cast_signed() - self.r.cast_signed())
    }
}

impl Counters {
    /// Powered up and programmed, with no pulse made yet.
    pub(super) fn new() -> Self {
        let mut pit = Pit8253::new();
        let tally = |pit: &mut Pit8253, channel| {
            pit.program(channel, Mode::InterruptOnTerminalCount, Count(u16::MAX));
            Tally { channel, last: pit.latch_and_read(channel), sum: 0 }
        };
        let (l, r) = (tally(&mut pit, L), tally(&mut pit, R));
        Self { pit, clocked: 0, l, r }
    }

    /// Starts the pulses: the first period, and the one after it if there is one. The clocks count from here.
    pub(super) fn start(&mut self, first: Period, second: Option<Period>) {
        self.pit.program(PULSES, Mode::RateGenerator, first.count());
        self.pit.clock(PULSES, 1);
        self.clocked = 1;
        self.write(second);
    }

    /// When the next pulse comes, as the chip stands; `None` if none will.
    pub(super) fn next_pulse(&self) -> Option<Tick> {
        let clocks = self.pit.clocks_until_falling(PULSES, NonZeroU64::MIN)?;
        Some(Tick((self.clocked + clocks) * TICKS_PER_CLOCK))
    }

    /// Lets the next pulse come and the period after it begin, and writes the count for the one after that. `goes_on`: whether
    /// there is a period after this pulse; if not, the gate goes low with it.
    pub(super) fn pulse(&mut self, goes_on: bool, after_next: Option<Period>) {
        let Some(clocks) = self.pit.clocks_until_falling(PULSES, NonZeroU64::MIN) else { return };
        self.clock_pulses(clocks);
        if goes_on {
            // OUT rises and the count is taken over one clock later, and the shortest period has two.
            self.clock_pulses(1);
            self.write(after_next);
        } else {
            self.pit.set_gate(PULSES, false);
        }
    }

    /// A pulse of the discriminator.
    pub(super) fn count(&mut self, sense: Sense) {
        let channel = match sense {
            Sense::Clockwise => L,
            Sense::Anticlockwise => R,
        };
        self.pit.clock(channel, 1);
    }

    /// Latches and reads both counters.
    pub(super) fn read(&mut self) -> Reading {
        let Self { pit, l, r, .. } = self;
        for tally in [&mut *l, r] {
            let now = pit.latch_and_read(tally.channel);
            tally.sum += u64::from(tally.last.wrapping_sub(now));
            tally.last = now;
        }
        Reading { l: l.sum, r: r.sum }
    }

    fn clock_pulses(&mut self, clocks: u64) {
        self.pit.clock(PULSES, clocks);
        self.clocked += clocks;
    }

    fn write(&mut self, period: Option<Period>) {
        if let Some(period) = period {
            self.pit.load(PULSES, period.count());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pulse_is_missing_at_the_first_and_at_the_wrap() {
        let mut counters = Counters::new();
        assert_eq!(counters.read(), Reading::default());
        for l in 1..=200_000 {
            counters.count(Sense::Clockwise);
            if l <= 3 || l % 1_000 == 0 {
                assert_eq!(counters.read(), Reading { l, r: 0 });
            }
        }
        counters.count(Sense::Anticlockwise);
        assert_eq!(counters.read(), Reading { l: 200_000, r: 1 });
        assert_eq!(counters.read().position(), Counts(199_999));
    }

    #[test]
    fn every_period_is_the_one_that_was_written() {
        let clocks = [65_536, 2, 2, 3, 5_000, 65_535, 2];
        let periods: Vec<Period> =
            clocks.into_iter().map(|clocks| Period::new(clocks).expect("possible")).collect();
        let mut counters = Counters::new();
        counters.start(periods[0], periods.get(1).copied());
        let mut due = 0;
        for (j, period) in periods.iter().enumerate() {
            due += u64::from(period.clocks());
            assert_eq!(counters.next_pulse(), Some(Tick(2 * due)), "pulse {j}");
            counters.pulse(j + 1 < periods.len(), periods.get(j + 2).copied());
        }
        assert_eq!(counters.next_pulse(), None);
    }
}
