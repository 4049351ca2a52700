//! The test bench of \[M\] as `ccu bench` runs it: a motor, what is put on its shaft, a program, and what is recorded of a run.
//! The apparatus itself is [`axis_worker::bench`]; files and pictures are made from what it tells, and change nothing of it.

pub mod filter;
pub mod limits;
mod run;
mod samples;
pub mod tune;

use axis_worker::motor::Load;
use supersigma_config::{MotorConfig, MotorError};
use supersigma_protocol::Tick;

pub use run::{FirstLost, Program, Report, Run, RunError};
pub use samples::{SampleError, SampleFile, SampleForm, SampleView};

/// The motor on the bench.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchMotor {
    /// Whose it is, in words: `the bench motor`, `the motor of left_x`.
    pub name: String,
    /// The motor, without the bench's load.
    pub config: MotorConfig,
    /// What the bench puts on its shaft.
    pub load: Load,
}

impl BenchMotor {
    /// The motor with its load as one.
    ///
    /// # Errors
    /// If it cannot be: it cannot hold that load, for example.
    pub fn loaded(&self) -> Result<MotorConfig, MotorError> {
        let loaded = self.load.on(&self.config);
        loaded.check().map(|()| loaded)
    }

    /// Counts of its encoder in one turn: 8 000 for a disc of 2 000 lines.
    #[must_use]
    pub const fn counts_per_turn(&self) -> u32 {
        4 * self.config.encoder_lines
    }
}

/// One run, whole in memory: for pictures, which need all of it at once.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Recording {
    /// Samples per second.
    pub sampling_hertz: u32,
    /// Counts of the encoder in one turn: 8 000 for a disc of 2 000 lines.
    pub counts_per_turn: u32,
    /// Half steps in one turn.
    pub half_steps_per_turn: u32,
    /// The position at each sample, in counts, from sample 0 at time 0 on; positive is forward.
    pub positions: Vec<i64>,
    /// The pulses that were given.
    pub commanded: Vec<CommandedPulse>,
}

/// One pulse of the 8253's channel 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CommandedPulse {
    /// When the motor got it; the train begins at 0.
    pub at: Tick,
    /// The period that it ends, in clocks of 1 MHz: 2 to 65 536.
    pub clocks: u32,
}
