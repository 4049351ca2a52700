//! The whole axis, driven as the worker drives it: commands in at a tick, answers and pulses out.

use proptest::prelude::*;
use supersigma_config::{AxisConfig, Config, ShortMoves};
use supersigma_protocol::{
    About, Activity, Address, Alarm, Answer, AxisReport, Body, Broadcast, Command, CommandBytes, Count,
    Direction, Distance, End, Frame, Occasion, Operation, Position, Refusal, Report, Sender, SensePoint,
    Sequence, SpeedIndex, Steps, Tick, Ticks,
};

use crate::{Card, Sink};

mod faults;
mod leaps;
mod profiles;
mod samples;

/// Keeps everything that an axis brings forth.
#[derive(Default)]
struct Record {
    answers: Vec<Answer>,
    loads: Vec<(Tick, Count)>,
    pulses: Vec<(Tick, Position)>,
}

impl Sink for Record {
    const PULSES: bool = true;
    fn answer(&mut self, answer: Answer) {
        self.answers.push(answer);
    }
    fn load(&mut self, tick: Tick, count: Count) {
        self.loads.push((tick, count));
    }
    fn pulse(&mut self, tick: Tick, position: Position) {
        self.pulses.push((tick, position));
    }
}

/// One card on a bus of its own.
struct Rig {
    card: Card,
    record: Record,
    sequence: Sequence,
}

fn config(method: ShortMoves) -> Config {
    let mut config = Config::default_set();
    config.ramp.short_moves = method;
    let AxisConfig { rail, travel, .. } = &mut config.axes[0];
    (rail.length, rail.lower_zone, rail.reference, rail.upper_zone) =
        (Steps(69_000), Steps(1_000), Steps(1_200), Steps(68_000));
    rail.start = Steps(3_000);
    (travel.min, travel.max) = (Position(0), Position(66_000));
    config
}

impl Rig {
    fn new(method: ShortMoves) -> Self {
        let config = config(method);
        let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
        Self { card: card.without_samples(), record: Record::default(), sequence: Sequence(0) }
    }

    /// Originated, with a clean record.
    fn ready(method: ShortMoves) -> Self {
        let mut rig = Self::new(method);
        rig.command(Operation::Originate).expect("nothing forbids it");
        let report = rig.settle();
        assert_eq!((report.position, report.alarm), (Some(Position(0)), None));
        rig.record = Record::default();
        rig
    }

    fn send(&mut self, bytes: Vec<u8>, at: Option<Tick>) -> Option<Result<(), Refusal>> {
        let bytes = CommandBytes::try_from(bytes).expect("not too many");
        let frame = Frame {
            sender: Sender::Ccu,
            sequence: self.sequence,
            tick: self.card.now(),
            body: Body::Command(Broadcast { bytes, at }),
        };
        self.sequence = self.sequence.next();
        self.card.hear(&frame, &mut self.record);
        self.record.answers.iter().rev().find_map(|answer| match answer.about {
            About::Command(sequence, result) if sequence == frame.sequence => Some(result),
            _ => None,
        })
    }

    fn command_at(&mut self, operation: Operation, at: Option<Tick>) -> Result<(), Refusal> {
        let bytes = Command::new(Address(1), operation).encode();
        self.send(bytes.as_slice().to_vec(), at).expect("card 1 answers")
    }

    fn command(&mut self, operation: Operation) -> Result<(), Refusal> {
        self.command_at(operation, None)
    }

    fn go(&mut self, direction: Direction, steps: u16) -> Result<(), Refusal> {
        self.command(Operation::Move { direction, distance: distance(steps) })
    }

    fn wait(&mut self, ticks: u64) {
        let to = self.card.now() + Ticks(ticks);
        self.card.advance(to, &mut self.record);
    }

    fn report(&mut self) -> AxisReport {
        match self.card.speak(Occasion::Heartbeat).report {
            Report::Axis(report) => report,
            Report::Digital(_) => unreachable!("a motor card"),
        }
    }

    /// Runs until nothing is due any more.
    fn settle(&mut self) -> AxisReport {
        while let Some(next) = self.card.next_event() {
            assert!(next < Tick(1_000_000_000_000), "it ends");
            self.card.advance(next, &mut self.record);
        }
        self.report()
    }

