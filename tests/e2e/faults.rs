//! Processes that end unasked, or hang. Whoever is left brakes, says why, and can be taken down; and the log tells
//! afterwards what happened.

use std::collections::BTreeSet;
use std::fs;

use serde_json::{Value, json};
use supersigma_tests::{Cell, Ran, Signal, changed, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// Axis 1 away from the origin: long enough for everything that has to happen meanwhile, and fast enough for a ramp.
const LONG: &str = "move left_x 60000 --speed 4000";

fn braked(axis: &Value) -> bool {
    axis["activity"] == "standing" && axis["alarm"]["cause"] == "braked"
}

/// A cell in which nobody who is gone comes back.
fn for_good() -> Cell {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), changed(&patient(), "restart = true ", "restart = false "))
        .expect("a configuration");
    cell
}

/// Brings a set up, and axis 1 to its way.
fn moving(cell: &Cell) -> supersigma_tests::Up {
    let up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    cell.ccu(&format!("{LONG} --no-wait")).done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    up
}

/// Where an axis stands that has been stopped on its way: somewhere between, and what it counted is where it is.
fn stopped_between(axis: &Value) -> i64 {
    let position = axis["position"].as_i64().expect("the position is kept");
    assert!(0 < position && position < 60_000, "{axis}");
    assert_eq!(axis["steps"], position, "it began at 0");
    position
}

#[test]
fn the_ccu_is_killed_and_nobody_runs_on() {
    let cell = Cell::new(EXE);
    let up = moving(&cell);
    let waiting = cell.start("move left_y 20000 --constant --speed 650");
    cell.until("left_y", "at its speed", |axis| axis["activity"] == "cruising");
    let daemon = cell.processes().into_iter().find(|process| process.pid == up.pid).expect("the daemon");
    assert!(daemon.has(&["up", "--detached"]), "{daemon:?}");
    daemon.signal(Signal::KILL);
    waiting.end().fails(3, &["the set's daemon is gone"]);
    // Nobody ends the others; they see for themselves that the CCU is gone.
    cell.until_all_have_ended();

    let frames = cell.frames(&up.log);
    let last = |axis: u8| frames.iter().rev().find(|frame| frame["axis"] == axis).expect("a frame");
    for axis in [1, 2] {
        let last = last(axis);
        assert_eq!(last["about"], json!({ "unasked": "leaving" }), "{last}");
        assert_eq!(last["alarm"], json!({ "cause": "ccu_lost", "message": "the CCU is gone" }), "{last}");
        stopped_between(last);
    }
    let braking = |frame: &&Value| frame["axis"] == 1 && frame["activity"] == "braking";
    assert!(frames.iter().any(|frame| braking(&frame)), "axis 1 has not braked by its ramp");
    let left = frames.iter().filter(|frame| frame["about"]["unasked"] == "leaving");
    let left: BTreeSet<u64> = left.filter_map(|frame| frame["axis"].as_u64()).collect();
    assert_eq!(left, (1..=8).collect());
    assert_eq!(cell.ccu("status").stdout, "");
    cell.ccu("status").fails(3, &["no set named \"cell\" is up", "`ccu up --name cell`"]);

    // What the dead have left is no obstacle, and goes.
    fs::remove_file(&up.log).expect("the log");
    let again = cell.up("20");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 100").done();
    assert_eq!(cell.down(), None);
    assert!(cell.frames(&again.log).len() > 8);
}

#[test]
fn a_worker_is_killed_and_the_others_brake() {
    let cell = for_good();
    let up = moving(&cell);
    let waiting = cell.start("move left_y 20000 --constant --speed 650");
    cell.until("left_y", "at its speed", |axis| axis["activity"] == "cruising");
    cell.worker(2).signal(Signal::KILL);
    waiting.end().fails(1, &["the worker of axis 2 (left_y) is gone", "`ccu ps` shows when it is back"]);
    stopped_between(&cell.until("left_x", "has braked", braked));
    for line in ["move left_y 10", "origin left_y", "line left_x=-10 left_y=10"] {
        cell.ccu("clear left_x").done();
        cell.ccu(line).fails(1, &["the worker of axis 2 (left_y) is gone"]);
    }
    let status = cell.ccu("status").good();
    assert!(status.stdout.lines().any(|line| line.trim() == "2 left_y       its worker is gone"), "{status}");
    let gone = cell.axis("left_y");
    assert_eq!((&gone["alive"], &gone["position"]), (&json!(false), &Value::Null));
    // The axes that are left can be brought home.
    let home = cell.axis("left_x")["position"].as_i64().expect("a position");
    cell.ccu(&format!("move left_x -{home}")).done();
    let said = cell.down().expect("it is worth a word");
    assert!(said.contains("a worker has ended; all axes brake card=axis 2"), "{said}");
    assert!(!said.contains("silent"), "it is told once: {said}");
    let frames = cell.frames(&up.log);
    let brake = frames.iter().find(|frame| frame["operation"] == "Brake").expect("the brake command");
    assert_eq!(brake["name"], "everyone");
}

