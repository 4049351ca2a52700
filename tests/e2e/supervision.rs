//! Processes that end unasked come back: workers as cards just switched on, the recorder with another file.

use std::fs;

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal, changed, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

#[test]
fn a_killed_worker_comes_back_and_does_not_know_where_its_axis_is() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    cell.ccu("origin left_x left_y").done();
    cell.ccu("move left_x 500").done();
    let before = cell.process_row("left_y");
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
    let after = cell.until_back("left_y", 1);
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
        cell.until_back("digital", restarts);
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
    eventually("the beginning is in the file", || {
        let frames = cell.ccu(&format!("frames --json {}", up.log.display()));
        frames.stdout.contains("Originate").then_some(())
    });
    cell.recorder().signal(Signal::KILL);
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    cell.until_back("recorder", 1);
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
    // What the daemon had to say of it while nobody wrote it down is at the beginning of the second.
    let bytes = fs::read(&second).expect("the log");
    let mut messages =
        mcap::MessageStream::new(&bytes).expect("a log").map(|message| message.expect("whole"));
    let gone =
        |message: mcap::Message| String::from_utf8_lossy(&message.data).contains("the recorder is gone");
    assert!(messages.any(|message| message.channel.topic == "/events" && gone(message)));
    // Whoever verifies the first one is told that there is more, which is not verified.
    let first = cell.ccu(&format!("replay --verify {}", up.log.display()));
    assert_eq!(first.code(), Some(0), "{first}");
    assert!(first.complaint().contains("ends in the middle of a record"), "{first}");
    assert!(first.complaint().contains(&format!("the log goes on in {}", second.display())), "{first}");
    let result = cell.ccu(&format!("replay --verify --json {}", up.log.display())).json().remove(0);
    assert_eq!((&result["result"], &result["goes_on_in"]), (&json!("identical"), &json!(second)));
}

#[test]
fn without_restarts_who_is_gone_stays_gone() {
    let cell = Cell::new(EXE);
    fs::write(cell.config(), changed(&patient(), "restart = true ", "restart = false "))
        .expect("a configuration");
    let _up = cell.up("20");
    cell.ccu("kill-worker left_y").done();
    eventually("left_y is gone", || Some(cell.process_row("left_y")).filter(|row| row["state"] == "ended"));
    cell.ccu("kill-worker left_y").fails(1, &["the worker of left_y has no process just now"]);
    cell.ccu("kill-worker left_q").fails(2, &["no axis \"left_q\"", "left_y"]);
    let _ = cell.down();
}

#[test]
fn processes_come_back_although_the_program_has_been_replaced() {
    let cell = Cell::new(EXE);
    let installed = cell.path("installed");
    fs::copy(EXE, &installed).expect("a copy");
    let first = cell.with_program(&installed);
    let up = first.up("20");
    fs::remove_file(&installed).expect("it is there");
    fs::write(&installed, "another program").expect("writable");
    cell.ccu("origin left_x").done();
    cell.ccu("kill-worker left_y").done();
    cell.until_back("left_y", 1);
    cell.recorder().signal(Signal::KILL);
    cell.until_back("recorder", 1);
    cell.ccu("clear").done();
    cell.ccu("origin left_y").done();
    // They bear the name of the program, not of the way in which they were started.
    for process in cell.processes() {
        let name = fs::read_to_string(format!("/proc/{}/comm", process.pid)).expect("it runs");
        assert_eq!(name.trim_end(), "ccu", "{process:?}");
        assert_eq!(process.arguments[0], installed.display().to_string());
    }
    let down = cell.ccu("down").good();
    assert!(down.stdout.contains("cell.2.mcap"), "{down}");
    cell.assert_nothing_left();
    assert!(up.log.exists());
}
