//! What a set is made of, typed and validated: axes, rails, ramps, digital lines, supervision.
//!
//! The values come from a TOML text; the seven-axis SUPERSIGMA set is compiled in ([`DEFAULT_TOML`]). Whoever
//! holds a loaded [`Config`] may rely on it: every rule is checked on loading, and an error names file, line, column
//! and key. Nothing in here moves, waits or talks to anybody.

mod deserialize;
mod document;
mod fault;
mod load;
mod model;
mod motor;
mod origin;
mod problem;
mod profile;
mod ramp;
mod ramps;
mod rules;
mod schema;
#[cfg(test)]
mod tests;

pub use document::KeyPath;
pub use fault::{ConfigError, Fault};
pub use load::DEFAULT_TOML;
pub use model::{
    AxisConfig, Config, DigitalConfig, ExecutiveConfig, Feedback, FollowingConfig, InputConfig, LineConfig,
    LogConfig, OnLoss, OriginationConfig, OutputConfig, RailConfig, RealTimeConfig, SchedulingPolicy,
    SupervisionConfig, TravelConfig,
};
pub use motor::{HALF_STEPS_PER_CYCLE, MotorConfig, MotorError};
pub use origin::{Origin, Source};
pub use problem::{Problem, choose};
pub use profile::{CountTable, Differences, Linear, Profile, ProfileName, RampConfig, ShortMoves, Sin2};
pub use ramp::{RampError, SMALLEST_N, SPEEDS};
