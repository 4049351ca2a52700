//! What axes did over time: speed, position and sense points, one panel under the other on one time axis, then the state
//! planes. Between two samples a straight line is drawn, because nothing is known there.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::RGBAColor;
use supersigma_config::AxisConfig;
use supersigma_protocol::AxisNumber;

use super::sense::{Group, alarms};
use super::sheet::{
    Area, Chart, Drawn, Entry, Frame, GREY, HEADING, Head, LABELS, NARROWEST, NO_LABELS, Words, color,
    dashes, picture, polyline, px, rectangle, stroke,
};
use super::trace::{AxisTrace, Sample, Trace, Window, seconds};
use super::{Picture, PlotError, Size, Subject, Timing, What, gantt, plane};

/// What is to be seen, and how.
#[derive(Debug, Clone, Copy)]
pub struct Shown<'a> {
    /// Of which set.
    pub subject: Subject<'a>,
    /// Which axes.
    pub axes: &'a [AxisNumber],
    /// Which panels; their order is always the same.
    pub what: &'a [What],
    /// When.
    pub window: Window,
    /// How large; as large as it takes if not given.
    pub size: Option<Size>,
}

/// The width of a picture whose size was not given.
const WIDTH: u32 = 1_160;

/// Draws the panels that are wanted.
///
/// # Errors
/// If the size that was asked for has no room for them.
pub fn moves(trace: &Trace, timing: &Timing, shown: &Shown<'_>) -> Result<Picture, PlotError> {
    let Shown { subject, window, .. } = *shown;
    let axes: Vec<_> = trace.axes.iter().filter(|trace| shown.axes.contains(&trace.axis)).collect();
    let view = View { trace, timing, axes, subject, window };
    let mut what = shown.what.to_vec();
    what.sort_unstable();
    what.dedup();
    let legend = match what.as_slice() {
        [What::Timing] => gantt::legend(timing),
        _ => view
            .axes
            .iter()
            .map(|trace| Entry::line(subject.names.of(trace.axis), color(trace.axis)))
            .collect(),
    };
    let head = Head { title: subject.title, subtitle: subject.subtitle, legend };
    let last_in_time = what.iter().rposition(|what| *what != What::Plane);
    let panels: Vec<_> =
        what.iter().enumerate().map(|(at, &what)| view.panel(what, last_in_time == Some(at))).collect();
    let (size, heights) = layout(&head, &panels, shown.size)?;
    picture(size, subject.title, |root| {
        head.draw(root, size.width)?;
        let (_, mut rest) = root.split_vertically(px(head.height(size.width)));
        for (panel, height) in panels.iter().zip(heights) {
            let (area, below) = rest.split_vertically(px(height));
            view.draw(panel, &area)?;
            rest = below;
        }
        Ok(())
    })
}

/// One panel: its height in pixels as it should be, and as it may be.
struct Panel {
    what: What,
    natural: f64,
    least: f64,
    /// Whether the time is written below it.
    labelled: bool,
}

/// The picture's size and the panels' heights in it.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some thousands of pixels at most"
)]
fn layout(head: &Head<'_>, panels: &[Panel], asked: Option<Size>) -> Result<(Size, Vec<f64>), PlotError> {
    let width = asked.map_or(WIDTH, |size| size.width);
    let (above, below) = (head.height(width), 8.0);
    let sum = |height: fn(&Panel) -> f64| panels.iter().map(height).sum::<f64>();
    let (natural, least) = (sum(|panel| panel.natural), sum(|panel| panel.least));
    let Some(asked) = asked else {
        let size = Size { width, height: (above + natural + below).ceil() as u32 };
        return Ok((size, panels.iter().map(|panel| panel.natural).collect()));
    };
    let room = f64::from(asked.height) - above - below;
    if asked.width < NARROWEST || room < least {
        let needed =
            Size { width: NARROWEST.max(asked.width), height: (above + least + below).ceil() as u32 };
        return Err(PlotError::TooSmall { asked, needed });
    }
    // What there is above the least goes to those that can use it.
    let share = if natural > least { (room - least) / (natural - least) } else { 0.0 };
    let heights = panels.iter().map(|panel| panel.least + (panel.natural - panel.least) * share).collect();
    Ok((asked, heights))
}

