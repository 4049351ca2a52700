//! The table of the firmware and the two [walks](Walk) up it, whatever the profile. Made once per axis; never changed afterwards.

use std::sync::Arc;

use supersigma_config::{RampConfig, RampError, SMALLEST_N, ShortMoves};
use supersigma_protocol::{SpeedIndex, Steps, Tick, Ticks};

use super::REACTION;
use super::walk::Walk;

/// Entries of the table: 0 ..= 232.
pub(super) const ENTRIES: usize = SpeedIndex::TOP.get() as usize + 1;

// The count of the next period is written while a period runs.
const _: () = assert!(REACTION.0 <= SMALLEST_N as u64);

/// Steps per second by which a speed that is asked for may miss an entry.
const GRACE: f64 = 0.5;

/// The ramp of one axis: counts, differences and walks.
#[derive(Debug)]
pub struct Table {
    counts: [u16; ENTRIES],
    differences: [u16; ENTRIES - 1],
    last: SpeedIndex,
    interval: Ticks,
    offset: Steps,
    method: ShortMoves,
    normal: Arc<Walk>,
    steep: Arc<Walk>,
}

impl Table {
    /// The table of `ramp`: what the paper's FORTRAN program did on a minicomputer.
    ///
    /// # Errors
    /// If the curve does not give a table that an 8253 can follow.
    pub fn new(ramp: &RampConfig) -> Result<Self, RampError> {
        let counts = ramp.counts()?;
        let mut differences = [0; ENTRIES - 1];
        for (difference, pair) in differences.iter_mut().zip(counts.windows(2)) {
            *difference = pair[0] - pair[1];
        }
        Ok(Self {
            counts,
            differences,
            last: SpeedIndex::new(ramp.profile.last_entry()).unwrap_or(SpeedIndex::TOP),
            interval: Ticks(ramp.interval_ticks().into()),
            offset: Steps(ramp.offset),
            method: ramp.short_moves,
            normal: Arc::new(Walk::new(&counts, ramp.interval_ticks())),
            steep: Arc::new(Walk::new(&counts, ramp.brake_interval_ticks)),
        })
    }

    /// N of each entry; the chip is loaded with N + 1 (see [`Table::period`]).
    #[must_use]
    pub fn counts(&self) -> &[u16] {
        &self.counts
    }

    /// N(i) − N(i + 1): the 232 bytes of \[C\] Table 2, or as many wide differences.
    #[must_use]
    pub fn differences(&self) -> &[u16] {
        &self.differences
    }

    /// The last entry that the profile has of its own: [`SpeedIndex::TOP`], but of a table with fewer entries, whose last
    /// one holds from there on.
    #[must_use]
    pub fn last(&self) -> SpeedIndex {
        self.last
    }

    /// The period of entry `index` in ticks: N + 1, \[C\] eq. (1).
    #[must_use]
    pub fn period(&self, index: SpeedIndex) -> u32 {
        u32::from(self.counts[usize::from(index.get())]) + 1
    }

    /// Steps per second of entry `index`, for people.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "the clock's frequency is exact in an f64")]
    pub fn speed(&self, index: SpeedIndex) -> f64 {
        Tick::PER_SECOND as f64 / f64::from(self.period(index))
    }

    /// The entry for a speed that somebody asks for; `None` if the ramp does not have it. Half a step per second of grace lets
    /// people ask for the round figures of its ends.
    #[must_use]
    pub fn index_of(&self, steps_per_second: f64) -> Option<SpeedIndex> {
        let (slowest, fastest) = (self.speed(SpeedIndex::START), self.speed(SpeedIndex::TOP));
        let range = slowest - GRACE..=fastest + GRACE;
        range.contains(&steps_per_second).then(|| self.index_at_most(steps_per_second))
    }

    /// The fastest entry that is not faster than `steps_per_second`; the first one if all are.
    #[must_use]
    pub fn index_at_most(&self, steps_per_second: f64) -> SpeedIndex {
        (0..=SpeedIndex::TOP.get())
            .filter_map(SpeedIndex::new)
            .take_while(|index| self.speed(*index) <= steps_per_second + GRACE)
            .last()
            .unwrap_or(SpeedIndex::START)
    }

    /// Time from one entry to the next in a normal ramp.
    #[must_use]
    pub fn interval(&self) -> Ticks {
        self.interval
    }

    /// Steps kept in reserve before the target by the paper's method.
    #[must_use]
    pub fn offset(&self) -> Steps {
        self.offset
    }

    /// How movements are planned.
    #[must_use]
    pub fn method(&self) -> ShortMoves {
        self.method
    }

    /// The walk of normal ramps.
    #[must_use]
    pub fn normal(&self) -> &Arc<Walk> {
        &self.normal
    }

    /// The walk of emergency stops.
    #[must_use]
    pub fn steep(&self) -> &Arc<Walk> {
        &self.steep
    }
}
