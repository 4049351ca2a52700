//! The control word: which counter, which mode, which bytes, which number system. No state in here.
//!
//! ```text
//!    D7  D6   D5  D4   D3 D2 D1   D0
//!    SC1 SC0  RL1 RL0  M2 M1 M0   BCD
//! ```

use core::num::NonZeroU32;

/// RL = 11: every count is written and read as two bytes, LSB first.
pub(super) const LOAD_LSB_THEN_MSB: u8 = 0b0011_0000;

/// One of the three counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CounterId {
    /// Counter 0: on the axis card, the step clock.
    Zero,
    /// Counter 1: on the axis card, the step counter of long moves.
    One,
    /// Counter 2: on the axis card, the step counter of moves of one or two steps.
    Two,
}

impl CounterId {
    /// All counters, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Zero, Self::One, Self::Two];

    /// SC1 and SC0, in place.
    pub(super) const fn select_bits(self) -> u8 {
        match self {
            Self::Zero => 0b0000_0000,
            Self::One => 0b0100_0000,
            Self::Two => 0b1000_0000,
        }
    }
}

/// What a counter does with its count, by the data sheet's mode numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Mode 0: OUT is low from the write on and rises for good N + 1 pulses later. A low gate suspends.
    InterruptOnTerminalCount,
    /// Mode 1: a rising gate makes OUT fall on the next pulse, for N pulses. Can be triggered again.
    OneShot,
    /// Mode 2: OUT is low for the last of every N pulses. A low gate stops, a rising one starts the period anew.
    RateGenerator,
    /// Mode 3: OUT is high for the larger half of every N pulses. Gate as in mode 2.
    SquareWave,
    /// Mode 4: N + 1 pulses after the write OUT is low for one pulse. A low gate suspends.
    SoftwareStrobe,
    /// Mode 5: N + 1 pulses after the gate rises OUT is low for one pulse. Can be triggered again.
    HardwareStrobe,
}

impl Mode {
    /// M2, M1 and M0, in place.
    pub(super) const fn bits(self) -> u8 {
        match self {
            Self::InterruptOnTerminalCount => 0b0000,
            Self::OneShot => 0b0010,
            Self::RateGenerator => 0b0100,
            Self::SquareWave => 0b0110,
            Self::SoftwareStrobe => 0b1000,
            Self::HardwareStrobe => 0b1010,
        }
    }

    /// M2 is a "don't care" in modes 2 and 3: 6 and 7 are the same modes.
    const fn of_word(word: u8) -> Self {
        match word >> 1 & 0b111 {
            0 => Self::InterruptOnTerminalCount,
            1 => Self::OneShot,
            2 | 6 => Self::RateGenerator,
            3 | 7 => Self::SquareWave,
            4 => Self::SoftwareStrobe,
            _ => Self::HardwareStrobe,
        }
    }

    /// Where the control word puts OUT: only mode 0 begins low.
    pub(super) const fn initial_out(self) -> bool {
        !matches!(self, Self::InterruptOnTerminalCount)
    }

    /// Modes 1 and 5 know only the gate's rising edge; in all others a low gate stops the counting.
    pub(super) const fn is_stopped_by_a_low_gate(self) -> bool {
        !matches!(self, Self::OneShot | Self::HardwareStrobe)
    }
}

/// Which bytes of a count are written and read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// RL = 01; the MSB of a count is zero.
    Lsb,
    /// RL = 10; the LSB of a count is zero.
    Msb,
    /// RL = 11; LSB first.
    LsbThenMsb,
}

/// The number system of a counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Base {
    /// 16 bits; a count of 0 means 65 536.
    Binary,
    /// Four decimal digits; a count of 0 means 10 000.
    Bcd,
}

impl Base {
    /// How many values the counting element has; also what a count of 0 stands for.
    #[inline]
    pub(super) const fn modulus(self) -> NonZeroU32 {
        const BINARY: NonZeroU32 = NonZeroU32::new(65_536).unwrap();
        const BCD: NonZeroU32 = NonZeroU32::new(10_000).unwrap();
        match self {
            Self::Binary => BINARY,
            Self::Bcd => BCD,
        }
    }

    /// What a count register with these bits divides by: 1 ..= modulus.
    #[inline]
    pub(super) fn divisor(self, bits: u16) -> NonZeroU32 {
        let value = match self {
            Self::Binary => u32::from(bits),
            Self::Bcd => {
                let digit = |place: u16| u32::from(bits >> (4 * place) & 0xF);
                (digit(0) + 10 * digit(1) + 100 * digit(2) + 1_000 * digit(3)) % self.modulus()
            }
        };
        NonZeroU32::new(value).unwrap_or(self.modulus())
    }

    /// What so many pulses leave over when the counting element goes round and round.
    pub(super) const fn remainder(self, pulses: u64) -> u32 {
        // Constant divisors, and masks that say that the results are small.
        match self {
            Self::Binary => (pulses & 0xFFFF) as u32,
            Self::Bcd => ((pulses % 10_000) & 0xFFFF) as u32,
        }
    }

    /// The bits with which the chip shows a counting element that has `left` pulses to go to zero, 1 ..= modulus.
    pub(super) fn bits(self, left: u32) -> u16 {
        let value = match self {
            Self::Binary => left,
            Self::Bcd => {
                let digit = |weight: u32| left / weight % 10;
                digit(1) | digit(10) << 4 | digit(100) << 8 | digit(1_000) << 12
            }
        };
        // A full counting element, 65 536, shows as zero; no other value has more than 16 bits.
        (value & 0xFFFF) as u16
    }
}

/// How a control word sets a counter up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Setup {
    pub(super) mode: Mode,
    pub(super) access: Access,
    pub(super) base: Base,
}

/// A control word, understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControlWord {
    SetUp {
        counter: CounterId,
        setup: Setup,
    },
    /// RL = 00; the other bits do not matter.
    Latch {
        counter: CounterId,
    },
    /// SC = 11: the read-back command of the 8254, which an 8253 does not have.
    Illegal,
}

impl ControlWord {
    pub(super) fn decode(word: u8) -> Self {
        let counter = match word >> 6 {
            0 => CounterId::Zero,
            1 => CounterId::One,
            2 => CounterId::Two,
            _ => return Self::Illegal,
        };
        let access = match word >> 4 & 0b11 {
            0 => return Self::Latch { counter },
            1 => Access::Lsb,
            2 => Access::Msb,
            _ => Access::LsbThenMsb,
        };
        let base = if word & 1 == 0 { Base::Binary } else { Base::Bcd };
        Self::SetUp { counter, setup: Setup { mode: Mode::of_word(word), access, base } }
    }
}