    fn carriage(&self) -> u32 {
        self.card.as_axis().expect("a motor card").mechanism().carriage()
    }

    fn periods(&self, start: Tick) -> Vec<u64> {
        let mut before = start;
        self.record
            .pulses
            .iter()
            .map(|(tick, _)| tick.since(std::mem::replace(&mut before, *tick)).0)
            .collect()
    }
}

fn distance(steps: u16) -> Distance {
    Distance::new(steps).expect("not zero")
}

const LENGTHS: [u16; 16] =
    [1, 2, 3, 4, 29, 30, 199, 200, 201, 2_599, 2_600, 5_183, 5_184, 10_000, 65_534, 65_535];

#[test]
fn every_movement_has_exactly_its_pulses_and_none_too_fast() {
    for method in [ShortMoves::Paper, ShortMoves::Optimal] {
        let mut rig = Rig::ready(method);
        for length in LENGTHS {
            for direction in [Direction::Forward, Direction::TowardsOrigin] {
                let (start, before) = (rig.card.now(), rig.carriage());
                rig.record = Record::default();
                rig.go(direction, length).expect("the rail is long enough");
                let report = rig.settle();
                assert_eq!(rig.record.pulses.len(), usize::from(length));
                assert_eq!(report.steps, Steps(length.into()), "{length} steps, {method:?}");
                assert_eq!(rig.carriage().abs_diff(before), u32::from(length));
                assert!(rig.periods(start).iter().all(|period| *period >= 133), "{length} steps");
                assert!(
                    report.sense.is_open_loop_success() || report.sense.has(SensePoint::X3),
                    "{report:?}"
                );
                assert_eq!((report.activity, report.alarm), (Activity::Standing, None));
            }
            assert_eq!(rig.report().position, Some(Position(0)));
        }
    }
}

#[test]
fn steps_reported_on_the_way_are_the_pulses_so_far() {
    for length in [1, 2, 3, 40, 700] {
        let mut rig = Rig::ready(ShortMoves::Optimal);
        rig.go(Direction::Forward, length).expect("ready");
        while let Some(next) = rig.card.next_event() {
            let middle = rig.card.now().since(next).0;
            rig.wait(middle.max(700));
            let report = rig.report();
            assert_eq!(report.steps.0 as usize, rig.record.pulses.len(), "{length} steps");
            assert_eq!(report.position, Some(Position(report.steps.0.try_into().expect("small"))));
        }
        assert_eq!(rig.record.pulses.len(), usize::from(length));
    }
}

#[test]
fn the_papers_long_movement_is_loaded_by_the_timer() {
    use Activity::{Accelerating, Creeping, Cruising, Decelerating, Standing};

    let mut rig = Rig::ready(ShortMoves::Paper);
    let start = rig.card.now();
    rig.go(Direction::Forward, 10_000).expect("ready");
    rig.settle();
    let loads: Vec<_> = rig.record.loads.iter().map(|(tick, count)| (tick.since(start).0, count.0)).collect();
    assert_eq!(loads[..4], [(0, 3_077), (25, 2_914), (2_580, 2_764), (5_160, 2_626)]);
    assert_eq!(loads[232], (231 * 2_580, 133));
    assert_eq!(loads.len(), 1 + 2 * 232, "the first count, 232 differences up, 232 down");
    assert_eq!(loads.last().map(|load| load.1), Some(3_077));
    let activities: Vec<_> = rig
        .record
        .answers
        .iter()
        .map(|answer| match answer.report {
            Report::Axis(report) => report.activity,
            Report::Digital(_) => unreachable!(),
        })
        .collect();
    // The reference step lies 200 steps from the origin: entering and leaving it are two changes of X3.
    assert_eq!(
        activities,
        [Accelerating, Accelerating, Accelerating, Cruising, Decelerating, Creeping, Standing]
    );
}

