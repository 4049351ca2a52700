//! Goldens with the source's numbers, and every plan, along every profile, against what a plan must be.

use proptest::prelude::*;
use supersigma_config::{CountTable, Differences, Linear, RampConfig, ShortMoves};
use supersigma_protocol::{Direction, Distance, SpeedIndex};

use super::any::any_ramp;
use super::*;

fn table(method: ShortMoves) -> Table {
    Table::new(&RampConfig { short_moves: method, ..RampConfig::default() })
        .expect("the default ramp is good")
}

fn any_method() -> impl Strategy<Value = ShortMoves> {
    prop_oneof![Just(ShortMoves::Optimal), Just(ShortMoves::Paper)]
}

/// A ramp of any profile, planned by one of the methods.
fn any_table(method: impl Strategy<Value = ShortMoves>) -> impl Strategy<Value = Table> {
    (any_ramp(), method).prop_map(|(ramp, short_moves)| {
        Table::new(&RampConfig { short_moves, ..ramp }).expect("such a ramp is good")
    })
}

/// The longest period from which a movement may end: that of the first speed, but for the entry that comes within the first
/// period.
fn slow_enough(table: &Table) -> u32 {
    table.period(SpeedIndex::new(1).expect("an entry"))
}

fn steps(steps: u16) -> Distance {
    Distance::new(steps).expect("not zero")
}

fn seconds(plan: &Plan) -> f64 {
    Ticks(plan.duration()).as_seconds()
}

#[test]
fn the_table_is_the_papers() {
    let table = table(ShortMoves::Paper);
    assert_eq!(table.differences().len(), 232);
    assert_eq!(table.differences()[..3], [163, 150, 138]);
    assert_eq!(table.differences().iter().map(|d| u32::from(*d)).sum::<u32>(), 2_944);
    assert_eq!((table.counts()[0], table.counts()[232]), (3_076, 132));
    assert_eq!((table.period(SpeedIndex::START), table.period(SpeedIndex::TOP)), (3_077, 133));
}

#[test]
fn a_linear_walk_by_hand() {
    let linear = Linear { f_start: 200.0, f_max: 2_520.0, t_a: 0.58 };
    let ramp = RampConfig { differences: Differences::Wide, ..linear.into() };
    let table = Table::new(&ramp).expect("usable");
    assert_eq!(table.differences()[..3], [476, 433, 395]);
    assert_eq!(table.interval(), Ticks(5_000));
    // The first period, 10 000 ticks, ends when entry 3 is due (2 · 5 000), at 230 steps/s, 8 696 ticks; that ends at
    // 18 696, where entry 4, due at 15 000, rules: 240 steps/s, 8 333 ticks; that at 27 029, after entry 6 was due at
    // 25 000: 260 steps/s, 7 692 ticks.
    let plan = Plan::ramped(&table, Distance::MAX, SpeedIndex::TOP);
    assert_eq!([1, 2, 3, 4].map(|pulse| plan.period(pulse)), [10_000, 8_696, 8_333, 7_692]);
    // Before entry 232, due after 231 intervals, 0.577 5 s: 200 · 0.577 5 + 4 000 / 2 · 0.577 5² = 782.5 steps along the
    // line; it is read half an interval early on average, which is 2 320 · 0.001 25 = 2.9 steps more.
    assert_eq!(table.normal().pulses().0, 785);
}

/// \[M\] eq. (1) to (6), as a program: the times of the pulses while the motor accelerates, in seconds.
fn train_of_the_papers_program(Linear { f_start, f_max, t_a }: Linear) -> Vec<f64> {
    let m = (f_max - f_start) / t_a;
    let mut times = vec![];
    let mut t = 0.0;
    while t <= t_a {
        t += 1.0 / (m * t + f_start);
        times.push(t);
    }
    times
}

