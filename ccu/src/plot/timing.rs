//! What took how long: movements as bars, digital lines as levels, and the totals. Frames in, values out; of a movement
//! only its beginning and its end are kept, so a program may run as long as it likes.

use serde::Serialize;
use supersigma_protocol::{
    About, Alarm, Answer, AxisNumber, AxisReport, Body, Broadcast, CardKind, Command, Direction, Frame,
    Operation, Refusal, Report, Sequence, Steps, Tick, Ticks,
};

use super::sheet::number;
use super::trace::{Window, moves, speed};
use crate::log::AxisNames;

/// Kinds of movements, as they are told apart in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Alone, with a ramp or at constant speed.
    Move,
    /// As a part of a line or a path.
    Line,
    /// Looking for the origin.
    Origin,
    /// Looking for the reference step.
    Reference,
}

/// How a movement ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// By itself.
    Complete,
    /// By a halt.
    Halted,
    /// By an alarm.
    Alarmed(Alarm),
    /// Not before the last frame.
    Open,
}

/// One movement of one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bar {
    /// What it was.
    pub kind: Kind,
    /// From the first pulse's command on.
    pub begin: Tick,
    /// When the axis stood again.
    pub end: Tick,
    /// Pulses made.
    pub steps: Steps,
    /// Where to; `None` for a search, which goes both ways, and for a path that turns.
    pub direction: Option<Direction>,
    /// How it ended.
    pub ending: Ending,
}

/// The movements of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTiming {
    /// Which axis.
    pub axis: AxisNumber,
    /// In the order of time.
    pub bars: Vec<Bar>,
    /// The largest speed that it reported, in steps per second.
    pub peak_speed: f64,
    /// What was asked of it, not answered yet.
    asked: Vec<(Sequence, Operation)>,
    /// What it is about to do, or is doing.
    next: (Kind, Option<Direction>),
    /// The last bar is not over.
    open: bool,
    halted: bool,
}

/// A digital card: its sixteen lines over time.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Lane {
    /// The word from each tick on.
    pub words: Vec<(Tick, u16)>,
}

impl Lane {
    fn push(&mut self, tick: Tick, word: u16) {
        if self.words.last().is_none_or(|last| last.1 != word) {
            self.words.push((tick, word));
        }
    }

    /// Whether line `bit` ever changed or was on.
    #[must_use]
    pub fn uses(&self, bit: u8) -> bool {
        self.words.iter().any(|(_, word)| word >> bit & 1 == 1)
    }

    /// When line `bit` was on, up to `end`.
    #[must_use]
    pub fn on(&self, bit: u8, end: Tick) -> Vec<Window> {
        let mut spans: Vec<Window> = Vec::new();
        let ends = self.words.iter().skip(1).map(|next| next.0).chain([end]);
        for (&(from, word), to) in self.words.iter().zip(ends) {
            if word >> bit & 1 == 1 {
                match spans.last_mut().filter(|span| span.to == from) {
                    Some(span) => span.to = to,
                    None => spans.push(Window { from, to }),
                }
            }
        }
        spans
    }
}

/// What took how long.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timing {
    /// The axes, by number.
    pub axes: Vec<AxisTiming>,
    /// The output card.
    pub outputs: Lane,
    /// The input card.
    pub inputs: Lane,
    /// Commands that would have left an axis' travel, and were not carried out.
    pub out_of_travel: Vec<(Tick, AxisNumber, Refusal)>,
    /// From the first frame to the last one; `None` without frames.
    pub span: Option<Window>,
}

impl Timing {
    /// Takes in what one frame says.
    pub fn hear(&mut self, frame: &Frame) {
        let mut span = self.span.unwrap_or(Window { from: frame.tick, to: frame.tick });
        span.to = span.to.max(frame.tick);
        self.span = Some(span);
        match &frame.body {
            Body::Command(broadcast) => self.asked(frame.sequence, broadcast),
            Body::Answer(answer) => self.answered(answer),
            Body::Fault(..) => {}
        }
    }

    /// The run is over at `end`, although nobody spoke then.
    pub fn close(&mut self, end: Tick) {
        let span = self.span.get_or_insert(Window { from: Tick(0), to: end });
        span.to = span.to.max(end);
        for axis in self.axes.iter_mut().filter(|axis| axis.open) {
            axis.open = false;
            if let Some(bar) = axis.bars.last_mut() {
                (bar.end, bar.ending) = (span.to, Ending::Open);
            }
        }
    }

    /// When nothing moved, from the first frame to the last one.
    #[must_use]
    pub fn idle(&self) -> Vec<Window> {
        let Some(span) = self.span else { return Vec::new() };
        gaps(span, self.axes.iter().flat_map(|axis| &axis.bars))
    }

    /// The totals of all axes in words.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "for people")]
    pub fn totals(&self) -> String {
        let bars = || self.axes.iter().flat_map(|axis| &axis.bars);
        let steps: u64 = bars().map(|bar| u64::from(bar.steps.0)).sum();
        let seconds = self.span.map_or(0.0, |span| span.to.since(span.from).as_seconds());
        format!(
            "{} movements, {} steps, {seconds:.3} s of machine time",
            bars().count(),
            number(steps as f64, 0)
        )
    }

    fn asked(&mut self, sequence: Sequence, broadcast: &Broadcast) {
        let Ok(Command { to, operation }) = Command::decode(broadcast.bytes.as_slice()) else { return };
        match to.kind() {
            CardKind::Axis(axis) => self.axis(axis).asked.push((sequence, operation)),
            CardKind::Everyone => {
                for axis in &mut self.axes {
                    axis.asked.push((sequence, operation));
                }
            }
            CardKind::DigitalInput | CardKind::DigitalOutput | CardKind::Unknown(_) => {}
        }
    }