#[test]
fn a_limited_movement_stays_under_its_ceiling_and_a_slew_has_one_speed() {
    let mut rig = Rig::ready(ShortMoves::Optimal);
    let limit = SpeedIndex::new(100).expect("in range");
    let fastest = u64::from(rig.card.as_axis().expect("a motor card").table().period(limit));
    let start = rig.card.now();
    rig.command(Operation::MoveLimited { direction: Direction::Forward, distance: distance(9_000), limit })
        .expect("ready");
    rig.settle();
    assert_eq!(rig.periods(start).into_iter().min(), Some(fastest));

    let (start, speed) = (rig.card.now(), SpeedIndex::new(20).expect("in range"));
    rig.record = Record::default();
    rig.command(Operation::Slew { direction: Direction::TowardsOrigin, distance: distance(500), speed })
        .expect("ready");
    rig.settle();
    let period = u64::from(rig.card.as_axis().expect("a motor card").table().period(speed));
    assert_eq!(rig.periods(start), vec![period; 500]);
    assert_eq!(rig.record.loads.len(), 1);
}

#[test]
fn refusals_name_the_reason_and_change_nothing() {
    let mut rig = Rig::new(ShortMoves::Optimal);
    assert_eq!(rig.go(Direction::Forward, 10), Err(Refusal::NotOriginated));
    assert_eq!(rig.send(vec![1], None), Some(Err(Refusal::TooShort { bytes: 1 })));
    assert_eq!(rig.send(vec![1, 0x40], None), Some(Err(Refusal::UnknownOpCode { op_code: 0x40 })));
    assert_eq!(rig.send(vec![1, 1, 0], None), Some(Err(Refusal::WrongLength { op_code: 1, bytes: 3 })));
    assert_eq!(rig.send(vec![1, 1, 0, 0], None), Some(Err(Refusal::ZeroSteps)));
    assert_eq!(rig.send(vec![1, 2, 0, 9, 233], None), Some(Err(Refusal::SpeedOutOfRange { speed: 233 })));
    assert_eq!(rig.send(vec![1, 0x0D], None), Some(Err(Refusal::WrongCard { address: 1, op_code: 0x0D })));
    assert_eq!(rig.send(vec![2, 1, 0, 9], None), None, "not for this card");
    assert_eq!(rig.send(vec![42, 1, 0, 9], None), None, "for no card");
    assert_eq!(rig.settle().position, None);

    let mut rig = Rig::ready(ShortMoves::Optimal);
    assert_eq!(
        rig.command(Operation::ArmLine { direction: Direction::Forward, distance: distance(3) }),
        Err(Refusal::NoLead)
    );
    assert_eq!(rig.command(Operation::Go), Err(Refusal::NotArmed));
    let (min, max) = (Position(0), Position(66_000));
    assert_eq!(
        rig.go(Direction::TowardsOrigin, 1),
        Err(Refusal::OutOfTravel { target: Position(-1), min, max })
    );
    rig.go(Direction::Forward, 5_000).expect("ready");
    rig.wait(400_000);
    assert_eq!(rig.go(Direction::Forward, 1), Err(Refusal::Moving));
    assert_eq!(rig.command(Operation::Clear), Err(Refusal::Moving));
    assert_eq!(rig.command(Operation::Originate), Err(Refusal::Moving));
    assert_eq!(rig.settle().position, Some(Position(5_000)), "the refused ones changed nothing");
    rig.command(Operation::Brake).expect("always");
    assert_eq!(rig.go(Direction::Forward, 1), Err(Refusal::InAlarm));
    rig.command(Operation::Clear).expect("standing");
    rig.go(Direction::Forward, 1).expect("cleared");
    assert_eq!(rig.settle().position, Some(Position(5_001)));
}

#[test]
fn origination_finds_the_same_point_from_everywhere() {
    for start in [0, 1, 999, 1_000, 1_001, 1_002, 5_000, 68_500, 69_000] {
        let mut config = config(ShortMoves::Optimal);
        config.axes[0].rail.start = Steps(start);
        let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
        let mut rig = Rig { card, record: Record::default(), sequence: Sequence(0) };
        rig.command(Operation::Originate).expect("nothing forbids it");
        let report = rig.settle();
        assert_eq!(report.position, Some(Position(0)), "from {start}");
        assert_eq!(rig.carriage(), 1_001, "from {start}");
        assert_eq!(report.steps.0 as usize, rig.record.pulses.len(), "from {start}");
        assert!(report.sense.is_open_loop_success(), "from {start}");
    }
}

