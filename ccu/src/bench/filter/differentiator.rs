//! The derivative filter of \[M\] section 4: an antisymmetric FIR, designed by the Remez exchange (Parks, `McClellan`).
//!
//! ```text
//!  gain, of
//!  2πf
//!   1 ┤▔▔▔▔▔▔╲              pass band: up to 1 kHz, |H(f)| = 2πf within the ripple
//!     │        ╲            stop band: from 1 kHz + 4 fs/(N − 1) on, at most the ripple of what 1 kHz has
//!     │          ╲
//!   0 ┤────────────▁▂▁▂▁▂▁  f
//!     0    1 kHz       fs/2
//! ```
//!
//! A differentiator up to half the sampling frequency would amplify most what is only the encoder's lines. The width of
//! the transition follows from the number of taps such that the ripple is about 0.1 % for every number: more taps let
//! less of the encoder's lines through, and come later. The design is that of MATLAB's `remez`, which \[M\] names: relative
//! error in the pass band, so that a slow speed is as exact as a fast one.

use std::f64::consts::TAU;

use axis_worker::bench::Sampling;
use pm_remez::{
    BandSetting, ParametersBuilder, Symmetry, constant, function, linear, pm_parameters, pm_remez,
};

use super::{FilterError, Response, hertz};

/// The length of the derivative filter: odd, so that its latency is a whole number of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Taps(usize);

impl Taps {
    /// With fewer, no room is left for a stop band at 20 kHz.
    pub const FEWEST: Self = Self(11);
    /// 15 ms at 20 kHz.
    pub const MOST: Self = Self(301);

    /// So many.
    ///
    /// # Errors
    /// If they are even, or not from [`Self::FEWEST`] to [`Self::MOST`].
    pub fn new(taps: usize) -> Result<Self, FilterError> {
        let good = taps % 2 == 1 && (Self::FEWEST.0..=Self::MOST.0).contains(&taps);
        good.then_some(Self(taps)).ok_or(FilterError::Taps { taps })
    }

    /// A millisecond of samples: 21 at 20 kHz, 61 at 60 kHz.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "10 to 30")]
    pub fn of_a_millisecond(sampling: Sampling) -> Self {
        let half = (hertz(sampling) / 2e3).round() as usize;
        Self(2 * half + 1)
    }

    /// How many.
    #[must_use]
    pub const fn get(self) -> usize {
        self.0
    }
}

/// A stream of positions that becomes one of speeds. Before the first position, the shaft stood there.
#[derive(Debug, Clone)]
pub struct Differentiator {
    taps: Vec<f64>,
    ripple: f64,
    sampling: Sampling,
    /// The last positions, the newest at `newest`; empty before the first one.
    window: Vec<f64>,
    newest: usize,
}

impl Differentiator {
    /// Up to this frequency it differentiates.
    pub const PASS_HERTZ: f64 = 1_000.0;
    /// How wide the transition is, of the sampling frequency and one tap.
    const TRANSITION: f64 = 4.0;

    /// For positions that come at this rate.
    ///
    /// # Errors
    /// If the design does not converge.
    pub fn new(taps: Taps, sampling: Sampling) -> Result<Self, FilterError> {
        let Equiripple { taps, ripple } = Equiripple::new(taps, sampling)?;
        // A steady speed is to come out as it is, without the ripple's error.
        let ramp: f64 = -taps.iter().zip(0_u32..).map(|(tap, k)| tap * f64::from(k)).sum::<f64>();
        let scale = hertz(sampling) / ramp;
        let ripple = [1.0 - ripple, 1.0 + ripple].map(|gain| (gain / (TAU * ramp) - 1.0).abs());
        let ripple = ripple[0].max(ripple[1]);
        let taps = taps.into_iter().map(|tap| tap * scale).collect();
        Ok(Self { taps, ripple, sampling, window: Vec::new(), newest: 0 })
    }

    /// Takes a position and gives a speed, in the position's unit per second.
    pub fn push(&mut self, position: f64) -> f64 {
        if self.window.is_empty() {
            self.window = vec![position; self.taps.len()];
        }
        self.newest = self.newest.checked_sub(1).unwrap_or(self.taps.len() - 1);
        self.window[self.newest] = position;
        let (older, newer) = self.window.split_at(self.newest);
        // Differences from the newest position, so that however far the shaft has turned, a shaft at rest gives 0.
        newer.iter().chain(older).zip(&self.taps).map(|(then, tap)| (then - position) * tap).sum()
    }

    /// By how many samples speeds come late, all frequencies alike: (N − 1) / 2.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "at most 150")]
    pub fn delay(&self) -> f64 {
        ((self.taps.len() - 1) / 2) as f64
    }

    /// The largest error in the pass band, of the speed that is.
    #[must_use]
    pub const fn ripple(&self) -> f64 {
        self.ripple
    }

    /// From this frequency on nothing passes, in hertz.
    #[must_use]
    pub fn stop_hertz(&self) -> f64 {
        stop_hertz(self.taps.len(), self.sampling)
    }

    /// What it makes of a sine of this frequency: the gain is that of its derivative, 2πf in the pass band.
    #[must_use]
    pub fn response(&self, frequency: f64) -> Response {
        Response::of(Response::polynomial(&self.taps, frequency, self.sampling))
    }
}

/// The design alone: taps whose response is jf, f in cycles per sample.
pub(super) struct Equiripple {
    pub(super) taps: Vec<f64>,
    pub(super) ripple: f64,
}

impl Equiripple {
    pub(super) fn new(taps: Taps, sampling: Sampling) -> Result<Self, FilterError> {
        let no_design = |reason: &dyn std::fmt::Display| FilterError::NoDesign {
            taps: taps.get(),
            sampling: sampling.hertz(),
            reason: reason.to_string(),
        };
        let pass = Differentiator::PASS_HERTZ / hertz(sampling);
        let stop = stop_hertz(taps.get(), sampling) / hertz(sampling);
        let relative = function(Box::new(|frequency| 1.0 / frequency));
        let design = BandSetting::with_weight(0.0, pass, linear(0.0, pass), relative)
            .and_then(|pass_band| {
                let stop_band = BandSetting::with_weight(stop, 0.5, constant(0.0), constant(1.0 / pass))?;
                let bands = [pass_band, stop_band];
                let mut parameters = pm_parameters(taps.get(), &bands)?;
                parameters.set_symmetry(Symmetry::Odd);
                parameters.set_flatness_threshold(FLAT);
                pm_remez(&parameters)
            })
            .map_err(|error| no_design(&error))?;
        if design.flatness > FLAT {
            return Err(no_design(&"its ripples are not of one height"));
        }
        // The design has the sign of its first half; a derivative is the newest position less the older ones.
        let sign = if design.impulse_response[taps.get() / 2 - 1] > 0.0 { 1.0 } else { -1.0 };
        let taps = design.impulse_response.iter().map(|tap| tap * sign).collect();
        Ok(Self { taps, ripple: design.weighted_error })
    }
}

/// How far the heights of the ripples may differ.
const FLAT: f64 = 1e-6;

#[expect(clippy::cast_precision_loss, reason = "at most 301")]
fn stop_hertz(taps: usize, sampling: Sampling) -> f64 {
    Differentiator::PASS_HERTZ + Differentiator::TRANSITION * hertz(sampling) / (taps - 1) as f64
}
