//! One counter of the chip, advanced by arithmetic.
//!
//! The counting element is held as the pulses it has `left` to zero, 1 ..= 65 536 (10 000 in BCD), so that the count
//! of 0 needs no special case. A batch of pulses is at most four pieces: the pulse that transfers a new count, the rest
//! of the period under way, a number of whole periods (a division), and the beginning of one more. The first is
//! missing when a rate generator runs, which is what the axis does all day, so that case is tested for first.

use core::num::{NonZeroU32, NonZeroU64};

use supersigma_protocol::Count;

use super::Edges;
use super::control::{Access, Base, Mode, Setup};

/// What the next CLK pulse finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// No whole count since the control word, or since the first byte of one in mode 0: pulses and triggers do nothing.
    NoCount,
    /// Modes 1 and 5: there is a count, and no trigger yet.
    Armed,
    /// The next pulse transfers the count register to the counting element, whatever the gate.
    Loading,
    /// Counting down to an event on OUT.
    Counting,
    /// Modes 0, 1, 4, 5: the event is over; the counting element goes round without effect.
    Expired,
}

/// One counter: registers, pins, and where it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counter {
    /// Pulses that the counting element has left to zero, 1 ..= modulus.
    left: u32,
    /// The count register: what the last whole count divides by.
    count: NonZeroU32,
    latch: Option<u16>,
    /// The LSB of a count whose MSB has not come yet.
    first_byte: Option<u8>,
    setup: Setup,
    /// The base in which `left` was counted: it differs from the set-up's until a count is transferred.
    left_base: Base,
    stage: Stage,
    gate: bool,
    out: bool,
    /// The reading flip-flop.
    msb_is_next: bool,
}

impl Counter {
    pub(super) const POWERED_UP: Self = Self {
        left: Base::Binary.modulus().get(),
        count: NonZeroU32::MIN,
        latch: None,
        first_byte: None,
        setup: Setup { mode: Mode::InterruptOnTerminalCount, access: Access::LsbThenMsb, base: Base::Binary },
        left_base: Base::Binary,
        stage: Stage::NoCount,
        gate: true,
        out: false,
        msb_is_next: false,
    };

    pub(super) fn set_up(&mut self, setup: Setup) {
        self.setup = setup;
        self.latch = None;
        self.first_byte = None;
        self.msb_is_next = false;
        self.stage = Stage::NoCount;
        self.out = setup.mode.initial_out();
    }

    pub(super) fn latch(&mut self) {
        if self.latch.is_none() {
            self.latch = Some(self.shown());
            self.msb_is_next = false;
        }
    }

    #[inline]
    pub(super) fn write(&mut self, byte: u8) {
        match (self.setup.access, self.first_byte.take()) {
            (Access::Lsb, _) => self.accept(u16::from_le_bytes([byte, 0])),
            (Access::Msb, _) => self.accept(u16::from_le_bytes([0, byte])),
            (Access::LsbThenMsb, Some(lsb)) => self.accept(u16::from_le_bytes([lsb, byte])),
            (Access::LsbThenMsb, None) => {
                self.first_byte = Some(byte);
                if self.setup.mode == Mode::InterruptOnTerminalCount {
                    // The first byte stops the counting; no CLK pulse is needed.
                    self.stage = Stage::NoCount;
                    self.out = false;
                }
            }
        }
    }

    /// Two writes in one, LSB then MSB.
    #[inline]
    pub(super) fn write_word(&mut self, count: Count) {
        if self.setup.access == Access::LsbThenMsb && self.first_byte.is_none() {
            self.accept(count.0);
        } else {
            let [lsb, msb] = count.0.to_le_bytes();
            self.write(lsb);
            self.write(msb);
        }
    }

    pub(super) fn read(&mut self) -> u8 {
        let [lsb, msb] = self.latch.unwrap_or_else(|| self.shown()).to_le_bytes();
        let is_msb = match self.setup.access {
            Access::Lsb => false,
            Access::Msb => true,
            Access::LsbThenMsb => {
                self.msb_is_next = !self.msb_is_next;
                !self.msb_is_next
            }
        };
        if is_msb || self.setup.access == Access::Lsb {
            self.latch = None;
        }
        if is_msb { msb } else { lsb }
    }

    /// All the bytes that the set-up gives, each in its place.
    pub(super) fn read_word(&mut self) -> u16 {
        let first = self.read();
        match self.setup.access {
            Access::Lsb => u16::from_le_bytes([first, 0]),
            Access::Msb => u16::from_le_bytes([0, first]),
            Access::LsbThenMsb => u16::from_le_bytes([first, self.read()]),
        }
    }

    pub(super) fn set_gate(&mut self, high: bool) {
        let trigger = high && !self.gate && self.stage != Stage::NoCount;
        self.gate = high;
        match self.setup.mode {
            Mode::InterruptOnTerminalCount | Mode::SoftwareStrobe => {}
            Mode::OneShot | Mode::HardwareStrobe => {
                if trigger {
                    self.stage = Stage::Loading;
                }
            }
            Mode::RateGenerator | Mode::SquareWave => {
                if trigger {
                    self.stage = Stage::Loading;
                }
                // A low gate raises OUT at once; a high one finds it high.
                self.out |= !high;
            }
        }
    }

