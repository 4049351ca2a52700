//! The table of the firmware and the two walks up it, whatever the profile. Made once per axis; never changed afterwards.

use supersigma_config::{RampConfig, RampError, SMALLEST_N, ShortMoves};
use supersigma_protocol::{SpeedIndex, Steps, Tick, Ticks};

use super::REACTION;

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
    normal: Walk,
    steep: Walk,
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
            normal: Walk::new(&counts, ramp.interval_ticks()),
            steep: Walk::new(&counts, ramp.brake_interval_ticks),
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
    pub fn normal(&self) -> &Walk {
        &self.normal
    }

    /// The walk of emergency stops.
    #[must_use]
    pub fn steep(&self) -> &Walk {
        &self.steep
    }
}

/// The pulses of an acceleration from standstill up to the top of the table, as runs: so many periods of entry 0,
/// so many of entry 1, … Periods never grow along a walk; an entry that is overtaken has none.
#[derive(Debug)]
pub struct Walk {
    periods: [u32; ENTRIES],
    /// Pulses before the first one of each entry.
    pulses: [u32; ENTRIES],
}

impl Walk {
    fn new(counts: &[u16; ENTRIES], interval: u32) -> Self {
        let mut periods = [0; ENTRIES];
        let mut pulses = [0; ENTRIES];
        let (mut begin, mut done) = (0, 0);
        for (entry, count) in counts.iter().enumerate() {
            periods[entry] = u32::from(*count) + 1;
            pulses[entry] = done;
            let own = periods_begun(begin, due(entry + 1, interval.into()), periods[entry]);
            done += own;
            begin += u64::from(own) * u64::from(periods[entry]);
        }
        Self { periods, pulses }
    }

    /// Pulses up to the top of the table.
    #[must_use]
    pub fn pulses(&self) -> Steps {
        Steps(self.pulses[ENTRIES - 1])
    }

    /// The entry of pulse `pulse`, from 1; the top for all beyond the walk.
    pub(super) fn entry_of(&self, pulse: u32) -> usize {
        self.pulses.partition_point(|before| *before < pulse) - 1
    }

    /// Pulses before the first one of `entry`.
    pub(super) fn before(&self, entry: usize) -> u32 {
        self.pulses[entry]
    }

    /// Pulses up to the last one of `entry`; there is no end to those of the top.
    pub(super) fn end(&self, entry: usize) -> u32 {
        self.pulses.get(entry + 1).copied().unwrap_or(u32::MAX)
    }

    /// The period of `entry` in ticks.
    pub(super) fn period(&self, entry: usize) -> u32 {
        self.periods[entry]
    }

    /// How many pulses of the walk have periods of at least `period`; no end to them if the top has.
    pub(super) fn not_faster_than(&self, period: u32) -> u32 {
        let entries = self.periods.partition_point(|other| *other >= period);
        self.pulses.get(entries).copied().unwrap_or(u32::MAX)
    }

    /// How many pulses of the walk have periods longer than `period`: those to walk back through, to stop from it.
    pub(super) fn slower_than(&self, period: u32) -> u32 {
        let entry = self.periods.partition_point(|longer| *longer > period);
        self.pulses.get(entry).copied().unwrap_or(self.pulses[ENTRIES - 1])
    }
}

/// When entry `entry` is due in a ramp that begins at 0: the first difference is subtracted as soon as the motor has been
/// started, each further one an `interval` later. So entry i + 1 rules from i intervals on, half an interval ahead of the
/// continuous curve on average: by 232 intervals the default ramp has made 2 586 steps, its curve 2 579.
pub(super) fn due(entry: usize, interval: u64) -> u64 {
    match entry {
        0 => 0,
        1 => REACTION.0,
        later => (later as u64 - 1) * interval,
    }
}

/// How many periods begin from tick `begin` on and before `due`, if each lasts `period`. A count written at `due`
/// rules the periods that begin at `due` or later: the chip reloads on the clock after the one that ends a period.
pub(super) fn periods_begun(begin: u64, due: u64, period: u32) -> u32 {
    let span = due.saturating_sub(begin);
    u32::try_from(span.div_ceil(u64::from(period))).unwrap_or(u32::MAX)
}
