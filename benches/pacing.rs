//! How late a worker handles what its machine does by itself: the difference of the ticks in its answers, when the card acted
//! and when the frame was sent, of real worker processes whose axes move. A worker wakes for a sample as it wakes for a
//! reload of the 8253, but only the sample makes a frame, so samples stand for both. Samples of all axes fall on the same
//! ticks: with seven axes, seven processes want a processor at once.
//!
//! Beside it, in turn with it: cyclictest with as many threads, the same period, alignment, policy and priority; where it is
//! not installed, a thread that sleeps until absolute times.

use std::error::Error;
use std::process::Command;
use std::thread;
use std::time::Duration;

use axis_worker::clock::{Clock, Monotonic, TimeScale};
use axis_worker::real_time;
use ccu::daemon::LiveLink;
use ccu::executive::{Displacement, Executive, Link, Operate, Outcome, Request};
use ccu::log::LogReader;
use supersigma_config::{Config, RealTimeConfig, SchedulingPolicy};
use supersigma_protocol::{About, Activity, AxisNumber, Body, Frame, Occasion, Position, Steps, Tick, Ticks};

use crate::figure::Figure;
use crate::live::LiveSet;
use crate::peers::Peer;
use crate::span::{TOLD, Times};

const ROOM: &str = "pacing";
/// From one event to the next: 2 ms, the shortest reload of a ramp is 1.29 ms.
const PERIOD_MS: u32 = 2;
/// A movement at this speed in steps per second, and so many steps, takes 4 s.
const SPEED: f64 = 4_000.0;
const STEPS: i64 = 16_000;
/// How long the reference is measured each time.
const SPAN: Duration = Duration::from_secs(4);
/// Reference and set take turns so often.
const TURNS: usize = 2;
/// Latencies beyond so many microseconds count as this one.
const LONGEST_US: u32 = 30_000;

type Failed = Box<dyn Error>;

/// What is measured at a time.
#[derive(Debug, Clone, Copy)]
struct Setting {
    axes: usize,
    busy: bool,
}

const SETTINGS: [Setting; 4] = [
    Setting { axes: 1, busy: false },
    Setting { axes: 7, busy: false },
    Setting { axes: 1, busy: true },
    Setting { axes: 7, busy: true },
];

pub(crate) fn measure() -> Result<Vec<Figure>, Failed> {
    let mut figures = Vec::new();
    for policy in [SchedulingPolicy::Normal, SchedulingPolicy::Fifo] {
        let real_time = RealTimeConfig { policy, ..RealTimeConfig::default() };
        if granted(&real_time)? {
            figures.extend(of_policy(&real_time)?);
        } else {
            println!("pacing: no privilege for SCHED_FIFO here, so only the normal policy is measured");
        }
    }
    Ok(figures)
}

/// Whether this process may have that; its workers may have what it may.
fn granted(real_time: &RealTimeConfig) -> Result<bool, Failed> {
    let asked = real_time.clone();
    // On a thread that ends: the benchmark itself stays normal.
    let missing = thread::spawn(move || real_time::ask_for(&asked)).join();
    Ok(missing.map_err(|_| "the privilege cannot be asked for")?.is_empty())
}

fn of_policy(real_time: &RealTimeConfig) -> Result<Vec<Figure>, Failed> {
    let folder = tempfile::Builder::new().prefix("ssp").tempdir_in("/tmp")?;
    let mut config = Config::default_set();
    config.log.sample_ms = PERIOD_MS;
    config.real_time = real_time.clone();
    for axis in &mut config.axes {
        axis.rail.length = Steps(200_000);
        axis.rail.upper_zone = Steps(199_000);
        axis.travel.max = Position(190_000);
    }
    let set = LiveSet::up(folder.path(), "pacing", config)?;
    let clock = set.link();
    let mut executive = Executive::new(set.link());
    operate(&mut executive, Request::Originate { axes: Vec::new() })?;
    let mut references = SETTINGS.map(|_| Times::default());
    let mut phases = Vec::new();
    let mut out = true;
    for (index, setting) in SETTINGS.iter().enumerate() {
        let hogs = if setting.busy { Peer::everywhere()? } else { Vec::new() };
        for _ in 0..TURNS {
            reference(setting.axes, real_time, &mut references[index])?;
            let began = clock.now();
            there_or_back(&mut executive, setting.axes, out)?;
            phases.push((index, began, clock.now()));
            out = !out;
        }
        drop(hogs);
    }
    drop((executive, clock));
    let report = set.down();
    let mut ours = SETTINGS.map(|_| Times::default());
    for logged in LogReader::open(&report.log)? {
        let Ok(frame) = logged?.frame else { continue };
        if let Some((at, late)) = lateness(&frame)
            && let Some((index, ..)) = phases.iter().find(|(_, from, to)| (*from..*to).contains(&at))
        {
            ours[*index].add_micros(late);
        }
    }
    let mut figures = Vec::new();
    for (setting, (reference, ours)) in SETTINGS.iter().zip(references.iter_mut().zip(&mut ours)) {
        figures.extend(told(*setting, real_time.policy, reference, ours));
    }
    Ok(figures)
}

