//! Proposals against the rotor, and against each other.

use proptest::prelude::*;
use supersigma_config::{Differences, MotorConfig, MotorError, RampConfig};
use supersigma_protocol::{Distance, SpeedIndex, Ticks};

use super::*;
use crate::bench::{Hold, Positioning, Train};
use crate::motor::{Load, start_stop};
use crate::ramp::{Plan, Stop, Table};

fn distance(half_steps: u16) -> Distance {
    Distance::new(half_steps).expect("not zero")
}

fn margin(part: f64) -> Margin {
    Margin::new(part).expect("a part")
}

fn with_load(torque: f64, inertia: f64) -> MotorConfig {
    Load { torque, inertia }.on(&MotorConfig::bench())
}

fn weak(motor: &MotorConfig, part: f64) -> MotorConfig {
    MotorConfig { holding_torque: motor.holding_torque * (1.0 - part), ..motor.clone() }
}

fn follows(motor: &MotorConfig, pulses: &Pulses) -> bool {
    matches!(play(motor, pulses), Ok(Outcome::Follows { .. }))
}

fn along(ramp: &RampConfig, half_steps: u16) -> Pulses {
    let table = Table::new(ramp).expect("a table");
    Pulses::from(&Plan::ramped(&table, distance(half_steps), SpeedIndex::TOP))
}

#[test]
fn a_train_below_start_stop_follows_and_one_far_above_slips_where_it_starts() {
    let motor = MotorConfig::bench();
    // 1 000 and 5 000 half steps/s; the bench motor starts and stops with up to 1 427, and starts with 2 463.
    let Ok(Outcome::Follows { settled }) = play(&motor, &Pulses::new(vec![2_000; 600])) else {
        panic!("it follows");
    };
    // Two periods of its 162 Hz are 12 ms; dry friction has then taken most of the swing.
    assert!(settled < Ticks::from_millis(100), "{settled:?}");
    let Ok(Outcome::Slips(slip)) = play(&motor, &Pulses::new(vec![400; 600])) else {
        panic!("it slips");
    };
    assert!((4..40).contains(&slip.pulse), "{slip:?}");
    assert_eq!(slip.at, Ticks(400 * slip.pulse as u64));
    assert!((slip.speed - 5_000.0).abs() < 1e-9 && slip.lost > 0 && slip.lost % 8 == 0, "{slip:?}");
}

#[test]
fn lags_are_small_where_it_follows_and_grow_where_it_slips() {
    let motor = MotorConfig::bench();
    let most = |period| {
        let lags = lags(&motor, &Pulses::new(vec![period; 300])).expect("a motor");
        assert!(lags.windows(2).all(|pair| pair[0].0 < pair[1].0));
        lags.into_iter().map(|(_, lag)| lag).fold(0.0, f64::max)
    };
    assert!(most(2_000) < 4.0);
    assert!(most(400) > 8.0);
}

#[test]
fn what_is_proposed_holds_on_every_rung_and_the_bench_plays_the_same_pulses() {
    for (motor, length) in [
        (with_load(0.0, 0.0), 1_500),
        (with_load(0.5, 3e-4), 400),
        (MotorConfig { load_torque: 0.4, ..MotorConfig::bench() }, 500),
    ] {
        let found = linear(&motor, distance(length), margin(0.3)).expect("a proposal");
        assert!(found.trials > 0 && found.trials <= MOST_TRIALS);
        for part in [0.0, 0.15, 0.3] {
            for load_torque in [motor.load_torque, -motor.load_torque] {
                let motor = MotorConfig { load_torque, ..weak(&motor, part) };
                assert!(follows(&motor, &found.pulses), "{found:?} with {part}");
            }
        }
        // Told as t_b, it is the same train.
        let typed = Positioning { hold: Hold::For(found.t_b()), ..found.profile };
        let train = Train::positioning(typed).expect("a train");
        assert_eq!(Pulses::from(&train), found.pulses);
        assert_eq!(found.pulses.len(), usize::from(length));
        assert!(found.profile.t_a.0 > 0 && found.profile.t_c.0 > 0, "{found:?}");
    }
}

#[test]
fn a_cards_ramp_holds_for_shorter_and_longer_movements_and_for_the_emergency_stop() {
    let motor = with_load(0.0, 0.0);
    let weak = weak(&motor, 0.3);
    for shape in [CardShape::Linear, CardShape::Sin2] {
        let found =
            card(&motor, distance(600), margin(0.3), shape, &RampConfig::default()).expect("a proposal");
        assert_eq!(found.pulses, along(&found.ramp, 600));
        for length in (1..48).chain([60, 116, 352, 440, 600]) {
            assert!(follows(&weak, &along(&found.ramp, length)), "{length} of {:?}", found.ramp);
        }
        let table = Table::new(&found.ramp).expect("a table");
        let mut plan = Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP);
        plan.stop(&table, plan.tick_of(table.normal().pulses().0 + 200), Stop::Brake);
        assert!(follows(&weak, &Pulses::from(&plan)), "{:?}", found.ramp);
        assert!(found.ramp.brake_interval_ticks < found.ramp.interval_ticks(), "{:?}", found.ramp);
    }
}

