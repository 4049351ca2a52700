//! What people see when they ask wrongly, and how output behaves in pipes: exit codes, places in files, no stray bytes.

use std::fs;
use std::io;
use std::process::Stdio;

use serde_json::Value;
use supersigma_tests::{Cell, changed, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

#[test]
fn without_a_set_it_is_said_how_to_start_one() {
    let cell = Cell::new(EXE);
    for line in [
        "status",
        "status --json",
        "move 1 10",
        "line 1=10 2=20",
        "origin",
        "reference 1",
        "halt",
        "brake all",
        "clear",
        "input",
        "output lamp on",
        "send 01 05",
        "down",
    ] {
        let ran = cell.ccu(line);
        ran.fails(3, &["no set named \"cell\" is up", "start one with `ccu up --name cell`"]);
        assert_eq!(ran.stdout, "");
    }
    cell.ccu("status --name other").fails(3, &["no set named \"other\" is up"]);
    cell.assert_nothing_left();
}

#[test]
fn wrong_arguments_are_wrong_usage() {
    let cell = Cell::new(EXE);
    for (line, says) in [
        ("", "Usage: ccu <COMMAND>"),
        ("fly", "unrecognized subcommand 'fly'"),
        ("move", "<AXIS> <STEPS>"),
        ("move left_x far", "invalid digit"),
        ("line", "AXIS=STEPS"),
        ("send 1G", "\"1G\" is no byte; 00 to FF are"),
        ("output lamp dim", "[possible values: on, off]"),
        ("up --time-scale 0", "it is a number from 0.01 to 1000"),
        ("run", "<SCRIPT>"),
        ("run --pulses p.csv x.rhai", "--dry-run"),
        ("profile --steps 0", "0 is not in 1..=65535"),
        ("profile --steps 65536", "65536 is not in 1..=65535"),
        ("profile --speed 1000", "--steps"),
        ("profile --axis 9", "there is no axis \"9\"; there are left_x, "),
        ("status --name ../x", "cannot be a set's name: 1 to 32 letters"),
        ("up --name -x", "-x"),
        ("up --name a_name_that_is_longer_than_thirty_two", "cannot be a set's name"),
        ("frames no.mcap", "cannot read the log no.mcap"),
        ("run no.rhai", "cannot read the program no.rhai"),
        ("up --config no.toml", "no.toml"),
        ("config check no.toml", "no.toml"),
    ] {
        let ran = cell.ccu(line);
        ran.fails(2, &[says]);
        assert_eq!(ran.stdout, "", "{ran}");
    }
    cell.assert_nothing_left();
    assert!(!cell.has_default_log());
}

#[test]
fn names_that_mean_nothing_are_told_with_what_was_meant() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let known = "its axes are `left_x`, `left_y`, `left_z`, `right_x`, `right_y`, `right_z`, `wrist`";
    for line in ["move left_q 10", "origin left_q", "halt left_q", "status left_q", "line left_q=10 1=5"] {
        cell.ccu(line).fails(2, &["this set has no axis \"left_q\"", known, "did you mean `left_"]);
    }
    cell.ccu("move rist 10").fails(2, &["did you mean `wrist`?"]);
    let far = cell.ccu("move 8 10");
    far.fails(2, &["this set has no axis \"8\"", known]);
    assert!(!far.complaint().contains("did you mean"), "{far}");
    for (line, says) in [
        ("move 1 65536", "65536 steps are too many for one movement"),
        (
            "move 1 10 --speed 20000",
            "axis 1 (left_x) cannot run at 20000 steps/s; its ramp goes from 650.0 to 15037.6",
        ),
        ("line 1", "\"1\" is not of the form AXIS=STEPS"),
        ("line 1=far", "\"far\" in \"1=far\" is no number of steps"),
        ("line 1=10 left_x=20", "names an axis that the line has already"),
        ("input nothing", "this set has no input \"nothing\""),
    ] {
        cell.ccu(line).fails(2, &[says]);
    }
    assert_eq!(cell.down(), None);
}

