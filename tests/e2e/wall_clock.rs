//! Jumps of the wall clock: a set knows nothing of them. Everything in it runs on the monotonic clock; the wall clock is read
//! once, when the set is started, and every stamp in the log is that moment and the ticks since.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use mcap::MessageStream;
use mcap::read::{Options, Summary};
use serde_json::Value;
use supersigma_protocol::Frame;
use supersigma_tests::{Account, Cell, Signal, eventually};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// A frame's stamps, in nanoseconds since the epoch of the log.
struct Stamp {
    sent: u64,
    logged: u64,
    tick: u64,
}

/// The epoch of a log that is whole, and the stamps of its frames.
fn stamps(log: &Path) -> (u64, Vec<Stamp>) {
    let bytes = fs::read(log).expect("the log");
    let summary = Summary::read(&bytes).expect("a log").expect("a summary");
    let index = summary.metadata_indexes.iter().find(|index| index.name == "supersigma").expect("ours");
    let metadata: BTreeMap<String, String> = mcap::read::metadata(&bytes, index).expect("metadata").metadata;
    let epoch: u64 = metadata["epoch_ns"].parse().expect("a number");
    let messages = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into()).expect("a log");
    let frames = messages
        .map(|message| message.expect("whole"))
        .filter(|message| message.channel.topic == "/microbus");
    let stamp = |message: mcap::Message| Stamp {
        sent: message.publish_time - epoch,
        logged: message.log_time - epoch,
        tick: Frame::decode(&message.data).expect("a frame").tick.0,
    };
    (epoch, frames.map(stamp).collect())
}

/// What a log of a set that runs 20 times faster than real time must look like, whatever its wall clock did.
fn assert_steady(log: &Path, lived: Duration) -> u64 {
    let (epoch, stamps) = stamps(log);
    assert!(stamps.len() > 100, "{} frames", stamps.len());
    for Stamp { sent, logged, tick } in &stamps {
        assert_eq!(*sent, tick * 500 / 20, "the epoch and the ticks");
        assert!(u128::from(*logged) <= lived.as_nanos(), "{logged} ns after a start {lived:?} ago");
    }
    assert!(stamps.is_sorted_by_key(|stamp| stamp.logged), "in the order in which they were logged");
    epoch
}

#[test]
fn every_stamp_is_the_start_and_the_ticks_since() {
    let cell = Cell::new(EXE);
    let began = Instant::now();
    let up = cell.up("20");
    cell.ccu("origin left_x wrist").done();
    cell.ccu("move left_x 5000").done();
    assert_eq!(cell.down(), None);
    assert_steady(&up.log, began.elapsed());
}

/// A library that lets the wall clock of a process jump, if the machine has it.
fn faketime() -> Option<PathBuf> {
    let folders = ["/usr/lib", "/usr/lib64", "/usr/local/lib"].map(PathBuf::from).into_iter();
    let below = fs::read_dir("/usr/lib").ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let libraries = folders.chain(below).map(|folder| folder.join("faketime/libfaketimeMT.so.1"));
    libraries.into_iter().find(|library| library.exists())
}

/// A command whose wall clock, and that of all it starts, goes wrong by what stands in the file.
fn with_clock(mut command: Command, library: &Path, clock: &Path) -> Command {
    command
        .env("LD_PRELOAD", library)
        .env("FAKETIME_TIMESTAMP_FILE", clock)
        .env("FAKETIME_NO_CACHE", "1")
        .env("FAKETIME_DONT_FAKE_MONOTONIC", "1");
    command.stdin(Stdio::null());
    command
}

#[test]
fn a_set_does_not_see_its_wall_clock_jump() {
    let Some(library) = faketime() else {
        println!("skipped: the library of `faketime` is not installed");
        return;
    };
    let cell = Cell::new(EXE);
    let clock = cell.file("clock", "+0\n");
    let jump = |by: i64| {
        fs::write(&clock, format!("{by:+}\n")).expect("writable");
        let date = with_clock(Command::new("date"), &library, &clock).arg("+%s").output().expect("date");
        let shown: i64 = String::from_utf8_lossy(&date.stdout).trim().parse().expect("seconds");
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
        let off = shown - i64::try_from(now.as_secs()).expect("small enough");
        assert!((off - by).abs() < 60, "the clock is off by {off} s");
    };
    let began = Instant::now();
    let log = cell.path("cell.mcap");
    let config = cell.config();
    let (config, path) = (config.display().to_string(), log.display().to_string());
    let up = cell.command(&["up", "--detach", "--time-scale", "20", "--config", &config, "--log", &path]);
    let up = with_clock(up, &library, &clock).output().expect("ccu can be started");
    assert!(up.status.success(), "{}", String::from_utf8_lossy(&up.stderr));
    for process in cell.processes() {
        let maps = fs::read_to_string(format!("/proc/{}/maps", process.pid)).expect("it runs");
        assert!(maps.contains("libfaketime"), "{process:?} has the library");
    }
    cell.ccu("origin left_x").done();
    let running = cell.start("move left_x 60000 --speed 2000");
    cell.until("left_x", "at its speed", |axis| axis["activity"] == "cruising");
    // A day on, two years back, and where it was.
    for by in [86_400, -63_000_000, 0] {
        jump(by);
        let before = cell.axis("left_x")["position"].as_i64();
        cell.until("left_x", "goes on", |axis| axis["position"].as_i64() > before);
    }
    running.end().done();
    let axis = cell.axis("left_x");
    assert_eq!((&axis["position"], &axis["alarm"]), (&Value::from(60_000), &Value::Null));
    // A recorder that is started while the clock is wrong goes on in the same time.
    jump(86_400);
    cell.recorder().signal(Signal::KILL);
    eventually("the recorder is back", || {
        let all = cell.ccu("ps --json --name cell").good().json();
        let back =
            |row: &Value| row["role"] == "recorder" && row["restarts"] == 1 && row["state"] == "running";
        all.iter().any(back).then_some(())
    });
    cell.ccu("clear").done();
    cell.ccu("move left_x -20000").done();
    cell.ccu("down").done();
    cell.assert_nothing_left();
    let mended = cell.path("mended.mcap");
    cell.ccu(&format!("recover {path} -o {}", mended.display())).done();
    let next = cell.path("cell.2.mcap");
    let epochs = [&mended, &next].map(|file| assert_steady(file, began.elapsed()));
    assert_eq!(epochs[0], epochs[1]);
    let account = Account::of([&log, &next]);
    assert!(account.faults.is_empty(), "{:?}", account.faults);
}
