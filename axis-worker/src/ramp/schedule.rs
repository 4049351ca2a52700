//! When each pulse of one axis is due: by a plan of its own, or by its share of the plan of a line's leading axis.
//!
//! On a line, every axis knows the leading axis' plan (same table, same steps), and follows it: with F steps of its
//! own against the leader's S, its pulse k belongs where the leader has made k·S/F steps,
//!
//! ```text
//!   leader   |  .  |  .  |  .  |  .  |  .  |        S = 6 periods of unequal length
//!   follower |      '      .      '        |        F = 2: pulse 1 at x = 3, pulse 2 at x = 6
//!                          ▲ x = k·S/F: tick T(⌊x⌋) + the same fraction of the leader's next period
//! ```
//!
//! so its position never differs from the ideal line by a whole step, and the last pulses fall together. A stop
//! changes the leader's plan, on every card at the same tick in the same way, so the axes stay on the line.

use supersigma_protocol::{Distance, Steps};

use super::plan::{Phase, Plan, Stop};
use super::table::Table;

/// The due ticks of an axis' pulses, numbered from 1, in ticks from the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schedule {
    plan: Plan,
    share: Option<Share>,
}

/// F and S of the picture, as they were commanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Share {
    own: u64,
    lead: u64,
}

impl From<Plan> for Schedule {
    fn from(plan: Plan) -> Self {
        Self { plan, share: None }
    }
}

impl Schedule {
    /// `own` steps along a line whose leading axis makes `lead` steps by `plan`.
    #[must_use]
    pub fn on_line(plan: Plan, own: Distance, lead: Distance) -> Self {
        let share = Share { own: own.get().into(), lead: lead.get().into() };
        Self { plan, share: (own != lead).then_some(share) }
    }

    /// The plan, if it is followed pulse by pulse and not as a share.
    #[must_use]
    pub fn own_plan(&self) -> Option<&Plan> {
        self.share.is_none().then_some(&self.plan)
    }

    /// All pulses of this axis.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "own ≤ lead, so the quotient is at most the plan's total"
    )]
    pub fn total(&self) -> Steps {
        let total = self.plan.total();
        self.share.map_or(total, |share| Steps((u64::from(total.0) * share.own / share.lead) as u32))
    }

    /// From the start to the end, in ticks: that of the leading axis, if there is one.
    #[must_use]
    pub fn duration(&self) -> u64 {
        self.plan.duration()
    }

    /// The tick of pulse `pulse`; pulse 0 is the start.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "the quotient is at most the plan's total")]
    pub fn tick_of(&self, pulse: u32) -> u64 {
        let Some(share) = self.share else {
            return self.plan.tick_of(pulse);
        };
        let scaled = u64::from(pulse) * share.lead;
        let (whole, part) = ((scaled / share.own) as u32, scaled % share.own);
        let before = self.plan.tick_of(whole);
        if part == 0 {
            return before;
        }
        before + u64::from(self.plan.period(whole + 1)) * part / share.own
    }

    /// What the axis does in the period after `done` pulses, and the tick at which this changes next.
    #[must_use]
    pub fn phase_at(&self, tick: u64) -> (Option<Phase>, Option<u64>) {
        let running = self.plan.pulses_by(tick) + 1;
        let runs = self.plan.runs();
        let index = self.plan.run_of(running);
        let Some(run) = runs.get(index) else {
            return (runs.last().map(|run| run.phase), None);
        };
        let next = runs[index..].iter().find(|later| later.phase != run.phase && later.pulses > 0);
        (Some(run.phase), next.map(|later| later.start))
    }

    /// Ends the movement, or the line's movement, as soon as `stop` allows from `tick` on.
    pub fn stop(&mut self, table: &Table, tick: u64, stop: Stop) {
        self.plan.stop(table, tick, stop);
    }

    /// Leaves out the pulses after `pulses`. Only for plans at start speed that are followed pulse by pulse.
    pub fn cut(&mut self, pulses: u32) {
        self.plan.cut(pulses);
    }
}
