//! The recorder loses nothing, and says so when it must: floods, a recorder that stands still, one that is killed, disks
//! that are full, folders that cannot be written to, and logs in several files.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Resource, Rlimit, geteuid, prlimit};
use serde_json::{Value, json};
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{BUFFER_FRAMES, Bus, Tap};
use supersigma_protocol::{Frame, Sender, Sequence, Tick};
use supersigma_tests::{Cell, Signal, Up, changed, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// The recorder as `ccu status --json` shows it.
fn recorder(cell: &Cell) -> Value {
    let mut lines = cell.ccu("status --json").good().json();
    assert_eq!(lines.len(), 8, "seven axes and the recorder: {lines:?}");
    lines.remove(7)["recorder"].take()
}

fn until_recorder(cell: &Cell, what: &str, seen: impl Fn(&Value) -> bool) -> Value {
    eventually(&format!("the recorder {what}"), || Some(recorder(cell)).filter(&seen))
}

/// Asks for a card's status again and again, over one connection.
fn flood(cell: &Cell, card: u8, times: usize) {
    let mut socket = UnixStream::connect(cell.runtime().join("control.sock")).expect("the daemon listens");
    let mut answers = BufReader::new(socket.try_clone().expect("a socket")).lines();
    for _ in 0..times {
        writeln!(socket, "{}", json!({ "do": { "send": { "bytes": [card, 5] } } }))
            .expect("the daemon reads");
        let answer = answers.next().expect("the daemon answers").expect("a line");
        assert!(answer.contains("answers"), "{answer}");
    }
}

/// Sent, logged and missing frames in what `ccu down` says.
fn sums(stdout: &str) -> (u64, u64, u64) {
    let number = |before: &str, after: &str| {
        let rest = stdout.split(before).nth(1)?;
        rest.split(after).next()?.trim().parse().ok()
    };
    let missing = number("logged\n", "are missing").unwrap_or(0);
    (number("frames:", "sent").expect(stdout), number("sent,", "logged").expect(stdout), missing)
}

/// The numbers of each sender in a log's frames, in order.
fn numbers(frames: &[Value]) -> BTreeMap<String, Vec<u64>> {
    let mut numbers: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for frame in frames {
        let sender = frame["sender"].as_str().expect("a sender").to_owned();
        numbers.entry(sender).or_default().push(frame["sequence"].as_u64().expect("a number"));
    }
    numbers
}

/// A set whose recorder has stood still while more commands were sent than its buffer holds.
fn with_a_gap(on_loss: &str) -> (Cell, Up, Value) {
    let cell = Cell::new(EXE);
    let config = changed(&patient(), "on_loss = \"warn\"", &format!("on_loss = \"{on_loss}\""));
    fs::write(cell.config(), config).expect("a configuration");
    let up = cell.up("20");
    cell.ccu("origin left_x").done();
    let process = cell.recorder();
    process.signal(Signal::STOP);
    flood(&cell, 1, BUFFER_FRAMES + 100);
    assert_eq!(recorder(&cell)["lost"], 0, "it cannot know yet");
    process.signal(Signal::CONT);
    // The gap shows with the next frame that gets through.
    flood(&cell, 1, 1);
    let seen = until_recorder(&cell, "has seen the gap", |recorder| recorder["lost"].as_u64() > Some(0));
    (cell, up, seen)
}

#[test]
fn a_gap_in_the_log_is_counted_and_told_and_motion_goes_on() {
    let (cell, up, seen) = with_a_gap("warn");
    assert_eq!((&seen["state"], &seen["trouble"]), (&json!("recording"), &Value::Null));
    let status = cell.ccu("status").good();
    assert!(status.stdout.contains(" FRAMES ARE MISSING"), "{status}");
    cell.ccu("move left_x 100").done();

    let down = cell.ccu("down").good();
    let (sent, logged, missing) = sums(&down.stdout);
    assert!(missing >= 100 && sent == logged + missing, "{down}");
    let said = fs::read_to_string(cell.runtime().with_extension("messages")).expect("it is worth a word");
    assert!(said.contains("frames are missing from the log; motion goes on"), "{said}");
    assert!(said.contains("frames are missing from the log sender=CCU"), "{said}");
    // The log tells the truth about itself: what is missing in its numbers is what its events say.
    let frames = cell.frames(&up.log);
    let holes: u64 =
        numbers(&frames).values().map(|numbers| numbers[numbers.len() - 1] + 1 - numbers.len() as u64).sum();
    assert_eq!((frames.len() as u64, holes), (logged, missing));
    let bytes = fs::read(&up.log).expect("the log");
    let told = mcap::MessageStream::new(&bytes)
        .expect("MCAP")
        .map(|message| message.expect("whole"))
        .filter(|message| message.channel.topic == "/events")
        .map(|message| serde_json::from_slice::<Value>(&message.data).expect("JSON"))
        .filter(|event| {
            event["message"].as_str().is_some_and(|text| text.contains("are missing from the log: number"))
        })
        .map(|event| {
            assert_eq!(event["level"], 4, "{event}");
            let text = event["message"].as_str().expect("text");
            text.split(' ').next().and_then(|number| number.parse::<u64>().ok()).expect("a number")
        })
        .sum::<u64>();
    assert_eq!(told, missing);
    cell.assert_nothing_left();
}

#[test]
fn a_gap_in_the_log_stops_the_set_if_that_is_wanted() {
    let (cell, _, _) = with_a_gap("stop");
    let stopped = until_recorder(&cell, "stops the set", |recorder| !recorder["trouble"].is_null());
    assert_eq!(stopped["state"], "recording");
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    cell.ccu("clear").done();
    cell.ccu("move left_x 10").fails(
        1,
        &["frames are missing from the log", "(log.on_loss is \"stop\")", "nothing moves without a log"],
    );
    let (sent, logged, missing) = sums(&cell.ccu("down").good().stdout);
    assert!(missing > 0 && sent == logged + missing);
    cell.assert_nothing_left();
}

/// Seven axes, twenty times faster than real time, as fast as they go.
const DANCE: &str = "
origin();
for turn in 0..25 {
    line(#{ left_x: 300, left_y: 290, left_z: 280, right_x: 270, right_y: 260, right_z: 250, wrist: 240 });
    line(#{ left_x: -300, left_y: -290, left_z: -280, right_x: -270, right_y: -260, right_z: -250, wrist: -240 });
}
";

#[test]
fn at_full_speed_nothing_is_lost_and_the_files_are_one_log() {
    let cell = Cell::new(EXE);
    let program = cell.file("dance.rhai", DANCE);
    let log = cell.path("dance.mcap");
    let line = format!(
        "run --json --time-scale 20 --config {} --log {} --log-rotate 0.1MB {}",
        cell.config().display(),
        log.display(),
        program.display()
    );
    let told = cell.ccu(&line).good().json();
    let summary = &told.last().expect("a summary")["summary"];
    assert_eq!(summary["movements"], 7 + 25 * 2 * 7);
    assert_eq!((&summary["frames_lost"], &summary["frames_sent"]), (&json!(0), &summary["frames_logged"]));
    let parts: Vec<PathBuf> = serde_json::from_value(summary["log_parts"].clone()).expect("paths");
    assert!(parts.len() > 1, "{summary}");
    assert_eq!((&parts[0], &parts[1]), (&log, &cell.path("dance.2.mcap")));
    let frames: Vec<Value> = parts.iter().flat_map(|part| cell.frames(part)).collect();
    assert_eq!(summary["frames_logged"], frames.len());
    let numbers = numbers(&frames);
    assert_eq!(numbers.len(), 9, "the CCU, seven axes, the digital cards");
    for (sender, numbers) in numbers {
        assert!((0..numbers.len() as u64).eq(numbers), "{sender} has a gap, or a frame twice");
    }
    cell.assert_nothing_left();
}

#[test]
fn a_killed_recorder_has_lost_the_last_moment_only() {
    let cell = Cell::new(EXE);
    let up = cell.up("1");
    // Another listener on the bus is the witness.
    let bus = SharedBus::join(&Place::new(cell.runtime()).expect("short enough")).expect("the bus");
    let mut tap = bus.tap().expect("room for a tap");
    cell.ccu("origin left_x left_y").done();
    for line in
        ["move left_x 60000 --speed 4000 --no-wait", "move left_y 20000 --constant --speed 650 --no-wait"]
    {
        cell.ccu(line).done();
    }
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    let (over, mut seen) = (AtomicBool::new(false), Vec::new());
    thread::scope(|scope| {
        let witness = scope.spawn(|| {
            let mut seen: Vec<Frame> = Vec::new();
            while !over.load(Ordering::Acquire) {
                let mut note = |_, _, bytes: &[u8]| seen.push(Frame::decode(bytes).expect("a frame"));
                tap.drain(&mut note).expect("the bus");
                thread::sleep(Duration::from_millis(2));
            }
            seen
        });
        // A second's worth of traffic, so that there is something to lose.
        flood(&cell, 1, 200);
        flood(&cell, 2, 200);
        cell.recorder().signal(Signal::KILL);
        cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
        over.store(true, Ordering::Release);
        seen = witness.join().expect("it only listens");
    });
    drop(tap);
    drop(bus);

    let recorder = until_recorder(&cell, "is known to be gone", |recorder| recorder["state"] == "stopped");
    let reason = recorder["trouble"]["reason"].as_str().expect("a reason");
    assert!(reason.contains("the recorder is gone (signal: 9 (SIGKILL))"), "{reason}");
    // The brake is sent when the recorder's end is noticed: the kill was before that.
    let brake = seen.iter().rev().find(|frame| {
        matches!(&frame.body, supersigma_protocol::Body::Command(command) if command.bytes.as_slice() == [0, 7])
    });
    let killed = brake.expect("all axes were told to brake").tick;
    let read: Vec<(Sender, Sequence)> = ccu::log::LogReader::open(&up.log)
        .expect("a log")
        .map(|frame| frame.expect("whole").frame.expect("a frame"))
        .map(|frame| (frame.sender, frame.sequence))
        .collect();
    let missing = seen.iter().filter(|frame| !read.contains(&(frame.sender, frame.sequence)));
    let oldest = missing.map(|frame| frame.tick).min().unwrap_or(killed);
    let lost_ms = killed.0.saturating_sub(oldest.0) / (Tick::PER_SECOND / 1000);
    println!(
        "{} frames seen, {} read; the oldest that is lost is {lost_ms} ms older than the kill",
        seen.len(),
        read.len()
    );
    // 100 ms by configuration; the rest is what a busy machine may take to run the recorder, and to notice its end.
    assert!(lost_ms <= 100 + 400, "{lost_ms} ms");
    assert!(!read.is_empty());
    cell.ccu("down").done();
    cell.assert_nothing_left();
}

/// What follows when the log cannot be written any more; `log` is where its file can be read.
fn nothing_moves(cell: &Cell, log: &Path, says: &[&str]) {
    let full = until_recorder(cell, "has no room", |recorder| recorder["state"] == "disk_full");
    let reason = full["trouble"]["reason"].as_str().expect("a reason").to_owned();
    assert!(says.iter().all(|say| reason.contains(say)), "{reason}");
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    cell.ccu("clear").done();
    let refused = cell.ccu("move left_x 10");
    refused.fails(1, says);
    refused.fails(1, &["whole and readable; nothing moves without a log", "make room on that disk"]);
    let status = cell.ccu("status").good();
    assert!(status.stdout.contains("DISK FULL, NO LOG ANY MORE, was "), "{status}");
    assert!(status.stdout.contains(&reason), "{status}");
    // The log is finished: `ccu frames` does not say that it ends too early, and it begins at the beginning.
    eventually("the end of the recorder", || {
        cell.processes().iter().all(|process| !process.has(&["recorder"])).then_some(())
    });
    for (sender, numbers) in numbers(&cell.frames(log)) {
        assert!((0..numbers.len() as u64).eq(numbers), "{sender} has a gap");
    }
    let said = fs::read_to_string(cell.runtime().with_extension("messages")).expect("it is worth a word");
    assert_eq!(said.matches("make room on that disk").count(), 1, "it is said once: {said}");
    assert!(said.contains(&reason), "{said}");
}

#[test]
fn a_file_that_may_not_grow_is_closed_and_nothing_moves() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 60000 --speed 4000 --no-wait").done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    let pid = i32::try_from(cell.recorder().pid).ok().and_then(Pid::from_raw).expect("a process number");
    let limit = fs::metadata(&up.log).expect("the log").len() + 10_000;
    prlimit(Some(pid), Resource::Fsize, Rlimit { current: Some(limit), maximum: Some(limit) })
        .expect("our own process");
    flood(&cell, 1, 2_000);
    nothing_moves(&cell, &up.log, &["cannot write the log", "cell.mcap: File too large", " frames in "]);
    assert!(fs::metadata(&up.log).expect("the log").len() <= limit);
    let down = cell.ccu("down").good();
    assert!(down.stdout.contains(" sent, unknown logged"), "{down}");
    cell.assert_nothing_left();
}

/// A disk of its own, where that is possible: root, and mount namespaces.
#[test]
fn a_full_disk_is_noticed_while_there_is_room_for_the_end() {
    let cell = Cell::new(EXE);
    let disk = cell.path("disk");
    fs::create_dir(&disk).expect("a folder");
    // The set lives where the disk is mounted, and nobody else does.
    let up = "up --detach --time-scale 2 --config cell.toml --log disk/run.mcap";
    let Some(ran) = cell.ccu_after_mount("mount -t tmpfs -o size=6m tmpfs disk", up) else { return };
    assert_eq!(ran.code(), Some(0), "{ran}");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 60000 --speed 4000 --no-wait").done();
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    let daemon =
        cell.processes().into_iter().find(|process| process.has(&["up", "--detached"])).expect("the daemon");
    let disk = PathBuf::from(format!("/proc/{}/root{}", daemon.pid, disk.display()));
    let mut filler = File::create(disk.join("filler")).expect("there is room yet");
    while filler.write_all(&[0; 4096]).is_ok() {}
    // Only now does the log grow beyond the room that it has set aside.
    eventually("the full disk", || {
        flood(&cell, 0, 100);
        (recorder(&cell)["state"] == "disk_full").then_some(())
    });
    let log = disk.join("run.mcap");
    nothing_moves(&cell, &log, &["no room is left for the log", "disk/run.mcap", " frames in "]);
    // Nothing was lost, the end is the real one, and how the axis came to a stand is in it.
    let bytes = fs::read(&log).expect("the log");
    let summary = mcap::Summary::read(&bytes).expect("MCAP").expect("with a summary");
    assert!(summary.stats.expect("with statistics").message_count > 0);
    let frames = cell.frames(&log);
    assert!(frames.iter().any(|frame| frame["operation"] == "Brake"));
    assert!(frames.iter().any(|frame| frame["axis"] == 1
        && frame["alarm"]["cause"] == "braked"
        && frame["activity"] == "standing"));
    cell.ccu("down").done();
    cell.assert_nothing_left();
}

#[test]
fn where_no_log_can_be_nothing_is_started() {
    let cell = Cell::new(EXE);
    let up = |log: &Path| cell.run(&["up", "--config", "cell.toml", "--log", &log.display().to_string()]);
    let missing = up(&cell.path("nowhere/run.mcap"));
    missing.fails(1, &["cannot create the log", "nowhere/run.mcap", "make the folder first"]);
    assert_eq!(missing.stderr.matches("No such file").count(), 1, "{missing}");
    let existing = cell.file("there.mcap", "precious");
    up(&existing).fails(2, &["there.mcap exists already", "never overwritten"]);
    assert_eq!(fs::read(&existing).expect("it is there"), b"precious");
    let dry = format!("run --dry-run --log {} -e print(1)", existing.display());
    cell.ccu(&dry).fails(2, &["there.mcap exists already"]);
    assert_eq!(fs::read(&existing).expect("it is there"), b"precious");
    cell.assert_nothing_left();
    cell.ccu("up --log-rotate 10parsecs").fails(2, &["100MB, 2GB, 10min, 1h"]);
    cell.ccu("up --log-rotate 0MB").fails(2, &["at least 0.1MB"]);
}

/// A cell whose commands may not write everywhere, and what closes a folder to them.
fn without_root() -> (Cell, impl Fn(&Path, u32)) {
    let cell = Cell::new(EXE);
    let cell = if geteuid().is_root() { cell.given_to(65_534) } else { cell };
    let close = |folder: &Path, mode| {
        fs::set_permissions(folder, fs::Permissions::from_mode(mode)).expect("our own, or root may");
    };
    (cell, close)
}

#[test]
fn where_this_user_may_not_write_nothing_is_started() {
    let (cell, close) = without_root();
    close(&cell.path(""), 0o555);
    cell.ccu("up --config cell.toml --log run.mcap")
        .fails(1, &["cannot create the log", "run.mcap: Permission denied", "you may write to", "--log"]);
    close(&cell.path("run"), 0o555);
    fs::remove_dir_all(cell.path("run/supersigma")).expect("empty");
    close(&cell.path(""), 0o755);
    for (line, code) in [("up --config cell.toml --log run.mcap", 1), ("status", 3)] {
        cell.ccu(line)
            .fails(code, &["cannot make", "run/supersigma", "Permission denied", "XDG_RUNTIME_DIR"]);
    }
    close(&cell.path("run"), 0o755);
    cell.assert_nothing_left();
    assert!(!cell.path("run.mcap").exists());
}

#[test]
fn a_log_whose_folder_is_closed_stays_in_its_file_and_goes_on_when_it_is_open() {
    let (cell, close) = without_root();
    cell.ccu("up --detach --time-scale 20 --config cell.toml --log run.mcap --log-rotate 0.1MB").done();
    cell.ccu("origin left_x").done();
    close(&cell.path(""), 0o555);
    let messages = || fs::read_to_string(cell.runtime().with_extension("messages")).unwrap_or_default();
    eventually("the end of the first file", || {
        flood(&cell, 1, 200);
        messages().contains("run.2.mcap: Permission denied").then_some(())
    });
    // It stays in the file that it has, so nothing is lost and axes go on.
    cell.ccu("move left_x 10").done();
    assert_eq!((&recorder(&cell)["state"], &recorder(&cell)["lost"]), (&json!("recording"), &json!(0)));
    // Another recorder needs another file, and is started as soon as it can have one.
    cell.recorder().signal(Signal::KILL);
    let tried = "the recorder cannot be started again error=cannot create the log";
    eventually("the attempt", || messages().contains(tried).then_some(()));
    cell.until("left_x", "has braked", |axis| axis["alarm"]["cause"] == "braked");
    cell.ccu("clear").done();
    cell.ccu("move left_x 10").fails(1, &["the recorder is gone", "nothing moves without a log"]);
    let frames = cell.ccu("frames --json run.mcap");
    assert_eq!(frames.code(), Some(0), "{frames}");
    for (sender, numbers) in numbers(&frames.json()) {
        assert!((0..numbers.len() as u64).eq(numbers), "{sender} has a gap");
    }
    close(&cell.path(""), 0o755);
    until_recorder(&cell, "is back", |recorder| recorder["state"] == "recording");
    cell.ccu("clear").done();
    cell.ccu("move left_x 10").done();
    cell.ccu("down").done();
    cell.assert_nothing_left();
    cell.ccu("recover run.mcap -o whole.mcap").done();
    assert_eq!(cell.frames(&cell.path("whole.mcap")), frames.json());
}

/// What `ccu up` says where this has been mounted before, in a mount namespace that ends with it.
fn up_after(mount: &str, says: &[&str]) {
    let cell = Cell::new(EXE);
    fs::create_dir(cell.path("disk")).expect("a folder");
    let up = "up --config cell.toml --log disk/run.mcap";
    let Some(ran) = cell.ccu_after_mount(mount, up) else { return };
    ran.fails(1, says);
    cell.assert_nothing_left();
}

#[test]
fn a_disk_that_takes_no_log_or_no_runtime_folder_is_told_at_the_start() {
    up_after(
        "mount -t tmpfs -o ro tmpfs disk",
        &["cannot create the log", "Read-only file system", "as it is mounted", "--log"],
    );
    up_after(
        "mount -t tmpfs -o size=64k tmpfs disk && head -c 64k /dev/zero >disk/full",
        &["cannot write the log", "No space left on device", "make room on that disk", "--log"],
    );
    up_after(
        "mount -t tmpfs -o ro tmpfs run",
        &["cannot make", "run/supersigma", "Read-only file system", "XDG_RUNTIME_DIR"],
    );
    up_after(
        "mount -t tmpfs -o size=16k tmpfs run && head -c 16k /dev/zero >run/full",
        &["cannot write", "config.toml", "No space left on device", "df -h", "XDG_RUNTIME_DIR"],
    );
    up_after(
        "mount -t tmpfs -o size=64k,nr_inodes=12 tmpfs run",
        &["cannot create the bus", "df -i", "XDG_RUNTIME_DIR"],
    );
}
