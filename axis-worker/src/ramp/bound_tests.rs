//! Every plan against the curve that it is made from, and every follower's periods against each other.

use proptest::prelude::*;
use supersigma_config::{Profile, RampConfig, ShortMoves};
use supersigma_protocol::{Direction, Distance, SpeedIndex, Tick};

use super::any::any_ramp;
use super::*;

/// From here on a movement has so many periods that their grain is lost in the whole.
const GRAINY: u16 = 30;
/// The worst ratio to the time along the curve; 1.0022 has been measured (30 steps under entry 1).
const WORST_RATIO: f64 = 1.005;
/// The worst excess of a shorter movement in ticks: a tenth of a period at start speed. 192 has been measured (2 steps).
const WORST_EXCESS: f64 = 307.7;
/// A ramp reads the table up to one interval early, half of one on average, and there are two ramps. 2 077 ticks have been
/// measured (5 000 steps under entry 174).
const LARGEST_LEAD: f64 = 2_580.0;

fn table(method: ShortMoves) -> Table {
    Table::new(&RampConfig { short_moves: method, ..RampConfig::default() })
        .expect("the default ramp is good")
}

fn curve() -> Curve {
    Curve::new(&RampConfig::default())
}

fn steps(steps: u16) -> Distance {
    Distance::new(steps).expect("not zero")
}

#[expect(clippy::cast_precision_loss, reason = "no movement of one command has 2^53 ticks")]
fn as_f64(ticks: u64) -> f64 {
    ticks as f64
}

/// Whether the optimal plan is as good as promised.
fn check(table: &Table, curve: &Curve, length: u16, limit: SpeedIndex) {
    let distance = steps(length);
    let along_curve = curve.seconds(table, distance, limit) * as_f64(Tick::PER_SECOND);
    let duration = as_f64(Plan::ramped(table, distance, limit).duration());
    let excess = duration - along_curve;
    let allowed = if length < GRAINY { WORST_EXCESS } else { (WORST_RATIO - 1.0) * along_curve };
    assert!(
        (-LARGEST_LEAD..=allowed).contains(&excess),
        "{length} steps under entry {}: {duration} ticks, {along_curve} along the curve",
        limit.get()
    );
}

#[test]
fn optimal_movements_of_every_length_are_as_short_as_the_curve_allows() {
    let (table, curve) = (table(ShortMoves::Optimal), curve());
    for length in (1..=10_000).chain([20_000, 40_000, 65_535]) {
        check(&table, &curve, length, SpeedIndex::TOP);
    }
}

#[test]
fn so_they_are_under_every_ceiling() {
    let (table, curve) = (table(ShortMoves::Optimal), curve());
    for limit in (0..=SpeedIndex::TOP.get()).filter_map(SpeedIndex::new) {
        for length in [1, 2, 3, 7, 29, 30, 100, 200, 1_000, 2_600, 5_000, 20_000] {
            check(&table, &curve, length, limit);
        }
    }
}

#[test]
fn the_papers_method_is_never_faster_and_up_to_five_times_slower() {
    let (optimal, paper) = (table(ShortMoves::Optimal), table(ShortMoves::Paper));
    let mut worst: f64 = 1.0;
    for length in 1..=10_000 {
        let duration = |table| Plan::ramped(table, steps(length), SpeedIndex::TOP).duration();
        let (optimal, paper) = (duration(&optimal), duration(&paper));
        assert!(optimal <= paper, "{length} steps: {optimal} ticks, the paper's method {paper}");
        worst = worst.max(as_f64(paper) / as_f64(optimal));
    }
    assert!((5.6..5.65).contains(&worst), "{worst}");
}

