//! Timing against numbers that were computed elsewhere and against the equations as they stand; the apparatus against a
//! rotor that is fed by hand.

use std::ops::ControlFlow;

use proptest::prelude::*;
use supersigma_config::MotorConfig;
use supersigma_protocol::{Direction, Tick, Ticks};

use super::*;
use crate::motor::{Counts, Detent, Load, Rotor};

/// Printed by `golden.py`, which stands beside this file.
#[rustfmt::skip]
const UP: [u32; 220] = [
    5000, 4082, 3549, 3188, 2921, 2712, 2544, 2404, 2286, 2182, 2093, 2014, 1942, 1879, 1821, 1768,
    1720, 1675, 1634, 1596, 1559, 1527, 1495, 1466, 1437, 1412, 1387, 1363, 1340, 1320, 1299, 1279,
    1261, 1243, 1226, 1210, 1194, 1179, 1164, 1151, 1136, 1124, 1111, 1099, 1087, 1076, 1064, 1054,
    1043, 1034, 1023, 1014, 1004, 996, 986, 979, 969, 962, 954, 946, 938, 931, 924, 917,
    910, 903, 896, 890, 884, 878, 872, 865, 860, 854, 849, 843, 838, 833, 827, 822,
    818, 812, 808, 803, 798, 794, 789, 785, 781, 776, 772, 768, 764, 760, 756, 752,
    749, 744, 741, 737, 734, 730, 727, 723, 720, 716, 713, 710, 707, 704, 700, 697,
    695, 691, 688, 686, 682, 680, 677, 674, 672, 668, 666, 663, 661, 658, 656, 653,
    650, 649, 645, 643, 641, 639, 636, 634, 631, 630, 627, 624, 623, 621, 618, 616,
    614, 612, 610, 608, 606, 604, 602, 600, 598, 596, 595, 592, 591, 588, 587, 585,
    583, 582, 579, 578, 577, 574, 573, 571, 569, 568, 566, 565, 563, 561, 560, 558,
    556, 555, 554, 552, 550, 549, 548, 546, 544, 543, 542, 540, 539, 537, 536, 535,
    533, 532, 531, 529, 528, 526, 525, 524, 523, 521, 520, 519, 518, 516, 515, 514,
    513, 511, 510, 509, 508, 507, 506, 504, 503, 502, 501, 500,
];

/// Printed by `golden.py` too. With the slope turned round these are the counts of the deceleration if it stood alone; after
/// the other parts their rounding begins elsewhere.
#[rustfmt::skip]
const DOWN: [u32; 223] = [
    500, 501, 502, 504, 504, 506, 507, 508, 509, 511, 511, 513, 514, 515, 517, 518,
    519, 520, 522, 522, 525, 525, 527, 528, 529, 531, 532, 533, 535, 536, 538, 539,
    540, 542, 543, 545, 546, 547, 550, 550, 552, 554, 555, 557, 558, 560, 561, 563,
    565, 566, 568, 569, 571, 573, 575, 576, 578, 580, 581, 584, 585, 587, 588, 591,
    592, 594, 597, 598, 600, 602, 604, 606, 607, 610, 612, 614, 617, 618, 620, 623,
    625, 627, 629, 631, 634, 636, 638, 641, 643, 646, 647, 651, 653, 655, 658, 660,
    663, 666, 668, 671, 674, 677, 679, 682, 685, 688, 691, 694, 697, 700, 703, 706,
    710, 712, 716, 719, 723, 726, 729, 733, 737, 740, 744, 747, 752, 755, 759, 763,
    767, 771, 775, 779, 784, 788, 793, 797, 801, 807, 811, 816, 820, 826, 831, 836,
    841, 847, 852, 858, 864, 869, 876, 881, 888, 894, 900, 907, 914, 921, 928, 935,
    942, 950, 958, 966, 974, 983, 991, 1000, 1009, 1018, 1028, 1038, 1047, 1059, 1069, 1080,
    1092, 1104, 1115, 1129, 1141, 1155, 1170, 1183, 1199, 1215, 1230, 1248, 1266, 1284, 1303, 1324,
    1345, 1367, 1391, 1415, 1441, 1468, 1498, 1529, 1561, 1596, 1634, 1674, 1718, 1764, 1815, 1870,
    1932, 1998, 2073, 2156, 2251, 2358, 2482, 2628, 2802, 3015, 3284, 3637, 4128, 4876, 5000,
];

fn frequency(hertz: u64) -> Frequency {
    Frequency::from_millihertz(1_000 * hertz).expect("possible")
}

fn profile(hold: Hold) -> Positioning {
    let t = Clocks(200_000);
    Positioning { start: frequency(200), max: frequency(2_000), t_a: t, hold, t_c: t }
}

