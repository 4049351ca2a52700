//! The second-order low pass of \[M\] section 4: Butterworth's, made digital by the bilinear transform.
//!
//! ```text
//!                  1                                      ω = 2π fc / fs, the cutoff as an angle per sample
//!  H(s) = ─────────────────      s = (z − 1)/(z + 1) / tan(ω/2)
//!          s² + √2 s + 1
//! ```
//!
//! The factor 1/tan(ω/2) is the pre-warping: it puts the half-power point exactly at fc, whatever the sampling frequency.

use axis_worker::bench::Sampling;
use biquad::{Biquad, Coefficients, DirectForm2Transposed, Q_BUTTERWORTH_F64, Type};

use super::differentiator::Differentiator;
use super::{FilterError, Response, hertz};

/// Where the low pass takes half of the power, in hertz.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Cutoff(f64);

impl Cutoff {
    /// Below it the latency is longer than a movement.
    pub const LOWEST: Self = Self(1.0);
    /// Where the derivative filter's pass band ends.
    pub const HIGHEST: Self = Self(Differentiator::PASS_HERTZ);
    /// Lets through what a rotor does about its detent, 162 Hz for the bench motor, and holds back most of the encoder's
    /// lines.
    pub const SWINGS: Self = Self(400.0);
    /// Holds back the swings, and lets through what a ramp does.
    pub const RAMPS: Self = Self(50.0);

    /// At this frequency.
    ///
    /// # Errors
    /// Outside [`Self::LOWEST`] to [`Self::HIGHEST`].
    pub fn new(hertz: f64) -> Result<Self, FilterError> {
        let range = Self::LOWEST.0..=Self::HIGHEST.0;
        range.contains(&hertz).then_some(Self(hertz)).ok_or(FilterError::Cutoff { hertz })
    }

    /// In hertz.
    #[must_use]
    pub const fn hertz(self) -> f64 {
        self.0
    }
}

/// A stream of samples, smoothed. Before the first one, everything was as that one is: it begins without a jump.
#[derive(Debug, Clone)]
pub struct LowPass {
    coefficients: Coefficients<f64>,
    section: DirectForm2Transposed<f64>,
    first: Option<f64>,
    sampling: Sampling,
}

impl LowPass {
    /// For samples that come at this rate.
    ///
    /// # Errors
    /// If the cutoff is half the sampling frequency or more; no [`Cutoff`] is.
    pub fn new(cutoff: Cutoff, sampling: Sampling) -> Result<Self, FilterError> {
        let share = 2.0 * cutoff.hertz() / hertz(sampling);
        let coefficients = Coefficients::from_normalized_params(Type::LowPass, share, Q_BUTTERWORTH_F64)
            .map_err(|_| FilterError::Cutoff { hertz: cutoff.hertz() })?;
        Ok(Self { coefficients, section: DirectForm2Transposed::new(coefficients), first: None, sampling })
    }

    /// Takes a sample and gives one.
    pub fn push(&mut self, sample: f64) -> f64 {
        // Its gain for what does not change is 1, so the rest before the first sample is left out and added again.
        let first = *self.first.get_or_insert(sample);
        first + self.section.run(sample - first)
    }

    /// By how many samples what changes slowly comes out late: the group delay at frequency 0. It grows to 1.21 times that
    /// at 0.64 of the cutoff, is the same again at the cutoff, and falls beyond.
    #[must_use]
    pub fn delay(&self) -> f64 {
        let [numerator, denominator] = [self.numerator(), self.denominator()];
        let mean = |c: [f64; 3]| (c[1] + 2.0 * c[2]) / (c[0] + c[1] + c[2]);
        mean(numerator) - mean(denominator)
    }

    /// What it makes of a sine of this frequency.
    #[must_use]
    pub fn response(&self, frequency: f64) -> Response {
        let [over, under] = [self.numerator(), self.denominator()]
            .map(|coefficients| Response::of(Response::polynomial(&coefficients, frequency, self.sampling)));
        Response { gain: over.gain / under.gain, phase: over.phase - under.phase }
    }

    /// b₀, b₁, b₂.
    pub(super) fn numerator(&self) -> [f64; 3] {
        [self.coefficients.b0, self.coefficients.b1, self.coefficients.b2]
    }

    /// 1, a₁, a₂.
    pub(super) fn denominator(&self) -> [f64; 3] {
        [1.0, self.coefficients.a1, self.coefficients.a2]
    }
}