    #[inline]
    pub(super) const fn out(&self) -> bool {
        self.out
    }

    #[inline]
    pub(super) fn clock(&mut self, pulses: u64) -> Edges {
        if self.setup.mode == Mode::RateGenerator && self.stage == Stage::Counting && self.gate {
            self.generate_rate(pulses)
        } else {
            self.clock_in_any_stage(pulses)
        }
    }

    /// Mode 2, gate high, binary: puts the counting element and the count register where clocks and writes that the caller
    /// knows would have brought them, `left` pulses before a reload.
    pub(super) fn leap_in_rate(&mut self, left: NonZeroU32, next: Count) {
        debug_assert!(self.setup.mode == Mode::RateGenerator && self.gate);
        self.count = self.setup.base.divisor(next.0);
        (self.left, self.left_base) = (left.get(), self.setup.base);
        self.stage = Stage::Counting;
        self.out = self.left > 1;
    }

    pub(super) fn clocks_until_falling(&self, nth: NonZeroU64) -> Option<u64> {
        if self.stage != Stage::Loading {
            return self.falling_without_load(nth.get());
        }
        let mut loaded = *self;
        let remaining = nth.get() - loaded.transfer().falling;
        if remaining == 0 { Some(1) } else { loaded.falling_without_load(remaining)?.checked_add(1) }
    }

    /// The counting element as the bus sees it.
    fn shown(&self) -> u16 {
        self.left_base.bits(self.left)
    }

    /// A whole count has been written.
    #[inline]
    fn accept(&mut self, bits: u16) {
        self.count = self.setup.base.divisor(bits);
        match self.setup.mode {
            Mode::InterruptOnTerminalCount => {
                self.out = false;
                self.stage = Stage::Loading;
            }
            Mode::SoftwareStrobe => self.stage = Stage::Loading,
            // Later counts wait for the end of the period or half period.
            Mode::RateGenerator | Mode::SquareWave => {
                if self.stage == Stage::NoCount {
                    self.stage = Stage::Loading;
                }
            }
            // Later counts wait for the next trigger.
            Mode::OneShot | Mode::HardwareStrobe => {
                if self.stage == Stage::NoCount {
                    self.stage = Stage::Armed;
                }
            }
        }
    }

    fn clock_in_any_stage(&mut self, pulses: u64) -> Edges {
        if self.stage != Stage::Loading {
            return self.clock_without_load(pulses);
        }
        let Some(rest) = pulses.checked_sub(1) else {
            return Edges::default();
        };
        let first = self.transfer();
        let later = self.clock_without_load(rest);
        // Each is at most half the pulses, rounded up, so the sums fit.
        Edges { falling: first.falling + later.falling, rising: first.rising + later.rising }
    }

    /// The pulse that transfers the count register to the counting element. It does not decrement.
    fn transfer(&mut self) -> Edges {
        self.left = self.count.get();
        self.left_base = self.setup.base;
        self.stage = Stage::Counting;
        // Mode 0 is low since the write, modes 2 and 3 are high since the control word or the low gate.
        let out = match self.setup.mode {
            Mode::InterruptOnTerminalCount | Mode::OneShot => false,
            Mode::RateGenerator | Mode::SquareWave | Mode::SoftwareStrobe | Mode::HardwareStrobe => true,
        };
        self.drive(out)
    }

    fn clock_without_load(&mut self, pulses: u64) -> Edges {
        if pulses == 0 || matches!(self.stage, Stage::NoCount | Stage::Armed) {
            return Edges::default();
        }
        let mode = self.setup.mode;
        if mode.is_stopped_by_a_low_gate() && !self.gate {
            // OUT stays, except that a strobe is over after its pulse.
            return if mode == Mode::SoftwareStrobe { self.drive(true) } else { Edges::default() };
        }
        match mode {
            Mode::InterruptOnTerminalCount | Mode::OneShot => match self.count_down(pulses) {
                Some(_) => self.drive(true),
                None => Edges::default(),
            },
            Mode::RateGenerator => self.generate_rate(pulses),
            Mode::SquareWave => self.generate_square(pulses),
            Mode::SoftwareStrobe | Mode::HardwareStrobe => self.strobe(pulses),
        }
    }

    /// Modes 0, 1, 4, 5: counts down, on past zero and round. Returns the pulses after terminal count when that
    /// falls into this batch.
    fn count_down(&mut self, pulses: u64) -> Option<u64> {
        let left = self.left;
        let modulus = self.left_base.modulus().get();
        let steps = self.left_base.remainder(pulses);
        self.left = if steps < left { left - steps } else { left + modulus - steps };
        if self.stage != Stage::Counting {
            return None;
        }
        let overshoot = pulses.checked_sub(u64::from(left))?;
        self.stage = Stage::Expired;
        Some(overshoot)
    }

