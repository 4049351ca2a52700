//! The walk up a table: the periods of an acceleration, one after the other, as the chip makes them of counts that are
//! written in time. Made once per axis, with sums, so that a question about a pulse or a tick is one search among at most 233
//! rungs. It knows no movement.

use std::ops::Range;

use supersigma_protocol::Steps;

use super::REACTION;
use super::signposts::Signposts;

/// The pulses of an acceleration from standstill up to the top of the table: so many periods of entry 0, so many of
/// entry 1, … Periods shrink from rung to rung; an entry that is overtaken has none, and entries that are alike share one.
#[derive(Debug, PartialEq, Eq)]
pub struct Walk {
    rungs: Vec<Rung>,
    /// By the pulses before a rung.
    by_pulse: Signposts,
    /// By the tick at which it begins.
    by_tick: Signposts,
    /// Pulses up to the top of the table.
    pulses: u32,
}

/// Successive periods of one length; there is no end to those of the last rung.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rung {
    /// In ticks.
    pub(super) period: u32,
    /// Pulses before its first one.
    pub(super) before: u32,
    /// Where its first period begins, in ticks from the start of the walk.
    pub(super) start: u64,
}

impl Walk {
    /// The walk up `counts`, with an entry due every `interval` ticks.
    pub(super) fn new(counts: &[u16], interval: u32) -> Self {
        let mut rungs: Vec<Rung> = Vec::with_capacity(counts.len());
        let (mut start, mut before, mut at_the_top) = (0, 0, 0);
        for (entry, count) in counts.iter().enumerate() {
            let period = u32::from(*count) + 1;
            let is_last = entry + 1 == counts.len();
            let own = periods_begun(start, due(entry + 1, interval.into()), period);
            if (own > 0 || is_last) && rungs.last().is_none_or(|last| last.period != period) {
                rungs.push(Rung { period, before, start });
            }
            at_the_top = before;
            before += own;
            start += u64::from(own) * u64::from(period);
        }
        let signposts = |key: fn(&Rung) -> u64| Signposts::new(&rungs.iter().map(key).collect::<Vec<_>>());
        let (by_pulse, by_tick) = (signposts(|rung| rung.before.into()), signposts(|rung| rung.start));
        Self { rungs, by_pulse, by_tick, pulses: at_the_top }
    }

    /// Pulses up to the top of the table.
    #[must_use]
    pub fn pulses(&self) -> Steps {
        Steps(self.pulses)
    }

    /// The index of the rung of pulse `pulse`, from 1; the last one for all beyond the walk.
    pub(super) fn rung_of(&self, pulse: u32) -> usize {
        let Range { start, end } = self.by_pulse.around(pulse.into());
        let begun = start + self.rungs[start..end].partition_point(|rung| rung.before < pulse);
        begun.saturating_sub(1)
    }

    /// The rung with this index.
    pub(super) fn rung(&self, index: usize) -> Rung {
        self.rungs[index]
    }

    /// Pulses up to the last one of the rung with this index.
    pub(super) fn end(&self, index: usize) -> u32 {
        self.rungs.get(index + 1).map_or(u32::MAX, |next| next.before)
    }

    /// The period of pulse `pulse`, from 1, in ticks.
    pub(super) fn period_of(&self, pulse: u32) -> u32 {
        self.rungs[self.rung_of(pulse)].period
    }

    /// The tick of pulse `pulse`; pulse 0 is the start.
    pub(super) fn tick_of(&self, pulse: u32) -> u64 {
        let rung = self.rungs[self.rung_of(pulse)];
        rung.start + u64::from(pulse - rung.before) * u64::from(rung.period)
    }

    /// The last pulse at or before `tick`.
    pub(super) fn pulse_at_most(&self, tick: u64) -> u32 {
        let rung = self.rung_at(tick);
        rung.pulse_after((tick - rung.start) / u64::from(rung.period))
    }

    /// The first pulse at or after `tick`.
    pub(super) fn pulse_at_least(&self, tick: u64) -> u32 {
        let rung = self.rung_at(tick);
        rung.pulse_after((tick - rung.start).div_ceil(u64::from(rung.period)))
    }

    /// How many pulses of the walk have periods of at least `period`; no end to them if the top has.
    pub(super) fn not_faster_than(&self, period: u32) -> u32 {
        let rungs = self.rungs.partition_point(|rung| rung.period >= period);
        self.rungs.get(rungs).map_or(u32::MAX, |faster| faster.before)
    }

    /// How many pulses of the walk have periods longer than `period`: those to walk back through, to stop from it.
    pub(super) fn slower_than(&self, period: u32) -> u32 {
        let rungs = self.rungs.partition_point(|rung| rung.period > period);
        self.rungs.get(rungs).map_or(self.pulses, |rung| rung.before)
    }

    fn rung_at(&self, tick: u64) -> Rung {
        let Range { start, end } = self.by_tick.around(tick);
        let begun = start + self.rungs[start..end].partition_point(|rung| rung.start <= tick);
        self.rungs[begun.saturating_sub(1)]
    }
}

impl Rung {
    /// The pulse after so many of its periods.
    fn pulse_after(self, periods: u64) -> u32 {
        u32::try_from(u64::from(self.before) + periods).unwrap_or(u32::MAX)
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
