//! The rotor against closed forms and the source's claims, with the ramp's own pulses; the encoder against a naive oracle.

use proptest::prelude::*;
use supersigma_config::{MotorConfig, Sin2};
use supersigma_protocol::{Direction, Distance, SpeedIndex, Tick, Ticks};

use super::*;
use crate::ramp::{Plan, Stop, Table};

const SECOND: Ticks = Ticks(Tick::PER_SECOND);
/// Longer than any rotor here coasts.
const PATIENCE: Ticks = Ticks(20 * Tick::PER_SECOND);

fn bench() -> MotorConfig {
    MotorConfig::bench()
}

fn rotor(config: &MotorConfig) -> Rotor {
    Rotor::new(config, Detent(0)).expect("such a motor can be")
}

/// The ramp of the default set with another top; the same shape, so everything scales.
fn table(amplitude: f64) -> Table {
    Table::new(&Sin2 { amplitude, ..Sin2::default() }.into()).expect("a usable ramp")
}

fn full(table: &Table, half_steps: u16) -> Plan {
    Plan::ramped(table, Distance::new(half_steps).expect("not zero"), SpeedIndex::TOP)
}

/// Makes the plan's first `pulses` pulses, each at its tick.
fn play(rotor: &mut Rotor, plan: &Plan, pulses: u32) {
    for pulse in 1..=pulses {
        rotor.advance(Ticks(plan.tick_of(pulse) - plan.tick_of(pulse - 1)));
        rotor.pulse(Direction::Forward);
    }
}

fn play_all(config: &MotorConfig, plan: &Plan) -> Rotor {
    let mut rotor = rotor(config);
    play(&mut rotor, plan, plan.total().0);
    assert!(rotor.settle(PATIENCE), "at rest in the end");
    rotor
}

fn train(rotor: &mut Rotor, pulses: u32, period: u64, direction: Direction) {
    for _ in 0..pulses {
        rotor.pulse(direction);
        rotor.advance(Ticks(period));
    }
}

/// The times in seconds at which the rotor passes `centre` forwards in the next `span`, interpolated between looks 5 µs
/// apart; and the furthest that it gets from there.
fn passages(rotor: &mut Rotor, centre: f64, span: Ticks) -> (Vec<f64>, f64) {
    let (mut times, mut furthest) = (vec![], 0.0_f64);
    let mut before = rotor.motion().half_steps - centre;
    for look in 0..span.0 / 10 {
        rotor.advance(Ticks(10));
        let now = rotor.motion().half_steps - centre;
        if before < 0.0 && now >= 0.0 {
            let part = before / (before - now);
            times.push((Ticks(look * 10).as_seconds()) + part * 5e-6);
        }
        furthest = furthest.max(now.abs());
        before = now;
    }
    (times, furthest)
}

fn mean_period(passages: &[f64]) -> f64 {
    let periods = u32::try_from(passages.len() - 1).expect("few");
    (passages[passages.len() - 1] - passages[0]) / f64::from(periods)
}

/// A motor in which nothing damps a swing and the field follows at once.
fn frictionless() -> MotorConfig {
    MotorConfig { damping: 0.0, viscous_friction: 0.0, friction: 0.0, corner_speed: 1e7, ..bench() }
}

#[test]
fn one_step_ends_in_its_detent_and_rest_costs_nothing() {
    let mut rotor = rotor(&bench());
    rotor.pulse(Direction::Forward);
    assert!(!rotor.is_at_rest());
    rotor.advance(SECOND);
    assert!(rotor.is_at_rest());
    assert_eq!((rotor.detent(), rotor.slips()), (Detent(1), 0));
    // Dry friction holds it within asin(0.03 / 2.5) / (π/4) = 0.0153 half steps of the detent.
    let motion = rotor.motion();
    assert!((motion.half_steps - 1.0).abs() < 0.015_3, "{motion:?}");
    assert!(motion.speed.abs() < f64::EPSILON);
    // 3 000 years would not be over yet if they were integrated.
    rotor.advance(Ticks(u64::MAX / 100));
    assert_eq!(rotor.motion(), motion);
}

