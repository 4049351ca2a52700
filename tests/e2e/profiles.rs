//! `ccu profile`: what is planned, against a plain rate generator that knows nothing of ramps.

use std::collections::BTreeSet;
use std::{fs, iter};

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
                "profile",
                "duration_ticks",
                "peak_speed",
                "accel_steps",
                "decel_at",
                "loads",
                "pulses",
            ];
            assert_eq!(keys, known.into(), "{line}");
            assert_eq!((&profile["steps"], &profile["method"]), (&steps.into(), &method.into()), "{line}");
            assert_eq!(profile["profile"], "sin2");
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

#[test]
fn a_dry_run_and_its_log_become_pictures() {
    let cell = Cell::new(EXE);
    let program = cell.file("two.rhai", "origin(1); move_by(1, 3000); try { move_by(1, -9000); } catch {}");
    let line = format!("run --dry-run --json --log run.mcap --plot run.svg {}", program.display());
    let said = cell.ccu(&line).good().json();
    let timing = said.iter().find_map(|line| line.get("timing")).expect("a dry run tells its timing");
    assert_eq!(
        (&timing["axes"][0]["movements"], &timing["axes"][0]["out_of_travel"]),
        (&2.into(), &1.into())
    );
    assert_eq!(timing["out_of_travel"][0]["axis"], 1);
    let gantt = fs::read_to_string(cell.path("run.svg")).expect("a picture");
    assert!(gantt.contains("Dry run of two.rhai") && gantt.contains("search for the origin"), "{gantt}");
    cell.ccu("plot run.mcap -o run.png --size 900x640").done();
    let png = fs::read(cell.path("run.png")).expect("a picture");
    // The header of a PNG: eight bytes of signature, then a chunk that begins with width and height.
    assert_eq!(png[16..24], [0, 0, 1_800_u32.to_be_bytes()[2], 1_800_u32.to_be_bytes()[3], 0, 0, 5, 0]);
    // A log that is cut is shown as far as it goes.
    let whole = fs::read(cell.path("run.mcap")).expect("a log");
    fs::write(cell.path("cut.mcap"), &whole[..whole.len() * 2 / 3]).expect("a file can be written");
    let cut = cell.ccu("plot cut.mcap -o cut.svg");
    assert!(cut.code() == Some(0) && cut.stderr.contains("ends in the middle of a record"), "{cut}");
    let picture = fs::read_to_string(cell.path("cut.svg")).expect("a picture");
    assert!(picture.contains("cut short") && picture.contains("steps/s"), "{picture}");
}

#[test]
fn pictures_that_cannot_be_say_why() {
    let cell = Cell::new(EXE);
    cell.run(&["run", "--dry-run", "--log", "run.mcap", "-e", "origin(1)"]).done();
    cell.run(&["run", "--dry-run", "--log", "still.mcap", "-e", "output(0, true)"]).done();
    cell.ccu("plot run.mcap -o run.jpg").fails(2, &["run.jpg", ".svg or .png"]);
    cell.ccu("plot run.mcap -o run.svg --axis left_q").fails(2, &["left_q", "did you mean `left_"]);
    cell.ccu("plot run.mcap -o run.svg --from 90 --to 95")
        .fails(2, &["has nothing from 90.000 s", "it goes from"]);
    cell.ccu("plot run.mcap -o run.svg --from 2 --to 1").fails(2, &["ends before it begins"]);
    cell.ccu("plot run.mcap -o run.svg --size 300x200").fails(2, &["300x200 is too small", "at least 480x"]);
    cell.ccu("plot still.mcap -o run.svg").fails(2, &["nothing moves in the log still.mcap"]);
    cell.ccu("plot --profile -o run.svg --which table --steps 5").fails(2, &["--steps is for --which speed"]);
    assert!(!cell.path("run.svg").exists());
}

#[test]
fn a_run_on_the_bench_becomes_pictures() {
    let cell = Cell::new(EXE);
    let line = "bench positioning --f-start 500 --f-max 2000 --ta 0.05 --tb 0.02 --tc 0.05 --reverse --cutoff 100 \
                --taps 31 --plot-position position.svg --plot-speed speed.png --plot-profile profile.svg";
    cell.ccu(line).done();
    let picture = |name: &str| fs::read_to_string(cell.path(name)).expect("a picture");
    let (position, profile) = (picture("position.svg"), picture("profile.svg"));
    assert!(position.contains("Angular position") && position.contains("without a load"), "{position}");
    for text in
        ["Ns_a = ", "Ns_b = ", "Ns_c = ", "31 taps at 20 kHz, low pass 100 Hz", "up to 2\u{2009}000 Hz"]
    {
        assert!(profile.contains(text), "{text}: {profile}");
    }
    assert!(!profile.contains("steps lost"), "{profile}");
    assert!(fs::read(cell.path("speed.png")).expect("a picture").starts_with(b"\x89PNG"));
    // The bench motor cannot start with 6 000: the picture is there, and says so.
    let lost = cell.ccu("bench constant --frequency 6000 --steps 100 --plot-profile lost.svg");
    assert!(lost.code() == Some(1), "{lost}");
    assert!(picture("lost.svg").contains("steps lost from pulse"));
    let constant = "bench constant --frequency 100 --steps 4";
    cell.ccu(&format!("{constant} --cutoff 20")).fails(2, &["--plot-speed <FILE>|--plot-profile <FILE>"]);
    cell.ccu(&format!("{constant} --plot-speed x.svg --taps 20"))
        .fails(2, &["odd number of them, 11 to 301"]);
    cell.ccu(&format!("{constant} --plot-speed x.svg --cutoff 2000")).fails(2, &["outside 1 to 1000 Hz"]);
    cell.ccu(&format!("{constant} --plot-speed x.gif")).fails(2, &["x.gif", ".svg or .png"]);
    cell.ccu("bench constant --frequency 20 --steps 3000 --plot-speed x.svg")
        .fails(2, &["takes 150.0 s", "100 s at most", "--out has no such limit"]);
    assert!(!cell.path("x.svg").exists());
}
