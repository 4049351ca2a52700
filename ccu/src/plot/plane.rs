//! The state plane of \[F\] Fig 3: speed over position, one frame an axis, with the limit zones up to e1 and from e2 on,
//! the reference step eR, and the points in which movements ended.

use plotters::prelude::*;

use super::Subject;
use super::moves::Limits;
use super::sheet::{
    Area, Chart, Drawn, Frame, GREY, INK, Words, color, dashes, polyline, px, rectangle, stroke,
};
use super::trace::{AxisTrace, Window};

/// A movement that uses less than this part of the rail is shown without the rest of it.
const WORTH_THE_RAIL: f64 = 0.2;

/// How many frames stand side by side.
fn columns(axes: usize) -> usize {
    match axes {
        0..=3 => axes.max(1),
        4 => 2,
        _ => 3,
    }
}

/// How many rows of frames there are.
pub(super) fn rows(axes: usize) -> usize {
    axes.div_ceil(columns(axes)).max(1)
}

/// Draws a state plane for every axis.
pub(super) fn draw(axes: &[&AxisTrace], subject: &Subject<'_>, window: Window, area: &Area<'_>) -> Drawn {
    let speeds = axes.iter().flat_map(|trace| trajectory(trace, window)).flatten().map(|point| point.1);
    let (low, high) = speeds.fold((0.0_f64, 0.0_f64), |(low, high), speed| (low.min(speed), high.max(speed)));
    let air = (high - low).max(1.0) * 0.12;
    let areas = area.split_evenly((rows(axes.len()), columns(axes.len())));
    for (trace, area) in axes.iter().zip(&areas) {
        let name = subject.names.of(trace.axis);
        let heading = format!("State plane of {name}");
        let limits = subject.config.axis(trace.axis).map(Limits::new);
        let frame = Frame {
            heading: &heading,
            x: reach(trace, window, limits.as_ref()),
            y: low - air..high + air,
            x_name: Some("position e, steps from the origin"),
            y_name: Some("speed, steps/s"),
        };
        let chart = frame.draw(area)?;
        if let Some(limits) = limits {
            zones(&limits, &frame, &chart)?;
        }
        polyline(&chart, vec![(frame.x.start, 0.0), (frame.x.end, 0.0)], stroke(&GREY, 1.0))?;
        for run in trajectory(trace, window) {
            polyline(&chart, run, stroke(&color(trace.axis), 1.75))?;
        }
        for rest in trace.rests().filter(|rest| window.holds(rest.tick)) {
            let Some(position) = rest.position else { continue };
            let dot = Circle::new((f64::from(position.0), 0.0), px(3.0), INK.filled());
            chart.plotting_area().draw(&dot)?;
        }
    }
    Ok(())
}

/// (position, speed) in runs in which the position is known. An axis begins and ceases to move with a jump.
fn trajectory(trace: &AxisTrace, window: Window) -> Vec<Vec<(f64, f64)>> {
    let inside: Vec<_> = trace.samples.iter().filter(|sample| window.holds(sample.tick)).collect();
    let mut runs = vec![vec![]];
    let mut before: Option<f64> = None;
    for sample in inside {
        let (Some(position), Some(run)) = (sample.position, runs.last_mut()) else {
            runs.push(vec![]);
            before = None;
            continue;
        };
        let at = f64::from(position.0);
        // Down to rest: at the speed that it had, then at none.
        if let Some(speed) = before.filter(|_| !sample.moves()) {
            run.push((at, speed));
        }
        run.push((at, sample.speed));
        before = sample.moves().then_some(sample.speed);
    }
    for run in &mut runs {
        run.dedup();
    }
    runs
}

/// The positions that are shown: the rail, or the movements alone if they use little of it.
fn reach(trace: &AxisTrace, window: Window, limits: Option<&Limits>) -> std::ops::Range<f64> {
    let points = trajectory(trace, window);
    let positions = points.iter().flatten().map(|point| (point.0, point.0));
    let (low, high) = positions.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((0.0, 1.0));
    let rail = limits.map(|limits| limits.lower_zone.start..limits.upper_zone.end);
    let (low, high) = match rail {
        Some(rail) if high - low >= WORTH_THE_RAIL * (rail.end - rail.start) => {
            (low.min(rail.start), high.max(rail.end))
        }
        _ => (low, high),
    };
    let air = (high - low).max(10.0) * 0.03;
    low - air..high + air
}

fn zones(limits: &Limits, frame: &Frame<'_>, chart: &Chart<'_, '_>) -> Drawn {
    let (x, y) = (&frame.x, &frame.y);
    for zone in [&limits.lower_zone, &limits.upper_zone] {
        let zone = zone.start.max(x.start)..zone.end.min(x.end);
        if zone.start < zone.end {
            rectangle(chart, zone, y.clone(), &RGBColor(170, 170, 170).mix(0.35))?;
        }
    }
    let line = |at: f64| dashes(chart, (at, y.start), (at, y.end), &GREY.mix(0.8), 4.0);
    let shown = |at: f64| x.contains(&at);
    let words = || Words::new(12.0).color(GREY);
    let name = |at: f64, text: &str| words().below().mark(chart, (at, y.end), (4.0, 4.0), text);
    let (e1, reference) = (limits.lower_zone.end, limits.reference);
    let pixel = |at: f64| chart.backend_coord(&(at, 0.0)).0;
    let close = shown(e1) && shown(reference) && pixel(reference) - pixel(e1) < px(24.0);
    if shown(e1) {
        line(e1)?;
        name(if close { reference } else { e1 }, if close { "e1, eR" } else { "e1" })?;
    }
    if shown(reference) {
        line(reference)?;
        if !close {
            name(reference, "eR")?;
        }
    }
    if shown(limits.upper_zone.start) {
        line(limits.upper_zone.start)?;
        words().ends().below().mark(chart, (limits.upper_zone.start, y.end), (-4.0, 4.0), "e2")?;
    }
    Ok(())
}