    fn answered(&mut self, answer: &Answer) {
        match (answer.card.kind(), &answer.report) {
            (CardKind::Axis(number), Report::Axis(report)) => {
                let axis = self.axis(number);
                if let About::Command(sequence, result) = answer.about {
                    let asked = axis.take(sequence);
                    match result {
                        Ok(()) => asked.into_iter().for_each(|operation| axis.consents(operation)),
                        Err(refusal @ Refusal::OutOfTravel { .. }) => {
                            self.out_of_travel.push((answer.acted_at, number, refusal));
                        }
                        Err(_) => {}
                    }
                }
                self.axis(number).reports(answer.acted_at, report);
            }
            (CardKind::DigitalOutput, Report::Digital(word)) => self.outputs.push(answer.acted_at, *word),
            (CardKind::DigitalInput, Report::Digital(word)) => self.inputs.push(answer.acted_at, *word),
            _ => {}
        }
    }

    fn axis(&mut self, axis: AxisNumber) -> &mut AxisTiming {
        let at = match self.axes.binary_search_by_key(&axis, |timing| timing.axis) {
            Ok(at) => at,
            Err(at) => {
                self.axes.insert(at, AxisTiming::new(axis));
                at
            }
        };
        &mut self.axes[at]
    }
}

impl AxisTiming {
    fn new(axis: AxisNumber) -> Self {
        Self {
            axis,
            bars: Vec::new(),
            peak_speed: 0.0,
            asked: Vec::new(),
            next: (Kind::Move, None),
            open: false,
            halted: false,
        }
    }

    /// What was asked with `sequence`. What was asked before that will not be answered any more.
    fn take(&mut self, sequence: Sequence) -> Option<Operation> {
        let at = self.asked.iter().position(|asked| asked.0 == sequence)?;
        self.asked.drain(..=at).next_back().map(|asked| asked.1)
    }

    fn consents(&mut self, operation: Operation) {
        match operation {
            Operation::Move { direction, .. }
            | Operation::MoveLimited { direction, .. }
            | Operation::Slew { direction, .. } => self.next = (Kind::Move, Some(direction)),
            // A second leg makes it a path, whose parts may go either way.
            Operation::ArmLine { direction, .. } => {
                let turns =
                    self.next.0 == Kind::Line && self.next.1.is_some_and(|before| before != direction);
                self.next = (Kind::Line, (!turns).then_some(direction));
            }
            Operation::Originate => self.next = (Kind::Origin, None),
            Operation::SeekReference => self.next = (Kind::Reference, None),
            Operation::Halt | Operation::Brake => self.halted = self.open,
            _ => {}
        }
    }

    fn reports(&mut self, tick: Tick, report: &AxisReport) {
        self.peak_speed = self.peak_speed.max(speed(report).abs());
        let moving = moves(report.activity);
        if moving && !self.open {
            let (kind, direction) = self.next;
            let ending = Ending::Open;
            self.bars.push(Bar { kind, begin: tick, end: tick, steps: report.steps, direction, ending });
        }
        if let Some(bar) = self.bars.last_mut().filter(|_| moving || self.open) {
            (bar.end, bar.steps) = (bar.end.max(tick), report.steps);
            if !moving {
                bar.ending = match report.alarm {
                    Some(alarm) => Ending::Alarmed(alarm),
                    None if self.halted => Ending::Halted,
                    None => Ending::Complete,
                };
                (self.halted, self.next) = (false, (Kind::Move, None));
            }
        }
        self.open = moving;
    }

    fn moving(&self) -> Ticks {
        self.bars.iter().map(|bar| bar.end.since(bar.begin)).fold(Ticks(0), |sum, span| sum + span)
    }
}

/// What of `span` no bar covers.
fn gaps<'a>(span: Window, bars: impl Iterator<Item = &'a Bar>) -> Vec<Window> {
    let mut bars: Vec<_> = bars.map(|bar| (bar.begin, bar.end)).collect();
    bars.sort_unstable();
    let mut gaps = Vec::new();
    let mut covered = span.from;
    for (begin, end) in bars.into_iter().chain([(span.to, span.to)]) {
        if begin > covered {
            gaps.push(Window { from: covered, to: begin });
        }
        covered = covered.max(end);
    }
    gaps
}

/// The totals of one axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Its number.
    pub axis: u8,
    /// What people call it.
    pub name: String,
    /// Movements.
    pub movements: usize,
    /// Pulses in all of them.
    pub steps: u64,
    /// The largest speed that it reported, in steps per second.
    pub peak_speed: f64,
    /// Seconds of machine time in which it moved.
    pub moving_seconds: f64,
    /// The longest time for which it stood, in seconds of machine time.
    pub longest_wait_seconds: f64,
    /// Commands that it refused because they would have left its travel.
    pub out_of_travel: usize,
}

impl Timing {
    /// The totals of every axis.
    #[must_use]
    pub fn summaries(&self, names: &AxisNames) -> Vec<Summary> {
        let summary = |timing: &AxisTiming| Summary {
            axis: timing.axis.get(),
            name: names.of(timing.axis).into_owned(),
            movements: timing.bars.len(),
            steps: timing.bars.iter().map(|bar| u64::from(bar.steps.0)).sum(),
            peak_speed: timing.peak_speed,
            moving_seconds: timing.moving().as_seconds(),
            longest_wait_seconds: self
                .span
                .iter()
                .flat_map(|&span| gaps(span, timing.bars.iter()))
                .map(|gap| gap.to.since(gap.from).as_seconds())
                .fold(0.0, f64::max),
            out_of_travel: self.out_of_travel.iter().filter(|refused| refused.1 == timing.axis).count(),
        };
        self.axes.iter().map(summary).collect()
    }
}
