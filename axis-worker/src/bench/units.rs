//! The bench's units, and what the 8253 can make of them: clocks of 1 MHz, the periods that 16 bits count in mode 2, and
//! frequencies in thousandths of a pulse per second, so that 20.5 is exact and nothing is a float.

use std::fmt;
use std::str::FromStr;

use supersigma_protocol::{Count, Tick, Ticks};

/// The quartz of \[M\].
pub const CLOCK_HERTZ: u64 = 1_000_000;
/// Ticks of 2 MHz in a clock.
pub(super) const TICKS_PER_CLOCK: u64 = Tick::PER_SECOND / CLOCK_HERTZ;
const MILLI: u64 = 1_000;

/// A span of time in clocks of 1 MHz, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Clocks(pub u64);

impl Clocks {
    /// The same in ticks.
    #[must_use]
    pub const fn ticks(self) -> Ticks {
        Ticks(self.0 * TICKS_PER_CLOCK)
    }
}

/// Seconds.
impl fmt::Display for Clocks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        decimal(f, self.0, 6)?;
        f.write_str(" s")
    }
}

/// Seconds, with up to six decimals.
impl FromStr for Clocks {
    type Err = UnitError;

    fn from_str(text: &str) -> Result<Self, UnitError> {
        parsed(text, 6).map(Self)
    }
}

/// The time from one pulse to the next, in clocks: 2 to 65 536, which is what mode 2 of an 8253 can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Period(u32);

impl Period {
    /// Mode 2 does not accept a count of 1.
    pub const SHORTEST: Self = Self(2);
    /// A count of 0.
    pub const LONGEST: Self = Self(65_536);

    /// `None` outside of 2 to 65 536.
    #[must_use]
    pub const fn new(clocks: u32) -> Option<Self> {
        if clocks < Self::SHORTEST.0 || clocks > Self::LONGEST.0 { None } else { Some(Self(clocks)) }
    }

    /// 2 to 65 536.
    #[must_use]
    pub const fn clocks(self) -> u32 {
        self.0
    }

    /// What is written to the chip.
    #[must_use]
    pub const fn count(self) -> Count {
        // 65 536 is written as 0.
        Count((self.0 & 0xFFFF) as u16)
    }

    /// The frequency that this is, pulses per second; for people, never for the pulse path.
    #[must_use]
    #[expect(clippy::float_arithmetic, reason = "for people")]
    pub fn hertz(self) -> f64 {
        1e6 / f64::from(self.0)
    }
}

/// Pulses per second, to a thousandth; only what channel 2 can make of 1 MHz.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Frequency(u64);

impl Frequency {
    /// 1 MHz / 65 536 = 15.258 79, rounded up to a thousandth.
    pub const LOWEST: Self = Self(15_259);
    /// 1 MHz / 2.
    pub const HIGHEST: Self = Self(500_000_000);

    /// From thousandths of a pulse per second.
    ///
    /// # Errors
    /// If the chip cannot make it; the error names the nearest that it can.
    pub const fn from_millihertz(millihertz: u64) -> Result<Self, UnitError> {
        if millihertz < Self::LOWEST.0 {
            return Err(UnitError::TooLow { asked: millihertz });
        }
        if millihertz > Self::HIGHEST.0 {
            return Err(UnitError::TooHigh { asked: millihertz });
        }
        Ok(Self(millihertz))
    }

    /// Thousandths of a pulse per second.
    #[must_use]
    pub const fn millihertz(self) -> u64 {
        self.0
    }

    /// Pulses per second; for people, never for the pulse path.
    #[must_use]
    #[expect(
        clippy::float_arithmetic,
        clippy::cast_precision_loss,
        reason = "for people; at most 500 000 000"
    )]
    pub fn hertz(self) -> f64 {
        self.0 as f64 / 1e3
    }
}

impl fmt::Display for Frequency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Millihertz(self.0).fmt(f)
    }
}

/// Pulses per second, with up to three decimals.
impl FromStr for Frequency {
    type Err = UnitError;

    fn from_str(text: &str) -> Result<Self, UnitError> {
        parsed(text, 3).and_then(Self::from_millihertz)
    }
}

struct Millihertz(u64);

impl fmt::Display for Millihertz {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        decimal(f, self.0, 3)?;
        f.write_str(" pulses/s")
    }
}

