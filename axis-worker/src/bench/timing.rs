//! NS-TC of \[M\], equations (1) to (6): which counts channel 2 is given. Integers only.
//!
//! ```text
//!  pulses/s
//!  f_max ┤        ╭────────────────╮
//!        │      ╱ ┊                ┊╲               m = (f_max − f_start) / t_a             (1)
//!        │    ╱   ┊                ┊ ╲              t(j−1) = T(1) + … + T(j−1)              (2)
//!        │  ╱     ┊                ┊  ╲             f(t) = m t + f_start, at most f_max     (3)
//! f_start┤╱       ┊                ┊   ╲            T(j) = 1 / f(t(j−1))                    (4)
//!        └┬───────┬────────────────┬───┬── time     TC(j) = f_CK T(j)                       (5)
//!         0      t_a              +t_b +t_c         the first j with t(j−1) > t_a is Ns_a   (6)
//! ```
//!
//! Equation (6) is printed as `T(j−1) > t_a`, which no period ever is; what must exceed `t_a` is the accumulated time of (2).
//! The deceleration is made "in the same way" with a slope of its own, `f(t) = f_max − (f_max − f_start) t / t_c`, at least
//! `f_start`. Between them are `Ns_b = t_b f_max` pulses, to the nearest whole one.
//!
//! # No drift
//!
//! T(j) is no whole number of clocks. Were each one rounded by itself, the errors would add up: at 3 000 pulses/s, 333 for
//! 333.33, a clock every three pulses. So the *exact* time t(j) is accumulated, and the count is what lies between two of its
//! rounded values:
//!
//! ```text
//! TC(j) = round(t(j)) − round(t(j−1))
//! ```
//!
//! Their sum is round(t(j)): half a clock from the exact time, whatever j is. (Accumulating the integer counts
//! in (2) instead would take the error into account only as far as the slope does, and not at all at `f_max`.) "Exact" is to
//! 2⁻³² of a clock: a million pulses later, that is less than a thousandth of a clock.

use super::units::{CLOCK_HERTZ, Clocks, Frequency, Period};

/// How long a part of a profile may be, in clocks: 100 s.
const LONGEST: Clocks = Clocks(100_000_000);
/// Clocks per second times thousandths: what a frequency in thousandths divides.
const NUMERATOR: u128 = CLOCK_HERTZ as u128 * 1_000;
/// Binary places after the point of a time.
const PLACES: u32 = 32;

/// The linear speed profile of \[M\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Positioning {
    /// `f_start`: with it the train begins and ends.
    pub start: Frequency,
    /// `f_max`.
    pub max: Frequency,
    /// `t_a`: 0 is no acceleration, the train begins with `f_max`.
    pub t_a: Clocks,
    /// The part with `f_max`.
    pub hold: Hold,
    /// `t_c`: 0 is no deceleration, the train ends with `f_max`.
    pub t_c: Clocks,
}

/// How long the part with `f_max` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// `t_b`.
    For(Clocks),
    /// As long as the whole train, with both ramps, needs for so many pulses.
    ForTotal(u32),
}

/// How many pulses each part has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PartSteps {
    /// `Ns_a`, accelerating.
    pub a: u32,
    /// `Ns_b`, at a constant frequency.
    pub b: u32,
    /// `Ns_c`, decelerating.
    pub c: u32,
}

impl PartSteps {
    /// Of the train.
    #[must_use]
    pub fn total(self) -> u64 {
        u64::from(self.a) + u64::from(self.b) + u64::from(self.c)
    }
}

/// A pulse train that channel 2 can make.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Train {
    parts: [Part; 3],
    steps: PartSteps,
    duration: Clocks,
}

/// Why a train cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TimingError {
    /// A ramp that goes the wrong way.
    #[error("f_start, {start}, is more than f_max, {max}: choose a start of {max} or less")]
    StartAboveTop {
        /// `f_start`.
        start: Frequency,
        /// `f_max`.
        max: Frequency,
    },
    /// A part that is too long.
    #[error("{part} of {asked} is too long: at most {}", LONGEST)]
    TooLong {
        /// `t_a`, `t_b` or `t_c`.
        part: &'static str,
        /// How long.
        asked: Clocks,
    },
    /// The ramps alone have more pulses.
    #[error("{asked} pulses are too few: the ramps alone have {least}, {a} up and {c} down", least = a + c)]
    TooFewSteps {
        /// Pulses of the train.
        asked: u32,
        /// `Ns_a`.
        a: u32,
        /// `Ns_c`.
        c: u32,
    },
    /// A train without a pulse.
    #[error("a train has at least one pulse")]
    NoSteps,
}

impl Train {
    /// CONST. FREQ.: `steps` pulses of one frequency.
    ///
    /// # Errors
    /// If there is no pulse.
    pub fn constant(frequency: Frequency, steps: u32) -> Result<Self, TimingError> {
        let hold = Part::Hold { frequency, steps };
        Self::of([Part::NONE, hold, Part::NONE].map(Part::measured))
    }

    /// POSITIONING.
    ///
    /// # Errors
    /// If the profile cannot be.
    pub fn positioning(wanted: Positioning) -> Result<Self, TimingError> {
        let Positioning { start, max, t_a, hold, t_c } = wanted;
        if start > max {
            return Err(TimingError::StartAboveTop { start, max });
        }
        let t_b = if let Hold::For(span) = hold { span } else { Clocks(0) };
        for (part, asked) in [("t_a", t_a), ("t_b", t_b), ("t_c", t_c)] {
            if asked > LONGEST {
                return Err(TimingError::TooLong { part, asked });
            }
        }
        let up = Part::Ramp { from: start, to: max, over: t_a }.measured();
        let down = Part::Ramp { from: max, to: start, over: t_c }.measured();
        let steps = match hold {
            // To the nearest whole one; at most 100 s of 500 000 pulses/s.
            Hold::For(span) => {
                let exact = u128::from(span.0) * u128::from(max.millihertz());
                u32::try_from((exact + NUMERATOR / 2) / NUMERATOR).unwrap_or(u32::MAX)
            }
            Hold::ForTotal(asked) => {
                let (a, c) = (up.steps, down.steps);
                asked.checked_sub(a + c).ok_or(TimingError::TooFewSteps { asked, a, c })?
            }
        };
        Self::of([up, Part::Hold { frequency: max, steps }.measured(), down])
    }