#[test]
fn the_reference_step_is_found_and_named() {
    let mut rig = Rig::new(ShortMoves::Optimal);
    rig.command(Operation::SeekReference).expect("nothing forbids it");
    let report = rig.settle();
    assert_eq!((report.position, rig.carriage()), (Some(Position(199)), 1_200));
    assert!(report.sense.has(SensePoint::X3) && report.sense.has(SensePoint::X4));
}

#[test]
fn a_stopped_origination_is_over_and_can_be_started_again() {
    let mut rig = Rig::new(ShortMoves::Optimal);
    rig.command(Operation::Originate).expect("nothing forbids it");
    rig.wait(300_000);
    assert_eq!(rig.report().activity, Activity::Originating);
    rig.command(Operation::Halt).expect("always");
    let report = rig.settle();
    assert_eq!((report.position, report.activity), (None, Activity::Standing));
    assert_eq!(rig.go(Direction::Forward, 10), Err(Refusal::NotOriginated));
    rig.command(Operation::Originate).expect("it may be started again");
    assert_eq!(rig.settle().position, Some(Position(0)));
}

#[test]
fn entering_an_end_zone_brakes_keeps_the_position_and_lets_the_axis_out_again() {
    let mut config = config(ShortMoves::Optimal);
    // A travel that reaches into the zone is refused by the loader; here it makes the emergency happen.
    config.axes[0].travel.max = Position(70_000);
    let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
    let mut rig = Rig { card, record: Record::default(), sequence: Sequence(0) };
    rig.command(Operation::Originate).expect("nothing forbids it");
    rig.settle();
    rig.go(Direction::Forward, 60_000).expect("ready");
    rig.settle();
    rig.go(Direction::Forward, 8_000).expect("ready");
    let report = rig.settle();
    assert_eq!(report.alarm, Some(Alarm::EndOfRail(End::Upper)));
    let carriage = rig.carriage();
    assert!((68_001..69_000).contains(&carriage), "braked within the zone: {carriage}");
    assert_eq!(report.position, Some(Position(i32::try_from(carriage).expect("small") - 1_001)));
    assert_eq!(rig.go(Direction::TowardsOrigin, 10), Err(Refusal::InAlarm));
    rig.command(Operation::Clear).expect("standing");
    assert_eq!(rig.go(Direction::Forward, 10), Err(Refusal::AtEnd { end: End::Upper }));
    rig.go(Direction::TowardsOrigin, 1_500).expect("away from the end");
    assert_eq!(rig.settle().alarm, None);
}

#[test]
fn a_missed_command_frame_brakes() {
    let mut rig = Rig::ready(ShortMoves::Optimal);
    rig.go(Direction::Forward, 9_000).expect("ready");
    rig.wait(500_000);
    rig.sequence = Sequence(rig.sequence.0 + 3);
    rig.command(Operation::Status).expect("always");
    let report = rig.settle();
    assert_eq!(report.alarm, Some(Alarm::FramesLost(3)));
    assert_eq!(report.position, Some(Position(report.steps.0.try_into().expect("small"))));
    assert!(report.steps < Steps(9_000));
    let about = |index: usize| rig.record.answers[index].about;
    let missed =
        (0..rig.record.answers.len()).find(|index| about(*index) == About::Unasked(Occasion::Missed(3)));
    let missed = missed.expect("it says so");
    assert_eq!(about(missed + 1), About::Unasked(Occasion::Changed), "what follows comes after it");
}

#[test]
fn without_a_ccu_it_says_so_and_brakes() {
    let mut rig = Rig::ready(ShortMoves::Optimal);
    rig.go(Direction::Forward, 9_000).expect("ready");
    rig.wait(500_000);
    rig.card.orphan(&mut rig.record);
    let report = rig.settle();
    assert_eq!(report.alarm, Some(Alarm::CcuLost));
    let occasions: Vec<About> = rig.record.answers.iter().map(|answer| answer.about).collect();
    let orphaned = occasions.iter().position(|about| *about == About::Unasked(Occasion::Orphaned));
    let orphaned = orphaned.expect("it says so");
    assert_eq!(occasions[orphaned + 1], About::Unasked(Occasion::Changed), "what follows comes after it");
}