#[test]
fn a_hanging_weight_deflects_the_rotor_by_the_springs_own_angle() {
    let config = MotorConfig { load_torque: 1.25, friction: 0.0, ..bench() };
    let mut rotor = rotor(&config);
    assert!(rotor.settle(PATIENCE));
    // asin(1.25 / 2.5) = 30° electrical; a half step is 45°.
    assert!((rotor.motion().half_steps + 30.0 / 45.0).abs() < 1e-3, "{:?}", rotor.motion());
    assert_eq!((rotor.detent(), rotor.slips()), (Detent(0), 0));
}

#[test]
fn small_swings_have_the_closed_forms_frequency() {
    for (torque, inertia) in [(2.5, 1.2e-4), (0.5, 1.2e-4), (2.5, 2e-3), (4.0, 1e-5)] {
        // So little damping that it changes the frequency by less than a thousandth.
        let config = MotorConfig { holding_torque: torque, rotor_inertia: inertia, ..frictionless() };
        let natural = config.natural_hertz() * std::f64::consts::TAU;
        let config = MotorConfig { viscous_friction: 0.02 * inertia * natural, ..config };
        let mut rotor = rotor(&config);
        rotor.pulse(Direction::Forward);
        // From π/4 down to below 0.15 rad, where sin x is x within 0.4 %.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a short positive span")]
        let seconds = |seconds: f64| Ticks((seconds * 2e6) as u64);
        rotor.advance(seconds(180.0 / natural));
        let (passages, furthest) = passages(&mut rotor, 1.0, seconds(63.0 / natural));
        assert!(furthest < 0.2 && passages.len() >= 10, "{furthest}, {}", passages.len());
        let error = 1.0 / mean_period(&passages) / config.natural_hertz() - 1.0;
        assert!(error.abs() < 0.01, "{:.1} Hz, off by {error:.5}", config.natural_hertz());
    }
}

#[test]
fn large_swings_are_a_pendulums_and_lose_no_energy_by_computing() {
    let config = frictionless();
    let mut rotor = rotor(&config);
    rotor.pulse(Direction::Forward);
    let (passages, furthest) = passages(&mut rotor, 1.0, SECOND);
    // (2/π) K(sin 22.5°) = 1.0400 for an amplitude of 45°, one half step.
    let ratio = mean_period(&passages) * config.natural_hertz();
    assert!((ratio - 1.040).abs() < 0.001, "{ratio}");
    assert!((furthest - 1.0).abs() < 0.002, "{furthest}");
    assert!(passages.len() > 150);
    let late = self::passages(&mut rotor, 1.0, Ticks(100_000)).1;
    assert!((late - 1.0).abs() < 0.002, "{late}");
}

#[test]
fn both_directions_are_mirrors() {
    let plan = full(&table(15_000.0), 4_000);
    let (mut forward, mut backward) = (rotor(&bench()), rotor(&bench()));
    for pulse in 1..=plan.total().0 {
        let span = Ticks(plan.tick_of(pulse) - plan.tick_of(pulse - 1));
        for (rotor, direction) in
            [(&mut forward, Direction::Forward), (&mut backward, Direction::TowardsOrigin)]
        {
            rotor.advance(span);
            rotor.pulse(direction);
        }
        let (there, back) = (forward.motion(), backward.motion());
        assert!((there.half_steps + back.half_steps).abs() < 1e-6, "{there:?} {back:?}");
    }
}

#[test]
fn above_pull_in_it_slips_by_whole_cycles() {
    for speed in [3_500, 5_000, 8_000, 15_000] {
        let mut rotor = rotor(&bench());
        train(&mut rotor, 2_000, Tick::PER_SECOND / speed, Direction::Forward);
        assert!(rotor.settle(PATIENCE));
        let lost = rotor.field().0 - rotor.detent().0;
        assert_eq!(rotor.field(), Detent(2_000));
        assert!(lost > 0 && lost % 8 == 0, "{lost} half steps lost at {speed}/s");
        assert!(rotor.slips() >= lost.unsigned_abs() / 8, "{} slips", rotor.slips());
    }
}

#[test]
fn a_motor_that_runs_does_not_follow_a_jump_to_another_speed() {
    let mut rotor = rotor(&bench());
    train(&mut rotor, 200, Tick::PER_SECOND / 1_000, Direction::Forward);
    assert_eq!(rotor.slips(), 0);
    train(&mut rotor, 2_000, Tick::PER_SECOND / 8_000, Direction::Forward);
    assert!(rotor.slips() > 0);
}

