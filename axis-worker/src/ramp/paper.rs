//! The method of \[C\] for ramped movements: the timer writes the next entry of the table every 1.29 ms, whatever the
//! pulses do, and the step counter decides when to go down again.
//!
//! ```text
//!   speed          na        nd          ns
//!     │            ╭──────────╮           │    nd = ns − na − offset: down the ramp from there,
//!     │          ╱ ·          ·╲          │    then low speed until the step counter reaches ns
//!     │       ╱    ·          ·   ╲       │
//!     │  ──╯       ·          ·      ╰────│
//!     └────────────┴──────────┴───────────┴── steps
//! ```
//!
//! A ramp is never changed before it ends, so a movement of ns ≥ 2·na + offset is long. A shorter one starts with a
//! larger N and subtracts the same differences: every ramp lasts as long, but has fewer steps (\[C\] Fig 10 and 11).
//! (So it is with every profile; only a table with fewer than 233 entries has shorter ramps, which end at its last one.)
//! Where the paper reads that N off a hyperbola fitted to Fig 11, we search for the smallest one that fits. Below 200
//! steps the movement has one constant speed. What this costs is the paper's own open problem; see [`Plan::fastest`].

use supersigma_protocol::{Distance, SpeedIndex};

use super::plan::{Phase, Plan};
use super::table::Table;
use super::walk::{due, periods_begun};

/// Shorter movements are not accelerated.
const VERY_SHORT: u32 = 200;

/// The plan of `distance` pulses under the ceiling `limit`.
pub(super) fn plan(table: &Table, distance: Distance, limit: SpeedIndex) -> Plan {
    let total = distance.steps().0;
    if total < VERY_SHORT || limit == SpeedIndex::START {
        return Plan::constant(table, distance, SpeedIndex::START);
    }
    let Some(ramp) = Ramp::longest_within(table, limit.min(table.last()), total) else {
        return Plan::constant(table, distance, SpeedIndex::START);
    };
    let mut plan = Plan::default();
    ramp.climb(&mut plan);
    let descent_from = total - ramp.reserve();
    let cruise = descent_from - plan.total().0;
    plan.push(cruise, ramp.period(ramp.top), Phase::Cruising, None);
    ramp.descend(&mut plan, total);
    plan
}

/// One of the family of \[C\] Fig 10: the table from entry 0 to `top`, each N raised by `raised`.
#[derive(Clone, Copy)]
struct Ramp<'a> {
    table: &'a Table,
    top: usize,
    raised: u32,
}

impl<'a> Ramp<'a> {
    /// The ramp with the smallest initial N of which the way up and down fit into `total` pulses.
    fn longest_within(table: &'a Table, limit: SpeedIndex, total: u32) -> Option<Self> {
        let top = usize::from(limit.get());
        let fits = |raised| {
            let ramp = Self { table, top, raised };
            ramp.pulses() + ramp.reserve() <= total
        };
        let (mut low, mut high) = (0, 65_535 - u32::from(table.counts()[0]) - 1);
        if !fits(high) {
            return None;
        }
        while low < high {
            let middle = low.midpoint(high);
            if fits(middle) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        Some(Self { table, top, raised: low })
    }

    fn period(&self, entry: usize) -> u32 {
        u32::from(self.table.counts()[entry]) + self.raised + 1
    }

    /// When the timer writes the count of `entry`, from the start of a climb.
    fn due(&self, entry: usize) -> u64 {
        due(entry, self.table.interval().0)
    }

    /// When a climb has ended and the steps are read.
    fn end(&self) -> u64 {
        self.top as u64 * self.table.interval().0
    }

    /// na: the steps of a climb, with the one that is running when it ends.
    fn pulses(&self) -> u32 {
        let mut climb = Plan::default();
        self.climb(&mut climb);
        climb.total().0
    }

    /// What is left of a movement when it goes down: na + offset, as in the paper. A ramp so steep that its first period takes
    /// up many entries has more steps down than up; then those, and one at low speed.
    fn reserve(&self) -> u32 {
        let mut down = Plan::default();
        self.slow_down(&mut down);
        (self.pulses() + self.table.offset().0).max(down.total().0 + 1)
    }

    /// From entry 0 to the end of the interval that belongs to `top`.
    fn climb(&self, plan: &mut Plan) {
        for entry in 0..self.top {
            self.push(plan, entry, Phase::Accelerating, self.due(entry), self.due(entry + 1));
        }
        self.push(plan, self.top, Phase::Accelerating, self.due(self.top), self.end());
    }

    /// Entries below `top` down to 0, then low speed up to `total` pulses.
    fn descend(&self, plan: &mut Plan, total: u32) {
        let written = self.slow_down(plan);
        plan.push(total - plan.total().0, self.period(0), Phase::Creeping, Some(written));
    }

    /// Entries below `top` down to 1; says when that of 0 is written.
    fn slow_down(&self, plan: &mut Plan) -> u64 {
        let mut written = plan.duration();
        for entry in (1..self.top).rev() {
            let next = written + self.table.interval().0;
            self.push(plan, entry, Phase::Decelerating, written, next);
            written = next;
        }
        written
    }

    /// The run of `entry`, whose count is written at `written` and replaced at `due`.
    fn push(&self, plan: &mut Plan, entry: usize, phase: Phase, written: u64, due: u64) {
        let period = self.period(entry);
        plan.push(periods_begun(plan.duration(), due, period), period, phase, Some(written));
    }
}
