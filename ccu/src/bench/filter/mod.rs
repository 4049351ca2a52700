//! Filters for the encoder's samples, \[M\] section 4: a derivative filter by the Remez exchange makes speed of position,
//! a second-order low pass makes that smooth. Both are designed for the chosen sampling frequency.
//!
//! ```text
//!  position ──► Differentiator ──► instantaneous speed ──► LowPass ──► filtered speed
//!   counts       N taps, late by                            late by its group delay
//!                (N − 1) / 2 samples                        at frequency 0
//! ```
//!
//! They are streams: a sample in, a sample out, with the latency told. [`Speeds`] runs a recording through both and puts
//! every value back to the time that it is of. Nothing in here knows where samples come from, or what they are shown on;
//! whatever unit a position has, its speed has per second.

mod differentiator;
mod edges;
mod low_pass;
mod speeds;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use axis_worker::bench::Sampling;

pub use differentiator::{Differentiator, Taps};
pub use edges::between_edges;
pub use low_pass::{Cutoff, LowPass};
pub use speeds::{Choice, Point, Speeds};

/// What a filter makes of a sine: of its amplitude, and of its phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Amplitude that comes out, for one of 1 that goes in.
    pub gain: f64,
    /// By how many radians it comes out ahead; negative if behind.
    pub phase: f64,
}

impl Response {
    /// Of the polynomial Σ cₖ z⁻ᵏ at a frequency, as real and imaginary part.
    fn polynomial(coefficients: &[f64], frequency: f64, sampling: Sampling) -> (f64, f64) {
        let step = TAU * frequency / hertz(sampling);
        coefficients.iter().zip(0_u32..).fold((0.0, 0.0), |(re, im), (coefficient, k)| {
            let (sin, cos) = (step * f64::from(k)).sin_cos();
            (re + coefficient * cos, im - coefficient * sin)
        })
    }

    fn of((re, im): (f64, f64)) -> Self {
        Self { gain: re.hypot(im), phase: im.atan2(re) }
    }
}

/// Why a filter cannot be made as it is wanted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// The low pass would let through what the derivative filter already takes away, or nothing at all.
    #[error("a cutoff of {hertz} Hz is outside {} to {} Hz", Cutoff::LOWEST.hertz(), Cutoff::HIGHEST.hertz())]
    Cutoff {
        /// What was wanted.
        hertz: f64,
    },
    /// Without a middle, or with too few or too many.
    #[error(
        "{taps} taps: the derivative filter has an odd number of them, {} to {}",
        Taps::FEWEST.get(),
        Taps::MOST.get()
    )]
    Taps {
        /// What was wanted.
        taps: usize,
    },
    /// The Remez exchange found no equiripple filter.
    #[error("no derivative filter of {taps} taps was found for {sampling} Hz ({reason}); try other --taps")]
    NoDesign {
        /// Its length.
        taps: usize,
        /// In hertz.
        sampling: u32,
        /// What the design said.
        reason: String,
    },
}

/// When a sample was taken, in seconds after the first one. Fractions lie between samples.
fn seconds(samples: f64, sampling: Sampling) -> f64 {
    samples / hertz(sampling)
}

fn hertz(sampling: Sampling) -> f64 {
    f64::from(sampling.hertz())
}
