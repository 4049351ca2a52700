//! What the pulses move: a motor, a carriage on a rail, and the detectors along it. It knows no firmware; it learns the
//! time only because a real rotor swings. Steps e are counted from the lower stop, as in \[F\] Fig 3.
//!
//! ```text
//!   e = 0          e1       eR                                   e2          em
//!    ╟──────────────┼────────┼────────────────────────────────────┼───────────╢
//!    stop  X1 = 1   │ origin   X3 = 1 at eR                       │  X2 = 1    stop
//!          (limit   │ = e1 + 1                                    │
//!           switch) │                                             │
//! ```
//!
//! Without a configured motor the carriage makes every step that it is told to. With one, a [`Rotor`] turns it, which
//! may slip, and an encoder on its shaft tells where it really is. The detectors then see the detent in which the rotor
//! would lock; they are looked at with each pulse, and a thousand times a second while the rotor swings out.

use supersigma_config::{AxisConfig, MotorConfig, MotorError, RailConfig};
use supersigma_protocol::{Direction, End, Position, Steps, Switch, Tick, Ticks};

use crate::motor::{Detent, Encoder, Rotor, SenseDiscriminator};

/// How often a rotor that swings out is looked at.
const LOOK: Ticks = Ticks::from_millis(1);

/// In so many looks, one after the other, a shaft must be slower than S1 to count as standing: a rotor that swings is slow
/// at both ends of each swing.
const SLOW_LOOKS: u8 = 5;

/// A motor, its carriage and its rail.
#[derive(Debug, Clone)]
pub struct Mechanism {
    rail: Rail,
    drive: Drive,
    detectors: Detectors,
    /// S1, in steps per second.
    s1: f64,
    switch: Switch,
    /// Pulses that will not reach the motor.
    lost: u32,
    /// Whether the rotor still moved when it was looked at last.
    swings: bool,
    /// In how many looks, one after the other, it was slower than S1.
    slow_looks: u8,
}

/// The places along a rail.
#[derive(Debug, Clone, Copy)]
struct Rail {
    e1: u32,
    e2: u32,
    reference: u32,
    length: u32,
}

/// What turns pulses into motion.
#[derive(Debug, Clone)]
enum Drive {
    /// Every pulse is a step; e.
    Ideal(u32),
    /// A rotor, at the time that it has reached.
    Rotor(Box<Shaft>),
}

/// A rotor with an encoder on its shaft.
#[derive(Debug, Clone)]
struct Shaft {
    rotor: Rotor,
    encoder: Encoder,
    discriminator: SenseDiscriminator,
    at: Tick,
}

/// What the detectors say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a detector of its own")]
pub struct Detectors {
    /// X1, the limit switch of the origination.
    pub lower: bool,
    /// X2.
    pub upper: bool,
    /// X3.
    pub reference: bool,
    /// The shaft is slower than S1; nothing says so without an encoder.
    pub slow: bool,
}

impl Detectors {
    /// The limit zone that the carriage stands in.
    #[must_use]
    pub fn zone(self) -> Option<End> {
        match (self.lower, self.upper) {
            (true, _) => Some(End::Lower),
            (_, true) => Some(End::Upper),
            _ => None,
        }
    }
}

impl Rail {
    fn detectors(self, e: u32, switch: Switch, slow: bool) -> Detectors {
        let lower = match switch {
            Switch::Free => e <= self.e1,
            Switch::StuckOpen => false,
            Switch::StuckClosed => true,
        };
        Detectors { lower, upper: e >= self.e2, reference: e == self.reference, slow }
    }
}

impl Shaft {
    fn new(motor: &MotorConfig, rail: &RailConfig) -> Result<Self, MotorError> {
        let e = f64::from(rail.start.0);
        let stop = |steps: Steps| Detent(steps.0.into());
        let rotor = Rotor::new(motor, stop(rail.start))?.with_stops(Detent(0), stop(rail.length));
        let encoder = Encoder::new(motor, e);
        let discriminator = SenseDiscriminator::new(encoder.levels());
        Ok(Self { rotor, encoder, discriminator, at: Tick(0) })
    }

