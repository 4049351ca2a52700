//! The recorder as the daemon knows it: what it said last, whether it records, and what to tell whoever wants to move
//! when it does not. One thread reads its words; when they end, the recorder has ended.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use supersigma_config::OnLoss;

use super::recorder::{Cause, Said};
use crate::control::{RecorderState, RecorderView};
use crate::executive::LogTrouble;
use crate::log::{LogSummary, RecorderStatus};

/// How long an exit status may take once a process has said its last word.
const STATUS: Duration = Duration::from_secs(5);

/// What is known of the recorder; shared.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    log: PathBuf,
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    recorder: RecorderState,
    status: RecorderStatus,
    trouble: Option<LogTrouble>,
    done: Option<LogSummary>,
}

/// What the thread that reads a recorder's words does with them.
pub(super) struct Ear {
    /// The words.
    pub(super) lines: Receiver<String>,
    /// How the process ended, once it has.
    pub(super) ended: Receiver<ExitStatus>,
    /// What follows when frames are missing.
    pub(super) on_loss: OnLoss,
    /// Nothing moves any more: there is no log.
    pub(super) no_log: Box<dyn Fn(LogTrouble) + Send>,
    /// Whether processes end because they shall.
    pub(super) leaving: Box<dyn Fn() -> bool + Send>,
}

impl Recording {
    /// A recorder that has begun the log.
    pub(super) fn new(log: &Path) -> Self {
        let state = State {
            recorder: RecorderState::Recording,
            status: RecorderStatus::default(),
            trouble: None,
            done: None,
        };
        Self { log: log.to_owned(), state: Arc::new(Mutex::new(state)) }
    }

    /// Listens until the recorder has ended. Its last words come out of what is returned, and then nothing any more.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn listen(&self, ear: Ear) -> std::io::Result<Receiver<LogSummary>> {
        let (over, last) = mpsc::channel();
        let recording = self.clone();
        thread::Builder::new().name("recorder's words".into()).spawn(move || {
            for line in &ear.lines {
                recording.hear(&line, &ear);
            }
            recording.has_ended(&ear);
            if let Some(summary) = recording.state().done.take() {
                let _ = over.send(summary);
            }
        })?;
        Ok(last)
    }

    /// What there is to tell.
    pub(super) fn view(&self) -> RecorderView {
        let state = self.state();
        let RecorderStatus { log, behind_ms, .. } = state.status.clone();
        RecorderView {
            state: state.recorder,
            log: log.parts.last().unwrap_or(&self.log).clone(),
            parts: if log.parts.is_empty() { vec![self.log.clone()] } else { log.parts },
            frames: log.frames,
            lost: log.lost,
            bytes: log.bytes,
            behind_ms,
            trouble: state.trouble.clone(),
        }
    }

    fn hear(&self, line: &str, ear: &Ear) {
        match serde_json::from_str(line) {
            Ok(Said::Ready) => {}
            Ok(Said::Status(status)) => self.take(status, ear),
            Ok(Said::Done(summary)) => {
                let mut state = self.state();
                state.status.log = summary.clone();
                state.done = Some(summary);
            }
            Ok(Said::Failed { cause, trouble }) => {
                let state = match cause {
                    Cause::DiskFull => RecorderState::DiskFull,
                    Cause::Exists | Cause::Other => RecorderState::Stopped,
                };
                self.fail(state, trouble, ear);
            }
            Err(error) => tracing::warn!(%error, line, "the recorder says something strange"),
        }
    }

    fn take(&self, status: RecorderStatus, ear: &Ear) {
        let lost = status.log.lost;
        let more = lost > std::mem::replace(&mut self.state().status, status).log.lost;
        if !more {
            return;
        }
        let log = self.log.display();
        match ear.on_loss {
            OnLoss::Warn => {
                tracing::error!(lost, log = %log, "frames are missing from the log; motion goes on");
            }
            OnLoss::Stop => {
                let trouble = LogTrouble {
                    reason: format!("{lost} frames are missing from the log {log} (log.on_loss is \"stop\")"),
                    advice: "the log tells where; take the set down and up again".to_owned(),
                };
                self.fail(RecorderState::Recording, trouble, ear);
            }
        }
    }

    /// The words have ended. Whether that is news depends on whether the recorder has said why.
    fn has_ended(&self, ear: &Ear) {
        let status = ear.ended.recv_timeout(STATUS).ok();
        let before = self.state().recorder;
        let why_is_known = before != RecorderState::Recording;
        if !why_is_known {
            self.state().recorder = RecorderState::Stopped;
        }
        if why_is_known || (ear.leaving)() {
            return;
        }
        let how = status.map_or_else(|| "it has closed its output".to_owned(), |status| status.to_string());
        let LogSummary { frames, bytes, .. } = self.state().status.log.clone();
        let trouble = LogTrouble {
            reason: format!(
                "the recorder is gone ({how}): at least {frames} frames in {bytes} bytes are in the log {}",
                self.view().log.display()
            ),
            advice: "what was recorded can be read; look at the free space where the log is, then take the set down and \
                     up again"
                .to_owned(),
        };
        self.fail(RecorderState::Stopped, trouble, ear);
    }

    fn fail(&self, state: RecorderState, trouble: LogTrouble, ear: &Ear) {
        {
            let mut now = self.state();
            now.recorder = state;
            now.trouble = Some(trouble.clone());
        }
        if !(ear.leaving)() {
            tracing::error!(
                "{}; all axes brake, and nothing moves without a log; {}",
                trouble.reason,
                trouble.advice
            );
            (ear.no_log)(trouble);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is in there is whole after every statement.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
