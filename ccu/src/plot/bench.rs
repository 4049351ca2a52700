//! The pictures of the test bench, \[M\] Figs 7 to 9: position over time, speed over time, and the prescribed speed profile
//! with the real one. A recording goes in, a picture comes out; what of it is speed, the bench's filters say.

mod filters;
#[cfg(test)]
mod tests;

use std::ops::Range;

use axis_worker::bench::{Clocks, PartSteps, Sampling, SamplingError};
use clap::ValueEnum;
use plotters::prelude::*;
use supersigma_config::HALF_STEPS_PER_CYCLE;
use supersigma_protocol::Direction;

use super::moves::{clipped, thinned};
use super::sheet::{
    ALARM, Area, Chart, Drawn, Entry, Frame, GREY, Head, Words, dashes, number, picture, polyline, px,
    stroke, width,
};
use super::trace::seconds;
use super::{Picture, PlotError, Size};
use crate::bench::filter::{Choice, Cutoff, FilterError, Point, Speeds, Taps, between_edges};
use crate::bench::{CommandedPulse, FirstLost, Program, Recording, Report, Run};

pub use filters::filters;

/// What is shown of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Graph {
    /// The shaft's angle over time, with the commanded one, \[M\] Fig 7
    Position,
    /// Its speed over time, as it is and filtered, \[M\] Fig 8
    Speed,
    /// The prescribed speed and the real one, \[M\] Fig 9, and how far the shaft lags behind
    Profile,
}

impl Graph {
    /// What the low pass has to let through for it.
    #[must_use]
    pub const fn cutoff(self) -> Cutoff {
        match self {
            Self::Position | Self::Speed => Cutoff::SWINGS,
            Self::Profile => Cutoff::RAMPS,
        }
    }
}

/// Which filters are wanted; what is not chosen is as fits the picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Filters {
    /// Of the low pass.
    pub cutoff: Option<Cutoff>,
    /// Of the derivative filter.
    pub taps: Option<Taps>,
}

/// A run and what is known of it.
#[derive(Debug, Clone)]
pub struct Plotted<'a> {
    title: String,
    subtitle: String,
    recording: &'a Recording,
    direction: Direction,
    /// The parts of its profile; a train of one frequency has none.
    parts: Option<PartSteps>,
    first_lost: Option<FirstLost>,
}

/// Why there is no picture of a run.
#[derive(Debug, thiserror::Error)]
pub enum BenchPlotError {
    /// Of another bench.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
    /// The filters cannot be made.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The picture cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

const WIDTH: u32 = 960;
const COMMANDED: RGBColor = RGBColor(213, 94, 0);
const REAL: RGBColor = RGBColor(0, 114, 178);
const INSTANT: RGBColor = RGBColor(150, 198, 228);
const EDGES: RGBColor = RGBColor(205, 205, 205);

impl<'a> Plotted<'a> {
    /// The recording of a run, and the report of it.
    #[must_use]
    pub fn new(run: &Run<'_>, report: &Report, recording: &'a Recording) -> Self {
        let pulses = number_of(report.pulses);
        let fastest = top_frequency(run.train.steps(), recording);
        let fastest = number(fastest, usize::from(fastest < 100.0 && fastest.fract() > 0.05));
        let title = match run.program {
            Program::Constant => format!("{pulses} steps at a constant frequency of {fastest} Hz"),
            Program::Positioning => format!("A positioning cycle of {pulses} steps, up to {fastest} Hz"),
        };
        let torque = (report.load_torque > 0.0).then(|| format!(", against {} N·m", report.load_torque));
        let disc =
            (report.load_inertia > 0.0).then(|| format!(", with a disc of {} kg·m²", report.load_inertia));
        let load = [torque, disc].into_iter().flatten().collect::<String>();
        let load = if load.is_empty() { ", without a load" } else { &load };
        let ended = if report.interrupted { "; ended before its end" } else { "" };
        let Report { motor, commanded, measured, .. } = report;
        let subtitle = format!("{motor}{load}; {commanded} steps given, {measured} made{ended}");
        Self {
            title,
            subtitle,
            recording,
            direction: run.direction,
            parts: (run.program == Program::Positioning).then(|| run.train.steps()),
            first_lost: report.first_lost,
        }
    }

