//! The fastest ramp that a motor follows, with something in hand. Nothing here is computed from the motor's data: ramps
//! are proposed, and their very pulses turn its rotor, as [`crate::motor`] has it.
//!
//! # The margin
//!
//! A *margin* m takes that part of the holding torque away. A ramp has the margin m if its pulses move the weakened
//! motor, with all of its load, by as many steps as they are, and it comes to rest there. Swings are no monotonous thing: a weak
//! motor may follow what a strong one does not. So a proposal is played on *rungs*, and must hold on all of them:
//!
//! ```text
//!   holding torque   T          T (1 − m/2)      T (1 − m)         with a load torque L, a hanging weight,
//!   rung             nominal    half             full              each of them both with L and with −L
//! ```
//!
//! # The search
//!
//! ```text
//!   speed
//!   f_max ┤      ╭─────────╮           f_start  3 candidates: 1, 0.8 and 0.6 of the start-stop of the worst rung
//!         │    ╱ ·         · ╲         f_max    golden section of its logarithm, up to the pull-out of the worst
//!         │  ╱   ·         ·   ╲                rung; what does not reach f_max within the movement is no candidate
//! f_start ┤╯     ·         ·     ╰     t        for each f_max the shortest ramp that holds, by bisection
//!         └──────┴─────────┴─────── t
//!          t_a = t         t_c = t     last, t_c alone is made as short as holds, and then t_a
//! ```
//!
//! The [bench's profile](linear()) is for one movement. A [ramp of the card](card()) is for all: it is stretched until shorter
//! movements and the emergency stop hold as well.
//!
//! The search is deterministic and has an end: at most [`MOST_TRIALS`] movements are played, each on the rungs up to the first
//! slip; mostly a few hundred. A movement is *fastest* if its last pulse comes soonest; how long the rotor swings after
//! that is told apart.

mod card;
mod positioning;
mod pulses;
mod search;
mod stand;
#[cfg(test)]
mod tests;

use supersigma_config::{MotorConfig, MotorError};
use thiserror::Error;

pub use card::{CardProposal, CardShape, card};
pub use positioning::{LinearProposal, linear};
pub use pulses::Pulses;
pub use stand::{Assessment, Outcome, Slip, assess, lags, play};

/// Movements that a search plays at most.
pub const MOST_TRIALS: u32 =
    3 * (search::TOPS * search::RAMPS + (card::STRETCHES + 1) * card::LENGTHS) + search::RAMPS;

/// The part of the holding torque that is kept in hand: 0 up to, but not, 1.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Margin(f64);

impl Margin {
    /// Nothing in hand.
    pub const NONE: Self = Self(0.0);

    /// `part` of the torque; `None` if that is not a part.
    #[must_use]
    pub fn new(part: f64) -> Option<Self> {
        (0.0..1.0).contains(&part).then_some(Self(part))
    }

    /// The motor that has this part of its holding torque no more.
    #[must_use]
    pub fn weakened(self, motor: &MotorConfig) -> MotorConfig {
        stand::weakened(motor, self.0)
    }

    /// As a part of 1.
    #[must_use]
    pub const fn part(self) -> f64 {
        self.0
    }
}

impl std::fmt::Display for Margin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.0} %", self.0 * 100.0)
    }
}

/// Why there is no proposal.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TuneError {
    /// The motor cannot be, or cannot hold its load.
    #[error(transparent)]
    Motor(#[from] MotorError),
    /// It holds its load, but not with that margin.
    #[error(
        "friction and load torque, {load} N·m together, are not less than the {weakened:.3} N·m that a margin of {margin} leaves of the holding torque"
    )]
    NoMargin {
        /// Newton metres.
        load: f64,
        /// Newton metres.
        weakened: f64,
        /// What was asked for.
        margin: Margin,
    },
    /// Not even slow pulses are followed.
    #[error("with a margin of {margin} the motor does not start and stop with its load at 50 half steps/s")]
    WillNotStart {
        /// What was asked for.
        margin: Margin,
    },
    /// The motor could, but the profile cannot be played.
    #[error("there is no such ramp for this motor whose table the card can play: {reason}")]
    NoTable {
        /// Of the last ramp that was tried.
        reason: supersigma_config::RampError,
    },
}
