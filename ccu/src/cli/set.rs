//! `ccu up` and `ccu down`.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::process::Stdio;
use std::str::FromStr;

use clap::Args;
use miette::{IntoDiagnostic, miette};
use supersigma_config::Config;
use tokio::signal::unix::{SignalKind, signal};

use super::exit::Exit;
use super::{SetArgs, StartArgs, config, service, show};
use crate::control::{Client, DownReport};
use crate::daemon::{Daemon, Options, StartError};
use crate::home::{Home, HomeError, SetName, default_log};
use crate::program;

/// What a detached daemon prints when it is up.
const READY: &str = "ready";

#[derive(Args)]
pub(super) struct UpArgs {
    #[command(flatten)]
    set: SetArgs,
    #[command(flatten)]
    start: StartArgs,
    /// Return when the set is up, and leave it running
    #[arg(long)]
    detach: bool,
    /// The other side of --detach
    #[arg(long, hide = true, conflicts_with = "detach")]
    detached: bool,
}

#[derive(Args)]
pub(super) struct DownArgs {
    #[command(flatten)]
    set: SetArgs,
}

/// What `--log-rotate` says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum LogRotate {
    Megabytes(f64),
    Minutes(f64),
}

impl FromStr for LogRotate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let split = text.find(|letter: char| letter.is_ascii_alphabetic()).unwrap_or(text.len());
        let (number, unit) = text.split_at(split);
        let of = |factor: f64, least: f64| {
            let value = number.trim().parse::<f64>().ok().map(|number| number * factor);
            value.filter(|value| *value >= least && value.is_finite())
        };
        let rotate = match unit {
            "MB" => of(1.0, 0.1).map(Self::Megabytes),
            "GB" => of(1e3, 0.1).map(Self::Megabytes),
            "min" => of(1.0, 0.01).map(Self::Minutes),
            "h" => of(60.0, 0.01).map(Self::Minutes),
            _ => None,
        };
        rotate.ok_or_else(|| "a size of at least 0.1MB or a time of at least 0.01min is needed, as in 100MB, 2GB, 10min, 1h".into())
    }
}

/// The configuration that a set is started with: the named one, and what the command line says otherwise.
pub(super) fn start_config(start: &StartArgs) -> Result<Config, Exit> {
    let mut config = config::load(start.config.as_deref())?;
    match start.log_rotate {
        Some(LogRotate::Megabytes(megabytes)) => config.log.rotate_mb = Some(megabytes),
        Some(LogRotate::Minutes(minutes)) => config.log.rotate_min = Some(minutes),
        None => {}
    }
    Ok(config)
}

impl From<StartError> for Exit {
    fn from(error: StartError) -> Self {
        let code = match &error {
            StartError::LogExists(_) | StartError::Ramp(_) | StartError::NoFoxglove(_) => 2,
            _ => 1,
        };
        Self::with_code(code, error)
    }
}

impl From<HomeError> for Exit {
    fn from(error: HomeError) -> Self {
        Self::with_code(1, error)
    }
}

/// The log that is named, or a new one where logs go.
pub(super) fn log_path(named: Option<&PathBuf>, name: &SetName) -> Result<PathBuf, Exit> {
    match named {
        Some(path) => Ok(path.clone()),
        None => Ok(default_log(name, jiff::Timestamp::now())?),
    }
}

/// The runtime in which a daemon lives.
pub(super) fn runtime() -> io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()
}

pub(super) fn up(args: &UpArgs) -> Result<(), Exit> {
    let home = Home::of(args.set.name.clone())?;
    if args.detach {
        return detach(&home);
    }
    if args.detached {
        rustix::process::setsid().into_diagnostic().map_err(Exit::could_not)?;
    }
    let config = start_config(&args.start)?;
    let log = log_path(args.start.log.as_ref(), &args.set.name)?;
    let (scale, foxglove) = (args.start.time_scale, args.start.foxglove);
    let options = Options { home: home.clone(), config, scale, log, script: None, foxglove };
    runtime()?.block_on(async {
        // Before anything is started: a signal that comes early must take down what is there by then.
        let asked_to_end = asked_to_end()?;
        let daemon = Daemon::start(options)?;
        // A set does not go down unasked because nobody reads what is said about it.
        let _ = if args.detached { say_ready() } else { say_up(&daemon) };
        service::ready(&daemon);
        tokio::select! {
            () = asked_to_end => {}
            () = daemon.wanted_down() => {}
            () = service::watchdog(home) => {}
        }
        service::stopping();
        let report = daemon.stop().await;
        service::stopped(&report);
        if !args.detached {
            down_line(&report, &mut io::stdout())?;
        }
        Ok(())
    })
}

