//! Axes with different profiles in one set, the example `profiles.toml`: each moves, stops and goes on, by itself and on
//! lines, and what it did is made again from its log alone. And what people are told of ramps and motors.

use std::fs;

use serde_json::Value;
use supersigma_tests::{Cell, changed};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const SET: &str = include_str!("../../examples/profiles.toml");
const TABLE: &str = include_str!("../../examples/exponential.txt");
const PATIENT: &str = "
[line]
lead_ms = 300
[executive]
answer_ms = 30000
overdue_ms = 30000
[supervision]
silent_ms = 30000
";
const AXES: [&str; 4] = ["slide", "carriage", "bridge", "lift"];

/// A cell with the example, whose limits also a busy machine keeps.
fn cell(set: &str) -> Cell {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), format!("{set}{PATIENT}")).expect("a configuration");
    fs::write(cell.path("exponential.txt"), TABLE).expect("a table");
    cell
}

fn position(cell: &Cell, axis: &str) -> i64 {
    cell.axis(axis)["position"].as_i64().expect("originated")
}

fn everything_moves(method: &str) {
    let cell = cell(&changed(SET, "short_moves = \"optimal\"", &format!("short_moves = \"{method}\"")));
    let up = cell.up("5");
    // Nobody needs the table's file any more: the set carries its counts.
    fs::remove_file(cell.path("exponential.txt")).expect("it was there");
    cell.ccu("origin all").done();
    for axis in AXES {
        let mut expected = 0;
        for (steps, options) in [
            (1, ""),
            (2, ""),
            (37, ""),
            (300, ""),
            (-200, "--speed 1000"),
            (12_000, ""),
            (1_000, "--constant --speed 700"),
            (-3_000, "--speed 2500"),
        ] {
            cell.ccu(&format!("move {axis} {steps} {options}")).done();
            expected += steps;
            assert_eq!(position(&cell, axis), expected, "{axis} after {steps}");
        }
    }
    // On lines, axes accelerate alike.
    cell.ccu("line carriage=-3000 bridge=-1777").done();
    cell.ccu("line carriage=400 bridge=-400 --speed 3000").done();
    let path = "path([#{ carriage: 700, bridge: 300 }, #{ carriage: 300, bridge: 700 }])";
    cell.run(&["run", "-e", path]).done();
    cell.ccu("line slide=100 carriage=100").fails(2, &["slide", "carriage", "ramp"]);
    // The reference step, half a turn from the limit, is found at whatever start speed.
    cell.ccu("reference lift").done();
    for axis in AXES {
        let start = position(&cell, axis);
        cell.ccu(&format!("move {axis} 12000 --speed 1000 --no-wait")).done();
        cell.until(axis, "at its speed", |axis| axis["activity"] == "cruising");
        cell.ccu(&format!("halt {axis}")).done();
        let halted = position(&cell, axis);
        assert!((start + 1..start + 12_000).contains(&halted), "{axis}: {halted}");
        cell.ccu("resume").done();
        assert_eq!(position(&cell, axis), start + 12_000, "{axis}");
        cell.ccu(&format!("move {axis} -12000 --speed 1000 --no-wait")).done();
        cell.until(axis, "at its speed", |axis| axis["activity"] == "cruising");
        cell.ccu(&format!("brake {axis}")).done();
        let braked = cell.until(axis, "standing", |axis| axis["activity"] == "standing");
        let braked = braked["position"].as_i64().expect("it is kept");
        assert!((start + 1..start + 12_000).contains(&braked), "{axis}: {braked}");
        cell.ccu(&format!("clear {axis}")).done();
    }
    // Closed loop makes lost steps good, with the linear ramp too.
    let before = position(&cell, "carriage");
    cell.ccu("inject carriage lost-steps=30").done();
    cell.ccu("move carriage -4000").done();
    assert_eq!(position(&cell, "carriage"), before - 4_000);
    let _ = cell.down();

    let result = cell.ccu(&format!("replay --verify --json {}", up.log.display())).good().json().remove(0);
    assert_eq!(
        (&result["result"], &result["cards"]),
        (&Value::from("identical"), &Value::from(5)),
        "{result}"
    );
    cell.ccu(&format!("plot {} -o run.svg", up.log.display())).done();
    assert!(cell.path("run.svg").exists());
}

#[test]
fn every_profile_moves_stops_and_is_made_again_from_its_log() {
    everything_moves("optimal");
}

#[test]
fn so_it_does_by_the_method_of_1980() {
    everything_moves("paper");
}

#[test]
fn a_dry_run_and_its_log_have_every_profile() {
    let cell = cell(SET);
    let program = "origin(); for axis in [1, 2, 3, 4] { move_by(axis, 5000); move_by(axis, -70); }";
    let config = cell.config().display().to_string();
    cell.run(&["run", "--dry-run", "--config", &config, "--log", "dry.mcap", "-e", program]).done();
    fs::remove_file(cell.path("exponential.txt")).expect("it was there");
    let result = cell.ccu("replay --verify --json dry.mcap").good().json().remove(0);
    assert_eq!(result["result"], "identical", "{result}");
}

