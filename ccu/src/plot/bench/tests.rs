//! Runs made by hand, and their pictures.

use axis_worker::bench::{Frequency, Train};
use axis_worker::motor::Load;
use resvg::usvg::{Options, Tree};
use supersigma_config::MotorConfig;
use supersigma_protocol::Tick;

use super::*;
use crate::bench::BenchMotor;

/// Four pulses of 10 ms each; the shaft makes each step in a millisecond, at an even speed. 20 counts a step.
fn recording(sign: i64) -> Recording {
    let commanded = (1..=4).map(|n| CommandedPulse { at: Tick(n * 20_000), clocks: 10_000 }).collect();
    let position = |sample: i64| {
        let steps = sample / 200;
        let since = sample % 200;
        sign * if steps == 0 {
            0
        } else {
            (steps.min(4) - 1) * 20 + if steps > 4 { 20 } else { since.min(20) }
        }
    };
    Recording {
        sampling_hertz: 20_000,
        counts_per_turn: 8_000,
        half_steps_per_turn: 400,
        positions: (0..=1_000).map(position).collect(),
        commanded,
    }
}

fn run(recording: &Recording) -> Plotted<'_> {
    Plotted {
        title: "Four steps & a title".into(),
        subtitle: "made by hand".into(),
        recording,
        direction: Direction::Forward,
        parts: None,
        first_lost: None,
    }
}

fn drawn(run: &Plotted<'_>, graph: Graph) -> String {
    let picture = run.picture(graph, Filters::default()).expect("it can be drawn");
    Tree::from_str(picture.svg(), &Options::default()).expect("it is an SVG");
    picture.svg().to_owned()
}

#[test]
fn lines_are_the_recording_in_units() {
    let recording = recording(1);
    let plotted = run(&recording);
    let shown = Shown::new(&plotted).expect("20 kHz is possible");
    assert_eq!(shown.time, 0.0..0.05);
    let commanded = shown.commanded(0.9);
    assert_eq!(&commanded[..3], [(0.0, 0.0), (0.01, 0.0), (0.01, 0.9)]);
    assert_eq!(commanded.last(), Some(&(0.05, 3.6)));
    assert_eq!(shown.prescribed(), [(0.0, 0.0), (0.0, 100.0), (0.04, 100.0), (0.04, 0.0), (0.05, 0.0)]);
    // Still until the first pulse, then a point a count.
    let real = shown.real(0.045);
    assert_eq!(&real[..3], [(0.0, 0.0), (0.01, 0.0), (0.01005, 0.045)]);
    let (t, degrees) = *real.last().expect("some");
    assert!((t - 0.05).abs() < 1e-9 && (degrees - 3.6).abs() < 1e-9);
    let all = |b| PartSteps { a: 0, b, c: 4 - b };
    assert!((top_frequency(all(4), &recording) - 100.0).abs() < 1e-9);
    assert!((top_frequency(all(0), &recording) - 100.0).abs() < 1e-9);
    // A pulse is a step of lag at once; a millisecond later it is made good.
    let lag = shown.lag(0.05);
    assert_eq!((lag[199].1, lag[200].1, lag[210].1, lag[220].1), (0.0, 1.0, 0.5, 0.0));
    let close = shown.close_up();
    assert!((close.start - 0.018).abs() < 1e-9 && (close.end - 0.038).abs() < 1e-9, "{close:?}");
}

#[test]
fn towards_the_origin_lag_and_profile_are_as_forward() {
    let recordings = [1, -1].map(recording);
    let backward = Plotted { direction: Direction::TowardsOrigin, ..run(&recordings[1]) };
    assert_eq!(drawn(&run(&recordings[0]), Graph::Profile), drawn(&backward, Graph::Profile));
    assert!(drawn(&backward, Graph::Position).contains('\u{2212}'), "positions below 0");
}

#[test]
fn pictures_name_units_parts_and_losses() {
    let recording = recording(1);
    let lost = FirstLost { pulse: 3, time_s: 0.03, frequency: 100.0 };
    let parts = Some(PartSteps { a: 1, b: 2, c: 1 });
    let whole = Plotted { parts, first_lost: Some(lost), ..run(&recording) };
    let profile = drawn(&whole, Graph::Profile);
    for text in ["Ns_a = 1", "Ns_b = 2", "Ns_c = 1", "steps lost from pulse 3 on, at 100 steps/s", "steps/s"]
    {
        assert!(profile.contains(text), "{text}");
    }
    let plain = drawn(&run(&recording), Graph::Profile);
    assert!(!plain.contains("Ns_") && !plain.contains("lost"));
    assert!(drawn(&whole, Graph::Position).contains("degrees"));
    let speed = drawn(&whole, Graph::Speed);
    assert!(speed.contains("Enlarged: where the first steps are lost"));
    assert!(speed.contains("degrees/s") && speed.contains("21 taps at 20 kHz, low pass 400 Hz"));
    assert!(profile.contains("low pass 50 Hz"));
}

#[test]
fn a_part_without_pulses_has_no_name() {
    let recording = recording(1);
    let profile =
        drawn(&Plotted { parts: Some(PartSteps { a: 0, b: 4, c: 0 }), ..run(&recording) }, Graph::Profile);
    assert!(profile.contains("Ns_b = 4") && !profile.contains("Ns_a") && !profile.contains("Ns_c"));
}

#[test]
fn an_empty_recording_is_an_empty_picture() {
    let recording = Recording { positions: vec![], commanded: vec![], ..recording(1) };
    for graph in [Graph::Position, Graph::Speed, Graph::Profile] {
        drawn(&run(&recording), graph);
    }
    let other = Recording { sampling_hertz: 1_000, ..recording };
    let error = run(&other).picture(Graph::Speed, Filters::default()).expect_err("not sampled like this");
    assert!(error.to_string().contains("not at 1000 Hz"), "{error}");
}

#[test]
fn the_heading_says_what_was_run_and_what_came_of_it() {
    let load = Load { torque: 0.5, inertia: 0.0 };
    let motor = BenchMotor { name: "the bench motor".into(), config: MotorConfig::bench(), load };
    let frequency = Frequency::from_millihertz(1_000_000).expect("1 kHz");
    let train = Train::constant(frequency, 100).expect("the counter can make it");
    let sampling = Sampling::LOWEST;
    let direction = Direction::TowardsOrigin;
    let run = Run { motor: &motor, program: Program::Constant, train, direction, sampling };
    let mut recording = Recording::default();
    let mut go_on = |_: Tick| std::ops::ControlFlow::Continue(());
    let report = run.go(None, Some(&mut recording), &mut go_on).expect("it runs");
    let plotted = Plotted::new(&run, &report, &recording);
    assert_eq!(plotted.title, "100 steps at a constant frequency of 1\u{2009}000 Hz");
    assert_eq!(plotted.subtitle, "the bench motor, against 0.5 N·m; -100 steps given, -100 made");
    assert!(plotted.parts.is_none() && plotted.first_lost.is_none());
    // Once it runs, a swing of start aside, the filtered speed is the pulses', whichever way it turns.
    let shown = Shown::new(&plotted).expect("20 kHz");
    let half_steps = shown.sign * 400.0 / 8_000.0;
    let choice = Choice { cutoff: Cutoff::RAMPS, taps: None };
    let speeds = shown.speeds(half_steps, choice).expect("they can be made");
    let running = speeds.filtered.iter().filter(|point| (0.05..0.09).contains(&point.seconds));
    for point in running {
        assert!((point.speed - 1_000.0).abs() < 40.0, "{point:?}");
    }
}
