//! A set under a service manager: readiness, status and watchdog over a real datagram socket, and messages as the journal
//! wants them.

use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use supersigma_tests::{Cell, LIMIT, Signal, eventually};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// The service manager's end.
struct Manager {
    socket: UnixDatagram,
}

impl Manager {
    fn at(path: &Path) -> Self {
        let socket = UnixDatagram::bind(path).expect("a socket");
        socket.set_read_timeout(Some(LIMIT)).expect("a limit");
        Self { socket }
    }

    /// The assignments of the next message.
    fn next(&self) -> Vec<String> {
        let mut buffer = [0; 4096];
        let length = self.socket.recv(&mut buffer).expect("a message in time");
        String::from_utf8_lossy(&buffer[..length]).lines().map(str::to_owned).collect()
    }
}

/// `ccu up` in the foreground, as a service manager starts it.
fn service(cell: &Cell) -> Command {
    let (config, log) = (cell.config(), cell.path("cell.mcap"));
    let mut command = cell.command(&["up", "--time-scale", "20"]);
    command.arg("--config").arg(config).arg("--log").arg(log).stdin(Stdio::null()).stdout(Stdio::null());
    command
}

/// Ended if the test fails before it has.
struct Service(Child);

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_service_manager_is_told_when_the_set_is_up_well_and_going() {
    let cell = Cell::new(EXE);
    let path = cell.path("notify");
    let manager = Manager::at(&path);
    let mut command = service(&cell);
    let mut running =
        Service(command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000").spawn().expect("it runs"));
    let first = manager.next();
    assert_eq!(first[0], "READY=1", "{first:?}");
    assert!(first[1].starts_with("STATUS=8 cards are up; log /"), "{first:?}");
    // It is true: every card is there.
    assert!(cell.status().iter().all(|axis| axis["alive"] == true));
    for _ in 0..3 {
        let ping = manager.next();
        assert_eq!(ping[0], "WATCHDOG=1", "{ping:?}");
        assert!(ping[1].starts_with("STATUS=up ") && ping[1].ends_with(" frames, 0 lost"), "{ping:?}");
    }
    assert_eq!(cell.down(), None);
    let mut rest = eventually("the end", || {
        let told = manager.next();
        (told[0] == "STOPPING=1").then(|| vec![told])
    });
    rest.push(manager.next());
    assert!(rest[1][0].starts_with("STATUS=down: "), "{rest:?}");
    assert!(running.0.wait().expect("a child").success());
}

#[test]
fn a_set_that_is_ended_by_a_signal_says_so_too_and_one_that_is_detached_says_nothing() {
    let cell = Cell::new(EXE);
    let path = cell.path("notify");
    let manager = Manager::at(&path);
    let mut command = service(&cell);
    let mut running = Service(command.env("NOTIFY_SOCKET", &path).spawn().expect("it runs"));
    assert_eq!(manager.next()[0], "READY=1");
    let pid = running.0.id();
    let daemon = cell.processes().into_iter().find(|process| process.pid == pid).expect("it is up");
    daemon.signal(Signal::TERM);
    assert_eq!(manager.next()[0], "STOPPING=1");
    assert!(manager.next()[0].starts_with("STATUS=down: "));
    assert!(running.0.wait().expect("a child").success());
    cell.assert_nothing_left();
    fs::remove_file(cell.path("cell.mcap")).expect("the log");

    let config = cell.config();
    let mut command =
        cell.command(&["up", "--detach", "--time-scale", "20", "--log", "cell.mcap", "--config"]);
    let output = command.arg(&config).env("NOTIFY_SOCKET", &path).output().expect("it runs");
    assert!(output.status.success());
    assert_eq!(cell.down(), None);
    manager.socket.set_nonblocking(true).expect("a socket");
    assert!(manager.socket.recv(&mut [0; 64]).is_err(), "nothing was to be told");
}

#[test]
fn a_service_manager_that_is_gone_does_not_keep_a_set_from_coming_up() {
    let cell = Cell::new(EXE);
    let messages = File::create(cell.path("messages")).expect("a file");
    let mut command = service(&cell);
    command.env("NOTIFY_SOCKET", cell.path("nobody")).stderr(messages);
    let mut running = Service(command.spawn().expect("it runs"));
    eventually("the set", || (cell.ccu("status").code() == Some(0)).then_some(()));
    assert_eq!(cell.down(), None);
    assert!(running.0.wait().expect("a child").success());
    let said = fs::read_to_string(cell.path("messages")).expect("the messages");
    assert!(said.contains("the service manager cannot be told"), "{said}");
}

/// Runs a command whose standard error is a file, which `JOURNAL_STREAM` names, or not; gives what stands in the file.
fn messages(cell: &Cell, words: &[&str], named: bool) -> String {
    let path = cell.path("journal");
    let file = File::create(&path).expect("a file");
    let data = file.metadata().expect("an inode");
    let inode = if named { data.ino() } else { data.ino() + 1 };
    let mut command = cell.command(words);
    command.env("JOURNAL_STREAM", format!("{}:{inode}", data.dev())).env("RUST_LOG", "trace");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(file).status().expect("it runs");
    fs::read_to_string(path).expect("a file")
}

#[test]
fn the_journal_gets_lines_with_priorities() {
    let cell = Cell::new(EXE);
    let wrong = cell.file("wrong.toml", "[ramp]\namplitud = 1.0\n");
    let check = ["config", "check", wrong.to_str().expect("UTF-8")];
    let said = messages(&cell, &check, true);
    let lines: Vec<&str> = said.lines().collect();
    assert!(lines.iter().all(|line| line.starts_with("<3>")), "{said}");
    assert!(lines[0].contains("wrong.toml:2:1: ramp.amplitud: there is no key"), "{said}");
    assert!(lines[1].starts_with("<3>help: did you mean `amplitude`?"), "{said}");
    // A stream that was redirected is not the journal.
    assert!(!messages(&cell, &check, false).contains("<3>"));

    let file = File::create(cell.path("service")).expect("a file");
    let data = file.metadata().expect("an inode");
    let mut command = service(&cell);
    command.env("JOURNAL_STREAM", format!("{}:{}", data.dev(), data.ino())).stderr(file);
    let mut running = Service(command.spawn().expect("it runs"));
    eventually("the set", || (cell.ccu("status").code() == Some(0)).then_some(()));
    cell.worker(2).signal(Signal::KILL);
    let said = eventually("the message", || {
        let said = fs::read_to_string(cell.path("service")).expect("a file");
        said.contains("a worker has ended").then_some(said)
    });
    let line = said.lines().find(|line| line.contains("a worker has ended")).expect("the line");
    assert!(
        line.starts_with("<3>ccu::daemon::keeper: a worker has ended; all axes brake card=axis 2"),
        "{said}"
    );
    assert!(!said.contains('\u{1b}'), "{said}");
    cell.ccu("down").done();
    assert!(running.0.wait().expect("a child").success());
}

#[test]
fn the_unit_file_is_good() {
    const UNIT: &str = include_str!("../../contrib/systemd/ccu@.service");
    assert!(include_str!("../../docs/src/guide/systemd.md").contains("contrib/systemd/ccu@.service"));
    let cell = Cell::new(EXE);
    let unit = UNIT.replace("/usr/local/bin/ccu", EXE).replace("User=supersigma", "User=root");
    let path = cell.file("ccu@cell.service", &unit);
    let Ok(output) = Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&path).output() else {
        println!("skipped: systemd-analyze is not here");
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    // It also looks at the units that this one needs, and may not like what it finds there.
    let about_ours: Vec<_> = said.lines().filter(|line| line.contains("ccu@")).collect();
    assert!(about_ours.is_empty(), "{about_ours:?}");
}
