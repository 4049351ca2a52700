//! People who stop what is under way: Ctrl-C, a halt from a second terminal, a polite end of the daemon. Axes come to a
//! stand by their ramp, positions are kept, logs are finished.

use serde_json::{Value, json};
use supersigma_tests::{Cell, Ran, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// Axis 1 away from the origin: long enough for everything that has to happen meanwhile, and fast enough for a ramp.
const LONG: &str = "move left_x 60000 --speed 4000";
const PROGRAM: &str =
    "origin(\"left_x\");\nprint(\"ready\");\nmove_by(\"left_x\", 60000, 4000);\nprint(\"never\");\n";

/// Axis 1 stands where it has counted, short of where it was to go, and nothing holds it.
fn halted(axis: &Value) -> i64 {
    let position = axis["position"].as_i64().expect("the position is kept");
    assert!(0 < position && position < 60_000, "{axis}");
    assert_eq!((&axis["steps"], &axis["alarm"]), (&json!(position), &Value::Null));
    position
}

fn on_its_way(cell: &Cell) {
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
}

fn stands(cell: &Cell) -> i64 {
    halted(&cell.until("left_x", "stands", |axis| axis["activity"] == "standing"))
}

/// The last thing that axis 1 did, in a complete log: it came to a stand by the normal ramp.
fn halted_in_the_log(frames: &[Value]) {
    let of_axis: Vec<&Value> = frames.iter().filter(|frame| frame["axis"] == 1).collect();
    assert!(of_axis.iter().any(|frame| frame["activity"] == "decelerating"), "it has not decelerated");
    assert!(of_axis.iter().all(|frame| frame["activity"] != "braking"), "it has braked");
    let last = of_axis.last().expect("frames of axis 1");
    assert_eq!((&last["about"]["unasked"], &last["activity"]), (&json!("leaving"), &json!("standing")));
    halted(last);
}

/// What `ccu run` says when it ends before its program does.
fn interrupted(ran: &Ran) {
    assert_eq!(ran.code(), Some(1), "{ran}");
    assert!(ran.complaint().contains("interrupted"), "{ran}");
    assert!(ran.stdout.contains("ready") && !ran.stdout.contains("never"), "{ran}");
}

#[test]
fn ctrl_c_in_a_waiting_move_halts_the_axis() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    cell.ccu("origin left_x").done();
    let waiting = cell.start(LONG);
    on_its_way(&cell);
    waiting.signal(Signal::INT);
    let ran = waiting.end();
    assert!(ran.signal() == Some(2) || ran.code() == Some(1) || ran.code() == Some(130), "{ran}");
    let position = stands(&cell);
    let back = cell.ccu(&format!("move left_x -{position} --json")).good().json().remove(0);
    assert_eq!(back["position"], 0);
    assert_eq!(cell.down(), None);
    assert!(
        cell.frames(&up.log).iter().any(|frame| frame["operation"] == "Halt" && frame["name"] == "left_x")
    );
}

#[test]
fn a_killed_client_halts_the_axis_too() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    cell.ccu("origin left_x").done();
    let waiting = cell.start(LONG);
    on_its_way(&cell);
    waiting.signal(Signal::KILL);
    assert_eq!(waiting.end().signal(), Some(9));
    stands(&cell);
    assert_eq!(cell.down(), None);
}

#[test]
fn a_halt_from_a_second_terminal_ends_a_waiting_move() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    let waiting = cell.start(LONG);
    on_its_way(&cell);
    cell.ccu("halt left_x").done();
    let ran = waiting.end();
    let position = stands(&cell);
    ran.fails(1, &["axis 1 (left_x) was stopped at", &format!("s after {position} steps, at {position}")]);
    // A brake, on a line: both stop, and stay on it.
    let waiting = cell.start("line left_x=30000 left_y=15000 --speed 4000");
    on_its_way(&cell);
    cell.ccu("brake").done();
    waiting.end().fails(1, &["is in alarm at ", "s: braked on command", "`ccu clear`; its position is kept"]);
    let made = ["left_x", "left_y"].map(|axis| {
        let axis = cell.until(axis, "stands", |axis| axis["activity"] == "standing");
        axis["steps"].as_i64().expect("steps")
    });
    assert!(0 < made[0] && made[0] < 30_000, "{made:?}");
    let said = cell.down().expect("alarms are worth a word");
    assert!(said.contains("braked on command"), "{said}");
}

#[test]
fn what_is_left_of_a_halted_movement_is_made_when_somebody_resumes_it() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    cell.ccu("resume").fails(1, &["nothing was halted"]);
    for (line, left_y) in
        [("move left_x 20000 --speed 4000 --no-wait", 0), ("line left_x=-20000 left_y=3001 --no-wait", 3_001)]
    {
        assert_eq!(cell.ccu(line).good().stdout, "started\n");
        on_its_way(&cell);
        // Whoever halts one axis of a line halts the line.
        cell.ccu("halt left_x").done();
        let halted = cell.axis("left_x")["position"].as_i64().expect("it is kept");
        assert!((1..20_000).contains(&halted), "{halted}");
        cell.ccu("resume").done();
        assert_eq!(cell.axis("left_y")["position"], left_y);
    }
    assert_eq!(cell.axis("left_x")["position"], 0);
    // What had ended before it was halted has no rest.
    cell.ccu("move left_x 10 --no-wait").done();
    cell.until("left_x", "has got there", |axis| axis["activity"] == "standing" && axis["position"] == 10);
    cell.ccu("halt left_x").done();
    cell.ccu("resume").fails(1, &["nothing was halted"]);
    assert_eq!(cell.down(), None);
}

