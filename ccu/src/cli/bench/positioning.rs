//! `ccu bench positioning`: POSITIONING of \[M\].

use axis_worker::bench::{Clocks, Frequency, Hold, Positioning, Train};
use clap::Args;
use miette::miette;

use super::running::RunArgs;
use crate::bench::Program;
use crate::cli::exit::Exit;

#[derive(Args)]
pub(in crate::cli) struct PositioningArgs {
    /// The frequency of start and end, in pulses/s (half steps/s): 15.259 to 500000
    #[arg(long, value_name = "HZ")]
    f_start: Frequency,
    /// The frequency between the ramps
    #[arg(long, value_name = "HZ")]
    f_max: Frequency,
    /// The acceleration's time, in seconds; 0 starts with --f-max
    #[arg(long, value_name = "S")]
    ta: Clocks,
    /// The time with --f-max
    #[arg(long, value_name = "S", required_unless_present = "steps")]
    tb: Option<Clocks>,
    /// The deceleration's time; 0 ends with --f-max
    #[arg(long, value_name = "S")]
    tc: Clocks,
    /// Instead of --tb: so many pulses in all
    #[arg(long, value_name = "N", conflicts_with = "tb")]
    steps: Option<u32>,
    #[command(flatten)]
    run: RunArgs,
}

pub(super) fn positioning(args: &PositioningArgs) -> Result<(), Exit> {
    let hold = match (args.tb, args.steps) {
        (_, Some(steps)) => Hold::ForTotal(steps),
        (t_b, None) => Hold::For(t_b.unwrap_or_default()),
    };
    let wanted = Positioning { start: args.f_start, max: args.f_max, t_a: args.ta, hold, t_c: args.tc };
    let train = Train::positioning(wanted).map_err(|error| Exit::wrong(miette!("{error}")))?;
    args.run.run(Program::Positioning, train)
}
