//! `ccu bench`: the test bench of \[M\]. Its arguments and what it prints stand here; the apparatus is
//! `axis_worker::bench`, what is recorded of it [`crate::bench`].

mod constant;
mod motor;
mod pictures;
mod positioning;
mod running;

use clap::Subcommand;

use super::exit::Exit;

#[derive(Subcommand)]
pub(super) enum BenchCommand {
    /// Pulses of one frequency (CONST. FREQ.)
    #[command(after_help = "\
Examples:
  ccu bench constant --frequency 20 --steps 16
  ccu bench constant --frequency 20 --steps 16 --plot-position fig7.svg --plot-speed fig8.png")]
    Constant(constant::ConstantArgs),
    /// A linear speed profile (POSITIONING)
    #[command(after_help = "\
Examples:
  ccu bench positioning --f-start 200 --f-max 2000 --ta 0.2 --tb 0.5 --tc 0.1
  ccu bench positioning --f-start 400 --f-max 4000 --ta 0.25 --tb 0.25 --tc 0.15 --plot-profile fig9.svg")]
    Positioning(positioning::PositioningArgs),
}

pub(super) fn bench(command: &BenchCommand) -> Result<(), Exit> {
    match command {
        BenchCommand::Constant(args) => constant::constant(args),
        BenchCommand::Positioning(args) => positioning::positioning(args),
    }
}
