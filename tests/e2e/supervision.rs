//! Processes that end unasked come back: workers as cards just switched on, the recorder with another file. How fast it is
//! noticed is promised, so it is measured, in the set's own ticks; the best of a few tries counts, because the machine
//! may be busy with something else.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mcap::read::Summary;
use serde_json::{Value, json};
use supersigma_tests::{Cell, Process, Signal, changed, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// The default limits, which the promises are made for.
fn promised() -> String {
    changed(&patient(), "silent_ms = 30000 ", "silent_ms = 450 ")
}

fn ps(cell: &Cell) -> Vec<Value> {
    cell.ccu("ps --json --name cell").good().json()
}

fn process(cell: &Cell, name: &str) -> Value {
    let found = ps(cell).into_iter().find(|row| row["name"] == name || row["role"] == name);
    found.unwrap_or_else(|| panic!("no {name}"))
}

fn until_back(cell: &Cell, name: &str, restarts: u32) -> Value {
    eventually(&format!("{name} is back"), || {
        Some(process(cell, name)).filter(|row| row["restarts"] == restarts && row["state"] == "running")
    })
}

#[test]
fn a_killed_worker_comes_back_and_does_not_know_where_its_axis_is() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    cell.ccu("move left_x 500").done();
    let before = process(&cell, "left_y");
    assert_eq!(
        (&before["axis"], &before["restarts"], &before["state"]),
        (&json!(2), &json!(0), &json!("running"))
    );
    // A program finds out, and may go on.
    let program = cell.file(
        "program.rhai",
        r#"
            try { move_by("left_y", 20000, 650); } catch (error) { print(`caught: ${error.kind}`); }
            for again in 0..600 { try { status("left_y"); break; } catch { wait(0.1); } }
            clear();
            try { move_by("left_y", 10); } catch (error) { print(`caught: ${error.kind}`); }
            origin("left_y");
            move_by("left_y", 10);
            print(`at ${position("left_y")}`);
        "#,
    );
    let running = cell.start(&format!("run {}", program.display()));
    cell.until("left_y", "on its way", |axis| axis["activity"] == "cruising");
    cell.ccu("kill-worker left_y").done();
    let after = until_back(&cell, "left_y", 1);
    assert_ne!(after["pid"], before["pid"]);
    let ran = running.end().good();
    assert_eq!(ran.stdout.lines().filter(|line| line.starts_with("caught: ")).count(), 2, "{ran}");
    assert!(ran.stdout.contains("caught: worker_gone\n"), "{ran}");
    assert!(ran.stdout.contains("caught: refused\n"), "{ran}");
    assert!(ran.stdout.contains("at 10\n"), "{ran}");
    // The others have braked, and know where they are.
    assert_eq!(cell.axis("left_x")["position"], 500);
    let said = cell.down().expect("it is worth a word");
    assert!(said.contains("a worker has ended; all axes brake card=axis 2"), "{said}");
    assert!(said.contains("the worker is started again"), "{said}");
    let frames = cell.frames(&up.log);
    let joined = frames.iter().filter(|frame| frame["axis"] == 2 && frame["about"]["unasked"] == "joined");
    assert_eq!(joined.count(), 2, "two lives");
    let brake = |frame: &&Value| frame["operation"] == "Brake" && frame["name"] == "everyone";
    assert!(frames.iter().any(|frame| brake(&frame)));
}

#[test]
fn a_worker_that_keeps_ending_is_started_less_and_less_often() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    for restarts in 1..=3 {
        cell.ccu("kill-worker digital").done();
        until_back(&cell, "digital", restarts);
    }
    cell.ccu("input").done();
    let table = cell.ccu("ps").good();
    assert_eq!(table.stdout.lines().count(), 11, "titles, CCU, recorder, eight workers: {table}");
    let _ = cell.down();
}

