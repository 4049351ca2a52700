//! One movement: a schedule, and the writes to the chip that make it true. It knows pulses and counts; it does not
//! know commands, alarms or positions.
//!
//! A count must reach the chip while the period before its own is running. The firmware writes it right after the
//! pulse that begins that period, or, by the paper's method, when the ramp's timer says so. A period that 16 bits
//! cannot count is made with the 8748's timer: GATE0 is closed at the pulse before, and opened one count before the
//! pulse that is due.
//!
//! ```text
//!   OUT0    ─┐┌──────┐┌───────────────────────────────┐┌──
//!            ┘└      ┘└                               ┘└
//!   GATE0   ─────────┐                 ┌───────────────────
//!                    └─────────────────┘← one count →
//!   writes      ▲ load               ▲ fire
//! ```

use std::num::NonZeroU32;

use supersigma_protocol::{Count, Direction, Pace, Position, Steps, Tick, Ticks};

use crate::board::{Board, Sink};
use crate::ramp::{Phase, REACTION, Schedule, Stop, Table};

/// What is left to count when the gate is opened for a pulse after a long pause.
const FIRE_AHEAD: u32 = 3_077;

/// A movement under way.
#[derive(Debug)]
pub(super) struct Movement {
    start: Tick,
    schedule: Schedule,
    /// Whether counter 2 counts, as for movements of one or two steps.
    short: bool,
    write: Option<Write>,
    phase: Option<Phase>,
    phase_changes: Option<u64>,
    /// The last pulse before the sense wire changes.
    turn: Option<u32>,
    /// Whether 16 bits count every period.
    counts_all: bool,
}

/// Where a leap ends: right after a write.
struct Landing {
    at: u64,
    /// What was written.
    period: u64,
    then: Option<Write>,
}

/// The next thing to do to the chip, and when, in ticks from the start.
#[derive(Debug, Clone, Copy)]
struct Write {
    at: u64,
    what: What,
}

/// Runs are counted from 0, pulses from 1.
#[derive(Debug, Clone, Copy)]
enum What {
    /// Write the count of this run of the plan.
    LoadRun(usize),
    /// Write the count of the period that ends with this pulse.
    LoadPulse(u32),
    /// Close the gate: this pulse is further away than 16 bits count.
    Hold(u32),
    /// Open the gate: this pulse is one count away.
    Fire(u32),
}

impl Movement {
    /// Starts `schedule` now.
    pub(super) fn begin(schedule: Schedule, board: &mut Board, sink: &mut impl Sink) -> Self {
        let total = schedule.total().0;
        board.set_direction(schedule.direction_of(1));
        board.arm_step_counters(total);
        let mut movement = Self {
            start: board.now(),
            turn: schedule.turns_after(0),
            counts_all: schedule.longest_period() <= Count::LONGEST,
            schedule,
            short: total <= 2,
            write: None,
            phase: None,
            phase_changes: None,
        };
        if let Some(count) = count(movement.schedule.tick_of(1)) {
            board.program_rate(count, sink);
            board.gate_rate(true);
            movement.write = movement.write_after(1, 0);
        } else {
            board.program_rate(Count(0), sink);
            movement.write = Some(movement.fire(1));
        }
        movement.look_at_phase(0);
        movement
    }

    /// Where to, at the moment.
    pub(super) fn direction(&self, board: &mut Board) -> Direction {
        self.schedule.direction_of(self.steps(board).0 + 1)
    }

    /// Where the axis is by now, if it began at `start`.
    pub(super) fn position(&self, start: Position, board: &mut Board) -> Position {
        self.schedule.position_after(start, self.steps(board))
    }

    /// How fast it goes; `None` once the last pulse has come.
    pub(super) fn pace(&self, board: &mut Board) -> Option<Pace> {
        let next = self.steps(board).0 + 1;
        (next <= self.schedule.total().0).then(|| Pace {
            period: Ticks(self.schedule.period(next)),
            direction: self.schedule.direction_of(next),
        })
    }

    /// What the axis does now.
    pub(super) fn phase(&self) -> Option<Phase> {
        self.phase
    }

    /// The steps made so far, as the chip counts them.
    pub(super) fn steps(&self, board: &mut Board) -> Steps {
        if !self.short {
            return Steps(board.read_long_counter());
        }
        match self.schedule.total() {
            _ if board.first_of_two() => Steps(1),
            Steps(2) if self.is_over(board) => Steps(2),
            _ => Steps(0),
        }
    }