#[test]
fn what_an_alarm_has_ended_is_resumed_once_it_is_cleared() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    let position = |axis: &str| cell.axis(axis)["position"].as_i64().expect("it is kept");
    let ways = [
        ("move left_x 20000 --speed 4000", "inject left_x force", (20_000, 0)),
        ("line left_x=-20000 left_y=3001 --speed 4000 --no-wait", "inject left_x force", (0, 3_001)),
        ("move left_x 20000 --speed 4000 --no-wait", "brake left_x", (20_000, 3_001)),
    ];
    for (line, stop, (left_x, left_y)) in ways {
        let moving = cell.start(line);
        on_its_way(&cell);
        cell.ccu(stop).done();
        let ended = moving.end();
        if line.contains("--no-wait") {
            ended.done();
        } else {
            ended.fails(1, &["excessive force", "`ccu resume`"]);
        }
        cell.until("left_x", "has braked", |axis| axis["activity"] == "standing" && !axis["alarm"].is_null());
        let stands = position("left_x");
        assert!((1..20_000).contains(&stands), "{line}: {stands}");
        // Nothing moves in alarm, and nothing is forgotten for it.
        if !line.contains("--no-wait") {
            cell.ccu("resume").fails(1, &["alarm", "ccu clear"]);
            assert_eq!(position("left_x"), stands);
        }
        cell.ccu("clear").done();
        cell.ccu("resume").done();
        assert_eq!((position("left_x"), position("left_y")), (left_x, left_y), "{line}");
    }
    // There and back again is not where it was.
    let moving = cell.start("move left_x -20000 --speed 4000");
    on_its_way(&cell);
    cell.ccu("inject left_x force").done();
    moving.end().fails(1, &["excessive force", "ccu resume"]);
    cell.ccu("clear").done();
    cell.ccu("move left_x 10").done();
    cell.ccu("move left_x -10").done();
    cell.ccu("resume").fails(1, &["has been moved since"]);
    cell.ccu("resume").fails(1, &["nothing was halted"]);
    cell.ccu("down").done();
}

#[test]
fn a_halted_program_waits_to_be_resumed() {
    let cell = Cell::new(EXE);
    let _up = cell.up("3");
    let text =
        "origin(\"left_x\");\nprint(\"ready\");\nmove_by(\"left_x\", 20000, 4000);\nprint(\"over\");\n";
    let program = cell.file("program.rhai", text);
    let mut running = cell.start(&format!("run --json {}", program.display()));
    running.says("ready");
    on_its_way(&cell);
    cell.ccu("halt left_x").done();
    let position = cell.until("left_x", "stands", |axis| axis["activity"] == "standing")["position"].clone();
    assert!((1..20_000).contains(&position.as_i64().expect("the position is kept")), "{position}");
    cell.ccu("resume").done();
    let told = running.end().good().json();
    assert_eq!(told[told.len() - 2], json!({ "print": "over" }));
    let movement = &told[told.len() - 3]["movement"];
    assert_eq!((&movement["done"], &movement["position"]), (&json!(20_000), &json!(20_000)));
    assert_eq!(cell.down(), None);
}

#[test]
fn ctrl_c_in_a_program_on_its_own_set_takes_everything_down() {
    let cell = Cell::new(EXE);
    let program = cell.file("program.rhai", PROGRAM);
    let log = cell.path("run.mcap");
    let options = format!("--time-scale 2 --config {} --log {}", cell.config().display(), log.display());
    let mut running = cell.start(&format!("run {options} {}", program.display()));
    running.says("ready");
    on_its_way(&cell);
    running.signal(Signal::INT);
    let ran = running.end();
    interrupted(&ran);
    cell.assert_nothing_left();
    let frames = cell.frames(&log);
    assert!(ran.stderr.contains(&format!("frames: {0} sent, {0} logged", frames.len())), "{ran}");
    halted_in_the_log(&frames);
}

#[test]
fn ctrl_c_in_a_program_on_a_set_that_is_up_leaves_the_set_up() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    let program = cell.file("program.rhai", PROGRAM);
    let mut running = cell.start(&format!("run {}", program.display()));
    running.says("ready");
    on_its_way(&cell);
    running.signal(Signal::INT);
    interrupted(&running.end());
    stands(&cell);
    assert_eq!(cell.down(), None);
    halted_in_the_log(&cell.frames(&up.log));
}

#[test]
fn a_set_is_taken_down_under_a_program() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    let endless = cell.file("program.rhai", "print(\"ready\"); wait(86400.0); print(\"never\");");
    let mut running = cell.start(&format!("run {}", endless.display()));
    running.says("ready");
    assert_eq!(cell.down(), None);
    running.end().fails(3, &["going down"]);
    assert!(cell.frames(&up.log).iter().any(|frame| frame["about"]["unasked"] == "leaving"));
}

#[test]
fn a_polite_end_of_the_daemon_is_a_way_down() {
    for signal in [Signal::TERM, Signal::INT, Signal::HUP] {
        let cell = Cell::new(EXE);
        let log = cell.path("up.mcap");
        let options = format!("--time-scale 2 --config {} --log {}", cell.config().display(), log.display());
        let mut daemon = cell.start(&format!("up {options}"));
        daemon.says("Ctrl-C, or `ccu down --name cell`, takes it down");
        cell.ccu("origin left_x").done();
        let waiting = cell.start(LONG);
        on_its_way(&cell);
        daemon.signal(signal);
        waiting.end().fails(3, &["the set is going down"]);
        let ran = daemon.end().good();
        cell.assert_nothing_left();
        let frames = cell.frames(&log);
        assert!(ran.stdout.starts_with("set cell is up: 8 cards; log "), "{ran}");
        assert!(ran.stdout.contains(&format!("frames: {0} sent, {0} logged", frames.len())), "{ran}");
        halted_in_the_log(&frames);
    }
}
