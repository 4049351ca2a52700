//! Another user of the same machine: what a set refuses him, and what he can put in its way. Needs root, which alone can be
//! two others; without, the tests say that they are skipped. That nothing is open to others, anybody can see.

use std::fmt::Debug;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::{Pid, geteuid, kill_process};
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_tests::{Cell, Signal, log_files};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const OWNER: u32 = 65_533;
const OTHER: u32 = 65_534;

fn cells_of_owner() -> Option<Cell> {
    if !geteuid().is_root() {
        eprintln!("skipped: only root can be two other users");
        return None;
    }
    Some(Cell::new(EXE).given_to(OWNER))
}

fn mode(path: &Path) -> u32 {
    fs::symlink_metadata(path).expect("it is there").permissions().mode() & 0o777
}

#[test]
fn another_user_is_told_whose_a_set_is_and_changes_nothing() {
    let Some(cell) = cells_of_owner() else { return };
    let up = cell.up("20");
    cell.ccu("origin wrist").done();
    let other = cell.of_user(OTHER);
    for (mode, closed) in [(0o755, "run/supersigmabelongs"), (0o700, "runbelongs")] {
        fs::set_permissions(cell.path("run"), Permissions::from_mode(mode)).expect("root may");
        for (line, code) in [
            ("status", 3),
            ("status --watch", 3),
            ("move wrist 10", 3),
            ("brake", 3),
            ("monitor", 3),
            ("down", 3),
            ("up", 1),
            ("run -e print(1)", 1),
        ] {
            let ran = other.ccu(line);
            ran.fails(
                code,
                &["belongs to user 65533, and we are user 65534", "obey that user alone", "XDG_RUNTIME_DIR"],
            );
            // A long path is broken where the line ends.
            assert!(ran.complaint().replace(' ', "").contains(closed), "{ran}");
        }
    }
    let log = up.log.display();
    for line in ["frames LOG", "log info LOG", "recover LOG -o x.mcap", "replay LOG", "plot LOG -o x.svg"] {
        other
            .ccu(&line.replace("LOG", &log.to_string()))
            .fails(2, &["cannot read the log", "Permission denied", "ask user 65533"]);
    }
    fs::set_permissions(cell.path("run"), Permissions::from_mode(0o755)).expect("root may");
    intrude(&cell, &up.log, up.pid);
    cell.ccu("move wrist 100").done();
    assert_eq!(cell.axis("wrist")["position"], 100);
    assert_eq!(cell.down(), None);
}

/// Runs [`intruder`] in another user's process.
fn intrude(cell: &Cell, log: &Path, daemon: u32) {
    let program = cell.path("intruder");
    fs::copy(std::env::current_exe().expect("a program"), &program).expect("room");
    let mut files = cell.shared_memory();
    assert!(!files.is_empty(), "a set has shared memory");
    files.push(log.to_owned());
    let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    let output = Command::new(program)
        .args(["--exact", "intruder", "--ignored"])
        .env("INTRUDER_FOLDER", cell.runtime())
        .env("INTRUDER_DAEMON", daemon.to_string())
        .env("INTRUDER_FILES", files.join(":"))
        .uid(OTHER)
        .gid(OTHER)
        .output()
        .expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("1 passed"), "{said}");
}

fn refused<T: Debug>(what: &str, path: &Path, result: io::Result<T>) {
    let error = result.expect_err(&format!("{what} {}", path.display()));
    assert_eq!(error.kind(), io::ErrorKind::PermissionDenied, "{what} {}: {error}", path.display());
}

#[test]
#[ignore = "another test runs it as another user"]
fn intruder() {
    let given = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("{name} is not given"));
    let folder = PathBuf::from(given("INTRUDER_FOLDER"));
    let parent = folder.parent().expect("a folder");
    for file in given("INTRUDER_FILES").split(':').map(Path::new) {
        refused("read", file, File::open(file));
        refused("write", file, OpenOptions::new().write(true).open(file));
        refused("open", file, fs::set_permissions(file, Permissions::from_mode(0o666)));
        refused("remove", file, fs::remove_file(file));
    }
    refused("look into", &folder, fs::read_dir(&folder));
    refused("look into", parent, fs::read_dir(parent));
    let socket = folder.join("control.sock");
    refused("call", &socket, UnixStream::connect(&socket));
    refused("remove", &socket, fs::remove_file(&socket));
    refused("write into", &folder, fs::write(folder.join("members"), "me"));
    refused("move", parent, fs::rename(parent, parent.with_extension("mine")));
    let place = Place::new(&folder).expect("short enough");
    let error = SharedBus::join(&place).expect_err("it is not ours").to_string();
    assert!(error.contains("it is another user's") && error.contains("Permission denied"), "{error}");
    let error = SharedBus::create(&place).expect_err("it is not ours").to_string();
    assert!(error.contains("Permission denied"), "{error}");
    let daemon = given("INTRUDER_DAEMON").parse().ok().and_then(Pid::from_raw).expect("a process number");
    kill_process(daemon, Signal::TERM).expect_err("it is another user's");
}

