//! How the set's processes come to life: with what arguments, and when they count as living. Who starts them again is
//! not known here.

use std::ffi::OsString;
use std::io;
use std::path::Path;
use std::process::ExitStatus;
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axis_worker::clock::{Clock, Monotonic};
use supersigma_protocol::Address;

use super::StartError;
use super::exchange::Exchange;
use super::foxglove::ViewAddress;
use super::members::Members;
use super::process::Process;
use super::recorder::{Cause, Said};
use crate::home::Home;
use crate::log::WallTime;

/// How long processes may take to come to life.
pub(super) const BIRTH: Duration = Duration::from_secs(20);

/// A recorder that hears the bus.
pub(super) struct Recorder {
    pub(super) process: Process,
    /// What it says.
    pub(super) lines: Receiver<String>,
    /// How it ended, once it has.
    pub(super) ended: Receiver<ExitStatus>,
}

/// What is needed to bring processes to life.
#[derive(Clone)]
pub(super) struct Births {
    pub(super) home: Home,
    pub(super) clock: Clock,
    /// The wall time of tick 0.
    pub(super) wall_epoch: WallTime,
    pub(super) exchange: Arc<Exchange>,
    /// Those that play a card.
    pub(super) members: Members,
    /// Once set, processes end because they shall.
    pub(super) leaving: Arc<Leaving>,
    /// Whether the set was started for a program.
    pub(super) script: bool,
}

impl Births {
    fn common(&self, command: &str) -> Vec<OsString> {
        let mut arguments: Vec<OsString> = vec![command.into()];
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        option("--runtime", self.home.folder().into());
        option("--config", self.home.config().into());
        option("--ccu", std::process::id().to_string().into());
        option("--epoch", self.clock.epoch().as_nanos().to_string().into());
        option("--time-scale", self.clock.scale().to_string().into());
        arguments
    }

    /// Starts one card's process; `ended` is called, on a thread of its own, when it has ended. It lives once it joins.
    ///
    /// # Errors
    /// If it cannot be started.
    pub(super) fn worker(
        &self,
        card: Address,
        ended: impl FnOnce(ExitStatus) + Send + 'static,
    ) -> io::Result<Process> {
        let mut arguments = self.common("axis-worker");
        arguments.extend(["--card".into(), card.0.to_string().into()]);
        self.members.admit(card, || Process::start(arguments, ended), Process::pid)
    }

    /// The arguments of processes that hear everything.
    fn listener(&self, command: &str) -> Vec<OsString> {
        let mut arguments = self.common(command);
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        option("--set", self.home.name().to_string().into());
        option("--wall-epoch", self.wall_epoch.0.to_string().into());
        arguments
    }

    /// Starts the live view, and returns when it listens, with its URL. Nothing depends on it.
    ///
    /// # Errors
    /// If it does not come to life.
    pub(super) fn view(&self, address: ViewAddress) -> Result<(Process, String), StartError> {
        let mut arguments = self.listener("foxglove-server");
        arguments.extend(["--address".into(), address.to_string().into()]);
        let leaving = Arc::clone(&self.leaving);
        let started = Process::start(arguments, move |status| {
            if !leaving.is_set() {
                tracing::warn!(%status, "the Foxglove server has ended; the set goes on");
            }
        });
        let cannot = |source| StartError::Io { what: "start the Foxglove server", source };
        let mut view = started.map_err(cannot)?;
        let url = view.line(BIRTH).ok_or(StartError::NoView(address))?;
        view.tell_events(None).map_err(cannot)?;
        Ok((view, url))
    }

    /// Starts a recorder that writes `log`, from this part on (the first is 1), and returns when it hears the bus. If it takes
    /// the place of one that was gone at `since`, it writes the events from then on.
    ///
    /// # Errors
    /// If it does not come to life, or its file cannot be begun.
    pub(super) fn recorder(
        &self,
        log: &Path,
        part: u32,
        since: Option<Monotonic>,
    ) -> Result<Recorder, StartError> {
        let mut arguments = self.listener("recorder");
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        option("--log", log.into());
        option("--part", part.to_string().into());
        if self.script {
            option("--script", self.home.script().into());
        }
        let (told, ended) = mpsc::channel();
        let tell = move |status| {
            // Whoever has its last words asks for the status; before that, nobody may.
            let _ = told.send(status);
        };
        let cannot = |source| StartError::Io { what: "start the recorder", source };
        let mut process = Process::start(arguments, tell).map_err(cannot)?;
        let first = process.line(BIRTH).and_then(|line| serde_json::from_str(&line).ok());
        match first {
            Some(Said::Ready) => {
                process.tell_events(since).map_err(cannot)?;
                Ok(Recorder { lines: process.take_lines(), ended, process })
            }
            Some(Said::Failed { cause: Cause::Exists, .. }) => Err(StartError::LogExists(log.to_owned())),
            Some(Said::Failed { trouble, .. }) => Err(StartError::NoLog(trouble)),
            Some(Said::Status(_) | Said::Done(_)) | None => {
                Err(StartError::NoRecorder { log: log.to_owned() })
            }
        }
    }
}

/// Whether processes end because they shall; once set, it stays so.
#[derive(Debug, Default)]
pub(super) struct Leaving {
    set: Mutex<bool>,
    changed: Condvar,
}

impl Leaving {
    /// From now on nothing is started any more.
    pub(super) fn set(&self) {
        *self.flag() = true;
        self.changed.notify_all();
    }

    /// Whether it is so.
    pub(super) fn is_set(&self) -> bool {
        *self.flag()
    }

    /// Waits until it is so, for `limit` at most; says whether it is.
    pub(super) fn wait(&self, limit: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.flag(), limit, |set| !*set);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }

    fn flag(&self) -> MutexGuard<'_, bool> {
        // One flag is always whole.
        self.set.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The pause before a process is started again after so many failures in a row: 100 ms, then twice as long after each
/// further one, 5 s at most.
pub(super) fn pause_after(failures: u32) -> Duration {
    let longest = Duration::from_secs(5);
    Duration::from_millis(100).saturating_mul(1 << failures.saturating_sub(1).min(16)).min(longest)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn the_pause_grows_to_a_limit() {
        let pauses: Vec<u128> = (1..=8).map(|failures| pause_after(failures).as_millis()).collect();
        assert_eq!(pauses, [100, 200, 400, 800, 1_600, 3_200, 5_000, 5_000]);
        assert_eq!(pause_after(u32::MAX), Duration::from_secs(5));
    }

    #[test]
    fn whoever_waits_is_told_at_once() {
        let leaving = Leaving::default();
        assert!(!leaving.is_set() && !leaving.wait(Duration::ZERO));
        thread::scope(|scope| {
            let waiting = scope.spawn(|| leaving.wait(Duration::from_secs(60)));
            leaving.set();
            assert!(waiting.join().expect("it ends"));
        });
        assert!(leaving.is_set());
    }
}
