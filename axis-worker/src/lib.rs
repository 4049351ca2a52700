//! One SUPERSIGMA card: a pure machine (8253, ramp, firmware, mechanism) and the process round it.
//!
//! [`Card`] is the machine as the bus sees it. Everything it is made of is deterministic and without I/O: no clock, no
//! floating point in the pulse path, no allocation per pulse. [`worker`] is the thin shell that gives it time and frames.

mod axis;
#[deny(clippy::float_arithmetic)]
mod board;
mod card;
pub mod clock;
mod digital;
#[deny(clippy::float_arithmetic)]
pub mod firmware;
pub mod mechanism;
pub mod motor;
#[deny(clippy::float_arithmetic)]
pub mod pit8253;
pub mod ramp;
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
/// only errors: it warns of what it then does right; and of the viewers' server nothing, because viewers come and go.
pub fn stderr_layer<S>() -> impl Layer<S>
where
    S: tracing::Subscriber + for<'span> tracing_subscriber::registry::LookupSpan<'span>,
{
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| {
        tracing_subscriber::EnvFilter::new("warn,iceoryx2_bb_loggers=error,foxglove=off")
    });
    let colours = std::io::IsTerminal::is_terminal(&std::io::stderr());
    tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_ansi(colours).with_filter(filter)
}
