//! Finding the limits of a motor and a ramp that keeps within them, as people do it: the bench finds lost steps, `tune`
//! proposes, and the bench finds none any more.

use std::fs;

use serde_json::Value;
use supersigma_tests::{Cell, Ran};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
/// Five times the inertia of the bench motor alone.
const DISC: &str = "--load-inertia 0.00048";

fn object(ran: Ran) -> Value {
    let ran = ran.good();
    let [object] = &ran.json()[..] else { panic!("one object: {ran}") };
    object.clone()
}

fn way<'a>(told: &'a Value, name: &str) -> &'a Value {
    let ways = told["ways"].as_array().expect("ways");
    ways.iter().find(|way| way["name"] == name).unwrap_or_else(|| panic!("no {name} in {told}"))
}

#[test]
fn a_profile_that_is_too_steep_is_caught_and_tune_mends_it() {
    let cell = Cell::new(EXE);
    // 380 000 half steps/s²; 2.5 N·m give this inertia no more than 265 000. So steps are lost, and the encoder tells.
    let steep = "bench positioning --f-start 400 --f-max 8000 --ta 0.02 --tc 0.02 --steps 600";
    cell.ccu(&format!("{steep} {DISC}")).fails(1, &["of 600 steps were lost"]);

    let told = object(cell.ccu(&format!("bench tune --steps 600 --profile linear --json {DISC}")));
    assert_eq!((&told["motor"], &told["steps"]), (&"the bench motor".into(), &600.into()));
    let bench = way(&told, "bench, linear");
    assert_eq!(bench["nominal"]["follows"], true, "{bench}");
    assert_eq!(bench["at_margin"]["follows"], true, "{bench}");
    assert!(bench["margin"].as_f64() >= Some(0.3), "{bench}");
    let command = bench["command"].as_str().expect("a command");
    let line = command.strip_prefix("ccu ").expect("of ccu");
    assert!(line.contains("--tb") && line.ends_with(DISC), "{line}");
    let report = object(cell.ccu(&format!("{line} --json")));
    assert_eq!((&report["lost"], &report["measured"]), (&0.into(), &600.into()), "{report}");
    // What has a margin holds for a weaker motor, too: a brake takes a part of the torque.
    cell.ccu(&format!("{line} --load-torque 0.1")).done();
}

#[test]
fn the_proposed_ramp_goes_into_a_configuration() {
    let cell = Cell::new(EXE);
    let axis = "[[axis]]\naddress = 1\nname = \"arm\"\nmotor = { load_inertia = 4.8e-4 }\n\
        rail = { length = 68_000, lower_zone = 600, reference = 800, upper_zone = 67_000, start = 4_500 }\ntravel = { min = 0, max = 66_000 }\n";
    let _ = cell.file("arm.toml", axis);
    let of_the_axis = "--config arm.toml --axis arm";
    let told = object(cell.ccu(&format!(
        "bench tune --steps 500 --margin 20% --profile sin2 {of_the_axis} --write ramp.toml --plot tune.svg --json"
    )));
    let current = way(&told, "current");
    let sin2 = way(&told, "card, sin²");
    assert_eq!(current["ramp"]["amplitude"], 15_000.0, "{current}");
    assert_eq!(sin2["at_margin"]["follows"], true, "{sin2}");
    let written = fs::read_to_string(cell.path("ramp.toml")).expect("a ramp");
    assert_eq!(sin2["toml"], written);
    assert!(fs::read_to_string(cell.path("tune.svg")).expect("a picture").contains("Lag of the rotor"));
    let _ = cell.file("tuned.toml", &format!("{axis}\n{written}"));
    cell.ccu("config check tuned.toml").done();
    // With it, the proposal is what the axis has, and it holds.
    let again = object(
        cell.ccu("bench tune --steps 500 --margin 20% --profile sin2 --config tuned.toml --axis arm --json"),
    );
    let current = way(&again, "current");
    assert_eq!(current["seconds"], sin2["seconds"], "{current}");
    assert_eq!(current["at_margin"]["follows"], true, "{current}");
    // The numbers N of the same ramp, as a table in a file.
    let table =
        format!("bench tune --steps 500 --margin 20% --profile sin2 {of_the_axis} --write ramp.table");
    let said = cell.ccu(&table).good().stdout;
    let counts = fs::read_to_string(cell.path("ramp.table")).expect("a table");
    assert_eq!(counts.lines().count(), 233);
    let key = said.lines().find(|line| line.starts_with("ramp = {")).expect("a key for it");
    let _ = cell.file("table.toml", &format!("{axis}{key}\n"));
    cell.ccu("config check table.toml").done();
}

#[test]
fn limits_are_told_drawn_and_written() {
    let cell = Cell::new(EXE);
    let told = object(cell.ccu("bench limits --torques 1,0 --json -o l.svg --csv l.csv"));
    let points = told["points"].as_array().expect("points");
    let torques: Vec<_> = points.iter().map(|point| point["torque"].as_f64()).collect();
    assert_eq!(torques, [Some(0.0), Some(1.0)]);
    for point in points {
        let limit = |name: &str| point[name].as_f64().unwrap_or_else(|| panic!("{name} of {point}"));
        assert!(limit("start_stop") <= limit("pull_in") && limit("pull_in") < limit("pull_out"), "{point}");
    }
    assert!(fs::read_to_string(cell.path("l.svg")).expect("a picture").contains("ramp only"));
    let table = fs::read_to_string(cell.path("l.csv")).expect("a table");
    assert!(
        table.starts_with("inertia_kgm2,torque_nm,start_stop_hz,pull_in_hz,pull_out_hz\n0,0,"),
        "{table}"
    );
    assert_eq!(table.lines().count(), 3);
    let ran = cell.ccu("bench limits --points 2 --inertia 0,6e-4 --top 5000").good();
    assert!(ran.stdout.contains("a disc of 0.0006 kg·m²") && ran.stdout.contains("> 5000"), "{ran}");
}

#[test]
fn who_asks_for_too_much_is_told_so() {
    let cell = Cell::new(EXE);
    for (line, code, says) in [
        ("bench tune --steps 100 --load-torque 2", 1, "that a margin of 30 % leaves of the holding torque"),
        ("bench tune --steps 100 --load-torque 3", 1, "are not less than the holding torque"),
        ("bench limits --load-torque 3", 1, "are not less than the holding torque"),
        ("bench tune --steps 100 --margin 100%", 2, "a margin is a part of the torque"),
        ("bench tune --steps 0", 2, "0 is not in 1..=65535"),
        ("bench tune --steps 9 --write ramp.txt", 2, "ends in .toml or .table"),
        ("bench tune --steps 9 --plot ramp.gif", 2, "it must end in .svg or .png"),
        ("bench limits --torques=-1", 2, "0 or more"),
        ("bench limits --top 7", 2, "from 100 to 100000"),
        ("bench limits --inertia 0,1,2,3,4,5 -o l.svg", 2, "5 discs at most"),
    ] {
        cell.ccu(line).fails(code, &[says]);
    }
}
