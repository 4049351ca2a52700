//! When each pulse of one axis is due: by a plan that it follows pulse by pulse, or by its share of the plan of a line's
//! leading axis.
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
//! so its position never differs from the ideal line by a whole step, and the last pulses fall together. A path is
//! a line after another, with a share for each; the plan runs on over the joints. A stop changes the leader's plan, on
//! every card at the same tick in the same way, so the axes stay on the line.

use supersigma_protocol::{Direction, Distance, Position, Steps};

use super::plan::{Phase, Plan, Stop};
use super::table::Table;

/// What an axis makes of one leg.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// The leading axis' steps.
    pub lead: Distance,
    /// The axis' own, and where to; `None` if it stands.
    pub own: Option<(Direction, Distance)>,
}

/// The due ticks of an axis' pulses, numbered from 1, in ticks from the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schedule {
    plan: Plan,
    legs: Vec<Leg>,
    /// Whether each pulse of the plan is one of this axis.
    is_plan: bool,
    /// All pulses of this axis.
    total: u32,
    /// The tick of the last one.
    end: u64,
}

/// F and S of the picture for one leg, and what lies before it. Legs in which the axis stands are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Leg {
    direction: Direction,
    own: u64,
    lead: u64,
    own_before: u64,
    lead_before: u64,
}

impl Schedule {
    /// All pulses of `plan`, in one direction.
    #[must_use]
    pub fn alone(plan: Plan, direction: Direction) -> Self {
        let all = u64::from(plan.total().0);
        let leg = Leg { direction, own: all, lead: all, own_before: 0, lead_before: 0 };
        Self::new(plan, vec![leg], true)
    }

    /// These shares of `plan`, one after the other.
    #[must_use]
    pub fn shared(plan: Plan, shares: &[Share]) -> Self {
        let (mut own_before, mut lead_before) = (0, 0);
        let mut legs = Vec::with_capacity(shares.len());
        for share in shares {
            let lead = u64::from(share.lead.get());
            if let Some((direction, own)) = share.own {
                let own = u64::from(own.get());
                legs.push(Leg { direction, own, lead, own_before, lead_before });
                own_before += own;
            }
            lead_before += lead;
        }
        // No share is more than its leg, so they are alike if their sums are.
        Self::new(plan, legs, own_before == lead_before)
    }

    fn new(plan: Plan, legs: Vec<Leg>, is_plan: bool) -> Self {
        let mut schedule = Self { plan, legs, is_plan, total: 0, end: 0 };
        schedule.sum_up();
        schedule
    }

    /// To be done whenever the plan has changed.
    #[expect(clippy::cast_possible_truncation, reason = "own ≤ lead, so it is at most the plan's total")]
    fn sum_up(&mut self) {
        let made = u64::from(self.plan.total().0);
        let last = self.legs.iter().rfind(|leg| leg.lead_before < made);
        self.total = last.map_or(0, |leg| {
            (leg.own_before + (made - leg.lead_before).min(leg.lead) * leg.own / leg.lead) as u32
        });
        self.end = self.tick_of(self.total);
    }

    /// The plan, if it is followed pulse by pulse and not as a share.
    #[must_use]
    pub fn own_plan(&self) -> Option<&Plan> {
        self.is_plan.then_some(&self.plan)
    }

    /// All pulses of this axis.
    #[must_use]
    pub fn total(&self) -> Steps {
        Steps(self.total)
    }

    /// The tick of the axis' last pulse.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.end
    }

    /// From the start to the end, in ticks: that of the leading axis.
    #[must_use]
    pub fn duration(&self) -> u64 {
        self.plan.duration()
    }

    /// The tick of pulse `pulse`; pulse 0 is the start.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "the quotient is at most the plan's total")]
    pub fn tick_of(&self, pulse: u32) -> u64 {
        if self.is_plan {
            return self.plan.tick_of(pulse);
        }
        let Some(leg) = self.leg_of(pulse) else {
            return 0;
        };
        let scaled = (u64::from(pulse) - leg.own_before) * leg.lead;
        let (whole, part) = ((leg.lead_before + scaled / leg.own) as u32, scaled % leg.own);
        let before = self.plan.tick_of(whole);
        if part == 0 {
            return before;
        }
        before + u64::from(self.plan.period(whole + 1)) * part / leg.own
    }

    /// The period that ends with pulse `pulse`, from 1, in ticks.
    #[must_use]
    pub fn period(&self, pulse: u32) -> u64 {
        if self.is_plan {
            return self.plan.period(pulse).into();
        }
        self.tick_of(pulse) - self.tick_of(pulse - 1)
    }

    /// How many pulses come at or before `tick`.
    #[must_use]
    pub fn pulses_by(&self, tick: u64) -> u32 {
        if self.is_plan {
            return self.plan.pulses_by(tick);
        }
        let (mut come, mut later) = (0, self.total + 1);
        while come + 1 < later {
            let middle = u32::midpoint(come, later);
            if self.tick_of(middle) <= tick { come = middle } else { later = middle }
        }
        come
    }

    /// No period is longer, in ticks; those of a share may all be shorter than that.
    #[must_use]
    pub fn longest_period(&self) -> u64 {
        let longest = u64::from(self.plan.longest_period());
        let stretch = self.legs.iter().map(|leg| leg.lead.div_ceil(leg.own)).max().unwrap_or(1);
        // Across a joint, a period has a part in each leg, and the legs in which the axis stands lie between.
        if self.legs.len() > 1 { u64::MAX } else { longest * (stretch + 1) }
    }

    /// The direction of pulse `pulse`, from 1.
    #[must_use]
    pub fn direction_of(&self, pulse: u32) -> Direction {
        self.leg_of(pulse).map_or(Direction::Forward, |leg| leg.direction)
    }

    /// The last pulse before the direction changes, if it does later than pulse `pulse`.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "bounded by the axis' total")]
    pub fn turns_after(&self, pulse: u32) -> Option<u32> {
        let pairs = self.legs.windows(2).filter(|pair| pair[0].direction != pair[1].direction);
        let mut turns = pairs.map(|pair| pair[1].own_before as u32);
        turns.find(|last| *last > pulse && *last < self.total)
    }

    /// Where the axis is after `steps` pulses from `start`.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "at most the steps that were made")]
    pub fn position_after(&self, start: Position, steps: Steps) -> Position {
        self.legs.iter().fold(start, |position, leg| {
            let made = u64::from(steps.0).saturating_sub(leg.own_before).min(leg.own);
            position.moved(leg.direction, Steps(made as u32))
        })
    }

    /// What the axis does at `tick`, and the tick at which this changes next.
    #[must_use]
    pub fn phase_at(&self, tick: u64) -> (Option<Phase>, Option<u64>) {
        self.plan.phase_at(tick)
    }

    /// Ends the movement, or the line's movement, as soon as `stop` allows from `tick` on.
    pub fn stop(&mut self, table: &Table, tick: u64, stop: Stop) {
        self.plan.stop(table, tick, stop);
        self.sum_up();
    }

    /// Leaves out the pulses after `pulses`. Only for plans at start speed that are followed pulse by pulse.
    pub fn cut(&mut self, pulses: u32) {
        self.plan.cut(pulses);
        self.sum_up();
    }

    fn leg_of(&self, pulse: u32) -> Option<&Leg> {
        let begun = self.legs.partition_point(|leg| leg.own_before < u64::from(pulse));
        self.legs.get(begun.checked_sub(1)?)
    }
}
