//! One process of the set: started with a lifeline, watched until it ends, ended in order or by force. What it does is
//! not known here.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use axis_worker::clock::Monotonic;
use rustix::process::{Pid, Signal, kill_process};

use crate::{notices, program};

/// A child process. Its standard input is its lifeline, its standard output comes here line by line.
#[derive(Debug)]
pub(super) struct Process {
    pid: u32,
    lifeline: Option<ChildStdin>,
    /// What the daemon says, if it goes along the lifeline.
    events: Option<notices::Stream>,
    lines: Receiver<String>,
    end: Arc<End>,
}

/// Whether, and how, a process has ended.
#[derive(Debug, Default)]
struct End {
    status: Mutex<Option<ExitStatus>>,
    changed: Condvar,
}

impl Process {
    /// Starts this very program with `arguments`, in a process group of its own, so that a terminal's Ctrl-C reaches
    /// the CCU alone. `ended` is called, on a thread of its own, when the process has ended.
    ///
    /// # Errors
    /// If it cannot be started.
    pub(super) fn start(
        arguments: impl IntoIterator<Item = OsString>,
        ended: impl FnOnce(ExitStatus) + Send + 'static,
    ) -> io::Result<Self> {
        let mut child = program::again()
            .args(arguments)
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let lifeline = child.stdin.take();
        let lines = lines_of(&mut child)?;
        let (pid, end) = (child.id(), Arc::new(End::default()));
        let watched = Arc::clone(&end);
        thread::Builder::new().name(format!("watch {pid}")).spawn(move || {
            if let Ok(status) = child.wait() {
                *watched.status.lock().unwrap_or_else(PoisonError::into_inner) = Some(status);
                watched.changed.notify_all();
                ended(status);
            }
        })?;
        Ok(Self { pid, lifeline, events: None, lines, end })
    }

    /// Its number.
    pub(super) fn pid(&self) -> u32 {
        self.pid
    }

    /// Its next line of output; `None` if none comes within `limit`, or if there will be none any more.
    pub(super) fn line(&self, limit: Duration) -> Option<String> {
        self.lines.recv_timeout(limit).ok()
    }

    /// All lines of output that are still to come.
    pub(super) fn take_lines(&mut self) -> Receiver<String> {
        std::mem::replace(&mut self.lines, mpsc::channel().1)
    }

    /// Asks it, over the lifeline, to say that it leaves.
    pub(super) fn ask_to_leave(&mut self) {
        if let Some(lifeline) = &mut self.lifeline {
            // If it is gone already, it has left.
            let _ = lifeline.write_all(b"\n").and_then(|()| lifeline.flush());
        }
    }

    /// From now on, what the daemon has to say goes along the lifeline; and the latest of what it has said since `since`.
    ///
    /// # Errors
    /// If the thread that writes cannot be started.
    pub(super) fn tell_events(&mut self, since: Option<Monotonic>) -> io::Result<()> {
        let stream = |lifeline| notices::stream_to(lifeline, since);
        self.events = self.lifeline.take().map(stream).transpose()?;
        Ok(())
    }

    /// Ends its lifeline, behind what is still to be said along it.
    pub(super) fn let_go(&mut self) {
        (self.lifeline, self.events) = (None, None);
    }

    /// Waits until it has ended, and kills it after `limit`; says how it ended.
    pub(super) fn finish(&mut self, limit: Duration) -> Option<ExitStatus> {
        self.let_go();
        let ended = self.wait(limit);
        if ended.is_none() {
            tracing::warn!(
                pid = self.pid,
                limit_ms = limit.as_millis(),
                "a process does not end, it is killed"
            );
            self.kill();
            return self.wait(limit);
        }
        ended
    }

    /// Kills it.
    pub(super) fn kill(&self) {
        // A process that has ended has been waited for, and its number may be another's by now.
        if self.wait(Duration::ZERO).is_none()
            && let Some(pid) = i32::try_from(self.pid).ok().and_then(Pid::from_raw)
            && let Err(error) = kill_process(pid, Signal::KILL)
        {
            tracing::warn!(pid = self.pid, %error, "a process could not be killed");
        }
    }

    fn wait(&self, limit: Duration) -> Option<ExitStatus> {
        let status = self.end.status.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.end.changed.wait_timeout_while(status, limit, |status| status.is_none());
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

fn lines_of(child: &mut Child) -> io::Result<Receiver<String>> {
    let (sender, lines) = mpsc::channel();
    let Some(output) = child.stdout.take() else {
        return Ok(lines);
    };
    thread::Builder::new().name("child's output".into()).spawn(move || {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    })?;
    Ok(lines)
}
