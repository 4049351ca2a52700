//! Goldens by hand, every reason by name, and what any table that is given out must be.

use proptest::prelude::*;

use super::*;
use crate::CountTable;

fn differences(counts: &[u16]) -> Vec<u16> {
    counts.windows(2).map(|pair| pair[0] - pair[1]).collect()
}

fn sin2(change: impl FnOnce(&mut Sin2)) -> RampConfig {
    let mut sin2 = Sin2::default();
    change(&mut sin2);
    sin2.into()
}

fn linear(f_start: f64, f_max: f64, t_a: f64) -> RampConfig {
    Linear { f_start, f_max, t_a }.into()
}

fn table(counts: &[u16]) -> RampConfig {
    CountTable { counts: counts.to_vec(), interval_ticks: 2_580 }.into()
}

fn wide(ramp: RampConfig) -> RampConfig {
    RampConfig { differences: Differences::Wide, ..ramp }
}

#[test]
fn the_default_curve_makes_the_table_of_the_paper() {
    let counts = RampConfig::default().counts().expect("the default ramp is usable");
    let differences = differences(&counts);
    assert_eq!((counts[0], counts[232]), (3_076, 132));
    assert_eq!(differences.len(), 232);
    assert_eq!(differences[..3], [163, 150, 138]);
    assert_eq!(differences.iter().max(), Some(&163));
    assert_eq!(differences.iter().sum::<u16>(), 2_944);
}

#[test]
fn the_printed_amplitude_contradicts_the_text_of_the_paper() {
    let counts = sin2(|sin2| sin2.amplitude = 14_000.0).counts().expect("usable");
    // 606.7 and 14 000 steps/s, where the text says 650 and 15 000.
    assert_eq!((counts[0], counts[232]), (3_296, 142));
}

#[test]
fn a_linear_table_by_hand() {
    // 200 to 2 520 steps/s: 10 steps/s from each entry to the next; 0.58 s: 2.5 ms, 5 000 ticks.
    let ramp = wide(linear(200.0, 2_520.0, 0.58));
    assert_eq!((ramp.interval_ticks(), ramp.brake_interval_ticks), (5_000, 1_666));
    let counts = ramp.counts().expect("usable");
    // N = INT(2 000 000 / V − 0.5):
    // 200: 10 000 − 0.5; 210: 9 523.8 − 0.5; 220: 9 090.9 − 0.5; 230: 8 695.7 − 0.5
    assert_eq!(counts[..4], [9_999, 9_523, 9_090, 8_695]);
    assert_eq!(differences(&counts)[..3], [476, 433, 395]);
    // 1 200: 1 666.7 − 0.5; 2 500: 800 − 0.5; 2 510: 796.8 − 0.5; 2 520: 793.7 − 0.5
    assert_eq!((counts[100], counts[230], counts[231], counts[232]), (1_666, 799, 796, 793));
    // The same with bytes: 200 steps/s is too slow for steps of 10 steps/s, 280 is not:
    // 2 000 000 / 280 − 2 000 000 / 290 = 246.3.
    let bytes = RampConfig { differences: Differences::Byte, ..ramp };
    assert_eq!(bytes.counts(), Err(RampError::TooSteep { entry: 1, difference: 476 }));
    let counts = linear(280.0, 2_600.0, 0.58).counts().expect("usable");
    // 280: 7 142.9 − 0.5; 290: 6 896.6 − 0.5
    assert_eq!(counts[..2], [7_142, 6_896]);
}

#[test]
fn the_interval_of_a_linear_ramp_is_the_nearest_tick() {
    // 0.3 s are 600 000 ticks, 2 586.2 from each of 233 entries to the next.
    assert_eq!(linear(650.0, 15_000.0, 0.3).interval_ticks(), 2_586);
    assert_eq!(linear(650.0, 15_000.0, 0.000_116).interval_ticks(), 1);
    assert_eq!(linear(650.0, 15_000.0, -1.0).interval_ticks(), 0);
}

#[test]
fn the_last_entry_of_a_short_table_holds() {
    let ramp = table(&[3_000, 2_800, 2_700]);
    let counts = ramp.counts().expect("usable");
    assert_eq!((counts[0], counts[1]), (3_000, 2_800));
    assert!(counts[2..].iter().all(|n| *n == 2_700));
    assert_eq!(ramp.profile.last_entry(), 2);
    assert_eq!(RampConfig::default().profile.last_entry(), 232);
    let whole: Vec<u16> = (0..233).map(|entry| 3_000 - 10 * entry).collect();
    let ramp = table(&whole);
    assert_eq!((ramp.counts().map(Vec::from), ramp.profile.last_entry()), (Ok(whole), 232));
}

