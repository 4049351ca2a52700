//! `ccu bench`: the test bench of \[M\]. Its arguments and what it prints stand here; the apparatus is
//! `axis_worker::bench`, what is recorded of it [`crate::bench`].

mod constant;
mod limits;
mod motor;
mod positioning;
mod running;
mod tune;

use clap::Subcommand;

use super::exit::Exit;

#[derive(Subcommand)]
pub(super) enum BenchCommand {
    /// Pulses of one frequency (CONST. FREQ.)
    #[command(after_help = "\
Examples:
  ccu bench constant --frequency 20 --steps 16")]
    Constant(constant::ConstantArgs),
    /// A linear speed profile (POSITIONING)
    #[command(after_help = "\
Examples:
  ccu bench positioning --f-start 200 --f-max 2000 --ta 0.2 --tb 0.5 --tc 0.1")]
    Positioning(positioning::PositioningArgs),
    /// The characteristic of the motor: start-stop, pull-in and pull-out over the load
    #[command(after_help = "\
Examples:
  ccu bench limits                                     the bench motor, with 12 torques of a brake
  ccu bench limits --torques 0,0.5,1 -o limits.svg     these torques, and a picture of the regions
  ccu bench limits --inertia 0,1.2e-4,1.2e-3 -o d.png  the same with three discs on the shaft
  ccu bench limits --config cell.toml --axis left_x --csv limits.csv

Frequencies are half steps/s.")]
    Limits(limits::LimitsArgs),
    /// The fastest profile with which the motor loses no steps
    #[command(after_help = "\
Examples:
  ccu bench tune --steps 4000
  ccu bench tune --steps 4000 --load-inertia 1.2e-3 --margin 20% --plot tune.svg
  ccu bench tune --steps 8000 --config cell.toml --axis left_x --profile sin2 --write ramp.toml

A margin of 30 % means: it holds with 30 % less holding torque, with 15 % less, and with all of it. The pulses themselves
turn the motor's rotor, to rest in the right place. Fastest is what has its last pulse soonest.")]
    Tune(tune::TuneArgs),
}

pub(super) fn bench(command: &BenchCommand) -> Result<(), Exit> {
    match command {
        BenchCommand::Constant(args) => constant::constant(args),
        BenchCommand::Positioning(args) => positioning::positioning(args),
        BenchCommand::Limits(args) => limits::limits(args),
        BenchCommand::Tune(args) => tune::tune(args),
    }
}
