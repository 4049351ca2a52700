//! What a worker asks of the system to be in time: a scheduling policy, locked memory, processors of its own, and timers that do
//! not dawdle. What it does not get, it does without; whoever started it is told, once, what is missing and how to get it.

use std::io;
use std::num::NonZeroU64;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};
use supersigma_config::{RealTimeConfig, SchedulingPolicy};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Something that the system has refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// What was asked for, and how the worker goes on without it.
    pub what: String,
    /// What the system said.
    pub reason: String,
    /// What to do about it.
    pub advice: &'static str,
}

/// Asks for what `config` wants, for the calling thread and those that it starts from now on; memory is locked as far as the
/// process has it by now. Gives what was refused.
#[must_use]
pub fn ask_for(config: &RealTimeConfig) -> Vec<Missing> {
    let mut missing = Vec::new();
    // Costs nothing and needs no privilege. Else the system may round every waiting up by 50 µs, to wake more at a time.
    if let Err(error) = set_current_timer_slack(NonZeroU64::new(1)) {
        tracing::debug!(%error, "timers keep their slack");
    }
    // Before the policy: a processor of its own is then the only one that it can take from others.
    if !config.cpus.is_empty()
        && let Err(error) = run_on(&config.cpus)
    {
        missing.push(Missing {
            what: format!("real_time.cpus = {:?}: it runs on any processor", config.cpus),
            reason: error.to_string(),
            advice: "name processors that this machine has, and on which this process may run (nproc, taskset -p)",
        });
    }
    if config.policy == SchedulingPolicy::Fifo
        && let Err(reason) = become_fifo(config.priority)
    {
        missing.push(Missing {
            what: format!("real_time.policy = \"fifo\" at priority {}: it works as normal", config.priority),
            reason,
            advice: "allow it with RLIMIT_RTPRIO (LimitRTPRIO= of systemd, rtprio in limits.conf) or CAP_SYS_NICE",
        });
    }
    if config.lock_memory
        && let Err(error) = mlockall(MlockAllFlags::CURRENT)
    {
        missing.push(Missing {
            what: "real_time.lock_memory = true: its memory is not locked".to_owned(),
            reason: error.to_string(),
            advice: "allow it with RLIMIT_MEMLOCK (LimitMEMLOCK= of systemd, memlock in limits.conf) or CAP_IPC_LOCK",
        });
    }
    missing
}

fn run_on(cpus: &[u16]) -> rustix::io::Result<()> {
    let mut set = CpuSet::new();
    for cpu in cpus {
        set.set(usize::from(*cpu));
    }
    sched_setaffinity(None, &set)
}

fn become_fifo(priority: u8) -> Result<(), String> {
    let priority = ThreadPriorityValue::try_from(priority)?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), policy)
        .map_err(|error| match error {
            thread_priority::Error::OS(code) => io::Error::from_raw_os_error(code).to_string(),
            other => other.to_string(),
        })
}