/// Arms and starts a line on two cards; returns both when they stand.
fn line(lead: u16, own: u16, stop: Option<(u64, Operation)>) -> [Rig; 2] {
    let mut rigs = [lead, own].map(|_| Rig::ready(ShortMoves::Optimal));
    let now = rigs.iter().map(|rig| rig.card.now()).max().expect("two");
    let start = now + Ticks(80_000);
    for (rig, steps) in rigs.iter_mut().zip([lead, own]) {
        rig.card.advance(now, &mut rig.record);
        rig.command(Operation::Lead { distance: distance(lead), limit: None }).expect("ready");
        rig.command(Operation::ArmLine { direction: Direction::Forward, distance: distance(steps) })
            .expect("ready");
        rig.command_at(Operation::Go, Some(start)).expect("armed");
        assert_eq!(rig.report().activity, Activity::Armed);
        if let Some((after, operation)) = stop {
            rig.command_at(operation, Some(start + Ticks(after))).expect("always");
        }
        rig.settle();
    }
    rigs
}

/// At each pulse of the follower it is within one step of the line through the leader's position.
fn check_line([leader, follower]: &[Rig; 2], lead: u16, own: u16) {
    let lead_ticks: Vec<Tick> = leader.record.pulses.iter().map(|pulse| pulse.0).collect();
    for (made, (tick, _)) in (1_u64..).zip(&follower.record.pulses) {
        let leading = lead_ticks.partition_point(|leads| leads <= tick) as u64;
        let apart = (leading * u64::from(own)).abs_diff(made * u64::from(lead));
        assert!(apart <= u64::from(lead), "pulse {made}");
    }
}

#[test]
fn lines_of_any_ratio_start_and_end_together() {
    for (lead, own) in
        [(7_919, 13), (5_000, 4_999), (3, 1), (65_535, 1), (65_535, 2), (20_000, 20_000), (9_000, 57)]
    {
        let rigs = line(lead, own, None);
        check_line(&rigs, lead, own);
        let [leader, follower] = &rigs;
        assert_eq!((leader.record.pulses.len(), follower.record.pulses.len()), (lead.into(), own.into()));
        let last = |rig: &Rig| rig.record.pulses.last().expect("it moved").0;
        assert_eq!(last(leader), last(follower), "{lead}:{own}");
    }
}

/// Arms a path on two cards, starts it, and returns both when they stand. A leg says what the axes make of it, and the
/// ceiling at the joint after it.
fn path(legs: &[(i32, i32, u8)], stop: Option<(u64, Operation)>) -> [Rig; 2] {
    let mut rigs = [(), ()].map(|()| Rig::ready(ShortMoves::Optimal));
    for rig in &mut rigs {
        rig.go(Direction::Forward, 30_000).expect("ready");
        rig.settle();
        rig.record = Record::default();
    }
    let now = rigs.iter().map(|rig| rig.card.now()).max().expect("two");
    let start = now + Ticks(80_000);
    for (which, rig) in rigs.iter_mut().enumerate() {
        rig.card.advance(now, &mut rig.record);
        for (one, other, joint) in legs {
            let lead = one.unsigned_abs().max(other.unsigned_abs());
            let lead = distance(lead.try_into().expect("small"));
            rig.command(Operation::Lead { distance: lead, limit: None }).expect("room");
            let own = if which == 0 { *one } else { *other };
            let direction = if own < 0 { Direction::TowardsOrigin } else { Direction::Forward };
            let part = Distance::new(own.unsigned_abs().try_into().expect("small"))
                .map_or(Operation::Rest, |distance| Operation::ArmLine { direction, distance });
            rig.command(part).expect("room");
            rig.command(Operation::Join { limit: SpeedIndex::new(*joint).expect("in range") })
                .expect("armed");
        }
        rig.command_at(Operation::Go, Some(start)).expect("armed");
        if let Some((after, operation)) = stop {
            rig.command_at(operation, Some(start + Ticks(after))).expect("always");
        }
        rig.settle();
    }
    rigs
}

