//! What goes wrong on purpose: inputs that close, switches that stick, steps that are lost; in open and in closed loop.

use proptest::prelude::*;
use supersigma_config::{Config, Feedback, FollowingConfig, MotorConfig, ShortMoves};
use supersigma_protocol::{
    Activity, Alarm, Body, Deviation, Direction, End, Fault, Frame, Operation, Position, Refusal, Sender,
    SensePoint, Steps, Switch,
};

use super::{Rig, config};
use crate::Card;

fn rig(change: impl FnOnce(&mut Config)) -> Rig {
    let mut config = config(ShortMoves::Optimal);
    change(&mut config);
    let card = Card::axis(&config, config.axes[0].address).expect("a good axis").expect("it exists");
    Rig { card, record: super::Record::default(), sequence: supersigma_protocol::Sequence(0) }
}

fn closed(limit: u32) -> impl FnOnce(&mut Config) {
    move |config| {
        let axis = &mut config.axes[0];
        axis.motor = Some(MotorConfig::bench());
        axis.feedback = Feedback::Closed;
        axis.following = FollowingConfig { limit: Steps(limit), ..FollowingConfig::default() };
    }
}

impl Rig {
    fn fail(&mut self, fault: Fault) {
        let axis = self.card.as_axis().expect("a motor card").number();
        let frame = Frame {
            sender: Sender::Ccu,
            sequence: self.sequence,
            tick: self.card.now(),
            body: Body::Fault(axis, fault),
        };
        self.sequence = self.sequence.next();
        self.card.hear(&frame, &mut self.record);
    }

    fn originated(mut self) -> Self {
        self.command(Operation::Originate).expect("nothing forbids it");
        let report = self.settle();
        assert_eq!((report.position, report.alarm), (Some(Position(0)), None));
        self
    }
}

#[test]
fn excessive_force_brakes_keeps_the_position_and_holds_the_axis() {
    let mut rig = rig(|_| {}).originated();
    rig.go(Direction::Forward, 9_000).expect("ready");
    rig.wait(900_000);
    rig.fail(Fault::Force);
    // The period that runs is the last of the cruise.
    rig.wait(133);
    assert_eq!(rig.report().activity, Activity::Braking);
    let report = rig.settle();
    assert_eq!(report.alarm, Some(Alarm::ExcessiveForce));
    assert_eq!(report.position, Some(rig.card.as_axis().expect("a motor card").mechanism().position()));
    assert!(report.steps < Steps(9_000));
    assert_eq!(rig.go(Direction::Forward, 1), Err(Refusal::InAlarm));
    rig.command(Operation::Clear).expect("standing");
    rig.go(Direction::Forward, 1).expect("cleared");
}

#[test]
fn an_axis_that_stood_still_keeps_its_position_in_an_emergency() {
    let mut rig = rig(|_| {}).originated();
    rig.fail(Fault::Limit(End::Upper));
    let report = rig.settle();
    assert_eq!((report.alarm, report.position), (Some(Alarm::EndOfRail(End::Upper)), Some(Position(0))));
}

#[test]
fn a_dead_or_stuck_switch_ends_the_search_with_its_name() {
    let mut dead = rig(|_| {});
    dead.fail(Fault::Switch(Switch::StuckOpen));
    dead.command(Operation::Originate).expect("nothing forbids it");
    let report = dead.settle();
    assert_eq!((report.alarm, report.position), (Some(Alarm::SwitchNeverClosed(Steps(69_000))), None));

    let mut stuck = rig(|_| {});
    stuck.fail(Fault::Switch(Switch::StuckClosed));
    stuck.command(Operation::Originate).expect("nothing forbids it");
    let report = stuck.settle();
    assert_eq!((report.alarm, report.position), (Some(Alarm::SwitchNeverOpened(Steps(2_000))), None));
    stuck.fail(Fault::Switch(Switch::Free));
    assert_eq!(stuck.command(Operation::Originate), Err(Refusal::InAlarm));
    stuck.command(Operation::Clear).expect("standing");
    stuck.command(Operation::Originate).expect("without a restart");
    assert_eq!(stuck.settle().position, Some(Position(0)));
}

#[test]
fn origination_says_how_many_steps_were_lost_since_the_last_one() {
    let mut rig = rig(|_| {}).originated();
    assert_eq!(rig.report().lost, None, "nothing was believed before the first one");
    rig.go(Direction::Forward, 5_000).expect("ready");
    rig.settle();
    rig.fail(Fault::LostSteps(Steps(37)));
    rig.go(Direction::Forward, 1_000).expect("ready");
    assert_eq!(rig.settle().position, Some(Position(6_000)), "open loop does not notice");
    assert_eq!(rig.carriage(), 1_001 + 6_000 - 37);
    let mut rig = rig.originated();
    assert_eq!(rig.report().lost, Some(Deviation(-37)));
    assert_eq!(rig.originated().report().lost, Some(Deviation(0)));
}

