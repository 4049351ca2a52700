//! What a set is made of, typed and validated: axes, rails, ramps, digital lines, supervision.
//!
//! The values come from a TOML text; the seven-axis SUPERSIGMA set is compiled in ([`DEFAULT_TOML`]). Whoever
//! holds a [`Config`] may rely on it: every rule is checked on loading, and an error names file, line, column and
//! key. Nothing in here moves, waits or talks to anybody.

mod model;

pub use model::{
    AxisConfig, Config, DigitalConfig, ExecutiveConfig, InputConfig, LineConfig, LogConfig, OriginationConfig,
    OutputConfig, RailConfig, RampConfig, ShortMoves, SupervisionConfig, TravelConfig,
};
