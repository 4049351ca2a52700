//! What the functions of a script do, as requests. It keeps the little that a program sets for itself, its speed
//! ceilings, and no other state: where the axes are, the cards know.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use rhai::{Dynamic, Map};
use supersigma_protocol::{
    Address, AxisNumber, AxisReport, Distance, Refusal, SensePoint, SpeedIndex, Tick, Ticks,
};

use crate::executive::{Displacement, Failure, Knowledge, Leg, Operate, Outcome, Request};

use super::arguments::{self as read, Lines};
use super::begun::{self, Open, Part};
use super::parameters::{self, Settings};
use super::trouble::Trouble;
use super::{Watcher, lock};

/// Machine time between two looks at an input that is waited for.
const POLL: Ticks = Ticks::from_millis(10);

/// The robot as one running program has it.
pub(super) struct Robot {
    operator: Arc<Mutex<dyn Operate + Send>>,
    pub(super) knowledge: Arc<Knowledge>,
    pub(super) watcher: Arc<Mutex<dyn Watcher>>,
    stop: Arc<AtomicBool>,
    settings: Arc<Settings>,
    /// What the blocks begin that the program is in, the innermost last.
    pub(super) blocks: Vec<Vec<Part>>,
    /// What was begun and nobody has waited for.
    pub(super) open: Vec<Open>,
    ceiling: Option<f64>,
    /// Of single axes; they go before the one for all.
    ceilings: BTreeMap<AxisNumber, Option<f64>>,
}

/// What has no result.
type Done = Result<(), Trouble>;
/// What moves: its movements, as a program sees them.
type Moved = Result<Dynamic, Trouble>;

impl Robot {
    /// A robot without speed ceilings.
    pub(super) fn new(
        operator: Arc<Mutex<dyn Operate + Send>>,
        knowledge: Arc<Knowledge>,
        watcher: Arc<Mutex<dyn Watcher>>,
        stop: Arc<AtomicBool>,
        settings: Arc<Settings>,
    ) -> Self {
        let (blocks, open) = (vec![], vec![]);
        let ceilings = BTreeMap::new();
        Self { operator, knowledge, watcher, stop, settings, blocks, open, ceiling: None, ceilings }
    }

    pub(super) fn originate_all(&mut self) -> Moved {
        self.moved(Request::Originate { axes: vec![] })
    }

    pub(super) fn originate(&mut self, axes: &Dynamic) -> Moved {
        let axes = read::axes(&self.knowledge, axes)?;
        if axes.is_empty() {
            return Ok(begun::results(&[], &self.knowledge));
        }
        self.moved(Request::Originate { axes })
    }

    pub(super) fn seek_reference(&mut self, axis: &Dynamic) -> Moved {
        let axis = read::axis(&self.knowledge, axis)?;
        self.moved(Request::SeekReference { axis })
    }

    pub(super) fn go_to(&mut self, axis: &Dynamic, position: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let axis = read::axis(&self.knowledge, axis)?;
        let target = read::whole("position", position)?;
        let speed = self.speed_for(axis, speed)?;
        let by = target.saturating_sub(self.where_is(axis)?);
        let most = i64::from(Distance::MAX.get());
        // A rail may be longer than what one command can ask for: then as few parts as possible, of like length.
        let parts = match by / most + by.signum() * i64::from(by % most != 0) {
            // What is begun is one movement: nobody would begin its second part.
            _ if !self.blocks.is_empty() => by.signum(),
            parts => parts,
        };
        if parts.abs() > 1 {
            self.within_travel(axis, target)?;
        }
        let mut left = by;
        let parts = (1..=parts.abs()).rev().map(|part| {
            let by = left / part;
            left -= by;
            Displacement(by)
        });
        let parts: Vec<_> = parts.collect();
        let mut movements = Vec::with_capacity(parts.len());
        for by in parts {
            movements.extend(self.make(Request::Move { axis, by, speed, constant: false, wait: true })?);
        }
        Ok(begun::results(&movements, &self.knowledge))
    }

    pub(super) fn move_by(&mut self, axis: &Dynamic, steps: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let axis = read::axis(&self.knowledge, axis)?;
        let by = read::steps(steps)?;
        let speed = self.speed_for(axis, speed)?;
        self.run(axis, by, speed, false)
    }

