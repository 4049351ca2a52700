//! How a ramp is looked for, whatever its shape.

use super::stand::Stand;

/// Parts of the start-stop frequency with which a ramp may start.
const STARTS: [f64; 3] = [1.0, 0.8, 0.6];
/// How many tops are tried for each start.
const TOPS: u32 = 12;
/// How many ramps for each top: the longest, and the bisection.
const RAMPS: u32 = 9;
/// A ramp is found to this part of itself.
const PRECISION: f64 = 0.02;
/// A top lies this much above its start at least, or there is no need of a ramp.
const LEAST_RISE: f64 = 1.05;

/// Trains that a search plays at most.
#[expect(clippy::cast_possible_truncation, reason = "three")]
pub const MOST_TRIALS: u32 = STARTS.len() as u32 * TOPS * RAMPS + FINISH;
/// What may be tried besides, to make the best ramp better.
const FINISH: u32 = 4 * RAMPS;

/// A ramp that holds, and how long the movement takes with it.
#[derive(Debug, Clone)]
pub(super) struct Found<R> {
    pub(super) ramp: R,
    pub(super) ticks: u64,
}

/// The best of what `best_ramp` finds for a start and a top, both in half steps/s: it gives the fastest ramp that holds.
pub(super) fn search<R>(
    start_stop: f64,
    stand: &Stand,
    best_ramp: impl Fn(f64, f64) -> Option<Found<R>>,
) -> Result<Option<Found<R>>, supersigma_config::MotorError> {
    let mut best: Option<Found<R>> = None;
    for part in STARTS {
        let start = (start_stop * part).floor();
        let top = stand.pull_out(start / 2.0)?;
        let mut look = |logarithm: f64| {
            let found = best_ramp(start, logarithm.exp().round());
            let ticks = found.as_ref().map_or(u64::MAX, |found| found.ticks);
            if best.as_ref().is_none_or(|best| ticks < best.ticks) {
                best = found.or(best.take());
            }
            ticks
        };
        let lowest = start * LEAST_RISE;
        if top > lowest {
            golden_section(lowest.ln(), top.ln(), &mut look);
        }
    }
    Ok(best)
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
