//! Samples: where they lie, what they say, and that they change nothing.

use super::*;

/// 10 ms of machine time.
const PERIOD: u64 = 20_000;

fn sampled() -> Rig {
    let config = config(ShortMoves::Optimal);
    let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
    Rig { card, record: Record::default(), sequence: Sequence(0) }
}

fn is_sample(answer: &Answer) -> bool {
    answer.about == About::Unasked(Occasion::Sampled)
}

fn axis_report(answer: &Answer) -> AxisReport {
    match answer.report {
        Report::Axis(report) => report,
        Report::Digital(_) => unreachable!("a motor card"),
    }
}

#[test]
fn a_moving_axis_is_sampled_on_multiples_of_the_period_and_says_where_it_is() {
    let mut rig = sampled();
    rig.command(Operation::Originate).expect("nothing forbids it");
    rig.settle();
    rig.record = Record::default();
    rig.wait(7_777);
    let start = rig.card.now();
    rig.go(Direction::Forward, 5_184).expect("ready");
    rig.settle();
    let end = rig.card.now();
    rig.wait(1_000_000);

    let samples: Vec<&Answer> = rig.record.answers.iter().filter(|answer| is_sample(answer)).collect();
    let due: Vec<u64> = (start.0 + 1..end.0).filter(|tick| tick % PERIOD == 0).collect();
    assert_eq!(samples.iter().map(|answer| answer.acted_at.0).collect::<Vec<_>>(), due);
    for sample in samples {
        let report = axis_report(sample);
        let made = rig.record.pulses.partition_point(|(tick, _)| *tick <= sample.acted_at);
        assert_eq!(report.steps.0 as usize, made, "at {}", sample.acted_at);
        let (Some(before), Some(after)) = (made.checked_sub(1), rig.record.pulses.get(made)) else {
            continue;
        };
        let period = after.0.since(rig.record.pulses[before].0);
        let pace = report.pace.expect("pulses are to come");
        assert_eq!((pace.period, pace.direction), (period, Direction::Forward), "at {}", sample.acted_at);
    }
}

#[test]
fn a_standing_or_armed_axis_is_not_sampled() {
    let mut rig = sampled();
    rig.command(Operation::Originate).expect("nothing forbids it");
    rig.settle();
    rig.record = Record::default();
    rig.wait(1_000_000);
    rig.command(Operation::Lead { distance: distance(500), limit: None }).expect("standing");
    rig.command(Operation::ArmLine { direction: Direction::Forward, distance: distance(500) })
        .expect("a lead");
    let start = rig.card.now() + Ticks(5 * PERIOD);
    rig.command_at(Operation::Go, Some(start)).expect("armed");
    rig.settle();
    let first = rig.record.answers.iter().find(|answer| is_sample(answer)).expect("it moves");
    assert!(first.acted_at > start && first.acted_at <= start + Ticks(PERIOD), "{}", first.acted_at);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same commands at the same ticks, with samples and without, looked at at other moments: the same pulses and
    /// the same answers.
    #[test]
    fn samples_change_nothing(
        moves in proptest::collection::vec((1..3_000u16, any::<bool>(), 1..2_000_000u64, 0..4u8), 1..6),
        look in 1..50_000u64,
    ) {
        let mut rigs = [sampled(), Rig::new(ShortMoves::Optimal)];
        for (which, rig) in rigs.iter_mut().enumerate() {
            rig.command(Operation::Originate).expect("nothing forbids it");
            rig.wait(8_000_000);
            for &(steps, forward, pause, stop) in &moves {
                let direction = if forward { Direction::Forward } else { Direction::TowardsOrigin };
                let _ = rig.go(direction, steps);
                if which == 0 {
                    for _ in 0..pause / look {
                        rig.wait(look);
                    }
                    rig.wait(pause % look);
                } else {
                    rig.wait(pause);
                }
                let _ = match stop {
                    0 => rig.command(Operation::Halt),
                    1 => rig.command(Operation::Brake),
                    2 => rig.command(Operation::Clear),
                    _ => rig.command(Operation::Status),
                };
            }
            rig.wait(8_000_000);
        }
        let [sampled, plain] = rigs;
        prop_assert_eq!(&sampled.record.pulses, &plain.record.pulses);
        prop_assert_eq!(&sampled.record.loads, &plain.record.loads);
        let told: Vec<&Answer> = sampled.record.answers.iter().filter(|answer| !is_sample(answer)).collect();
        prop_assert_eq!(told, plain.record.answers.iter().collect::<Vec<_>>());
    }
}
