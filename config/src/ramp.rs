//! The ramp table: from the profile to the numbers N that the firmware writes, plus 1, to the 8253.
//!
//! This is the program with which \[C\] made its Table 2, for other profiles too. Only numbers here: no motion, no chip.

use supersigma_protocol::{SpeedIndex, Tick};
use thiserror::Error;

use crate::{Differences, Linear, Profile, RampConfig, Sin2};

/// Entries of the ramp table, one for each [`SpeedIndex`].
pub const SPEEDS: usize = SpeedIndex::TOP.get() as usize + 1;

/// The smallest N of a ramp. A period of N + 1 ticks must be longer than the 25 ticks within which the firmware writes the
/// count of the next one.
pub const SMALLEST_N: u16 = 25;
/// The largest N for which N + 1 is still written in 16 bits as itself (an 8253 reads 0 as 65 536).
const LARGEST_N: u16 = 65_534;
/// One byte, as in the 232 differences of \[C\] Table 2.
const LARGEST_BYTE: u16 = 255;
/// One second from one entry to the next, in ticks. So the pulses of a ramp are countable in 32 bits.
const LONGEST_INTERVAL: u32 = 2_000_000;
/// The longest movement of one command; a reserve beyond it would forbid every ramp.
const LARGEST_OFFSET: u32 = 65_535;
/// Fin, the clock of the 8253.
#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
const CLOCK_HERTZ: f64 = Tick::PER_SECOND as f64;

/// Why a curve makes no usable ramp table.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RampError {
    /// A parameter of the curve is infinite or not a number.
    #[error("`{parameter}` is not a finite number")]
    NotFinite {
        /// Its key.
        parameter: &'static str,
    },
    /// The entries of the table follow each other without time between them.
    #[error("`interval_ticks` is 0: the ramp would take no time")]
    NoInterval,
    /// A linear ramp in no time.
    #[error("`t_a` is {seconds} s, and 116 µs are the least: one tick from each of 233 entries to the next")]
    NoTime {
        /// Seconds.
        seconds: f64,
    },
    /// A ramp of minutes.
    #[error(
        "from one entry to the next {ticks} ticks would pass, more than a second: the whole ramp has 232 of them"
    )]
    IntervalTooLong {
        /// The key that says so.
        parameter: &'static str,
        /// Ticks.
        ticks: u32,
    },
    /// A linear ramp that goes down.
    #[error("`f_max` is {f_max} steps/s, less than `f_start`, {f_start}")]
    Falls {
        /// Steps per second.
        f_start: f64,
        /// Steps per second.
        f_max: f64,
    },
    /// A table that is none, or more than the card holds.
    #[error("the table has {length} entries, a ramp has 2 to 233")]
    Length {
        /// Entries.
        length: usize,
    },
    /// The same for the emergency stop.
    #[error("`brake_interval_ticks` is 0: no mechanism stops at once")]
    NoBrakeInterval,
    /// An emergency stop would take longer than a normal one.
    #[error(
        "`brake_interval_ticks` is {brake}, longer than {of}, {normal}: braking would be slower than halting",
        of = if *derived { "the interval of the ramp, t_a / 232" } else { "`interval_ticks`" }
    )]
    BrakeSlower {
        /// Ticks per entry of the emergency stop.
        brake: u32,
        /// Ticks per entry of the normal ramp.
        normal: u32,
        /// Whether these follow from `t_a`.
        derived: bool,
    },
    /// The reserve is longer than any movement.
    #[error("`offset` is {offset}, more than the 65 535 steps of the longest movement")]
    OffsetTooLong {
        /// Steps.
        offset: u32,
    },
    /// A speed that a card cannot make: the 8253 from its 2 MHz clock, or the firmware in its time.
    #[error(
        "entry {entry} is {speed:.1} steps/s, for which N is not in 25 to 65 534: a card makes 30.6 to 76 923 steps/s"
    )]
    Undividable {
        /// The place in the table, 0 to 232.
        entry: u8,
        /// Steps per second.
        speed: f64,
    },
    /// The curve goes over its top.
    #[error(
        "entry {entry} is slower than the one before it (N rises from {before} to {n}): the speeds of a ramp must never fall"
    )]
    SpeedFalls {
        /// The place in the table, 1 to 232.
        entry: u8,
        /// N of the entry before.
        before: u16,
        /// N of this entry.
        n: u16,
    },
    /// The table of differences is stored in bytes.
    #[error(
        "N falls by {difference} at entry {entry}, more than the 255 that one byte of the table holds; \
         `differences = \"wide\"` would allow it"
    )]
    TooSteep {
        /// The place in the table, 1 to 232.
        entry: u8,
        /// How much smaller N is than that of the entry before.
        difference: u16,
    },
}

