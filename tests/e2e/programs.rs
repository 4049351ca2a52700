//! Programs, as a user runs them: on sets of their own, faster than real time, and dry. What a program does depends on
//! none of that, to the last step and the last tick, and every frame of it is in the log.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use supersigma_tests::Cell;

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// All seven axes, with single movements, one at constant speed, a line, and the digital cards.
const PROGRAM: &str = r#"
origin();
go_to("left_x", 1200);
move_by(2, 800, 4000);
slew("left_z", 150, 700);
line(#{ right_x: 3001, "5": 1777, right_z: 1, wrist: 240 });
output("left_gripper", true);
wait_for("left_grasped", true, 5.0);
print(`left_x at ${position("left_x")}`);
reference("wrist");
move_by("left_x", -1200);
"#;

/// Movements in JSON, and the summary.
fn told(cell: &Cell, line: &str) -> (Vec<Value>, Value) {
    let mut lines = cell.ccu(line).json();
    let summary = lines.pop().expect("the summary")["summary"].clone();
    let movements = lines.iter().filter_map(|line| line.get("movement")).cloned();
    (movements.collect(), summary)
}

/// Runs a program on a set of its own, and looks at what it leaves.
fn live(cell: &Cell, program: &Path, scale: u32) -> (Vec<Value>, Vec<Value>) {
    let log = cell.path(&format!("at-{scale}.mcap"));
    let (config, program) = (cell.config(), program.display());
    let options = format!("--time-scale {scale} --config {} --log {}", config.display(), log.display());
    let (movements, summary) = told(cell, &format!("run --json {options} {program}"));
    cell.assert_nothing_left();
    let frames = cell.frames(&log);
    assert_eq!(summary["frames_sent"], frames.len());
    assert_eq!(summary["frames_logged"], frames.len());
    assert_eq!(summary["movements"], movements.len());
    assert_eq!(summary["log"], log.to_str().expect("UTF-8"));
    (movements, frames)
}

#[test]
fn a_program_does_the_same_at_every_speed_and_dry() {
    let cell = Cell::new(EXE);
    let program = cell.file("program.rhai", PROGRAM);
    let (movements, frames) = live(&cell, &program, 20);
    let of = |kind: &str| movements.iter().filter(|movement| movement["kind"] == kind).collect::<Vec<_>>();
    let originated: BTreeSet<u64> = of("origin").iter().filter_map(|one| one["axis"].as_u64()).collect();
    assert_eq!(originated, (1..=7).collect());
    for origin in of("origin") {
        assert_eq!((&origin["position"], &origin["asked"]), (&json!(0), &Value::Null), "{origin}");
    }
    let asked = |kind: &str| -> Vec<(Value, Value, Value, Value)> {
        let fields = |one: &&Value| {
            assert_eq!(one["sense"].as_str().map(|sense| &sense[..4]), Some("0001"), "{one}");
            (one["name"].clone(), one["asked"].clone(), one["done"].clone(), one["position"].clone())
        };
        of(kind).iter().map(fields).collect()
    };
    let row = |name: &str, asked: i32, position: i32| {
        (json!(name), json!(asked), json!(asked.abs()), json!(position))
    };
    assert_eq!(asked("move"), [row("left_x", 1200, 1200), row("left_y", 800, 800), row("left_x", -1200, 0)]);
    assert_eq!(asked("slew"), [row("left_z", 150, 150)]);
    assert_eq!(
        asked("line"),
        [
            row("right_x", 3001, 3001),
            row("right_y", 1777, 1777),
            row("right_z", 1, 1),
            row("wrist", 240, 240)
        ]
    );
    // The wrist's reference step lies at 500, its origin at 301.
    let reference = of("reference");
    assert_eq!(
        (reference.len(), &reference[0]["position"], &reference[0]["sense"]),
        (1, &json!(199), &json!("00110"))
    );
    assert!(frames.iter().any(|frame| frame["operation"] == "WriteOutputs" && frame["word"] == 1));

    // Even the ticks that each movement takes are the same: the machine knows nothing of the time scale.
    assert_eq!(live(&cell, &program, 5).0, movements);
    let log = cell.path("dry.mcap");
    let dry = format!("run --json --dry-run --log {} {}", log.display(), program.display());
    let (dry, summary) = told(&cell, &dry);
    assert_eq!(dry, movements);
    assert_eq!(summary["frames_logged"], cell.frames(&log).len());
    cell.assert_nothing_left();
    assert!(!cell.has_default_log(), "logs went where they should");
}

#[test]
fn people_see_a_line_a_movement_and_a_sum() {
    let cell = Cell::new(EXE);
    let ran = cell.run(&[
        "run",
        "--time-scale",
        "20",
        "--config",
        cell.config().to_str().expect("UTF-8"),
        "-e",
        r#"origin("wrist"); move_by("wrist", 400); print("half way"); line(#{ wrist: -100 });"#,
    ]);
    assert_eq!(ran.code(), Some(0), "{ran}");
    assert!(ran.stderr.starts_with("set cell is up in "), "{ran}");
    let lines: Vec<Vec<&str>> = ran.stdout.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[0], ["axis", "movement", "asked", "done", "X1..X5", "seconds", "position"]);
    assert_eq!((lines[1][0], lines[1][1], lines[1][2], lines[1][6]), ("wrist", "origin", "-", "0"));
    assert_eq!((&lines[2][..5], lines[2][6]), (&["wrist", "move", "+400", "400", "00010"][..], "400"));
    assert_eq!(lines[3], ["half", "way"]);
    assert_eq!((&lines[4][..4], lines[4][6]), (&["wrist", "line", "-100", "100"][..], "300"));
    let steps: u32 = 400 + 100 + lines[1][3].parse::<u32>().expect("steps");
    assert!(ran.stdout.contains(&format!("\n3 movements, {steps} steps, ")), "{ran}");
    // Nobody has named a log, so it is where logs go.
    let log = ran.stdout.lines().find_map(|line| line.strip_prefix("log:    ")).expect("the log is named");
    let log = log.split(" (").next().expect("a path");
    assert!(log.starts_with(cell.path("state/supersigma/cell-").to_str().expect("UTF-8")), "{log}");
    let frames = cell.frames(Path::new(log)).len();
    assert!(ran.stdout.contains(&format!("frames: {frames} sent, {frames} logged")), "{ran}");
    cell.assert_nothing_left();
}

