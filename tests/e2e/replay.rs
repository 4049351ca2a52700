//! Logs of real sets, run again: what was commanded, what was done to the axes, who was killed; and the same on a bus.

use std::fs;
use std::path::Path;

use serde_json::Value;
use supersigma_tests::{Cell, Ran, Signal, changed, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

fn verified(cell: &Cell, log: &Path) -> Ran {
    cell.ccu(&format!("replay --verify --json {}", log.display()))
}

/// The log is what fresh machines say.
fn identical(cell: &Cell, log: &Path) -> Value {
    let result = verified(cell, log).good().json().remove(0);
    assert_eq!(result["result"], "identical", "{result}");
    let of_cards = cell.frames(log).iter().filter(|frame| frame["kind"] == "answer").count();
    assert_eq!(result["answers"], of_cards, "{result}");
    result
}

/// A set whose second axis is a motor that can lose steps, in closed loop.
fn closed() -> String {
    let axis = "name = \"left_y\"\n";
    changed(&patient(), axis, &format!("{axis}loop = \"closed\"\nmotor = {{}}\n"))
}

#[test]
fn everything_that_can_happen_to_a_set_happens_again() {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), closed()).expect("a configuration");
    let up = cell.up("20");
    cell.ccu("origin left_x left_y left_z").done();
    cell.ccu("line left_x=2000 left_y=1500 left_z=500 --speed 5000").done();
    let path = "path([#{ left_x: 700, left_y: 300 }, #{ left_x: 300, left_y: 700 }])";
    cell.run(&["run", "-e", path]).done();
    cell.ccu("inject left_y lost-steps=30").done();
    cell.ccu("move left_y 900").done();
    cell.ccu("output lamp on").done();
    cell.ccu("move left_x 20000 --speed 1000 --no-wait").done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    cell.ccu("halt left_x").done();
    let resumed = cell.start("resume");
    cell.until("left_x", "is on its way again", |axis| axis["activity"] == "cruising");
    cell.ccu("inject left_x force").done();
    cell.until("left_x", "has braked", |axis| axis["activity"] == "standing");
    resumed.end().fails(1, &["excessive force"]);
    cell.ccu("send 01 7F 00").fails(1, &["op-code 7F"]);
    assert_eq!(cell.ccu("move left_x 10").code(), Some(1), "it is in alarm");
    cell.ccu("clear left_x").done();
    cell.ccu("move left_x 40000 --speed 1000 --no-wait").done();
    cell.worker(3).signal(Signal::KILL);
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    let _ = cell.down();
    let result = identical(&cell, &up.log);
    assert_eq!((&result["cards"], &result["truncated"]), (&Value::from(8), &Value::from(false)));
    let said = cell.ccu(&format!("replay --verify {}", up.log.display())).good();
    assert!(
        said.stdout.starts_with("identical: ") && said.stdout.contains(" answers of 8 cards, "),
        "{said}"
    );
}

#[test]
fn the_end_of_a_killed_ccu_happens_again() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 60000 --speed 4000 --no-wait").done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    let daemon = cell.processes().into_iter().find(|process| process.pid == up.pid).expect("the daemon");
    daemon.signal(Signal::KILL);
    cell.until_all_have_ended();
    let orphaned = |frame: &Value| frame["axis"] == 1 && frame["about"]["unasked"] == "orphaned";
    assert!(cell.frames(&up.log).iter().any(orphaned));
    identical(&cell, &up.log);
}