    /// Draws it.
    ///
    /// # Errors
    /// If the recording is of a sampling frequency that the bench does not have, or no such filter can be made.
    pub fn picture(&self, graph: Graph, filters: Filters) -> Result<Picture, BenchPlotError> {
        let shown = Shown::new(self)?;
        let cutoff = filters.cutoff.unwrap_or(graph.cutoff());
        let choice = Choice { cutoff, taps: filters.taps };
        match graph {
            Graph::Position => Ok(shown.position()?),
            Graph::Speed => shown.speed(choice),
            Graph::Profile => shown.profile(choice),
        }
    }
}

/// A run with its units.
struct Shown<'a> {
    run: &'a Plotted<'a>,
    sampling: Sampling,
    /// From the beginning of the train to the last sample, in seconds.
    time: Range<f64>,
    /// 1 forward, −1 towards the origin.
    sign: f64,
}

const SECONDS: &str = "time from the start of the train, s";

impl<'a> Shown<'a> {
    fn new(run: &'a Plotted<'a>) -> Result<Self, SamplingError> {
        let sampling = Sampling::new(run.recording.sampling_hertz)?;
        let last = run.recording.positions.len().saturating_sub(1);
        let end = seconds(sampling.tick_of(last as u64));
        let sign = if run.direction == Direction::Forward { 1.0 } else { -1.0 };
        Ok(Self { run, sampling, time: 0.0..end.max(1e-3), sign })
    }

