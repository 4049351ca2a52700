//! What the executive needs of a set: to send, to hear, and to know the time. A live set and a dry run are two such links.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axis_worker::ramp::Table;
use supersigma_config::{Config, RampError};
use supersigma_protocol::{
    Activity, Address, Answer, AxisNumber, Broadcast, Fault, Sequence, SpeedIndex, Tick, Ticks,
};

use super::failure::{Failure, LogTrouble};
use super::request::{Remainder, Request};

/// A set's configuration and the ramps that follow from it.
#[derive(Debug)]
pub struct Knowledge {
    /// The set.
    pub config: Config,
    tables: BTreeMap<AxisNumber, Table>,
}

impl Knowledge {
    /// Everything that can be known beforehand.
    ///
    /// # Errors
    /// If an axis' ramp does not give a table.
    pub fn new(config: Config) -> Result<Arc<Self>, RampError> {
        let mut tables = BTreeMap::new();
        for axis in &config.axes {
            tables.insert(axis.address, Table::new(config.ramp_of(axis))?);
        }
        Ok(Arc::new(Self { config, tables }))
    }

    /// The ramp of an axis.
    ///
    /// # Errors
    /// If the set does not have the axis.
    pub fn table(&self, axis: AxisNumber) -> Result<&Table, Failure> {
        self.tables.get(&axis).ok_or(Failure::NoSuchAxis { axis })
    }

    /// The entry of the axis' ramp for a speed in steps per second.
    ///
    /// # Errors
    /// If the ramp does not have the speed, or the set the axis.
    pub fn speed(&self, axis: AxisNumber, asked: f64) -> Result<SpeedIndex, Failure> {
        let table = self.table(axis)?;
        let (slowest, fastest) = (table.speed(SpeedIndex::START), table.speed(SpeedIndex::TOP));
        table.index_of(asked).ok_or(Failure::SpeedOutOfRange { axis, asked, slowest, fastest })
    }

    /// These axes, or all of the set if none is named.
    ///
    /// # Errors
    /// If the set does not have one of them.
    pub fn axes(&self, named: &[AxisNumber]) -> Result<Vec<AxisNumber>, Failure> {
        for axis in named {
            self.table(*axis)?;
        }
        Ok(if named.is_empty() {
            self.config.axes.iter().map(|axis| axis.address).collect()
        } else {
            named.to_vec()
        })
    }

    /// Whether these axes accelerate alike, as they must on a line.
    ///
    /// # Errors
    /// If not, with the two that differ.
    pub fn same_ramp(&self, axes: &[AxisNumber]) -> Result<(), Failure> {
        let ramp = |axis: AxisNumber| self.config.axis(axis).map(|axis| self.config.ramp_of(axis));
        match axes.windows(2).find(|pair| ramp(pair[0]) != ramp(pair[1])) {
            Some(pair) => Err(Failure::DifferentRamps { one: pair[0], other: pair[1] }),
            None => Ok(()),
        }
    }

    /// An axis as messages call it, `axis 1 (left_x)`.
    #[must_use]
    pub fn number_and_name(&self, axis: AxisNumber) -> String {
        match self.config.axis(axis) {
            Some(config) => format!("{axis} ({})", config.name),
            None => axis.to_string(),
        }
    }

    /// What people call an axis.
    #[must_use]
    pub fn name(&self, axis: AxisNumber) -> &str {
        self.config.axis(axis).map_or("?", |axis| &axis.name)
    }
}

/// Something that was heard on the bus, or about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Heard {
    /// An answer.
    Answer(Answer),
    /// The process that plays a card has ended.
    WorkerGone(Address),
    /// There is no log any more.
    NoLog(Arc<LogTrouble>),
    /// Frames of a card were lost.
    FramesLost(Address, u64),
    /// Somebody wants what was halted to go on.
    Resume,
    /// The set goes down.
    GoingDown,
}

/// The executive's end of a set.
pub trait Link {
    /// The set.
    fn knowledge(&self) -> &Arc<Knowledge>;

    /// The tick now.
    fn now(&self) -> Tick;

    /// The machine time that passes during a span of real time.
    fn ticks(&self, real: Duration) -> Ticks;

    /// Puts a command on the bus.
    ///
    /// # Errors
    /// If the bus fails, or nobody plays a card that the command is for.
    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure>;

