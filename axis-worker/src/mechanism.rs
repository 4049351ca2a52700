//! What the pulses move: a motor on a rail, and the detectors along it. It counts steps; it knows no time and no
//! firmware. Steps e are counted from the lower stop, as in \[F\] Fig 3.
//!
//! ```text
//!   e = 0          e1       eR                                   e2          em
//!    ╟──────────────┼────────┼────────────────────────────────────┼───────────╢
//!    stop  X1 = 1   │ origin   X3 = 1 at eR                       │  X2 = 1    stop
//!          (limit   │ = e1 + 1                                    │
//!           switch) │                                             │
//! ```

use supersigma_config::RailConfig;
use supersigma_protocol::{Direction, End, Position, Steps};

/// A motor on its rail.
#[derive(Debug, Clone)]
pub struct Mechanism {
    e: u32,
    e1: u32,
    e2: u32,
    reference: u32,
    length: u32,
}

/// What the detectors say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Detectors {
    /// X1, the limit switch of the origination.
    pub lower: bool,
    /// X2.
    pub upper: bool,
    /// X3.
    pub reference: bool,
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

impl Mechanism {
    /// The carriage of `rail` where it stands at switch-on.
    #[must_use]
    pub fn new(rail: &RailConfig) -> Self {
        Self {
            e: rail.start.0,
            e1: rail.lower_zone.0,
            e2: rail.upper_zone.0,
            reference: rail.reference.0,
            length: rail.length.0,
        }
    }

    /// The step e at which the carriage stands.
    #[must_use]
    pub fn carriage(&self) -> u32 {
        self.e
    }

    /// Where the carriage really is, in steps from the origin, whatever the firmware believes.
    #[must_use]
    pub fn position(&self) -> Position {
        Position(0)
            .moved(Direction::Forward, Steps(self.e))
            .moved(Direction::TowardsOrigin, Steps(self.e1 + 1))
    }

    /// What the detectors say now.
    #[must_use]
    pub fn detectors(&self) -> Detectors {
        Detectors { lower: self.e <= self.e1, upper: self.e >= self.e2, reference: self.e == self.reference }
    }

    /// Makes `pulses` steps; at a stop the carriage stays where it is and the motor slips.
    pub fn step(&mut self, direction: Direction, pulses: u32) {
        self.e = match direction {
            Direction::Forward => self.e.saturating_add(pulses).min(self.length),
            Direction::TowardsOrigin => self.e.saturating_sub(pulses),
        };
    }

    /// After how many steps in `direction` a detector changes next; `None` if none does before the stop.
    #[must_use]
    pub fn steps_to_change(&self, direction: Direction) -> Option<u32> {
        // A detector that says one thing at e − 1 and another at e changes at the border e.
        let borders = [self.e1 + 1, self.e2, self.reference, self.reference + 1];
        match direction {
            Direction::Forward => borders.into_iter().filter(|e| *e > self.e).map(|e| e - self.e).min(),
            Direction::TowardsOrigin => {
                borders.into_iter().filter(|e| *e <= self.e).map(|e| self.e + 1 - e).min()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use supersigma_protocol::Steps;

    use super::*;

    fn rail() -> RailConfig {
        RailConfig {
            length: Steps(1_000),
            lower_zone: Steps(100),
            upper_zone: Steps(900),
            reference: Steps(300),
            start: Steps(500),
        }
    }

    #[test]
    fn every_change_of_a_detector_is_foreseen() {
        for direction in [Direction::Forward, Direction::TowardsOrigin] {
            let mut start = rail();
            start.start = Steps(if direction == Direction::Forward { 0 } else { 1_000 });
            let mut walking = Mechanism::new(&start);
            let mut changes = vec![];
            while let Some(steps) = walking.steps_to_change(direction) {
                let before = walking.detectors();
                walking.step(direction, steps - 1);
                assert_eq!(walking.detectors(), before, "nothing changes before the foreseen step");
                walking.step(direction, 1);
                assert_ne!(walking.detectors(), before);
                changes.push(walking.carriage());
            }
            let expected = match direction {
                Direction::Forward => [101, 300, 301, 900],
                Direction::TowardsOrigin => [899, 300, 299, 100],
            };
            assert_eq!(changes, expected);
        }
    }

    #[test]
    fn the_carriage_does_not_leave_the_rail() {
        let mut mechanism = Mechanism::new(&rail());
        mechanism.step(Direction::TowardsOrigin, 501);
        assert_eq!(mechanism.carriage(), 0);
        mechanism.step(Direction::Forward, 5_000);
        assert_eq!(mechanism.carriage(), 1_000);
        assert_eq!(mechanism.detectors().zone(), Some(End::Upper));
    }
}
