//! Programs that move several axes at once on a live set, what stops them, what `ccu check` says, and conversations.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Stdio};

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// Two axes on a long way at once, and a program that does something else meanwhile.
const LONG: &str = r#"
origin(["left_x", "left_y"]);
let h = begin { move_by("left_x", 60000, 4000); move_by("left_y", 30000, 3000); };
print("ready");
WAIT;
print("over");
"#;

fn long(cell: &Cell, wait: &str) -> String {
    cell.file("long.rhai", &LONG.replace("WAIT", wait)).display().to_string()
}

fn on_their_way(cell: &Cell) {
    for axis in ["left_x", "left_y"] {
        cell.until(axis, "at its speed", |axis| axis["activity"] == "cruising");
    }
}

/// Both axes stand short of where they were to go.
fn stand(cell: &Cell) {
    for (axis, to) in [("left_x", 60_000), ("left_y", 30_000)] {
        let axis = cell.until(axis, "stands", |axis| axis["activity"] == "standing");
        let position = axis["position"].as_i64().expect("the position is kept");
        assert!(0 < position && position < to, "{axis}");
        assert_eq!(axis["alarm"], Value::Null);
    }
}

#[test]
fn movements_of_one_block_overlap_on_a_live_set() {
    let cell = Cell::new(EXE);
    let up = cell.up("5");
    let program = cell.file(
        "together.rhai",
        r#"origin(["left_x", "left_y", "wrist"]);
        let began = now();
        let moved = together { move_by("left_x", 20000); move_by("left_y", 15000); go_to("wrist", 3000); };
        for one in moved { print(`${one.axis} ${one.start - began} ${one.seconds}`) }"#,
    );
    let lines = cell.ccu(&format!("run --json {}", program.display())).good().json();
    let spans: Vec<(String, f64, f64)> = lines
        .iter()
        .filter_map(|line| line["print"].as_str())
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            let number = |at: usize| words[at].parse::<f64>().expect("a number");
            (words[0].to_owned(), number(1), number(1) + number(2))
        })
        .collect();
    assert_eq!(
        spans.iter().map(|(axis, ..)| axis.as_str()).collect::<Vec<_>>(),
        ["left_x", "left_y", "wrist"]
    );
    let last_start = spans.iter().map(|(_, start, _)| *start).fold(0.0, f64::max);
    for (axis, start, end) in &spans {
        assert!(0.0 < *start && last_start < *end, "{axis}: {spans:?}");
    }
    assert_eq!(cell.down(), None);
    // The bus has seen it too: all three were commanded before the first of them stood again.
    let frames = cell.frames(&up.log);
    let place = |is: &dyn Fn(&Value) -> bool| frames.iter().rposition(is).expect("such a frame");
    let moves = |axis: u64| place(&|frame| frame["to"] == axis && frame["operation"] == "Move");
    let begun = [1, 2, 7].map(moves);
    let last = begun.into_iter().max().expect("three");
    for (axis, steps) in [(1, 20_000), (2, 15_000), (7, 3_000)] {
        let is_end = |frame: &Value| {
            frame["axis"] == axis && frame["activity"] == "standing" && frame["steps"] == steps
        };
        let end = frames.iter().position(is_end).expect("its end");
        assert!(end > last, "axis {axis} had ended before the last began");
    }
}

#[test]
fn ctrl_c_halts_everything_that_was_begun() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    let mut running = cell.start(&format!("run {}", long(&cell, "wait(1000)")));
    running.says("ready");
    on_their_way(&cell);
    running.signal(Signal::INT);
    let ran = running.end();
    assert_eq!(ran.code(), Some(1), "{ran}");
    assert!(ran.complaint().contains("interrupted") && !ran.stdout.contains("over"), "{ran}");
    stand(&cell);
    assert_eq!(cell.down(), None);
}

#[test]
fn a_killed_program_leaves_nothing_moving() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    // It waits for the movements themselves.
    let mut running = cell.start(&format!("run {}", long(&cell, "wait(h)")));
    running.says("ready");
    on_their_way(&cell);
    running.signal(Signal::KILL);
    assert_eq!(running.end().signal(), Some(9));
    stand(&cell);
    assert_eq!(cell.down(), None);
}

#[test]
fn what_somebody_halts_waits_to_be_resumed_and_the_program_with_it() {
    let cell = Cell::new(EXE);
    let _up = cell.up("10");
    let mut running = cell.start(&format!("run --json {}", long(&cell, "wait(h)")));
    running.says("ready");
    on_their_way(&cell);
    cell.ccu("halt").done();
    stand(&cell);
    // Once the program has noticed, there is something to resume.
    supersigma_tests::eventually("something to resume", || {
        (cell.ccu("resume").code() == Some(0)).then_some(())
    });
    let ran = running.end().good();
    let moved: Vec<Value> = ran.json().into_iter().filter_map(|line| line.get("movement").cloned()).collect();
    let ends: Vec<(&Value, &Value)> = moved
        .iter()
        .filter(|one| one["kind"] == "move")
        .map(|one| (&one["done"], &one["position"]))
        .collect();
    assert_eq!(ends, [(&json!(60_000), &json!(60_000)), (&json!(30_000), &json!(30_000))]);
    assert_eq!(cell.down(), None);
}