#[test]
fn a_linear_ramp_is_that_of_the_papers_program() {
    for (f_start, f_max, t_a) in [(200.0, 2_520.0, 0.58), (200.0, 6_000.0, 0.4), (600.0, 15_000.0, 1.0)] {
        let linear = Linear { f_start, f_max, t_a };
        let table =
            Table::new(&RampConfig { differences: Differences::Wide, ..linear.into() }).expect("usable");
        let plan = Plan::ramped(&table, Distance::MAX, SpeedIndex::TOP);
        // The card is ahead of the line by up to an interval of its table, and behind it by whole numbers N only.
        let interval = table.interval().as_seconds();
        let train = train_of_the_papers_program(linear);
        for (pulse, theirs) in (1_u32..).zip(&train) {
            let early = theirs - Ticks(plan.tick_of(pulse)).as_seconds();
            assert!((-0.25 * interval..=interval).contains(&early), "pulse {pulse}: {early} s of {interval}");
        }
        // So by t_a it has made up to an interval's steps more.
        let theirs = u32::try_from(train.len()).expect("some thousand");
        let ours = plan.pulses_by(232 * table.interval().0);
        assert!((0.0..=f_max * interval).contains(&f64::from(ours - theirs)), "{ours}, {theirs}");
    }
}

#[test]
fn the_ramp_of_a_short_table_ends_where_the_table_does() {
    for short_moves in [ShortMoves::Optimal, ShortMoves::Paper] {
        let counts = CountTable { counts: vec![3_000, 2_800, 2_600, 2_400], interval_ticks: 10_000 };
        let table = Table::new(&RampConfig { short_moves, ..counts.into() }).expect("usable");
        assert_eq!(table.last().get(), 3);
        assert_eq!(table.period(SpeedIndex::TOP), 2_401);
        let plan = Plan::ramped(&table, steps(1_000), SpeedIndex::TOP);
        let runs: Vec<_> = plan.runs().map(|run| run.period).collect();
        // Entry 1 is overtaken.
        assert!(runs.starts_with(&[3_001]) && runs.contains(&2_601) && runs.contains(&2_401), "{runs:?}");
        // Twice 3 intervals of 10 000 ticks, and the rest at 2 401: nothing waits for entries that are not there.
        assert!((2_380_000..2_425_000).contains(&plan.duration()), "{short_moves:?}: {}", plan.duration());
    }
}

#[test]
fn the_full_ramp_has_about_2600_steps_in_three_tenths_of_a_second() {
    let table = table(ShortMoves::Paper);
    let ramp = u64::from(SpeedIndex::TOP.get()) * table.interval().0;
    assert_eq!(ramp, 598_560);
    for plan in [
        Plan::ramped(&table, Distance::MAX, SpeedIndex::TOP),
        Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP),
    ] {
        let pulses = plan.pulses_by(ramp);
        assert!((2_585..=2_589).contains(&pulses), "{pulses}");
    }
}

#[test]
fn the_papers_times_for_short_movements() {
    let table = table(ShortMoves::Paper);
    for (length, expected) in [(199, 0.306), (200, 0.643), (1_000, 0.618)] {
        let plan = Plan::ramped(&table, steps(length), SpeedIndex::TOP);
        let seconds = seconds(&plan);
        assert!(
            (seconds - expected).abs() < 0.004,
            "{length} steps: {seconds} s, the paper's method needs {expected}"
        );
    }
}

#[test]
fn a_movement_is_long_from_two_ramps_and_the_offset_on() {
    let table = table(ShortMoves::Paper);
    let slowest = |length| Plan::ramped(&table, steps(length), SpeedIndex::TOP).period(1);
    assert!(slowest(5_183) > 3_077);
    assert_eq!(slowest(5_184), 3_077);
    assert_eq!(slowest(65_535), 3_077);
}

#[test]
fn the_optimal_method_solves_the_papers_open_problem() {
    let table = table(ShortMoves::Optimal);
    for (length, bound) in [(200, 0.115), (1_000, 0.264)] {
        let seconds = seconds(&Plan::ramped(&table, steps(length), SpeedIndex::TOP));
        assert!(seconds < bound * 1.03, "{length} steps in {seconds} s");
    }
}