#[test]
fn every_reason_is_named() {
    let ok = RampConfig::default;
    let long: Vec<u16> = vec![3_000; 234];
    let reasons = [
        (sin2(|sin2| sin2.omega = f64::NAN), RampError::NotFinite { parameter: "omega" }),
        (sin2(|sin2| sin2.phase = f64::INFINITY), RampError::NotFinite { parameter: "phase" }),
        (sin2(|sin2| sin2.interval_ticks = 0), RampError::NoInterval),
        (
            sin2(|sin2| sin2.interval_ticks = 2_000_001),
            RampError::IntervalTooLong { parameter: "interval_ticks", ticks: 2_000_001 },
        ),
        (RampConfig { brake_interval_ticks: 0, ..ok() }, RampError::NoBrakeInterval),
        (
            RampConfig { brake_interval_ticks: 2_581, ..ok() },
            RampError::BrakeSlower { brake: 2_581, normal: 2_580, derived: false },
        ),
        (RampConfig { offset: 65_536, ..ok() }, RampError::OffsetTooLong { offset: 65_536 }),
        (sin2(|sin2| sin2.amplitude = 0.0), RampError::Undividable { entry: 0, speed: 0.0 }),
        // The curve starts on its top, 15 000 steps/s (N = 132), and is at 14 974.8 at entry 7 (N = 133).
        (
            sin2(|sin2| sin2.phase = std::f64::consts::FRAC_PI_2),
            RampError::SpeedFalls { entry: 7, before: 132, n: 133 },
        ),
        // V = 60.023 and 71.637 steps/s, N = 33 319 and 27 918.
        (sin2(|sin2| sin2.phase = 0.063_3), RampError::TooSteep { entry: 1, difference: 5_401 }),
        (linear(f64::NAN, 2_000.0, 0.5), RampError::NotFinite { parameter: "f_start" }),
        (linear(200.0, f64::INFINITY, 0.5), RampError::NotFinite { parameter: "f_max" }),
        (linear(200.0, 2_000.0, f64::NAN), RampError::NotFinite { parameter: "t_a" }),
        (linear(200.0, 2_000.0, 0.0), RampError::NoTime { seconds: 0.0 }),
        (linear(200.0, 2_000.0, -0.5), RampError::NoTime { seconds: -0.5 }),
        // 233 s of 2 000 000 ticks, a 232nd of them.
        (linear(200.0, 2_000.0, 233.0), RampError::IntervalTooLong { parameter: "t_a", ticks: 2_008_621 }),
        (linear(2_000.0, 200.0, 0.5), RampError::Falls { f_start: 2_000.0, f_max: 200.0 }),
        (linear(0.0, 2_000.0, 0.5), RampError::Undividable { entry: 0, speed: 0.0 }),
        (
            RampConfig { brake_interval_ticks: 5_001, ..wide(linear(200.0, 2_520.0, 0.58)) },
            RampError::BrakeSlower { brake: 5_001, normal: 5_000, derived: true },
        ),
        (table(&[3_000]), RampError::Length { length: 1 }),
        (table(&long), RampError::Length { length: 234 }),
        (table(&[3_000, 2_700]), RampError::TooSteep { entry: 1, difference: 300 }),
        (table(&[3_000, 24]), RampError::Undividable { entry: 1, speed: 80_000.0 }),
        (table(&[3_000, 2_900, 2_901]), RampError::SpeedFalls { entry: 2, before: 2_900, n: 2_901 }),
    ];
    for (ramp, reason) in reasons {
        assert_eq!(ramp.counts(), Err(reason));
    }
}

fn any_profile() -> impl Strategy<Value = Profile> {
    prop_oneof![
        (-1e4..2e6_f64, -10.0..10.0_f64, -4.0..4.0_f64, 0..10_000_u32).prop_map(
            |(amplitude, omega, phase, interval_ticks)| {
                Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks })
            }
        ),
        (-100.0..2_000.0_f64, 0.0..100_000.0_f64, -0.1..3.0_f64)
            .prop_map(|(f_start, f_max, t_a)| Profile::Linear(Linear { f_start, f_max, t_a })),
        (prop::collection::vec(0..=300_u16, 0..240), 0..10_000_u32).prop_map(|(falls, interval_ticks)| {
            let counts = falls.iter().scan(40_000_u16, |n, fall| {
                *n = n.saturating_sub(*fall);
                Some(*n)
            });
            Profile::Table(CountTable { counts: counts.collect(), interval_ticks })
        }),
    ]
}

proptest! {
    /// Whatever the profile, a table that is given out can be played by the card and stored in it.
    #[test]
    fn a_table_is_usable_or_refused(profile in any_profile(), wide: bool) {
        let differences = if wide { Differences::Wide } else { Differences::Byte };
        let ramp = RampConfig { brake_interval_ticks: 1, differences, ..profile.into() };
        if let Ok(counts) = ramp.counts() {
            prop_assert!(counts.iter().all(|n| (25..=65_534).contains(n)));
            prop_assert!(counts.windows(2).all(|pair| pair[1] <= pair[0] && (wide || pair[0] - pair[1] <= 255)));
        }
    }
}
