//! One movement as runs of equal periods, and how it ends sooner. Planned at the start of the movement, changed only
//! by a stop. Nothing here knows the chip or what time it is. A run is worked out when it is asked for: to plan a movement,
//! and to find a pulse or a tick in it, costs the same for every length.

use std::sync::Arc;

use supersigma_config::ShortMoves;
use supersigma_protocol::{Activity, Distance, SpeedIndex, Steps};

use super::piece::{Piece, Shape};
use super::table::Table;
use super::walk::Walk;
use super::{REACTION, paper};

/// How a movement is ended before its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stop {
    /// Down the normal ramp.
    Halt,
    /// Down the steep ramp.
    Brake,
}

/// The parts of a movement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Up the ramp.
    Accelerating,
    /// At the top, at a ceiling, or at constant speed.
    Cruising,
    /// Down the ramp.
    Decelerating,
    /// At low speed, until the steps are done.
    Creeping,
    /// Down the steep ramp.
    Braking,
}

impl From<Phase> for Activity {
    fn from(phase: Phase) -> Self {
        match phase {
            Phase::Accelerating => Self::Accelerating,
            Phase::Cruising => Self::Cruising,
            Phase::Decelerating => Self::Decelerating,
            Phase::Creeping => Self::Creeping,
            Phase::Braking => Self::Braking,
        }
    }
}

/// One leg of a path, as its leading axis makes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Leg {
    /// How far.
    pub distance: Distance,
    /// The ceiling.
    pub limit: SpeedIndex,
    /// The ceiling at the joint to the next leg; [`SpeedIndex::START`] is as good as a stop.
    pub joint: SpeedIndex,
}

/// Successive periods of one length. Ticks count from the start of the movement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Pulses of the movement before this run.
    pub before: u32,
    /// Pulses of this run, one at the end of each period. None if a later count overtakes this one.
    pub pulses: u32,
    /// Where the first period begins.
    pub start: u64,
    /// Ticks of one period: the count for the chip.
    pub period: u32,
    /// When the firmware writes the count; `None` if the chip has it already.
    pub written: Option<u64>,
    /// What the axis does meanwhile.
    pub phase: Phase,
}

/// A movement: exactly [`Plan::total`] pulses, numbered from 1.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Plan {
    pieces: Vec<Piece>,
}

impl Plan {
    /// The movement of `distance` under the ceiling `limit`, by the table's method.
    #[must_use]
    pub fn ramped(table: &Table, distance: Distance, limit: SpeedIndex) -> Self {
        match table.method() {
            ShortMoves::Optimal => Self::fastest(table, distance, limit),
            ShortMoves::Paper => paper::plan(table, distance, limit),
        }
    }

    /// The fastest plan of exactly `distance` pulses that stays on the curve and under `limit`: up the walk, and back
    /// down it from half-way or from the ceiling. The two halves mirror each other; an odd pulse, or whatever the
    /// ceiling leaves, lies between them.
    #[must_use]
    pub fn fastest(table: &Table, distance: Distance, limit: SpeedIndex) -> Self {
        Self::path(table, &[Leg { distance, limit, joint: SpeedIndex::START }])
    }

