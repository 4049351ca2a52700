//! Rounds by chance: a random program on a real set, and at a random moment a random process of it is killed, or stands
//! still for a while. Whatever happens, no step is unaccounted for, every log can be read, and the next start is clean.
//!
//! A round follows from its seed, but for the very moment at which the signal arrives. `SUPERSIGMA_SEED=17` makes round 17
//! alone.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use fastrand::Rng;
use serde_json::Value;
use supersigma_protocol::AxisNumber;
use supersigma_tests::{Account, Cell, Program, Programmer, Signal, changed, eventually, log_files, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// Whom it strikes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Victim {
    Worker(u8),
    Recorder,
    Daemon,
    Client,
}

/// What happens to it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fate {
    Killed,
    /// It stands still for so long, and goes on.
    Paused(Duration),
    /// It stands still for so long, and is killed.
    Hung(Duration),
}

#[derive(Debug)]
struct Round {
    seed: u64,
    scale: u32,
    program: Program,
    victim: Victim,
    fate: Fate,
    /// The step of the program after whose beginning it happens.
    step: usize,
    /// How long after that.
    delay: Duration,
}

impl Round {
    fn new(seed: u64) -> Self {
        let mut chance = Rng::with_seed(seed);
        let milliseconds = |chance: &mut Rng, most| Duration::from_millis(chance.u64(0..most));
        let steps = chance.usize(2..=6);
        Self {
            seed,
            scale: *chance.choice(&[4, 10, 20]).expect("three"),
            program: Programmer::new(chance.u64(..), 6_000).program(steps),
            victim: match chance.u8(0..10) {
                0..4 => Victim::Worker(chance.u8(1..=8)),
                4..6 => Victim::Recorder,
                6..8 => Victim::Daemon,
                _ => Victim::Client,
            },
            fate: match chance.u8(0..4) {
                0 | 1 => Fate::Killed,
                // Beyond the time after which a card counts as silent, and below.
                2 => Fate::Paused(milliseconds(&mut chance, 2_500)),
                _ => Fate::Hung(milliseconds(&mut chance, 2_500)),
            },
            step: chance.usize(0..=steps),
            delay: milliseconds(&mut chance, 250),
        }
    }

    fn play(&self) {
        let cell = Cell::new(EXE);
        fs::write(cell.config(), config()).expect("a configuration");
        let up = cell.up(&self.scale.to_string());
        let script = cell.file("program.rhai", &self.program.text);
        let mut client = cell.start(&format!("run {}", script.display()));
        match self.step {
            0 => {}
            step => client.says(&format!("step {step}")),
        }
        thread::sleep(self.delay);
        let killed = self.strike(&cell, up.pid);
        // How it ends, depends on what it waited for; that it ends, does not.
        let _ = client.end();
        let told = if self.victim == Victim::Daemon && !matches!(self.fate, Fate::Paused(_)) {
            cell.until_all_have_ended();
            None
        } else {
            Some(self.take_down(&cell, killed))
        };
        let account = self.read_logs(&cell, &up.log);
        if let Some(told) = told {
            assert_eq!(account.positions(), told, "in the log, and told");
        }
        start_again(&cell);
    }

    /// Gives the process that does not live any more.
    fn strike(&self, cell: &Cell, daemon: u32) -> Option<u32> {
        let process = match self.victim {
            Victim::Worker(card) => Some(cell.worker(card)),
            Victim::Recorder => Some(cell.recorder()),
            Victim::Daemon => cell.processes().into_iter().find(|process| process.pid == daemon),
            // The program may be over.
            Victim::Client => cell.processes().into_iter().find(|process| process.has(&["run"])),
        };
        let send = |signal| process.iter().all(|process| process.reaches(signal));
        let reached = match self.fate {
            Fate::Killed => send(Signal::KILL),
            Fate::Paused(time) => {
                let reached = send(Signal::STOP);
                thread::sleep(time);
                reached && send(Signal::CONT)
            }
            Fate::Hung(time) => {
                let reached = send(Signal::STOP);
                thread::sleep(time);
                reached && send(Signal::KILL)
            }
        };
        assert!(reached || self.victim == Victim::Client, "who is of the set lives on");
        process.filter(|_| !matches!(self.fate, Fate::Paused(_))).map(|process| process.pid)
    }

