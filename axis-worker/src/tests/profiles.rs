//! Every profile on the whole machine: what the chip makes of it is what was planned.

use supersigma_config::RampConfig;

use super::*;
use crate::ramp::any::any_ramp;
use crate::ramp::{Plan, Stop, Table};

/// An axis with this ramp, originated at start speed, with a clean record.
fn ready(ramp: &RampConfig) -> Rig {
    let mut config = config(ramp.short_moves);
    config.ramp = ramp.clone();
    config.axes[0].origination.speed = SpeedIndex::START;
    let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
    let mut rig = Rig { card: card.without_samples(), record: Record::default(), sequence: Sequence(0) };
    rig.command(Operation::Originate).expect("nothing forbids it");
    let report = rig.settle();
    assert_eq!((report.position, report.alarm, rig.carriage()), (Some(Position(0)), None, 1_001));
    rig.record = Record::default();
    rig
}

fn pulses(rig: &Rig, start: Tick) -> Vec<u64> {
    rig.record.pulses.iter().map(|(tick, _)| tick.since(start).0).collect()
}

fn planned(plan: &Plan) -> Vec<u64> {
    (1..=plan.total().0).map(|pulse| plan.tick_of(pulse)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn the_machine_makes_what_is_planned_along_every_profile(
        ramp in any_ramp(), paper: bool, length in prop_oneof![1_u16..20, 1_u16..=1_000, 1_u16..=20_000], limit in 0_u8..=232,
    ) {
        let short_moves = if paper { ShortMoves::Paper } else { ShortMoves::Optimal };
        let ramp = RampConfig { short_moves, ..ramp };
        let mut rig = ready(&ramp);
        let start = rig.card.now();
        let limit = SpeedIndex::new(limit).expect("in range");
        rig.command(Operation::MoveLimited { direction: Direction::Forward, distance: distance(length), limit })
            .expect("ready");
        let report = rig.settle();
        prop_assert_eq!(report.position, Some(Position(length.into())));
        let plan = Plan::ramped(&Table::new(&ramp).expect("usable"), distance(length), limit);
        prop_assert_eq!(pulses(&rig, start), planned(&plan));
    }

    #[test]
    fn a_stop_is_made_as_planned_and_the_rest_can_be_made_later(
        ramp in any_ramp(), paper: bool, length in 2_u16..=20_000, part in 0.0..1.0_f64, brake: bool,
    ) {
        let short_moves = if paper { ShortMoves::Paper } else { ShortMoves::Optimal };
        let ramp = RampConfig { short_moves, ..ramp };
        let table = Table::new(&ramp).expect("usable");
        let mut plan = Plan::ramped(&table, distance(length), SpeedIndex::TOP);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "any tick will do")]
        let tick = (plan.duration() as f64 * part) as u64;
        let mut rig = ready(&ramp);
        let start = rig.card.now();
        rig.go(Direction::Forward, length).expect("ready");
        rig.wait(tick);
        let (operation, stop) = if brake { (Operation::Brake, Stop::Brake) } else { (Operation::Halt, Stop::Halt) };
        rig.command(operation).expect("always");
        let report = rig.settle();
        plan.stop(&table, tick, stop);
        prop_assert_eq!(pulses(&rig, start), planned(&plan));
        let made = u16::try_from(report.steps.0).expect("at most the length");
        prop_assert_eq!(report.position, Some(Position(made.into())));
        rig.command(Operation::Clear).expect("standing");
        if made < length {
            rig.go(Direction::Forward, length - made).expect("ready");
            prop_assert_eq!(rig.settle().position, Some(Position(length.into())));
        }
    }
}
