//! What the machine is, and what a process takes of it, read from `/proc`.

use std::env;
use std::fs;
use std::thread;
use std::time::Duration;

use crate::process::Process;

/// What a process takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vitals {
    /// Memory that is in the machine, in bytes: what is shared with others, and the program, counted in.
    pub resident: u64,
    /// What nobody else has.
    pub own: u64,
    /// Open file descriptors.
    pub files: usize,
    /// Processor time since it was started.
    pub processor: Duration,
}

impl Process {
    /// What it takes now; `None` if it has ended.
    #[must_use]
    pub fn vitals(&self) -> Option<Vitals> {
        let of = |file: &str| fs::read_to_string(format!("/proc/{}/{file}", self.pid)).ok();
        let status = of("status")?;
        let bytes = |key| {
            let line = status.lines().find_map(|line| line.strip_prefix(key))?;
            line.trim().strip_suffix(" kB")?.parse().ok().map(|kilobytes: u64| kilobytes * 1024)
        };
        let files = fs::read_dir(format!("/proc/{}/fd", self.pid)).ok()?.count();
        Some(Vitals {
            resident: bytes("VmRSS:")?,
            own: bytes("RssAnon:")?,
            files,
            processor: processor(&of("stat")?)?,
        })
    }

    /// What it is in its set: `ccu`, `recorder`, or `card 3`; `None` if it is a command under way.
    #[must_use]
    pub fn part(&self) -> Option<String> {
        match self.arguments.get(1).map(String::as_str) {
            Some("up") => Some("ccu".into()),
            Some("recorder") => Some("recorder".into()),
            Some("axis-worker") => {
                let at = self.arguments.iter().position(|argument| argument == "--card")?;
                Some(format!("card {}", self.arguments.get(at + 1)?))
            }
            _ => None,
        }
    }
}

/// Time in the program and in the system, the 14th and 15th field of proc(5)'s `stat`.
fn processor(stat: &str) -> Option<Duration> {
    // The second field is the process' name in brackets, and may hold anything.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let (user, system): (u64, u64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    let per_second = rustix::param::clock_ticks_per_second();
    Some(Duration::from_millis((user + system) * 1_000 / per_second))
}

/// What kind of machine this is: processor, cores, memory, system.
#[must_use]
pub fn machine() -> String {
    let first = |file: &str, key: &str| {
        let text = fs::read_to_string(file).unwrap_or_default();
        let line = text.lines().find(|line| line.starts_with(key))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let model = first("/proc/cpuinfo", "model name").unwrap_or_else(|| env::consts::ARCH.into());
    let memory = first("/proc/meminfo", "MemTotal")
        .and_then(|total| total.strip_suffix(" kB")?.parse::<u64>().ok())
        .map_or_else(String::new, |kilobytes| format!(", {} GB", kilobytes.div_ceil(1_000_000)));
    let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{model}, {cores} cores{memory}, Linux {}", kernel.split('-').next().unwrap_or_default().trim())
}
