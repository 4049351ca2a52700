//! A stepping motor, its load and its encoder, as numbers. Here are only the numbers and what makes them unusable; how
//! a motor moves is the axis worker's business.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Half steps of one electrical cycle: after it the same windings carry the same currents.
pub const HALF_STEPS_PER_CYCLE: u32 = 8;

/// Far above any motor of this kind (a few hundred hertz), and slow enough to be followed in steps of 5 µs.
const HIGHEST_NATURAL_HERTZ: f64 = 5_000.0;
/// A turn in steps of less than a minute of arc is not this kind of motor; with it, counts of the encoder are exact.
const MOST_HALF_STEPS: u32 = 25_600;
const MOST_LINES: u32 = 100_000;

/// A stepping motor that can lose steps, its load, and the encoder on its shaft. What is left out is as on the bench.
///
/// The bench motor is a plausible one of the size of \[C\]'s Rapid-Syn 34D-9209FA (NEMA 34), whose data sheet is not
/// at hand: its numbers are chosen so that it does on the bench what the paper reports, 27 000 half steps/s included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotorConfig {
    /// Half steps of one turn, a multiple of 8: 400 are 0.9° each.
    #[schemars(range(min = 8, max = 25_600), extend("multipleOf" = 8))]
    pub half_steps_per_turn: u32,
    /// The largest torque against which the motor at rest holds its detent, newton metres, above 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub holding_torque: f64,
    /// The speed at which the inductance of the windings has taken the torque down to 1/√2 of the holding torque, half
    /// steps per second, above 0. Beyond it the torque falls with 1/speed.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub corner_speed: f64,
    /// The rotor's moment of inertia, kg·m², above 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rotor_inertia: f64,
    /// The moment of inertia of all that the shaft turns besides, kg·m², 0 or more.
    #[schemars(range(min = 0.0))]
    pub load_inertia: f64,
    /// Damping of the rotor's swing about the turning field by the currents that the swing induces, at full field and
    /// small slip, newton metres per radian per second, 0 or more.
    #[schemars(range(min = 0.0))]
    pub damping: f64,
    /// The slip between rotor and field at which that damping gives its largest torque, half steps per second, above 0.
    /// Beyond it the torque falls again, so that the motor does not run up like an induction motor.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub damping_slip: f64,
    /// Friction that grows with the speed of the shaft, newton metres per radian per second, 0 or more.
    #[schemars(range(min = 0.0))]
    pub viscous_friction: f64,
    /// Dry friction, the same at every speed and against it, newton metres, 0 or more.
    #[schemars(range(min = 0.0))]
    pub friction: f64,
    /// A torque that always turns the shaft towards the origin, as a hanging weight does, newton metres; negative if away
    /// from it.
    pub load_torque: f64,
    /// Lines of the encoder's disc, above 0, 100 000 at most; four times as many counts make one turn. \[M\] has 2 000.
    #[schemars(range(min = 1, max = 100_000))]
    pub encoder_lines: u32,
}

impl Default for MotorConfig {
    fn default() -> Self {
        Self::bench()
    }
}

/// Why a motor cannot be.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MotorError {
    /// A quantity is infinite or not a number.
    #[error("{value} is not a finite number")]
    NotFinite {
        /// Its key.
        parameter: &'static str,
        /// What it is.
        value: f64,
    },
    /// A quantity without which nothing moves, or everything at once.
    #[error("{value} is not more than 0")]
    NotPositive {
        /// Its key.
        parameter: &'static str,
        /// What it is.
        value: f64,
    },
    /// A quantity that cannot be negative.
    #[error("{value} is less than 0")]
    Negative {
        /// Its key.
        parameter: &'static str,
        /// What it is.
        value: f64,
    },
    /// A turn that is not made of electrical cycles.
    #[error("{half_steps} half steps are not a turn, which has 8 to 25 600, a multiple of 8")]
    NoTurn {
        /// Half steps per turn.
        half_steps: u32,
    },
    /// An encoder without lines, or with more than can be made.
    #[error("an encoder with {lines} lines cannot be, it has 1 to 100 000")]
    NoEncoder {
        /// Lines.
        lines: u32,
    },
    /// The motor cannot even hold its load.
    #[error(
        "friction and load torque, {load} N·m together, are not less than the holding torque, {holding} N·m"
    )]
    Overloaded {
        /// Newton metres.
        load: f64,
        /// Newton metres.
        holding: f64,
    },
    /// So little inertia for so much torque that no such motor exists.
    #[error(
        "the rotor would swing at {hertz:.0} Hz, more than 5 000: too little inertia for {holding_torque} N·m"
    )]
    TooLight {
        /// The natural frequency.
        hertz: f64,
        /// Newton metres.
        holding_torque: f64,
    },
}

impl MotorError {
    /// The key of the value that is wrong, or of the first of those that do not fit each other.
    #[must_use]
    pub const fn parameter(&self) -> &'static str {
        match self {
            Self::NotFinite { parameter, .. }
            | Self::NotPositive { parameter, .. }
            | Self::Negative { parameter, .. } => parameter,
            Self::NoTurn { .. } => "half_steps_per_turn",
            Self::NoEncoder { .. } => "encoder_lines",
            Self::Overloaded { .. } => "holding_torque",
            Self::TooLight { .. } => "rotor_inertia",
        }
    }
}