#[test]
fn a_path_runs_on_over_its_joints_and_turns_where_it_must() {
    let legs = [(3_000, 1_000, 232), (3_000, 1_000, 100), (500, 0, 0), (-2_000, 700, 0), (-1, -3, 0)];
    let [mut one, mut other] = path(&legs, None);
    assert_eq!(one.report().position, Some(Position(30_000 + 4_499)));
    assert_eq!(other.report().position, Some(Position(30_000 + 2_697)));
    assert_eq!((one.record.pulses.len(), other.record.pulses.len()), (8_501, 2_703));
    let last = one.record.pulses[..8_500].last().expect("it moved").1;
    assert_eq!(last, Position(34_500), "the direction changes just at the joint");
    // Two equal legs are one: the first joint is passed at the speed that the curve has reached there.
    let begin = one.record.pulses[2_999].0;
    let end = one.record.pulses[3_000].0;
    assert!(end.since(begin).0 < 200, "{:?}", end.since(begin));
    for rig in [&one, &other] {
        let ticks: Vec<u64> = rig.record.pulses.iter().map(|pulse| pulse.0.0).collect();
        assert!(ticks.windows(2).all(|pair| pair[1] - pair[0] >= 133));
    }
}

#[test]
fn a_path_is_bounded_and_refused_leg_by_leg() {
    let mut rig = Rig::ready(ShortMoves::Optimal);
    let lead = Operation::Lead { distance: distance(100), limit: None };
    let forward = Operation::ArmLine { direction: Direction::Forward, distance: distance(100) };
    let back = Operation::ArmLine { direction: Direction::TowardsOrigin, distance: distance(100) };
    rig.command(lead).expect("ready");
    rig.command(forward).expect("ready");
    rig.command(lead).expect("room");
    rig.command(back).expect("back to the origin");
    rig.command(lead).expect("room");
    let (min, max) = (Position(0), Position(66_000));
    assert_eq!(rig.command(back), Err(Refusal::OutOfTravel { target: Position(-100), min, max }));
    for _ in 2..32 {
        rig.command(lead).expect("room");
        rig.command(Operation::Rest).expect("room");
    }
    assert_eq!(rig.command(lead), Err(Refusal::PathFull));
    rig.command(Operation::Halt).expect("always");
    assert_eq!(rig.command(Operation::Join { limit: SpeedIndex::TOP }), Err(Refusal::NotArmed));

    let long = Operation::Lead { distance: distance(40_000), limit: None };
    rig.command(long).expect("ready");
    rig.command(Operation::ArmLine { direction: Direction::Forward, distance: distance(40_000) })
        .expect("ready");
    rig.command(long).expect("room");
    let back = Operation::ArmLine { direction: Direction::TowardsOrigin, distance: distance(40_000) };
    assert_eq!(rig.command(back), Err(Refusal::PathTooLong { steps: 80_000 }));
}

