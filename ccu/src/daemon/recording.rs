//! The recorder as the daemon knows it: what it said last, whether it records, and what to tell whoever wants to move
//! when it does not. One thread reads its words; when they end, the recorder has ended.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use axis_worker::clock::Monotonic;
use supersigma_config::OnLoss;

use super::recorder::{Cause, Said};
use crate::control::{ProcessRole, ProcessState, ProcessView, RecorderState, RecorderView};
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
    pid: u32,
    since: Instant,
    restarts: u32,
    /// When the process ended, if it has.
    ended: Option<Instant>,
    recorder: RecorderState,
    /// What recorders before this one have written.
    earlier: LogSummary,
    status: RecorderStatus,
    trouble: Option<LogTrouble>,
    done: Option<LogSummary>,
}

/// What comes from a recorder.
pub(super) struct Words {
    /// What it says.
    pub(super) lines: Receiver<String>,
    /// How the process ended, once it has.
    pub(super) ended: Receiver<ExitStatus>,
}

/// Starts a recorder that goes on with this part of the log, after one that was gone at this time; its words and its process'
/// number.
type Again = Box<dyn Fn(u32, Monotonic) -> Option<(Words, u32)> + Send>;

/// What the thread that reads a recorder's words does with them.
pub(super) struct Ear {
    /// What follows when frames are missing.
    pub(super) on_loss: OnLoss,
    /// Nothing moves any more: there is no log.
    pub(super) no_log: Box<dyn Fn(LogTrouble) + Send>,
    /// Whether processes end because they shall.
    pub(super) leaving: Box<dyn Fn() -> bool + Send>,
    /// What follows when the recorder is gone without a word; nothing if `None`.
    pub(super) again: Option<Again>,
}

impl Recording {
    /// A recorder that has begun the log.
    pub(super) fn new(log: &Path, pid: u32) -> Self {
        let state = State {
            pid,
            since: Instant::now(),
            restarts: 0,
            ended: None,
            recorder: RecorderState::Recording,
            earlier: LogSummary::default(),
            status: RecorderStatus::default(),
            trouble: None,
            done: None,
        };
        Self { log: log.to_owned(), state: Arc::new(Mutex::new(state)) }
    }

    /// Listens until the recorder has ended and no other follows. The last words come out of what is returned, and then
    /// nothing any more.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn listen(&self, words: Words, ear: Ear) -> std::io::Result<Receiver<LogSummary>> {
        let (over, last) = mpsc::channel();
        let recording = self.clone();
        thread::Builder::new().name("recorder's words".into()).spawn(move || {
            let mut words = words;
            loop {
                for line in &words.lines {
                    recording.hear(&line, &ear);
                }
                let gone = Monotonic::now();
                if !recording.has_gone(&words, &ear) {
                    break;
                }
                let again = ear.again.as_ref().and_then(|again| again(recording.parts() + 1, gone));
                let Some((next, pid)) = again else { break };
                recording.goes_on(pid);
                words = next;
            }
            let mut state = recording.state();
            if let Some(done) = state.done.take() {
                let _ = over.send(state.earlier.clone().and(done));
            }
        })?;
        Ok(last)
    }

    /// What there is to tell.
    pub(super) fn view(&self) -> RecorderView {
        let state = self.state();
        let behind_ms = state.status.behind_ms;
        let log = state.earlier.clone().and(state.status.log.clone());
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

    /// Its process.
    pub(super) fn process(&self) -> ProcessView {
        let state = self.state();
        let ended = state.ended;
        ProcessView {
            role: ProcessRole::Recorder,
            card: None,
            pid: Some(state.pid).filter(|_| ended.is_none()),
            state: if ended.is_some() { ProcessState::Ended } else { ProcessState::Running },
            since_ms: ended.unwrap_or(state.since).elapsed().as_millis().try_into().unwrap_or(u64::MAX),
            restarts: state.restarts,
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

    /// The words have ended; says whether the process has gone without having said why.
    fn has_gone(&self, words: &Words, ear: &Ear) -> bool {
        let status = words.ended.recv_timeout(STATUS).ok();
        let why_is_known = {
            let mut state = self.state();
            state.ended = Some(Instant::now());
            let before = state.recorder;
            if before == RecorderState::Recording {
                state.recorder = RecorderState::Stopped;
            }
            before != RecorderState::Recording
        };
        if why_is_known || (ear.leaving)() {
            return false;
        }
        let how = status.map_or_else(|| "it has closed its output".to_owned(), |status| status.to_string());
        let view = self.view();
        let trouble = LogTrouble {
            reason: format!(
                "the recorder is gone ({how}): at least {} frames in {} bytes are in the log {}",
                view.frames,
                view.bytes,
                view.log.display()
            ),
            advice: if ear.again.is_some() {
                "another one is started, and the log goes on in another file; then `ccu clear`, and go on; `ccu recover` \
                 mends the file that was cut"
                    .to_owned()
            } else {
                "what was recorded can be read; look at the free space where the log is, then take the set down and up \
                 again"
                    .to_owned()
            },
        };
        self.fail(RecorderState::Stopped, trouble, ear);
        true
    }

    /// Another recorder hears the bus.
    fn goes_on(&self, pid: u32) {
        let mut state = self.state();
        let status = std::mem::take(&mut state.status);
        state.earlier = std::mem::take(&mut state.earlier).and(status.log);
        if state.earlier.parts.is_empty() {
            state.earlier.parts.push(self.log.clone());
        }
        (state.pid, state.since, state.ended) = (pid, Instant::now(), None);
        (state.recorder, state.trouble) = (RecorderState::Recording, None);
        state.restarts += 1;
        tracing::warn!(
            restarts = state.restarts,
            "the recorder is started again; the log goes on in another file"
        );
    }

    /// How many files the log has.
    fn parts(&self) -> u32 {
        u32::try_from(self.view().parts.len()).unwrap_or(u32::MAX)
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
