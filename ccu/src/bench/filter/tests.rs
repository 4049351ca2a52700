//! The designs against scipy's numbers; the streams against what filters promise.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use proptest::prelude::*;
use serde::Deserialize;

use super::differentiator::Equiripple;
use super::*;

/// A line of golden/scipy.csv, which golden/scipy.py has made.
#[derive(Debug, Clone, Deserialize)]
struct Golden {
    filter: String,
    sampling: u32,
    parameter: u32,
    quantity: String,
    at: u32,
    re: f64,
    im: f64,
}

fn golden(filter: &str, quantity: &str) -> Vec<Golden> {
    let mut reader = csv::Reader::from_reader(&include_bytes!("golden/scipy.csv")[..]);
    let all = reader.deserialize().map(|row: Result<Golden, _>| row.expect("a line of the table"));
    let wanted: Vec<_> = all.filter(|row| row.filter == filter && row.quantity == quantity).collect();
    assert!(!wanted.is_empty(), "the table has no {quantity} of {filter}");
    wanted
}

impl Golden {
    fn sampling(&self) -> Sampling {
        sampling(self.sampling)
    }

    fn low_pass(&self) -> LowPass {
        LowPass::new(cutoff(self.parameter.into()), self.sampling()).expect("it can be made")
    }

    fn equiripple(&self) -> Equiripple {
        Equiripple::new(taps(self.parameter as usize), self.sampling()).expect("it can be made")
    }

    /// Near to these numbers: within `tolerance`.
    fn is(&self, re: f64, im: f64, tolerance: f64) {
        let off = (re - self.re).hypot(im - self.im);
        assert!(off <= tolerance, "{re} + {im}i is {off} off {self:?}");
    }
}

fn sampling(hertz: u32) -> Sampling {
    Sampling::new(hertz).expect("a rate of the bench")
}

fn cutoff(hertz: f64) -> Cutoff {
    Cutoff::new(hertz).expect("in range")
}

fn taps(taps: usize) -> Taps {
    Taps::new(taps).expect("odd and in range")
}

#[test]
fn low_passes_are_those_of_scipy() {
    // Both compute the same closed form, in other steps.
    for row in golden("low_pass", "b") {
        row.is(row.low_pass().numerator()[row.at as usize], 0.0, 1e-13);
    }
    for row in golden("low_pass", "a") {
        row.is(row.low_pass().denominator()[row.at as usize], 0.0, 1e-13);
    }
    for row in golden("low_pass", "delay") {
        row.is(row.low_pass().delay(), 0.0, 1e-8 * row.re);
    }
    for row in golden("low_pass", "response") {
        let Response { gain, phase } = row.low_pass().response(row.at.into());
        row.is(gain * phase.cos(), gain * phase.sin(), 1e-8);
    }
}

#[test]
fn differentiators_are_those_of_scipy() {
    // scipy looks for extrema on a grid, we between the points of one, and the margin at the band's ends is another.
    let tolerance = 2e-6;
    for row in golden("differentiator", "tap") {
        row.is(row.equiripple().taps[row.at as usize], 0.0, tolerance);
    }
    for row in golden("differentiator", "response") {
        let (re, im) = Response::polynomial(&row.equiripple().taps, row.at.into(), row.sampling());
        row.is(re, im, tolerance);
    }
}

#[test]
fn the_low_pass_halves_the_power_at_its_cutoff() {
    for hertz in [1.0, 50.0, 400.0, 1_000.0] {
        for rate in [20_000, 37_123, 60_000] {
            let gain = |frequency| {
                LowPass::new(cutoff(hertz), sampling(rate)).expect("made").response(frequency).gain
            };
            assert!((gain(hertz) - FRAC_1_SQRT_2).abs() < 1e-6, "{hertz} Hz at {rate} Hz: {}", gain(hertz));
            assert!((gain(0.0) - 1.0).abs() < 1e-6);
        }
    }
}

/// The gain of a differentiator for 2πf.
fn relative(filter: &Differentiator, hertz: f64) -> f64 {
    filter.response(hertz).gain / (TAU * hertz)
}

