//! A recording's speeds, each at the time that it is of.

use axis_worker::bench::Sampling;

use super::{Cutoff, Differentiator, FilterError, LowPass, Taps, seconds};

/// A speed and when it was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// After the first sample.
    pub seconds: f64,
    /// In the position's unit per second.
    pub speed: f64,
}

/// Which filters are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Of the low pass.
    pub cutoff: Cutoff,
    /// Of the derivative filter; a millisecond of samples if none are chosen.
    pub taps: Option<Taps>,
}

/// What both filters make of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Speeds {
    /// Of the derivative filter.
    pub instant: Vec<Point>,
    /// Of the derivative filter and then the low pass: \[M\]'s real speed.
    pub filtered: Vec<Point>,
    /// The largest error of speeds that change with at most [`Differentiator::PASS_HERTZ`], of the speed that is, before
    /// the low pass.
    pub ripple: f64,
    /// By how many seconds the filtered speed came late.
    pub latency: f64,
}

impl Speeds {
    /// Of positions that were sampled at this rate, in any unit.
    ///
    /// The latency of both filters is taken back: an output stands at the time that it is of. What they would say of times
    /// before the first sample is left out; the shaft stood still then. Of the last [`Self::latency`] they say nothing,
    /// because what came after it is not known.
    ///
    /// # Errors
    /// If the filters cannot be made.
    pub fn new(
        positions: impl IntoIterator<Item = f64>,
        sampling: Sampling,
        choice: Choice,
    ) -> Result<Self, FilterError> {
        let taps = choice.taps.unwrap_or_else(|| Taps::of_a_millisecond(sampling));
        let mut derivative = Differentiator::new(taps, sampling)?;
        let mut low_pass = LowPass::new(choice.cutoff, sampling)?;
        let late = derivative.delay();
        let later = late + low_pass.delay();
        let (mut instant, mut filtered) = (Vec::new(), Vec::new());
        for (position, sample) in positions.into_iter().zip(0_u32..) {
            let speed = derivative.push(position);
            let smooth = low_pass.push(speed);
            for (curve, speed, late) in [(&mut instant, speed, late), (&mut filtered, smooth, later)] {
                let seconds = seconds(f64::from(sample) - late, sampling);
                if seconds >= 0.0 {
                    curve.push(Point { seconds, speed });
                }
            }
        }
        let latency = seconds(later, sampling);
        Ok(Self { instant, filtered, ripple: derivative.ripple(), latency })
    }
}