    fn position(&self) -> Result<Picture, PlotError> {
        let degrees = 360.0 / f64::from(self.run.recording.half_steps_per_turn);
        let legend = vec![
            Entry::line("commanded: where each pulse turns the field to", COMMANDED),
            Entry::line("real: what the encoder counts", REAL),
        ];
        let commanded = self.commanded(degrees * self.sign);
        let real = self.real(360.0 / f64::from(self.run.recording.counts_per_turn));
        let both = |heading: &str, x: Range<f64>, area: &Area<'_>| -> Drawn {
            let lines = [(&commanded, &COMMANDED, 1.25), (&real, &REAL, 1.75)]
                .map(|(line, color, pixels)| (clipped(line, &x), color, pixels));
            let y = reach(lines.iter().flat_map(|(line, ..)| line), 0.06);
            let chart = frame(heading, x, y, "degrees").draw(area)?;
            for (line, color, pixels) in lines {
                polyline(&chart, thinned(line, area), stroke(color, pixels))?;
            }
            self.first_lost(&chart)
        };
        self.picture(legend, 640, |area| {
            let (whole, close) = area.split_vertically(px(300.0));
            both("Angular position", self.time.clone(), &whole)?;
            both(&self.enlarged(), self.close_up(), &close)
        })
    }

    fn speed(&self, choice: Choice) -> Result<Picture, BenchPlotError> {
        let degrees = 360.0 / f64::from(self.run.recording.counts_per_turn);
        let speeds = self.speeds(degrees, choice)?;
        let edges = between_edges(&self.run.recording.positions, self.sampling);
        let edges: Vec<_> = edges.iter().map(|point| (point.seconds, point.speed * degrees)).collect();
        let legend = vec![
            Entry::line("real, filtered", REAL),
            Entry::line("instantaneous: the derivative filter alone", INSTANT),
            Entry::line("by the time between the encoder's edges", EDGES),
        ];
        let [instant, filtered] = [&speeds.instant, &speeds.filtered].map(|points| line(points));
        let all = |heading: &str, x: Range<f64>, with_edges: bool, area: &Area<'_>| -> Drawn {
            let lines = [(&instant, &INSTANT, 1.0), (&filtered, &REAL, 1.75)]
                .map(|(line, color, pixels)| (clipped(line, &x), color, pixels));
            let y = reach(lines.iter().flat_map(|(line, ..)| line).chain(&[(0.0, 0.0)]), 0.12);
            let chart = frame(heading, x.clone(), y.clone(), "degrees/s").draw(area)?;
            if with_edges {
                let inside = clipped(&edges, &x).into_iter().map(|(t, v)| (t, v.clamp(y.start, y.end)));
                polyline(&chart, thinned(inside.collect(), area), stroke(&EDGES, 1.0))?;
            }
            polyline(&chart, vec![(x.start, 0.0), (x.end, 0.0)], stroke(&GREY, 1.0))?;
            for (line, color, pixels) in lines {
                polyline(&chart, thinned(line, area), stroke(color, pixels))?;
            }
            self.first_lost(&chart)
        };
        Ok(self.picture(legend, 660, |area| {
            let (whole, close) = area.split_vertically(px(300.0));
            let heading = format!("Angular speed; {}", self.filters(choice, &speeds));
            all(&heading, self.time.clone(), false, &whole)?;
            all(&self.enlarged(), self.close_up(), true, &close)
        })?)
    }

    fn profile(&self, choice: Choice) -> Result<Picture, BenchPlotError> {
        let half_steps = self.sign * f64::from(self.run.recording.half_steps_per_turn)
            / f64::from(self.run.recording.counts_per_turn);
        let speeds = self.speeds(half_steps, choice)?;
        let (prescribed, real) = (self.prescribed(), line(&speeds.filtered));
        let lag = self.lag(half_steps);
        let legend =
            vec![Entry::line("prescribed: 1 MHz / TC", COMMANDED), Entry::line("real, filtered", REAL)];
        Ok(self.picture(legend, 710, |area| {
            let (top, below) = area.split_vertically(px(370.0));
            let mut y = reach(prescribed.iter().chain(&real), 0.05);
            // Room for the names of the parts.
            y.end += (y.end - y.start) * 0.14;
            let heading = format!("Speed; {}", self.filters(choice, &speeds));
            let chart = frame(&heading, self.time.clone(), y, "steps/s").draw(&top)?;
            self.parts(&chart)?;
            polyline(&chart, vec![(self.time.start, 0.0), (self.time.end, 0.0)], stroke(&GREY, 1.0))?;
            polyline(&chart, thinned(prescribed, &top), stroke(&COMMANDED, 1.75))?;
            polyline(&chart, thinned(real, &top), stroke(&REAL, 1.5))?;
            self.first_lost(&chart)?;
            self.lags(lag, &below)
        })?)
    }

    /// The frame with the lag, and the half cycle at which the torque is zero.
    fn lags(&self, lag: Vec<(f64, f64)>, area: &Area<'_>) -> Drawn {
        let half_cycle = f64::from(HALF_STEPS_PER_CYCLE) / 2.0;
        let limits = [(0.0, -half_cycle), (0.0, half_cycle)];
        let y = reach(lag.iter().chain(&limits), 0.1);
        let y_top = y.end;
        let heading = "How far the shaft is behind the pulses; beyond half a cycle it is not pulled back";
        let chart = frame(heading, self.time.clone(), y, "steps").draw(area)?;
        for (_, limit) in limits {
            dashes(&chart, (self.time.start, limit), (self.time.end, limit), &GREY, 4.0)?;
        }
        let words = Words::new(12.0).color(GREY).ends().below();
        // If steps are lost, both limits are close to 0.
        if y_top < 5.0 * half_cycle {
            words.mark(&chart, (self.time.end, half_cycle), (-6.0, 4.0), "half a cycle: 4 steps")?;
        }
        polyline(&chart, thinned(lag, area), stroke(&REAL, 1.0))?;
        self.first_lost(&chart)
    }

    /// `Ns_a`, `Ns_b` and `Ns_c`, each above its part.
    fn parts(&self, chart: &Chart<'_, '_>) -> Drawn {
        let Some(PartSteps { a, b, c }) = self.run.parts else { return Ok(()) };
        let top = chart.plotting_area().get_y_range().end;
        let bottom = chart.plotting_area().get_y_range().start;
        let (mut begin, mut pulses, mut row) = (0.0, 0_usize, 0);
        for (name, steps) in [("Ns_a", a), ("Ns_b", b), ("Ns_c", c)] {
            pulses += steps as usize;
            let last = pulses.checked_sub(1).and_then(|last| self.run.recording.commanded.get(last));
            let (Some(last), true) = (last, steps > 0) else { continue };
            let end = seconds(last.at);
            dashes(chart, (end, bottom), (end, top), &GREY, 4.0)?;
            let text = format!("{name} = {}", number(steps.into(), 0));
            let room = chart.backend_coord(&(end, 0.0)).0 - chart.backend_coord(&(begin, 0.0)).0;
            // One that is wider than its part stands lower than the one beside it.
            row = if px(width(&text, 12.0) + 8.0) > room { 1 - row } else { 0 };
            let at = (f64::midpoint(begin, end), top);
            let words = Words::new(12.0).color(GREY).centered().below();
            words.mark(chart, at, (0.0, 5.0 + 16.0 * f64::from(row)), &text)?;
            begin = end;
        }
        Ok(())
    }

    /// Where the first steps were lost, if it is in this frame; the legend says which they were.
    fn first_lost(&self, chart: &Chart<'_, '_>) -> Drawn {
        let Some(at) = self.run.first_lost.map(|place| place.time_s) else { return Ok(()) };
        let (x, y) = (chart.plotting_area().get_x_range(), chart.plotting_area().get_y_range());
        if !x.contains(&at) {
            return Ok(());
        }
        dashes(chart, (at, y.start), (at, y.end), &ALARM, 4.0)
    }

    fn picture(
        &self,
        mut legend: Vec<Entry>,
        height: u32,
        paint: impl FnOnce(&Area<'_>) -> Drawn,
    ) -> Result<Picture, PlotError> {
        if let Some(place) = self.run.first_lost {
            let (pulse, speed) = (number_of(place.pulse), number(place.frequency, 0));
            legend.push(Entry::line(format!("steps lost from pulse {pulse} on, at {speed} steps/s"), ALARM));
        }
        let head = Head { title: &self.run.title, subtitle: &self.run.subtitle, legend };
        picture(Size { width: WIDTH, height }, &self.run.title, |root| {
            head.draw(root, WIDTH)?;
            let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
            paint(&rest)
        })
    }

    /// The filters in words.
    fn filters(&self, choice: Choice, speeds: &Speeds) -> String {
        let taps = choice.taps.unwrap_or_else(|| Taps::of_a_millisecond(self.sampling));
        format!(
            "derivative filter of {} taps at {} kHz, low pass {} Hz; their {} ms are put back",
            taps.get(),
            number(f64::from(self.sampling.hertz()) / 1e3, 0),
            number(choice.cutoff.hertz(), 0),
            number(speeds.latency * 1e3, 2)
        )
    }

    /// In units of so much a count.
    fn speeds(&self, a_count: f64, choice: Choice) -> Result<Speeds, FilterError> {
        Speeds::new(counts(self.run.recording).map(|count| count * a_count), self.sampling, choice)
    }

    /// Where the pulses turn the field to, as a staircase of so high steps.
    fn commanded(&self, step: f64) -> Vec<(f64, f64)> {
        let mut points = vec![(0.0, 0.0)];
        for (pulse, number) in self.run.recording.commanded.iter().zip(1_u32..) {
            let at = seconds(pulse.at);
            points.extend([(at, step * f64::from(number - 1)), (at, step * f64::from(number))]);
        }
        let last = points.last().map_or(0.0, |point| point.1);
        points.push((self.time.end, last));
        points
    }

    /// Where the encoder is, in units of so much a count; what does not change has no points.
    fn real(&self, a_count: f64) -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (count, sample) in counts(self.run.recording).zip(0_u64..) {
            let point = (seconds(self.sampling.tick_of(sample)), count * a_count);
            let [before, last] = points.last_chunk().map_or([None; 2], |pair: &[_; 2]| pair.map(Some));
            let stands = |p: Option<(f64, f64)>| p.is_some_and(|p| p.1.to_bits() == point.1.to_bits());
            if stands(before) && stands(last) {
                points.pop();
            }
            points.push(point);
        }
        points
    }

    /// The speed of every period, in pulses per second, as a staircase; equal ones are one step.
    fn prescribed(&self) -> Vec<(f64, f64)> {
        let mut points = vec![(0.0, 0.0)];
        let (mut begin, mut clocks) = (0.0, 0);
        for pulse in &self.run.recording.commanded {
            let speed = 1.0 / period(pulse);
            if pulse.clocks == clocks {
                points.pop();
            } else {
                points.push((begin, speed));
            }
            (begin, clocks) = (seconds(pulse.at), pulse.clocks);
            points.push((begin, speed));
        }
        points.extend([(begin, 0.0), (self.time.end, 0.0)]);
        points
    }

    /// The pulses given less the steps made, at every sample.
    fn lag(&self, half_steps: f64) -> Vec<(f64, f64)> {
        let mut pulses = self.run.recording.commanded.iter().peekable();
        let mut given = 0_u32;
        let samples = counts(self.run.recording).zip(0_u64..);
        samples
            .map(|(count, sample)| {
                let tick = self.sampling.tick_of(sample);
                while pulses.next_if(|pulse| pulse.at <= tick).is_some() {
                    given += 1;
                }
                (seconds(tick), f64::from(given) - count * half_steps)
            })
            .collect()
    }

    /// The pulse in the middle and what comes of it, or how steps are lost: a period and a half, or 20 ms if that is more.
    fn close_up(&self) -> Range<f64> {
        let pulses = &self.run.recording.commanded;
        let Some(middle) = pulses.get(pulses.len().saturating_sub(1) / 2) else { return self.time.clone() };
        let span = (1.5 * period(middle)).max(0.02).min(self.time.end);
        let begin = match self.run.first_lost {
            Some(place) => place.time_s - 0.5 * span,
            None => seconds(middle.at) - 0.1 * span,
        };
        let begin = begin.clamp(0.0, self.time.end - span);
        begin..begin + span
    }

    fn enlarged(&self) -> String {
        if self.run.first_lost.is_some() {
            return "Enlarged: where the first steps are lost".into();
        }
        let middle = self.run.recording.commanded.len().div_ceil(2);
        format!("Enlarged: pulse {} and what comes of it", number_of(middle as u64))
    }
}