    /// Lets the rotor turn until `to`, and the encoder with it.
    fn advance(&mut self, to: Tick) {
        self.rotor.advance(to.since(self.at));
        self.at = self.at.max(to);
        for levels in self.encoder.turn_to(self.rotor.motion().half_steps) {
            self.discriminator.sample(levels);
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a rail has far fewer steps")]
    fn measured(&self) -> i64 {
        self.encoder.half_steps(self.discriminator.position()).round() as i64
    }
}

impl Mechanism {
    /// The carriage of an axis where it stands at switch-on.
    ///
    /// # Errors
    /// If its motor cannot be.
    pub fn new(axis: &AxisConfig) -> Result<Self, MotorError> {
        let RailConfig { length, lower_zone, upper_zone, reference, start } = axis.rail.clone();
        let rail = Rail { e1: lower_zone.0, e2: upper_zone.0, reference: reference.0, length: length.0 };
        let drive = match &axis.motor {
            None => Drive::Ideal(start.0),
            Some(motor) => Drive::Rotor(Box::new(Shaft::new(motor, &axis.rail)?)),
        };
        let detectors = rail.detectors(start.0, Switch::Free, axis.motor.is_some());
        let s1 = axis.following.s1;
        Ok(Self {
            rail,
            drive,
            detectors,
            s1,
            switch: Switch::Free,
            lost: 0,
            swings: false,
            slow_looks: SLOW_LOOKS,
        })
    }

    /// The step e at which the carriage stands.
    #[must_use]
    pub fn carriage(&self) -> u32 {
        match &self.drive {
            Drive::Ideal(e) => *e,
            // The stops keep it between 0 and the rail's length.
            Drive::Rotor(shaft) => u32::try_from(shaft.rotor.detent().0).unwrap_or(0).min(self.rail.length),
        }
    }

    /// Where the carriage really is, in steps from the origin, whatever the firmware believes.
    #[must_use]
    pub fn position(&self) -> Position {
        let e = Steps(self.carriage());
        Position(0).moved(Direction::Forward, e).moved(Direction::TowardsOrigin, Steps(self.rail.e1 + 1))
    }

    /// What the detectors said when they were looked at last.
    #[must_use]
    pub fn detectors(&self) -> Detectors {
        self.detectors
    }

    /// Where the encoder says that the shaft is at `now`, in steps from where it was switched on; `None` without one.
    pub(crate) fn measure(&mut self, now: Tick) -> Option<i64> {
        match &mut self.drive {
            Drive::Ideal(_) => None,
            Drive::Rotor(shaft) => {
                shaft.advance(now);
                Some(shaft.measured())
            }
        }
    }

    /// Whether it has a rotor, whose motion cannot be foreseen by counting pulses.
    pub(crate) fn has_rotor(&self) -> bool {
        matches!(self.drive, Drive::Rotor(_))
    }

    /// When a rotor that swings is looked at next, after `now`; `None` if it is at rest.
    pub(crate) fn next_look(&self, now: Tick) -> Option<Tick> {
        self.swings.then(|| Tick((now.0 / LOOK.0 + 1) * LOOK.0))
    }

    /// Lets a rotor turn until `now`, and looks at the detectors.
    pub(crate) fn look(&mut self, now: Tick) {
        if let Drive::Rotor(shaft) = &mut self.drive {
            shaft.advance(now);
            self.swings = !shaft.rotor.is_at_rest();
            let slow = shaft.rotor.motion().speed.abs() < self.s1;
            self.slow_looks = match slow {
                _ if !self.swings => SLOW_LOOKS,
                true => (self.slow_looks + 1).min(SLOW_LOOKS),
                false => 0,
            };
        }
        self.read_detectors();
    }

    /// Makes `pulses` steps at `now`; at a stop the carriage stays where it is and the motor slips. Rotors take one at a time.
    pub(crate) fn step(&mut self, direction: Direction, pulses: u32, now: Tick) {
        let lost = self.lost.min(pulses);
        self.lost -= lost;
        let pulses = pulses - lost;
        match &mut self.drive {
            Drive::Ideal(e) => {
                *e = match direction {
                    Direction::Forward => e.saturating_add(pulses).min(self.rail.length),
                    Direction::TowardsOrigin => e.saturating_sub(pulses),
                };
            }
            Drive::Rotor(shaft) => {
                shaft.advance(now);
                for _ in 0..pulses {
                    shaft.rotor.pulse(direction);
                }
                self.swings = true;
            }
        }
        self.read_detectors();
    }

    fn read_detectors(&mut self) {
        let slow = self.has_rotor() && self.slow_looks == SLOW_LOOKS;
        self.detectors = self.rail.detectors(self.carriage(), self.switch, slow);
    }

    /// After how many pulses in `direction` a detector changes next, if every pulse is a step; `None` if none does before
    /// the stop.
    #[must_use]
    pub fn steps_to_change(&self, direction: Direction) -> Option<u32> {
        let e = self.carriage();
        let Rail { e1, e2, reference, .. } = self.rail;
        // A detector that says one thing at e − 1 and another at e changes at the border e.
        let borders = [e1 + 1, e2, reference, reference + 1];
        let steps = match direction {
            Direction::Forward => borders.into_iter().filter(|at| *at > e).map(|at| at - e).min(),
            Direction::TowardsOrigin => borders.into_iter().filter(|at| *at <= e).map(|at| e + 1 - at).min(),
        };
        steps.map(|steps| steps.saturating_add(self.lost))
    }

    /// The next `pulses` will not reach the motor: a fault on purpose.
    pub(crate) fn lose(&mut self, pulses: Steps) {
        self.lost = pulses.0;
    }

    /// What is wrong with the limit switch: a fault on purpose.
    pub(crate) fn set_switch(&mut self, switch: Switch, now: Tick) {
        self.switch = switch;
        self.look(now);
    }
}

#[cfg(test)]
mod tests {
    use supersigma_config::Config;

    use super::*;

    fn mechanism(start: u32) -> Mechanism {
        let mut axis = Config::default_set().axes.swap_remove(0);
        axis.rail = RailConfig {
            length: Steps(1_000),
            lower_zone: Steps(100),
            upper_zone: Steps(900),
            reference: Steps(300),
            start: Steps(start),
        };
        Mechanism::new(&axis).expect("no motor")
    }

    #[test]
    fn every_change_of_a_detector_is_foreseen() {
        for (direction, start, expected) in [
            (Direction::Forward, 0, [101, 300, 301, 900]),
            (Direction::TowardsOrigin, 1_000, [899, 300, 299, 100]),
        ] {
            let mut walking = mechanism(start);
            let mut changes = vec![];
            while let Some(steps) = walking.steps_to_change(direction) {
                let before = walking.detectors();
                walking.step(direction, steps - 1, Tick(0));
                assert_eq!(walking.detectors(), before, "nothing changes before the foreseen step");
                walking.step(direction, 1, Tick(0));
                assert_ne!(walking.detectors(), before);
                changes.push(walking.carriage());
            }
            assert_eq!(changes, expected);
        }
    }

    #[test]
    fn the_carriage_does_not_leave_the_rail() {
        let mut mechanism = mechanism(500);
        mechanism.step(Direction::TowardsOrigin, 501, Tick(0));
        assert_eq!(mechanism.carriage(), 0);
        mechanism.step(Direction::Forward, 5_000, Tick(0));
        assert_eq!(mechanism.carriage(), 1_000);
        assert_eq!(mechanism.detectors().zone(), Some(End::Upper));
    }

    #[test]
    fn lost_pulses_and_a_stuck_switch_are_what_they_say() {
        let mut mechanism = mechanism(110);
        mechanism.lose(Steps(3));
        assert_eq!(mechanism.steps_to_change(Direction::TowardsOrigin), Some(13));
        mechanism.step(Direction::TowardsOrigin, 12, Tick(0));
        assert_eq!((mechanism.carriage(), mechanism.detectors().lower), (101, false));
        mechanism.set_switch(Switch::StuckOpen, Tick(0));
        mechanism.step(Direction::TowardsOrigin, 1, Tick(0));
        assert!(!mechanism.detectors().lower);
        mechanism.set_switch(Switch::StuckClosed, Tick(0));
        assert!(mechanism.detectors().lower);
    }
}
