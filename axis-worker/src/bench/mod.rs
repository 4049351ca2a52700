//! The test bench of one stepping motor, \[M\]: the machine parts of an axis, wired as on its "prototyping board".
//! Deterministic and without I/O; every number that a pulse depends on is an integer. It knows no rail and no MICROBUS.
//!
//! ```text
//!  timing      counts TC(j)            pulses       ┌───────┐ shaft ┌─────────┐ A ┌───────────────┐ L
//!  ───────────────────────► channel 2 ─────────────►│ motor ├───────┤ encoder ├──►│ SENSE         ├───► channel 0 ─┐ latched and
//!                           8253 │                  │ load  │       │         │ B │ DISCRIMINATOR │ R              ├─► read by the
//!  1 MHz ────────────────────────┘                  └───────┘       └─────────┘──►│               ├───► channel 1 ─┘ interrupt
//!                                                                                 └───────────────┘
//!  TEST-NS     pulses given  ◄────────────────────── compared at every sample ───────────────────────── counts read
//! ```
//!
//! A clock of the bench is 1 µs, two ticks. A step is one pulse, a half step of the motor, as everywhere here; frequencies
//! are pulses per second.

mod apparatus;
mod confirmation;
mod counters;
mod sampling;
#[cfg(test)]
#[expect(clippy::float_arithmetic, clippy::cast_precision_loss, reason = "the oracles compute in floats")]
mod tests;
mod timing;
mod units;

pub use apparatus::{Bench, Observer, Outcome, Pulse, Sample};
pub use confirmation::{Confirmed, Place};
pub use sampling::{Sampling, SamplingError};
pub use timing::{Hold, PartSteps, Periods, Positioning, TimingError, Train};
pub use units::{CLOCK_HERTZ, Clocks, Frequency, Period, UnitError};