impl RampError {
    /// The key of the value that is wrong; `None` when only the profile as a whole is.
    #[must_use]
    pub const fn parameter(&self) -> Option<&'static str> {
        match self {
            Self::NotFinite { parameter } | Self::IntervalTooLong { parameter, .. } => Some(parameter),
            Self::NoInterval => Some("interval_ticks"),
            Self::NoTime { .. } => Some("t_a"),
            Self::Falls { .. } => Some("f_max"),
            Self::Length { .. } => Some("counts"),
            Self::NoBrakeInterval | Self::BrakeSlower { .. } => Some("brake_interval_ticks"),
            Self::OffsetTooLong { .. } => Some("offset"),
            Self::Undividable { .. } | Self::SpeedFalls { .. } | Self::TooSteep { .. } => None,
        }
    }

    /// The entry of the table at which it shows.
    #[must_use]
    pub const fn entry(&self) -> Option<u8> {
        match self {
            Self::Undividable { entry, .. }
            | Self::SpeedFalls { entry, .. }
            | Self::TooSteep { entry, .. } => Some(*entry),
            _ => None,
        }
    }
}

impl RampConfig {
    /// The table N(0) … N(232), largest first: the firmware writes N + 1, and the chip divides 2 MHz by that.
    ///
    /// ```text
    /// sin2     V(t) = amplitude · sin²(omega · t + phase)           [C] eq. (3), t = entry · interval_ticks · 0.5 µs
    /// linear   V = f_start + (f_max − f_start) · entry / 232        [M] eq. (1) and (3) at t = entry · t_a / 232
    ///          N = INT(2 000 000 / V − 1 + 0.5)                     [C] eq. (2)
    /// table    N as given, and the last one for all further entries
    /// ```
    ///
    /// With the default curve N(0) = 3 076 (650 steps/s) and N(232) = 132 (15 000 steps/s).
    ///
    /// # Errors
    ///
    /// [`RampError`], the first reason found why this ramp is unusable.
    pub fn counts(&self) -> Result<[u16; SPEEDS], RampError> {
        self.check_parameters()?;
        let mut counts = [0; SPEEDS];
        let mut before = None;
        for (entry, place) in (0..=SpeedIndex::TOP.get()).zip(&mut counts) {
            let n = self.n_at(entry)?;
            match before {
                Some(before) if n > before => {
                    return Err(RampError::SpeedFalls { entry, before, n });
                }
                Some(before) if before - n > LARGEST_BYTE && self.differences == Differences::Byte => {
                    return Err(RampError::TooSteep { entry, difference: before - n });
                }
                _ => {}
            }
            *place = n;
            before = Some(n);
        }
        Ok(counts)
    }

    fn check_parameters(&self) -> Result<(), RampError> {
        let key_of_interval = match &self.profile {
            Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks }) => {
                finite([("amplitude", *amplitude), ("omega", *omega), ("phase", *phase)])?;
                if *interval_ticks == 0 {
                    return Err(RampError::NoInterval);
                }
                "interval_ticks"
            }
            Profile::Linear(Linear { f_start, f_max, t_a }) => {
                finite([("f_start", *f_start), ("f_max", *f_max), ("t_a", *t_a)])?;
                if f_max < f_start {
                    return Err(RampError::Falls { f_start: *f_start, f_max: *f_max });
                }
                // Less than a tick from entry to entry; `interval_ticks` would round up.
                if t_a * CLOCK_HERTZ < f64::from(SpeedIndex::TOP.get()) {
                    return Err(RampError::NoTime { seconds: *t_a });
                }
                "t_a"
            }
            Profile::Table(table) => {
                let length = table.counts.len();
                if !(2..=SPEEDS).contains(&length) {
                    return Err(RampError::Length { length });
                }
                if table.interval_ticks == 0 {
                    return Err(RampError::NoInterval);
                }
                "interval_ticks"
            }
        };
        let (brake, normal) = (self.brake_interval_ticks, self.interval_ticks());
        if normal > LONGEST_INTERVAL {
            return Err(RampError::IntervalTooLong { parameter: key_of_interval, ticks: normal });
        }
        match brake {
            0 => Err(RampError::NoBrakeInterval),
            _ if brake > normal => {
                Err(RampError::BrakeSlower { brake, normal, derived: key_of_interval == "t_a" })
            }
            _ if self.offset > LARGEST_OFFSET => Err(RampError::OffsetTooLong { offset: self.offset }),
            _ => Ok(()),
        }
    }

    fn n_at(&self, entry: u8) -> Result<u16, RampError> {
        let speed = match &self.profile {
            Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks }) => {
                let seconds = f64::from(entry) * f64::from(*interval_ticks) / CLOCK_HERTZ;
                amplitude * (omega * seconds + phase).sin().powi(2)
            }
            Profile::Linear(linear) => linear.speed(entry),
            Profile::Table(table) => {
                let n = *table.counts.get(usize::from(entry)).or(table.counts.last()).unwrap_or(&0);
                let speed = CLOCK_HERTZ / (f64::from(n) + 1.0);
                let usable = (SMALLEST_N..=LARGEST_N).contains(&n);
                return if usable { Ok(n) } else { Err(RampError::Undividable { entry, speed }) };
            }
        };
        let n = (CLOCK_HERTZ / speed - 1.0 + 0.5).trunc();
        if (f64::from(SMALLEST_N)..=f64::from(LARGEST_N)).contains(&n) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is in the range")]
            Ok(n as u16)
        } else {
            Err(RampError::Undividable { entry, speed })
        }
    }
}

fn finite(parameters: [(&'static str, f64); 3]) -> Result<(), RampError> {
    match parameters.into_iter().find(|(_, value)| !value.is_finite()) {
        Some((parameter, _)) => Err(RampError::NotFinite { parameter }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