/// Why a number is no time, or no frequency that the chip can make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum UnitError {
    /// The count would not fit into 16 bits.
    #[error(
        "{} need a count of {}, and the 8253 counts no further than 65 536: the nearest possible is {}",
        Millihertz(*asked),
        count(*asked),
        Frequency::LOWEST
    )]
    TooLow {
        /// Thousandths of a pulse per second.
        asked: u64,
    },
    /// The count would be below 2.
    #[error(
        "{} need a count below 2, which mode 2 of the 8253 does not accept: the nearest possible is {}",
        Millihertz(*asked),
        Frequency::HIGHEST
    )]
    TooHigh {
        /// Thousandths of a pulse per second.
        asked: u64,
    },
    /// No number, or one that is negative or out of all proportion.
    #[error("this is not a plain decimal number of 0 or more")]
    NotANumber,
    /// Finer than the unit.
    #[error("at most {most} decimals")]
    TooFine {
        /// How many there may be.
        most: usize,
    },
}

/// The count for a frequency, in words.
fn count(millihertz: u64) -> String {
    match (CLOCK_HERTZ * MILLI).checked_div(millihertz) {
        Some(count) => count.to_string(),
        None => "infinity".to_owned(),
    }
}

/// A number of units of 10^−`decimals`, written without trailing zeros.
fn decimal(f: &mut fmt::Formatter<'_>, value: u64, decimals: usize) -> fmt::Result {
    let digits = format!("{value:0width$}", width = decimals + 1);
    let (whole, part) = digits.split_at(digits.len() - decimals);
    match part.trim_end_matches('0') {
        "" => f.write_str(whole),
        part => write!(f, "{whole}.{part}"),
    }
}

/// The reverse: a decimal number in units of 10^−`decimals`.
fn parsed(text: &str, decimals: usize) -> Result<u64, UnitError> {
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let plain = |digits: &str| digits.bytes().all(|digit| digit.is_ascii_digit());
    if !plain(whole) || !plain(part) || (whole.is_empty() && part.is_empty()) {
        return Err(UnitError::NotANumber);
    }
    let part = part.trim_end_matches('0');
    if part.len() > decimals {
        return Err(UnitError::TooFine { most: decimals });
    }
    format!("{whole}{part:0<decimals$}").parse().map_err(|_| UnitError::NotANumber)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_exact() {
        let frequency = |text: &str| text.parse::<Frequency>().map(Frequency::millihertz);
        assert_eq!(frequency("20"), Ok(20_000));
        assert_eq!(frequency("20.5"), Ok(20_500));
        assert_eq!(frequency("1234.567000"), Ok(1_234_567));
        assert_eq!(frequency("1234.5678"), Err(UnitError::TooFine { most: 3 }));
        for wrong in ["", ".", "-20", "1e3", "20 Hz", "99999999999999999999"] {
            assert_eq!(frequency(wrong), Err(UnitError::NotANumber), "{wrong:?}");
        }
        assert_eq!("0.2".parse(), Ok(Clocks(200_000)));
        assert_eq!(".000001".parse(), Ok(Clocks(1)));
        assert_eq!(Clocks(1_200_000).to_string(), "1.2 s");
        assert_eq!(Clocks(0).to_string(), "0 s");
        assert_eq!(Frequency(20_500).to_string(), "20.5 pulses/s");
    }

    #[test]
    fn what_the_chip_cannot_do_is_refused_with_the_nearest_that_it_can() {
        let said = |text: &str| text.parse::<Frequency>().expect_err("impossible").to_string();
        assert_eq!(
            said("15"),
            "15 pulses/s need a count of 66666, and the 8253 counts no further than 65 536: the nearest possible is \
             15.259 pulses/s"
        );
        assert_eq!(
            said("500000.001"),
            "500000.001 pulses/s need a count below 2, which mode 2 of the 8253 does not accept: the nearest possible \
             is 500000 pulses/s"
        );
        assert!(said("0").contains("a count of infinity"), "{}", said("0"));
        assert!("15.259".parse::<Frequency>().is_ok() && "500000".parse::<Frequency>().is_ok());
        assert_eq!(Period::new(1), None);
        assert_eq!(Period::new(65_537), None);
        assert_eq!(Period::new(65_536).map(Period::count), Some(Count(0)));
        assert_eq!(Period::new(65_535).map(Period::count), Some(Count(65_535)));
    }
}
