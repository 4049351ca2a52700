//! One SUPERSIGMA card: a pure machine (8253, ramp, firmware, mechanism) and the process round it.
//!
//! [`Card`] is the machine as the bus sees it. Everything it is made of is deterministic and without I/O: no clock, no
//! floating point in the pulse path, no allocation per pulse. [`worker`] is the thin shell that gives it time and frames.

mod axis;
#[deny(clippy::float_arithmetic)]
pub mod bench;
#[deny(clippy::float_arithmetic)]
mod board;
mod card;
pub mod clock;
mod digital;
#[deny(clippy::float_arithmetic)]
pub mod firmware;
pub mod journal;
pub mod mechanism;
pub mod motor;
#[deny(clippy::float_arithmetic)]
pub mod pit8253;
pub mod ramp;
pub mod real_time;
pub mod stall;
pub mod tune;
pub mod worker;

use tracing_subscriber::Layer;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

pub use axis::{Axis, AxisError};
pub use board::{Board, Sink};
pub use card::Card;
pub use digital::Digital;

#[cfg(test)]
mod tests;

/// Writes what happens to standard error, as [`stderr_layer`] does. For the first lines of a program.
pub fn start_logging() {
    tracing_subscriber::registry().with(stderr_layer()).init();
}

/// What writes to standard error, as `RUST_LOG` asks for it; warnings and worse if it does not, but of the bus' library
/// only errors: it warns of what it then does right; and of the viewers' server nothing, because viewers come and go. In
/// colours only on a terminal, and not if `NO_COLOR` is set; with priorities if it is the [`journal`] that listens.
pub fn stderr_layer<S>() -> Box<dyn Layer<S> + Send + Sync>
where
    S: tracing::Subscriber + for<'span> tracing_subscriber::registry::LookupSpan<'span> + Send + Sync,
{
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| {
        tracing_subscriber::EnvFilter::new("warn,iceoryx2_bb_loggers=error,foxglove=off")
    });
    let told = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    if journal::is_connected() {
        return told.with_ansi(false).event_format(journal::Lines).with_filter(filter).boxed();
    }
    let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    told.with_ansi(wanted && std::io::IsTerminal::is_terminal(&std::io::stderr())).with_filter(filter).boxed()
}