/// The mean frequency of the constant part; of a train that has none, that of its shortest period. Single counts are whole
/// clocks, and so a little off.
fn top_frequency(PartSteps { a, b, .. }: PartSteps, recording: &Recording) -> f64 {
    let at = |pulse: u32| match pulse.checked_sub(1) {
        Some(index) => recording.commanded.get(index as usize).map(|pulse| seconds(pulse.at)),
        None => Some(0.0),
    };
    match (at(a), at(a + b)) {
        (Some(from), Some(to)) if to > from => f64::from(b) / (to - from),
        _ => recording.commanded.iter().map(|pulse| 1.0 / period(pulse)).fold(0.0, f64::max),
    }
}

fn frame<'a>(heading: &'a str, x: Range<f64>, y: Range<f64>, y_name: &'a str) -> Frame<'a> {
    Frame { heading, x, y, x_name: Some(SECONDS), y_name: Some(y_name) }
}

/// What points take up, and air above and below it.
fn reach<'a>(points: impl Iterator<Item = &'a (f64, f64)>, air: f64) -> Range<f64> {
    let all = points.map(|point| (point.1, point.1)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let (low, high) = all.unwrap_or((0.0, 1.0));
    let air = (high - low).max(1.0) * air;
    low - air..high + air
}

/// The period that a pulse ends, in seconds.
fn period(pulse: &CommandedPulse) -> f64 {
    Clocks(pulse.clocks.into()).ticks().as_seconds()
}

fn line(points: &[Point]) -> Vec<(f64, f64)> {
    points.iter().map(|point| (point.seconds, point.speed)).collect()
}

#[expect(clippy::cast_precision_loss, reason = "no shaft turns 2^52 counts far")]
fn counts(recording: &Recording) -> impl Iterator<Item = f64> + '_ {
    recording.positions.iter().map(|&count| count as f64)
}

#[expect(clippy::cast_precision_loss, reason = "no train has 2^52 pulses")]
fn number_of(pulse: u64) -> String {
    number(pulse as f64, 0)
}
