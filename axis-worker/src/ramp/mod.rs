//! The ramp: the table of counts, and plans that walk it. Integers only; no state, no clock, no chip. (The continuous
//! [`Curve`] is there to measure plans with, not to make them.)
//!
//! ```text
//!   speed
//!   15 000 ┤            ╭────────────────────╮
//!          │          ╱ ·                    · ╲
//!          │        ╱   ·                    ·   ╲          V(t) = 15 000 sin²(4.544 26 t + 0.209 7)
//!          │      ╱     ·                    ·     ╲
//!      650 ┼────╯       ·                    ·       ╰────
//!          └────────────┴────────────────────┴──────────── t
//!           up the walk    one period after     the same periods
//!                          the other            in reverse
//! ```
//!
//! The *table* holds N for 233 speeds, 1.29 ms apart (\[C\] eq. (2), (3)), or those of another profile: a linear one, or a
//! table of counts. Nothing below the table knows which. A *walk* turns it into periods: each
//! period has the entry that is due when it begins, because a count written to a running 8253 waits for the end of
//! the period. A *plan* is one movement: runs of equal periods, each with the tick at which the firmware writes its
//! count, held as a few *pieces* that are parts of a walk, or level. Both directions of the question — the tick of a
//! pulse, the pulses by a tick — are then a search among a few pieces and one in the walk's sums, however long the
//! movement. A *schedule* is a plan, or an axis' share of the plan of a
//! line's leading axis.

#[cfg(test)]
pub(crate) mod any;
#[cfg(test)]
mod bound_tests;
mod curve;
#[deny(clippy::float_arithmetic)]
mod paper;
#[deny(clippy::float_arithmetic)]
mod piece;
#[deny(clippy::float_arithmetic)]
mod plan;
#[deny(clippy::float_arithmetic)]
mod schedule;
#[deny(clippy::float_arithmetic)]
mod signposts;
mod table;
#[cfg(test)]
mod tests;
#[deny(clippy::float_arithmetic)]
mod walk;

pub use curve::Curve;
pub use plan::{Leg, Phase, Plan, Run, Stop};
pub use schedule::{Schedule, Share};
pub use table::Table;
pub use walk::Walk;

use supersigma_protocol::Ticks;

/// From the pulse that tells the firmware that a count is wanted to the write of that count: five of the 8748's
/// 2.5 µs instruction cycles, enough to read a counter and write two bytes. Far shorter than the shortest period.
pub(crate) const REACTION: Ticks = Ticks(25);
