//! Which motor stands on the bench, and what is put on its shaft: arguments that all bench commands share.

use std::fmt::Write as _;
use std::path::PathBuf;

use axis_worker::motor::Load;
use clap::Args;
use miette::miette;
use supersigma_config::{MotorConfig, MotorError, RampConfig};

use crate::bench::BenchMotor;
use crate::cli::config;
use crate::cli::exit::Exit;

/// The motor on the bench.
#[derive(Args)]
#[command(next_help_heading = "Motor")]
pub(in crate::cli) struct MotorArgs {
    /// The configuration that has the axis; the built-in set if none is named
    #[arg(long, value_name = "FILE", requires = "axis")]
    config: Option<PathBuf>,
    /// The motor of this axis, by number or name; the bench motor if none is named
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// A brake on the shaft, in newton metres: against the motion, whatever its direction
    #[arg(long, value_name = "N·M", default_value_t = 0.0, value_parser = load)]
    load_torque: f64,
    /// A disc on the shaft, its moment of inertia in kg·m²
    #[arg(long, value_name = "KG·M²", default_value_t = 0.0, value_parser = load)]
    load_inertia: f64,
}

impl MotorArgs {
    /// The motor that was asked for.
    ///
    /// # Errors
    /// If there is no such axis, it has no motor that can lose steps, or the motor cannot hold the load.
    pub(in crate::cli) fn motor(&self) -> Result<BenchMotor, Exit> {
        let (name, config) = match &self.axis {
            None => ("the bench motor".to_owned(), MotorConfig::bench()),
            Some(axis) => self.motor_of(axis)?,
        };
        let load = Load { torque: self.load_torque, inertia: self.load_inertia };
        let motor = BenchMotor { name, config, load };
        match motor.loaded() {
            Ok(_) => Ok(motor),
            Err(error) => {
                // A load that is too heavy is nobody's typing error.
                let could_not = matches!(error, MotorError::Overloaded { .. });
                let exit = if could_not { Exit::could_not } else { Exit::wrong };
                Err(exit(miette!("{} cannot be run with that load: {error}", motor.name)))
            }
        }
    }

    /// The ramp that goes with it: that of the axis, or of the built-in set if none is named.
    ///
    /// # Errors
    /// If there is no such axis.
    pub(in crate::cli) fn ramp(&self) -> Result<RampConfig, Exit> {
        let set = config::load(self.config.as_deref())?;
        let axis = self.axis.as_deref().and_then(|axis| set.find_axis(axis));
        Ok(axis.map_or(&set.ramp, |axis| set.ramp_of(axis)).clone())
    }

    /// The axis, as it was typed.
    pub(in crate::cli) fn axis(&self) -> Option<&str> {
        self.axis.as_deref()
    }

    /// What was typed, to type it again: with a space before each argument.
    pub(in crate::cli) fn typed(&self) -> String {
        let mut typed = String::new();
        if let Some(config) = &self.config {
            let _ = write!(typed, " --config {}", config.display());
        }
        if let Some(axis) = &self.axis {
            let _ = write!(typed, " --axis {axis}");
        }
        for (name, value) in [("torque", self.load_torque), ("inertia", self.load_inertia)] {
            if value > 0.0 {
                let _ = write!(typed, " --load-{name} {value}");
            }
        }
        typed
    }

    fn motor_of(&self, wanted: &str) -> Result<(String, MotorConfig), Exit> {
        let set = config::load(self.config.as_deref())?;
        let axis = config::axis(&set, wanted)?;
        let Some(motor) = axis.motor.clone() else {
            return Err(Exit::wrong(miette!(
                help =
                    "give it a table `motor` in the configuration, or leave --axis out for the bench motor",
                "{} has no motor that can lose steps: there is nothing to test",
                axis.name
            )));
        };
        Ok((format!("the motor of {}", axis.name), motor))
    }
}

/// A torque or an inertia that a bench can put on a shaft.
pub(super) fn load(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        Ok(_) => Err("a load is a number of 0 or more".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}
