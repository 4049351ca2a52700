//! The ramp table: from the speed-time curve to the numbers N that the firmware writes, plus 1, to the 8253.
//!
//! This is the program with which \[C\] made its Table 2. Only numbers here: no motion, no chip.

use supersigma_protocol::{SpeedIndex, Tick};
use thiserror::Error;

use crate::RampConfig;

/// Entries of the ramp table, one for each [`SpeedIndex`].
pub const SPEEDS: usize = SpeedIndex::TOP.get() as usize + 1;

/// The largest N for which N + 1 is still written in 16 bits as itself (an 8253 reads 0 as 65 536).
const LARGEST_N: f64 = 65_534.0;
/// The chip divides by N + 1, and in mode 2 not by 1.
const SMALLEST_N: f64 = 1.0;
/// One byte, as in the 232 differences of \[C\] Table 2.
const LARGEST_DIFFERENCE: u16 = 255;
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
    /// The same for the emergency stop.
    #[error("`brake_interval_ticks` is 0: no mechanism stops at once")]
    NoBrakeInterval,
    /// An emergency stop would take longer than a normal one.
    #[error(
        "`brake_interval_ticks` is {brake}, longer than `interval_ticks`, {normal}: braking would be slower than halting"
    )]
    BrakeSlower {
        /// Ticks per entry of the emergency stop.
        brake: u32,
        /// Ticks per entry of the normal ramp.
        normal: u32,
    },
    /// The reserve is longer than any movement.
    #[error("`offset` is {offset}, more than the 65 535 steps of the longest movement")]
    OffsetTooLong {
        /// Steps.
        offset: u32,
    },
    /// A speed that the 8253 cannot make from its 2 MHz clock.
    #[error(
        "entry {entry} is {speed:.1} steps/s, for which N is not in 1 to 65 534: an 8253 makes 30.6 to 1 000 000 steps/s"
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
    #[error("N falls by {difference} at entry {entry}, more than the 255 that one byte of the table holds")]
    TooSteep {
        /// The place in the table, 1 to 232.
        entry: u8,
        /// How much smaller N is than that of the entry before.
        difference: u16,
    },
}

impl RampError {
    /// The key of the value that is wrong; `None` when only the curve as a whole is.
    #[must_use]
    pub const fn parameter(&self) -> Option<&'static str> {
        match self {
            Self::NotFinite { parameter } => Some(parameter),
            Self::NoInterval => Some("interval_ticks"),
            Self::NoBrakeInterval | Self::BrakeSlower { .. } => Some("brake_interval_ticks"),
            Self::OffsetTooLong { .. } => Some("offset"),
            Self::Undividable { .. } | Self::SpeedFalls { .. } | Self::TooSteep { .. } => None,
        }
    }
}

