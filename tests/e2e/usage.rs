//! What people see when they ask wrongly, and how output behaves in pipes: exit codes, places in files, no stray bytes.

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use supersigma_tests::{Cell, changed, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

#[test]
fn without_a_set_it_is_said_how_to_start_one() {
    let cell = Cell::new(EXE);
    for line in [
        "status",
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
        ("staus", "a similar subcommand exists: 'status'"),
        ("status --jsn", "a similar argument exists: '--json'"),
        ("completions tcsh", "[possible values: bash, elvish, fish, powershell, zsh]"),
        ("config show --json", "--origin"),
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
    for line in [
        "profile",
        "profile --steps 65535 --json --pulses",
        "config show",
        "config show --origin",
        "config schema",
        "completions zsh",
        "man",
        "--help",
        "help move",
        "--version",
    ] {
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
        // The state of the whole set ends with its recorder.
        let values: Vec<_> = ran.json().into_iter().filter(|value| value.get("recorder").is_none()).collect();
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

/// Runs a program of the system that may not be there.
fn outside(program: &str, arguments: &[&str], input: &str) -> Option<Output> {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let Ok(mut child) = command.spawn() else {
        println!("skipped: {program} is not here");
        return None;
    };
    let mut stdin = child.stdin.take().expect("piped");
    let input = input.to_owned();
    let writing = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().expect("it ends");
    // A program that does not read to the end says why on its own.
    let _ = writing.join().expect("no panic");
    Some(output)
}

#[test]
fn completions_are_scripts_of_their_shells() {
    let cell = Cell::new(EXE);
    for (shell, arguments) in [("bash", "-n"), ("zsh", "-n"), ("fish", "--no-execute")] {
        let script = cell.ccu(&format!("completions {shell}")).good().stdout;
        if let Some(output) = outside(shell, &[arguments], &script) {
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success() && said.is_empty(), "{shell}: {said}");
        }
    }
    // What bash completes: the words that `ccu mo` may become.
    let script = cell.ccu("completions bash").good().stdout;
    let ask = "\nCOMP_WORDS=(ccu st); COMP_CWORD=1; _ccu ccu st ccu; echo \"<${COMPREPLY[*]}>\"\n";
    if let Some(output) = outside("bash", &[], &format!("{script}{ask}")) {
        assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "<status>", "{output:?}");
    }
}

#[test]
fn manual_pages_are_written_for_every_command_and_have_no_faults() {
    let cell = Cell::new(EXE);
    let folder = cell.path("man/man1");
    cell.ccu(&format!("man {}", folder.display())).done();
    let mut names = vec![];
    for entry in fs::read_dir(&folder).expect("the pages") {
        let path = entry.expect("a page").path();
        let page = path.to_str().expect("UTF-8");
        if let Some(output) = outside("groff", &["-ww", "-man", "-Tutf8", page], "") {
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success() && said.is_empty(), "{page}: {said}");
        }
        names.push(path.file_name().expect("a file").to_string_lossy().into_owned());
    }
    let help = cell.ccu("--help").good().stdout;
    let listed = help.split("Commands:\n").nth(1).expect("a list").split("\n\n").next().expect("its lines");
    for command in listed.lines().filter_map(|line| line.strip_prefix("  ")?.split(' ').next()) {
        let known = command.is_empty() || command == "help";
        assert!(known || names.contains(&format!("ccu-{command}.1")), "no page of {command}: {names:?}");
    }
    assert!(
        names.contains(&"ccu-config-show.1".into()) && !names.contains(&"ccu-recorder.1".into()),
        "{names:?}"
    );
    let printed = cell.ccu("man").good().stdout;
    assert_eq!(printed, fs::read_to_string(folder.join("ccu.1")).expect("the page"));
    assert!(printed.contains(".SH EXAMPLES"), "{printed}");
    let file = cell.file("taken", "");
    cell.ccu(&format!("man {}", file.display())).fails(1, &["cannot write the manual pages to"]);
}

#[test]
fn failures_are_json_when_json_is_asked_for() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let bad = cell.file("bad.toml", "[ramp]\namplitud = 1.0\n");
    let failed = |line: &str, code: i32| -> Value {
        let ran = cell.ccu(line);
        assert_eq!(ran.code(), Some(code), "{ran}");
        assert_eq!(ran.stdout, "", "{ran}");
        assert_eq!(ran.stderr.lines().count(), 1, "{ran}");
        let mut told: Value =
            serde_json::from_str(&ran.stderr).unwrap_or_else(|error| panic!("{error}: {ran}"));
        let error = told["error"].take();
        let keys: Vec<_> = error.as_object().expect("an object").keys().cloned().collect();
        assert_eq!(keys, ["axis", "code", "exit", "help", "message", "name", "reason", "tick"], "{ran}");
        assert_eq!(error["exit"], code, "{ran}");
        assert!(error["message"].as_str().is_some_and(|message| !message.is_empty()), "{ran}");
        error
    };
    let refused = failed("move left_x 5 --json", 1);
    assert_eq!(
        [&refused["code"], &refused["reason"], &refused["name"]],
        ["refused", "not_originated", "left_x"]
    );
    assert_eq!(refused["axis"], 1);
    assert!(refused["tick"].as_u64().is_some_and(|tick| tick > 0), "{refused}");
    assert_eq!(refused["help"], "originate the axis first: `ccu origin`");
    cell.ccu("brake left_y").done();
    let alarm = failed("origin left_y --json", 1);
    assert_eq!([&alarm["code"], &alarm["reason"]], ["refused", "in_alarm"]);
    for (line, exit, code) in [
        ("move left_x 70000 --json".to_owned(), 2, "too_far"),
        ("move nobody 1 --json".to_owned(), 2, "wrongly_asked"),
        ("move left_x far --json".to_owned(), 2, "usage"),
        ("status --name nobody --json".to_owned(), 3, "no_set"),
        (format!("config check --json {}", bad.display()), 2, "wrongly_asked"),
    ] {
        assert_eq!(failed(&line, exit)["code"], code, "{line}");
    }
    let program = cell.file("program.rhai", "move_by(\"wrist\", 10);\n");
    let of_program = failed(&format!("run --json {}", program.display()), 1);
    assert_eq!([&of_program["code"], &of_program["name"]], ["refused", "wrist"]);
    assert_eq!(cell.down(), None);
}