    /// Modes 4 and 5: OUT is low for the one pulse that begins at terminal count.
    fn strobe(&mut self, pulses: u64) -> Edges {
        // A strobe that is under way ends with the first pulse.
        let mut edges = self.drive(true);
        if let Some(overshoot) = self.count_down(pulses) {
            edges.falling += 1;
            if overshoot == 0 {
                self.out = false;
            } else {
                edges.rising += 1;
            }
        }
        edges
    }

    /// Mode 2, counting, gate high: OUT falls when one pulse is left and rises with the reload.
    #[inline]
    fn generate_rate(&mut self, pulses: u64) -> Edges {
        let left = u64::from(self.left);
        if pulses < left {
            let remaining = self.left - narrow(pulses);
            let fell = remaining == 1 && pulses > 0;
            self.left = remaining;
            self.out &= !fell;
            return Edges { falling: u64::from(fell), rising: 0 };
        }
        // To the reload: OUT falls on the way unless it is low already (or a count of 1 keeps it high), and rises.
        let falling = u64::from(left > 1);
        let rising = u64::from(left > 1 || !self.out);
        if self.count == NonZeroU32::MIN {
            self.left = 1;
            self.out = true;
            return Edges { falling, rising };
        }
        let (periods, phase) = divide(pulses - left, self.count);
        self.left = self.count.get() - phase;
        self.out = self.left > 1;
        Edges { falling: falling + periods + u64::from(!self.out), rising: rising + periods }
    }

    /// Mode 3, counting, gate high: OUT toggles at the end of every half period, with a reload.
    fn generate_square(&mut self, pulses: u64) -> Edges {
        let left = u64::from(half_period(self.left, self.out));
        if pulses < left {
            self.enter_half(narrow(pulses));
            return Edges::default();
        }
        self.left = self.count.get();
        // The low half of a count of 1 has no length: OUT is high all the time.
        let mut edges = self.drive(!self.out || self.left == 1);
        if self.left == 1 {
            return edges;
        }
        let (periods, phase) = divide(pulses - left, self.count);
        edges.falling += periods;
        edges.rising += periods;
        let half = half_period(self.left, self.out);
        if phase < half {
            self.enter_half(phase);
        } else {
            let toggle = self.drive(!self.out);
            edges.falling += toggle.falling;
            edges.rising += toggle.rising;
            self.enter_half(phase - half);
        }
        edges
    }

    /// Goes `pulses` into the half period under way, fewer than it has. The 8253 counts by two; the first pulse after
    /// the load of an odd count counts by one if OUT is high and by three if it is low.
    fn enter_half(&mut self, pulses: u32) {
        if pulses > 0 {
            self.left = 2 * (half_period(self.left, self.out) - pulses);
        }
    }

    /// Puts OUT to a level on a CLK pulse.
    fn drive(&mut self, high: bool) -> Edges {
        let was_high = core::mem::replace(&mut self.out, high);
        Edges { falling: u64::from(was_high && !high), rising: u64::from(!was_high && high) }
    }

    /// [`clocks_until_falling`](Self::clocks_until_falling) when no transfer is due; `nth` is 1 or more.
    fn falling_without_load(&self, nth: u64) -> Option<u64> {
        if self.stage != Stage::Counting || (self.setup.mode.is_stopped_by_a_low_gate() && !self.gate) {
            return None;
        }
        let left = u64::from(self.left);
        let period = u64::from(self.count.get());
        let (first, periods) = match self.setup.mode {
            Mode::InterruptOnTerminalCount | Mode::OneShot => return None,
            Mode::SoftwareStrobe | Mode::HardwareStrobe => return (nth == 1).then_some(left),
            // The fall of the period under way, whatever count comes next.
            Mode::RateGenerator if left > 1 && nth == 1 => return Some(left - 1),
            _ if period == 1 => return None,
            // With one pulse left this period's fall is past (or the count was 1).
            Mode::RateGenerator => (left - 1, if left > 1 { nth - 1 } else { nth }),
            Mode::SquareWave => {
                let half = u64::from(half_period(self.left, self.out));
                let high_half = if self.out { 0 } else { u64::from(half_period(self.count.get(), true)) };
                (half + high_half, nth - 1)
            }
        };
        periods.checked_mul(period)?.checked_add(first)
    }
}

/// Mode 3: pulses to the end of the half period in which OUT is `high` when the counting element stands at `left`.
fn half_period(left: u32, high: bool) -> u32 {
    if high { left.div_ceil(2) } else { left / 2 }
}

/// Whole periods in so many pulses, and the pulses over. The narrow division is several times faster on most
/// processors, and nearly all batches fit it.
#[inline]
fn divide(pulses: u64, period: NonZeroU32) -> (u64, u32) {
    if let Ok(pulses) = u32::try_from(pulses) {
        (u64::from(pulses / period), pulses % period)
    } else {
        let period = NonZeroU64::from(period);
        (pulses / period, narrow(pulses % period))
    }
}

/// For values that are known to be below 2^32.
#[inline]
const fn narrow(value: u64) -> u32 {
    (value & 0xFFFF_FFFF) as u32
}
