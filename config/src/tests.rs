//! Loading as a whole: files, the default set, the way to a text and back, and texts of chance. In `shape` and `rules`
//! each way to be wrong has a text; its message names file, line, column and key.

mod files;
mod profiles;
mod rules;
mod shape;

use std::fmt::Write as _;
use std::fs;

use miette::{Diagnostic, NarratableReportHandler};
use proptest::prelude::*;
use supersigma_protocol::{AxisNumber, Position, SpeedIndex, Steps};

use super::*;

/// One sound axis, lines 1 to 5; what follows begins on line 6.
const AXIS: &str = r#"[[axis]]
address = 1
name = "a"
rail = { length = 10000, lower_zone = 400, reference = 600, upper_zone = 9600, start = 50 }
travel = { min = 0, max = 9198 }
"#;

/// The error's plain line, and miette's drawing of it without graphics.
fn messages(text: &str) -> (String, String) {
    let error = Config::from_toml(text, "set.toml").expect_err("this text breaks a rule");
    let mut drawn = String::new();
    NarratableReportHandler::new().render_report(&mut drawn, &error).expect("drawing into a string");
    (error.to_string(), drawn)
}

/// `text` has one fault, whose plain message is `plain` and whose advice contains `advice`.
#[track_caller]
fn breaks(text: &str, plain: &str, advice: &str) {
    let (message, drawn) = messages(text);
    assert_eq!(message, plain);
    assert!(drawn.contains(advice), "no advice {advice:?} in\n{drawn}");
    let [line, column] = [1, 2].map(|part| plain.split(':').nth(part).expect("file:line:column"));
    let labels = [
        format!("label at line {line}, column {column}:"),
        format!("label at line {line}, columns {column} "),
    ];
    assert!(labels.iter().any(|label| drawn.contains(label)), "no label at {line}:{column} in\n{drawn}");
}

/// The sound axis with one thing replaced.
fn axis_with(what: &str, by: &str) -> String {
    assert!(AXIS.contains(what), "{what:?} is not in the axis");
    AXIS.replacen(what, by, 1)
}

/// The sound axis and more text after it.
fn axis_and(more: &str) -> String {
    format!("{AXIS}{more}")
}

#[test]
fn the_sound_axis_is_sound() {
    let config = Config::from_toml(AXIS, "set.toml").expect("sound");
    assert_eq!(config.axes.len(), 1);
}

#[test]
fn an_axis_ramp_has_the_rest_from_the_set() {
    let text = axis_and("ramp = { amplitude = 14000 }\n[ramp]\noffset = 12\nshort_moves = \"paper\"\n");
    let config = Config::from_toml(&text, "set.toml").expect("sound");
    let own = RampConfig {
        offset: 12,
        short_moves: ShortMoves::Paper,
        ..Sin2 { amplitude: 14_000.0, ..Sin2::default() }.into()
    };
    assert_eq!(config.axes[0].ramp, Some(own));
    // A fault that comes from the set's ramp is told once, one of its own where it stands.
    breaks(
        &axis_and("ramp = { amplitude = 14000 }\n[ramp]\noffset = 70000\n"),
        "set.toml:8:10: ramp.offset: this ramp cannot be used: `offset` is 70000, more than the 65 535 steps of the longest movement",
        "65535",
    );
    breaks(
        &axis_and("ramp = { phase = inf }\n"),
        "set.toml:6:18: axis[0].ramp.phase: this ramp cannot be used: `phase` is not a finite number",
        "a plain number",
    );
}

#[test]
fn files_are_read_and_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("mine.toml");
    let error = Config::load(&file).expect_err("not there yet");
    assert!(error.to_string().contains("mine.toml"), "{error}");
    assert!(error.help().is_some() && error.faults().is_empty());

    fs::write(&file, AXIS).expect("writing");
    assert_eq!(Config::load(&file).expect("sound").axes[0].name, "a");

    fs::write(&file, b"[log]\nflush_ms = \xFF5\n").expect("writing");
    let error = Config::load(&file).expect_err("not UTF-8");
    assert!(error.to_string().ends_with("mine.toml:2:12: log.flush_ms: this is not UTF-8 text"), "{error}");
}

