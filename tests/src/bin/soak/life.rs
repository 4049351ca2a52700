//! The life of the set: program after program, a look at everything after each, a worker killed now and then; in the end
//! the log is held against the machines.

use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::time::{Duration, Instant};

use fastrand::Rng;
use serde_json::Value;
use supersigma_tests::{Account, Cell, Programmer, changed, counts, eventually, log_files, patient};

use super::Args;
use super::watch::Watch;

/// What came of it.
#[derive(Debug, Default)]
pub(crate) struct Record {
    pub(crate) took: Duration,
    pub(crate) programs: u64,
    /// Workers killed on purpose.
    pub(crate) killed: u64,
    /// Alarms that followed from that.
    pub(crate) provoked: usize,
    pub(crate) watch: Watch,
    pub(crate) sent: u64,
    pub(crate) logged: u64,
    pub(crate) account: Account,
    /// The files of the log, and their bytes.
    pub(crate) files: usize,
    pub(crate) bytes: u64,
    /// What the verification of the log says.
    pub(crate) verified: Value,
    pub(crate) findings: Vec<String>,
}

pub(crate) fn live(args: &Args, ccu: &Path) -> Record {
    let cell = Cell::new(&ccu.display().to_string());
    fs::write(cell.config(), config()).expect("a configuration");
    let mut record = Record::default();
    // The tools of the tests fail by panicking; what was seen until then is worth a report.
    let whole = panic::catch_unwind(AssertUnwindSafe(|| run(args, &cell, &mut record)));
    if whole.is_err() {
        record.findings.push("it could not be carried through: see what was said above".into());
    }
    record
}

/// The built-in set with limits that a busy machine keeps; its log in files that fit into memory.
fn config() -> String {
    let text = changed(&patient(), "silent_ms = 30000 ", "silent_ms = 5000 ");
    let text = changed(&text, "lead_ms = 300 ", "lead_ms = 100 ");
    changed(&text, "# rotate_mb = 100 ", "rotate_mb = 100 ")
}

fn run(args: &Args, cell: &Cell, record: &mut Record) {
    let began = Instant::now();
    let end = Duration::from_secs_f64(args.minutes * 60.0);
    let warm_up = (end / 5).min(Duration::from_secs(120));
    let mut chance = Rng::with_seed(args.seed);
    // Two legs of a path may go from end to end.
    let mut programmer = Programmer::new(args.seed, 32_000);
    let up = cell.up(&args.time_scale.to_string());
    while began.elapsed() < end {
        // A slow set gets short programs, for none may take a minute.
        let program =
            programmer.program(chance.usize(2..=usize::try_from(args.time_scale.clamp(2, 20)).unwrap_or(2)));
        let file = cell.file("program.rhai", &program.text);
        let ran = cell.ccu(&format!("run {}", file.display()));
        record.programs += 1;
        record.took = began.elapsed();
        if ran.code() != Some(0) {
            record.findings.push(format!("program {}: {}", record.programs, ran.complaint()));
            fs::copy(&file, std::env::temp_dir().join(format!("soak-{}.rhai", record.programs)))
                .expect("a copy");
            cell.ccu("clear").done();
            programmer.forget();
            continue;
        }
        look(cell, &programmer, record, began.elapsed() > warm_up);
        if args.kill_every > 0 && record.programs.is_multiple_of(args.kill_every) {
            kill(cell, chance.u8(1..=7), record);
            programmer.forget();
        }
    }
    record.took = began.elapsed();
    let told = cell.positions();
    let down = cell.ccu("down").good();
    cell.assert_nothing_left();
    (record.sent, record.logged) = counts(&down.stdout).unwrap_or_else(|| panic!("no counts in {down}"));
    if record.sent != record.logged {
        record.findings.push(format!("{} frames were sent, {} logged", record.sent, record.logged));
    }
    read_log(cell, &up.log, record);
    let of_log = record.account.positions();
    if of_log != told {
        record.findings.push(format!("positions by the log: {of_log:?}; by the set: {told:?}"));
    }
}

/// After a program that has come to its end.
fn look(cell: &Cell, programmer: &Programmer, record: &mut Record, warm: bool) {
    record.findings.extend(record.watch.look(cell, warm));
    for (axis, (number, due)) in cell.status().iter().zip(programmer.positions()) {
        if axis["position"].as_i64() != due || !axis["alarm"].is_null() || axis["activity"] != "standing" {
            let program = record.programs;
            record
                .findings
                .push(format!("after program {program}, axis {number} should stand at {due:?}: {axis}"));
        }
    }
}

/// A worker is killed, and comes back.
fn kill(cell: &Cell, card: u8, record: &mut Record) {
    let before = cell.worker(card);
    cell.ccu(&format!("kill-worker {card}")).done();
    record.killed += 1;
    eventually("all are back, and stand", || {
        let all = cell.ccu("ps --json --name cell").good().json();
        let back = all.iter().all(|row| row["state"] == "running" && row["pid"] != before.pid);
        let stands = |axis: &Value| axis["alive"] == true && axis["activity"] == "standing";
        // The others brake, and that is told before the killed one is back.
        (back && cell.status().iter().all(stands)).then_some(())
    });
    record.provoked += cell.status().iter().filter(|axis| !axis["alarm"].is_null()).count();
    cell.ccu("clear").done();
}

fn read_log(cell: &Cell, log: &Path, record: &mut Record) {
    let files = log_files(log);
    record.files = files.len();
    record.bytes = files.iter().filter_map(|file| fs::metadata(file).ok()).map(|file| file.len()).sum();
    record.account = Account::of(&files);
    record.findings.extend(record.account.faults.iter().map(|fault| format!("the log: {fault}")));
    if record.account.frames != record.logged {
        record.findings.push(format!("{} frames are in the log's files", record.account.frames));
    }
    if record.account.alarms.len() != record.provoked {
        let (alarms, provoked) = (&record.account.alarms, record.provoked);
        record.findings.push(format!("{provoked} alarms were provoked, in the log are {alarms:?}"));
    }
    let mut command = cell.command(&["replay", "--verify", "--json"]);
    let verified = command.arg(log).output().expect("ccu can be started");
    record.verified = serde_json::from_slice(&verified.stdout).unwrap_or_default();
    if record.verified["result"] != "identical" {
        let said = String::from_utf8_lossy(&verified.stderr).into_owned();
        record.findings.push(format!("the log is not what the machines say: {} {said}", record.verified));
    }
}