impl MotorConfig {
    /// The motor on the test bench of \[C\], without load.
    #[must_use]
    pub const fn bench() -> Self {
        Self {
            half_steps_per_turn: 400,
            holding_torque: 2.5,
            corner_speed: 4_000.0,
            rotor_inertia: 1.2e-4,
            load_inertia: 0.0,
            damping: 0.025,
            damping_slip: 800.0,
            viscous_friction: 4e-4,
            friction: 0.03,
            load_torque: 0.0,
            encoder_lines: 2_000,
        }
    }

    /// Rotor and load together, kg·m².
    #[must_use]
    pub fn inertia(&self) -> f64 {
        self.rotor_inertia + self.load_inertia
    }

    /// Electrical cycles of one turn: the rotor's teeth.
    #[must_use]
    pub fn cycles_per_turn(&self) -> u32 {
        self.half_steps_per_turn / HALF_STEPS_PER_CYCLE
    }

    /// How fast the rotor at rest swings about its detent, in hertz, when little and not damped:
    ///
    /// ```text
    /// f = √(p · T / J) / 2π         p cycles per turn, T holding torque, J inertia
    /// ```
    #[must_use]
    pub fn natural_hertz(&self) -> f64 {
        (f64::from(self.cycles_per_turn()) * self.holding_torque / self.inertia()).sqrt()
            / std::f64::consts::TAU
    }

    /// Whether such a motor can be.
    ///
    /// # Errors
    ///
    /// [`MotorError`], the first reason found why it cannot.
    pub fn check(&self) -> Result<(), MotorError> {
        let positive = [
            ("holding_torque", self.holding_torque),
            ("corner_speed", self.corner_speed),
            ("rotor_inertia", self.rotor_inertia),
            ("damping_slip", self.damping_slip),
        ];
        let not_negative = [
            ("load_inertia", self.load_inertia),
            ("damping", self.damping),
            ("viscous_friction", self.viscous_friction),
            ("friction", self.friction),
        ];
        let every = positive.into_iter().chain(not_negative).chain([("load_torque", self.load_torque)]);
        if let Some((parameter, value)) = every.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(MotorError::NotFinite { parameter, value });
        }
        if let Some((parameter, value)) = positive.into_iter().find(|(_, value)| *value <= 0.0) {
            return Err(MotorError::NotPositive { parameter, value });
        }
        if let Some((parameter, value)) = not_negative.into_iter().find(|(_, value)| *value < 0.0) {
            return Err(MotorError::Negative { parameter, value });
        }
        let half_steps = self.half_steps_per_turn;
        if half_steps == 0 || !half_steps.is_multiple_of(HALF_STEPS_PER_CYCLE) || half_steps > MOST_HALF_STEPS
        {
            return Err(MotorError::NoTurn { half_steps });
        }
        if self.encoder_lines == 0 || self.encoder_lines > MOST_LINES {
            return Err(MotorError::NoEncoder { lines: self.encoder_lines });
        }
        let (load, holding) = (self.friction + self.load_torque.abs(), self.holding_torque);
        if load >= holding {
            return Err(MotorError::Overloaded { load, holding });
        }
        let hertz = self.natural_hertz();
        if hertz > HIGHEST_NATURAL_HERTZ {
            return Err(MotorError::TooLight { hertz, holding_torque: self.holding_torque });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bench_motor_can_be_and_swings_at_162_hertz() {
        let bench = MotorConfig::bench();
        assert_eq!(bench.check(), Ok(()));
        // √(50 · 2.5 / 1.2e-4) = 1 020.6 rad/s.
        assert!((bench.natural_hertz() - 162.44).abs() < 0.01, "{}", bench.natural_hertz());
    }

    #[test]
    fn every_reason_is_named() {
        let ok = MotorConfig::bench;
        let reasons = [
            (
                MotorConfig { load_torque: f64::INFINITY, ..ok() },
                MotorError::NotFinite { parameter: "load_torque", value: f64::INFINITY },
            ),
            (
                MotorConfig { rotor_inertia: 0.0, ..ok() },
                MotorError::NotPositive { parameter: "rotor_inertia", value: 0.0 },
            ),
            (
                MotorConfig { friction: -0.1, ..ok() },
                MotorError::Negative { parameter: "friction", value: -0.1 },
            ),
            (MotorConfig { half_steps_per_turn: 0, ..ok() }, MotorError::NoTurn { half_steps: 0 }),
            (MotorConfig { half_steps_per_turn: 404, ..ok() }, MotorError::NoTurn { half_steps: 404 }),
            (MotorConfig { encoder_lines: 0, ..ok() }, MotorError::NoEncoder { lines: 0 }),
            (
                MotorConfig { friction: 1.0, load_torque: -1.5, ..ok() },
                MotorError::Overloaded { load: 2.5, holding: 2.5 },
            ),
        ];
        for (motor, reason) in reasons {
            assert_eq!(motor.check(), Err(reason));
        }
        let light = MotorConfig { rotor_inertia: 1e-8, ..ok() }.check();
        assert!(matches!(light, Err(MotorError::TooLight { hertz, .. }) if hertz > 17_000.0), "{light:?}");
    }
}