impl RampConfig {
    /// The table N(0) … N(232), largest first: the firmware writes N + 1, and the chip divides 2 MHz by that.
    ///
    /// ```text
    /// V(t) = amplitude · sin²(omega · t + phase)        [C] eq. (3), t = entry · interval_ticks · 0.5 µs
    /// N    = INT(2 000 000 / V − 1 + 0.5)               [C] eq. (2)
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
                Some(before) if before - n > LARGEST_DIFFERENCE => {
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
        for (parameter, value) in
            [("amplitude", self.amplitude), ("omega", self.omega), ("phase", self.phase)]
        {
            if !value.is_finite() {
                return Err(RampError::NotFinite { parameter });
            }
        }
        let (brake, normal) = (self.brake_interval_ticks, self.interval_ticks);
        match (normal, brake) {
            (0, _) => Err(RampError::NoInterval),
            (_, 0) => Err(RampError::NoBrakeInterval),
            _ if brake > normal => Err(RampError::BrakeSlower { brake, normal }),
            _ if self.offset > LARGEST_OFFSET => Err(RampError::OffsetTooLong { offset: self.offset }),
            _ => Ok(()),
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the range is checked before"
    )]
    fn n_at(&self, entry: u8) -> Result<u16, RampError> {
        let seconds = f64::from(entry) * f64::from(self.interval_ticks) / CLOCK_HERTZ;
        let speed = self.amplitude * (self.omega * seconds + self.phase).sin().powi(2);
        let n = (CLOCK_HERTZ / speed - 1.0 + 0.5).trunc();
        if (SMALLEST_N..=LARGEST_N).contains(&n) {
            Ok(n as u16)
        } else {
            Err(RampError::Undividable { entry, speed })
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ShortMoves;

    fn differences(counts: &[u16]) -> Vec<u16> {
        counts.windows(2).map(|pair| pair[0] - pair[1]).collect()
    }

    #[test]
    fn the_default_curve_makes_the_table_of_the_paper() {
        let counts = RampConfig::default().counts().expect("the default ramp is usable");
        let differences = differences(&counts);
        assert_eq!((counts[0], counts[232]), (3_076, 132));
        assert_eq!(differences.len(), 232);
        assert_eq!(differences[..3], [163, 150, 138]);
        assert_eq!(differences.iter().max(), Some(&163));
        assert_eq!(differences.iter().sum::<u16>(), 2_944);
    }

    #[test]
    fn the_printed_amplitude_contradicts_the_text_of_the_paper() {
        let counts = RampConfig { amplitude: 14_000.0, ..RampConfig::default() }.counts().expect("usable");
        // 606.7 and 14 000 steps/s, where the text says 650 and 15 000.
        assert_eq!((counts[0], counts[232]), (3_296, 142));
    }

    #[test]
    fn every_reason_is_named() {
        let ok = RampConfig::default;
        let reasons = [
            (RampConfig { omega: f64::NAN, ..ok() }, RampError::NotFinite { parameter: "omega" }),
            (RampConfig { phase: f64::INFINITY, ..ok() }, RampError::NotFinite { parameter: "phase" }),
            (RampConfig { interval_ticks: 0, ..ok() }, RampError::NoInterval),
            (RampConfig { brake_interval_ticks: 0, ..ok() }, RampError::NoBrakeInterval),
            (
                RampConfig { brake_interval_ticks: 2_581, ..ok() },
                RampError::BrakeSlower { brake: 2_581, normal: 2_580 },
            ),
            (RampConfig { offset: 65_536, ..ok() }, RampError::OffsetTooLong { offset: 65_536 }),
            (RampConfig { amplitude: 0.0, ..ok() }, RampError::Undividable { entry: 0, speed: 0.0 }),
            // The curve starts on its top, 15 000 steps/s (N = 132), and is at 14 974.8 at entry 7 (N = 133).
            (
                RampConfig { phase: std::f64::consts::FRAC_PI_2, ..ok() },
                RampError::SpeedFalls { entry: 7, before: 132, n: 133 },
            ),
            // V = 60.023 and 71.637 steps/s, N = 33 319 and 27 918.
            (RampConfig { phase: 0.063_3, ..ok() }, RampError::TooSteep { entry: 1, difference: 5_401 }),
        ];
        for (ramp, reason) in reasons {
            assert_eq!(ramp.counts(), Err(reason));
        }
    }

    proptest! {
        /// Whatever the parameters, a table that is given out can be played by the chip and stored in bytes.
        #[test]
        fn a_table_is_usable_or_refused(
            amplitude in -1e4..2e6_f64,
            omega in -10.0..10.0_f64,
            phase in -4.0..4.0_f64,
            interval_ticks in 0..10_000_u32,
        ) {
            let ramp = RampConfig {
                amplitude, omega, phase, interval_ticks, brake_interval_ticks: 1, offset: 10,
                short_moves: ShortMoves::Optimal,
            };
            if let Ok(counts) = ramp.counts() {
                prop_assert!(counts.iter().all(|n| (1..=65_534).contains(n)));
                prop_assert!(counts.windows(2).all(|pair| pair[1] <= pair[0] && pair[0] - pair[1] <= 255));
            }
        }
    }
}
