//! `ccu bench constant`.

use clap::Args;
use miette::miette;

use super::motor::MotorArgs;
use crate::cli::exit::Exit;

#[derive(Args)]
pub(in crate::cli) struct ConstantArgs {
    #[command(flatten)]
    motor: MotorArgs,
}

pub(super) fn constant(args: &ConstantArgs) -> Result<(), Exit> {
    let motor = args.motor.motor()?;
    Err(Exit::wrong(miette!("{} is not wired up", motor.name)))
}
