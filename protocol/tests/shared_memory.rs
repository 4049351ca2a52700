//! The shared-memory bus between real processes: killed, stopped and started again; and what they leave behind.
//!
//! The other process is this test's own executable, started again for one of the ignored tests at the end.

use std::env;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};
use supersigma_protocol::Address;
use supersigma_protocol::bus::shared_memory::{Place, SharedBus, SharedReceive, SharedTransmit};
use supersigma_protocol::bus::{BUFFER_FRAMES, Bus, Receive, Tap, Transmit, Wake};
use tempfile::TempDir;

/// Long enough for the slowest machine; only a failing test waits so long.
const GENEROUS: Duration = Duration::from_secs(60);
/// Tells a child where its bus is.
const ROOT: &str = "SUPERSIGMA_TEST_ROOT";
/// What a child prints when its port stands.
const READY: &str = "ready";

#[test]
fn nothing_stays_in_memory_or_folder_after_a_sweep() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let (mut ccu, answers) = bus.ccu().unwrap();
    let (card, mut commands) = bus.card(Address(1)).unwrap();
    ccu.send(b"x", Wake::Everyone).unwrap();
    assert_eq!(all(&mut commands), [b"x"]);
    assert!(!home.in_shared_memory().is_empty() && home.bus_folder().is_dir());
    drop((ccu, answers, card, commands, bus));
    SharedBus::sweep(&home.place).unwrap();
    assert_eq!(home.in_shared_memory(), Vec::<PathBuf>::new());
    assert!(!home.bus_folder().exists());
    SharedBus::sweep(&home.place).expect("sweeping a clean place is no error");
}

#[test]
fn a_sweep_under_a_living_port_spares_the_process() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let (mut ccu, answers) = bus.ccu().unwrap();
    let (card, mut commands) = bus.card(Address(1)).unwrap();
    SharedBus::sweep(&home.place).unwrap();
    ccu.send(b"x", Wake::Everyone).unwrap();
    while commands.receive().unwrap().is_some() {}
    drop((ccu, answers, card, commands, bus));
    assert_eq!(home.in_shared_memory(), Vec::<PathBuf>::new());
}

#[test]
fn leftovers_do_not_stop_the_next_life_of_a_set() {
    let home = Home::new();
    let (memory, folder) = (Path::new("/dev/shm"), home.bus_folder());
    fs::create_dir_all(folder.join("services")).unwrap();
    fs::create_dir_all(folder.join("nodes/1")).unwrap();
    let prefix = home.place.prefix();
    for stale in [
        memory.join(format!("{prefix}1.data")),
        memory.join(format!("{prefix}node.0_10_0.global_mgmt")),
        folder.join(format!("{prefix}1.ev")),
        folder.join(format!("services/{prefix}1.service")),
        folder.join(format!("nodes/{prefix}1.node_monitor")),
    ] {
        fs::write(stale, "not what iceoryx2 expects").unwrap();
    }
    let other = home.root.path().join("lock");
    fs::write(&other, "the set's own file").unwrap();
    let bus = SharedBus::create(&home.place).unwrap();
    let _ports = (bus.ccu().unwrap(), bus.card(Address(1)).unwrap(), bus.tap().unwrap());
    assert!(!memory.join(format!("{prefix}1.data")).exists());
    assert_eq!(fs::read(other).unwrap(), b"the set's own file", "only the bus's folder is swept");
}

#[test]
fn no_file_of_the_bus_is_open_to_other_users() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let _ports = (bus.ccu().unwrap(), bus.card(Address(1)).unwrap(), bus.tap().unwrap());
    for file in home.in_shared_memory() {
        let mode = fs::metadata(&file).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", file.display());
    }
    assert_eq!(fs::metadata(home.bus_folder()).unwrap().permissions().mode() & 0o777, 0o700);
}

#[test]
fn two_sets_do_not_hear_each_other() {
    let (left, right) = (Home::new(), Home::new());
    let (left_bus, right_bus) =
        (SharedBus::create(&left.place).unwrap(), SharedBus::create(&right.place).unwrap());
    let (mut left_ccu, _left_answers) = left_bus.ccu().unwrap();
    let (mut right_ccu, _right_answers) = right_bus.ccu().unwrap();
    let (_left_card, mut left_commands) = left_bus.card(Address(1)).unwrap();
    let (_right_card, mut right_commands) = right_bus.card(Address(1)).unwrap();
    left_ccu.send(b"left", Wake::Everyone).unwrap();
    right_ccu.send(b"right", Wake::Everyone).unwrap();
    assert_eq!(all(&mut left_commands), [b"left"]);
    assert_eq!(all(&mut right_commands), [b"right"]);
    drop((left_ccu, left_bus));
    SharedBus::sweep(&left.place).unwrap();
    right_ccu.send(b"still", Wake::Everyone).unwrap();
    assert_eq!(all(&mut right_commands), [b"still"]);
}

#[test]
fn there_is_nothing_to_join_before_the_ccu_has_created_it() {
    let home = Home::new();
    let error = SharedBus::join(&home.place).unwrap_err().to_string();
    let root = home.place.root().display();
    assert_eq!(error, format!("cannot join the bus: there is none in {root}; start the set first"));
    assert_eq!(home.in_shared_memory(), Vec::<PathBuf>::new(), "a failed join leaves nothing");
}

#[test]
fn a_set_has_one_ccu() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let _first = bus.ccu().unwrap();
    let error = bus.ccu().unwrap_err().to_string();
    assert!(error.starts_with("cannot make a sending port: "), "{error}");
}

