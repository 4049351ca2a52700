//! What a set costs before it does anything: the time until seven axes are ready, and, while nothing is asked of it, its
//! processor time, wake-ups, memory and log. The reference for the start is as many bare processes of the same program.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use supersigma_config::Config;
use supersigma_tests::{Cell, Process};

use crate::figure::Figure;

const ROOM: &str = "start-up and idle";
/// Each figure of the start is the best of so many rounds.
const ROUNDS: usize = 5;
/// How long an idle set is watched.
const IDLE: Duration = Duration::from_secs(20);
/// What follows from the start has passed by then.
const SETTLING: Duration = Duration::from_secs(2);

/// What a set's processes have used up.
#[derive(Debug, Clone, Copy, Default)]
struct Used {
    processor: Duration,
    wakes: u64,
}

/// An idle set, watched for a while.
struct Idle {
    processes: usize,
    used: Used,
    /// Proportional set sizes in bytes.
    memory: Vec<u64>,
    /// By how much the log has grown.
    log: u64,
}

pub(crate) fn measure() -> Result<Vec<Figure>, Box<dyn Error>> {
    let idle = idle()?;
    let (mut up, mut bare) = (Duration::MAX, Duration::MAX);
    for _ in 0..ROUNDS {
        up = up.min(start_of_a_set());
        bare = bare.min(start_of_bare_processes(idle.processes)?);
    }
    let seconds = IDLE.as_secs_f64();
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let (all, greatest) = (idle.memory.iter().sum(), idle.memory.iter().copied().max().unwrap_or(0));
    let share = 100.0 * idle.used.processor.as_secs_f64() / seconds;
    Ok(vec![
        Figure::new(ROOM, "`ccu up` until seven axes are ready", milliseconds(up), "ms")
            .against("as many bare processes, `ccu --version`", milliseconds(bare)),
        Figure::new(
            ROOM,
            format!("processor time of {} idle processes", idle.processes),
            share,
            "% of a core",
        )
        .at_most(1.0),
        Figure::new(ROOM, "wake-ups of all of them", number(idle.used.wakes) / seconds, "/s"),
        Figure::new(ROOM, "memory of all of them, shared pages once", number(all) / 1e6, "MB"),
        Figure::new(ROOM, "memory of the largest", number(greatest) / 1e6, "MB"),
        Figure::new(
            ROOM,
            format!("log per idle hour, from {seconds} s"),
            number(idle.log) / 1e6 * 3_600.0 / seconds,
            "MB",
        ),
    ])
}

#[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
fn number(count: u64) -> f64 {
    count as f64
}

/// A cell with the set that is compiled in.
fn cell() -> Cell {
    let cell = Cell::new(env!("CARGO_BIN_EXE_ccu"));
    fs::write(cell.config(), Config::default_set().to_toml()).expect("a configuration");
    cell
}

fn start_of_a_set() -> Duration {
    let cell = cell();
    let began = Instant::now();
    let _ = cell.up("1");
    let took = began.elapsed();
    let _ = cell.down();
    took
}

/// All at once, as a set starts its cards.
fn start_of_bare_processes(processes: usize) -> Result<Duration, Box<dyn Error>> {
    let cell = cell();
    let began = Instant::now();
    let started: Vec<_> = (0..processes)
        .map(|_| cell.command(&["--version"]).stdout(Stdio::null()).spawn())
        .collect::<Result<_, _>>()?;
    for mut process in started {
        process.wait()?;
    }
    Ok(began.elapsed())
}

fn idle() -> Result<Idle, Box<dyn Error>> {
    let cell = cell();
    let up = cell.up("1");
    thread::sleep(SETTLING);
    let processes = cell.processes();
    let before = (used(&processes)?, fs::metadata(&up.log)?.len());
    thread::sleep(IDLE);
    let after = (used(&processes)?, fs::metadata(&up.log)?.len());
    let memory = processes.iter().map(memory).collect::<Result<_, _>>()?;
    let _ = cell.down();
    let ((used_before, log_before), (used_after, log_after)) = (before, after);
    let used = Used {
        processor: used_after.processor.saturating_sub(used_before.processor),
        wakes: used_after.wakes - used_before.wakes,
    };
    Ok(Idle { processes: processes.len(), used, memory, log: log_after - log_before })
}

/// Of all their threads.
fn used(processes: &[Process]) -> Result<Used, Box<dyn Error>> {
    let mut used = Used::default();
    for process in processes {
        for thread in fs::read_dir(format!("/proc/{}/task", process.pid))? {
            let thread = thread?.path();
            // Nanoseconds on a processor, nanoseconds waiting for one, turns.
            let times = fs::read_to_string(thread.join("schedstat"))?;
            let spent = times.split(' ').next().unwrap_or_default().parse()?;
            used.processor += Duration::from_nanos(spent);
            used.wakes += entry(&thread.join("status"), "voluntary_ctxt_switches:")?;
        }
    }
    Ok(used)
}

fn memory(process: &Process) -> Result<u64, Box<dyn Error>> {
    let kilobytes = entry(Path::new(&format!("/proc/{}/smaps_rollup", process.pid)), "Pss:")?;
    Ok(kilobytes * 1_024)
}

/// A number that the kernel tells under this name.
fn entry(path: &Path, name: &str) -> Result<u64, Box<dyn Error>> {
    let text = fs::read_to_string(path)?;
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    let number = line.and_then(|line| line.split_whitespace().next());
    Ok(number.ok_or_else(|| format!("{} has no {name}", path.display()))?.parse()?)
}