#[test]
fn a_cut_log_is_verified_and_shown_as_far_as_it_goes() {
    let cell = Cell::new(EXE);
    let log = cell.path("dry.mcap");
    let script = "origin(); move_by(\"wrist\", 400); line(#{ left_x: 3000, left_y: 1000 });";
    cell.run(&["run", "--dry-run", "--log", "dry.mcap", "-e", script]).done();
    let whole = identical(&cell, &log);
    let bytes = fs::read(&log).expect("the log");
    let cut = cell.path("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("a file");
    let ran = verified(&cell, &cut);
    assert_eq!(ran.code(), Some(0), "{ran}");
    assert!(ran.complaint().contains("ends in the middle of a record"), "{ran}");
    let result = ran.json().remove(0);
    assert_eq!((&result["result"], &result["truncated"]), (&Value::from("identical"), &Value::from(true)));
    let answers = |result: &Value| result["answers"].as_u64().expect("a number");
    assert!(0 < answers(&result) && answers(&result) < answers(&whole), "{result}");
    let shown = cell.ccu("replay --speed max --json cut.mcap");
    assert!(shown.complaint().contains("ends in the middle of a record"), "{shown}");
    assert_eq!(shown.json().len() as u64, result["frames"].as_u64().expect("a number"));
    cell.ccu("replay --verify nothing.mcap").fails(2, &["nothing.mcap"]);
}

#[test]
fn a_log_is_shown_from_any_moment_with_what_was_then() {
    let cell = Cell::new(EXE);
    let script = "origin(); move_by(\"wrist\", 400); move_by(\"wrist\", -150);";
    cell.run(&["run", "--dry-run", "--log", "dry.mcap", "-e", script]).done();
    let all = cell.frames(&cell.path("dry.mcap"));
    let end = all.iter().filter_map(|frame| frame["time_s"].as_f64()).fold(0.0, f64::max);
    let rows = cell.ccu("replay --speed max --json dry.mcap").good().json();
    assert_eq!(rows, all);
    let some = cell.ccu("replay --speed max --json --axis wrist --from 1 --to 2 dry.mcap").good().json();
    let among = |frame: &&Value| {
        let time = frame["time_s"].as_f64().expect("a time");
        (1.0..=2.0).contains(&time) && (frame["to"] == 7 || frame["to"] == 0 || frame["axis"] == 7)
    };
    assert_eq!(some, all.iter().filter(among).cloned().collect::<Vec<_>>());
    // Nothing happens to the wrist after its end; the table still knows where it is.
    let table =
        cell.ccu(&format!("replay --watch --speed 100 --from {} --axis wrist dry.mcap", end - 0.001)).good();
    let last = table.stdout.lines().rfind(|line| line.contains(" wrist ")).expect("a row");
    assert_eq!(last.split_whitespace().nth(5), Some("250"), "{table}");
    cell.ccu("replay --from 2 --to 1 dry.mcap").fails(2, &["--from comes after --to"]);
    // At its own pace it takes its time; Ctrl-C ends it in order.
    let mut slow = cell.start("replay --speed 0.01 dry.mcap");
    slow.says("Originate");
    slow.signal(Signal::INT);
    slow.end().done();
}

#[test]
fn a_recorded_run_is_made_again_on_a_live_bus() {
    let cell = Cell::new(EXE);
    let script =
        "origin(); line(#{ left_x: 3000, left_y: 1000 }); move_by(\"wrist\", 400); output(\"lamp\", true);";
    cell.run(&["run", "--time-scale", "20", "--config", "cell.toml", "--log", "first.mcap", "-e", script])
        .code()
        .filter(|code| *code == 0)
        .expect("the run");
    // On a set of its own: fresh, with the log's configuration.
    let ran = cell.ccu("replay first.mcap --bus --json --log second.mcap");
    assert_eq!(ran.code(), Some(0), "{ran}");
    let result = ran.json().remove(0);
    assert_eq!(result["same"], true, "{result}");
    cell.assert_nothing_left();
    identical(&cell, &cell.path("second.mcap"));
    let positions = |log: &str| {
        let frames = cell.frames(&cell.path(log));
        [1, 2, 7].map(|axis| {
            frames.iter().rfind(|frame| frame["axis"] == axis).map(|frame| frame["position"].clone())
        })
    };
    assert_eq!(positions("first.mcap"), positions("second.mcap"));
    assert_eq!(positions("second.mcap")[0], Some(Value::from(3000)));

    // On a set that is up; but not on one that has moved already, and not on another one.
    let up = cell.up("20");
    let ran = cell.ccu("replay first.mcap --bus --json").good();
    assert_eq!(ran.json()[0]["same"], true, "{ran}");
    cell.ccu("replay first.mcap --bus").fails(1, &["just switched on", "has moved already"]);
    let _ = cell.down();
    identical(&cell, &up.log);
    fs::remove_file(&up.log).expect("the log");
    fs::write(cell.config(), closed()).expect("a configuration");
    let _ = cell.up("20");
    cell.ccu("replay first.mcap --bus").fails(2, &["not the one that was recorded", "axis 2"]);
    let _ = cell.down();
}

#[test]
fn a_replay_on_the_bus_ends_with_whoever_wants_it() {
    let cell = Cell::new(EXE);
    let script = "origin(\"left_x\"); move_by(\"left_x\", 60000);";
    let run = cell.run(&["run", "--dry-run", "--config", "cell.toml", "--log", "long.mcap", "-e", script]);
    assert_eq!(run.code(), Some(0), "{run}");
    let _ = cell.up("1");
    let running = cell.start("replay long.mcap --bus");
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    running.signal(Signal::INT);
    running.end().fails(1, &["interrupted"]);
    let axis = cell.until("left_x", "stands", |axis| axis["activity"] == "standing");
    assert!(axis["alarm"].is_null(), "halted, not braked: {axis}");
    eventually("the set's rest", || (cell.axis("left_x")["steps"] == axis["steps"]).then_some(()));
    let _ = cell.down();
}