#[test]
fn the_default_set_is_the_seven_axes() {
    let set = Config::default_set();
    let axes: Vec<_> = set.axes.iter().map(|axis| (axis.address.get(), axis.name.as_str())).collect();
    let expected = [
        (1, "left_x"),
        (2, "left_y"),
        (3, "left_z"),
        (4, "right_x"),
        (5, "right_y"),
        (6, "right_z"),
        (7, "wrist"),
    ];
    assert_eq!(axes, expected);
    assert_eq!(set.find_axis("wrist"), set.axis(AxisNumber::new(7).expect("a number of an axis")));
    let grasped = &set.digital.inputs[0];
    assert_eq!(
        (grasped.name.as_str(), grasped.follows.as_deref(), grasped.delay_ms),
        ("left_grasped", Some("left_gripper"), 80)
    );
    assert!(set.digital.inputs.iter().any(|input| input.name == "part_present" && input.initial));
}

#[test]
fn what_the_default_text_says_is_what_the_code_does_without_it() {
    let set = Config::default_set();
    assert_eq!(set.ramp, RampConfig::default());
    assert_eq!(set.line, LineConfig::default());
    assert_eq!(set.executive, ExecutiveConfig::default());
    assert_eq!(set.supervision, SupervisionConfig::default());
    assert_eq!(set.real_time, RealTimeConfig::default());
    assert_eq!(set.log, LogConfig::default());
    assert_eq!(set.axes[0].origination, OriginationConfig::default());
    // Nothing of those tables is left to a default: each key that the model has is in the text.
    let text: toml::Table = DEFAULT_TOML.parse().expect("TOML");
    let written: toml::Table = set.to_toml().parse().expect("TOML");
    for table in ["ramp", "line", "executive", "supervision", "real_time", "log"] {
        assert_eq!(text[table], written[table], "{table}");
    }
}

#[test]
fn the_ramp_that_the_default_text_suggests_is_usable() {
    let text = DEFAULT_TOML.replace("# ramp = {", "ramp = {");
    assert_ne!(text, DEFAULT_TOML);
    let set = Config::from_toml(&text, "set.toml").expect("sound");
    let counts = set.axes[6].ramp.as_ref().expect("its own ramp").counts().expect("usable");
    // 9 000 · sin²(0.272) = 649.6 steps/s; 9 000 at the top.
    assert_eq!((counts[0], counts[232]), (3_078, 221));
}

#[test]
fn the_effective_default_set_comes_back() {
    let set = Config::default_set();
    assert_eq!(Config::from_toml(&set.to_toml(), "shown").expect("sound"), set);
}

/// Profiles of which the carriage can stop from entry 90 within 400 steps, with differences of one byte.
fn any_profile() -> impl Strategy<Value = Profile> {
    prop_oneof![
        (10_000.0..15_000.0_f64).prop_map(|amplitude| Profile::Sin2(Sin2 { amplitude, ..Sin2::default() })),
        (600.0..700.0_f64, 4_000.0..8_000.0_f64, 0.1..0.3_f64)
            .prop_map(|(f_start, f_max, t_a)| Profile::Linear(Linear { f_start, f_max, t_a })),
        (proptest::collection::vec(0..=8_u16, 2..=233), 1_000..3_000_u32).prop_map(
            |(falls, interval_ticks)| {
                let counts = falls.iter().scan(3_000, |n, fall| {
                    *n -= fall;
                    Some(*n)
                });
                Profile::Table(CountTable { counts: counts.collect(), interval_ticks })
            }
        ),
    ]
}

