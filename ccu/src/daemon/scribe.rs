//! Keeps the recorder alive. One that ends without a word is started again, and the log goes on in another file; one that
//! has said what is wrong, a full disk for example, is not: that is for people.

use std::io;
use std::path::Path;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axis_worker::clock::Monotonic;

use super::StartError;
use super::births::{Births, Recorder, pause_after};
use super::process::Process;
use super::recording::{Ear, Recording, Words};
use crate::log::LogSummary;

/// The recorder's process and what is known of it.
pub(super) struct Scribe {
    recording: Recording,
    process: Arc<Mutex<Process>>,
    last_words: Receiver<LogSummary>,
}

impl Scribe {
    /// Starts the recorder, and returns when it hears the bus.
    ///
    /// # Errors
    /// If it does not come to life, or the log cannot be begun.
    pub(super) fn start(births: &Births, log: &Path) -> Result<Self, StartError> {
        let Recorder { process, lines, ended } = births.recorder(log, 1, None)?;
        let recording = Recording::new(log, process.pid());
        let process = Arc::new(Mutex::new(process));
        let ear = Ear {
            on_loss: births.exchange.knowledge().config.log.on_loss,
            no_log: {
                let exchange = Arc::clone(&births.exchange);
                Box::new(move |trouble| exchange.no_log(trouble))
            },
            leaving: {
                let leaving = Arc::clone(&births.leaving);
                Box::new(move || leaving.is_set())
            },
            again: if births.exchange.knowledge().config.supervision.restart {
                let (births, log, process) = (births.clone(), log.to_owned(), Arc::clone(&process));
                Some(Box::new(move |part, gone| again(&births, &log, part, gone, &process)))
            } else {
                None
            },
        };
        let last_words = recording.listen(Words { lines, ended }, ear);
        let last_words =
            last_words.map_err(|source: io::Error| StartError::Io { what: "hear the recorder", source })?;
        Ok(Self { recording, process, last_words })
    }

    /// What there is to tell.
    pub(super) fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Ends its lifeline, and waits until it has ended; what is in the log then, if it says so within `limit`.
    pub(super) fn finish(&self, limit: Duration) -> Option<LogSummary> {
        lock(&self.process).let_go();
        let summary = self.last_words.recv_timeout(limit).ok();
        lock(&self.process).finish(limit);
        summary
    }
}

/// Starts a recorder that goes on with this part of the log, after a pause that grows while it does not come to life;
/// `None` if nothing shall be started any more.
fn again(
    births: &Births,
    log: &Path,
    mut part: u32,
    gone: Monotonic,
    process: &Mutex<Process>,
) -> Option<(Words, u32)> {
    let mut failures = 1;
    while !births.leaving.wait(pause_after(failures)) {
        match births.recorder(log, part, Some(gone)) {
            Ok(recorder) => {
                let pid = recorder.process.pid();
                let mut process = lock(process);
                // Whoever takes the set down sets it, and then lets go of what is here.
                let leaving = births.leaving.is_set();
                *process = recorder.process;
                if leaving {
                    process.let_go();
                    return None;
                }
                births.exchange.log_again();
                return Some((Words { lines: recorder.lines, ended: recorder.ended }, pid));
            }
            // The one before may have begun it without a word, or it is somebody else's.
            Err(StartError::LogExists(_)) => part += 1,
            Err(error) => {
                tracing::error!(%error, "the recorder cannot be started again");
                failures += 1;
            }
        }
    }
    None
}

fn lock(process: &Mutex<Process>) -> MutexGuard<'_, Process> {
    process.lock().unwrap_or_else(PoisonError::into_inner)
}