#[test]
fn a_differentiator_keeps_its_ripple_and_stops_what_is_beyond() {
    for rate in [20_000, 44_100, 60_000] {
        for length in [11, 15, 21, 41, 61, 99, 201, 301] {
            let filter = Differentiator::new(taps(length), sampling(rate)).expect("it converges");
            assert!(filter.ripple() < 0.01, "{length} taps at {rate} Hz: {}", filter.ripple());
            for part in 1..=200 {
                let hertz = Differentiator::PASS_HERTZ * f64::from(part) / 200.0;
                let error = (relative(&filter, hertz) - 1.0).abs();
                assert!(error <= filter.ripple() * 1.001 + 1e-9, "{length} taps at {rate} Hz: {hertz} Hz");
            }
            let most = TAU * Differentiator::PASS_HERTZ * filter.ripple();
            for part in 0..=200 {
                let hertz = filter.stop_hertz()
                    + (f64::from(rate) / 2.0 - filter.stop_hertz()) * f64::from(part) / 200.0;
                let gain = filter.response(hertz).gain;
                assert!(gain <= most * 1.001 + 1e-6, "{length} taps at {rate} Hz: {hertz} Hz: {gain}");
            }
        }
    }
}

#[test]
fn what_cannot_be_is_told() {
    let text = |error: FilterError| error.to_string();
    assert_eq!(
        text(Cutoff::new(f64::NAN).expect_err("no number")),
        "a cutoff of NaN Hz is outside 1 to 1000 Hz"
    );
    for wrong in [0, 9, 20, 303] {
        assert_eq!(
            text(Taps::new(wrong).expect_err("even, or too few or many")),
            format!("{wrong} taps: the derivative filter has an odd number of them, 11 to 301")
        );
    }
}

#[test]
fn a_swing_comes_out_at_its_time_with_its_size() {
    // 20 half steps of the bench motor's swing about its detent, in counts, as the encoder's lines give them.
    let rate = sampling(40_000);
    let at = |seconds: f64| 18.0 * (TAU * 162.4 * seconds).sin() * (-seconds * 30.0).exp();
    let speed = |seconds: f64| (at(seconds + 1e-7) - at(seconds - 1e-7)) / 2e-7;
    let counts = (0..4_000).map(|sample| at(seconds(f64::from(sample), rate)).floor());
    let choice = Choice { cutoff: Cutoff::HIGHEST, taps: None };
    let speeds = Speeds::new(counts.clone(), rate, choice).expect("they can be made");
    let inside = |points: &[Point]| -> Vec<Point> {
        points.iter().copied().filter(|point| (0.005..0.09).contains(&point.seconds)).collect()
    };
    let error = |points: &[Point]| {
        let squares = points.iter().map(|point| (point.speed - speed(point.seconds)).powi(2));
        (squares.sum::<f64>() / f64::from(u32::try_from(points.len()).expect("few"))).sqrt()
    };
    let top = 18.0 * TAU * 162.4;
    let counts: Vec<_> = counts.collect();
    let differences: Vec<_> = counts
        .windows(2)
        .zip(0_u32..)
        .map(|(pair, at)| Point {
            seconds: seconds(f64::from(at) + 0.5, rate),
            speed: (pair[1] - pair[0]) * hertz(rate),
        })
        .collect();
    #[expect(clippy::cast_possible_truncation, reason = "whole numbers")]
    let whole: Vec<_> = counts.iter().map(|count| *count as i64).collect();
    let edges: Vec<_> = between_edges(&whole, rate)
        .chunks_exact(2)
        .map(|ends| Point { seconds: f64::midpoint(ends[0].seconds, ends[1].seconds), ..ends[0] })
        .collect();
    let errors =
        [&differences, &edges, &speeds.instant, &speeds.filtered].map(|points| error(&inside(points)) / top);
    let expected = [0.601, 0.0514, 0.0876, 0.0325];
    for (error, expected) in errors.iter().zip(expected) {
        assert!((error / expected - 1.0).abs() < 0.05, "{errors:?}");
    }
}

