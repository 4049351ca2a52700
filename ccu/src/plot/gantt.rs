//! Movements as bars, a lane an axis; below them the digital lines. What nobody does anything in is shaded.

use std::borrow::Cow;

use plotters::prelude::*;
use supersigma_protocol::{Direction, Tick, Ticks};

use super::sheet::{
    ALARM, Area, Chart, Drawn, Entry, FAINT, Frame, GREY, HEADING, Head, INK, LABELS, SHADE, Words, number,
    picture, polyline, px, rectangle, stroke, width,
};
use super::timing::{AxisTiming, Bar, Ending, Kind, Lane, Timing};
use super::trace::{Window, seconds};
use super::{Picture, PlotError, Size, Subject};

const AXIS_LANE: f64 = 32.0;
const LINE_LANE: f64 = 16.0;
const AIR: f64 = 6.0;
const WIDTH: u32 = 1_160;
const HALTED: RGBColor = RGBColor(213, 94, 0);
const OUTPUT: RGBColor = RGBColor(80, 80, 80);
const INPUT: RGBColor = RGBColor(160, 160, 160);

/// Draws everything that `timing` holds.
///
/// # Errors
/// If the drawing library refuses.
pub fn gantt(timing: &Timing, subject: &Subject<'_>) -> Result<Picture, PlotError> {
    let span = timing.span.unwrap_or(Window { from: Tick(0), to: Tick(0) });
    let window = Window { to: span.to.max(span.from + Ticks(1)), ..span };
    let head = Head { title: subject.title, subtitle: subject.subtitle, legend: legend(timing) };
    let above = head.height(WIDTH);
    let tall = above + HEADING + height(timing, subject) + LABELS + 8.0;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "seven axes and thirty-two lines"
    )]
    let size = Size { width: WIDTH, height: tall.ceil() as u32 };
    picture(size, subject.title, |root| {
        head.draw(root, size.width)?;
        let (_, area) = root.split_vertically(px(above));
        panel(timing, subject, window, Some("machine time since the set was switched on, s"), &area)
    })
}

/// What the colours mean, of those that are there.
pub(super) fn legend(timing: &Timing) -> Vec<Entry> {
    let bars = || timing.axes.iter().flat_map(|axis| &axis.bars);
    let kinds = [Kind::Move, Kind::Line, Kind::Origin, Kind::Reference].into_iter();
    let mut entries: Vec<_> = kinds
        .filter(|&kind| bars().any(|bar| bar.kind == kind))
        .map(|kind| Entry::filled(name(kind), color(kind)))
        .collect();
    if bars().any(|bar| bar.ending == Ending::Halted) {
        entries.push(Entry::filled("ended by a halt", HALTED));
    }
    if bars().any(|bar| matches!(bar.ending, Ending::Alarmed(_))) {
        entries.push(Entry::filled("ended by an alarm", ALARM));
    }
    entries.push(Entry::filled("no axis moves", FAINT));
    for (card, name, color) in [(&timing.outputs, "output on", OUTPUT), (&timing.inputs, "input on", INPUT)] {
        if card.words.iter().any(|(_, word)| *word != 0) {
            entries.push(Entry::filled(name, color));
        }
    }
    entries
}

/// The height of the lanes in pixels.
pub(super) fn height(timing: &Timing, subject: &Subject<'_>) -> f64 {
    let count = |lanes: usize| f64::from(u32::try_from(lanes).unwrap_or(u32::MAX));
    count(timing.axes.len()) * AXIS_LANE + count(lines(timing, subject).len()) * LINE_LANE + 2.0 * AIR
}

/// Draws the lanes of a window.
pub(super) fn panel(
    timing: &Timing,
    subject: &Subject<'_>,
    window: Window,
    x_name: Option<&str>,
    area: &Area<'_>,
) -> Drawn {
    let total = height(timing, subject);
    let x = window.seconds();
    let frame = Frame { heading: "Movements", x: x.clone(), y: 0.0..total, x_name, y_name: None };
    let chart = frame.draw(area)?;
    let axes_end = total - AIR - AXIS_LANE * f64::from(u32::try_from(timing.axes.len()).unwrap_or(u32::MAX));
    for span in timing.idle() {
        shade(&chart, span, window, axes_end..total, SHADE)?;
    }
    let mut y = total - AIR;
    for axis in &timing.axes {
        let middle = y - AXIS_LANE / 2.0;
        polyline(&chart, vec![(x.start, middle), (x.end, middle)], stroke(&FAINT, 1.0))?;
        let name = subject.names.of(axis.axis);
        Words::new(12.0).mark(&chart, (x.start, middle), (-82.0, -6.0), &name)?;
        let moving = format!("moves {}\u{2009}%", number(100.0 * share(axis, window), 0));
        Words::new(10.0).color(GREY).mark(&chart, (x.start, middle), (-82.0, 8.0), &moving)?;
        for bar in &axis.bars {
            draw_bar(bar, window, middle, &chart)?;
        }
        y -= AXIS_LANE;
    }
    for (name, lane, bit, color) in lines(timing, subject) {
        let middle = y - LINE_LANE / 2.0;
        polyline(&chart, vec![(x.start, middle), (x.end, middle)], stroke(&FAINT, 1.0))?;
        Words::new(10.5).color(GREY).mark(&chart, (x.start, middle), (-82.0, 0.0), &name)?;
        for span in lane.on(bit, window.to) {
            shade(&chart, span, window, middle - 4.0..middle + 4.0, color)?;
        }
        y -= LINE_LANE;
    }
    Ok(())
}