fn counts(train: &Train) -> Vec<u32> {
    train.periods().map(Period::clocks).collect()
}

#[test]
fn the_counts_of_a_ramp_are_those_computed_by_hand() {
    let up = Positioning { t_c: Clocks(0), ..profile(Hold::For(Clocks(0))) };
    let up = Train::positioning(up).expect("possible");
    assert_eq!(counts(&up), UP);
    assert_eq!(up.steps(), PartSteps { a: 220, b: 0, c: 0 });
    assert_eq!(up.duration(), Clocks(200_591));

    let down = Positioning { t_a: Clocks(0), ..profile(Hold::For(Clocks(0))) };
    let down = Train::positioning(down).expect("possible");
    assert_eq!(counts(&down), DOWN);
    assert_eq!(down.steps(), PartSteps { a: 0, b: 0, c: 223 });

    // t_b = 0.5 s of 2 000 pulses/s.
    let whole = Train::positioning(profile(Hold::For(Clocks(500_000)))).expect("possible");
    assert_eq!(whole.steps(), PartSteps { a: 220, b: 1_000, c: 223 });
    // 200 591.100 58 + 500 000 + 209 311.086 48, in `golden.py`'s numbers.
    assert_eq!(whole.duration(), Clocks(909_902));
    let counts = counts(&whole);
    assert_eq!(counts[..220], UP);
    assert!(counts[220..1_220].iter().all(|&count| count == 500));
    for (got, alone) in counts[1_220..].iter().zip(DOWN) {
        assert!(got.abs_diff(alone) <= 1, "{got}, {alone}");
    }
}

#[test]
fn a_train_has_the_pulses_that_were_asked_for() {
    let total = |hold| Train::positioning(profile(hold)).map(|train| train.steps());
    assert_eq!(total(Hold::ForTotal(1_443)), Ok(PartSteps { a: 220, b: 1_000, c: 223 }));
    assert_eq!(total(Hold::ForTotal(443)), Ok(PartSteps { a: 220, b: 0, c: 223 }));
    assert_eq!(total(Hold::ForTotal(442)), Err(TimingError::TooFewSteps { asked: 442, a: 220, c: 223 }));
    assert_eq!(
        TimingError::TooFewSteps { asked: 442, a: 220, c: 223 }.to_string(),
        "442 pulses are too few: the ramps alone have 443, 220 up and 223 down"
    );
    assert_eq!(Train::constant(frequency(20), 0), Err(TimingError::NoSteps));
    let backwards = Positioning { start: frequency(2_001), ..profile(Hold::ForTotal(1_000)) };
    assert!(matches!(Train::positioning(backwards), Err(TimingError::StartAboveTop { .. })));
    let long = Positioning { t_a: Clocks(100_000_001), ..profile(Hold::ForTotal(1_000)) };
    assert_eq!(
        Train::positioning(long).expect_err("too long").to_string(),
        "t_a of 100.000001 s is too long: at most 100 s"
    );
}

/// Three thousand pulses/s are 333.33 clocks: each rounded by itself would lose a clock every three pulses.
#[test]
fn a_constant_frequency_does_not_drift() {
    let train = Train::constant(frequency(3_000), 3_000_000).expect("possible");
    assert_eq!(train.duration(), Clocks(1_000_000_000));
    assert!(train.periods().all(|period| (333..=334).contains(&period.clocks())));
    let slowest = Train::constant(Frequency::LOWEST, 1_000).expect("possible");
    assert_eq!(slowest.periods().count(), 1_000);
    let fastest = Train::constant(Frequency::HIGHEST, 1_000).expect("possible");
    assert_eq!(fastest.duration(), Clocks(2_000));
}