    pub(super) fn slew(&mut self, axis: &Dynamic, steps: &Dynamic, speed: &Dynamic) -> Moved {
        let axis = read::axis(&self.knowledge, axis)?;
        let by = read::steps(steps)?;
        let speed = read::speed(speed)?;
        self.run(axis, by, Some(speed), true)
    }

    pub(super) fn line(&mut self, parts: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let parts = read::parts(&self.knowledge, parts)?;
        self.on_a_line(&parts, speed)
    }

    pub(super) fn line_to(&mut self, targets: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let mut parts = read::parts(&self.knowledge, targets)?;
        for (axis, value) in &mut parts {
            *value = value.saturating_sub(self.where_is(*axis)?);
        }
        self.on_a_line(&parts, speed)
    }

    pub(super) fn path(&mut self, legs: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let legs = read::legs(&self.knowledge, legs)?;
        self.one_after_the_other(&legs, speed)
    }

    /// Each leg goes on from where the one before it ends; an axis that a leg does not name stays where it is.
    pub(super) fn path_to(&mut self, legs: &Dynamic, speed: Option<&Dynamic>) -> Moved {
        let mut legs = read::legs(&self.knowledge, legs)?;
        let mut places = BTreeMap::new();
        for (axis, value) in legs.iter_mut().flatten() {
            let place = match places.get(axis) {
                Some(place) => *place,
                None => self.where_is(*axis)?,
            };
            places.insert(*axis, *value);
            *value = value.saturating_sub(place);
        }
        self.one_after_the_other(&legs, speed)
    }

    fn one_after_the_other(&mut self, legs: &[Vec<(AxisNumber, i64)>], speed: Option<&Dynamic>) -> Moved {
        let mut path = Vec::with_capacity(legs.len());
        for parts in legs.iter().filter(|parts| parts.iter().any(|(_, by)| *by != 0)) {
            let speed = match speed {
                Some(speed) => Some(read::speed(speed)?),
                None => self.line_ceiling(parts)?,
            };
            let parts = parts.iter().map(|(axis, by)| (*axis, Displacement(*by))).collect();
            path.push(Leg { parts, speed });
        }
        if path.is_empty() {
            return Ok(begun::results(&[], &self.knowledge));
        }
        self.moved(Request::Path { legs: path, wait: true })
    }

    pub(super) fn set_speed(&mut self, speed: &Dynamic) -> Done {
        let ceiling = read::ceiling(speed)?;
        if let Some(ceiling) = ceiling {
            for axis in &self.knowledge.config.axes {
                self.within_ramp(axis.address, ceiling)?;
            }
        }
        self.ceiling = ceiling;
        self.ceilings.clear();
        Ok(())
    }

    pub(super) fn set_speed_of(&mut self, axis: &Dynamic, speed: &Dynamic) -> Done {
        let axis = read::axis(&self.knowledge, axis)?;
        let ceiling = read::ceiling(speed)?;
        if let Some(ceiling) = ceiling {
            self.within_ramp(axis, ceiling)?;
        }
        self.ceilings.insert(axis, ceiling);
        Ok(())
    }

    /// A span of machine time, or a handle.
    pub(super) fn wait(&mut self, what: &Dynamic) -> Result<Dynamic, Trouble> {
        if let Ok(handle) = begun::handle_of(what) {
            return self.wait_begun(&handle);
        }
        let (_, ticks) = read::seconds("seconds", what)?;
        self.request(Request::Wait { ticks }).map(|_| Dynamic::UNIT)
    }

    /// Machine time in seconds.
    pub(super) fn now(&mut self) -> Result<f64, Trouble> {
        match self.request(Request::Now)? {
            Outcome::Tick(tick) => Ok(tick.since(Tick(0)).as_seconds()),
            _ => Err(self.senseless("the time")),
        }
    }

    /// A parameter of the program.
    pub(super) fn parameter(
        &mut self,
        name: &Dynamic,
        default: Option<&Dynamic>,
    ) -> Result<Dynamic, Trouble> {
        parameters::value(&self.settings, name, default)
    }

    pub(super) fn set_output(&mut self, output: &Dynamic, on: &Dynamic) -> Done {
        let bit = read::line(&self.knowledge, Lines::Outputs, output)?;
        let on = read::level("on", on)?;
        self.request(Request::Output { bit, on }).map(drop)
    }

    pub(super) fn input(&mut self, input: &Dynamic) -> Result<bool, Trouble> {
        let bit = read::line(&self.knowledge, Lines::Inputs, input)?;
        self.read_input(bit)
    }