fn told(setting: Setting, policy: SchedulingPolicy, reference: &mut Times, ours: &mut Times) -> Vec<Figure> {
    let policy = match policy {
        SchedulingPolicy::Normal => "normal",
        SchedulingPolicy::Fifo => "fifo",
    };
    let machine = if setting.busy { "busy" } else { "idle" };
    let axes = if setting.axes == 1 { "one axis" } else { "seven axes" };
    let name = if has_cyclictest() { "cyclictest" } else { "an absolute sleep (no cyclictest here)" };
    let figures = TOLD.map(|(statistic, share)| {
        let figure = |what: &str, value| {
            Figure::new(ROOM, format!("{what}, {policy}, {machine}, {axes}, {statistic}"), value, "µs")
        };
        let of = reference.share(share);
        [figure("reference", of), figure("lateness", ours.share(share)).against(name, of)]
    });
    figures.into_iter().flatten().collect()
}

/// When a sample was due, and by how many microseconds it was sent later.
fn lateness(frame: &Frame) -> Option<(Tick, f64)> {
    let Body::Answer(answer) = &frame.body else { return None };
    let late = frame.tick.since(answer.acted_at);
    let sampled = answer.about == About::Unasked(Occasion::Sampled);
    sampled.then(|| (answer.acted_at, late.as_seconds() * 1e6))
}

fn operate(executive: &mut Executive<LiveLink>, request: Request) -> Result<Outcome, Failed> {
    executive.operate(request).map_err(|failure| failure.to_string().into())
}

/// So many axes move, each on its own.
fn there_or_back(executive: &mut Executive<LiveLink>, axes: usize, out: bool) -> Result<(), Failed> {
    let by = Displacement(if out { STEPS } else { -STEPS });
    let mut begun = Vec::new();
    for axis in AxisNumber::all().take(axes) {
        let request = Request::Move { axis, by, speed: Some(SPEED), constant: false, wait: false };
        operate(executive, request)?;
        begun.push(axis);
    }
    for axis in begun {
        while !stands(executive, axis)? {
            operate(executive, Request::Wait { ticks: Ticks::from_millis(100) })?;
        }
    }
    Ok(())
}

fn stands(executive: &mut Executive<LiveLink>, axis: AxisNumber) -> Result<bool, Failed> {
    match operate(executive, Request::Status { axes: vec![axis] })? {
        Outcome::Axes(states) => Ok(states
            .iter()
            .all(|state| state.report.is_some_and(|report| report.activity == Activity::Standing))),
        other => Err(format!("{other:?} is no status").into()),
    }
}

fn has_cyclictest() -> bool {
    Command::new("cyclictest").arg("--help").output().is_ok()
}

fn reference(threads: usize, real_time: &RealTimeConfig, times: &mut Times) -> Result<(), Failed> {
    if has_cyclictest() { cyclictest(threads, real_time, times) } else { sleeps(threads, real_time, times) }
}

fn cyclictest(threads: usize, real_time: &RealTimeConfig, times: &mut Times) -> Result<(), Failed> {
    let mut command = Command::new("cyclictest");
    command.args(["--quiet", "--default-system", "--secaligned"]);
    command.arg(format!("--threads={threads}")).arg(format!("--interval={}", PERIOD_MS * 1_000));
    command.arg(format!("--histogram={LONGEST_US}")).arg(format!("--duration={}", SPAN.as_secs() + 1));
    match real_time.policy {
        SchedulingPolicy::Normal => command.arg("--policy=other"),
        SchedulingPolicy::Fifo => {
            command.arg("--policy=fifo").arg(format!("--priority={}", real_time.priority))
        }
    };
    let output = command.output()?;
    if !output.status.success() {
        return Err(format!("cyclictest: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    // A line a microsecond, a column a thread; then lines that begin with `#`.
    for line in String::from_utf8(output.stdout)?.lines() {
        if let Some(overflows) = line.strip_prefix("# Histogram Overflows:") {
            repeat(times, f64::from(LONGEST_US), overflows)?;
        } else if !line.starts_with('#')
            && let Some((micros, counts)) = line.split_once(' ')
        {
            repeat(times, micros.parse()?, counts)?;
        }
    }
    Ok(())
}

fn repeat(times: &mut Times, micros: f64, counts: &str) -> Result<(), Failed> {
    for count in counts.split_whitespace() {
        for _ in 0..count.parse::<u32>()? {
            times.add_micros(micros);
        }
    }
    Ok(())
}

fn sleeps(threads: usize, real_time: &RealTimeConfig, times: &mut Times) -> Result<(), Failed> {
    let clock = Clock::new(Monotonic::now(), TimeScale::REAL);
    let sleeper = || {
        let asked = real_time.clone();
        thread::spawn(move || {
            let _ = real_time::ask_for(&asked);
            let mut late = Vec::new();
            let mut next = Tick(0);
            while next < Tick(0) + TimeScale::REAL.ticks(SPAN) {
                next += Ticks::from_millis(PERIOD_MS.into());
                thread::sleep(clock.until(next));
                late.push(clock.now().since(next));
            }
            late
        })
    };
    let sleepers: Vec<_> = (0..threads).map(|_| sleeper()).collect();
    for sleeper in sleepers {
        for late in sleeper.join().map_err(|_| "a sleeper has failed")? {
            times.add_micros(late.as_seconds() * 1e6);
        }
    }
    Ok(())
}