#[test]
fn a_bad_configuration_is_refused_with_its_place() {
    let cell = Cell::new(EXE);
    let config = changed(&patient(), "offset = 10 ", "offset = \"ten\" ");
    let line = 1 + config.lines().position(|line| line.starts_with("offset")).expect("a line");
    let path = cell.file("bad.toml", &config);
    let place = format!("{}:{line}:10", path.display());
    let program = cell.file("program.rhai", "origin();");
    for command in [
        format!("config check {}", path.display()),
        format!("up --config {}", path.display()),
        format!("up --detach --config {}", path.display()),
        format!("run --config {} {}", path.display(), program.display()),
        format!("run --dry-run --config {} {}", path.display(), program.display()),
        format!("profile --config {}", path.display()),
    ] {
        cell.ccu(&command).fails(2, &[&place, "offset"]);
    }
    let unknown = changed(&patient(), "offset = 10 ", "ofset = 10 ");
    let path = cell.file("unknown.toml", &unknown);
    cell.ccu(&format!("config check {}", path.display()))
        .fails(2, &[&format!("{}:{line}:1", path.display()), "ofset", "offset"]);
    cell.assert_nothing_left();
    assert!(!cell.has_default_log());
}

#[test]
fn a_wrong_program_is_refused_before_anything_is_started() {
    let cell = Cell::new(EXE);
    for (text, place, says) in [
        (
            "origin();\nmove_by(\"wrist\", 10;\n",
            "2:20",
            "to separate the arguments to function call 'move_by'",
        ),
        ("origin();\n  mov_by(\"wrist\", 10);\n", "2:3", "mov_by"),
        ("origin();\nmove_by(\"rist\", 10);\n", "2:1", "wrist"),
        ("let x = 1;\nprint(y);\n", "2:7", "y"),
        ("origin(\"wrist\");\nmove_by(\"wrist\", \"far\");\n", "2:1", "steps"),
        ("move_by(\"wrist\", 70000);\n", "1:1", "70000"),
    ] {
        let program = cell.file("wrong.rhai", text);
        let place = format!("{}:{place}", program.display());
        let ran = cell.ccu(&format!("run {}", program.display()));
        ran.fails(2, &[&place, says]);
        assert_eq!(ran.stdout, "", "{ran}");
        let log = cell.path("named.mcap");
        cell.ccu(&format!("run --log {} {}", log.display(), program.display())).fails(2, &[&place, says]);
        assert!(!log.exists(), "{text:?} has made a log");
        cell.ccu(&format!("run --dry-run {}", program.display())).fails(2, &[&place, says]);
    }
    // What the robot will refuse is also seen before; then it is the robot's word, and its exit code.
    let program = cell.file("early.rhai", "move_by(\"wrist\", 10);\n");
    cell.ccu(&format!("run {}", program.display()))
        .fails(1, &[&format!("{}:1:1", program.display()), "the position is unknown; originate first"]);
    cell.assert_nothing_left();
    assert!(!cell.has_default_log());
}

#[test]
fn a_log_is_never_overwritten() {
    let cell = Cell::new(EXE);
    let log = cell.file("old.mcap", "somebody's work");
    let program = cell.file("program.rhai", "origin();");
    for line in [
        format!("up --log {}", log.display()),
        format!("up --detach --log {}", log.display()),
        format!("run --log {} {}", log.display(), program.display()),
        format!("run --dry-run --log {} {}", log.display(), program.display()),
    ] {
        cell.ccu(&line).fails(2, &[&format!("the log {} exists already", log.display())]);
    }
    assert_eq!(fs::read_to_string(log).expect("it is there"), "somebody's work");
    cell.assert_nothing_left();
}

#[test]
fn a_log_that_cannot_be_made_leaves_nothing() {
    let cell = Cell::new(EXE);
    let log = cell.path("no/such/folder.mcap");
    for how in ["", "--detach"] {
        cell.ccu(&format!("up {how} --log {}", log.display())).fails(1, &["cannot create the log"]);
    }
    cell.assert_nothing_left();
}

/// Runs a command whose standard output nobody reads.
fn unread(cell: &Cell, line: &str) {
    let (reader, writer) = io::pipe().expect("a pipe");
    drop(reader);
    let words: Vec<&str> = line.split_whitespace().collect();
    let mut command = cell.command(&words);
    let output =
        command.stdin(Stdio::null()).stdout(writer).stderr(Stdio::piped()).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && said.is_empty(),
        "`{line}` into a closed pipe: {}, {said}",
        output.status
    );
}

