//! The pieces that a plan is made of: some periods of one length, or a part of a walk, up or down. A part of a walk takes the
//! room of one period, however many runs it has, and answers from the walk's sums. It knows where it begins, and not what
//! comes before or after it.

use std::sync::Arc;

use super::REACTION;
use super::plan::{Phase, Run};
use super::walk::{Rung, Walk};

/// Successive runs of a plan that belong together. Pulses within a piece are counted from 1, runs from 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Piece {
    shape: Shape,
    /// What the axis does meanwhile.
    pub(super) phase: Phase,
    /// When the firmware writes the first run's count; `None` if the chip has it already.
    pub(super) written: Option<u64>,
    /// Pulses of the plan before this piece.
    pub(super) before: u32,
    /// Runs of the plan before this piece.
    pub(super) runs_before: usize,
    /// Where its first period begins.
    pub(super) start: u64,
    /// Pulses of this piece. None if a later count overtakes this one.
    pub(super) pulses: u32,
    /// Where its last period ends.
    pub(super) end: u64,
    /// Where the walk is when the piece begins, in ticks from the start of the walk.
    walked: u64,
    /// The rung of its first pulse.
    rung: usize,
}

/// Where the periods of a piece come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Shape {
    /// All of one length, in ticks.
    Level(u32),
    /// Those of a walk after this pulse of it.
    Up(Arc<Walk>, u32),
    /// Those of a walk from this pulse of it backwards.
    Down(Arc<Walk>, u32),
}

impl Shape {
    /// The first period.
    pub(super) fn first_period(&self) -> u32 {
        match self {
            Self::Level(period) => *period,
            Self::Up(walk, from) => walk.period_of(from + 1),
            Self::Down(walk, from) => walk.period_of(*from),
        }
    }
}

impl Piece {
    /// `pulses` periods of `shape` that follow `last`, or begin the plan.
    pub(super) fn after(
        last: Option<&Self>,
        shape: Shape,
        pulses: u32,
        phase: Phase,
        written: Option<u64>,
    ) -> Self {
        let (before, runs_before, start) = last
            .map_or((0, 0, 0), |last| (last.before + last.pulses, last.runs_before + last.runs(), last.end));
        let (walked, rung) = match &shape {
            Shape::Level(_) => (0, 0),
            Shape::Up(walk, from) => (walk.tick_of(*from), walk.rung_of(from + 1)),
            Shape::Down(walk, from) => (walk.tick_of(*from), walk.rung_of(*from)),
        };
        let mut piece =
            Self { shape, phase, written, before, runs_before, start, pulses, end: start, walked, rung };
        piece.end = piece.tick_of(pulses);
        piece
    }

    /// Leaves out its pulses after `pulses`.
    pub(super) fn cut(&mut self, pulses: u32) {
        self.pulses = self.pulses.min(pulses);
        self.end = self.tick_of(self.pulses);
    }

    /// How many runs it has. Periods of one length are a run even if there is none.
    pub(super) fn runs(&self) -> usize {
        self.run_of(self.pulses) + 1
    }

    /// The run in which pulse `pulse` of the piece lies.
    pub(super) fn run_of(&self, pulse: u32) -> usize {
        let pulse = pulse.max(1);
        match &self.shape {
            Shape::Level(_) => 0,
            Shape::Up(walk, from) => walk.rung_of(from + pulse) - self.rung,
            Shape::Down(walk, from) => self.rung - walk.rung_of(from - pulse + 1),
        }
    }

    /// The run with this index.
    pub(super) fn run(&self, index: usize) -> Run {
        let (first, last, period) = match &self.shape {
            Shape::Level(period) => (1, self.pulses, *period),
            Shape::Up(walk, from) => {
                let rung = self.rung + index;
                let Rung { before, period, .. } = walk.rung(rung);
                (before.max(*from) + 1 - from, (walk.end(rung) - from).min(self.pulses), period)
            }
            Shape::Down(walk, from) => {
                let rung = self.rung - index;
                let Rung { before, period, .. } = walk.rung(rung);
                (from - walk.end(rung).min(*from) + 1, (from - before).min(self.pulses), period)
            }
        };
        let (start, written) = match &self.shape {
            _ if index == 0 => (self.start, self.written),
            Shape::Level(_) => (self.start, None),
            // Its count is written early in the last period of the run before it.
            Shape::Up(walk, _) => {
                let start = self.start + walk.rung(self.rung + index).start - self.walked;
                (start, Some(start - u64::from(walk.rung(self.rung + index - 1).period) + REACTION.0))
            }
            Shape::Down(walk, _) => {
                let Rung { start: walked, period, .. } = walk.rung(self.rung - index + 1);
                let start = self.start + self.walked - walked;
                (start, Some(start - u64::from(period) + REACTION.0))
            }
        };
        Run {
            before: self.before + first - 1,
            pulses: last + 1 - first,
            start,
            period,
            written,
            phase: self.phase,
        }
    }

    /// The tick of pulse `pulse` of the piece; pulse 0 is where it begins.
    pub(super) fn tick_of(&self, pulse: u32) -> u64 {
        self.start
            + match &self.shape {
                Shape::Level(period) => u64::from(pulse) * u64::from(*period),
                Shape::Up(walk, from) => walk.tick_of(from + pulse) - self.walked,
                Shape::Down(walk, from) => self.walked - walk.tick_of(from - pulse),
            }
    }

    /// The period that ends with pulse `pulse` of the piece, in ticks.
    pub(super) fn period_of(&self, pulse: u32) -> u32 {
        match &self.shape {
            Shape::Level(period) => *period,
            Shape::Up(walk, from) => walk.period_of(from + pulse),
            Shape::Down(walk, from) => walk.period_of(from - pulse + 1),
        }
    }

    /// How many of its pulses come at or before `tick`, which is not before its start.
    pub(super) fn pulses_by(&self, tick: u64) -> u32 {
        let spent = tick - self.start;
        let come = match &self.shape {
            Shape::Level(period) => u32::try_from(spent / u64::from(*period)).unwrap_or(u32::MAX),
            Shape::Up(walk, from) => walk.pulse_at_most(self.walked + spent) - from,
            Shape::Down(walk, from) => from - walk.pulse_at_least(self.walked.saturating_sub(spent)),
        };
        come.min(self.pulses)
    }

    /// Its longest period, in ticks.
    pub(super) fn longest_period(&self) -> u32 {
        match &self.shape {
            Shape::Level(_) | Shape::Up(..) => self.shape.first_period(),
            Shape::Down(..) => self.period_of(self.pulses),
        }
    }
}
