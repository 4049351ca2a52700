//! Logs in the hands of people: what is asked of them, what is asked wrongly, and what is left of them after a crash.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal, Up, eventually};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// A set that has moved two axes and braked one; its complete log.
fn moved(cell: &Cell) -> Up {
    let up = cell.up("20");
    cell.ccu("origin left_x left_y").done();
    cell.ccu("move left_x 1200").done();
    cell.ccu("move left_y 300").done();
    cell.ccu("brake left_x").done();
    assert_eq!(cell.down(), None);
    up
}

#[test]
fn frames_are_found_by_time_axis_and_operation() {
    let cell = Cell::new(EXE);
    let log = moved(&cell).log;
    let all = cell.frames(&log);
    let asked = |options: &str| cell.ccu(&format!("frames {} --json {options}", log.display())).good().json();

    let is_move = |frame: &&Value| frame["operation"] == "Move";
    let moves: Vec<Value> = all.iter().filter(is_move).cloned().collect();
    assert_eq!(moves.len(), 2);
    let shown = asked("--op move");
    let answers: Vec<&Value> = shown.iter().filter(|frame| frame["kind"] == "answer").collect();
    assert_eq!(shown.iter().filter(is_move).cloned().collect::<Vec<_>>(), moves);
    assert_eq!(shown.len(), moves.len() + answers.len());
    assert!(answers.len() >= 2);
    for answer in answers {
        assert!(moves.iter().any(|asked| asked["sequence"] == answer["about"]["command"]), "{answer}");
    }

    let second = |frame: &Value| frame["time_s"].as_f64().expect("a number");
    let [from, to] = [second(&moves[0]), second(&moves[1])];
    let between: Vec<Value> =
        all.iter().filter(|frame| (from..to).contains(&second(frame))).cloned().collect();
    assert!(between.contains(&moves[0]) && !between.contains(&moves[1]));
    assert_eq!(asked(&format!("--from {from} --to {to}")), between);
    let of_y: Vec<Value> = between
        .iter()
        .filter(|frame| ["left_y", "everyone"].iter().any(|name| frame["name"] == *name))
        .cloned()
        .collect();
    assert_eq!(asked(&format!("--from {from} --to {to} --axis left_y")), of_y);

    let table = cell.ccu(&format!("frames {} --csv --op BRAKE", log.display())).good().stdout;
    let rows: Vec<&str> = table.lines().collect();
    assert!(rows[0].starts_with("kind,time_s,tick,sender,sequence,address,name,bytes,operation,"), "{table}");
    assert!(rows[1].starts_with("command,") && rows[1].contains(",left_x,01 07,Brake,"), "{table}");
}

#[test]
fn a_log_tells_what_it_holds() {
    let cell = Cell::new(EXE);
    let log = moved(&cell).log;
    let frames = cell.frames(&log);
    let info = cell.ccu(&format!("log info {} --json", log.display())).good().json().remove(0);
    assert_eq!(
        (&info["state"], &info["set"], &info["gaps"]),
        (&json!("complete"), &json!("cell"), &json!([]))
    );
    assert_eq!(info["frames"]["all"], frames.len());
    let of = |kind: &str| frames.iter().filter(|frame| frame["kind"] == kind).count();
    assert_eq!(info["frames"]["commands"], of("command"));
    let answers = info["frames"]["answers"].as_object().expect("by card").values().filter_map(Value::as_u64);
    assert_eq!(answers.sum::<u64>(), of("answer") as u64);
    assert_eq!(
        (&info["alarms"][0]["axis"], &info["alarms"][0]["alarm"]),
        (&json!("left_x"), &json!("braked on command"))
    );
    let text = cell.ccu(&format!("log info {}", log.display())).good().stdout;
    for says in ["state:    complete", "missing in 0 gaps", "/axis/left_x/status", "braked on command"] {
        assert!(text.contains(says), "{text}");
    }
}

#[test]
fn wrong_questions_are_told_as_such() {
    let cell = Cell::new(EXE);
    let log = moved(&cell).log;
    let log = log.display();
    let text = cell.file("text.mcap", "this is a text");
    for (line, code, says) in [
        (format!("frames {log} --op mvoe"), 2, "did you mean `Move`?"),
        (format!("frames {log} --op dance"), 2, "the operations are `Move`, `MoveLimited`"),
        (format!("frames {log} --axis left_q"), 2, "knows no axis `left_q`"),
        (format!("frames {log} --from soon"), 2, "it is a number of seconds"),
        (format!("frames {log} --from -1"), 2, "it is a number of seconds"),
        (
            format!("frames {log} --from 2 --to 1.5"),
            2,
            "nothing lies between --from 2.0000000 and --to 1.5000000",
        ),
        (format!("frames {log} --json --csv"), 2, "cannot be used with"),
        ("log".to_owned(), 2, "Usage: ccu log <COMMAND>"),
        ("log info no.mcap".to_owned(), 2, "cannot read the log no.mcap"),
        (format!("log info {}", text.display()), 2, "is not a log of this program"),
        (format!("recover {log}"), 2, "--output <FILE>"),
        (format!("recover {log} -o {log}"), 2, "exists already"),
        ("recover no.mcap -o out.mcap".to_owned(), 2, "cannot read the log no.mcap"),
        (format!("recover {} -o out.mcap", text.display()), 1, "is not a log of this program"),
        (format!("recover {log} -o no/such/out.mcap"), 1, "cannot create the log no/such/out.mcap"),
    ] {
        let ran = cell.ccu(&line);
        ran.fails(code, &[says]);
        assert_eq!(ran.stdout, "", "{ran}");
    }
    assert!(!cell.path("out.mcap").exists());
}