#[test]
fn a_killed_card_can_join_again_and_again() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let (mut ccu, mut answers) = bus.ccu().unwrap();
    let mut tap = bus.tap().unwrap();
    // More lives than the services have slots for cards, nodes or listeners.
    for life in 0..40_u8 {
        let mut card = home.start("child_card_that_echoes");
        assert_eq!(ask(&mut ccu, &mut answers, life), life);
        card.kill().unwrap();
        card.wait().unwrap();
        ccu.send(&[life], Wake::Card(Address(3))).expect("a dead reader is no error");
        if life % 2 == 0 {
            bus.clean_dead();
        }
        tap.drain(&mut |_, _, _| ()).unwrap();
    }
}

#[test]
fn a_stopped_card_blocks_nobody_and_hears_again() {
    let home = Home::new();
    let bus = SharedBus::create(&home.place).unwrap();
    let (mut ccu, mut answers) = bus.ccu().unwrap();
    let card = home.start("child_card_that_echoes");
    let id = Pid::from_raw(card.id().try_into().unwrap()).unwrap();
    assert_eq!(ask(&mut ccu, &mut answers, 1), 1);
    kill_process(id, Signal::STOP).unwrap();
    let (_id, status) = waitpid(Some(id), WaitOptions::UNTRACED).unwrap().expect("it was started");
    assert!(status.stopped());
    for _ in 0..2 * BUFFER_FRAMES {
        ccu.send(&[2], Wake::Card(Address(3))).unwrap();
    }
    kill_process(id, Signal::CONT).unwrap();
    for _ in 0..BUFFER_FRAMES {
        assert_eq!(next(&mut answers), [2], "the buffer's worth was kept");
    }
    assert_eq!(ask(&mut ccu, &mut answers, 3), 3, "and nothing else");
}

#[test]
fn a_killed_ccu_and_its_orphans_do_not_stop_the_next_one() {
    let home = Home::new();
    for _ in 0..3 {
        let mut ccu = home.start("child_ccu_that_does_nothing");
        let mut orphan = home.start("child_card_that_echoes");
        ccu.kill().unwrap();
        ccu.wait().unwrap();
        orphan.kill().unwrap();
        orphan.wait().unwrap();
        assert!(!home.in_shared_memory().is_empty(), "a killed process leaves files");
    }
    let bus = SharedBus::create(&home.place).unwrap();
    let (mut ccu, mut answers) = bus.ccu().unwrap();
    let _card = home.start("child_card_that_echoes");
    assert_eq!(ask(&mut ccu, &mut answers, 9), 9);
}

#[test]
#[ignore = "is the other process of the tests above"]
fn child_card_that_echoes() {
    let Some(place) = place_of_child() else {
        return;
    };
    let bus = SharedBus::join(&place).unwrap();
    let (mut answers, mut commands) = bus.card(Address(3)).unwrap();
    say_ready();
    loop {
        while let Some(command) = commands.receive().unwrap() {
            answers.send(&command.bytes, Wake::Everyone).unwrap();
        }
        commands.wait(GENEROUS).unwrap();
    }
}

#[test]
#[ignore = "is the other process of the tests above"]
fn child_ccu_that_does_nothing() {
    let Some(place) = place_of_child() else {
        return;
    };
    let bus = SharedBus::create(&place).unwrap();
    let (_commands, mut answers) = bus.ccu().unwrap();
    say_ready();
    loop {
        answers.wait(GENEROUS).unwrap();
    }
}

/// A set's folder of its own, gone with its bus at the end of the test.
struct Home {
    root: TempDir,
    place: Place,
}

impl Home {
    fn new() -> Self {
        let root = TempDir::new().unwrap();
        let place = Place::new(root.path()).unwrap();
        Self { root, place }
    }

    fn bus_folder(&self) -> PathBuf {
        self.root.path().join("bus")
    }

    fn in_shared_memory(&self) -> Vec<PathBuf> {
        let of_ours =
            |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(self.place.prefix());
        fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path()).filter(of_ours).collect()
    }

    /// Another process, whose port stands when this returns.
    fn start(&self, test: &str) -> Other {
        let mut child = Command::new(env::current_exe().unwrap())
            .args(["--exact", test, "--ignored", "--nocapture"])
            .env(ROOT, self.root.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let ready = lines.any(|line| line.unwrap().ends_with(READY));
        assert!(ready, "{test} ended before it was ready");
        Other(child)
    }
}

impl Drop for Home {
    fn drop(&mut self) {
        SharedBus::sweep(&self.place).unwrap();
    }
}

/// A child that does not outlive its test, even a failed one.
struct Other(Child);

impl Drop for Other {
    fn drop(&mut self) {
        // It may be gone already, which is as good.
        let _ended = self.0.kill();
        let _reaped = self.0.wait();
    }
}

impl std::ops::Deref for Other {
    type Target = Child;
    fn deref(&self) -> &Child {
        &self.0
    }
}

impl std::ops::DerefMut for Other {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

fn place_of_child() -> Option<Place> {
    env::var_os(ROOT).map(|root| Place::new(root).unwrap())
}

fn say_ready() {
    println!("{READY}");
    std::io::stdout().flush().unwrap();
}

fn all(port: &mut SharedReceive) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| port.receive().unwrap()).map(|frame| frame.bytes).collect()
}

fn next(port: &mut SharedReceive) -> Vec<u8> {
    let deadline = Instant::now() + GENEROUS;
    loop {
        if let Some(frame) = port.receive().unwrap() {
            return frame.bytes;
        }
        assert!(Instant::now() < deadline, "nothing came");
        port.wait(GENEROUS).unwrap();
    }
}

/// Sends one byte to card 3 and returns the one that comes back.
fn ask(ccu: &mut SharedTransmit, answers: &mut SharedReceive, byte: u8) -> u8 {
    ccu.send(&[byte], Wake::Card(Address(3))).unwrap();
    next(answers)[0]
}