/// What is drawn.
struct View<'a> {
    trace: &'a Trace,
    timing: &'a Timing,
    axes: Vec<&'a AxisTrace>,
    subject: Subject<'a>,
    window: Window,
}

const TIME: &str = "machine time since the set was switched on, s";

impl View<'_> {
    fn panel(&self, what: What, labelled: bool) -> Panel {
        let frame = HEADING + if labelled { LABELS } else { NO_LABELS };
        let (natural, least) = match what {
            What::Speed | What::Position => (frame + 210.0, frame + 110.0),
            What::Sense => {
                let lanes: f64 = self.axes.iter().map(|trace| self.group(trace).height()).sum();
                (frame + lanes, frame + lanes)
            }
            What::Timing => {
                let lanes = gantt::height(self.timing, &self.subject);
                (frame + lanes, frame + lanes)
            }
            What::Plane => {
                let rows = f64::from(u32::try_from(plane::rows(self.axes.len())).unwrap_or(u32::MAX));
                (rows * 270.0, rows * 190.0)
            }
        };
        Panel { what, natural, least, labelled }
    }

    fn draw(&self, panel: &Panel, area: &Area<'_>) -> Drawn {
        let x_name = panel.labelled.then_some(TIME);
        match panel.what {
            What::Speed => self.speed(x_name, area),
            What::Position => self.position(x_name, area),
            What::Sense => self.sense(x_name, area),
            What::Timing => gantt::panel(self.timing, &self.subject, self.window, x_name, area),
            What::Plane => plane::draw(&self.axes, &self.subject, self.window, area),
        }
    }

    fn speed(&self, x_name: Option<&str>, area: &Area<'_>) -> Drawn {
        let x = self.window.seconds();
        let lines: Vec<_> =
            self.axes.iter().map(|trace| (trace.axis, clipped(&speeds(trace, self.window), &x))).collect();
        let (low, high) = extent(lines.iter().flat_map(|(_, points)| points)).unwrap_or((0.0, 1.0));
        let air = (high - low).max(1.0) * 0.06;
        let low = if low < 0.0 { low - air } else { 0.0 };
        let frame = Frame {
            heading: "Speed; below 0 towards the origin",
            x: x.clone(),
            y: low..high + air,
            x_name,
            y_name: Some("steps/s"),
        };
        let frame = if low < 0.0 { frame } else { Frame { heading: "Speed", ..frame } };
        let chart = frame.draw(area)?;
        polyline(&chart, vec![(x.start, 0.0), (x.end, 0.0)], stroke(&GREY, 1.0))?;
        for (axis, points) in lines {
            polyline(&chart, thinned(points, area), stroke(&color(axis), 1.75))?;
        }
        Ok(())
    }

    fn position(&self, x_name: Option<&str>, area: &Area<'_>) -> Drawn {
        let x = self.window.seconds();
        let lines: Vec<_> = self
            .axes
            .iter()
            .map(|trace| {
                let runs = positions(trace, self.window).into_iter().map(|run| clipped(&run, &x));
                (trace.axis, runs.filter(|run| !run.is_empty()).collect::<Vec<_>>())
            })
            .collect();
        let limits: Vec<_> = self
            .axes
            .iter()
            .filter_map(|trace| Some((trace.axis, Limits::new(self.subject.config.axis(trace.axis)?))))
            .collect();
        let known = extent(lines.iter().flat_map(|(_, runs)| runs.iter().flatten()));
        let y = reach(known.unwrap_or((0.0, 1.0)), limits.iter().map(|(_, limits)| limits));
        let heading = if self.axes.iter().any(|trace| starts_unknown(trace, self.window)) {
            "Position; no line where the card does not know it yet"
        } else {
            "Position"
        };
        let frame =
            Frame { heading, x: x.clone(), y: y.clone(), x_name, y_name: Some("steps from the origin") };
        let chart = frame.draw(area)?;
        for (axis, limits) in &limits {
            limits.draw(*axis, &x, &y, limits_are_named(&self.axes), &chart)?;
        }
        for (axis, runs) in lines {
            for run in runs {
                polyline(&chart, thinned(run, area), stroke(&color(axis), 1.75))?;
            }
        }
        Ok(())
    }

    fn sense(&self, x_name: Option<&str>, area: &Area<'_>) -> Drawn {
        let groups: Vec<_> = self.axes.iter().map(|trace| self.group(trace)).collect();
        let total: f64 = groups.iter().map(Group::height).sum();
        let frame = Frame {
            heading: "Sense points, alarms and faults; a filled lane is on",
            x: self.window.seconds(),
            y: 0.0..total.max(1.0),
            x_name,
            y_name: None,
        };
        let chart = frame.draw(area)?;
        let mut top = total;
        for group in groups {
            group.draw(self.subject.names.of(group.trace.axis).as_ref(), top, self.window, &chart)?;
            top -= group.height();
        }
        Ok(())
    }

    fn group<'a>(&'a self, trace: &'a AxisTrace) -> Group<'a> {
        let faults = self
            .trace
            .faults
            .iter()
            .filter(|(tick, axis, _)| *axis == trace.axis && self.window.holds(*tick));
        Group {
            trace,
            alarms: alarms(trace, self.window),
            faults: faults.map(|(tick, _, fault)| (*tick, format!("fault: {fault}"))).collect(),
        }
    }
}