#[test]
fn two_users_have_sets_of_the_same_name_that_know_nothing_of_each_other() {
    let Some(one) = cells_of_owner() else { return };
    let two = Cell::new(EXE).given_to(OTHER);
    let (_first, _second) = (one.up("20"), two.up("20"));
    one.ccu("origin wrist").done();
    one.ccu("move wrist 111").done();
    assert!(two.axis("wrist")["position"].is_null());
    assert_eq!(one.down(), None);
    two.ccu("origin wrist").done();
    assert_eq!(two.down(), None);
}

#[test]
fn what_another_user_puts_among_a_sets_files_is_told_and_stops_no_set_that_is_up() {
    let Some(cell) = cells_of_owner() else { return };
    let _up = cell.up("20");
    let prefix = Place::new(cell.runtime()).expect("short enough").prefix().to_owned();
    let squatter = PathBuf::from(format!("/dev/shm/{prefix}squatter"));
    fs::write(&squatter, [0; 10]).expect("anybody may write there");
    std::os::unix::fs::chown(&squatter, Some(OTHER), Some(OTHER)).expect("root may");
    File::options().write(true).open(&squatter).and_then(|file| file.set_len(1 << 20)).expect("root may");
    // A card that comes back goes through the set's files.
    cell.worker(7).signal(Signal::KILL);
    cell.until_back("wrist", 1);
    cell.until("wrist", "is back", |axis| axis["activity"] == "standing" && axis["alive"] == true);
    cell.ccu("clear").done();
    cell.ccu("origin wrist").done();
    cell.ccu("down").done();
    cell.ccu("up --log again.mcap")
        .fails(1, &["squatter", "it belongs to user 65534: have it removed, or give the set another name"]);
    let elsewhere = cell.neighbour("elsewhere");
    let _up = elsewhere.up("20");
    assert_eq!(elsewhere.down(), None);
    fs::remove_file(&squatter).expect("root may");
    cell.assert_nothing_left();
}

/// Everything below a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    let mut next = 0;
    while let Some(path) = found.get(next).cloned() {
        if path.is_dir() {
            let entries =
                fs::read_dir(&path).expect("our own").map(|entry| entry.expect("it is there").path());
            found.extend(entries);
        }
        next += 1;
    }
    found
}

#[test]
fn nothing_is_open_to_others_after_processes_were_started_again_and_the_log_was_rotated() {
    let cell = Cell::new(EXE);
    let log = cell.path("cell.mcap");
    cell.ccu("up --detach --time-scale 20 --config cell.toml --log cell.mcap --log-rotate 0.1MB").done();
    cell.worker(7).signal(Signal::KILL);
    cell.until_back("wrist", 1);
    cell.until("wrist", "is back", |axis| axis["activity"] == "standing" && axis["alive"] == true);
    cell.recorder().signal(Signal::KILL);
    let recording = || {
        let status = cell.ccu("status --json").good().json();
        let recorder = &status.last().expect("the recorder is told last")["recorder"];
        (recorder["state"] == "recording" && log_files(&log).len() > 1).then_some(())
    };
    supersigma_tests::eventually("another recorder", recording);
    cell.ccu("clear").done();
    let files = log_files(&log).len();
    cell.ccu("origin left_x left_z").done();
    while log_files(&log).len() == files {
        for _ in 0..20 {
            cell.ccu("line left_x=300 left_z=290").done();
            cell.ccu("line left_x=-300 left_z=-290").done();
        }
    }
    let mut all = cell.shared_memory();
    all.extend(below(&cell.path("run/supersigma")));
    all.extend(log_files(&log));
    assert!(all.len() > 50, "{all:?}");
    for path in all {
        assert_eq!(mode(&path) & 0o077, 0, "{}", path.display());
    }
    cell.ccu("down").done();
    for path in log_files(&log) {
        assert_eq!(mode(&path), 0o600, "{}", path.display());
    }
    cell.assert_nothing_left();
}
