//! `ccu profile`: what is planned, against a plain rate generator that knows nothing of ramps.

use std::collections::BTreeSet;
use std::iter;

use serde_json::Value;
use supersigma_tests::Cell;

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

fn numbers(list: &Value) -> Vec<u64> {
    let list = list.as_array().unwrap_or_else(|| panic!("{list} is no list"));
    list.iter().map(|number| number.as_u64().expect("a number")).collect()
}

/// A counter that divides by what was loaded last when a period begins.
fn rate_generator(loads: &[Value], pulses: usize) -> Vec<u64> {
    let loads: Vec<(u64, u64)> = loads
        .iter()
        .map(|load| (load["tick"].as_u64().expect("a tick"), load["count"].as_u64().expect("a count")))
        .collect();
    let (mut now, mut made) = (0, Vec::with_capacity(pulses));
    let mut next = 0;
    let mut count = 0;
    for _ in 0..pulses {
        while let Some((_, newer)) = loads.get(next).filter(|(tick, _)| *tick <= now) {
            (count, next) = (*newer, next + 1);
        }
        now += count;
        made.push(now);
    }
    assert!(next > 0, "nothing was loaded at tick 0");
    made
}

#[test]
fn a_profile_is_what_a_rate_generator_makes_of_its_loads() {
    let cell = Cell::new(EXE);
    for method in ["optimal", "paper"] {
        for steps in [1, 2, 3, 199, 200, 2_599, 5_183, 5_184, 10_000, 65_535_usize] {
            let line = format!("profile --steps {steps} --method {method} --json --pulses");
            let profile = cell.ccu(&line).good().json().remove(0);
            let keys: BTreeSet<&str> =
                profile.as_object().expect("an object").keys().map(String::as_str).collect();
            let known = [
                "steps",
                "method",
                "duration_ticks",
                "peak_speed",
                "accel_steps",
                "decel_at",
                "loads",
                "pulses",
            ];
            assert_eq!(keys, known.into(), "{line}");
            assert_eq!((&profile["steps"], &profile["method"]), (&steps.into(), &method.into()), "{line}");
            let pulses = numbers(&profile["pulses"]);
            assert_eq!(pulses.len(), steps, "{line}");
            assert_eq!(profile["duration_ticks"].as_u64(), pulses.last().copied(), "{line}");
            let starts = iter::once(0).chain(pulses.iter().copied());
            let periods: Vec<u32> = starts
                .zip(&pulses)
                .map(|(from, to)| to.checked_sub(from).and_then(|period| u32::try_from(period).ok()))
                .collect::<Option<_>>()
                .unwrap_or_else(|| panic!("{line}: pulses out of order"));
            let shortest = *periods.iter().min().expect("a movement has pulses");
            assert!(shortest >= 133, "{line}: a period of {shortest} ticks");
            let peak = profile["peak_speed"].as_f64().expect("a speed");
            assert!((peak * f64::from(shortest) - 2e6).abs() < 1e-3, "{line}: {peak}");
            let loads = profile["loads"].as_array().expect("a list");
            assert!(rate_generator(loads, steps) == pulses, "{line}: the loads make other pulses");
            let decel_at = profile["decel_at"].as_u64().expect("steps");
            assert!(profile["accel_steps"].as_u64() <= Some(decel_at), "{line}: {profile}");
        }
    }
}

#[test]
fn the_long_movement_of_the_paper() {
    let cell = Cell::new(EXE);
    let long = cell.ccu("profile --steps 10000 --method paper --json").good().json().remove(0);
    assert!(long.get("pulses").is_none(), "nobody asked for the pulses");
    // [C]: about 2 600 steps to the top in 0.3 s, down again the same way, ten steps before the end.
    assert_eq!(
        (long["accel_steps"].as_u64(), long["decel_at"].as_u64()),
        (Some(2_587), Some(10_000 - 2_587 - 10))
    );
    // 200 steps: the paper takes 0.64 s at less than 650 steps/s and finds that it could be 0.115 s.
    let ticks = |method: &str| {
        let line = format!("profile --steps 200 --method {method} --json");
        cell.ccu(&line).good().json()[0]["duration_ticks"].as_u64().expect("ticks")
    };
    assert!(ticks("optimal") < 2_000_000 / 5, "{}", ticks("optimal"));
    assert!(ticks("optimal") < ticks("paper"));
}

#[test]
fn the_ramp_table_is_that_of_the_paper() {
    let cell = Cell::new(EXE);
    let table = cell.ccu("profile --json").good().json().remove(0);
    let entries = table["entries"].as_array().expect("a list");
    assert_eq!((table["interval_ticks"].as_u64(), entries.len()), (Some(2_580), 233));
    assert_eq!((entries[0]["n"].as_u64(), entries[232]["n"].as_u64()), (Some(3_076), Some(132)));
    let differences: Vec<u64> = entries.iter().filter_map(|entry| entry["difference"].as_u64()).collect();
    assert_eq!(
        (differences.len(), differences.iter().max(), differences.iter().sum()),
        (232, Some(&163), 2_944_u64)
    );
}
