//! The recorder's process: a tap on the bus, a log, and a lifeline. It is a process of its own so that the log survives
//! whatever happens to the CCU. It prints `ready` when it hears the bus, and its summary, as JSON, when it is done.

use std::fs;
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use axis_worker::clock::{Clock, Monotonic, TimeScale};
use clap::Args;
use miette::{IntoDiagnostic, WrapErr};
use supersigma_config::Config;
use supersigma_protocol::bus::Bus;
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};

use crate::log::{AxisNames, LogHeader, LogWriter, Timeline, WallTime, run};

/// What a recorder prints when it hears the bus.
pub const READY: &str = "ready";

/// What the recorder is told by the daemon.
#[derive(Debug, Clone, Args)]
pub struct RecorderArgs {
    /// The set's name
    #[arg(long)]
    pub set: String,
    /// The set's runtime folder
    #[arg(long, value_name = "DIR")]
    pub runtime: PathBuf,
    /// The set's configuration
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The program that the set was started for
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// The set's tick 0, in nanoseconds of the machine's monotonic clock
    #[arg(long, value_name = "NS")]
    pub epoch: u64,
    /// The same in nanoseconds since 1970
    #[arg(long, value_name = "NS")]
    pub wall_epoch: u64,
    /// How many times faster than real time
    #[arg(long, value_name = "K", default_value_t = TimeScale::REAL)]
    pub time_scale: TimeScale,
    /// The log
    #[arg(long, value_name = "FILE")]
    pub log: PathBuf,
}

/// Records until the lifeline ends and everybody has left.
///
/// # Errors
/// If the bus or the log fails.
pub fn record(args: &RecorderArgs) -> miette::Result<()> {
    let text =
        fs::read_to_string(&args.config).into_diagnostic().wrap_err("cannot read the set's configuration")?;
    let config = Config::from_toml(&text, &args.config.display().to_string())?;
    let script = args.script.as_ref().map(fs::read_to_string).transpose();
    let script = script.into_diagnostic().wrap_err("cannot read the set's program")?;
    let timeline = Timeline { epoch: WallTime(args.wall_epoch), scale: args.time_scale };
    let header =
        LogHeader {
            version: LogHeader::VERSION.to_owned(),
            set: args.set.clone(),
            names: AxisNames::from(&config),
            timeline,
            config: text,
            script,
        };
    let flush = Duration::from_millis(config.log.flush_ms.into());
    let writer = LogWriter::create(&args.log, header, flush).into_diagnostic()?;
    let bus = SharedBus::join(&Place::new(&args.runtime).into_diagnostic()?).into_diagnostic()?;
    let tap = bus.tap().into_diagnostic()?;
    let stop = watch_lifeline().into_diagnostic()?;
    say(READY).into_diagnostic()?;
    let clock = Clock::new(Monotonic::from_nanos(args.epoch), args.time_scale);
    let summary = run(tap, writer, || clock.now(), &stop).into_diagnostic()?;
    // If the CCU is gone, nobody reads this; the log is complete all the same.
    let _ = say(&serde_json::to_string(&summary).into_diagnostic()?);
    Ok(())
}

fn say(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

fn watch_lifeline() -> io::Result<Arc<AtomicBool>> {
    let ended = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&ended);
    thread::Builder::new().name("lifeline".into()).spawn(move || {
        let mut buffer = [0; 64];
        while matches!(io::stdin().read(&mut buffer), Ok(1..)) {}
        flag.store(true, Ordering::Release);
    })?;
    Ok(ended)
}