#[test]
fn the_curve_is_the_papers() {
    let (table, curve) = (table(ShortMoves::Optimal), curve());
    assert!((curve.speed(0.0) - 650.0).abs() < 0.1, "{}", curve.speed(0.0));
    assert!((curve.speed(0.3) - 15_000.0).abs() < 0.1, "{}", curve.speed(0.3));
    // A/2 · (t − (sin(2(ωt + φ)) − sin 2φ) / 2ω) at 232 intervals of 1.29 ms.
    assert!((curve.steps(0.299_28) - 2_578.84).abs() < 0.01, "{}", curve.steps(0.299_28));
    // The table is read half an interval early on average: at 15 steps/ms, 9.7 steps; waiting for periods costs some.
    let plan = Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP);
    assert_eq!(plan.pulses_by(598_560), 2_586);
    // One step from 650 steps/s, still almost that slow.
    let one = curve.seconds(&table, steps(1), SpeedIndex::TOP);
    assert!((one - 1.0 / 660.6).abs() < 1e-5, "{one}");
    // Under the lowest ceiling nothing is accelerated: 100 periods of 3 077 ticks.
    let slow = curve.seconds(&table, steps(100), SpeedIndex::START);
    assert!((slow - 0.153_85).abs() < 1e-9, "{slow}");
}

/// Pairs of neighbouring periods of an axis with `own` steps against the `lead` of the plan: first tick, both lengths.
fn neighbours(plan: &Plan, own: u16, lead: u16) -> impl Iterator<Item = (u64, u64, u64)> {
    let share = Share { lead: steps(lead), own: Some((Direction::Forward, steps(own))) };
    let schedule = Schedule::shared(plan.clone(), &[share]);
    (1..u32::from(own)).map(move |pulse| {
        let tick = |pulse| schedule.tick_of(pulse);
        (tick(pulse - 1), tick(pulse) - tick(pulse - 1), tick(pulse + 1) - tick(pulse))
    })
}

fn ratio(one: u64, other: u64) -> f64 {
    as_f64(one.max(other)) / as_f64(one.min(other))
}

/// How evenly an axis follows.
fn check_follower(table: &Table, plan: &Plan, own: u16, lead: u16) {
    let cruises = |from: u64, to: u64| {
        plan.runs().any(|run| {
            let end = run.start + u64::from(run.pulses) * u64::from(run.period);
            run.phase == Phase::Cruising && run.start <= from && to <= end
        })
    };
    for (tick, one, other) in neighbours(plan, own, lead) {
        if cruises(tick, tick + one + other) {
            assert!(one.abs_diff(other) <= 1, "{own} of {lead} at {tick}: {one} and {other}");
        }
        assert!(
            ratio(one, other) < 1.25 || one.min(other) > table.period(SpeedIndex::START).into(),
            "{own} of {lead} at {tick}: {one} and {other} ticks"
        );
    }
}

/// A follower's pulses are as even as the leader's: never further apart than a tick of rounding while the leader cruises,
/// which at the shortest period is a ratio of 134/133. On ramps, a period of a follower that hardly moves spans
/// many of the leader's, so it may be up to 2.52 times its neighbour (133 steps against 65 535), but only at
/// speeds from which a motor can stop at once.
#[test]
fn followers_are_even() {
    let table = table(ShortMoves::Optimal);
    for lead in [2, 10, 100, 1_000, 5_184, 10_000, 65_535] {
        for limit in [20, 100, 232].into_iter().filter_map(SpeedIndex::new) {
            let plan = Plan::fastest(&table, steps(lead), limit);
            for own in [1, 2, 3, 4, 11, 41, 133, 256, lead / 7, lead / 2 + 1, lead - 1, lead] {
                check_follower(&table, &plan, own.clamp(1, lead), lead);
            }
        }
    }
    let plan = Plan::fastest(&table, Distance::MAX, SpeedIndex::TOP);
    let worst = neighbours(&plan, 133, 65_535).map(|(_, one, other)| ratio(one, other)).fold(1.0, f64::max);
    assert!((2.51..2.52).contains(&worst), "{worst}");
}

