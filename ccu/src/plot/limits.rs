//! The characteristic of a motor: torque over speed, with the regions between its limits. Above the whole of it, below
//! the beginning, where it starts and stops.

use axis_worker::motor::Characteristic;
use plotters::prelude::*;

use super::sheet::{
    Area, Chart, Drawn, Entry, Frame, GREY, Head, Words, nth_color, picture, polyline, px, stroke,
};
use super::{Picture, PlotError, Size};
use crate::bench::limits::Limits;

const WIDTH: u32 = 960;
const START_STOP: RGBColor = RGBColor(0, 158, 115);
const PULL_IN: RGBColor = RGBColor(0, 114, 178);
const PULL_OUT: RGBColor = RGBColor(213, 94, 0);
/// The regions below those limits, on white.
const STARTS_AND_STOPS: RGBColor = RGBColor(204, 232, 221);
const STARTS: RGBColor = RGBColor(214, 230, 243);
const RAMP_ONLY: RGBColor = RGBColor(252, 234, 217);
/// The beginning goes so far beyond the largest pull-in.
const CLOSE: f64 = 1.6;
/// More discs than this are not told apart.
pub const MOST_DISCS: usize = 5;

type Limit = fn(&Characteristic) -> Option<f64>;

const LIMITS: [(Limit, RGBColor, RGBColor, &str); 3] = [
    (|point| point.pull_out, PULL_OUT, RAMP_ONLY, "pull-out"),
    (|point| point.pull_in, PULL_IN, STARTS, "pull-in"),
    (|point| point.start_stop, START_STOP, STARTS_AND_STOPS, "start-stop"),
];

/// Draws the limits of one disc with their regions, or those of several as lines. `top` is how far pull-out was looked for,
/// half steps/s.
///
/// # Errors
/// If the drawing library refuses.
pub fn limits(limits: &[Limits], top: f64, title: &str, subtitle: &str) -> Result<Picture, PlotError> {
    let every = || limits.iter().flat_map(|limits| &limits.points);
    let most = |limit: Limit| every().filter_map(limit).fold(0.0, f64::max);
    let beyond = every().any(|point| point.pull_out.is_none());
    let furthest = if beyond { top } else { most(|point| point.pull_out) * 1.08 }.max(100.0);
    let close = (most(|point| point.pull_in.or(point.start_stop)) * CLOSE).clamp(50.0, furthest);
    let torque = every().map(|point| point.torque).fold(0.1, f64::max) * 1.06;
    let head = Head { title, subtitle, legend: legend(limits) };
    let draw = |root: &Area<'_>| -> Drawn {
        head.draw(root, WIDTH)?;
        let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
        let (whole, start) = rest.split_vertically(px(340.0));
        let which =
            if limits.len() > 1 { ": thick pull-in, left of it start-stop, right pull-out" } else { "" };
        panel(limits, top, &format!("The whole characteristic{which}"), furthest, torque, &whole)?;
        panel(limits, top, "The start region, enlarged", close, torque, &start)
    };
    picture(Size { width: WIDTH, height: 760 }, title, draw)
}

fn legend(limits: &[Limits]) -> Vec<Entry> {
    if let [_] = limits {
        return vec![
            Entry::filled("starts, and stops after any pulse", STARTS_AND_STOPS),
            Entry::filled("starts", STARTS),
            Entry::filled("only a ramp leads there", RAMP_ONLY),
            Entry::line("start-stop", START_STOP),
            Entry::line("pull-in", PULL_IN),
            Entry::line("pull-out", PULL_OUT),
        ];
    }
    let disc = |(n, limits): (usize, &Limits)| {
        Entry::line(format!("a disc of {} kg·m²", limits.inertia), nth_color(n))
    };
    limits.iter().enumerate().map(disc).collect()
}