#[test]
fn a_message_says_which_axis_when_and_what_to_do() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let ran = cell.ccu("move left_x 5");
    ran.fails(
        1,
        &[
            "axis 1 (left_x) refused at ",
            " s: the position is unknown; originate first",
            "help: originate the axis",
        ],
    );
    let program = cell.file("program.rhai", "move_by(\"wrist\", 10);\n");
    cell.ccu(&format!("run {}", program.display()))
        .fails(1, &["program.rhai:1:1", "axis 7 (wrist) refused at ", " s: the position is unknown"]);
    cell.ccu("send 01 01 00 00")
        .fails(1, &["axis 1 (left_x) refused: 0 steps are no movement", "help: ask for 1 step or more"]);
    assert_eq!(cell.down(), None);
}

#[test]
fn narrow_terminals_get_narrow_messages() {
    let cell = Cell::new(EXE);
    for line in
        ["--help", "run --help", "word --help", "status --name nobody", "move", "config check no.toml"]
    {
        let output = cell.command(&words(line)).env("COLUMNS", "60").output().expect("it runs");
        for said in [output.stdout, output.stderr] {
            let said = String::from_utf8(said).expect("UTF-8");
            // Words that are longer than a line, such as examples and usage lines, are not broken.
            let wide = said.lines().find(|line| line.chars().count() > 60 && !line.contains("Usage:"));
            assert_eq!(wide, None, "`{line}`");
        }
    }
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

#[test]
fn every_value_in_force_has_an_origin() {
    let cell = Cell::new(EXE);
    let config = cell.config();
    let shown = cell.ccu(&format!("config show --origin --config {}", config.display())).good().stdout;
    let columns: Vec<Option<usize>> = shown
        .lines()
        .map(|line| line.find(&config.display().to_string()).or_else(|| line.rfind("default")))
        .collect();
    assert!(columns.len() > 100 && columns.iter().all(|column| *column == columns[0]), "{shown}");
    let text = fs::read_to_string(&config).expect("a file");
    let lead = 1 + text.lines().position(|line| line.starts_with("lead_ms")).expect("a line");
    let values = cell.ccu(&format!("config show --origin --json {}", config.display())).good().json();
    assert_eq!(values.len(), columns.len());
    let of =
        |key: &str| values.iter().find(|value| value["key"] == key).unwrap_or_else(|| panic!("no {key}"));
    assert_eq!(of("line.lead_ms")["line"], lead);
    assert_eq!(of("line.lead_ms")["value"], 300);
    assert_eq!(of("axis[0].loop")["file"], Value::Null);
    // Without --origin it is a configuration.
    let effective = cell.ccu(&format!("config show {}", config.display())).good().stdout;
    let path = cell.file("effective.toml", &effective);
    cell.ccu(&format!("config check {}", path.display())).done();
}

#[test]
fn the_schema_agrees_with_an_independent_validator() {
    const SCRIPT: &str = r#"
import json, sys, tomllib
import jsonschema
schema = json.load(open(sys.argv[1]))
kind = jsonschema.validators.validator_for(schema)
kind.check_schema(schema)
for name in sys.argv[2:]:
    errors = list(kind(schema).iter_errors(tomllib.load(open(name, "rb"))))
    print(len(errors))
"#;
    match Command::new("python3").args(["-c", "import jsonschema, tomllib"]).output() {
        Ok(output) if output.status.success() => {}
        _ => {
            println!(
                "skipped: python3.11 with the package `jsonschema` (pip install jsonschema) is not here"
            );
            return;
        }
    }
    let cell = Cell::new(EXE);
    let schema = cell.file("schema.json", &cell.ccu("config schema").good().stdout);
    let built_in = cell.file("built-in.toml", &cell.ccu("config show").good().stdout);
    let effective = cell.ccu(&format!("config show {}", built_in.display())).good().stdout;
    let effective = cell.file("effective.toml", &effective);
    let mut good = vec![built_in.clone(), effective];
    let examples = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../examples");
    for entry in fs::read_dir(examples).expect("the examples") {
        let path = entry.expect("an example").path();
        good.extend((path.extension().is_some_and(|kind| kind == "toml")).then_some(path));
    }
    let text = fs::read_to_string(&built_in).expect("a file");
    let wrong = [
        ("offset = 10 ", "ofset = 10 "),
        ("offset = 10 ", "offset = -1 "),
        ("name = \"wrist\"", "name = \"The Wrist\""),
    ]
    .map(|(from, to)| changed(&text, from, to));
    let wrong = wrong.iter().enumerate().map(|(place, text)| cell.file(&format!("wrong{place}.toml"), text));
    let files: Vec<_> = good.iter().cloned().chain(wrong).collect();
    let output = Command::new("python3")
        .arg("-c")
        .arg(SCRIPT)
        .arg(&schema)
        .args(&files)
        .output()
        .expect("it ran before");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts: Vec<usize> =
        String::from_utf8_lossy(&output.stdout).lines().map(|line| line.parse().expect("a count")).collect();
    for (place, (file, count)) in files.iter().zip(&counts).enumerate() {
        assert_eq!(*count == 0, place < good.len(), "{}: {count} errors", file.display());
    }
    assert_eq!(counts.len(), files.len());
}