#[test]
fn check_tells_all_problems_at_once_and_where() {
    let cell = Cell::new(EXE);
    let program = cell.file(
        "bad.rhai",
        "let far = param(\"far\", 60000);\norigin();\ngo_to(\"lef_x\", far);\nmove_by(\"wrist\", 0);\n\
         go_to(\"left_y\", far);\n",
    );
    let program = program.display().to_string();
    let ran = cell.run(&["check", "bad.rhai"]);
    ran.fails(2, &["did you mean `left_x`?", "bad.rhai: 2 problems"]);
    let drawn = "   ╭─[bad.rhai:3:7]\n 2 │ origin();\n 3 │ go_to(\"lef_x\", far);\n   ·       ───┬───\n   \
                 ·          ╰── here\n 4 │ move_by(\"wrist\", 0);\n   ╰────\n";
    assert!(ran.stderr.contains(drawn), "{ran}");

    let ran = cell.run(&["check", "--json", &program]);
    assert_eq!(ran.code(), Some(2), "{ran}");
    let places: Vec<(Value, Value, Value)> = ran
        .json()
        .iter()
        .map(|problem| (problem["line"].clone(), problem["column"].clone(), problem["kind"].clone()))
        .collect();
    let row = |line: u64, column: u64| (json!(line), json!(column), json!("script"));
    assert_eq!(places, [row(3, 7), row(4, 18)]);

    // What is computed is found by the rehearsal, and so is what a parameter does.
    let program = "origin(); let far = param(\"far\", 6000); go_to(\"wrist\", far + 1)";
    assert_eq!(cell.run(&["check", "-e", program]).good().stdout, "-e: nothing is wrong\n");
    cell.run(&["check", "-e", program, "--set", "far=6500"])
        .fails(2, &["-e:1:41", "target 6501 is outside the travel 0 to 6500", "1 problem"]);
    cell.run(&["check", "-e", program, "--set", "fur=1"]).fails(2, &["did you mean `far`?"]);
    cell.run(&["check", "-e", program, "--set", "far=x"]).fails(2, &["must be a whole number, not \"x\""]);
    cell.run(&["run", "-e", program, "--set", "far"]).fails(2, &["laps=3"]);
    cell.run(&["check", "-e", "move_by(1, 5)"]).fails(2, &["originate first"]);
    cell.run(&["check", "--originated", "-e", "move_by(1, 5)"]).done();
    assert!(!cell.has_default_log() && cell.processes().is_empty(), "nothing was started");
}

/// A conversation through pipes.
fn conversation(cell: &Cell, arguments: &[&str]) -> Child {
    let mut command = cell.command(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("it starts")
}

fn say(child: &mut Child, text: &str) {
    let input = child.stdin.as_mut().expect("a pipe");
    input.write_all(text.as_bytes()).and_then(|()| input.flush()).expect("it reads");
}

#[test]
fn a_conversation_keeps_what_was_said_and_goes_on_after_an_error() {
    let cell = Cell::new(EXE);
    let mut child = conversation(&cell, &["repl", "--dry-run"]);
    say(
        &mut child,
        "let n = 400\nfn twice(a) {\n  a * 2\n}\nmov_by(1)\norigin(\"wrist\")\nmove_by(\"wrist\", twice(n))\n\
         position(\"wrist\")\n[1, \"a\"]\nexit()\nprint(\"never\")\n",
    );
    let output = child.wait_with_output().expect("it ends");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "the first error's: {err}");
    assert!(err.contains("did you mean `move_by`?") && err.contains("[repl:5:1]"), "{err}");
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines.len(), 5, "{out}");
    assert!(lines[2].contains("+800"), "{out}");
    assert_eq!(lines[3..], ["800", "[1, \"a\"]"]);
    cell.ccu("repl").fails(3, &["no set named \"cell\" is up"]);
}

#[test]
fn ctrl_c_in_a_conversation_halts_what_moves_and_the_conversation_goes_on() {
    let cell = Cell::new(EXE);
    let _up = cell.up("2");
    let mut child = conversation(&cell, &["repl"]);
    say(
        &mut child,
        "origin(\"left_x\")\nlet h = begin { move_by(\"left_x\", 60000, 4000) }\nprint(\"ready\")\nwait(h)\n",
    );
    let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
    let mut line = String::new();
    while line.trim_end() != "ready" {
        line.clear();
        assert!(out.read_line(&mut line).expect("it says something") > 0, "it has ended");
    }
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    let pid = i32::try_from(child.id()).expect("a process number");
    let process = cell.processes().into_iter().find(|process| i32::try_from(process.pid) == Ok(pid));
    process.expect("it lives").signal(Signal::INT);
    let axis = cell.until("left_x", "stands", |axis| axis["activity"] == "standing");
    assert!(axis["position"].as_i64().is_some_and(|position| 0 < position && position < 60_000), "{axis}");
    say(&mut child, "go_to(\"left_x\", 0)\nprint(position(\"left_x\"))\n");
    drop(child.stdin.take());
    let rest: Vec<String> = out.lines().map(|line| line.expect("UTF-8")).collect();
    assert_eq!(rest.last().map(String::as_str), Some("0"), "{rest:?}");
    assert_eq!(child.wait().expect("it ends").code(), Some(1));
    assert_eq!(cell.down(), None);
}