    /// When the firmware has something to do.
    pub(super) fn wake_at(&self) -> Tick {
        let turn = self.turn.map(|last| self.schedule.tick_of(last));
        let soonest = [self.write.map(|write| write.at), self.phase_changes, turn]
            .into_iter()
            .flatten()
            .fold(self.schedule.end(), u64::min);
        self.start + Ticks(soonest)
    }

    /// Does what is due; says whether the movement is over.
    pub(super) fn wake(&mut self, board: &mut Board, sink: &mut impl Sink) -> bool {
        if self.is_over(board) {
            board.gate_rate(false);
            return true;
        }
        let now = self.elapsed(board);
        while let Some(write) = self.write.filter(|write| write.at <= now) {
            self.write = self.carry_out(write.what, now, board, sink);
        }
        if self.phase_changes.is_some_and(|at| at <= now) {
            self.look_at_phase(now);
        }
        if let Some(last) = self.turn.take_if(|last| self.schedule.tick_of(*last) <= now) {
            board.set_direction(self.schedule.direction_of(last + 1));
            self.turn = self.schedule.turns_after(last);
        }
        false
    }

    /// The next tick at which more happens than a write to the chip: the phase changes, the sense wire changes, a detector
    /// changes, the movement ends.
    pub(super) fn next_news(&self, board: &Board) -> Tick {
        let turn = self.turn.map(|last| self.schedule.tick_of(last));
        let all = self.schedule.total().0;
        let change = board.steps_to_change().filter(|steps| *steps <= all).and_then(|steps| {
            let pulse = self.schedule.pulses_by(self.elapsed(board)).checked_add(steps)?;
            (pulse <= all).then(|| self.schedule.tick_of(pulse))
        });
        let soonest =
            [self.phase_changes, turn, change].into_iter().flatten().fold(self.schedule.end(), u64::min);
        self.start + Ticks(soonest)
    }

    /// Whether it has something to write before `before`.
    pub(super) fn writes_before(&self, before: Tick) -> bool {
        self.write.is_some_and(|write| self.start + Ticks(write.at) < before)
    }

    /// Makes all writes before `before` at once, as if each had been made in its time. Nothing else may happen before
    /// that: see [`Movement::next_news`].
    pub(super) fn leap(&mut self, before: Tick, board: &mut Board) {
        let limit = before.since(self.start).0;
        let Some(Write { at, what }) = self.write.filter(|write| write.at < limit) else { return };
        let landing = match what {
            What::LoadRun(index) => self.landing_on_run(index, limit),
            What::LoadPulse(pulse) => self.landing_on_pulse(pulse, limit),
            What::Hold(_) | What::Fire(_) => None,
        };
        let Some(landing) = landing.filter(|landing| landing.at > at) else { return };
        let made = self.schedule.pulses_by(landing.at);
        let since = landing.at - self.schedule.tick_of(made);
        let left = self.schedule.period(made + 1) + 1 - since;
        let steps = made - self.steps(board).0;
        let left = u32::try_from(left).ok().and_then(NonZeroU32::new).filter(|_| since > 0);
        if let (Some(left), Some(count)) = (left, count(landing.period)) {
            board.leap(self.start + Ticks(landing.at), steps, left, count);
            self.write = landing.then;
        }
    }

    /// The last count of the plan that is written before `limit`.
    fn landing_on_run(&self, index: usize, limit: u64) -> Option<Landing> {
        let plan = self.schedule.own_plan()?;
        // What is written before `limit` is at most for the period after the running one, which ends two pulses later.
        let furthest = plan.run_of(plan.pulses_by(limit) + 2);
        let last = (index + 1..=furthest).rev().find_map(|last| {
            let run = plan.run(last)?;
            Some((last, run.period, run.written.filter(|written| *written < limit)?))
        });
        let (last, period, at) = last?;
        Some(Landing { at, period: period.into(), then: self.write_run_after(last, at) })
    }

    /// The same for a share: the last pulse whose period's count is written before `limit`.
    fn landing_on_pulse(&self, pulse: u32, limit: u64) -> Option<Landing> {
        if !self.counts_all {
            return None;
        }
        let begun = self.schedule.pulses_by(limit.checked_sub(REACTION.0 + 1)?);
        let last = (begun + 2).min(self.schedule.total().0);
        let at = self.schedule.tick_of(last.checked_sub(2)?) + REACTION.0;
        (last > pulse).then(|| Landing {
            at,
            period: self.schedule.period(last),
            then: self.write_after(last, at),
        })
    }