#[test]
fn a_motor_follows_the_default_ramp_and_loses_a_bad_one() {
    let mut good = rig(|config| config.axes[0].motor = Some(MotorConfig::bench())).originated();
    for length in [1, 2, 3, 50, 700, 5_184, 20_000] {
        good.go(Direction::Forward, length).expect("ready");
        good.settle();
    }
    assert_eq!(good.report().position, Some(Position(25_940)));
    assert_eq!(good.carriage(), 1_001 + 25_940, "no step was lost");

    let mut bad = rig(|config| config.axes[0].motor = Some(MotorConfig::bench())).originated();
    let speed = supersigma_protocol::SpeedIndex::TOP;
    bad.command(Operation::Slew { direction: Direction::Forward, distance: super::distance(2_000), speed })
        .expect("ready");
    let report = bad.settle();
    assert_eq!(report.position, Some(Position(2_000)), "open loop believes its pulses");
    assert!(bad.carriage() < 2_500, "a start at 15 000 steps/s is not followed: {}", bad.carriage());
}

#[test]
fn closed_loop_makes_lost_steps_good_within_the_movement() {
    let mut rig = rig(closed(64)).originated();
    rig.go(Direction::Forward, 3_000).expect("ready");
    rig.wait(300_000);
    rig.fail(Fault::LostSteps(Steps(16)));
    let report = rig.settle();
    assert_eq!((report.position, report.steps, report.alarm), (Some(Position(3_000)), Steps(3_000), None));
    assert_eq!(rig.carriage(), 1_001 + 3_000);
    assert!(report.sense.is_closed_loop_success(), "{:?}", report.sense);
    assert_eq!(
        rig.record.pulses.iter().filter(|(_, at)| at.0 > 2_990).count(),
        10,
        "up to the target, and not beyond"
    );
}

#[test]
fn closed_loop_alarms_when_the_shaft_is_too_far_off_and_still_knows_where_it_is() {
    let mut rig = rig(closed(8)).originated();
    rig.go(Direction::Forward, 9_000).expect("ready");
    rig.wait(500_000);
    // So many that the rotor does not coast over the gap.
    rig.fail(Fault::LostSteps(Steps(400)));
    let report = rig.settle();
    assert!(matches!(report.alarm, Some(Alarm::FollowingError(Steps(9..)))), "{:?}", report.alarm);
    assert_eq!(report.position, Some(rig.card.as_axis().expect("a motor card").mechanism().position()));
    rig.fail(Fault::LostSteps(Steps(0)));
    rig.command(Operation::Clear).expect("standing");
    rig.go(Direction::Forward, 100).expect("cleared");
    let after = rig.settle();
    assert_eq!((after.steps, after.alarm), (Steps(100), None));
}

#[test]
fn x5_is_off_while_a_measured_shaft_moves() {
    let mut rig = rig(closed(64)).originated();
    assert!(rig.report().sense.has(SensePoint::X5));
    rig.go(Direction::Forward, 3_000).expect("ready");
    rig.wait(400_000);
    let sense = rig.report().sense;
    assert!(!sense.has(SensePoint::X5) && !sense.has(SensePoint::X4), "{sense}");
}

#[test]
fn the_reference_step_is_locked_in_closed_loop() {
    let mut rig = rig(closed(64));
    rig.command(Operation::SeekReference).expect("nothing forbids it");
    let report = rig.settle();
    assert_eq!((report.position, report.alarm), (Some(Position(199)), None));
    assert_eq!(report.sense.to_string(), "00111");
}

#[test]
fn the_origin_is_found_to_the_step_a_thousand_times() {
    let mut rig = rig(|_| {}).originated();
    // A linear congruential generator is random enough to come from everywhere.
    let mut random: u32 = 1;
    for _ in 0..1_000 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let target = (random >> 8) % 60_000 + 1;
        rig.go(Direction::Forward, u16::try_from(target).expect("below 60 001")).expect("within the travel");
        rig.settle();
        rig.record = super::Record::default();
        rig = rig.originated();
        assert_eq!((rig.carriage(), rig.report().lost), (1_001, Some(Deviation(0))));
    }
}

#[test]
fn the_state_of_an_axis_fits_in_a_kilobyte() {
    let table = size_of::<crate::ramp::Table>();
    let axis = size_of::<crate::Axis>();
    assert!(axis - table <= 1_024, "{} bytes besides the ramp's table of {table}", axis - table);
}

/// What may come between.
#[derive(Debug, Clone, Copy)]
enum Interruption {
    Command(Operation),
    Fault(Fault),
}