#[test]
fn between_two_edges_the_speed_is_the_way_by_the_time() {
    let rate = sampling(20_000);
    // Edges 1, 2 and 4 forward at the samples 2, 4 and 5, and edge 4 again, back, at 9.
    let points = between_edges(&[0, 0, 1, 1, 2, 4, 4, 4, 4, 3, 3], rate);
    let expected =
        [(0, 0.0), (2, 0.0), (2, 10_000.0), (4, 10_000.0), (4, 40_000.0), (5, 40_000.0), (5, 0.0), (9, 0.0)];
    let expected = expected.map(|(at, speed)| Point { seconds: seconds(f64::from(at), rate), speed });
    assert_eq!(points.len(), expected.len(), "{points:?}");
    for (point, wanted) in points.iter().zip(expected) {
        assert!((point.seconds - wanted.seconds).abs() < 1e-12, "{points:?}");
        assert!((point.speed - wanted.speed).abs() < 1e-6, "{points:?}");
    }
    assert_eq!(between_edges(&[5, 5, 5], rate), []);
    assert_eq!(between_edges(&[], rate), []);
}

prop_compose! {
    fn filters()(rate in 20_000_u32..=60_000, half in 5_usize..60, hertz in 5.0..1_000.0)
        -> (Sampling, Choice)
    {
        (sampling(rate), Choice { cutoff: cutoff(hertz), taps: Some(taps(2 * half + 1)) })
    }
}

fn positions() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1e4..1e4, 200..400)
}

/// Values of both curves, of positions.
fn run(positions: &[f64], (rate, choice): (Sampling, Choice)) -> Vec<f64> {
    let speeds = Speeds::new(positions.iter().copied(), rate, choice).expect("they can be made");
    speeds.instant.iter().chain(&speeds.filtered).map(|point| point.speed).collect()
}

/// The largest speed that positions of this size can have.
fn scale(positions: &[f64], rate: Sampling) -> f64 {
    hertz(rate) * positions.iter().fold(1.0, |most: f64, position| most.max(position.abs()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn filters_are_linear(filters in filters(), a in positions(), b in positions(), factor in -3.0..3.0_f64) {
        let sum: Vec<_> = a.iter().zip(&b).map(|(a, b)| a + factor * b).collect();
        let short = a.len().min(b.len());
        let [of_a, of_b, of_sum] =
            [&a[..short], &b[..short], &sum[..]].map(|positions| run(positions, filters));
        for ((of_a, of_b), of_sum) in of_a.iter().zip(&of_b).zip(&of_sum) {
            prop_assert!((of_a + factor * of_b - of_sum).abs() < 1e-9 * scale(&sum, filters.0));
        }
    }

    #[test]
    fn what_stands_has_no_speed(filters in filters(), position in -1e9..1e9) {
        prop_assert!(run(&[position; 300], filters).iter().all(|speed| *speed == 0.0));
    }

    #[test]
    fn a_ramp_gives_its_slope_once_the_filters_are_full(
        filters in filters(), start in -1e6..1e6, slope in -1e5..1e5_f64
    ) {
        let (rate, choice) = filters;
        let positions = (0..30_000).map(|at| start + slope * seconds(f64::from(at), rate));
        let speeds = Speeds::new(positions, rate, choice).expect("they can be made");
        // Ten time constants of the low pass.
        let full = speeds.latency + 10.0 * 2.0_f64.sqrt() / (TAU * choice.cutoff.hertz()) + 0.005;
        for point in speeds.instant.iter().chain(&speeds.filtered).filter(|point| point.seconds > full) {
            prop_assert!(
                (point.speed - slope).abs() < 1e-3 + slope.abs() * 1e-4,
                "{} instead of {slope} at {} s", point.speed, point.seconds
            );
        }
    }

    #[test]
    fn a_stream_has_no_memory_beyond_its_taps(half in 5_usize..60, a in positions(), tail in positions()) {
        let new = || Differentiator::new(taps(2 * half + 1), sampling(40_000)).expect("it can be made");
        let (mut one, mut other) = (new(), new());
        for &position in &a {
            one.push(position);
        }
        for (at, &position) in tail.iter().enumerate() {
            let speeds = (one.push(position), other.push(position));
            if at > 2 * half {
                prop_assert_eq!(speeds.0.to_bits(), speeds.1.to_bits());
            }
        }
    }
}