    /// The time that the looking itself takes comes on top of the timeout.
    pub(super) fn wait_for(&mut self, input: &Dynamic, level: &Dynamic, timeout: &Dynamic) -> Done {
        let bit = read::line(&self.knowledge, Lines::Inputs, input)?;
        let level = read::level("level", level)?;
        let (seconds, mut left) = read::seconds("timeout", timeout)?;
        while self.read_input(bit)? != level {
            if left == Ticks(0) {
                let tick = self.tick();
                return Err(Trouble::Timeout { input: input.to_string(), level, seconds, tick });
            }
            let ticks = left.min(POLL);
            self.request(Request::Wait { ticks })?;
            left = Ticks(left.0 - ticks.0);
        }
        Ok(())
    }

    pub(super) fn position(&mut self, axis: &Dynamic) -> Result<i64, Trouble> {
        let axis = read::axis(&self.knowledge, axis)?;
        self.where_is(axis)
    }

    pub(super) fn status(&mut self, axis: &Dynamic) -> Result<Map, Trouble> {
        let axis = read::axis(&self.knowledge, axis)?;
        let report = self.report(axis)?;
        let mut status = Map::new();
        for (name, point) in ["x1", "x2", "x3", "x4", "x5"].into_iter().zip(SensePoint::ALL) {
            status.insert(name.into(), report.sense.has(point).into());
        }
        let position = report.position.map_or(Dynamic::UNIT, |position| i64::from(position.0).into());
        let alarm = report.alarm.map_or(Dynamic::UNIT, |alarm| alarm.to_string().into());
        status.insert("axis".into(), self.knowledge.name(axis).into());
        status.insert("steps".into(), i64::from(report.steps.0).into());
        status.insert("position".into(), position);
        status.insert("activity".into(), report.activity.to_string().into());
        status.insert("alarm".into(), alarm);
        Ok(status)
    }

    pub(super) fn halt(&mut self, axes: Option<&Dynamic>) -> Done {
        self.all_or(axes, |axes| Request::Halt { axes })
    }

    pub(super) fn brake(&mut self, axes: Option<&Dynamic>) -> Done {
        self.all_or(axes, |axes| Request::Brake { axes })
    }

    pub(super) fn clear(&mut self, axes: Option<&Dynamic>) -> Done {
        self.all_or(axes, |axes| Request::Clear { axes })
    }