#[test]
fn a_recorder_that_was_killed_leaves_a_log_that_can_be_made_whole() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 500").done();
    let so_far = || cell.ccu(&format!("frames --json {}", up.log.display()));
    eventually("the movement in the log", || {
        so_far().json().iter().any(|frame| frame["operation"] == "Move").then_some(())
    });
    cell.recorder().signal(Signal::KILL);
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    cell.ccu("down").done();

    // The crash leaves whole chunks; the disk may leave less.
    let log = fs::read(&up.log).expect("readable");
    fs::write(&up.log, &log[..log.len() - 7]).expect("writable");
    let cut = so_far();
    let help = format!("`ccu recover {} -o FILE` makes a complete log", up.log.display());
    assert!(cut.complaint().contains(&help), "{cut}");
    let info = cell.ccu(&format!("log info {}", up.log.display())).good().stdout;
    assert!(info.contains("state:    cut") && info.contains(&help), "{info}");

    let whole = cell.path("whole.mcap");
    let line = format!("recover {} -o {}", up.log.display(), whole.display());
    let told = cell.ccu(&format!("{line} --json")).good().json().remove(0);
    assert_eq!((&told["complete"], &told["lost"], &told["orphans"]), (&json!(false), &json!([]), &json!(0)));
    assert_eq!(told["frames"], cut.json().len());
    assert_eq!(cell.frames(&whole), cut.json());
    assert_eq!(fs::read(&up.log).expect("readable"), log[..log.len() - 7]);
    cell.ccu(&line).fails(2, &["whole.mcap exists already"]);
    python_reads(&whole, &told);

    // Of a complete log a copy is made.
    let copy = cell.path("copy.mcap");
    let told = cell.ccu(&format!("recover {} -o {}", whole.display(), copy.display())).good().stdout;
    assert!(told.contains("is complete; nothing was to be done"), "{told}");
    assert_eq!(cell.frames(&copy), cut.json());

    // A damaged chunk in the middle is told, and costs only itself.
    let mut damaged = fs::read(&whole).expect("readable");
    let marks = damaged.windows(8).enumerate().filter(|(_, bytes)| bytes == b"\x04\0\0\0zstd");
    let marks: Vec<usize> = marks.map(|(at, _)| at).collect();
    // Half of them are in the index at the end; the second chunk of the rest has frames in it.
    damaged[marks[2] + 30] ^= 0xFF;
    let damaged = {
        fs::write(cell.path("damaged.mcap"), damaged).expect("writable");
        cell.path("damaged.mcap")
    };
    let shown = cell.ccu(&format!("frames {}", damaged.display()));
    shown.fails(2, &["is damaged after frame", "`ccu recover"]);
    let mended = cell.path("mended.mcap");
    let told = cell.ccu(&format!("recover {} -o {}", damaged.display(), mended.display())).good().stdout;
    assert!(told.contains("lost:      bytes ") && told.contains("frames are missing there"), "{told}");
    let left = cell.frames(&mended).len();
    assert!(0 < left && left < cut.json().len());
    cell.assert_nothing_left();
}

#[test]
fn a_reader_may_leave_early() {
    let cell = Cell::new(EXE);
    let log = moved(&cell).log;
    for options in [&["--json"][..], &["--csv"], &[]] {
        let mut command = cell.command(&["frames"]);
        command.arg(&log).args(options).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        let mut first = [0; 1];
        let mut out = child.stdout.take().expect("piped");
        out.read_exact(&mut first).expect("a line");
        drop(out);
        let output = child.wait_with_output().expect("it ends");
        assert_eq!((output.status.code(), &*output.stderr), (Some(0), &b""[..]));
    }
}

/// The format's own Python package reads a recovered log by its index.
fn python_reads(log: &Path, told: &Value) {
    const READ: &str = r#"
import json, sys
from mcap.reader import make_reader
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    frames = sum(1 for _ in reader.iter_messages(topics=["/microbus"]))
    messages = sum(1 for _ in reader.iter_messages())
    names = sorted(attachment.name for attachment in reader.iter_attachments())
    metadata = [record.name for record in reader.iter_metadata()]
print(json.dumps({
    "frames": frames, "messages": messages, "counted": summary.statistics.message_count,
    "chunks": len(summary.chunk_indexes), "names": names, "metadata": metadata,
}))
"#;
    let python = |arguments: &[&str]| Command::new("python3").args(arguments).output();
    if !python(&["-c", "import mcap"]).is_ok_and(|output| output.status.success()) {
        println!("skipped: python3 with the package `mcap` (pip install mcap) is not here");
        return;
    }
    let output = python(&["-c", READ, log.to_str().expect("UTF-8")]).expect("it ran before");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    for key in ["frames", "messages", "chunks"] {
        assert_eq!(read[key], told[key], "{key}");
    }
    assert_eq!(read["counted"], told["messages"]);
    assert_eq!((&read["names"], &read["metadata"]), (&json!(["config.toml"]), &json!(["supersigma"])));
}
