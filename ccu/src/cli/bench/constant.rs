//! `ccu bench constant`: CONST. FREQ. of \[M\].

use axis_worker::bench::{Frequency, Train};
use clap::Args;
use miette::miette;

use super::running::RunArgs;
use crate::bench::Program;
use crate::cli::exit::Exit;

#[derive(Args)]
pub(in crate::cli) struct ConstantArgs {
    /// The frequency, in pulses/s (half steps/s): 15.259 to 500000
    #[arg(long, value_name = "HZ")]
    frequency: Frequency,
    /// How many pulses
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    #[command(flatten)]
    run: RunArgs,
}

pub(super) fn constant(args: &ConstantArgs) -> Result<(), Exit> {
    let train =
        Train::constant(args.frequency, args.steps).map_err(|error| Exit::wrong(miette!("{error}")))?;
    args.run.run(Program::Constant, train)
}
