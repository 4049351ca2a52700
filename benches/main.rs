//! What the project promises of speed, measured in one run against named references:
//!
//! ```text
//! cargo bench -p supersigma-ccu --bench performance                   # everything, as a table
//! cargo bench -p supersigma-ccu --bench performance -- machine bus    # some rooms of it
//! cargo bench -p supersigma-ccu --bench performance -- --record docs  # and docs/performance.md, docs/performance.csv
//! ```
//!
//! Every room measures one thing and its reference side by side. None of them is a test: a slow machine gives other
//! figures, not a failure.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

mod bus;
mod figure;
mod live;
mod machine;
mod pacing;
mod peers;
mod ping;
mod recorder;
mod span;
mod startup;

use figure::{Figure, Report};

/// Measures the set against its references, in one run
#[derive(Debug, Parser)]
struct Args {
    /// What to measure [default: everything]
    #[arg(value_enum)]
    rooms: Vec<Room>,
    /// Write performance.md, with all rooms, into this folder of the repository, and append to its performance.csv
    #[arg(long, value_name = "DIR", conflicts_with = "rooms")]
    record: Option<PathBuf>,
    /// Given by cargo to every benchmark
    #[arg(long, hide = true)]
    bench: bool,
}

/// One thing that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Room {
    /// The axis machine, alone
    Machine,
    /// From a command to its answer, with all processes of a set
    Bus,
    /// How late workers handle what happens by itself
    Pacing,
    /// The log, alone
    Recorder,
    /// A whole set that starts, and then idles
    Startup,
}

impl Room {
    fn measure(self) -> Result<Vec<Figure>, Box<dyn Error>> {
        match self {
            Self::Machine => Ok(machine::measure()),
            Self::Bus => bus::measure(),
            Self::Pacing => pacing::measure(),
            Self::Recorder => recorder::measure(),
            Self::Startup => startup::measure(),
        }
    }
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    if let Some(played) = peers::play() {
        return played;
    }
    axis_worker::start_logging();
    let args = Args::parse();
    let rooms = if args.rooms.is_empty() { Room::value_variants() } else { &args.rooms };
    let mut report = Report::of_this_machine();
    for &room in rooms {
        let figures = room.measure()?;
        print!("{}", report.add(figures));
    }
    if let Some(folder) = &args.record {
        // Cargo starts a benchmark in its package's folder.
        report.record(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder))?;
    }
    Ok(ExitCode::SUCCESS)
}
