//! Processes: those that a test has started itself, and those of a set as the system knows them.

use std::fs;
use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use rustix::process::{Pid, Signal, kill_process};

use crate::eventually;
use crate::ran::Ran;

/// A process that may or may not be ours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Process {
    /// Its number.
    pub pid: u32,
    /// Its arguments, the program first.
    pub arguments: Vec<String>,
}

impl Process {
    /// All processes whose environment has every one of `variables` (`NAME=value`).
    pub(crate) fn all_with(variables: &[String]) -> Vec<Self> {
        let entries = fs::read_dir("/proc").expect("Linux has /proc");
        let pids = entries.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse::<u32>().ok());
        pids.filter_map(|pid| {
            // A process may end while it is being looked at; then it is no more.
            let of = |file: &str| {
                let text = fs::read(format!("/proc/{pid}/{file}")).ok()?;
                let parts = text.split(|byte| *byte == 0).filter(|part| !part.is_empty());
                Some(parts.map(|part| String::from_utf8_lossy(part).into_owned()).collect::<Vec<_>>())
            };
            let environment = of("environ")?;
            let ours = variables.iter().all(|variable| environment.contains(variable));
            Some(Self { pid, arguments: of("cmdline")? }).filter(|_| ours)
        })
        .collect()
    }

    /// Whether `arguments` stand among its own, one after the other.
    #[must_use]
    pub fn has(&self, arguments: &[&str]) -> bool {
        self.arguments.windows(arguments.len()).any(|window| window == arguments)
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        send(self.pid, signal);
    }

    /// Sends it a signal, if it still runs; says whether it did.
    #[must_use]
    pub fn reaches(&self, signal: Signal) -> bool {
        pid(self.pid).is_some_and(|pid| kill_process(pid, signal).is_ok())
    }
}

/// A command that a test has started, and that has not been waited for yet.
#[derive(Debug)]
pub struct Running {
    what: String,
    child: Option<Child>,
    stdout: Collector,
    stderr: Collector,
}

impl Running {
    /// Starts `command`; what it says is collected.
    pub(crate) fn start(mut command: Command) -> Self {
        let words = std::iter::once(command.get_program()).chain(command.get_args());
        let what = words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("cannot start `{what}`: {error}"));
        let stdout = Collector::of(child.stdout.take().expect("piped"));
        let stderr = Collector::of(child.stderr.take().expect("piped"));
        Self { what, child: Some(child), stdout, stderr }
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) {
        send(self.child.as_ref().expect("not waited for yet").id(), signal);
    }

    /// Waits until `text` stands in its standard output.
    pub fn says(&mut self, text: &str) {
        let _ = self.line_with(text);
    }

    /// Waits until `text` stands in its standard output, and gives the whole line.
    #[must_use = "or call `says`"]
    pub fn line_with(&mut self, text: &str) -> String {
        let (what, child) = (&self.what, self.child.as_mut().expect("not waited for yet"));
        eventually(&format!("{text:?} from `{what}`"), || {
            let ended = child.try_wait().expect("a child can be asked");
            let said = self.stdout.text();
            let line = said.split_inclusive('\n').find(|line| line.contains(text) && line.ends_with('\n'));
            assert!(
                line.is_some() || ended.is_none(),
                "`{what}` has ended without {text:?}: {}",
                self.stderr.text()
            );
            line.map(|line| line.trim_end().to_owned())
        })
    }

    /// Waits until it has ended, and nobody holds its output any more.
    #[must_use]
    pub fn end(mut self) -> Ran {
        let child = self.child.as_mut().expect("not waited for yet");
        let status = eventually(&format!("the end of `{}`", self.what), || {
            child.try_wait().expect("a child can be waited for")
        });
        self.child = None;
        let what = std::mem::take(&mut self.what);
        Ran { what, status, stdout: self.stdout.whole(), stderr: self.stderr.whole() }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Only a test that has failed leaves one behind.
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Reads a pipe to its end.
#[derive(Debug)]
struct Collector {
    read: Arc<Mutex<Vec<u8>>>,
    reading: Option<JoinHandle<()>>,
}

impl Collector {
    fn of(mut pipe: impl Read + Send + 'static) -> Self {
        let read = Arc::new(Mutex::new(Vec::new()));
        let into = Arc::clone(&read);
        let reading = thread::spawn(move || {
            let mut buffer = [0; 4096];
            while let Ok(length @ 1..) = pipe.read(&mut buffer) {
                into.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&buffer[..length]);
            }
        });
        Self { read, reading: Some(reading) }
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.read.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }

    fn whole(&mut self) -> String {
        if let Some(reading) = &self.reading {
            eventually("the end of a pipe", || reading.is_finished().then_some(()));
        }
        self.text()
    }
}

fn pid(number: u32) -> Option<Pid> {
    i32::try_from(number).ok().and_then(Pid::from_raw)
}

fn send(number: u32, signal: Signal) {
    let pid = pid(number).expect("a process number");
    kill_process(pid, signal).unwrap_or_else(|error| panic!("cannot signal process {number}: {error}"));
}
