//! The recorder's process: a tap on the bus, a log, and a lifeline. It is a process of its own so that the log survives
//! whatever happens to the CCU. What it has to say goes to its standard output, a line of JSON each ([`Said`]).

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use clap::Args;
use miette::{IntoDiagnostic, WrapErr, miette};
use rustix::process::Signal;
use serde::{Deserialize, Serialize};
use tokio::signal::unix::{SignalKind, signal};

use super::lifeline::Lifeline;
use super::listener::ListenerArgs;
use crate::executive::LogTrouble;
use crate::log::{LogError, LogSummary, LogWriter, RecorderStatus, Rotation, run};

/// Words that may wait for a daemon that does not read; news beyond them are dropped, newer ones follow.
const WAITING_WORDS: usize = 16;

/// What a recorder says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Said {
    /// It hears the bus, and the log is begun.
    Ready,
    /// What has changed.
    Status(RecorderStatus),
    /// Why there is no log, or none any more.
    Failed {
        /// What kind of trouble it is.
        cause: Cause,
        /// For people.
        trouble: LogTrouble,
    },
    /// The log is finished, and this is in it.
    Done(LogSummary),
}

/// Why there is no log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// Its file exists already.
    Exists,
    /// There is no room.
    DiskFull,
    /// Something else.
    Other,
}

/// What the recorder is told by the daemon.
#[derive(Debug, Clone, Args)]
pub struct RecorderArgs {
    /// The set.
    #[command(flatten)]
    pub listener: ListenerArgs,
    /// The program that the set was started for
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// The log
    #[arg(long, value_name = "FILE")]
    pub log: PathBuf,
    /// The first file of it that is this recorder's
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub part: u32,
}

/// Records until the lifeline ends and everybody has left. Whether what went wrong has been said already, on the
/// standard output, is in the result.
///
/// # Errors
/// If the bus or the log fails and nobody has been told.
pub fn record(args: &RecorderArgs) -> miette::Result<bool> {
    let script = args.script.as_ref().map(fs::read_to_string).transpose();
    let script = script.into_diagnostic().wrap_err("cannot read the set's program")?;
    let (config, header) = args.listener.read(script)?;
    let flush = Duration::from_millis(config.log.flush_ms.into());
    outlive_file_size_limit().into_diagnostic()?;
    let mouth = Mouth::open().into_diagnostic()?;
    let writer = match LogWriter::resume(&args.log, args.part, header, flush) {
        Ok(writer) => writer.rotating(Rotation::from(&config.log)),
        Err(error) => return mouth.fail(&error, trouble_at_start(&error)),
    };
    let bus = args.listener.bus()?;
    let tap = args.listener.tap(&bus)?;
    let clock = args.listener.clock();
    let lifeline = Lifeline::watch(clock).into_diagnostic()?;
    mouth.say(Said::Ready);
    let mut last = RecorderStatus::default();
    let recorded = run(
        tap,
        writer,
        || clock.now(),
        &lifeline.events,
        &lifeline.ended,
        |status| {
            mouth.mention(Said::Status(status.clone()));
            if status.full && !last.full {
                mouth.say(Said::Failed { cause: Cause::DiskFull, trouble: no_room(&status.log) });
            }
            last = status.clone();
        },
    );
    match recorded {
        Ok(summary) => {
            mouth.say(Said::Done(summary));
            mouth.close();
            Ok(true)
        }
        Err(LogError::Full { .. }) => {
            mouth.say(Said::Done(last.log));
            Ok(!mouth.close())
        }
        Err(error) => {
            let trouble = trouble_on_the_way(&error, &last.log);
            mouth.fail(&error, trouble)
        }
    }
}

/// The daemon reads what is said; a thread waits for it, so that the recorder never does.
struct Mouth {
    words: SyncSender<Said>,
    speaking: JoinHandle<io::Result<()>>,
}

impl Mouth {
    fn open() -> io::Result<Self> {
        let (words, said) = mpsc::sync_channel(WAITING_WORDS);
        let speaking = thread::Builder::new().name("mouth".into()).spawn(move || speak(&said))?;
        Ok(Self { words, speaking })
    }

    /// Says what must be heard. If the CCU is gone, nobody hears it; the log is complete all the same.
    fn say(&self, said: Said) {
        let _ = self.words.send(said);
    }

    /// Says what will soon be old.
    fn mention(&self, said: Said) {
        let _ = self.words.try_send(said);
    }

    /// Waits until everything has been said; whether it could be.
    fn close(self) -> bool {
        drop(self.words);
        matches!(self.speaking.join(), Ok(Ok(())))
    }

    /// Says why it does not go on; if nobody hears that, it is the caller's to tell.
    fn fail(self, error: &LogError, trouble: LogTrouble) -> miette::Result<bool> {
        let cause = match error {
            LogError::Exists { .. } => Cause::Exists,
            error if error.is_full() => Cause::DiskFull,
            _ => Cause::Other,
        };
        let report = miette!(help = trouble.advice.clone(), "{}", trouble.reason);
        self.say(Said::Failed { cause, trouble });
        if self.close() { Ok(false) } else { Err(report) }
    }
}

fn speak(said: &Receiver<Said>) -> io::Result<()> {
    for said in said {
        let mut out = io::stdout().lock();
        serde_json::to_writer(&mut out, &said)?;
        writeln!(out)?;
        out.flush()?;
    }
    Ok(())
}

const MAKE_ROOM: &str = "make room on that disk, or choose another one with --log";

fn trouble_at_start(error: &LogError) -> LogTrouble {
    let advice = match error {
        LogError::Exists { .. } => "a log is never overwritten: choose another name, or move the file away",
        LogError::Create { error, .. } => where_to_create(error),
        LogError::Write { .. } => MAKE_ROOM,
        _ => "look at the disk and the folder, or name a log elsewhere with --log",
    };
    LogTrouble { reason: error.to_string(), advice: advice.to_owned() }
}

/// What to do if no file can be made.
fn where_to_create(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::NotFound => "make the folder first, or name a log elsewhere with --log",
        io::ErrorKind::PermissionDenied => {
            "the folder must be one that you may write to; name a log elsewhere with --log"
        }
        io::ErrorKind::ReadOnlyFilesystem => {
            "nothing can be written to that disk as it is mounted; name a log elsewhere with --log"
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => MAKE_ROOM,
        _ => "look at the disk and the folder, or name a log elsewhere with --log",
    }
}

fn no_room(log: &LogSummary) -> LogTrouble {
    let path = log.parts.last().cloned().unwrap_or_default();
    told_with(&LogError::Full { path }.to_string(), log)
}

fn trouble_on_the_way(error: &LogError, log: &LogSummary) -> LogTrouble {
    told_with(&error.to_string(), log)
}

/// What happened and what is in the log; what to do about it.
fn told_with(what: &str, log: &LogSummary) -> LogTrouble {
    LogTrouble {
        reason: format!("{what}: {} frames in {} bytes are in it, whole and readable", log.frames, log.bytes),
        advice: format!("{MAKE_ROOM}; then take the set down and up again"),
    }
}

/// A process that writes more into a file than it may is killed by a signal, unless it asks to be told of it: then the
/// writing fails, and can be told.
fn outlive_file_size_limit() -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let _inside = runtime.enter();
    // The handler stays when what listens to it goes.
    signal(SignalKind::from_raw(Signal::XFSZ.as_raw())).map(drop)
}