/// What every plan must be, whatever made it.
fn check(table: &Table, plan: &Plan, total: u32, longest_period: u32) {
    assert_eq!(plan.total().0, total);
    let (mut before, mut end, mut written, mut period) = (0, 0, 0, 0);
    for (index, run) in plan.runs().enumerate() {
        assert_eq!(plan.run(index), Some(run), "a run is the same by its index");
        assert_eq!((run.before, run.start), (before, end), "runs follow each other: {run:?}");
        assert!((table.period(SpeedIndex::TOP)..=longest_period).contains(&run.period), "{run:?}");
        if let Some(tick) = run.written {
            assert!(tick >= written, "counts are written in order: {run:?}");
            assert!(run.pulses == 0 || tick <= run.start, "a count is written before it rules: {run:?}");
            written = tick;
        } else {
            assert_eq!(run.period, period, "the chip has the count: {run:?}");
        }
        period = run.period;
        before += run.pulses;
        end += u64::from(run.pulses) * u64::from(run.period);
        // Whoever asks for a pulse or a tick is told what the runs say.
        assert_eq!(plan.tick_of(before), end, "{run:?}");
        assert_eq!(
            (plan.pulses_by(end), plan.pulses_by(end.saturating_sub(1))),
            (before, before.saturating_sub(1))
        );
        if run.pulses > 0 {
            assert_eq!((plan.run_of(run.before + 1), plan.run_of(before)), (index, index), "{run:?}");
            assert_eq!((plan.period(run.before + 1), plan.period(before)), (period, period), "{run:?}");
        }
    }
    assert_eq!((plan.duration(), plan.longest_period() <= longest_period), (end, true));
}

/// A count rules from the first period that begins at or after its write, unless a later count has been written by
/// then. The chip's rule, applied plainly to the writes, must give the plan's own pulses.
fn pulses_from_writes(plan: &Plan) -> Vec<u64> {
    let runs: Vec<_> = plan.runs().collect();
    let mut pulses = vec![];
    let mut now = 0;
    for _ in 0..plan.total().0 {
        let ruling = runs
            .iter()
            .rfind(|run| run.written.is_some_and(|written| written <= now))
            .expect("the first count is written at 0");
        now += u64::from(ruling.period);
        pulses.push(now);
    }
    pulses
}

fn pulses_from_plan(plan: &Plan) -> Vec<u64> {
    (1..=plan.total().0).map(|pulse| plan.tick_of(pulse)).collect()
}

#[test]
fn every_length_can_be_planned_by_both_methods() {
    for method in [ShortMoves::Paper, ShortMoves::Optimal] {
        let table = table(method);
        for length in (1..=6_000).chain([10_000, 65_534, 65_535]) {
            check(&table, &Plan::ramped(&table, steps(length), SpeedIndex::TOP), length.into(), 65_536);
        }
    }
}

#[test]
fn optimal_plans_never_change_speed_by_more_than_the_full_ramp_does() {
    let table = table(ShortMoves::Optimal);
    let largest = |plan: &Plan| {
        let speeds: Vec<f64> = plan.runs().map(|run| 2e6 / f64::from(run.period)).collect();
        speeds.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
    };
    let full = largest(&Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP));
    for length in 1..=5_300 {
        assert!(largest(&Plan::fastest(&table, steps(length), SpeedIndex::TOP)) <= full, "{length} steps");
    }
}