/// Equations (1) to (6) in seconds and pulses per second, as they stand; the times of the pulses of one part.
fn oracle(from: f64, to: f64, duration: f64) -> Vec<f64> {
    let (low, high) = (from.min(to), from.max(to));
    let slope = (to - from) / duration;
    let (mut time, mut times) = (0.0, vec![]);
    loop {
        let is_last = time > duration;
        time += 1.0 / (slope * time + from).clamp(low, high);
        times.push(time);
        if is_last {
            return times;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_pulse_is_within_a_clock_of_its_exact_time(
        start in 15_259_u64..3_000_000,
        rise in 0_u64..20_000_000,
        t_a in 1_000_u64..500_000,
        t_b in 0_u64..300_000,
        t_c in 1_000_u64..500_000,
    ) {
        let (low, high) = (start as f64 / 1e3, (start + rise) as f64 / 1e3);
        let seconds = |clocks: u64| clocks as f64 / 1e6;
        let hertz = |millihertz| Frequency::from_millihertz(millihertz).expect("possible");
        let wanted = Positioning {
            start: hertz(start),
            max: hertz(start + rise),
            t_a: Clocks(t_a),
            hold: Hold::For(Clocks(t_b)),
            t_c: Clocks(t_c),
        };
        let train = Train::positioning(wanted).expect("possible");
        let up = oracle(low, high, seconds(t_a));
        let down = oracle(high, low, seconds(t_c));
        let hold = (seconds(t_b) * high).round();
        let PartSteps { a, b, c } = train.steps();
        // At the very border the last binary digit decides.
        prop_assume!([&up, &down].iter().zip([t_a, t_c]).all(|(times, end)| {
            times.iter().all(|time| (time - seconds(end)).abs() > 1e-9)
        }));
        prop_assert_eq!((a as usize, c as usize), (up.len(), down.len()));
        prop_assert!((f64::from(b) - hold).abs() <= 1.0);
        let top = up[up.len() - 1];
        let until = top + f64::from(b) / high;
        let exact = up
            .iter()
            .copied()
            .chain((1..=b).map(|pulse| top + f64::from(pulse) / high))
            .chain(down.iter().map(|time| until + time));
        let mut clock = 0_u64;
        for (period, exact) in train.periods().zip(exact) {
            clock += u64::from(period.clocks());
            prop_assert!((clock as f64 - exact * 1e6).abs() < 0.51, "{} clocks for {} s", clock, exact);
        }
        prop_assert_eq!(train.periods().count() as u64, train.steps().total());
        prop_assert_eq!(train.duration(), Clocks(clock));
    }
}

/// Keeps everything; the run ends early at the sample of that number.
#[derive(Default)]
struct Everything {
    pulses: Vec<Pulse>,
    samples: Vec<Sample>,
    until: Option<u64>,
}

impl Observer for Everything {
    fn pulse(&mut self, pulse: Pulse) {
        self.pulses.push(pulse);
    }

    fn sample(&mut self, sample: Sample) -> ControlFlow<()> {
        self.samples.push(sample);
        if self.until == Some(sample.number) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

fn run(motor: &MotorConfig, train: &Train, direction: Direction, sampling: u32) -> (Outcome, Everything) {
    let bench = Bench::new(motor).expect("such a motor can be");
    let mut seen = Everything::default();
    let sampling = Sampling::new(sampling).expect("possible");
    let outcome = bench.run(train, direction, sampling, &mut seen);
    assert_eq!(outcome.samples, seen.samples.len() as u64);
    (outcome, seen)
}

fn constant(hertz: u64, steps: u32) -> Train {
    Train::constant(frequency(hertz), steps).expect("possible")
}

#[test]
fn twenty_pulses_a_second_turn_the_motor_by_as_many_half_steps() {
    for (direction, sign) in [(Direction::Forward, 1), (Direction::TowardsOrigin, -1)] {
        let (outcome, seen) = run(&MotorConfig::bench(), &constant(20, 8), direction, 20_000);
        let Outcome { confirmed, l, r, illegal, at_rest, interrupted, .. } = outcome.clone();
        assert_eq!(confirmed, Confirmed { commanded: 8 * sign, measured: 8 * sign, first_lost: None });
        assert_eq!((illegal, at_rest, interrupted), (0, true, false));
        // 20 counts to a half step; dry friction holds it a little off the detent.
        let position = l.cast_signed() - r.cast_signed();
        assert!((position - sign * 160).abs() < 10, "{position}");
        // At 20 pulses/s it swings at every step (Fig. 7 of [M]).
        assert!(outcome.reversals >= 16 && l.min(r) > 0, "{outcome:?}");
        for (number, pulse) in (1..).zip(&seen.pulses) {
            assert_eq!((pulse.number, pulse.at), (number, Tick(number * 100_000)));
        }
        for (number, sample) in (0..).zip(&seen.samples) {
            assert_eq!((sample.number, sample.at), (number, Tick(number * 100)));
        }
        assert_eq!(outcome.last_pulse, Tick(800_000));
        assert_eq!(seen.samples.last().map(|sample| sample.at), Some(outcome.ended));
    }
}

#[test]
fn the_pulses_come_when_their_counts_say_and_the_samples_when_theirs_do() {
    let train = Train::positioning(profile(Hold::ForTotal(600))).expect("possible");
    let (outcome, seen) = run(&MotorConfig::bench(), &train, Direction::Forward, 44_100);
    assert_eq!(outcome.confirmed.lost(), 0, "{outcome:?}");
    assert_eq!(outcome.confirmed.first_lost, None);
    let mut due = Tick(0);
    let periods: Vec<Period> = train.periods().collect();
    assert_eq!(seen.pulses.len(), periods.len());
    for (pulse, period) in seen.pulses.iter().zip(periods) {
        due += Ticks(2 * u64::from(period.clocks()));
        assert_eq!((pulse.at, pulse.period), (due, period));
    }
    assert_eq!(outcome.last_pulse, Tick(2 * train.duration().0));
    let sampling = Sampling::new(44_100).expect("possible");
    for (number, sample) in (0..).zip(&seen.samples) {
        assert_eq!(sample.at, sampling.tick_of(number));
        let given = seen.pulses.partition_point(|pulse| pulse.at <= sample.at);
        assert_eq!(sample.commanded, i64::try_from(given).expect("few"));
        assert_eq!(sample.period, given.checked_sub(1).map(|last| seen.pulses[last].period));
    }
}

/// The counters hold what the shaft did, to a count: nothing is lost between encoder, discriminator and 8253.
#[test]
fn the_counters_follow_the_shaft() {
    let (motor, train) = (MotorConfig::bench(), constant(900, 100));
    let (_, seen) = run(&motor, &train, Direction::Forward, 60_000);
    let mut rotor = Rotor::new(&motor, Detent(0)).expect("it can be");
    let (mut now, mut pulses) = (Tick(0), seen.pulses.iter().peekable());
    for sample in &seen.samples {
        while let Some(pulse) = pulses.next_if(|pulse| pulse.at <= sample.at) {
            rotor.advance(pulse.at.since(now));
            rotor.pulse(Direction::Forward);
            now = pulse.at;
        }
        rotor.advance(sample.at.since(now));
        now = sample.at;
        let Counts(position) = sample.position();
        let shaft = rotor.motion().half_steps * 20.0;
        // The discriminator's last clock may lie half a clock back.
        assert!((position as f64 - shaft).abs() <= 1.0, "{position} counts, {shaft} at {now:?}");
    }
}

/// Too fast from standstill: what the encoder says is what the rotor did, and the place is where it slipped.
#[test]
fn lost_steps_are_found_and_placed() {
    let motor = Load { torque: 0.5, inertia: 2e-4 }.on(&MotorConfig::bench());
    for (hertz, steps) in [(5_000, 400), (2_600, 300), (40_000, 400)] {
        let (outcome, seen) = run(&motor, &constant(hertz, steps), Direction::Forward, 50_000);
        let mut rotor = Rotor::new(&motor, Detent(0)).expect("it can be");
        let (mut now, mut slipped) = (Tick(0), None);
        for pulse in &seen.pulses {
            rotor.advance(pulse.at.since(now));
            now = pulse.at;
            if rotor.slips() > 0 {
                slipped = slipped.or(Some(pulse.number - 1));
            }
            rotor.pulse(Direction::Forward);
        }
        assert!(rotor.settle(Ticks(20_000_000)));
        assert_eq!(outcome.confirmed.measured, rotor.detent().0, "{hertz} pulses/s: {outcome:?}");
        assert!(outcome.confirmed.lost() > 0 && outcome.confirmed.lost() % 8 == 0, "{outcome:?}");
        let first = outcome.confirmed.first_lost.expect("a place");
        let slipped = slipped.expect("a slip");
        assert!(first.pulse <= slipped && first.pulse + 8 >= slipped, "{first:?}, slipped at {slipped}");
        let ended = first.period.expect("after a pulse").clocks();
        assert!(ended.abs_diff(1_000_000 / u32::try_from(hertz).expect("small")) <= 1, "{first:?}");
    }
}

/// A disc so fine that its edges come faster than the discriminator's clock: it says so, and the count is wrong.
#[test]
fn edges_faster_than_the_clock_are_illegal() {
    let fine = MotorConfig { encoder_lines: 100_000, ..MotorConfig::bench() };
    let (outcome, _) = run(&fine, &constant(1_000, 100), Direction::Forward, 20_000);
    assert!(outcome.illegal > 0, "{outcome:?}");
    let coarse = MotorConfig { encoder_lines: 10_000, ..MotorConfig::bench() };
    let (outcome, _) = run(&coarse, &constant(1_000, 100), Direction::Forward, 20_000);
    assert_eq!((outcome.illegal, outcome.confirmed.lost()), (0, 0), "{outcome:?}");
}

#[test]
fn a_run_ends_when_its_observer_has_enough() {
    let bench = Bench::new(&MotorConfig::bench()).expect("it can be");
    let mut seen = Everything { until: Some(1_000), ..Everything::default() };
    let outcome = bench.run(&constant(20, 1_000), Direction::Forward, Sampling::LOWEST, &mut seen);
    assert!(outcome.interrupted && !outcome.at_rest);
    assert_eq!((outcome.samples, outcome.ended), (1_001, Tick(100_000)));
    assert_eq!(outcome.confirmed.commanded, 1);
}
