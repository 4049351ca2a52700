//! One card as a process of its own, for whoever starts cards without the `ccu` command.

use clap::Parser;
use miette::IntoDiagnostic;

/// One SUPERSIGMA card as a process; `ccu` starts its own and does not need this command.
#[derive(Parser)]
#[command(name = "axis-worker", version)]
struct Cli {
    #[command(flatten)]
    args: axis_worker::worker::WorkerArgs,
}

fn main() -> miette::Result<()> {
    axis_worker::start_logging();
    axis_worker::worker::run(&Cli::parse().args).into_diagnostic()
}
