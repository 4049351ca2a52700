//! What the axes said, as series over time: frames in, values out. Nothing is drawn, nothing is guessed: between two
//! samples nothing is known.

use supersigma_protocol::{
    Activity, Alarm, Answer, AxisNumber, AxisReport, Body, CardKind, Fault, Frame, Pace, Position, Report,
    StatusWord, Tick, Ticks,
};

/// The state of an axis at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When the card saw it.
    pub tick: Tick,
    /// Where the card believed the axis to be; `None` before it was originated.
    pub position: Option<Position>,
    /// Steps per second, negative towards the origin; 0 at rest.
    pub speed: f64,
    /// X1..X5.
    pub sense: StatusWord,
    /// What it was doing.
    pub activity: Activity,
    /// Why it was locked.
    pub alarm: Option<Alarm>,
}

impl Sample {
    fn new(tick: Tick, report: &AxisReport) -> Self {
        let AxisReport { position, sense, activity, alarm, .. } = *report;
        Self { tick, position, speed: speed(report), sense, activity, alarm }
    }

    /// Whether the motor is turned: it is given pulses, or swings after the last one.
    #[must_use]
    pub const fn moves(&self) -> bool {
        moves(self.activity)
    }

    /// The same state, some time later.
    fn lasts(&self, later: &Self) -> bool {
        Self { tick: later.tick, ..*self } == *later
    }
}

/// Steps per second at the tick of a report, negative towards the origin; 0 at rest.
pub(super) fn speed(report: &AxisReport) -> f64 {
    report.pace.map_or(0.0, Pace::steps_per_second)
}

/// Whether an axis that does this moves.
pub(super) const fn moves(activity: Activity) -> bool {
    !matches!(activity, Activity::Standing | Activity::Armed)
}

/// One axis over time.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTrace {
    /// Which.
    pub axis: AxisNumber,
    /// What it said, in the order of time.
    pub samples: Vec<Sample>,
}

impl AxisTrace {
    /// Where movements ended: the first sample at rest after one that moved, if the position was known.
    pub fn rests(&self) -> impl Iterator<Item = &Sample> {
        self.samples.windows(2).filter(|pair| pair[0].moves() && !pair[1].moves()).map(|pair| &pair[1])
    }

    /// Whether it moved in this span.
    #[must_use]
    pub fn moved(&self, window: Window) -> bool {
        let ends = self.samples.iter().skip(1).map(|next| next.tick).chain([Tick(u64::MAX)]);
        let mut spans = self.samples.iter().zip(ends);
        spans.any(|(sample, end)| sample.moves() && sample.tick <= window.to && end > window.from)
    }

    fn push(&mut self, sample: Sample) {
        // Of a state that lasts, the first and the last sample say everything.
        if let [.., before, last] = self.samples.as_mut_slice()
            && before.lasts(last)
            && last.lasts(&sample)
        {
            *last = sample;
        } else {
            self.samples.push(sample);
        }
    }
}

/// A span of machine time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Its first tick.
    pub from: Tick,
    /// Its last tick; after the first.
    pub to: Tick,
}

impl Window {
    /// Whether `tick` lies in it.
    #[must_use]
    pub fn holds(&self, tick: Tick) -> bool {
        (self.from..=self.to).contains(&tick)
    }

    /// In seconds of machine time since the set's epoch.
    #[must_use]
    pub fn seconds(&self) -> std::ops::Range<f64> {
        seconds(self.from)..seconds(self.to)
    }
}

/// Seconds of machine time since the set's epoch.
pub(super) fn seconds(tick: Tick) -> f64 {
    tick.since(Tick(0)).as_seconds()
}

/// All axes over time, and the faults that were made on purpose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// The axes that said something, by number.
    pub axes: Vec<AxisTrace>,
    /// When, on which axis, which.
    pub faults: Vec<(Tick, AxisNumber, Fault)>,
    /// From the first frame to the last one; `None` without frames.
    pub span: Option<Window>,
}

impl Trace {
    /// Takes in what one frame says.
    pub fn hear(&mut self, frame: &Frame) {
        let Frame { tick, ref body, .. } = *frame;
        self.span = Some(self.span.map_or(Window { from: tick, to: tick }, |span| Window {
            from: span.from.min(tick),
            to: span.to.max(tick),
        }));
        match *body {
            Body::Fault(axis, fault) => self.faults.push((tick, axis, fault)),
            Body::Answer(Answer { card, acted_at, report: Report::Axis(report), .. }) => {
                if let CardKind::Axis(axis) = card.kind() {
                    self.axis(axis).push(Sample::new(acted_at, &report));
                }
            }
            Body::Answer(_) | Body::Command(_) => {}
        }
    }

    /// Every axis' samples in the order of time. Frames of a log come nearly so: a card may answer a command for a tick
    /// that lies before its last change.
    pub fn sort(&mut self) {
        for trace in &mut self.axes {
            trace.samples.sort_by_key(|sample| sample.tick);
        }
    }

    /// From a little before the first movement to a little after the last one; `None` if nothing moved.
    #[must_use]
    pub fn moving(&self) -> Option<Window> {
        let edges = |trace: &AxisTrace| {
            let first = trace.samples.iter().position(Sample::moves)?;
            let last = trace.samples.iter().rposition(Sample::moves)?;
            let end = trace.samples.get(last + 1).unwrap_or(&trace.samples[last]);
            Some((trace.samples[first].tick, end.tick))
        };
        let (from, to) = self.axes.iter().filter_map(edges).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let span = self.span?;
        let air = to.since(from).0 / 50;
        Some(Window {
            from: Tick(from.0.saturating_sub(air)).max(span.from).min(from),
            to: (to + Ticks(air.max(1))).min(span.to).max(from + Ticks(1)),
        })
    }

    fn axis(&mut self, axis: AxisNumber) -> &mut AxisTrace {
        let at = match self.axes.binary_search_by_key(&axis, |trace| trace.axis) {
            Ok(at) => at,
            Err(at) => {
                self.axes.insert(at, AxisTrace { axis, samples: Vec::new() });
                at
            }
        };
        &mut self.axes[at]
    }
}
