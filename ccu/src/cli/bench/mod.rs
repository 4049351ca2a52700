//! `ccu bench`: the test bench of \[M\]. Its arguments and what it prints stand here; the apparatus is
//! `axis_worker::bench`, what is recorded of it [`crate::bench`].

mod constant;
mod limits;
mod motor;
mod pictures;
mod positioning;
mod running;
mod tune;

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