    /// Has a request carried out, and tells the watcher of the movements.
    pub(super) fn request(&mut self, request: Request) -> Result<Outcome, Trouble> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Trouble::Interrupted);
        }
        let outcome = self.operate(request).map_err(|failure| self.trouble(failure))?;
        if let Outcome::Moved(movements) = &outcome {
            let mut watcher = lock(&self.watcher);
            for movement in movements {
                watcher.movement(movement);
            }
        }
        Ok(outcome)
    }

    /// Has a request carried out, whoever wants the program to end.
    pub(super) fn operate(&self, request: Request) -> Result<Outcome, Failure> {
        lock(&self.operator).operate(request)
    }

    fn moved(&mut self, request: Request) -> Moved {
        let begins = !self.blocks.is_empty();
        let movements = self.make(request)?;
        Ok(if begins { Dynamic::UNIT } else { begun::results(&movements, &self.knowledge) })
    }

    fn all_or(&mut self, axes: Option<&Dynamic>, request: impl FnOnce(Vec<AxisNumber>) -> Request) -> Done {
        match axes {
            Some(axes) => self.several(axes, request),
            None => self.request(request(vec![])).map(drop),
        }
    }

    /// In a request no axes mean all; in a script an empty array means none.
    fn several(&mut self, axes: &Dynamic, request: impl FnOnce(Vec<AxisNumber>) -> Request) -> Done {
        let axes = read::axes(&self.knowledge, axes)?;
        if axes.is_empty() { Ok(()) } else { self.request(request(axes)).map(drop) }
    }

    fn run(&mut self, axis: AxisNumber, by: Displacement, speed: Option<f64>, constant: bool) -> Moved {
        self.moved(Request::Move { axis, by, speed, constant, wait: true })
    }

    /// A line of these displacements. Where all of them are 0 there is nothing to do, as in a single movement.
    fn on_a_line(&mut self, parts: &[(AxisNumber, i64)], speed: Option<&Dynamic>) -> Moved {
        let speed = match speed {
            Some(speed) => Some(read::speed(speed)?),
            None => self.line_ceiling(parts)?,
        };
        if !parts.is_empty() && parts.iter().all(|(_, by)| *by == 0) {
            return Ok(begun::results(&[], &self.knowledge));
        }
        let parts = parts.iter().map(|(axis, by)| (*axis, Displacement(*by))).collect();
        self.moved(Request::Line { parts, speed, wait: true })
    }

    /// The speed of the leading axis at which no axis of the line is above its own ceiling: an axis with half of the
    /// steps has half of the speed.
    fn line_ceiling(&self, parts: &[(AxisNumber, i64)]) -> Result<Option<f64>, Trouble> {
        let steps = |by: i64| f64::from(u32::try_from(by.unsigned_abs()).unwrap_or(u32::MAX));
        let Some((leader, longest)) = parts.iter().max_by_key(|(_, by)| by.unsigned_abs()) else {
            return Ok(None);
        };
        let top = self.ramp_of(*leader)?.1;
        let moving = parts.iter().filter(|(_, by)| *by != 0);
        let ceilings =
            moving.filter_map(|(axis, by)| Some(self.ceiling_of(*axis)? * steps(*longest) / steps(*by)));
        Ok(ceilings.reduce(f64::min).filter(|ceiling| *ceiling < top))
    }

    fn speed_for(&self, axis: AxisNumber, asked: Option<&Dynamic>) -> Result<Option<f64>, Trouble> {
        asked.map_or_else(|| Ok(self.ceiling_of(axis)), |speed| read::speed(speed).map(Some))
    }

    fn ceiling_of(&self, axis: AxisNumber) -> Option<f64> {
        self.ceilings.get(&axis).copied().unwrap_or(self.ceiling)
    }

    /// The first and the last speed of an axis' ramp.
    fn ramp_of(&self, axis: AxisNumber) -> Result<(f64, f64), Trouble> {
        let table = self.knowledge.table(axis).map_err(|failure| self.trouble(failure))?;
        Ok((table.speed(SpeedIndex::START), table.speed(SpeedIndex::TOP)))
    }

    /// A ceiling that no movement could have is told where it is set, not where it is first used.
    fn within_ramp(&self, axis: AxisNumber, asked: f64) -> Done {
        self.knowledge.speed(axis, asked).map(drop).map_err(|failure| self.trouble(failure))
    }

    /// A movement of several commands is not begun if the last of them will be refused.
    fn within_travel(&self, axis: AxisNumber, target: i64) -> Done {
        read::within_travel(&self.knowledge, axis, target).map_err(|failure| self.trouble(failure))
    }

    fn where_is(&mut self, axis: AxisNumber) -> Result<i64, Trouble> {
        let position = self.report(axis)?.position;
        position
            .map(|position| i64::from(position.0))
            .ok_or_else(|| self.trouble(Failure::Refused { axis, refusal: Refusal::NotOriginated, at: None }))
    }

    fn report(&mut self, axis: AxisNumber) -> Result<AxisReport, Trouble> {
        let Outcome::Axes(states) = self.request(Request::Status { axes: vec![axis] })? else {
            return Err(self.senseless("the state of an axis"));
        };
        let state = states.into_iter().find(|state| state.axis == axis);
        state
            .and_then(|state| state.report)
            .ok_or_else(|| self.trouble(Failure::WorkerGone { card: axis.address() }))
    }

    fn read_input(&mut self, bit: u8) -> Result<bool, Trouble> {
        match self.request(Request::Digital { card: Address::DIGITAL_INPUT })? {
            Outcome::Digital(word) => Ok(word & (1 << bit) != 0),
            _ => Err(self.senseless("the digital inputs")),
        }
    }

    pub(super) fn trouble(&self, failure: Failure) -> Trouble {
        // Without a set there is nobody to ask, and a card may have said it already.
        let known = failure.at().is_some() || failure == Failure::Cancelled || failure.exit_code() == 3;
        Trouble::robot(failure, &self.knowledge, if known { None } else { self.tick() })
    }

    fn tick(&self) -> Option<Tick> {
        match self.operate(Request::Now) {
            Ok(Outcome::Tick(tick)) => Some(tick),
            _ => None,
        }
    }

    pub(super) fn senseless(&self, asked: &str) -> Trouble {
        self.trouble(Failure::Control { reason: format!("asked for {asked}, it tells something else") })
    }
}