/// Where the live view is.
pub(super) fn say_view(url: Option<&str>, out: &mut dyn Write) -> io::Result<()> {
    url.map_or(Ok(()), |url| writeln!(out, "Foxglove: open the connection {url}"))
}

fn say_ready() -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{READY}")?;
    out.flush()
}

fn say_up(daemon: &Daemon) -> io::Result<()> {
    let mut out = io::stdout().lock();
    let (name, workers) = (daemon.home().name(), daemon.workers());
    writeln!(out, "set {name} is up: {workers} cards; log {}", daemon.log().display())?;
    say_view(daemon.foxglove(), &mut out)?;
    writeln!(out, "Ctrl-C, or `ccu down --name {name}`, takes it down")?;
    out.flush()
}

/// What resolves when the process is asked to end by a signal.
pub(super) fn asked_to_end() -> Result<impl Future<Output = ()>, Exit> {
    let listen = |kind| signal(kind).into_diagnostic().map_err(Exit::could_not);
    let (mut interrupt, mut terminate) = (listen(SignalKind::interrupt())?, listen(SignalKind::terminate())?);
    let mut hangup = listen(SignalKind::hangup())?;
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = hangup.recv() => {}
        }
    })
}

/// Starts the same command in a session of its own, and returns when that is up, or says why it is not.
fn detach(home: &Home) -> Result<(), Exit> {
    let messages = home.messages();
    let file = private_file(&messages)?;
    let arguments = std::env::args_os()
        .skip(1)
        .map(|argument| if argument == "--detach" { "--detached".into() } else { argument });
    let mut child = program::again()
        .args(arguments)
        // A service's main process is the one in the foreground; what leaves it speaks for nobody.
        .env_remove("NOTIFY_SOCKET")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(file)
        .spawn()?;
    let mut line = String::new();
    if let Some(out) = child.stdout.take() {
        BufReader::new(out).read_line(&mut line)?;
    }
    if line.trim_end() != READY {
        let status = child.wait()?;
        let said = fs::read_to_string(&messages).unwrap_or_default();
        let _ = fs::remove_file(&messages);
        let _ = io::stderr().write_all(said.as_bytes());
        let code = status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1);
        return Err(Exit::silent(code));
    }
    let description = Client::connect(home)?.describe()?;
    let mut out = io::stdout().lock();
    writeln!(out, "set {} is up: process {}; log {}", home.name(), child.id(), description.log.display())?;
    say_view(description.foxglove.as_deref(), &mut out)?;
    writeln!(out, "what it has to say goes to {}", messages.display())?;
    Ok(())
}

fn private_file(path: &std::path::Path) -> Result<File, Exit> {
    OpenOptions::new()
        .create(true)
        .write(true)
        .truncate(true)
        .mode(0o600)
        .open(path)
        .map_err(|error| Exit::could_not(miette!("cannot write {}: {error}", path.display())))
}

pub(super) fn down(args: &DownArgs) -> Result<(), Exit> {
    let home = Home::of(args.set.name.clone()).map_err(|error| Exit::with_code(3, error))?;
    let report = Client::connect(&home)?.down()?;
    // Empty, unless something went wrong; then it is kept.
    let messages = home.messages();
    if fs::metadata(&messages).is_ok_and(|file| file.len() == 0) {
        fs::remove_file(&messages)?;
    }
    let mut out = io::stdout().lock();
    writeln!(out, "set {} is down", home.name())?;
    Ok(down_line(&report, &mut out)?)
}

/// What a set leaves: its log.
pub(super) fn down_line(report: &DownReport, out: &mut dyn Write) -> io::Result<()> {
    let logged = report.logged.map_or_else(|| "unknown".to_owned(), |logged| logged.to_string());
    let size = report.bytes.map(|bytes| format!(" ({})", show::size(bytes))).unwrap_or_default();
    writeln!(out, "frames: {} sent, {logged} logged", report.sent)?;
    if let Some(lost @ 1..) = report.lost {
        writeln!(out, "        {lost} are missing from the log; its events tell where")?;
    }
    match report.parts.as_slice() {
        [] | [_] => writeln!(out, "log:    {}{size}", report.log.display()),
        parts => {
            writeln!(out, "log:    {} files{size}", parts.len())?;
            parts.iter().try_for_each(|part| writeln!(out, "        {}", part.display()))
        }
    }
}
