//! `ccu replay`: a log run again. On fresh machines in this process, to compare (`--verify`); before people's eyes, at its
//! own pace or another; or on a live bus (`--bus`). What the options mean stands here; the work is in the rooms below.

mod bus;
mod show_again;
mod verify;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use axis_worker::clock::TimeScale;
use clap::Args;
use miette::{Diagnostic, IntoDiagnostic};
use supersigma_config::Config;

use super::SetArgs;
use super::exit::Exit;
use crate::log::{LogError, LogHeader};

#[derive(Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub(super) struct ReplayArgs {
    /// The log
    log: PathBuf,
    /// Give the recorded commands to fresh machines and compare every answer, byte for byte
    #[arg(long, conflicts_with_all = ["bus", "speed", "from", "to", "watch", "axis"])]
    verify: bool,
    /// Put the recorded commands and faults on a live bus again: of the set that is up, or of one started for it
    #[arg(long, conflicts_with_all = ["from", "to", "watch", "axis"])]
    bus: bool,
    /// How many times faster than the machine runs, or `max`; with --bus, of the set that is started for it [default: 1;
    /// with --bus, that of the recorded set]
    #[arg(long, value_name = "K")]
    speed: Option<Speed>,
    /// Begin here, in seconds of machine time
    #[arg(long, value_name = "S", value_parser = seconds)]
    from: Option<f64>,
    /// End here, in seconds of machine time
    #[arg(long, value_name = "S", value_parser = seconds)]
    to: Option<f64>,
    /// The table of the axes, drawn anew as it changes, instead of the frames
    #[arg(long, conflicts_with = "json")]
    watch: bool,
    /// Only frames of, or to, these axes
    #[arg(long, value_name = "AXIS")]
    axis: Vec<String>,
    /// One JSON object a frame; with --verify or --bus, one for the result
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    set: SetArgs,
    /// With --bus, the log of a set that is started for it [default: a new file in ~/.local/state/supersigma]
    #[arg(long = "log", value_name = "FILE", requires = "bus")]
    new_log: Option<PathBuf>,
}

/// How fast a log is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Speed {
    /// So many times faster than the machine runs.
    Times(TimeScale),
    /// As fast as it goes.
    Max,
}

impl FromStr for Speed {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        text.parse().map(Self::Times).map_err(|error| format!("{error}, or `max`"))
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..1e9).contains(&seconds) => Ok(seconds),
        _ => Err(format!("{text:?} is no number of seconds since the set's tick 0")),
    }
}

pub(super) fn replay(args: &ReplayArgs) -> Result<(), Exit> {
    if args.verify {
        verify::verify(&args.log, args.json)
    } else if args.bus {
        bus::bus(args)
    } else {
        show_again::show(args)
    }
}

/// A log that cannot be read is wrongly named.
fn log_error(error: LogError) -> Exit {
    Exit::wrong(Err::<(), _>(error).into_diagnostic().expect_err("it is an error"))
}

/// The log ends before it says anything about itself.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("the log {} is cut before its first frame: there is nothing to replay", .0.display())]
struct Nothing(PathBuf);

/// The log's configuration does not stand the checks of this program.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("no machine can be made of the configuration in {}", path.display())]
#[diagnostic(help("{}", version_help(version.as_deref())))]
struct WrongConfig {
    path: PathBuf,
    version: Option<String>,
    #[source]
    #[diagnostic_source]
    source: supersigma_config::ConfigError,
}

fn version_help(version: Option<&str>) -> String {
    match version {
        Some(version) => format!(
            "the log was written by version {version}, this is {}; replay it with that version",
            LogHeader::VERSION
        ),
        None => "the log was written by this version: its attachment `config.toml` has been changed".into(),
    }
}

/// The configuration of the recorded set.
fn config_of(path: &Path, header: &LogHeader) -> Result<Config, Exit> {
    Config::from_toml(&header.config, &format!("config.toml in {}", path.display())).map_err(|source| {
        Exit::with_code(2, WrongConfig { path: path.to_owned(), version: other_version(header), source })
    })
}

/// The version that wrote the log, if it is not this one.
fn other_version(header: &LogHeader) -> Option<String> {
    Some(header.version.clone()).filter(|version| version != LogHeader::VERSION)
}
