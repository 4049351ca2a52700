//! The Intel 8253 programmable interval timer, whole: three counters, six modes, binary and BCD.
//!
//! The model follows Intel's data sheet of the 8253. Where only the sheet of its successor, the 8254, states a rule
//! precisely (when a count is transferred, what a gate edge does), that rule is taken. It never follows a
//! paper *about* the chip. Of the card it knows the wiring, [`Pit8253::clock_card`], and nothing else. Nothing panics,
//! allocates or loops over pulses: a million CLK pulses cost what ten cost.
//!
//! # One CLK pulse
//!
//! A CLK pulse is a rising edge followed by a falling one. Gate triggers are sampled at the first, counts are
//! transferred and decremented at the second, so everything that OUT does falls on whole pulses. Bytes are written and
//! gates moved *between* pulses.
//!
//! ```text
//!             write N = 3
//!                  v
//! CLK         __--__--__--__--__--__--__--__--__
//! element             3   2   1   3   2   1   3
//! OUT, mode 2 ----------------____--------____--
//! ```
//!
//! The first pulse after the write transfers the count, so mode 2 pulls OUT low on pulses N, 2N, 3N and so on.
//!
//! # Why the card has two step counters
//!
//! OUT0 steps the motor and is also CLK1 and CLK2 ([`Pit8253::clock_card`]). Counter 1 counts the steps of long
//! moves, counter 2 serves moves of one or two steps (\[C\], Fig 7 and the text below it: "the internal organization
//! of 8253 does not allow" one counter for both). These are the rules of the chip behind that sentence:
//!
//! * A count that has been written is only *transferred to the counting element on the next CLK pulse*. The first step
//!   is spent on loading, and until then a latched read gives what the last movement left. Whoever reads counter 1
//!   cannot tell "no step yet" from garbage, and sees `n` steps as `N − n + 1`.
//! * Mode 2 does not accept a count of 1, so a counter in that mode can't announce a move of one step.
//!
//! Counter 2 is therefore run in mode 1, the hardware one-shot, with a count of 1, and triggered over its gate: OUT2
//! falls with the first step and rises with the second. Testing OUT2 tells one step from two, and no count is read.
//!
//! # What the data sheets leave open
//!
//! The model is deterministic there too:
//!
//! * Power-up: every counter is as after a mode 0 control word (LSB then MSB, binary), its counting element
//!   reads 0, and all gates are high (inputs that nobody drives).
//! * SC = 11 (the 8254's read-back command) does not exist on an 8253: such a control word is ignored.
//! * A count of 1 is illegal in modes 2 and 3: OUT stays high for as long as it is in force.
//! * BCD digits above 9 count for what they weigh, modulo 10 000: `0x1F` loads 25.
//! * Modes 4 and 5 strobe once per load, although the counting element wraps and passes zero again. A strobe ends on
//!   the next pulse even when the gate stops the counting.
//! * Reads and writes have a byte flip-flop each. The first byte of a two-byte count waits outside the count register
//!   until the second comes. A latch command starts the read-out at the LSB.
//! * A counter that has a control word but no count keeps what it had last counted to, and can be read.

mod control;
mod counter;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod properties;

use core::num::{NonZeroU32, NonZeroU64};

use supersigma_protocol::Count;

use control::{ControlWord, LOAD_LSB_THEN_MSB};
pub use control::{CounterId, Mode};
use counter::Counter;

/// How often an OUT pin changed during a batch of CLK pulses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Edges {
    /// High to low.
    pub falling: u64,
    /// Low to high.
    pub rising: u64,
}

/// The chip: three independent 16-bit down counters, each with its own CLK, GATE and OUT.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pit8253 {
    counters: [Counter; 3],
}

impl Pit8253 {
    /// A chip that has just been powered up (see the module's list of what the data sheets leave open).
    #[must_use]
    pub const fn new() -> Self {
        Self { counters: [Counter::POWERED_UP; 3] }
    }

    /// A write with A1 A0 = 11. Either sets up a counter (which stops it, releases its latch, forgets a half-written
    /// count and puts OUT to the mode's initial level at once) or latches its counting element.
    ///
    /// A second latch command before the first has been read out is ignored, and so is SC = 11.
    pub fn write_control(&mut self, word: u8) {
        match ControlWord::decode(word) {
            ControlWord::SetUp { counter, setup } => self.counter_mut(counter).set_up(setup),
            ControlWord::Latch { counter } => self.counter_mut(counter).latch(),
            ControlWord::Illegal => {}
        }
    }

