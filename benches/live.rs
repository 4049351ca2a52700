//! A whole set for a measurement: the daemon's part is played by the benchmark itself, through the library, so that the
//! exchange can be measured from inside; cards and recorder are processes of their own, as always.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use axis_worker::clock::TimeScale;
use ccu::control::DownReport;
use ccu::daemon::{Daemon, LiveLink, Options};
use ccu::home::Home;
use supersigma_config::Config;
use tokio::runtime::{Builder, Runtime};

/// A set that is up, in real time. It must be taken down; only the end of this process does it otherwise.
pub(crate) struct LiveSet {
    runtime: Runtime,
    daemon: Daemon,
}

impl LiveSet {
    /// Brings it up; its log goes into `folder`.
    pub(crate) fn up(folder: &Path, name: &str, config: Config) -> Result<Self, Box<dyn Error>> {
        let home = Home::of(format!("bench-{name}-{}", std::process::id()).parse()?)?;
        let options = Options {
            home,
            config,
            scale: TimeScale::REAL,
            log: folder.join(format!("{name}.mcap")),
            script: None,
            foxglove: None,
        };
        let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let daemon = runtime.block_on(async { Daemon::start(options) })?;
        Ok(Self { runtime, daemon })
    }

    /// What an executive has of it.
    pub(crate) fn link(&self) -> LiveLink {
        self.daemon.link(Arc::new(AtomicBool::new(false)))
    }

    /// Takes it down.
    pub(crate) fn down(self) -> DownReport {
        self.runtime.block_on(self.daemon.stop())
    }
}