/// An example does live what it does dry; gives what it printed last.
fn example(name: &str) -> Option<String> {
    let cell = Cell::new(EXE);
    let program = format!("{EXAMPLES}/{name}.rhai");
    let dry = cell.ccu(&format!("run --json --dry-run {program}")).good().json();
    let options = format!("--time-scale 50 --config {}", cell.config().display());
    let live = cell.ccu(&format!("run --json {options} {program}")).json();
    cell.assert_nothing_left();
    let done = |lines: &[Value]| -> Vec<Value> {
        let totals = |line: &&Value| line.get("summary").is_some() || line.get("timing").is_some();
        lines.iter().filter(|line| !totals(line)).map(timeless).collect()
    };
    assert_eq!(done(&live), done(&dry));
    live.iter().filter_map(|line| line["print"].as_str()).next_back().map(str::to_owned)
}

/// What is printed of a failure, without its machine time: a live set's begins earlier.
fn timeless(line: &Value) -> Value {
    match line["print"].as_str().and_then(|text| text.split_once(" refused at ")) {
        Some((whom, why)) => {
            json!({ "print": format!("{whom} refused {}", why.split_once(": ").expect("a reason").1) })
        }
        None => line.clone(),
    }
}

#[test]
fn the_assembly_runs() {
    assert_eq!(example("assembly").as_deref(), Some("2 screws driven"));
}

#[test]
fn the_lines_run() {
    assert_eq!(example("lines").as_deref(), Some("at 19919, 7987"));
}

#[test]
fn the_recovery_runs() {
    assert_eq!(example("recover").as_deref(), Some("the wrist is at 5000"));
}

#[test]
fn a_dry_run_writes_every_pulse_in_order_and_twice_the_same() {
    let cell = Cell::new(EXE);
    let program = cell.file("program.rhai", PROGRAM);
    let run = |file: &str| {
        let pulses = cell.path(file);
        let line = format!("run --json --dry-run --pulses {} {}", pulses.display(), program.display());
        (told(&cell, &line), fs::read_to_string(pulses).expect("the pulses"))
    };
    let ((movements, summary), pulses) = run("pulses.csv");
    let mut steps: BTreeMap<u64, u64> = BTreeMap::new();
    for movement in &movements {
        let count = |key: &str| movement[key].as_u64().expect(key);
        *steps.entry(count("axis")).or_default() += count("done");
    }
    assert_eq!(steps.values().sum::<u64>(), summary["steps"].as_u64().expect("steps"));
    let mut lines = pulses.lines();
    assert_eq!(lines.next(), Some("tick,axis,position"));
    let mut counted: BTreeMap<u64, u64> = BTreeMap::new();
    let mut before: BTreeMap<u64, (u64, i64)> = BTreeMap::new();
    let mut now = 0;
    for line in lines {
        let fields: Vec<i64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
        let (tick, axis) = (fields[0].unsigned_abs(), fields[1].unsigned_abs());
        assert!(tick >= now, "{line} comes after tick {now}");
        now = tick;
        if let Some((earlier, position)) = before.insert(axis, (tick, fields[2])) {
            // 133 ticks are 15 037 steps/s, the top of the ramp; a pulse is a step.
            assert!(tick >= earlier + 133, "{line} comes too soon after {earlier}");
            assert_eq!((fields[2] - position).abs(), 1, "{line}");
        }
        *counted.entry(axis).or_default() += 1;
    }
    assert_eq!(counted, steps);
    assert!(run("again.csv").1 == pulses, "two dry runs of one program differ");
}

#[test]
fn a_program_runs_on_a_set_that_is_up() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    let program = cell.file("program.rhai", "origin(\"wrist\");\nmove_by(\"wrist\", 400);\n");
    let (movements, summary) = told(&cell, &format!("run --json {}", program.display()));
    assert_eq!((movements.len(), &summary["movements"], &summary["log"]), (2, &json!(2), &Value::Null));
    assert_eq!(cell.axis("wrist")["position"], 400);
    // How a set is started, and where it logs, was said when it was started.
    let other = cell.path("other.mcap");
    cell.ccu(&format!("run --log {} {}", other.display(), program.display()))
        .fails(2, &["set cell is up already", "--log", "`ccu down --name cell`"]);
    assert!(!other.exists());
    assert_eq!(cell.axis("wrist")["position"], 400);
    assert_eq!(cell.down(), None);
    let moves = cell.frames(&up.log);
    assert_eq!(moves.iter().filter(|frame| frame["operation"] == "Move").count(), 1);
}