    /// The fastest plan over several legs that passes each joint no faster than it may be passed.
    ///
    /// ```text
    ///   speed                           K: how far up the walk a ceiling, or a joint, allows
    ///     │    ╭─────╮                  k: how far up the walk the joint is passed: at most K, and
    ///     │  ╱        ╲     ╭─╮             no further from the next k than the leg has pulses
    ///     │╱            ╲ ╱     ╲
    ///     └──────────────┴────────╲──   Within a leg: up from k to a peak, down to the next k; what is left
    ///     k = 0          k        k = 0 over lies between them at the peak's speed
    /// ```
    ///
    /// The joint after the last leg is where the movement ends, and has no speed.
    #[must_use]
    pub fn path(table: &Table, legs: &[Leg]) -> Self {
        let walk = table.normal();
        let up_to = |index: SpeedIndex| walk.slower_than(table.period(index));
        let length = |leg: &Leg| leg.distance.steps().0;
        // passed[i] is k before leg i; none before the first, none after the last.
        let mut passed = vec![0; legs.len() + 1];
        for (i, pair) in legs.windows(2).enumerate() {
            let [leg, next] = pair else { continue };
            // The periods on both sides of a joint that is passed at k are those of the walk's pulse k + 1.
            let joint = walk.not_faster_than(table.period(leg.joint)).saturating_sub(1);
            let allowed = joint.min(up_to(leg.limit)).min(up_to(next.limit));
            passed[i + 1] = allowed.min(passed[i] + length(leg));
        }
        for (i, leg) in legs.iter().enumerate().rev() {
            passed[i] = passed[i].min(passed[i + 1] + length(leg));
        }
        let mut plan = Self::default();
        for (i, leg) in legs.iter().enumerate() {
            let (from, to) = (passed[i], passed[i + 1]);
            let ceiling = up_to(leg.limit);
            let peak = ceiling.min((length(leg) + from + to) / 2);
            let mut period = if peak < ceiling { walk.period_of(peak + 1) } else { table.period(leg.limit) };
            // Where the top borders on a joint, it is no faster than that.
            if peak == from && i > 0 {
                period = period.max(table.period(legs[i - 1].joint));
            }
            if peak == to && i + 1 < legs.len() {
                period = period.max(table.period(leg.joint));
            }
            plan.ascend(walk, from, peak);
            plan.follow(length(leg) + from + to - 2 * peak, period, Phase::Cruising);
            plan.descend(walk, peak, to, Phase::Decelerating);
        }
        plan
    }

    /// `distance` pulses at one speed, without a ramp.
    #[must_use]
    pub fn constant(table: &Table, distance: Distance, speed: SpeedIndex) -> Self {
        let mut plan = Self::default();
        plan.follow(distance.steps().0, table.period(speed), Phase::Cruising);
        plan
    }

    /// All pulses.
    #[must_use]
    pub fn total(&self) -> Steps {
        Steps(self.pieces.last().map_or(0, |last| last.before + last.pulses))
    }

    /// From the start to the last pulse, in ticks.
    #[must_use]
    pub fn duration(&self) -> u64 {
        self.pieces.last().map_or(0, |last| last.end)
    }

    /// The runs, in order.
    pub fn runs(&self) -> impl Iterator<Item = Run> {
        self.pieces.iter().flat_map(|piece| (0..piece.runs()).map(|index| piece.run(index)))
    }

    /// The run with this index, from 0.
    #[must_use]
    pub fn run(&self, index: usize) -> Option<Run> {
        let begun = self.pieces.partition_point(|piece| piece.runs_before <= index);
        let piece = self.pieces.get(begun.checked_sub(1)?)?;
        let within = index - piece.runs_before;
        (within < piece.runs()).then(|| piece.run(within))
    }

    /// The index of the run in which pulse `pulse`, from 1, lies; that after the last one for all beyond it.
    #[must_use]
    pub fn run_of(&self, pulse: u32) -> usize {
        match self.piece_of(pulse) {
            Some(piece) => piece.runs_before + piece.run_of(pulse - piece.before),
            None => self.pieces.last().map_or(0, |last| last.runs_before + last.runs()),
        }
    }

    /// The tick of pulse `pulse`; pulse 0 is the start. The last one's for all beyond it.
    #[must_use]
    pub fn tick_of(&self, pulse: u32) -> u64 {
        if pulse == 0 {
            return 0;
        }
        self.piece_of(pulse).map_or_else(|| self.duration(), |piece| piece.tick_of(pulse - piece.before))
    }

    /// The period that ends with pulse `pulse`, from 1, in ticks; 0 beyond the last.
    #[must_use]
    pub fn period(&self, pulse: u32) -> u32 {
        self.piece_of(pulse).map_or(0, |piece| piece.period_of(pulse - piece.before))
    }

    /// No period is longer, in ticks.
    #[must_use]
    pub fn longest_period(&self) -> u32 {
        self.pieces.iter().map(Piece::longest_period).max().unwrap_or(0)
    }

    /// The periods of all pulses, in ticks.
    pub fn periods(&self) -> impl Iterator<Item = u32> {
        self.runs().flat_map(|run| (0..run.pulses).map(move |_| run.period))
    }

    /// How many pulses come at or before `tick`.
    #[must_use]
    pub fn pulses_by(&self, tick: u64) -> u32 {
        let begun = self.pieces.partition_point(|piece| piece.start <= tick);
        let Some(piece) = begun.checked_sub(1).map(|last| &self.pieces[last]) else {
            return 0;
        };
        piece.before + piece.pulses_by(tick)
    }

