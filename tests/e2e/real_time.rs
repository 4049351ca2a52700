//! The real-time options: what the system grants holds for every card's process; what it refuses is told, and the set works
//! without it.

use std::fs;
use std::thread;

use supersigma_config::{RealTimeConfig, SchedulingPolicy};
use supersigma_tests::{Cell, changed, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const NOBODY: u32 = 65_534;

/// A cell whose set wants all that there is, on this processor.
fn wanting(cpu: &str) -> Cell {
    let cell = Cell::new(EXE);
    let text = changed(&patient(), "policy = \"normal\" ", "policy = \"fifo\" ");
    let text = changed(&text, "priority = 50 ", "priority = 7 ");
    let text = changed(&text, "lock_memory = false ", "lock_memory = true ");
    fs::write(cell.config(), changed(&text, "cpus = [] ", &format!("cpus = [{cpu}] ")))
        .expect("a configuration");
    cell
}

/// A line of a process' status, as the system tells it.
fn status(pid: u32, key: &str) -> String {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).expect("a process");
    let line = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
    line.unwrap_or_else(|| panic!("no {key} in {text}")).trim().to_owned()
}

/// Priority and policy of a process' first thread: fields 40 and 41 of what the system tells.
fn scheduling(pid: u32) -> (u32, u32) {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).expect("a process");
    let (_, rest) = text.rsplit_once(") ").expect("a name in brackets");
    let field = |number: usize| rest.split(' ').nth(number - 3)?.parse().ok();
    field(40).zip(field(41)).expect("numbers")
}

#[test]
fn what_is_granted_holds_for_every_card() {
    let policy = SchedulingPolicy::Fifo;
    let wanted = RealTimeConfig { policy, lock_memory: true, ..RealTimeConfig::default() };
    let asked = thread::spawn(move || axis_worker::real_time::ask_for(&wanted));
    let missing = asked.join().expect("it only asks");
    if !missing.is_empty() {
        eprintln!("skipped: this user may not have it: {missing:?}");
        return;
    }
    let allowed = status(std::process::id(), "Cpus_allowed_list");
    let cpu = allowed.split([',', '-']).next().expect("at least one processor");
    let cell = wanting(cpu);
    let _up = cell.up("1");
    for card in 1..=8 {
        let pid = cell.worker(card).pid;
        // SCHED_FIFO is 1.
        assert_eq!(scheduling(pid), (7, 1), "card {card}");
        assert_ne!(status(pid, "VmLck"), "0 kB", "card {card}");
        assert_eq!(status(pid, "Cpus_allowed_list"), cpu, "card {card}");
    }
    // The recorder has to yield to them.
    assert_eq!(scheduling(cell.recorder().pid), (0, 0));
    cell.ccu("origin wrist").done();
    cell.ccu("move wrist 400").done();
    assert_eq!(cell.down(), None);
}

/// A command that may not have what the configuration wants.
fn refused(cell: &Cell, line: &str) {
    let ran = cell.ccu_after(&["sh"], "ulimit -r 0 && ulimit -l 64", line);
    assert_eq!(ran.code(), Some(0), "{ran}");
}

#[test]
fn what_is_refused_is_told_and_the_set_works_without() {
    // No machine has so many processors.
    let cell = wanting("1023");
    // Root would be refused nothing.
    let cell = if rustix::process::geteuid().is_root() { cell.given_to(NOBODY) } else { cell };
    refused(&cell, "up --detach --config cell.toml --log cell.mcap --time-scale 20");
    refused(&cell, "origin wrist");
    refused(&cell, "move wrist 400");
    refused(&cell, "down");
    let told = fs::read_to_string(cell.runtime().with_extension("messages")).expect("it was told");
    for (missing, advice) in [
        ("real_time.policy = \\\"fifo\\\" at priority 7", "LimitRTPRIO="),
        ("real_time.lock_memory = true", "LimitMEMLOCK="),
        ("real_time.cpus = [1023]", "nproc"),
    ] {
        let lines = told.lines().filter(|line| line.contains(missing) && line.contains(advice));
        assert_eq!(lines.count(), 8, "{missing}: each card tells it once: {told}");
    }
}
