//! How a ramp is looked for, whatever its shape.

use std::thread;

use supersigma_config::MotorError;

use super::pulses::Pulses;
use super::stand::Stand;

/// Parts of the start-stop frequency with which a ramp may start.
const STARTS: [f64; 3] = [1.0, 0.8, 0.6];
/// How many tops are tried for each start.
pub(super) const TOPS: u32 = 10;
/// How many ramps for each top: the longest, and the bisection.
pub(super) const RAMPS: u32 = 9;
/// A ramp is found to this part of itself.
const PRECISION: f64 = 0.02;
/// A top lies this much above its start at least, or there is no need of a ramp.
const LEAST_RISE: f64 = 1.05;

/// A ramp, and the movement along it.
#[derive(Debug, Clone)]
pub(super) struct Made<R> {
    pub(super) ramp: R,
    pub(super) pulses: Pulses,
}

/// What is looked for.
pub(super) trait Shape: Sync {
    /// A ramp.
    type Ramp: Send;

    /// The shortest ramp that holds from a start to a top, both in half steps/s; `None` if there is none that also fits
    /// into the movement.
    fn shortest(&self, start: f64, top: f64) -> Option<Made<Self::Ramp>>;

    /// What is still to be done with the best ramp of a start.
    fn finish(&self, made: Made<Self::Ramp>) -> Option<Made<Self::Ramp>>;
}

/// The fastest of all movements that a shape finds. Every start has its own thread.
pub(super) fn search<S: Shape>(
    shape: &S,
    start_stop: f64,
    stand: &Stand,
) -> Result<Option<Made<S::Ramp>>, MotorError> {
    let from = |part: f64| best_top(shape, (start_stop * part).floor(), stand);
    let found = thread::scope(|scope| {
        let searches = STARTS.map(|part| scope.spawn(move || from(part)));
        searches.map(|search| search.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok(found.into_iter().flatten().min_by_key(|made| made.pulses.duration()))
}

/// The same for one start.
fn best_top<S: Shape>(shape: &S, start: f64, stand: &Stand) -> Result<Option<Made<S::Ramp>>, MotorError> {
    let (lowest, top) = (start * LEAST_RISE, stand.pull_out(start / 2.0)?);
    if top <= lowest {
        return Ok(None);
    }
    let mut best: Option<Made<S::Ramp>> = None;
    golden_section(lowest.ln(), top.ln(), &mut |logarithm: f64| {
        let found = shape.shortest(start, logarithm.exp().round());
        let ticks = found.as_ref().map_or(u64::MAX, |made| made.pulses.duration().0);
        if best.as_ref().is_none_or(|best| ticks < best.pulses.duration().0) {
            best = found.or(best.take());
        }
        ticks
    });
    Ok(best.and_then(|made| shape.finish(made)))
}

/// Looks for the smallest value of `look` between `low` and `high`, with [`TOPS`] looks; whoever looks remembers it.
fn golden_section(mut low: f64, mut high: f64, look: &mut dyn FnMut(f64) -> u64) {
    const PART: f64 = 0.618_033_988_749_894_9;
    let (mut left, mut right) = (high - PART * (high - low), low + PART * (high - low));
    let (mut at_left, mut at_right) = (look(left), look(right));
    for _ in 2..TOPS {
        // Where neither is possible, what is slower is.
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - PART * (high - low);
            at_left = look(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + PART * (high - low);
            at_right = look(right);
        }
    }
}

/// The shortest of the ramps `shortest..=longest`, in whole units, that holds; `None` if not even the longest does. By
/// bisection of its logarithm, with at most [`RAMPS`] looks.
pub(super) fn shortest(shortest: u32, longest: u32, holds: impl Fn(u32) -> bool) -> Option<u32> {
    if longest < shortest || !holds(longest) {
        return None;
    }
    let (mut bad, mut good) = (shortest.max(1) - 1, longest);
    for _ in 1..RAMPS {
        if f64::from(good - bad) <= (PRECISION * f64::from(good)).max(1.0) {
            break;
        }
        let between = (f64::from(bad.max(1)) * f64::from(good)).sqrt();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two u32")]
        let between = (between as u32).clamp(bad + 1, good - 1);
        if holds(between) {
            good = between;
        } else {
            bad = between;
        }
    }
    Some(good)
}