    /// Makes a fault on purpose, over the bus.
    ///
    /// # Errors
    /// If the bus fails, or nobody plays the card.
    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure>;

    /// The next thing heard; `None` when it is `until` and nothing was.
    ///
    /// # Errors
    /// If the bus fails, or whoever asked does not want it any more.
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure>;

    /// What an axis is doing, as far as it is known here; `None` if nobody plays its card.
    fn activity(&self, axis: AxisNumber) -> Option<Activity> {
        let _ = axis;
        None
    }

    /// What the executives of this set have in common.
    fn common(&self) -> Arc<Common>;

    /// Tells the other executives of this set that what was halted may go on.
    fn tell_resume(&self);
}

/// What the executives of one set have in common: which axes are on a line together, what is left of halted movements, and
/// how many programs wait for it to go on.
#[derive(Debug, Default)]
pub struct Common {
    shared: Mutex<Shared>,
    starting: Mutex<()>,
}

#[derive(Debug, Default)]
struct Shared {
    lines: Vec<Vec<AxisNumber>>,
    remainders: Vec<Remainder>,
    /// Movements that nobody waits for.
    unwatched: Vec<Request>,
    paused: usize,
}

impl Common {
    /// Held from the first arming of a line to its start.
    pub fn starting(&self) -> MutexGuard<'_, ()> {
        self.starting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// These axes begin to move together, or one alone; whatever line one of them was on is over.
    pub fn begin(&self, axes: &[AxisNumber]) {
        let mut shared = self.shared();
        shared.lines.retain(|line| !line.iter().any(|axis| axes.contains(axis)));
        shared.unwatched.retain(|request| !request.moving().keys().any(|axis| axes.contains(axis)));
        for rest in &mut shared.remainders {
            let again = rest.from.iter().map(|(axis, _)| *axis).find(|axis| axes.contains(axis));
            rest.moved = rest.moved.or(again);
        }
        if axes.len() > 1 {
            shared.lines.push(axes.to_vec());
        }
    }

    /// The axes that move, or moved last, on a line with `axis`; that one among them.
    pub fn line_of(&self, axis: AxisNumber) -> Vec<AxisNumber> {
        let shared = self.shared();
        shared.lines.iter().find(|line| line.contains(&axis)).cloned().unwrap_or_else(|| vec![axis])
    }

    /// Keeps a movement that nobody waits for, so that its rest is known if it is halted.
    pub fn leave_unwatched(&self, request: Request) {
        self.shared().unwatched.push(request);
    }

    /// Takes the movements of `axes` that nobody waits for.
    pub fn take_unwatched(&self, axes: &[AxisNumber]) -> Vec<Request> {
        let mut shared = self.shared();
        let concerned = |request: &mut Request| request.moving().keys().any(|axis| axes.contains(axis));
        shared.unwatched.extract_if(.., concerned).collect()
    }

    /// Keeps what is left of a movement; it replaces what was left of earlier ones of these axes.
    pub fn leave(&self, remainder: Remainder) {
        let mut shared = self.shared();
        shared.remainders.retain(|other| {
            !other.from.iter().any(|(axis, _)| remainder.from.iter().any(|(ours, _)| ours == axis))
        });
        shared.remainders.push(remainder);
    }

    /// Takes what is left of movements of `axes`.
    pub fn take_left_of(&self, axes: &[AxisNumber]) -> Option<Remainder> {
        let mut shared = self.shared();
        let concerned = |left: &Remainder| left.from.iter().any(|(axis, _)| axes.contains(axis));
        let index = shared.remainders.iter().position(concerned)?;
        Some(shared.remainders.remove(index))
    }

    /// Takes all that is left of movements, and says how many programs wait to be resumed.
    pub fn take(&self) -> (Vec<Remainder>, usize) {
        let mut shared = self.shared();
        (std::mem::take(&mut shared.remainders), shared.paused)
    }

    /// A program waits to be resumed, until what comes back is dropped.
    pub fn pause(self: Arc<Self>) -> Paused {
        self.shared().paused += 1;
        Paused(self)
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        // Every statement leaves it whole.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Somebody waits to be resumed.
#[derive(Debug)]
pub struct Paused(Arc<Common>);

impl Drop for Paused {
    fn drop(&mut self) {
        self.0.shared().paused -= 1;
    }
}