#[test]
fn what_does_not_fit_into_bytes_is_wide() {
    // With 20 times the inertia it starts with 200 half steps/s at most: from there N falls fast.
    let heavy = with_load(0.0, 2.4e-3);
    let curve = |part| card(&heavy, distance(200), margin(part), CardShape::Linear, &RampConfig::default());
    let found = curve(0.5).expect("a proposal");
    assert_eq!(found.ramp.differences, Differences::Wide, "{:?}", found.ramp);
    assert!(found.ramp.counts().is_ok());
}

#[test]
fn what_is_too_steep_is_made_to_hold_and_what_is_too_gentle_faster() {
    let ramp = RampConfig::default();
    let length = distance(4_000);
    let assess = |motor: &MotorConfig, pulses: &Pulses| assess(motor, margin(0.2), pulses).expect("a motor");
    // Ten times the inertia: the ramp of 0.3 s to 15 000 is too steep.
    let heavy = with_load(0.0, 1.2e-3);
    let shorter = distance(600);
    let current = assess(&heavy, &along(&ramp, 4_000));
    let Outcome::Slips(slip) = current.nominal else { panic!("it holds: {current:?}") };
    assert!(slip.pulse > 10 && slip.lost != 0 && current.margin.is_none(), "{current:?}");
    let found = linear(&heavy, shorter, margin(0.2)).expect("a proposal");
    let tuned = assess(&heavy, &found.pulses);
    assert!(matches!(tuned.at_margin, Outcome::Follows { .. }), "{tuned:?}");
    assert!(tuned.margin >= Some(margin(0.2)), "{tuned:?}");
    // The unloaded motor has more in it than that ramp asks for.
    let free = with_load(0.0, 0.0);
    let current = assess(&free, &along(&ramp, 4_000));
    assert!(matches!(current.at_margin, Outcome::Follows { .. }), "{current:?}");
    for pulses in [
        linear(&free, length, margin(0.2)).expect("a proposal").pulses,
        card(&free, length, margin(0.2), CardShape::Sin2, &ramp).expect("a proposal").pulses,
    ] {
        assert!(pulses.duration() < current.duration, "{:?}", pulses.duration());
    }
}

#[test]
fn a_movement_that_is_too_short_for_ramps_has_one_frequency() {
    let motor = MotorConfig::bench();
    for length in [1, 2] {
        let found = linear(&motor, distance(length), Margin::NONE).expect("a proposal");
        assert_eq!((found.profile.t_a.0, found.profile.t_c.0, found.steps.b), (0, 0, length.into()));
        let limit = start_stop(&motor, Load::default()).expect("a motor").expect("it starts");
        assert!(found.profile.max.hertz() <= limit);
        let card = card(&motor, distance(length), Margin::NONE, CardShape::Sin2, &RampConfig::default())
            .expect("a proposal");
        assert!(card.pulses.top_speed() <= limit + 1.0);
    }
}

#[test]
fn more_margin_is_not_faster() {
    let motor = with_load(0.3, 2e-4);
    let duration = |part| linear(&motor, distance(800), margin(part)).expect("a proposal").pulses.duration();
    let durations = [0.0, 0.25, 0.5].map(duration);
    assert!(durations.windows(2).all(|pair| pair[0] <= pair[1]), "{durations:?}");
}

#[test]
fn who_cannot_hold_the_load_is_told_what_is_missing() {
    let loaded = with_load(2.0, 0.0);
    assert!(linear(&loaded, distance(100), margin(0.1)).is_ok());
    let error = linear(&loaded, distance(100), margin(0.3)).expect_err("1.75 N·m are left");
    assert_eq!(error, TuneError::NoMargin { load: 2.03, weakened: 1.75, margin: margin(0.3) });
    let said = error.to_string();
    assert!(said.contains("2.03 N·m") && said.contains("1.750 N·m") && said.contains("30 %"), "{said}");
    let error = linear(&with_load(3.0, 0.0), distance(100), Margin::NONE).expect_err("overloaded");
    assert!(matches!(error, TuneError::Motor(MotorError::Overloaded { .. })), "{error}");
    assert_eq!((Margin::new(1.0), Margin::new(-0.1), Margin::new(f64::NAN)), (None, None, None));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn a_proposal_holds_with_its_margin_whatever_the_motor(
        torque in 0.5..5.0_f64, brake in 0.0..0.3_f64, inertia in 5e-5..1e-3_f64,
        length in 20_u16..400, part in 0.0..0.5_f64,
    ) {
        let motor = MotorConfig {
            holding_torque: torque, friction: 0.03 + brake, rotor_inertia: inertia, ..MotorConfig::bench()
        };
        let found = linear(&motor, distance(length), margin(part));
        let Ok(found) = found else { return Err(TestCaseError::reject("it does not start")) };
        for part in [0.0, part] {
            let outcome = play(&weak(&motor, part), &found.pulses);
            prop_assert!(matches!(outcome, Ok(Outcome::Follows { .. })), "{:?} {:?}", outcome, found.profile);
        }
    }
}
