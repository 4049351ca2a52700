//! What the executive needs of a set: to send, to hear, and to know the time. A live set and a dry run are two such links.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use axis_worker::ramp::Table;
use supersigma_config::{Config, RampError};
use supersigma_protocol::{Address, Answer, AxisNumber, Broadcast, Sequence, Tick, Ticks};

use super::request::Failure;

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

    /// What people call an axis.
    #[must_use]
    pub fn name(&self, axis: AxisNumber) -> &str {
        self.config.axis(axis).map_or("?", |axis| &axis.name)
    }
}

/// Something that was heard on the bus, or about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heard {
    /// An answer.
    Answer(Answer),
    /// The process that plays a card has ended.
    WorkerGone(Address),
    /// The recorder has ended.
    NoLog,
    /// Frames of a card were lost.
    FramesLost(Address, u64),
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

    /// The next thing heard; `None` when it is `until` and nothing was.
    ///
    /// # Errors
    /// If the bus fails, or whoever asked does not want it any more.
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure>;
}