/// With one axis there is room to say what the lines are.
fn limits_are_named(axes: &[&AxisTrace]) -> bool {
    axes.len() == 1
}

fn starts_unknown(trace: &AxisTrace, window: Window) -> bool {
    trace
        .samples
        .iter()
        .any(|sample| window.holds(sample.tick) && sample.moves() && sample.position.is_none())
}

/// The lowest and the highest value.
fn extent<'a>(points: impl Iterator<Item = &'a (f64, f64)>) -> Option<(f64, f64)> {
    points.map(|point| (point.1, point.1)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// Speed over time. Where the axis begins or ceases to move, the speed jumps.
pub(super) fn speeds(trace: &AxisTrace, window: Window) -> Vec<(f64, f64)> {
    let mut points = Vec::with_capacity(trace.samples.len());
    for pair in trace.samples.windows(2) {
        let [now, next] = [&pair[0], &pair[1]];
        points.push((seconds(now.tick), now.speed));
        if !now.moves() || !next.moves() {
            points.push((seconds(next.tick), now.speed));
        }
    }
    points.extend(trace.samples.last().map(|last| (seconds(last.tick), last.speed)));
    points.extend(stands(trace, window).map(|last| (seconds(window.to), last.speed)));
    points
}

/// Position over time, in runs in which it is known.
pub(super) fn positions(trace: &AxisTrace, window: Window) -> Vec<Vec<(f64, f64)>> {
    let mut runs: Vec<Vec<(f64, f64)>> = trace
        .samples
        .split(|sample| sample.position.is_none())
        .map(|run| {
            run.iter()
                .filter_map(|sample| Some((seconds(sample.tick), f64::from(sample.position?.0))))
                .collect()
        })
        .collect();
    let end = stands(trace, window).and_then(|last| Some((seconds(window.to), f64::from(last.position?.0))));
    if let Some(run) = runs.last_mut() {
        run.extend(end);
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// The last sample, if the axis stands there and so until the window's end.
fn stands(trace: &AxisTrace, window: Window) -> Option<&Sample> {
    trace.samples.last().filter(|last| !last.moves() && last.tick < window.to)
}

/// What of a line lies between two moments; where it crosses one of them there is a point.
pub(super) fn clipped(points: &[(f64, f64)], x: &Range<f64>) -> Vec<(f64, f64)> {
    let mut inside = Vec::new();
    for (at, &point) in points.iter().enumerate() {
        if let Some(&before) = at.checked_sub(1).and_then(|at| points.get(at)) {
            let crossings = [x.start, x.end].map(|edge| (before.0 < edge && edge < point.0).then_some(edge));
            inside.extend(crossings.into_iter().flatten().map(|edge| {
                let share = (edge - before.0) / (point.0 - before.0);
                (edge, before.1 + (point.1 - before.1) * share)
            }));
        }
        if (x.start..=x.end).contains(&point.0) {
            inside.push(point);
        }
    }
    inside
}

/// No more points than the area can show: of each column the first, the lowest, the highest and the last.
pub(super) fn thinned(points: Vec<(f64, f64)>, area: &Area<'_>) -> Vec<(f64, f64)> {
    let columns = area.dim_in_pixel().0 as usize;
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return points };
    if points.len() <= 4 * columns || last.0 <= first.0 {
        return points;
    }
    let (start, span) = (first.0, last.0 - first.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "columns are some thousands"
    )]
    let column = |x: f64| ((x - start) / span * columns as f64) as i64;
    let mut few = Vec::with_capacity(4 * columns);
    for of_column in points.chunk_by(|a, b| column(a.0) == column(b.0)) {
        let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (lowest, highest) = (of_column.iter().min_by(by_height), of_column.iter().max_by(by_height));
        let mut kept: Vec<_> =
            [of_column.first(), lowest, highest, of_column.last()].into_iter().flatten().copied().collect();
        kept.sort_by(|a, b| a.0.total_cmp(&b.0));
        kept.dedup();
        few.extend(kept);
    }
    few
}

/// Where an axis may go, and where its rail ends, in steps from the origin.
pub(super) struct Limits {
    /// The permitted positions.
    pub(super) travel: Range<f64>,
    /// From the lower end of the rail to e1.
    pub(super) lower_zone: Range<f64>,
    /// From e2 to the upper end of the rail.
    pub(super) upper_zone: Range<f64>,
    /// eR.
    pub(super) reference: f64,
}

impl Limits {
    pub(super) fn new(axis: &AxisConfig) -> Self {
        let rail = &axis.rail;
        // The origin is the first step out of the lower zone.
        let position = |step: u32| f64::from(step) - f64::from(rail.lower_zone.0) - 1.0;
        Self {
            travel: f64::from(axis.travel.min.0)..f64::from(axis.travel.max.0),
            lower_zone: position(0)..position(rail.lower_zone.0),
            upper_zone: position(rail.upper_zone.0)..position(rail.length.0),
            reference: position(rail.reference.0),
        }
    }

    fn draw(
        &self,
        axis: AxisNumber,
        x: &Range<f64>,
        y: &Range<f64>,
        named: bool,
        chart: &Chart<'_, '_>,
    ) -> Drawn {
        let tint: RGBAColor = color(axis).mix(0.08);
        for zone in [&self.lower_zone, &self.upper_zone] {
            let zone = zone.start.max(y.start)..zone.end.min(y.end);
            if zone.start < zone.end {
                rectangle(chart, x.clone(), zone, &tint)?;
            }
        }
        for (limit, name) in [(self.travel.start, "travel min"), (self.travel.end, "travel max")] {
            if y.contains(&limit) {
                dashes(chart, (x.start, limit), (x.end, limit), &color(axis).mix(0.6), 5.0)?;
                if named {
                    Words::new(11.0).color(GREY).ends().above().mark(
                        chart,
                        (x.end, limit),
                        (-6.0, -3.0),
                        name,
                    )?;
                }
            }
        }
        Ok(())
    }
}

/// The positions that are shown: all that were taken, and the limits that are near them.
fn reach<'a>((low, high): (f64, f64), limits: impl Iterator<Item = &'a Limits>) -> Range<f64> {
    let span = (high - low).max(10.0);
    let near = (low - 0.35 * span, high + 0.35 * span);
    let (mut from, mut to) = (low, high);
    for limits in limits {
        for limit in [limits.lower_zone.start, limits.travel.start, limits.travel.end, limits.upper_zone.end]
        {
            if limit >= near.0 && limit <= near.1 {
                (from, to) = (from.min(limit), to.max(limit));
            }
        }
    }
    let air = (to - from).max(10.0) * 0.05;
    from - air..to + air
}