fn panel(limits: &[Limits], top: f64, heading: &str, to: f64, torque: f64, area: &Area<'_>) -> Drawn {
    let frame = Frame {
        heading,
        x: 0.0..to,
        y: 0.0..torque,
        x_name: Some("half steps/s"),
        y_name: Some("torque of a brake, N·m"),
    };
    let chart = frame.draw(area)?;
    if let [only] = limits {
        for (limit, _, region, _) in LIMITS {
            fill(&chart, curve(only, limit, top, to), region)?;
        }
        for (limit, color, _, _) in LIMITS {
            let curve = curve(only, limit, top, to);
            line(&chart, &curve, to, color, 2.0)?;
            let points = only.points.iter().filter_map(|point| Some((limit(point)?, point.torque)));
            for point in points.filter(|point| point.0 < to) {
                chart.plotting_area().draw(&Circle::new(point, px(2.5), color.filled()))?;
            }
        }
        return name_regions(&chart, only, top, to, torque);
    }
    for (n, one) in limits.iter().enumerate() {
        for (limit, _, _, name) in LIMITS {
            let width = if name == "pull-in" { 2.25 } else { 1.25 };
            line(&chart, &curve(one, limit, top, to), to, nth_color(n), width)?;
        }
    }
    Ok(())
}

/// A limit from the largest torque down to the smallest, cut off at `to`, with the point where it is cut. What does not start
/// has no limit of starting; what never falls out of step has one beyond `top`.
fn curve(limits: &Limits, limit: Limit, top: f64, to: f64) -> Vec<(f64, f64)> {
    let at = |point: &Characteristic| {
        let pull_out = Some(point.pull_out.unwrap_or(top));
        Some((limit(&Characteristic { pull_out, ..*point })?, point.torque))
    };
    let points: Vec<_> = limits.points.iter().rev().filter_map(at).collect();
    let mut cut = Vec::new();
    for (n, &(speed, torque)) in points.iter().enumerate() {
        if let Some(&(before, above)) = n.checked_sub(1).and_then(|n| points.get(n))
            && (before - to) * (speed - to) < 0.0
        {
            cut.push((to, above + (torque - above) * (to - before) / (speed - before)));
        }
        cut.push((speed.min(to), torque));
    }
    cut
}

/// Everything that is slower.
fn fill(chart: &Chart<'_, '_>, curve: Vec<(f64, f64)>, color: RGBColor) -> Drawn {
    let (Some(first), Some(last)) = (curve.first().copied(), curve.last().copied()) else { return Ok(()) };
    let corners = [(0.0, last.1), (0.0, first.1)];
    let outline: Vec<_> = curve.into_iter().chain(corners).collect();
    chart.plotting_area().draw(&Polygon::new(outline, color.filled()))
}

/// The curve, without what runs along the edge where it is cut off.
fn line(chart: &Chart<'_, '_>, curve: &[(f64, f64)], to: f64, color: RGBColor, width: f64) -> Drawn {
    let inside = curve.iter().position(|point| point.0 >= to).map_or(curve, |edge| &curve[..=edge]);
    polyline(chart, inside.to_vec(), stroke(&color, width))
}

/// Writes into each region what the motor does there, where there is room at a third of the largest torque.
fn name_regions(chart: &Chart<'_, '_>, limits: &Limits, top: f64, to: f64, torque: f64) -> Drawn {
    let height = torque / 3.0;
    let at = |limit: Limit| {
        let curve = curve(limits, limit, top, to);
        let near = |a: &&(f64, f64), b: &&(f64, f64)| (a.1 - height).abs().total_cmp(&(b.1 - height).abs());
        curve.iter().min_by(near).map_or(0.0, |point| point.0)
    };
    let [out, starts, stops] = LIMITS.map(|(limit, ..)| at(limit));
    let words = Words::new(12.5).color(GREY).centered();
    let pixels = |span: f64| f64::from(chart.plotting_area().dim_in_pixel().0) / 4.0 * span / to;
    for (from, until, name) in [
        (0.0, stops, "starts and stops"),
        (stops, starts, "starts"),
        (starts, out, "ramp only"),
        (out, to, "slips"),
    ] {
        if pixels(until - from) > super::sheet::width(name, 12.5) + 12.0 {
            words.mark(chart, (f64::midpoint(from, until), height), (0.0, 0.0), name)?;
        }
    }
    Ok(())
}