prop_compose! {
    /// Any sound axis but for address and name.
    fn any_axis()(
        lower in 400..2_000_u32,
        gaps in (1..500_u32, 1..20_000_u32, 1..5_000_u32),
        start in 0..=1_000_u32,
        speed in 0..=90_u8,
        ramp in proptest::option::of((any_profile(), 0..=65_535_u32, any::<bool>())),
        reach in 0.0..=1.0_f64,
        motor in proptest::option::of((0.1..5.0_f64, 1e-5..1e-2_f64)),
    ) -> AxisConfig {
        let upper = lower + gaps.0 + gaps.1;
        #[expect(clippy::cast_possible_truncation, reason = "at most 20 500")]
        let max = (f64::from(upper - lower - 2) * reach) as i32;
        AxisConfig {
            address: AxisNumber::new(1).expect("an axis"),
            name: String::new(),
            rail: RailConfig {
                length: Steps(upper + gaps.2),
                lower_zone: Steps(lower),
                upper_zone: Steps(upper),
                reference: Steps(lower + gaps.0),
                start: Steps(start.min(upper)),
            },
            travel: TravelConfig { min: Position(max / 2), max: Position(max) },
            origination: OriginationConfig { speed: SpeedIndex::new(speed).expect("at most 90") },
            ramp: ramp.map(|(profile, offset, wide)| {
                let differences = if wide { Differences::Wide } else { Differences::Byte };
                RampConfig { offset, differences, ..profile.into() }
            }),
            feedback: if motor.is_some() { Feedback::Closed } else { Feedback::Open },
            following: FollowingConfig { s1: 20.0 + reach, ..FollowingConfig::default() },
            motor: motor.map(|(holding_torque, rotor_inertia)| MotorConfig { holding_torque, rotor_inertia, ..MotorConfig::bench() }),
        }
    }
}

proptest! {
    #[test]
    fn every_sound_set_comes_back(
        axes in proptest::collection::vec(any_axis(), 1..=7),
        ramp in (any_profile(), 0..=65_535_u32, any::<bool>()),
        heartbeat_ms in 1..10_000_u32,
        lines in proptest::collection::vec((any::<bool>(), 0..1_000_u32, any::<bool>()), 0..=16),
    ) {
        let mut set = Config::default_set();
        set.ramp = RampConfig { offset: ramp.1, ..ramp.0.into() };
        set.ramp.short_moves = if ramp.2 { ShortMoves::Paper } else { ShortMoves::Optimal };
        set.supervision = SupervisionConfig { heartbeat_ms, silent_ms: 2 * heartbeat_ms + 1, restart: true };
        set.axes = axes;
        for (axis, number) in set.axes.iter_mut().zip(AxisNumber::all()) {
            axis.address = number;
            axis.name = format!("axis_{}", number.get());
        }
        set.digital.inputs = (0..).zip(lines).map(|(bit, (follows, delay_ms, initial))| InputConfig {
            bit,
            name: format!("i{bit}"),
            follows: follows.then(|| "lamp".to_owned()),
            delay_ms: if follows { delay_ms } else { 0 },
            initial,
        }).collect();
        let text = set.to_toml();
        prop_assert_eq!(Config::from_toml(&text, "shown").expect("sound"), set, "{}", text);
    }

    #[test]
    fn no_text_makes_it_panic(text in any::<String>()) {
        let _ = Config::from_toml(&text, "set.toml").map_err(|error| drawn_in_full(&error));
    }

    /// Texts near the default one reach deeper than those of chance.
    #[test]
    fn no_damage_to_the_default_text_makes_it_panic(
        cuts in proptest::collection::vec((any::<prop::sample::Index>(), "[\\[\\]{}=\"'.,#\n\u{e4}a-z0-9-]{0,3}", 0..4_usize), 1..6),
    ) {
        let mut text: Vec<char> = DEFAULT_TOML.chars().collect();
        for (place, by, gone) in cuts {
            let from = place.index(text.len());
            let to = (from + gone).min(text.len());
            text.splice(from..to, by.chars());
        }
        let text: String = text.into_iter().collect();
        match Config::from_toml(&text, "set.toml").map_err(|error| drawn_in_full(&error)) {
            Ok(set) => prop_assert_eq!(Config::from_toml(&set.to_toml(), "shown").expect("sound"), set),
            Err(message) => prop_assert!(message.contains("set.toml"), "{}", message),
        }
    }
}

/// All that can be said about an error, so that saying it is tried too.
fn drawn_in_full(error: &ConfigError) -> String {
    let mut all = error.to_string();
    for fault in error.faults() {
        let _ = write!(all, "{fault} {:?} {:?}", fault.advice(), fault.source_name());
    }
    miette::GraphicalReportHandler::new().render_report(&mut all, error).expect("drawing into a string");
    all
}