fn any_interruption() -> impl Strategy<Value = Interruption> {
    prop_oneof![
        Just(Interruption::Command(Operation::Halt)),
        Just(Interruption::Command(Operation::Brake)),
        Just(Interruption::Command(Operation::Status)),
        Just(Interruption::Fault(Fault::Force)),
        Just(Interruption::Fault(Fault::Limit(End::Lower))),
        Just(Interruption::Fault(Fault::Limit(End::Upper))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Reported steps are the pulses that were sent and, with an encoder, what it counted; the travel is left by no more
    /// than the way in which an axis brakes; and it always ends standing.
    #[test]
    fn whatever_comes_between_every_step_is_accounted_for(
        moves in prop::collection::vec((any::<bool>(), 1_u16..=30_000, 0_u8..=232, 0_u64..2_000_000, any_interruption()), 1..6),
        encoder: bool,
    ) {
        let mut rig = if encoder { rig(closed(64)) } else { rig(|_| {}) }.originated();
        for (forward, length, limit, after, interruption) in moves {
            let direction = if forward { Direction::Forward } else { Direction::TowardsOrigin };
            let limit = supersigma_protocol::SpeedIndex::new(limit).expect("in range");
            rig.record = super::Record::default();
            let before = rig.carriage();
            if rig.command(Operation::MoveLimited { direction, distance: super::distance(length), limit }).is_err() {
                continue;
            }
            rig.wait(after);
            match interruption {
                Interruption::Command(operation) => rig.command(operation).expect("always"),
                Interruption::Fault(fault) => rig.fail(fault),
            }
            let report = rig.settle();
            prop_assert_eq!(report.activity, Activity::Standing);
            prop_assert_eq!(report.steps.0 as usize, rig.record.pulses.len());
            prop_assert_eq!(rig.carriage().abs_diff(before), report.steps.0);
            let position = report.position.expect("originated").0;
            prop_assert_eq!(i64::from(position) + 1_001, i64::from(rig.carriage()));
            prop_assert!((-900..=66_900).contains(&position));
            rig.command(Operation::Clear).expect("standing");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn a_rotor_does_not_care_in_which_portions_time_passes(
        length in 1_u16..=4_000, portions in prop::collection::vec(1_u64..60_000, 1..40), lost in 0_u32..40,
    ) {
        let run = |portions: &[u64]| {
            let mut rig = rig(closed(64)).originated();
            rig.record = super::Record::default();
            rig.go(Direction::Forward, length).expect("ready");
            rig.fail(Fault::LostSteps(Steps(lost)));
            for portion in portions {
                rig.wait(*portion);
            }
            rig.settle();
            (rig.record.pulses, rig.record.loads, rig.record.answers)
        };
        prop_assert_eq!(run(&portions), run(&[]));
    }
}

#[test]
fn a_first_search_in_closed_loop_can_be_stopped_at_any_moment() {
    // Nothing is known yet that the shaft could be compared with.
    for stop in [Operation::Halt, Operation::Brake] {
        for ticks in [0, 1, 3_075, 3_076, 500_000] {
            let mut rig = rig(closed(200));
            rig.command(Operation::Originate).expect("nothing forbids it");
            rig.wait(ticks);
            rig.command(stop).expect("always");
            rig.settle();
            let report = rig.report();
            assert_eq!(
                (report.activity, report.position),
                (Activity::Standing, None),
                "{stop:?} after {ticks}"
            );
        }
    }
}

#[test]
fn a_search_that_is_stopped_tells_the_steps_of_all_its_stages() {
    let whole = |operation| {
        let mut rig = rig(|_| {});
        rig.command(operation).expect("nothing forbids it");
        rig.settle();
        rig.card.now()
    };
    for (operation, stop) in
        [(Operation::Originate, Operation::Halt), (Operation::SeekReference, Operation::Brake)]
    {
        let whole = whole(operation);
        let mut most = 0;
        for part in 1..=40 {
            for rig in [&mut rig(|_| {}), &mut rig(closed(200))] {
                rig.command(operation).expect("nothing forbids it");
                rig.wait(whole.0 * part / 40);
                let before = rig.report().steps;
                assert_eq!(before.0 as usize, rig.record.pulses.len(), "{operation:?}, {part}/40 of it");
                rig.command(stop).expect("always");
                let report = rig.settle();
                let told = (report.activity, report.steps.0 as usize);
                assert_eq!(
                    told,
                    (Activity::Standing, rig.record.pulses.len()),
                    "{operation:?}, {part}/40 of it"
                );
                most = most.max(told.1);
            }
        }
        assert!(most > 3_000, "the way to the switch and the stages after it: {most}");
    }
}