proptest! {
    #[test]
    fn plans_are_what_the_chip_makes_of_their_writes(
        table in any_table(any_method()), length in 1_u16..=9_000, limit in 0_u8..=232,
    ) {
        let limit = SpeedIndex::new(limit).expect("in range");
        let plan = Plan::ramped(&table, steps(length), limit);
        check(&table, &plan, length.into(), 65_536);
        prop_assert!(plan.runs().all(|run| run.pulses == 0 || run.period >= table.period(limit)));
        prop_assert_eq!(pulses_from_writes(&plan), pulses_from_plan(&plan));
    }

    #[test]
    fn a_stop_leaves_the_past_and_the_running_period_alone(
        table in any_table(any_method()), length in 1_u16..=9_000, limit in 0_u8..=232, part in 0.0..1.0_f64,
        steep: bool, again in 0_u64..400_000,
    ) {
        let plan = Plan::ramped(&table, steps(length), SpeedIndex::new(limit).expect("in range"));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "any tick will do")]
        let tick = (plan.duration() as f64 * part) as u64;
        let mut stopped = plan.clone();
        stopped.stop(&table, tick, if steep { Stop::Brake } else { Stop::Halt });
        check(&table, &stopped, stopped.total().0, 65_536);
        prop_assert!(stopped.total() <= plan.total());
        let running = plan.pulses_by(tick) + 1;
        for pulse in 1..=running.min(plan.total().0) {
            prop_assert_eq!(stopped.tick_of(pulse), plan.tick_of(pulse));
        }
        for pulse in running + 1..=stopped.total().0 {
            prop_assert!(stopped.period(pulse) >= stopped.period(pulse - 1), "a stop never speeds up");
        }
        if stopped != plan {
            prop_assert!(
                stopped.period(stopped.total().0) >= slow_enough(&table),
                "the last period is slow enough to stop from"
            );
        }
        // The same stop again changes nothing.
        let mut again_now = stopped.clone();
        again_now.stop(&table, tick + again, if steep { Stop::Brake } else { Stop::Halt });
        if stopped != plan {
            prop_assert_eq!(&again_now, &stopped);
        }
        // A brake after a halt shortens what is left, and never the past.
        let mut twice = stopped.clone();
        twice.stop(&table, tick + again, Stop::Brake);
        check(&table, &twice, twice.total().0, 65_536);
        prop_assert!(twice.total() <= stopped.total());
    }

    #[test]
    fn a_path_passes_joints_as_fast_as_they_and_the_curve_allow(
        table in any_table(Just(ShortMoves::Optimal)),
        legs in prop::collection::vec((1_u16..=6_000, 0_u8..=232, 0_u8..=232), 1..=16),
    ) {
        let index = |index| SpeedIndex::new(index).expect("in range");
        let legs: Vec<Leg> = legs
            .into_iter()
            .map(|(length, limit, joint)| Leg { distance: steps(length), limit: index(limit), joint: index(joint) })
            .collect();
        let plan = Plan::path(&table, &legs);
        let total = legs.iter().map(|leg| leg.distance.steps().0).sum();
        check(&table, &plan, total, table.period(SpeedIndex::START));
        prop_assert_eq!(pulses_from_writes(&plan), pulses_from_plan(&plan));
        let (mut before, mut apart) = (0, 0);
        for (leg, next) in legs.iter().zip(legs.iter().skip(1).map(Some).chain([None])) {
            let end = before + leg.distance.steps().0;
            for pulse in before + 1..=end {
                prop_assert!(plan.period(pulse) >= table.period(leg.limit), "under the ceiling");
            }
            if next.is_some() {
                let slower = plan.period(end).max(plan.period(end + 1));
                prop_assert!(slower >= table.period(leg.joint), "joint {} is passed too fast", end);
            }
            apart += Plan::fastest(&table, leg.distance, leg.limit).duration();
            before = end;
        }
        prop_assert!(plan.duration() <= apart, "running on is never slower than stopping");
        prop_assert!(plan.period(total) >= slow_enough(&table), "it ends slowly");
    }

    #[test]
    fn pulses_by_is_the_inverse_of_tick_of(
        table in any_table(any_method()), length in 1_u16..=65_535, pulse in 1_u32..=65_535,
    ) {
        let plan = Plan::ramped(&table, steps(length), SpeedIndex::TOP);
        let pulse = pulse.min(plan.total().0);
        prop_assert_eq!(plan.pulses_by(plan.tick_of(pulse)), pulse);
        prop_assert_eq!(plan.pulses_by(plan.tick_of(pulse) - 1), pulse - 1);
    }

    #[test]
    fn followers_stay_within_a_step_of_the_line(
        table in any_table(Just(ShortMoves::Optimal)), lead in 1_u16..=20_000, own in 1_u16..=20_000,
        part in 0.0..1.5_f64, steep: bool,
    ) {
        let (lead, own) = (lead.max(own), own.min(lead));
        let plan = Plan::fastest(&table, steps(lead), SpeedIndex::TOP);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "any tick will do")]
        let tick = (plan.duration() as f64 * part) as u64;
        let mut leader = plan.clone();
        let share = Share { lead: steps(lead), own: Some((Direction::Forward, steps(own))) };
        let mut follower = Schedule::shared(plan, &[share]);
        let stop = if steep { Stop::Brake } else { Stop::Halt };
        leader.stop(&table, tick, stop);
        follower.stop(&table, tick, stop);
        for pulse in 1..=follower.total().0 {
            let ideal = u64::from(pulse) * u64::from(lead);
            let leading = u64::from(leader.pulses_by(follower.tick_of(pulse)));
            let apart = (leading * u64::from(own)).abs_diff(ideal);
            prop_assert!(apart <= u64::from(lead), "pulse {} of {}", pulse, follower.total());
        }
    }
}