#[test]
fn the_ramp_takes_the_bench_motor_to_15_000_and_to_27_000() {
    for amplitude in [15_000.0, 27_000.0] {
        let plan = full(&table(amplitude), 40_000);
        let mut rotor = rotor(&bench());
        let half = plan.pulses_by(plan.duration() / 2);
        play(&mut rotor, &plan, half);
        // Within a hundredth of the top speed, and behind the field by less than half a cycle.
        let motion = rotor.motion();
        assert!((motion.speed / amplitude - 1.0).abs() < 0.01, "{motion:?}");
        assert!((f64::from(half) - motion.half_steps).abs() < 4.0, "{motion:?} after {half} pulses");
        let rotor = play_all(&bench(), &plan);
        assert_eq!((rotor.slips(), rotor.detent()), (0, Detent(40_000)), "at {amplitude}");
    }
}

#[test]
fn short_movements_of_every_length_are_followed() {
    let table = table(15_000.0);
    for length in (1..40).chain((40..5_400).step_by(67)) {
        let rotor = play_all(&bench(), &full(&table, length));
        assert_eq!((rotor.slips(), rotor.detent()), (0, Detent(length.into())));
    }
}

#[test]
fn the_same_ramp_is_too_steep_for_twenty_times_the_inertia() {
    let heavy = MotorConfig { load_inertia: 20.0 * bench().rotor_inertia, ..bench() };
    let rotor = play_all(&heavy, &full(&table(15_000.0), 40_000));
    assert!(rotor.slips() > 0);
    assert_ne!(rotor.detent(), Detent(40_000));
}

#[test]
fn a_motor_is_not_stopped_by_suspending_the_pulses_but_by_the_steep_ramp() {
    let table = table(15_000.0);
    let plan = full(&table, 40_000);
    let cut = plan.pulses_by(plan.duration() / 2);
    let mut coasting = rotor(&bench());
    play(&mut coasting, &plan, cut);
    assert_eq!(coasting.slips(), 0);
    assert!(coasting.settle(PATIENCE));
    let lost = (coasting.detent().0 - i64::from(cut)).unsigned_abs();
    assert!(coasting.slips() > 0 && lost > 0, "{lost} half steps too far");

    let mut braked = plan.clone();
    braked.stop(&table, plan.tick_of(cut), Stop::Brake);
    let way = braked.total().0 - cut;
    assert!(way < 1_000, "three times as steep as the ramp's 2 587: {way}");
    let rotor = play_all(&bench(), &braked);
    assert_eq!((rotor.slips(), rotor.detent()), (0, Detent(braked.total().0.into())));
    // "… would increase the stopping time, rather than reduce it" [C]: so it is the shorter way, too.
    assert!(lost > u64::from(way), "coasts {lost}, brakes within {way}");
}

#[test]
fn at_a_stop_the_rotor_stays_and_the_field_turns_on() {
    let mut rotor = rotor(&bench()).with_stops(Detent(-3), Detent(20));
    for _ in 0..100 {
        rotor.pulse(Direction::Forward);
        rotor.advance(Ticks(2_000));
        assert!(rotor.motion().half_steps <= 20.0, "{:?}", rotor.motion());
    }
    assert!(rotor.settle(PATIENCE));
    assert!(rotor.slips() >= 9, "80 pulses too many: {}", rotor.slips());
    // The detent of the field that is next to the stop, before it or beyond it: 100 − 80, 20.
    assert_eq!(rotor.detent(), Detent(20));
    train(&mut rotor, 15, 2_000, Direction::TowardsOrigin);
    assert!(rotor.settle(PATIENCE));
    assert_eq!(rotor.detent(), Detent(5));
    assert!((rotor.motion().half_steps - 5.0).abs() < 0.02, "{:?}", rotor.motion());
}

