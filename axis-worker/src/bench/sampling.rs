//! When the interrupt reads the counters: SAMP of \[M\], 20 to 60 kHz. Few of these frequencies have a whole number of ticks
//! to a sample. Sample k comes at the tick nearest to k / f, reckoned from the start each time, so that nothing adds up.

use supersigma_protocol::Tick;

/// How often the position is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling(u32);

/// A sampling frequency that the bench does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the bench samples at 20 000 to 60 000 Hz, not at {asked} Hz: the nearest possible is {} Hz",
    self.nearest()
)]
pub struct SamplingError {
    /// Samples per second.
    pub asked: u32,
}

impl SamplingError {
    /// The nearest that it has.
    #[must_use]
    pub fn nearest(&self) -> u32 {
        self.asked.clamp(Sampling::LOWEST.0, Sampling::HIGHEST.0)
    }
}

impl Sampling {
    /// 20 kHz.
    pub const LOWEST: Self = Self(20_000);
    /// 60 kHz.
    pub const HIGHEST: Self = Self(60_000);

    /// So many samples per second.
    ///
    /// # Errors
    /// Below 20 000 and above 60 000.
    pub const fn new(hertz: u32) -> Result<Self, SamplingError> {
        if hertz < Self::LOWEST.0 || hertz > Self::HIGHEST.0 {
            Err(SamplingError { asked: hertz })
        } else {
            Ok(Self(hertz))
        }
    }

    /// Samples per second.
    #[must_use]
    pub const fn hertz(self) -> u32 {
        self.0
    }

    /// When sample `number` is taken; number 0 is at 0.
    #[must_use]
    pub fn tick_of(self, number: u64) -> Tick {
        let hertz = u128::from(self.0);
        let tick = (u128::from(number) * u128::from(Tick::PER_SECOND) + hertz / 2) / hertz;
        Tick(u64::try_from(tick).unwrap_or(u64::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_has_all_its_samples_whatever_the_frequency() {
        for hertz in [20_000, 30_000, 44_100, 59_999, 60_000] {
            let sampling = Sampling::new(hertz).expect("possible");
            let second = u64::from(hertz);
            for seconds in [0, 1, 3_600, 1_000_000] {
                assert_eq!(sampling.tick_of(seconds * second), Tick(seconds * Tick::PER_SECOND));
            }
            let spans: Vec<u64> =
                (0..second).map(|k| sampling.tick_of(k + 1).since(sampling.tick_of(k)).0).collect();
            let short = Tick::PER_SECOND / second;
            assert!(spans.iter().all(|span| (short..=short + 1).contains(span)), "{hertz}");
        }
    }

    #[test]
    fn other_frequencies_are_refused_with_the_nearest() {
        let refused = |hertz| Sampling::new(hertz).expect_err("impossible").to_string();
        assert!(refused(19_999).ends_with("the nearest possible is 20000 Hz"), "{}", refused(19_999));
        assert!(refused(0).ends_with("20000 Hz") && refused(100_000).ends_with("60000 Hz"));
    }
}
