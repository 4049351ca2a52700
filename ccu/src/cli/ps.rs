//! `ccu ps` and `ccu kill-worker`: the processes of sets. What the kernel knows of them comes from `/proc`.

use std::fs;
use std::io::{self, Write};
use std::time::Duration;

use clap::{Args, ValueEnum};
use miette::miette;
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use supersigma_config::Config;
use supersigma_protocol::{Address, CardKind};

use super::asked::Asked;
use super::exit::Exit;
use super::{SetArgs, show};
use crate::control::{Client, Description, ProcessRole, ProcessState, ProcessView};
use crate::home::{Home, SetName};

#[derive(Args)]
pub(super) struct PsArgs {
    /// Only this set; all of yours if none is named
    #[arg(long, value_name = "NAME")]
    name: Option<SetName>,
    /// One JSON object a process
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct KillWorkerArgs {
    /// The axis, by name or number, or `digital`
    axis: String,
    /// What is done to its process
    #[arg(long, value_enum, default_value_t = Blow::Kill)]
    signal: Blow,
    #[command(flatten)]
    set: SetArgs,
}

/// What can be done to a process on purpose.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Blow {
    /// End it at once
    Kill,
    /// Let it hang
    Stop,
    /// Let it go on
    Cont,
}

/// One process, for programs and people.
#[derive(Debug, Serialize)]
struct Row {
    set: String,
    /// `ccu`, `recorder` or `worker`.
    role: &'static str,
    axis: Option<u8>,
    /// The axis' name, or `digital`.
    name: Option<String>,
    pid: Option<u32>,
    state: &'static str,
    up_s: f64,
    /// Processor time since its start, in percent of one core.
    cpu_percent: Option<f64>,
    rss_bytes: Option<u64>,
    restarts: u32,
}

pub(super) fn ps(args: &PsArgs) -> Result<(), Exit> {
    let names = match &args.name {
        Some(name) => vec![name.clone()],
        None => Home::names()?,
    };
    let mut rows = Vec::new();
    for name in names {
        match Client::connect(&Home::of(name)?).and_then(|mut client| client.describe()) {
            Ok(description) => rows.extend(rows_of(&description)?),
            // Among all sets, one that goes down just now is none.
            Err(failure) if args.name.is_some() => return Err(failure.into()),
            Err(_) => {}
        }
    }
    let mut out = io::stdout().lock();
    if args.json {
        for row in &rows {
            show::print_json(row, &mut out)?;
        }
    } else if rows.is_empty() {
        writeln!(out, "no set is up; `ccu up` starts one")?;
    } else {
        table(&rows, &mut out)?;
    }
    Ok(())
}

pub(super) fn kill_worker(args: &KillWorkerArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let card = match args.axis.as_str() {
        "digital" => Address::DIGITAL_INPUT,
        axis => asked.axis(axis)?.address(),
    };
    let processes = asked.client.describe()?.processes;
    let process = processes.iter().find(|process| process.card == Some(card));
    let pid = process.and_then(|process| process.pid);
    let pid = pid.and_then(|pid| i32::try_from(pid).ok()).and_then(Pid::from_raw).ok_or_else(|| {
        Exit::could_not(miette!(
            help = "`ccu ps` tells when it is back",
            "the worker of {} has no process just now: it waits to be started again",
            args.axis
        ))
    })?;
    let signal = match args.signal {
        Blow::Kill => Signal::KILL,
        Blow::Stop => Signal::STOP,
        Blow::Cont => Signal::CONT,
    };
    kill_process(pid, signal).map_err(|error| Exit::from(io::Error::from(error)))
}

/// The CCU first, then what it has started.
fn rows_of(set: &Description) -> Result<Vec<Row>, Exit> {
    let config = Config::from_toml(&set.config, "the set's configuration");
    let config = config.map_err(|error| Exit::could_not(error.into()))?;
    let usage = Usage::of(set.pid);
    let ccu = Row {
        set: set.name.clone(),
        role: "ccu",
        axis: None,
        name: None,
        pid: Some(set.pid),
        state: "running",
        up_s: usage.as_ref().map_or(set.up_s, |usage| usage.age.as_secs_f64()),
        cpu_percent: usage.as_ref().map(Usage::percent),
        rss_bytes: usage.map(|usage| usage.rss_bytes),
        restarts: 0,
    };
    Ok(std::iter::once(ccu).chain(set.processes.iter().map(|process| row(set, &config, process))).collect())
}