#[test]
fn ramps_are_told_by_their_profile() {
    let cell = cell(SET);
    for (axis, line, word, first) in [
        ("slide", "slide: V(t) = 15000 sin²(4.54426 t + 0.2097) steps/s", "sin2", 3_076),
        (
            "carriage",
            "carriage: linear from 200 to 6000 steps/s in 0.4 s, a table entry every 1.72 ms",
            "linear",
            9_999,
        ),
        ("lift", "lift: a table of 61 counts, a table entry every 8.00 ms", "table", 3_999),
    ] {
        let profile = format!("profile --config cell.toml --axis {axis}");
        let said = cell.ccu(&profile).good().stdout;
        assert!(said.starts_with(line), "{said}");
        let table = cell.ccu(&format!("{profile} --json")).good().json().remove(0);
        assert_eq!((&table["profile"], &table["entries"][0]["n"]), (&word.into(), &first.into()));
        let moved = cell.ccu(&format!("{profile} --steps 1000 --json")).good().json().remove(0);
        assert_eq!(moved["profile"], word);
        for which in ["table", "length", "times"] {
            cell.ccu(&format!(
                "plot --profile --config cell.toml --axis {axis} -o {which}.svg --which {which}"
            ))
            .done();
        }
        let picture = fs::read_to_string(cell.path("table.svg")).expect("a picture");
        let named = if word == "sin2" { "sin²" } else { word };
        assert!(picture.contains(named), "{axis}");
    }
    // The linear table is that of the paper's equations: equal steps of speed, f_max at the end.
    let table = cell.ccu("profile --config cell.toml --axis carriage --json").good().json().remove(0);
    // t_a / 232 = 3 448.3 ticks; 25 steps/s an entry: 2 000 000 / 225 − 0.5, 2 000 000 / 6 000 − 0.5.
    assert_eq!((&table["interval_ticks"], &table["differences"]), (&3_448.into(), &"wide".into()));
    assert_eq!((&table["entries"][1]["n"], &table["entries"][232]["n"]), (&8_888.into(), &332.into()));
    assert_eq!(table["motor"]["stall"], Value::Null, "{}", table["motor"]);
}

#[test]
fn a_motor_that_cannot_follow_its_ramp_is_worth_a_warning() {
    let cell = cell(SET);
    assert_eq!(cell.ccu("config check cell.toml").good().stdout, "cell.toml: good, 4 axes\n");
    // Steeper by far than 0.4 s: 580 000 steps/s² are 9 100 rad/s², times 1.2e-4 kg·m² 1.1 N·m; with ten times the inertia 12.
    let steep = SET.replacen("t_a = 0.4", "t_a = 0.01", 1);
    let steep = changed(&steep, "motor = {}", "motor = { load_inertia = 1.08e-3 }");
    fs::write(cell.config(), format!("{steep}{PATIENT}")).expect("a configuration");
    let checked = cell.ccu("config check cell.toml");
    assert_eq!((checked.code(), checked.stdout.as_str()), (Some(0), "cell.toml: good, 4 axes\n"));
    for say in [
        "warning: cell.toml: axis 2 (carriage): the motor falls out of step at pulse ",
        "N·m of ",
        "at entry ",
    ] {
        assert!(checked.stderr.contains(say), "{checked}");
    }
    assert_eq!(checked.stderr.lines().count(), 1, "the others follow: {checked}");
    let told = cell.ccu("config check --json cell.toml").good().json().remove(0);
    let [warning] = told["warnings"].as_array().map_or(&[][..], Vec::as_slice) else { panic!("{told}") };
    assert_eq!((&warning["axis"], &warning["name"]), (&2.into(), &"carriage".into()));
    assert!(warning["message"].as_str().is_some_and(|message| checked.stderr.contains(message)), "{told}");
    let said = cell.ccu("profile --config cell.toml --axis carriage").good().stdout;
    assert!(
        said.lines().nth(1).is_some_and(|line| line.starts_with("the motor falls out of step at pulse ")),
        "{said}"
    );
    let table = cell.ccu("profile --config cell.toml --axis carriage --json").good().json().remove(0);
    assert!(table["motor"]["stall"]["pulse"].as_u64().is_some_and(|pulse| pulse > 0), "{}", table["motor"]);
}

#[test]
fn what_is_wrong_with_a_table_is_told_with_its_line() {
    let cell = cell(SET);
    fs::write(cell.path("exponential.txt"), "4000\n3900 # so far\n3950\n").expect("a table");
    cell.ccu("config check cell.toml")
        .fails(2, &["exponential.txt:3:1", "axis[3].ramp.counts[2]", "rises from 3900 to 3950"]);
    fs::remove_file(cell.path("exponential.txt")).expect("it was there");
    cell.ccu("up --config cell.toml").fails(2, &["axis[3].ramp.file", "exponential.txt cannot be read"]);
}