#[test]
fn a_closed_pipe_is_quiet_and_changes_nothing() {
    let cell = Cell::new(EXE);
    for line in ["profile", "profile --steps 65535 --json --pulses", "config show", "config schema"] {
        unread(&cell, line);
    }
    let log = cell.path("cell.mcap");
    unread(
        &cell,
        &format!("up --detach --time-scale 20 --config {} --log {}", cell.config().display(), log.display()),
    );
    for line in
        ["status", "status --json", "origin", "move wrist 10", "send 00 05", "input", "output lamp on"]
    {
        unread(&cell, line);
    }
    assert_eq!(cell.axis("wrist")["position"], 10);
    let program = cell.file("program.rhai", "for i in 0..3 { print(\"x\"); move_by(\"wrist\", 10); }");
    unread(&cell, &format!("run {}", program.display()));
    assert_eq!(cell.axis("wrist")["position"], 40);
    unread(&cell, "down");
    cell.assert_nothing_left();
    unread(&cell, &format!("frames {}", log.display()));
    unread(&cell, &format!("frames --json {}", log.display()));
}

#[test]
fn a_set_in_the_foreground_stays_up_when_nobody_reads() {
    let cell = Cell::new(EXE);
    let (reader, writer) = io::pipe().expect("a pipe");
    drop(reader);
    let config = cell.config();
    let mut command =
        cell.command(&["up", "--time-scale", "20", "--config", config.to_str().expect("UTF-8")]);
    let mut daemon = command.stdin(Stdio::null()).stdout(writer).spawn().expect("it runs");
    supersigma_tests::eventually("the set", || (cell.ccu("status").code() == Some(0)).then_some(()));
    cell.ccu("origin wrist").done();
    assert_eq!(cell.down(), None);
    assert!(daemon.wait().expect("a child").success());
}

#[test]
fn what_goes_into_a_pipe_has_no_colours_and_json_has_an_object_a_line() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    let program = cell.file("program.rhai", "origin(\"wrist\"); print(\"here\"); move_by(\"wrist\", 10);");
    let keys = |value: &Value| -> Vec<String> {
        value.as_object().unwrap_or_else(|| panic!("{value} is no object")).keys().cloned().collect()
    };
    let movement = [
        "asked",
        "axis",
        "done",
        "kind",
        "lost",
        "name",
        "position",
        "recovered",
        "seconds",
        "sense",
        "ticks",
    ];
    for (line, lines, stable) in [
        ("origin left_x --json".to_owned(), 1, &movement[..]),
        ("move left_x 10 --json".to_owned(), 1, &movement),
        ("line left_x=10 --json".to_owned(), 1, &movement),
        (
            "status --json".to_owned(),
            7,
            &["activity", "alarm", "alive", "axis", "lost", "name", "position", "sense", "steps"],
        ),
        ("input --json".to_owned(), 1, &["lines", "word"]),
        ("output lamp on --json".to_owned(), 1, &["lines", "word"]),
        ("send 01 05 --json".to_owned(), 1, &["card", "report", "result"]),
        ("profile --json".to_owned(), 1, &["entries", "interval_ticks"]),
    ] {
        let ran = cell.ccu(&line).good();
        let values = ran.json();
        assert_eq!(values.len(), lines, "{ran}");
        for value in &values {
            let there = keys(value);
            assert!(
                stable.iter().all(|key| there.iter().any(|it| it == key)),
                "{value} should have {stable:?}"
            );
        }
        let plain = cell.ccu(&line.replace(" --json", "")).stdout;
        assert!(!plain.is_empty() && !plain.contains('\u{1b}'), "{plain:?}");
    }
    let told = cell.ccu(&format!("run --json {}", program.display())).good().json();
    let told: Vec<String> = told.iter().flat_map(keys).collect();
    assert_eq!(told, ["movement", "print", "movement", "summary"]);
    for wrong in ["move left_x -9999", "move nobody 1", "send 01 7F", "status --name nobody", "fly"] {
        let ran = cell.ccu(wrong);
        assert!(!ran.stderr.is_empty() && !ran.stderr.contains('\u{1b}'), "{ran}");
    }
    assert_eq!(cell.down(), None);
    let frames = cell.frames(&up.log);
    assert!(frames.iter().all(|frame| ["command", "answer"].map(Value::from).contains(&frame["kind"])));
    let people = cell.ccu(&format!("frames {}", up.log.display())).good().stdout;
    assert!(!people.contains('\u{1b}'));
    assert_eq!(people.lines().count(), frames.len() + 1);
}