#[test]
fn the_recorder_is_killed_and_nothing_moves_without_a_log() {
    let cell = for_good();
    let up = moving(&cell);
    let waiting = cell.start("move left_y 20000 --constant --speed 650");
    cell.until("left_y", "at its speed", |axis| axis["activity"] == "cruising");
    // A log can be read while it is written; what happened 100 ms ago is in it.
    let cruising =
        |log: &Ran| log.json().iter().any(|frame| frame["axis"] == 2 && frame["activity"] == "cruising");
    let log_so_far = || {
        let log = cell.ccu(&format!("frames --json {}", up.log.display()));
        assert_eq!(log.code(), Some(0), "{log}");
        assert!(log.stderr.starts_with("the log ends in the middle of a record; the "), "{log}");
        log
    };
    eventually("the movement in the log", || cruising(&log_so_far()).then_some(()));
    cell.recorder().signal(Signal::KILL);
    let ran = waiting.end();
    assert_eq!(ran.code(), Some(1), "{ran}");
    assert!(
        ["the recorder is gone (signal: 9 (SIGKILL))", "axis 2 (left_y) is in alarm"]
            .iter()
            .any(|why| ran.complaint().contains(why)),
        "{ran}"
    );
    for axis in ["left_x", "left_y"] {
        stopped_between(&cell.until(axis, "has braked", braked));
    }
    cell.ccu("clear").done();
    for line in ["move left_x 10", "line left_x=10 left_y=10", "origin", "output lamp on"] {
        cell.ccu(line).fails(
            1,
            &["the recorder is gone (signal: 9 (SIGKILL))", "; nothing moves without a log", "free space"],
        );
    }
    let status = cell.ccu("status").good();
    assert!(status.stdout.contains("NO LOG ANY MORE, was "), "{status}");
    // What was recorded can be read, up to where it ends.
    assert!(cruising(&log_so_far()));
    let down = cell.ccu("down").good();
    assert!(down.stdout.contains(" sent, unknown logged"), "{down}");
    cell.assert_nothing_left();
}

#[test]
fn a_worker_hangs_and_is_noticed_by_its_silence() {
    let cell = Cell::new(EXE);
    let config = changed(&patient(), "silent_ms = 30000 ", "silent_ms = 2000 ");
    fs::write(cell.config(), config).expect("a configuration");
    let up = moving(&cell);
    let hung = cell.worker(2);
    hung.signal(Signal::STOP);
    stopped_between(&cell.until("left_x", "has braked", braked));
    cell.ccu("move left_y 10").fails(1, &["the worker of axis 2 (left_y) is gone"]);
    // It wakes: it has missed nothing, brakes as everybody was told, and can be commanded again.
    hung.signal(Signal::CONT);
    cell.until("left_y", "is back", |axis| axis["alive"] == true && braked(axis));
    cell.ccu("clear").done();
    cell.ccu("move left_y 10").done();
    assert_eq!(cell.axis("left_y")["position"], 10);
    let said = cell.down().expect("it is worth a word");
    assert!(said.contains("the card is silent; all axes brake card=axis 2 limit_ms=2000"), "{said}");
    assert!(cell.frames(&up.log).iter().any(|frame| frame["operation"] == "Brake"));
}

#[test]
fn a_worker_that_hangs_for_good_does_not_hold_the_set_up() {
    let cell = Cell::new(EXE);
    let config = changed(&patient(), "silent_ms = 30000 ", "silent_ms = 2000 ");
    // Until the silence is noticed, commands to the card wait in vain.
    let config = changed(&config, "answer_ms = 30000 ", "answer_ms = 500 ");
    fs::write(cell.config(), config).expect("a configuration");
    let up = cell.up("20");
    cell.worker(8).signal(Signal::STOP);
    eventually("the silence of card 8", || {
        cell.ccu("input").complaint().contains("the worker of card 8").then_some(())
    });
    cell.ccu("output lamp on").fails(1, &["the worker of card 9", "is gone"]);
    let said = cell.down().expect("it is worth a word");
    assert!(said.contains("a process does not end, it is killed"), "{said}");
    let frames = cell.frames(&up.log);
    let left = frames.iter().filter(|frame| frame["about"]["unasked"] == "leaving");
    assert_eq!(left.filter_map(|frame| frame["axis"].as_u64()).collect::<BTreeSet<_>>(), (1..=7).collect());
}