    /// What the axis does at `tick`, and the tick at which this changes next.
    #[must_use]
    pub fn phase_at(&self, tick: u64) -> (Option<Phase>, Option<u64>) {
        let index = self.index_of(self.pulses_by(tick) + 1);
        let Some(piece) = self.pieces.get(index) else {
            return (self.pieces.last().map(|last| last.phase), None);
        };
        let next = self.pieces[index..].iter().find(|later| later.phase != piece.phase && later.pulses > 0);
        (Some(piece.phase), next.map(|later| later.start))
    }

    /// Ends the movement as soon as `stop` allows, if it is told so at `tick`. The period that is running comes to its
    /// end as it was planned, because the chip has it already; each later one is a slower one of the walk. A plan
    /// whose own end comes with fewer pulses stays as it is.
    pub fn stop(&mut self, table: &Table, tick: u64, stop: Stop) {
        let running = self.pulses_by(tick) + 1;
        let index = self.index_of(running);
        let Some(piece) = self.pieces.get(index) else {
            return;
        };
        // A stop that is under way goes on as it is: each new one would leave out a part of the descent.
        let stopping =
            |piece: &Piece| matches!(piece.phase, Phase::Decelerating | Phase::Creeping | Phase::Braking);
        if piece.phase == Phase::Braking || stop == Stop::Halt && self.pieces[index..].iter().all(stopping) {
            return;
        }
        let (walk, phase) = match stop {
            Stop::Halt => (table.normal(), Phase::Decelerating),
            Stop::Brake => (table.steep(), Phase::Braking),
        };
        let descent = walk.slower_than(self.period(running));
        if running + descent >= self.total().0 {
            return;
        }
        self.cut(running);
        // A count written at the very tick of a pulse would rule the period that begins there: so, a little later,
        // but not after the running period.
        let earliest = (tick + REACTION.0).min(self.duration());
        let first = self.pieces.len();
        self.descend(walk, descent, 0, phase);
        if let Some(next) = self.pieces.get_mut(first) {
            next.written = next.written.max(Some(earliest));
        }
    }

    /// Leaves out the pulses after `pulses`.
    pub fn cut(&mut self, pulses: u32) {
        self.pieces.truncate(self.index_of(pulses) + 1);
        if let Some(last) = self.pieces.last_mut() {
            last.cut(pulses - last.before);
        }
    }

    /// Adds `pulses` periods.
    pub(super) fn follow(&mut self, pulses: u32, period: u32, phase: Phase) {
        self.join(Shape::Level(period), pulses, phase);
    }

    /// Adds a run whose count is written at `written`.
    pub(super) fn push(&mut self, pulses: u32, period: u32, phase: Phase, written: Option<u64>) {
        let piece = Piece::after(self.pieces.last(), Shape::Level(period), pulses, phase, written);
        self.pieces.push(piece);
    }

    /// Adds the periods of `walk` after its pulse `from`, up to pulse `to`.
    fn ascend(&mut self, walk: &Arc<Walk>, from: u32, to: u32) {
        self.join(Shape::Up(Arc::clone(walk), from), to - from, Phase::Accelerating);
    }

    /// Adds the periods of `walk` from its pulse `from` back to the one after pulse `to`.
    fn descend(&mut self, walk: &Arc<Walk>, from: u32, to: u32, phase: Phase) {
        self.join(Shape::Down(Arc::clone(walk), from), from - to, phase);
    }

    /// Adds `pulses` periods of `shape`, if there are any, whose first count the firmware writes early in the last period
    /// before them.
    fn join(&mut self, shape: Shape, pulses: u32, phase: Phase) {
        if pulses == 0 {
            return;
        }
        let last = self.pieces.last();
        let written = last.map_or(Some(0), |last| {
            let period = last.period_of(last.pulses);
            (period != shape.first_period()).then(|| last.end - u64::from(period) + REACTION.0)
        });
        self.pieces.push(Piece::after(last, shape, pulses, phase, written));
    }

    fn piece_of(&self, pulse: u32) -> Option<&Piece> {
        self.pieces.get(self.index_of(pulse))
    }

    /// The index of the piece in which pulse `pulse`, from 1, lies.
    fn index_of(&self, pulse: u32) -> usize {
        self.pieces.partition_point(|piece| piece.before + piece.pulses < pulse)
    }
}