    fn of(parts: [Measured; 3]) -> Result<Self, TimingError> {
        let [a, b, c] = parts.map(|part| part.steps);
        let steps = PartSteps { a, b, c };
        if steps.total() == 0 {
            return Err(TimingError::NoSteps);
        }
        let duration = Clocks(Time(parts.iter().map(|part| part.span.0).sum()).rounded());
        Ok(Self { parts: parts.map(|measured| measured.part), steps, duration })
    }

    /// How many pulses each part has.
    #[must_use]
    pub const fn steps(&self) -> PartSteps {
        self.steps
    }

    /// What is written to channel 2, pulse by pulse. Pulse j ends period j.
    #[must_use]
    pub fn periods(&self) -> Periods {
        Periods { parts: self.parts, part: 0, given: 0, within: Time(0), exact: Time(0), counted: 0 }
    }

    /// The time from the start to the last pulse.
    #[must_use]
    pub const fn duration(&self) -> Clocks {
        self.duration
    }
}

/// The counts of a train, one by one; it needs no memory for them.
#[derive(Debug, Clone)]
pub struct Periods {
    parts: [Part; 3],
    part: usize,
    /// Pulses of this part so far.
    given: u32,
    /// t(j−1), within this part.
    within: Time,
    /// Since the start.
    exact: Time,
    /// The sum of the counts so far.
    counted: u64,
}

impl Iterator for Periods {
    type Item = Period;

    fn next(&mut self) -> Option<Period> {
        let (period, is_last) = loop {
            let part = self.parts.get(self.part)?;
            if let Some(found) = part.period(self.given, self.within) {
                break found;
            }
            self.part += 1;
        };
        self.given += 1;
        self.within.0 += period.0;
        self.exact.0 += period.0;
        if is_last {
            self.part += 1;
            (self.given, self.within) = (0, Time(0));
        }
        let until = self.exact.rounded();
        let clocks = until - std::mem::replace(&mut self.counted, until);
        // Two rounded times differ by T(j) rounded up or down, and the chip has a count on either side of each frequency.
        u32::try_from(clocks).ok().and_then(Period::new)
    }
}

/// Clocks, with [`PLACES`] binary places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Time(u128);

impl Time {
    fn of(clocks: Clocks) -> Self {
        Self(u128::from(clocks.0) << PLACES)
    }

    fn rounded(self) -> u64 {
        let whole = (self.0 + (1 << (PLACES - 1))) >> PLACES;
        // A train of 2³² pulses of the longest period is still shorter.
        u64::try_from(whole).unwrap_or(u64::MAX)
    }
}

/// One of the three parts of a train.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Ramp { from: Frequency, to: Frequency, over: Clocks },
    Hold { frequency: Frequency, steps: u32 },
}

/// A part and its extent.
#[derive(Debug, Clone, Copy)]
struct Measured {
    part: Part,
    steps: u32,
    span: Time,
}

impl Part {
    const NONE: Self = Self::Hold { frequency: Frequency::HIGHEST, steps: 0 };

    /// T(j) of this part, and whether it is the last, after `given` = j − 1 pulses that took the time `within`. `None` if
    /// the part has no pulses at all.
    fn period(&self, given: u32, within: Time) -> Option<(Time, bool)> {
        match *self {
            Self::Hold { steps: 0, .. } | Self::Ramp { over: Clocks(0), .. } => None,
            Self::Hold { frequency, steps } => {
                let period = divided(NUMERATOR << PLACES, u128::from(frequency.millihertz()));
                Some((Time(period), given + 1 == steps))
            }
            Self::Ramp { from, to, over } => {
                let end = Time::of(over);
                Some((ramp_period(from, to, over, within.min(end)), within > end))
            }
        }
    }

    /// The same with how many pulses it has, and how long they take.
    fn measured(self) -> Measured {
        let (mut given, mut within) = (0, Time(0));
        if let Self::Hold { steps, .. } = self {
            // All are alike; there may be many.
            let period = self.period(given, within).map_or(0, |(period, _)| period.0);
            return Measured { part: self, steps, span: Time(period * u128::from(steps)) };
        }
        while let Some((period, is_last)) = self.period(given, within) {
            given += 1;
            within.0 += period.0;
            if is_last {
                break;
            }
        }
        Measured { part: self, steps: given, span: within }
    }
}

/// Equations (1), (3) and (4) in one fraction: `1 / f(t) = t_a / (f_start t_a + (f_max − f_start) t)`, t being at most `t_a`.
fn ramp_period(from: Frequency, to: Frequency, over: Clocks, at: Time) -> Time {
    let (from, to, over) = (u128::from(from.millihertz()), u128::from(to.millihertz()), u128::from(over.0));
    let flat = (from * over) << PLACES;
    let sloped = if to >= from { flat + (to - from) * at.0 } else { flat - (from - to) * at.0 };
    // With 100 s and 500 000 pulses/s the largest of these numbers has 121 bits.
    Time(divided((NUMERATOR * over) << (2 * PLACES), sloped))
}

/// To the nearest.
fn divided(numerator: u128, denominator: u128) -> u128 {
    (numerator + denominator / 2) / denominator
}
