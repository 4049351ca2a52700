//! Speed without a filter: the way between two edges of the encoder, divided by the time between them.
//!
//! Between two samples the shaft moves less than a line most of the time, so their difference is 0 or ± one line: at
//! 40 kHz ± 5 turns/s with 8 000 lines. The time between edges says what the mean speed was, as exactly as the samples
//! tell when an edge was passed. \[M\]'s counters give no more.

use axis_worker::bench::Sampling;

use super::seconds;
use super::speeds::Point;

/// Mean speeds between edges as a staircase, in counts per second: each from its edge to the next one. Of positions in
/// counts, sampled at this rate.
///
/// Where the shaft turns back it passes the same edge twice, and has moved nowhere in between. After its last edge it may
/// be anywhere between two of them, so that the staircase ends there.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "neither counts nor samples reach 2^52")]
pub fn between_edges(positions: &[i64], sampling: Sampling) -> Vec<Point> {
    // Edge n is the one between the counts n − 1 and n; of several in one sample, the last one.
    let edges = positions.windows(2).zip(1_usize..).filter(|(pair, _)| pair[0] != pair[1]);
    let edges = edges.map(|(pair, at)| (pair[0].max(pair[1]), seconds(at as f64, sampling)));
    let edges: Vec<_> = edges.collect();
    let first = edges.first().map(|edge| [(0.0, 0.0), (edge.1, 0.0)]);
    let between = edges.windows(2).flat_map(|pair| {
        let [(from, since), (to, until)] = [pair[0], pair[1]];
        let speed = (to - from) as f64 / (until - since);
        [(since, speed), (until, speed)]
    });
    first.into_iter().flatten().chain(between).map(|(seconds, speed)| Point { seconds, speed }).collect()
}