#[test]
fn a_killed_recorder_comes_back_with_another_file() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 60000 --speed 4000 --no-wait").done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    cell.recorder().signal(Signal::KILL);
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    until_back(&cell, "recorder", 1);
    cell.ccu("clear").done();
    let home = cell.axis("left_x")["position"].as_i64().expect("the position is kept");
    cell.ccu(&format!("move left_x -{home}")).done();
    let second = cell.path("cell.2.mcap");
    eventually("both files in the status", || {
        let status = cell.ccu("status --json").good().json();
        let recorder = &status.last().expect("the recorder")["recorder"];
        (recorder["parts"] == json!([up.log, second])).then_some(())
    });
    let down = cell.ccu("down").good();
    cell.assert_nothing_left();
    assert!(down.stdout.contains("cell.2.mcap"), "{down}");
    // The first file ends where the recorder was killed; the second is whole, and has the way back.
    assert!(cell.ccu(&format!("frames --json {}", up.log.display())).stdout.contains("Originate"));
    let back = |frame: &Value| frame["operation"] == "Move" && frame["steps"] == home;
    assert!(cell.frames(&second).iter().any(back), "the way back");
}

#[test]
fn without_restarts_who_is_gone_stays_gone() {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), changed(&patient(), "restart = true ", "restart = false "))
        .expect("a configuration");
    let _up = cell.up("20");
    cell.ccu("kill-worker left_y").done();
    eventually("left_y is gone", || Some(process(&cell, "left_y")).filter(|row| row["state"] == "ended"));
    cell.ccu("kill-worker left_y").fails(1, &["the worker of left_y has no process just now"]);
    cell.ccu("kill-worker left_q").fails(2, &["no axis \"left_q\"", "left_y"]);
    let _ = cell.down();
}

/// The real time from the blow to the brake command, both by the wall clock, for the best of a few tries.
fn best_of(tries: usize, mut once: impl FnMut() -> Duration) -> Duration {
    (0..tries).map(|_| once()).min().expect("some")
}

/// When tick 0 was, from the log's metadata.
fn epoch(log: &Path) -> Duration {
    let bytes = fs::read(log).expect("the log");
    let summary = Summary::read(&bytes).expect("a log").expect("a summary");
    let index = summary.metadata_indexes.iter().find(|index| index.name == "supersigma").expect("ours");
    let metadata = mcap::read::metadata(&bytes, index).expect("metadata");
    Duration::from_nanos(metadata.metadata["epoch_ns"].parse().expect("a number"))
}

/// From a blow at one process to the brake command that follows it.
fn until_the_brake(signal: Signal, victim: fn(&Cell) -> Process) -> Duration {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), promised()).expect("a configuration");
    let up = cell.up("1");
    cell.ccu("origin wrist").done();
    let hit = victim(&cell);
    let blow = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
    hit.signal(signal);
    let braked = |axis: &Value| axis["alarm"]["cause"] == "braked";
    cell.until("left_x", "has braked", braked);
    if signal == Signal::STOP {
        hit.signal(Signal::CONT);
    }
    cell.ccu("down").done();
    let frames = cell.frames(&up.log);
    let brake = frames.iter().find(|frame| frame["operation"] == "Brake").expect("the brake command");
    let tick = brake["tick"].as_u64().expect("a tick");
    (epoch(&up.log) + Duration::from_nanos(tick * 500)).saturating_sub(blow)
}

#[test]
fn a_death_is_noticed_within_200_ms() {
    let noticed = best_of(5, || until_the_brake(Signal::KILL, |cell| cell.worker(2)));
    assert!(noticed < Duration::from_millis(200), "{noticed:?}");
}

#[test]
fn silence_is_noticed_within_500_ms() {
    let noticed = best_of(5, || until_the_brake(Signal::STOP, |cell| cell.worker(2)));
    assert!(noticed < Duration::from_millis(550), "{noticed:?}");
}

#[test]
fn a_set_is_up_within_half_a_second() {
    let up = best_of(5, || {
        let cell = Cell::new(EXE);
        let begun = Instant::now();
        let _up = cell.up("1");
        let up = begun.elapsed();
        cell.ccu("down").done();
        up
    });
    assert!(up < Duration::from_millis(500), "{up:?}");
}
