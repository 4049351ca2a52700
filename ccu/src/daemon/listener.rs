//! What the processes have in common that only listen to the bus, the recorder and the live view: what the daemon tells them,
//! and what they make of it.

use std::fs;
use std::path::PathBuf;

use axis_worker::clock::{Clock, Monotonic, TimeScale};
use clap::Args;
use miette::{IntoDiagnostic, WrapErr};
use supersigma_config::Config;
use supersigma_protocol::bus::shared_memory::{Place, SharedBus, SharedTap};
use supersigma_protocol::bus::{Bus, Origin};

use super::members_tap::MembersTap;
use crate::home::members_in;
use crate::log::{AxisNames, LogHeader, Timeline, WallTime};

/// What a listener is told by the daemon.
#[derive(Debug, Clone, Args)]
pub struct ListenerArgs {
    /// The set's name
    #[arg(long)]
    pub set: String,
    /// The set's runtime folder
    #[arg(long, value_name = "DIR")]
    pub runtime: PathBuf,
    /// The set's configuration
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The CCU's process; nobody else is believed to command
    #[arg(long, value_name = "PID")]
    pub ccu: u32,
    /// The set's tick 0, in nanoseconds of the machine's monotonic clock
    #[arg(long, value_name = "NS")]
    pub epoch: u64,
    /// The same in nanoseconds since 1970
    #[arg(long, value_name = "NS")]
    pub wall_epoch: u64,
    /// How many times faster than real time
    #[arg(long, value_name = "K", default_value_t = TimeScale::REAL)]
    pub time_scale: TimeScale,
}

impl ListenerArgs {
    /// The set's configuration, and what a log says before its first frame.
    ///
    /// # Errors
    /// If the configuration cannot be read.
    pub(super) fn read(&self, script: Option<String>) -> miette::Result<(Config, LogHeader)> {
        let text = fs::read_to_string(&self.config)
            .into_diagnostic()
            .wrap_err("cannot read the set's configuration")?;
        let config = Config::from_toml(&text, &self.config.display().to_string())?;
        let header = LogHeader {
            version: LogHeader::VERSION.to_owned(),
            set: self.set.clone(),
            names: AxisNames::from(&config),
            timeline: Timeline { epoch: WallTime(self.wall_epoch), scale: self.time_scale },
            config: text,
            script,
        };
        Ok((config, header))
    }

    /// The set's bus.
    ///
    /// # Errors
    /// If it cannot be joined.
    pub(super) fn bus(&self) -> miette::Result<SharedBus> {
        SharedBus::join(&Place::new(&self.runtime).into_diagnostic()?).into_diagnostic()
    }

    /// What the set's own processes say on its bus.
    ///
    /// # Errors
    /// If the bus has no room for it.
    pub(super) fn tap(&self, bus: &SharedBus) -> miette::Result<MembersTap<SharedTap>> {
        let tap = bus.tap().into_diagnostic()?;
        Ok(MembersTap::new(tap, Origin(self.ccu), members_in(&self.runtime)))
    }

    /// The set's time.
    pub(super) fn clock(&self) -> Clock {
        Clock::new(Monotonic::from_nanos(self.epoch), self.time_scale)
    }
}