fn row(set: &Description, config: &Config, process: &ProcessView) -> Row {
    let since = Duration::from_millis(process.since_ms);
    let usage = process.pid.and_then(Usage::of);
    let (axis, name) = match process.card.map(Address::kind) {
        Some(CardKind::Axis(axis)) => (Some(axis.get()), config.axis(axis).map(|axis| axis.name.clone())),
        Some(_) => (None, Some("digital".to_owned())),
        None => (None, None),
    };
    Row {
        set: set.name.clone(),
        role: match process.role {
            ProcessRole::Recorder => "recorder",
            ProcessRole::Worker => "worker",
        },
        axis,
        name,
        pid: process.pid,
        state: match process.state {
            ProcessState::Running => "running",
            ProcessState::Silent => "silent",
            ProcessState::Restarting => "restarting",
            ProcessState::Ended => "ended",
        },
        up_s: since.as_secs_f64(),
        cpu_percent: usage.as_ref().map(Usage::percent),
        rss_bytes: usage.map(|usage| usage.rss_bytes),
        restarts: process.restarts,
    }
}

fn table(rows: &[Row], out: &mut dyn Write) -> io::Result<()> {
    let longest = |of: fn(&Row) -> usize, least: usize| rows.iter().map(of).max().unwrap_or(0).max(least);
    let sets = longest(|row| row.set.len(), 3);
    let names = longest(|row| row.name.as_ref().map_or(1, String::len), 4);
    writeln!(
        out,
        "{:<sets$}  {:<8}  {:>4} {:<names$}  {:>8}  {:<10}  {:>9}  {:>5}  {:>8}  {:>8}",
        "set", "process", "axis", "name", "pid", "state", "up", "cpu", "memory", "restarts"
    )?;
    for row in rows {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        writeln!(
            out,
            "{:<sets$}  {:<8}  {:>4} {:<names$}  {:>8}  {:<10}  {:>9}  {:>5}  {:>8}  {:>8}",
            row.set,
            row.role,
            or_dash(row.axis.map(|axis| axis.to_string())),
            or_dash(row.name.clone()),
            or_dash(row.pid.map(|pid| pid.to_string())),
            row.state,
            duration(row.up_s),
            or_dash(row.cpu_percent.map(|cpu| format!("{cpu:.1}%"))),
            or_dash(row.rss_bytes.map(show::size)),
            row.restarts
        )?;
    }
    Ok(())
}

/// For people: `4.2 s`, `3 min 20 s`, `2 h 5 min`, `3 d 4 h`.
fn duration(seconds: f64) -> String {
    let whole = Duration::try_from_secs_f64(seconds).unwrap_or_default().as_secs();
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3_600 => format!("{} min {} s", whole / 60, whole % 60),
        3_600..86_400 => format!("{} h {} min", whole / 3_600, whole / 60 % 60),
        _ => format!("{} d {} h", whole / 86_400, whole / 3_600 % 24),
    }
}

/// What a process has used so far.
#[derive(Debug, Clone, PartialEq)]
struct Usage {
    cpu: Duration,
    /// Since it was started.
    age: Duration,
    rss_bytes: u64,
}

impl Usage {
    /// `None` if there is no such process.
    fn of(pid: u32) -> Option<Self> {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let now = Duration::try_from(rustix::time::clock_gettime(rustix::time::ClockId::Boottime)).ok()?;
        Self::parse(&stat, rustix::param::clock_ticks_per_second(), rustix::param::page_size() as u64, now)
    }

    /// From the text of `/proc/PID/stat`, proc(5): fields 14, 15, 22 and 24, after the name in brackets, which may hold
    /// anything. `now` is the time since the machine was started.
    fn parse(stat: &str, ticks_per_second: u64, page: u64, now: Duration) -> Option<Self> {
        let fields: Vec<&str> = stat.get(stat.rfind(')')? + 1..)?.split_whitespace().collect();
        let number = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
        let duration = |ticks: u64| Duration::from_micros(ticks * 1_000_000 / ticks_per_second.max(1));
        let (cpu, age) = (duration(number(14)? + number(15)?), now.saturating_sub(duration(number(22)?)));
        Some(Self { cpu, age, rss_bytes: number(24)? * page })
    }

    fn percent(&self) -> f64 {
        100.0 * self.cpu.as_secs_f64() / self.age.as_secs_f64().max(0.001)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_whose_name_has_brackets() {
        let stat = "42 (a) b) (c) S 1 42 42 0 -1 4194560 100 0 0 0 150 50 0 0 20 0 3 0 1000 99 7 1844";
        let usage = Usage::parse(stat, 100, 4_096, Duration::from_secs(30)).expect("it is whole");
        let (cpu, age) = (Duration::from_secs(2), Duration::from_secs(20));
        assert_eq!(usage, Usage { cpu, age, rss_bytes: 7 * 4_096 });
        assert!((usage.percent() - 10.0).abs() < 1e-9);
        assert_eq!(Usage::parse("42 (ccu) S 1", 100, 4_096, Duration::ZERO), None);
        assert!(Usage::of(std::process::id()).expect("that is us").rss_bytes > 0);
    }

    #[test]
    fn durations_for_people() {
        for (seconds, text) in
            [(4.25, "4.2 s"), (200.0, "3 min 20 s"), (7_500.0, "2 h 5 min"), (273_600.0, "3 d 4 h")]
        {
            assert_eq!(duration(seconds), text);
        }
    }
}
