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
    /// Pulses of one frequency
    #[command(after_help = "\
Frequencies are pulses per second; a pulse is a half step. When the last pulse has been given and
the rotor is at rest, the steps that the encoder counted are compared with those commanded.

Examples:
  ccu bench constant --frequency 20 --steps 16
  ccu bench constant --frequency 20 --steps 16 --plot-position fig7.svg --plot-speed fig8.png
  ccu bench constant --frequency 2000 --steps 800 --load-torque 0.5 --sampling 60000 --out run.mcap
  ccu bench constant --frequency 650 --steps 400 --config cell.toml --axis wrist --reverse

Exit codes: 0 the motor made all its steps, 1 it did not, 2 wrongly asked.")]
    Constant(constant::ConstantArgs),
    /// A linear speed profile: up, along, down
    #[command(after_help = "\
Frequencies are pulses per second; a pulse is a half step. --ta and --tc give the slopes of
acceleration and deceleration, each by itself.

Examples:
  ccu bench positioning --f-start 200 --f-max 2000 --ta 0.2 --tb 0.5 --tc 0.1
  ccu bench positioning --f-start 400 --f-max 4000 --ta 0.25 --tb 0.25 --tc 0.15 --plot-profile fig9.svg
  ccu bench positioning --f-start 200 --f-max 2000 --ta 0.2 --tc 0.1 --steps 1600
  ccu bench positioning --f-start 400 --f-max 8000 --ta 0.3 --tb 1 --tc 0.2 --out run.csv --json

Exit codes: 0 the motor made all its steps, 1 it did not, 2 wrongly asked.")]
    Positioning(positioning::PositioningArgs),
}

pub(super) fn bench(command: &BenchCommand) -> Result<(), Exit> {
    match command {
        BenchCommand::Constant(args) => constant::constant(args),
        BenchCommand::Positioning(args) => positioning::positioning(args),
    }
}