#[test]
fn pull_in_falls_with_inertia_and_with_torque() {
    let pull_in = |torque, inertia| {
        pull_in(&bench(), Load { torque, inertia }).expect("a motor").expect("it starts at all")
    };
    for loads in [
        [0.0, 1.2e-4, 6e-4, 2.4e-3].map(|inertia| pull_in(0.0, inertia)),
        [0.0, 0.5, 1.0, 1.5].map(|torque| pull_in(torque, 0.0)),
    ] {
        assert!(loads.windows(2).all(|pair| pair[1] < pair[0]), "{loads:?}");
    }
    // A rotor that is suddenly led by a field of speed ω catches up if ω < 2 ω₀ / p: 2 599 half steps/s, but
    // for the field's own delay.
    let free = pull_in(0.0, 0.0);
    assert!((2_000.0..2_599.0).contains(&free), "{free}");
}

#[test]
fn stopping_in_full_swing_is_harder_than_starting() {
    let load = Load::default();
    let [start_stop, pull_in] =
        [start_stop, pull_in].map(|limit| limit(&bench(), load).expect("a motor").expect("starts"));
    assert!(start_stop < 0.7 * pull_in, "{start_stop} {pull_in}");
    let fails = |speed| {
        (1..=48).find(|pulses| {
            let mut rotor = rotor(&bench());
            train(&mut rotor, *pulses, speed, Direction::Forward);
            rotor.settle(PATIENCE);
            rotor.slips() > 0
        })
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a period")]
    let period = |speed: f64| (2e6 / speed).round() as u64;
    assert_eq!(fails(period(start_stop * 0.99)), None);
    assert!(fails(period(start_stop * 1.02)).is_some());
}

#[test]
fn pull_out_falls_with_torque_as_the_field_does_with_speed() {
    let config = bench();
    let mut last = f64::INFINITY;
    for torque in [0.25, 0.5, 1.0, 1.5, 2.0] {
        let load = Load { torque, inertia: 0.0 };
        let speed = pull_out(&config, load, 300.0..=60_000.0).expect("a motor").expect("it falls out");
        assert!(speed < last, "{speed} with {torque} N·m, {last} with less");
        last = speed;
        // T / √(1 + (f / corner)²), of which the first harmonic of eight steps is sinc(π/8) = 0.9745, carries it all:
        // brake, friction, and the acceleration of the test itself.
        let available =
            0.974_5 * config.holding_torque / (1.0 + (speed / config.corner_speed).powi(2)).sqrt();
        let shaft = speed * std::f64::consts::TAU / 400.0;
        let needed = torque + config.friction + config.viscous_friction * shaft + 0.025;
        assert!((available / needed - 1.0).abs() < 0.05, "{available} of {needed} N·m at {speed}");
    }
    assert_eq!(pull_out(&config, Load::default(), 500.0..=27_000.0), Ok(None));
}

#[test]
fn the_characteristic_has_its_start_region_inside() {
    let points = characteristic(&bench(), 1.2e-4, [0.0, 1.0, 3.0], 20_000.0).expect("a motor");
    assert_eq!(points[0].pull_out, None, "beyond 20 000");
    let (start, run) = (points[1].pull_in.expect("starts"), points[1].pull_out.expect("falls out"));
    assert!(start < run, "{points:?}");
    assert_eq!((points[2].pull_in, points[2].pull_out), (None, Some(0.0)), "more than it can hold");
}

#[test]
fn motors_that_cannot_be_are_refused() {
    let config = MotorConfig { rotor_inertia: 0.0, ..bench() };
    let error = config.check().expect_err("no inertia");
    assert_eq!(Rotor::new(&config, Detent(0)).err(), Some(error.clone()));
    assert_eq!(pull_in(&config, Load::default()), Err(error.clone()));
    assert_eq!(pull_out(&config, Load::default(), 100.0..=1_000.0), Err(error));
}

#[test]
fn the_encoder_finds_out_what_the_pulses_do_not_tell() {
    for (speed, slips) in [(1_500, false), (6_000, true)] {
        let config = bench();
        let mut rotor = rotor(&config);
        let mut encoder = Encoder::new(&config, 0.0);
        let mut discriminator = SenseDiscriminator::new(encoder.levels());
        let mut look = |rotor: &Rotor| {
            for levels in encoder.turn_to(rotor.motion().half_steps) {
                discriminator.sample(levels);
            }
            let position = encoder.half_steps(discriminator.position());
            assert!((position - rotor.motion().half_steps).abs() < 1.0 / 20.0, "within a count");
            (position, discriminator.reversals(), discriminator.illegal())
        };
        for _ in 0..600 {
            rotor.pulse(Direction::Forward);
            for _ in 0..4 {
                rotor.advance(Ticks(Tick::PER_SECOND / speed / 4));
                look(&rotor);
            }
        }
        while !rotor.is_at_rest() {
            rotor.advance(Ticks(100));
            look(&rotor);
        }
        let (position, reversals, illegal) = look(&rotor);
        #[expect(clippy::cast_possible_truncation, reason = "a few hundred")]
        let found = position.round() as i64;
        assert_eq!(found, rotor.detent().0);
        assert_eq!(found != 600, slips, "{found} half steps of 600 at {speed}/s");
        assert_eq!(illegal, 0);
        assert!(reversals > 0, "it swings when it stops");
    }
}

#[test]
fn both_signals_at_once_are_illegal_and_count_nothing() {
    let config = bench();
    let mut encoder = Encoder::new(&config, 0.0);
    let mut discriminator = SenseDiscriminator::new(encoder.levels());
    // 20 counts to a half step: two counts each time, of which every first one is missed.
    for look in 1..=50 {
        assert_eq!(encoder.turn_to(f64::from(look) / 10.0).count(), 2);
        assert_eq!(discriminator.sample(encoder.levels()), None);
    }
    assert_eq!((discriminator.illegal(), discriminator.position()), (50, Counts(0)));
}

#[test]
fn a_turn_has_8_000_counts() {
    let mut encoder = Encoder::new(&bench(), 0.0);
    let mut discriminator = SenseDiscriminator::new(encoder.levels());
    for levels in encoder.turn_to(400.0) {
        assert_eq!(discriminator.sample(levels), Some(Sense::Clockwise));
    }
    assert_eq!((discriminator.clockwise(), discriminator.position()), (8_000, Counts(8_000)));
    for levels in encoder.turn_to(399.0) {
        assert_eq!(discriminator.sample(levels), Some(Sense::Anticlockwise));
    }
    assert_eq!((discriminator.anticlockwise(), discriminator.position()), (20, Counts(7_980)));
    assert_eq!((discriminator.reversals(), discriminator.illegal()), (1, 0));
    assert!((encoder.half_steps(Counts(7_980)) - 399.0).abs() < 1e-9);
}

/// Each train, from rest to rest, moves the rotor by its pulses.
fn follow(trains: &[(u32, u64, bool)]) -> Result<(), TestCaseError> {
    let mut rotor = rotor(&bench());
    let mut expected = 0;
    for &(pulses, speed, forward) in trains {
        let (direction, sense) =
            if forward { (Direction::Forward, 1) } else { (Direction::TowardsOrigin, -1) };
        train(&mut rotor, pulses, Tick::PER_SECOND / speed, direction);
        prop_assert!(rotor.settle(PATIENCE));
        expected += sense * i64::from(pulses);
        let end = (rotor.slips(), rotor.detent());
        prop_assert_eq!(end, (0, Detent(expected)), "{} steps at {}/s", pulses, speed);
        let motion = rotor.motion();
        #[expect(clippy::cast_precision_loss, reason = "a few thousand")]
        let error = motion.half_steps - expected as f64;
        prop_assert!(error.abs() < 0.016, "{:?}", motion);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn below_start_stop_every_pulse_is_a_step(
        trains in proptest::collection::vec((1_u32..=600, 30_u64..=1_400, any::<bool>()), 1..4),
    ) {
        follow(&trains)?;
    }

    #[test]
    fn below_pull_in_every_pulse_of_a_long_train_is_a_step(
        trains in proptest::collection::vec((500_u32..=1_000, 1_400_u64..=2_400, any::<bool>()), 1..3),
    ) {
        follow(&trains)?;
    }

    /// A rotor that is said to be captured comes to rest in its detent, with a hanging weight too, and whatever the pulses were.
    #[test]
    fn who_is_captured_stays(
        pulses in proptest::collection::vec((50_u64..3_000, any::<bool>()), 1..60), load_torque in -2.0..2.0_f64,
        corner_speed in 500.0..20_000.0_f64, load_inertia in 0.0..1e-3_f64,
    ) {
        let config = MotorConfig { load_torque, corner_speed, load_inertia, ..bench() };
        let mut rotor = rotor(&config);
        for (span, forward) in pulses {
            rotor.pulse(if forward { Direction::Forward } else { Direction::TowardsOrigin });
            rotor.advance(Ticks(span));
        }
        // A weight that has once pulled the rotor along may keep it running.
        prop_assume!(rotor.catch(SECOND));
        let captured = rotor.detent();
        prop_assert!(rotor.settle(PATIENCE));
        prop_assert_eq!(rotor.detent(), captured);
    }

    /// Whoever looks, and however often, does not change what happens: the motion is a function of the pulses' ticks.
    #[test]
    fn looking_changes_nothing(
        pulses in proptest::collection::vec((1_u64..3_000, any::<bool>()), 1..60), cut in 1_u64..100,
    ) {
        let (mut at_once, mut looked_at) = (rotor(&bench()), rotor(&bench()));
        for (span, forward) in pulses {
            let direction = if forward { Direction::Forward } else { Direction::TowardsOrigin };
            at_once.advance(Ticks(span));
            at_once.pulse(direction);
            for part in 0..span.div_ceil(cut) {
                looked_at.advance(Ticks(cut.min(span - part * cut)));
                let _ = looked_at.motion();
            }
            looked_at.pulse(direction);
            prop_assert_eq!(at_once.motion(), looked_at.motion());
        }
        prop_assert_eq!(at_once.settle(PATIENCE), looked_at.settle(PATIENCE));
        prop_assert_eq!((at_once.motion(), at_once.detent()), (looked_at.motion(), looked_at.detent()));
    }

    /// The plain rule of quadrature: when one signal changes, A before and B after are alike if and only if the disc
    /// turns clockwise.
    #[test]
    fn the_discriminator_does_what_quadrature_says(
        samples in proptest::collection::vec((any::<bool>(), any::<bool>()), 1..300),
    ) {
        let levels = |(a, b)| Levels { a, b };
        let mut discriminator = SenseDiscriminator::new(levels(samples[0]));
        let (mut senses, mut illegal) = (vec![], 0);
        for pair in samples.windows(2) {
            let ((a, b), (new_a, new_b)) = (pair[0], pair[1]);
            let changes = u8::from(a != new_a) + u8::from(b != new_b);
            let expected = (changes == 1)
                .then_some(if a == new_b { Sense::Clockwise } else { Sense::Anticlockwise });
            prop_assert_eq!(discriminator.sample(levels(pair[1])), expected);
            senses.extend(expected);
            illegal += u64::from(changes == 2);
        }
        let count = |sense| senses.iter().filter(|each| **each == sense).count() as u64;
        prop_assert_eq!(discriminator.clockwise(), count(Sense::Clockwise));
        prop_assert_eq!(discriminator.anticlockwise(), count(Sense::Anticlockwise));
        prop_assert_eq!(discriminator.reversals(), senses.windows(2).filter(|pair| pair[0] != pair[1]).count() as u64);
        prop_assert_eq!(discriminator.illegal(), illegal);
        #[expect(clippy::cast_possible_wrap, reason = "at most 300")]
        let position = count(Sense::Clockwise) as i64 - count(Sense::Anticlockwise) as i64;
        prop_assert_eq!(discriminator.position(), Counts(position));
    }

    #[test]
    fn the_encoder_is_where_the_shaft_is(
        start in -500.0..500.0_f64, turns in proptest::collection::vec(-30.0..30.0_f64, 1..40), lines in 1_u32..=5_000,
    ) {
        let config = MotorConfig { encoder_lines: lines, ..bench() };
        let mut encoder = Encoder::new(&config, start);
        let mut discriminator = SenseDiscriminator::new(encoder.levels());
        let mut shaft = start;
        for turn in turns {
            shaft += turn;
            for levels in encoder.turn_to(shaft) {
                prop_assert!(discriminator.sample(levels).is_some());
            }
            let seen = encoder.half_steps(discriminator.position());
            let count = encoder.half_steps(Counts(1));
            prop_assert!((seen - (shaft - start)).abs() <= count * 1.000_001, "{} {}", seen, shaft - start);
        }
        prop_assert_eq!(discriminator.illegal(), 0);
    }
}