    /// Ends the movement as soon as `stop` allows.
    pub(super) fn stop(&mut self, table: &Table, stop: Stop, board: &mut Board, sink: &mut impl Sink) {
        let now = self.elapsed(board);
        let next = self.steps(board).0 + 1;
        let due = self.schedule.tick_of(next);
        self.schedule.stop(table, now, stop);
        self.counts_all = self.schedule.longest_period() <= Count::LONGEST;
        self.look_at_phase(now);
        self.turn = self.schedule.turns_after(next - 1);
        if next > self.schedule.total().0 {
            self.write = None;
        } else if self.schedule.tick_of(next) == due {
            // The running period stays. Whatever is planned for it stays too; what comes after it is new.
            if !matches!(self.write, Some(Write { what: What::Hold(pulse) | What::Fire(pulse), .. }) if pulse == next)
            {
                self.write = self.write_after(next, self.safely_after(now, next));
            }
        } else {
            // Only a follower's running period can change: it is longer than the leader's.
            board.gate_rate(false);
            let due = self.schedule.tick_of(next);
            if let Some(count) = count(due - now) {
                board.load_rate(count, sink);
                board.gate_rate(true);
                self.write = self.write_after(next, self.safely_after(now, next));
            } else {
                self.write = Some(self.fire(next));
            }
        }
    }

    /// Ends the movement with the pulse that has just come. Only at start speed.
    pub(super) fn cut(&mut self, board: &mut Board) {
        let done = self.steps(board);
        self.schedule.cut(done.0);
        self.write = None;
    }

    fn elapsed(&self, board: &Board) -> u64 {
        board.now().since(self.start).0
    }

    fn is_over(&self, board: &Board) -> bool {
        self.elapsed(board) >= self.schedule.end()
    }

    fn look_at_phase(&mut self, now: u64) {
        (self.phase, self.phase_changes) = self.schedule.phase_at(now);
    }

    fn carry_out(&mut self, what: What, now: u64, board: &mut Board, sink: &mut impl Sink) -> Option<Write> {
        match what {
            What::LoadRun(index) => {
                let run = self.schedule.own_plan()?.run(index)?;
                board.load_rate(count(run.period.into())?, sink);
                self.write_run_after(index, now)
            }
            What::LoadPulse(pulse) => {
                board.load_rate(count(self.schedule.period(pulse))?, sink);
                self.write_after(pulse, now)
            }
            What::Hold(pulse) => {
                board.gate_rate(false);
                Some(self.fire(pulse))
            }
            What::Fire(pulse) => {
                board.load_rate(Count::dividing_by(FIRE_AHEAD)?, sink);
                board.gate_rate(true);
                self.write_after(pulse, self.safely_after(now, pulse))
            }
        }
    }

    /// When the next count can be written while the period of `pulse` runs. The chip takes over a count on the first
    /// clock of a period, so one written at the tick at which a period begins would rule that very period.
    fn safely_after(&self, now: u64, pulse: u32) -> u64 {
        (now + REACTION.0).min(self.schedule.tick_of(pulse))
    }

    /// The next write when the chip has what it needs for pulse `pulse`; not before `earliest`.
    fn write_after(&self, pulse: u32, earliest: u64) -> Option<Write> {
        if let Some(plan) = self.schedule.own_plan() {
            return self.write_run_after(plan.run_of(pulse), earliest);
        }
        let next = pulse + 1;
        if next > self.schedule.total().0 {
            return None;
        }
        Some(if count(self.schedule.period(next)).is_none() {
            Write { at: self.schedule.tick_of(pulse), what: What::Hold(next) }
        } else {
            let begun = self.schedule.tick_of(pulse - 1);
            Write { at: (begun + REACTION.0).max(earliest), what: What::LoadPulse(next) }
        })
    }

    fn write_run_after(&self, index: usize, earliest: u64) -> Option<Write> {
        let plan = self.schedule.own_plan()?;
        let mut later = (index + 1..).map_while(|next| Some((next, plan.run(next)?)));
        let (next, written) = later.find_map(|(next, run)| Some((next, run.written?)))?;
        Some(Write { at: written.max(earliest), what: What::LoadRun(next) })
    }

    fn fire(&self, pulse: u32) -> Write {
        let at = self.schedule.tick_of(pulse) - u64::from(FIRE_AHEAD);
        Write { at, what: What::Fire(pulse) }
    }
}

/// The count that makes a period of `ticks`, if 16 bits can.
fn count(ticks: u64) -> Option<Count> {
    u32::try_from(ticks).ok().and_then(Count::dividing_by)
}