/// The part of the window in which an axis moves.
fn share(axis: &AxisTiming, window: Window) -> f64 {
    let inside = |bar: &Bar| bar.end.min(window.to).since(bar.begin.max(window.from)).as_seconds();
    axis.bars.iter().map(inside).sum::<f64>() / window.to.since(window.from).as_seconds()
}

/// The digital lines that were used: name, card, bit, colour.
fn lines<'a>(timing: &'a Timing, subject: &Subject<'a>) -> Vec<(Cow<'a, str>, &'a Lane, u8, RGBColor)> {
    let digital = &subject.config.digital;
    let outputs: Vec<_> = digital.outputs.iter().map(|line| (line.bit, line.name.as_str())).collect();
    let inputs: Vec<_> = digital.inputs.iter().map(|line| (line.bit, line.name.as_str())).collect();
    let of = |lane: &'a Lane, names: Vec<(u8, &'a str)>, card: &'static str, color| {
        (0..16).filter(|&bit| lane.uses(bit)).map(move |bit| {
            let name = names.iter().find(|line| line.0 == bit);
            let name = name.map_or_else(|| Cow::Owned(format!("{card} {bit}")), |line| Cow::Borrowed(line.1));
            (name, lane, bit, color)
        })
    };
    of(&timing.outputs, outputs, "output", OUTPUT).chain(of(&timing.inputs, inputs, "input", INPUT)).collect()
}

fn shade(
    chart: &Chart<'_, '_>,
    span: Window,
    window: Window,
    y: std::ops::Range<f64>,
    color: RGBColor,
) -> Drawn {
    let (from, to) = (span.from.max(window.from), span.to.min(window.to));
    if from >= to {
        return Ok(());
    }
    rectangle(chart, seconds(from)..seconds(to), y, &color)
}

fn draw_bar(bar: &Bar, window: Window, middle: f64, chart: &Chart<'_, '_>) -> Drawn {
    let (from, to) = (bar.begin.max(window.from), bar.end.min(window.to));
    if from > to {
        return Ok(());
    }
    let pixel = |x: f64| f64::from(chart.backend_coord(&(x, middle)).0) / f64::from(px(1.0));
    let (left, right) = (pixel(seconds(from)), pixel(seconds(to)));
    // The shortest movement is still seen; two that follow each other are told apart.
    let wide = (right - left - 0.75).max(1.0);
    let block = |from: f64, to: f64, half: f64, color: RGBColor| {
        let corners = [(px(from), px(-half)), (px(to), px(half))];
        let shape = Rectangle::new(corners, color.filled());
        chart.plotting_area().draw(&(EmptyElement::at((seconds(bar.begin.max(window.from)), middle)) + shape))
    };
    block(0.0, wide, 10.0, color(bar.kind))?;
    let ending = match bar.ending {
        Ending::Halted => Some(HALTED),
        Ending::Alarmed(_) => Some(ALARM),
        Ending::Complete | Ending::Open => None,
    };
    if let Some(ending) = ending.filter(|_| bar.end <= window.to) {
        block(wide - 4.0_f64.min(wide), wide, 13.0, ending)?;
    }
    let sign = match bar.direction {
        Some(Direction::Forward) => "+",
        Some(Direction::TowardsOrigin) => "\u{2212}",
        None => "",
    };
    let text = format!("{sign}{}", number(f64::from(bar.steps.0), 0));
    let room = wide - if ending.is_some() { 9.0 } else { 3.0 };
    if width(&text, 9.5) <= room {
        let ink = if matches!(bar.kind, Kind::Origin | Kind::Reference) { INK } else { WHITE };
        let at = (seconds(bar.begin.max(window.from)), middle);
        Words::new(9.5).color(ink).centered().mark(chart, at, (wide / 2.0, 0.0), &text)?;
    }
    Ok(())
}

fn color(kind: Kind) -> RGBColor {
    match kind {
        Kind::Move => RGBColor(0, 114, 178),
        Kind::Line => RGBColor(0, 140, 102),
        Kind::Origin => RGBColor(240, 190, 70),
        Kind::Reference => RGBColor(215, 150, 185),
    }
}

fn name(kind: Kind) -> &'static str {
    match kind {
        Kind::Move => "move",
        Kind::Line => "line or path",
        Kind::Origin => "search for the origin",
        Kind::Reference => "search for the reference step",
    }
}