#[test]
fn a_line_that_is_late_moves_nobody() {
    let mut rig = Rig::ready(ShortMoves::Optimal);
    rig.command(Operation::Lead { distance: distance(500), limit: None }).expect("ready");
    rig.command(Operation::ArmLine { direction: Direction::Forward, distance: distance(100) })
        .expect("ready");
    let late = rig.card.now() - Ticks(7);
    assert_eq!(rig.command_at(Operation::Go, Some(late)), Err(Refusal::Late { by: Ticks(7) }));
    assert_eq!(rig.command_at(Operation::Go, None), Err(Refusal::NoStartTick));
    assert_eq!(rig.report().activity, Activity::Armed);
    rig.command(Operation::Halt).expect("always");
    assert_eq!(rig.settle().activity, Activity::Standing);
    assert!(rig.record.pulses.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn an_interrupted_movement_reports_just_the_pulses_that_it_made(
        length in 1_u16..=30_000, paper: bool, after in 0_u64..3_000_000, brake: bool, again in 0_u64..200_000,
    ) {
        let mut rig = Rig::ready(if paper { ShortMoves::Paper } else { ShortMoves::Optimal });
        let start = rig.card.now();
        rig.go(Direction::Forward, length).expect("ready");
        rig.wait(after);
        rig.command(if brake { Operation::Brake } else { Operation::Halt }).expect("always");
        rig.wait(again);
        rig.command(Operation::Brake).expect("always");
        let report = rig.settle();
        prop_assert_eq!(report.steps.0 as usize, rig.record.pulses.len());
        prop_assert_eq!(report.position, Some(Position(report.steps.0.try_into().expect("small"))));
        prop_assert!(report.steps.0 <= length.into());
        prop_assert_eq!(report.alarm, Some(Alarm::Braked));
        let periods = rig.periods(start);
        prop_assert!(periods.iter().all(|period| *period >= 133));
        if let Some(last) = periods.last() {
            prop_assert!(*last >= 2_000, "the last period is slow enough to stop from: {}", last);
        }
    }

    #[test]
    fn interrupted_lines_stay_on_the_line(
        lead in 2_u16..=20_000, own in 1_u16..=20_000, after in 0_u64..1_500_000, brake: bool,
    ) {
        let (lead, own) = (lead.max(own), own.min(lead));
        let operation = if brake { Operation::Brake } else { Operation::Halt };
        let mut rigs = line(lead, own, Some((after, operation)));
        check_line(&rigs, lead, own);
        for rig in &mut rigs {
            let pulses = rig.record.pulses.len();
            prop_assert_eq!(rig.report().steps.0 as usize, pulses);
        }
        let leading = rigs[0].record.pulses.len() as u64;
        let ideal = leading * u64::from(own) / u64::from(lead);
        prop_assert_eq!(rigs[1].record.pulses.len() as u64, ideal);
    }

    #[test]
    fn interrupted_paths_stop_on_the_path(
        legs in prop::collection::vec((-3_000_i32..=3_000, -3_000_i32..=3_000, 0_u8..=232), 1..=16),
        after in 0_u64..4_000_000, brake: bool,
    ) {
        // Where an axis turns, the path must stop.
        let legs: Vec<_> = legs.iter().filter(|leg| (leg.0, leg.1) != (0, 0)).copied().collect();
        let mut joined = legs.clone();
        for (i, leg) in joined.iter_mut().enumerate() {
            let turns = legs.get(i + 1).is_some_and(|next| leg.0.signum() != next.0.signum() || leg.1.signum() != next.1.signum());
            if turns { leg.2 = 0; }
        }
        prop_assume!(!joined.is_empty());
        let operation = if brake { Operation::Brake } else { Operation::Halt };
        let [one, other] = &mut path(&joined, Some((after, operation)));
        // The way of the leading axis at which they stand is the same for both: look for it leg by leg.
        let (mut at, mut found) = ((30_000, 30_000), false);
        let stands = [&mut *one, &mut *other].map(|rig| rig.report().position.expect("known").0);
        for (a, b, _) in &joined {
            let lead = i64::from(a.unsigned_abs().max(b.unsigned_abs()));
            found |= (0..=lead).any(|x| {
                let part = |own: i32| i32::try_from(i64::from(own.abs()) * x / lead).expect("small") * own.signum();
                [at.0 + part(*a), at.1 + part(*b)] == stands
            });
            at = (at.0 + a, at.1 + b);
        }
        prop_assert!(found, "{:?} is not on the path", stands);
        for rig in [one, other] {
            let pulses = rig.record.pulses.len();
            prop_assert_eq!(rig.report().steps.0 as usize, pulses);
            let periods: Vec<u64> = rig.record.pulses.windows(2).map(|pair| pair[1].0.since(pair[0].0).0).collect();
            prop_assert!(periods.iter().all(|period| *period >= 133));
        }
    }

    #[test]
    fn it_does_not_matter_in_which_portions_time_passes(
        length in 1_u16..=8_000, portions in prop::collection::vec(1_u64..100_000, 1..60),
    ) {
        let mut whole = Rig::ready(ShortMoves::Optimal);
        let mut sliced = Rig::ready(ShortMoves::Optimal);
        whole.go(Direction::Forward, length).expect("ready");
        sliced.go(Direction::Forward, length).expect("ready");
        for portion in portions {
            sliced.wait(portion);
        }
        whole.settle();
        sliced.settle();
        prop_assert_eq!(&whole.record.pulses, &sliced.record.pulses);
        prop_assert_eq!(&whole.record.loads, &sliced.record.loads);
        prop_assert_eq!(&whole.record.answers, &sliced.record.answers);
    }
}
