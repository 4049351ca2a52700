//! Lines and paths: every axis is told the leading axis' steps and its own, leg by leg, then all are told one start tick.
//! How fast a joint may be passed is decided here, once, so that all cards plan alike.

use std::collections::BTreeMap;
use std::time::Duration;

use axis_worker::ramp::{Leg as PlanLeg, Plan, Table};
use supersigma_protocol::{
    Address, AxisNumber, Broadcast, Command, Direction, Distance, Operation, SpeedIndex, Tick, Ticks,
};

use super::failure::Failure;
use super::link::Link;
use super::request::{Displacement, Leg, MovementKind};
use super::{Executive, Underway, refused};

/// A leg as it is commanded.
struct Planned {
    leg: PlanLeg,
    limit: Option<SpeedIndex>,
    parts: BTreeMap<AxisNumber, (Direction, Distance)>,
}

impl Planned {
    /// The steps of `axis` for each of the leading axis, with their sign.
    fn ratio(&self, axis: AxisNumber) -> f64 {
        let lead = f64::from(self.leg.distance.get());
        self.parts.get(&axis).map_or(0.0, |(direction, distance)| {
            let ratio = f64::from(distance.get()) / lead;
            if *direction == Direction::Forward { ratio } else { -ratio }
        })
    }
}

impl<L: Link> Executive<L> {
    /// Arms all axes, and starts them at one tick.
    pub(super) fn path(&mut self, legs: &[Leg], kind: MovementKind) -> Result<Vec<Underway>, Failure> {
        let (planned, axes) = self.plan_path(legs)?;
        let table = self.link.knowledge().table(axes[0])?;
        let duration = match &planned[..] {
            [Planned { leg, .. }] => Plan::ramped(table, leg.distance, leg.limit).duration(),
            _ => Plan::path(table, &planned.iter().map(|one| one.leg).collect::<Vec<_>>()).duration(),
        };
        let common = self.link.common();
        // The start is said to everyone, so only one line may be armed at a time.
        let starting = common.starting();
        let mut armed = Vec::with_capacity(axes.len());
        for axis in &axes {
            let since = match self.arm(*axis, &planned) {
                Ok(since) => since,
                Err(failure) => {
                    self.halt(&armed)?;
                    return Err(failure);
                }
            };
            let own = planned.iter().filter_map(|leg| leg.parts.get(axis));
            let asked = legs.iter().flat_map(|leg| &leg.parts).filter(|(other, _)| other == axis);
            armed.push(Underway {
                axis: *axis,
                kind,
                asked: Some(Displacement(asked.map(|(_, by)| by.0).sum())),
                steps: Some(own.map(|(_, distance)| u64::from(distance.get())).sum()),
                since,
                // Start and due time follow when all are armed.
                start: since,
                due: since,
            });
        }
        common.begin(&axes);
        let start = match self.start_together(&armed) {
            Ok(start) => start,
            Err(failure) => {
                self.halt(&armed)?;
                return Err(failure);
            }
        };
        drop(starting);
        for underway in &mut armed {
            (underway.start, underway.due) = (start, start + Ticks(duration));
        }
        Ok(armed)
    }

    /// What is commanded for each leg, and all axes that move in any.
    fn plan_path(&self, legs: &[Leg]) -> Result<(Vec<Planned>, Vec<AxisNumber>), Failure> {
        let knowledge = self.link.knowledge();
        let mut planned: Vec<Planned> = Vec::with_capacity(legs.len());
        for leg in legs {
            let mut parts = BTreeMap::new();
            for (axis, by) in &leg.parts {
                knowledge.table(*axis)?;
                if let Some(part) = by.split()? {
                    parts.insert(*axis, part);
                }
            }
            let Some((&leader, &(_, distance))) = parts.iter().max_by_key(|(_, part)| part.1) else {
                continue;
            };
            let limit = leg.speed.map(|speed| knowledge.speed(leader, speed)).transpose()?;
            let leg = PlanLeg { distance, limit: limit.unwrap_or(SpeedIndex::TOP), joint: SpeedIndex::START };
            planned.push(Planned { leg, limit, parts });
        }
        let mut axes: Vec<_> = planned.iter().flat_map(|leg| leg.parts.keys().copied()).collect();
        axes.sort_unstable();
        axes.dedup();
        let Some(first) = axes.first() else {
            return Err(Failure::EmptyLine);
        };
        knowledge.same_ramp(&axes)?;
        let table = knowledge.table(*first)?;
        for i in 1..planned.len() {
            planned[i - 1].leg.joint = joint(table, &axes, &planned[i - 1], &planned[i]);
        }
        Ok((planned, axes))
    }