    /// One byte of a count, as the counter's control word has announced it.
    #[inline]
    pub fn write(&mut self, counter: CounterId, byte: u8) {
        self.counter_mut(counter).write(byte);
    }

    /// The next byte of the latched value, or, without one, of the counting element as it stands.
    pub fn read(&mut self, counter: CounterId) -> u8 {
        self.counter_mut(counter).read()
    }

    /// Drives GATE. Setting a level again changes nothing; only a change from low to high is a trigger.
    pub fn set_gate(&mut self, counter: CounterId, high: bool) {
        self.counter_mut(counter).set_gate(high);
    }

    /// The level of OUT: `true` is high.
    #[inline]
    #[must_use]
    pub fn output(&self, counter: CounterId) -> bool {
        self.counter(counter).out()
    }

    /// Gives a counter `pulses` CLK pulses and tells how often its OUT fell and rose. Any number of pulses costs the
    /// same.
    ///
    /// Edges that a write or a gate makes are not in this count. In modes 1 to 5 these only ever *raise* OUT; in mode
    /// 0 the control word and every new count pull it low.
    #[inline]
    pub fn clock(&mut self, counter: CounterId, pulses: u64) -> Edges {
        self.counter_mut(counter).clock(pulses)
    }

    /// CLK pulses from now until OUT falls for the `nth` time, if nobody writes or moves the gate.
    ///
    /// `None` if it never does (or after 2^64 pulses, which is the same).
    #[inline]
    #[must_use]
    pub fn clocks_until_falling(&self, counter: CounterId, nth: NonZeroU64) -> Option<u64> {
        self.counter(counter).clocks_until_falling(nth)
    }

    /// The wiring of the axis card (\[C\], Fig 7): `ticks` of 2 MHz into CLK0, and OUT0 into CLK1 and CLK2. Returns how
    /// often OUT0 fell, which is the number of steps that the motor was given.
    ///
    /// Counters 1 and 2 see all pulses of the batch; to act on a certain step, clock up to it (with
    /// [`clocks_until_falling`](Self::clocks_until_falling)). Counter 0 must not be in mode 0, the one mode in which
    /// writing makes OUT fall, for that step would go uncounted.
    #[inline]
    pub fn clock_card(&mut self, ticks: u64) -> u64 {
        let [step_clock, long_moves, short_moves] = &mut self.counters;
        let steps = step_clock.clock(ticks).falling;
        long_moves.clock(steps);
        short_moves.clock(steps);
        steps
    }

    /// The same as many clocks and counts, for a caller who knows what they come to: OUT0 has fallen `steps` times, counter 0
    /// stands `left` ticks before a reload, and `next` is the last count that was written to it. Counter 0 must be a rate
    /// generator with its gate high.
    #[inline]
    pub fn leap_card(&mut self, steps: u64, left: NonZeroU32, next: Count) {
        let [step_clock, long_moves, short_moves] = &mut self.counters;
        step_clock.leap_in_rate(left, next);
        long_moves.clock(steps);
        short_moves.clock(steps);
    }

    /// Sets a counter up for binary counts of two bytes and writes the first: a control word and two bytes.
    pub fn program(&mut self, counter: CounterId, mode: Mode, count: Count) {
        self.write_control(counter.select_bits() | LOAD_LSB_THEN_MSB | mode.bits());
        self.load(counter, count);
    }

    /// Writes a count, LSB then MSB. The counter must have been set up for both bytes; otherwise these are, as on the
    /// chip, two counts of one byte each.
    #[inline]
    pub fn load(&mut self, counter: CounterId, count: Count) {
        self.counter_mut(counter).write_word(count);
    }

    /// Latches a counter and reads it out: LSB then MSB where the control word says both, otherwise the one byte there
    /// is, with zero for the other. A value that was latched before and not read out comes first, as on the chip.
    pub fn latch_and_read(&mut self, counter: CounterId) -> u16 {
        let counter = self.counter_mut(counter);
        counter.latch();
        counter.read_word()
    }

    #[inline]
    fn counter(&self, counter: CounterId) -> &Counter {
        let [zero, one, two] = &self.counters;
        match counter {
            CounterId::Zero => zero,
            CounterId::One => one,
            CounterId::Two => two,
        }
    }

    #[inline]
    fn counter_mut(&mut self, counter: CounterId) -> &mut Counter {
        let [zero, one, two] = &mut self.counters;
        match counter {
            CounterId::Zero => zero,
            CounterId::One => one,
            CounterId::Two => two,
        }
    }
}

impl Default for Pit8253 {
    fn default() -> Self {
        Self::new()
    }
}