proptest! {
    #[test]
    fn any_optimal_movement_is_as_short_as_the_curve_allows(length in 1_u16.., limit in 0_u8..=232) {
        let limit = SpeedIndex::new(limit).expect("in range");
        check(&table(ShortMoves::Optimal), &curve(), length, limit);
    }

    #[test]
    fn any_follower_is_even(lead in 1_u16..=20_000, part in 0.0..=1.0_f64, limit in 0_u8..=232) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within 1 ..= lead")]
        let own = ((f64::from(lead) * part) as u16).clamp(1, lead);
        let table = table(ShortMoves::Optimal);
        let plan = Plan::fastest(&table, steps(lead), SpeedIndex::new(limit).expect("in range"));
        check_follower(&table, &plan, own, lead);
    }

    /// Along any profile the plan is as good: never behind the curve by more than the grain of its periods, and ahead of it by
    /// no more than an interval of the table on either side.
    #[test]
    fn along_every_profile_movements_are_as_short_as_the_curve_allows(
        ramp in any_ramp(), length in 1_u16.., limit in 0_u8..=232,
    ) {
        let limit = SpeedIndex::new(limit).expect("in range");
        let (table, curve) = (Table::new(&ramp).expect("usable"), Curve::new(&ramp));
        let distance = steps(length);
        let along_curve = curve.seconds(&table, distance, limit) * as_f64(Tick::PER_SECOND);
        let duration = as_f64(Plan::fastest(&table, distance, limit).duration());
        // A period is never faster than the curve at its begin, so each ramp may lose a first period; N is a whole number.
        let grain = f64::from(table.period(SpeedIndex::START)) + along_curve * 0.02;
        let lead = 2.0 * f64::from(ramp.interval_ticks()) + along_curve * 0.02;
        let excess = duration - along_curve;
        prop_assert!((-lead..=grain).contains(&excess), "{duration} ticks, {along_curve} along the curve");
    }

    /// The closed forms of every profile against plain sums of little pieces.
    #[test]
    fn the_area_under_every_curve_is_the_steps(ramp in any_ramp(), part in 0.0..1.2_f64) {
        let curve = Curve::new(&ramp);
        let seconds = curve.end() * if matches!(ramp.profile, Profile::Sin2(_)) { part.min(1.0) } else { part };
        let width = seconds / 10_000.0;
        let middle = |piece: u32| (f64::from(piece) + 0.5) * width;
        let area: f64 = (0..10_000).map(|piece| curve.speed(middle(piece)) * width).sum();
        let steps = curve.steps(seconds);
        prop_assert!((steps - area).abs() < 1e-3 + steps * 1e-4, "{} and {}", steps, area);
        // The slope is that of the speed. A piece in which it jumps is up to a thirty-fifth of an interval long.
        let rise: f64 = (0..10_000).map(|piece| curve.acceleration(middle(piece)) * width).sum();
        let risen = curve.speed(seconds) - curve.speed(0.0);
        prop_assert!((rise - risen).abs() < 1.0 + curve.speed(seconds) * 0.05, "{} and {}", rise, risen);
    }

    /// The closed forms against plain sums of little pieces, and against each other.
    #[test]
    fn the_area_under_the_curve_is_the_steps(seconds in 0.0..0.299_f64, length in 1_u16.., limit in 0_u8..=232) {
        let (table, curve) = (table(ShortMoves::Optimal), curve());
        let width = seconds / 10_000.0;
        let area: f64 = (0..10_000).map(|piece| curve.speed((f64::from(piece) + 0.5) * width) * width).sum();
        prop_assert!((curve.steps(seconds) - area).abs() < 1e-3, "{} and {}", curve.steps(seconds), area);
        let limit = SpeedIndex::new(limit).expect("in range");
        let shortest = curve.seconds(&table, steps(length), limit);
        let half: f64 = (0..10_000)
            .map(|piece| (f64::from(piece) + 0.5) * shortest / 20_000.0)
            .map(|seconds| if seconds < 0.299_28 { curve.speed(seconds) } else { f64::INFINITY })
            .map(|speed| speed.min(table.speed(limit)) * shortest / 20_000.0)
            .sum();
        prop_assert!((2.0 * half - f64::from(length)).abs() < 0.5 + f64::from(length) * 1e-5, "{} of {}", half, length);
    }
}