    /// Tells one axis all legs; returns when it consented to the last. If it refuses a later one, the first ones are
    /// taken back; an axis that refuses the first is left alone, for it may be moving for somebody else.
    fn arm(&mut self, axis: AxisNumber, legs: &[Planned]) -> Result<Tick, Failure> {
        let mut since = None;
        for leg in legs {
            match self.arm_leg(axis, leg) {
                Ok(consented) => since = Some(consented),
                Err(failure) => {
                    if since.is_some() {
                        self.link.send(Command::new(axis.address(), Operation::Halt).into())?;
                    }
                    return Err(failure);
                }
            }
        }
        since.ok_or(Failure::EmptyLine)
    }

    fn arm_leg(
        &mut self,
        axis: AxisNumber,
        Planned { leg, limit, parts }: &Planned,
    ) -> Result<Tick, Failure> {
        self.command(axis, Operation::Lead { distance: leg.distance, limit: *limit })?;
        let part = match parts.get(&axis) {
            Some(&(direction, distance)) => Operation::ArmLine { direction, distance },
            None => Operation::Rest,
        };
        let since = self.command(axis, part)?.acted_at;
        if leg.joint != SpeedIndex::START {
            self.command(axis, Operation::Join { limit: leg.joint })?;
        }
        Ok(since)
    }

    /// Names one start tick to all armed axes. Unless every one confirms it before half of the lead has passed, it fails
    /// while there is still time to call the line off, so that nobody moves.
    fn start_together(&mut self, armed: &[Underway]) -> Result<Tick, Failure> {
        let lead = Duration::from_millis(self.link.knowledge().config.line.lead_ms.into());
        let now = self.link.now();
        let (start, confirmed_by) = (now + self.link.ticks(lead), now + self.link.ticks(lead / 2));
        // One frame for all: if this process is held up, it comes too late for every card, and not for some.
        let go = Command::new(Address::EVERYONE, Operation::Go);
        let sequence = self.link.send(Broadcast { at: Some(start), ..go.into() })?;
        let mut pending: Vec<AxisNumber> = armed.iter().map(|underway| underway.axis).collect();
        while let Some(first) = pending.first().copied() {
            let from: Vec<Address> = pending.iter().map(|axis| axis.address()).collect();
            match self.answer_to(sequence, &from, confirmed_by)? {
                Some(answer) => {
                    if let Some(index) = pending.iter().position(|axis| axis.address() == answer.card) {
                        refused(pending.swap_remove(index), &answer)?;
                    }
                }
                None => return Err(Failure::NotConfirmed { axis: first }),
            }
        }
        Ok(start)
    }
}

/// How fast the leading axis may pass the joint between two legs: so that no axis' speed jumps by more than the start
/// speed, with which any axis may start from standstill.
fn joint(table: &Table, axes: &[AxisNumber], leg: &Planned, next: &Planned) -> SpeedIndex {
    let ratios = axes.iter().map(|axis| (leg.ratio(*axis), next.ratio(*axis)));
    if ratios.clone().any(|(before, after)| before * after < 0.0) {
        return SpeedIndex::START;
    }
    let jump = ratios.map(|(before, after)| (before - after).abs()).fold(0.0, f64::max);
    if jump == 0.0 {
        return SpeedIndex::TOP;
    }
    table.index_at_most(table.speed(SpeedIndex::START) / jump)
}