    /// The set has survived: everybody comes back, every axis can be moved, and it goes down in order. Gives the positions that
    /// it told in the end.
    fn take_down(&self, cell: &Cell, killed: Option<u32>) -> BTreeMap<AxisNumber, Option<i64>> {
        eventually("everybody is there", || {
            // The daemon need not have noticed yet that somebody is gone.
            let running =
                |row: &Value| row["state"] == "running" && row["pid"].as_u64() != killed.map(u64::from);
            cell.ccu("ps --json --name cell").good().json().iter().all(running).then_some(())
        });
        let standing = eventually("everybody stands", || {
            let axes = cell.status();
            axes.iter().all(|axis| axis["alive"] == true && axis["activity"] == "standing").then_some(axes)
        });
        if let (Victim::Worker(card @ 1..=7), Fate::Killed | Fate::Hung(_)) = (self.victim, self.fate) {
            let axis = &standing[usize::from(card) - 1];
            assert!(axis["position"].is_null(), "a new process knows nothing: {axis}");
        }
        cell.ccu("clear").done();
        for axis in &standing {
            let name = axis["name"].as_str().expect("a name");
            if axis["position"].is_null() {
                cell.ccu(&format!("move {name} 10")).fails(1, &["originate"]);
                cell.ccu(&format!("origin {name}")).done();
            }
            let on = if axis["position"].as_i64() > Some(3_000) { -7 } else { 7 };
            let moved = cell.ccu(&format!("move {name} {on} --json")).good().json().remove(0);
            assert_eq!(moved["position"], axis["position"].as_i64().unwrap_or(0) + on, "{moved}");
        }
        let told = cell.positions();
        let down = cell.ccu("down").good();
        cell.assert_nothing_left();
        let counts = supersigma_tests::counts(&down.stdout);
        // Without its recorder some frames were on the bus that nobody wrote down.
        match (self.victim, counts) {
            (Victim::Recorder, Some((sent, logged))) => assert!(logged <= sent, "{down}"),
            (_, Some((sent, logged))) => assert_eq!(sent, logged, "{down}"),
            (_, None) => panic!("no counts in {down}"),
        }
        told
    }

    /// Every file of the log can be read, and nothing in it contradicts the machines.
    fn read_logs(&self, cell: &Cell, log: &Path) -> Account {
        let files = log_files(log);
        for file in &files {
            let name = file.display();
            let info = cell.ccu(&format!("log info --json {name}")).good().json().remove(0);
            let cut = info["state"] == "cut";
            let frames = cell.ccu(&format!("frames --json {name}"));
            assert_eq!((frames.code(), frames.stderr.is_empty()), (Some(0), !cut), "{frames}");
            assert_eq!(frames.stdout.lines().count() as u64, info["frames"]["all"], "{info}");
            // Only a recorder that was killed leaves a file that is not whole.
            assert!(info["state"] == "complete" || (cut && self.victim == Victim::Recorder), "{info}");
            if cut {
                let mended = file.with_extension("mended");
                cell.ccu(&format!("recover {name} -o {}", mended.display())).done();
                let of_mended = cell.ccu(&format!("log info --json {}", mended.display())).good().json();
                let facts = (&of_mended[0]["state"], &of_mended[0]["frames"]);
                assert_eq!(facts, (&Value::from("complete"), &info["frames"]));
            }
            let verified = cell.ccu(&format!("replay --verify --json {name}"));
            let result = verified.json().remove(0);
            let whole = self.victim != Victim::Recorder || file == log;
            assert!(
                result["result"] == "identical" || (!whole && result["result"] == "unverifiable"),
                "{verified}"
            );
        }
        let account = Account::of(&files);
        assert!(account.faults.is_empty(), "{:#?}", account.faults);
        assert!(account.missing == 0 || self.victim == Victim::Recorder, "{account:?}");
        account
    }
}

/// What a killed set has left is no obstacle.
fn start_again(cell: &Cell) {
    for (number, file) in log_files(&cell.path("cell.mcap")).iter().enumerate() {
        fs::rename(file, cell.path(&format!("before-{number}.mcap"))).expect("a log of the first set");
    }
    let _up = cell.up("20");
    cell.ccu("origin wrist").done();
    cell.ccu("move wrist 100").done();
    assert_eq!(cell.down(), None);
}

/// A card counts as silent soon; all other limits are those that a busy machine keeps.
fn config() -> String {
    let text = changed(&patient(), "silent_ms = 30000 ", "silent_ms = 1500 ");
    changed(&text, "lead_ms = 300 ", "lead_ms = 200 ")
}

/// Says how a round that has failed is made again.
struct Tell<'a>(&'a Round);

impl Drop for Tell<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            eprintln!("{:#?}\n{}", self.0, self.0.program.text);
            eprintln!(
                "SUPERSIGMA_SEED={} cargo test -p supersigma-ccu --test rounds -- --include-ignored makes this round again",
                self.0.seed
            );
        }
    }
}

/// Makes these rounds, two at a time; or the one that somebody wants to see again.
fn rounds(first: u64, count: u64) {
    let wanted = env::var("SUPERSIGMA_SEED").ok().map(|seed| seed.parse::<u64>().expect("a number"));
    let (first, count) = wanted.map_or((first, count), |seed| (seed, 1));
    let next = AtomicU64::new(first);
    let failed = thread::scope(|scope| {
        let play = || {
            while let Some(seed) =
                Some(next.fetch_add(1, Ordering::Relaxed)).filter(|seed| *seed < first + count)
            {
                let round = Round::new(seed);
                let _tell = Tell(&round);
                round.play();
            }
        };
        let both = [scope.spawn(play), scope.spawn(play)];
        both.map(|one| one.join().is_err())
    });
    assert_eq!(failed, [false; 2], "rounds have failed: see above");
}

#[test]
fn ten_rounds() {
    rounds(1, 10);
}

/// Other rounds each time.
#[test]
#[ignore = "minutes: `just long`"]
fn a_hundred_rounds() {
    let count = env::var("SUPERSIGMA_ROUNDS").map_or(100, |count| count.parse().expect("a number"));
    rounds(fastrand::u64(0..1_000_000_000), count);
}
