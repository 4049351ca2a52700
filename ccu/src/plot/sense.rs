//! Sense points as lanes: X1 to X5 of one axis, filled while they are on, with its alarms and the faults made on it.

use std::collections::BTreeMap;

use plotters::prelude::*;
use supersigma_protocol::{Alarm, SensePoint, Tick};

use super::sheet::{
    ALARM, Chart, DrawError, Drawn, FAINT, GREY, Words, color, polyline, px, rectangle, stroke, width,
};
use super::trace::{AxisTrace, Sample, Window, seconds};

/// The sense lanes of one axis.
pub(super) struct Group<'a> {
    pub(super) trace: &'a AxisTrace,
    pub(super) alarms: Vec<(Window, Alarm)>,
    pub(super) faults: Vec<(Tick, String)>,
}

impl Group<'_> {
    const LANE: f64 = 12.0;
    const EVENTS: f64 = 16.0;
    const AIR: f64 = 9.0;

    fn has_events(&self) -> bool {
        !self.alarms.is_empty() || !self.faults.is_empty()
    }

    /// In pixels.
    pub(super) fn height(&self) -> f64 {
        let lanes = Self::LANE * f64::from(u8::try_from(SensePoint::ALL.len()).unwrap_or(u8::MAX));
        lanes + Self::AIR + if self.has_events() { Self::EVENTS } else { 0.0 }
    }

    /// Draws it below `top`.
    pub(super) fn draw(&self, name: &str, top: f64, window: Window, chart: &Chart<'_, '_>) -> Drawn {
        let x = window.seconds();
        let mut y = top - Self::AIR / 2.0;
        let bottom = top - self.height() + Self::AIR / 2.0;
        for (span, _) in &self.alarms {
            rectangle(chart, span.seconds(), bottom..y, &ALARM.mix(0.12))?;
        }
        Words::new(12.0).bold().color(color(self.trace.axis)).mark(
            chart,
            (x.start, y),
            (-86.0, 9.0),
            name,
        )?;
        if self.has_events() {
            self.events(y - Self::EVENTS / 2.0, window, chart)?;
            y -= Self::EVENTS;
        }
        for (point, label) in SensePoint::ALL.into_iter().zip(["X1", "X2", "X3", "X4", "X5"]) {
            let middle = y - Self::LANE / 2.0;
            polyline(chart, vec![(x.start, middle), (x.end, middle)], stroke(&FAINT, 1.0))?;
            for span in on(self.trace, point, window) {
                rectangle(chart, span.seconds(), middle - 4.0..middle + 4.0, &color(self.trace.axis))?;
            }
            Words::new(10.0).color(GREY).ends().mark(chart, (x.start, middle), (-6.0, 0.0), label)?;
            y -= Self::LANE;
        }
        Ok(())
    }

    /// Alarms and faults with their names; a name that has no room is left out, the mark stays.
    fn events(&self, y: f64, window: Window, chart: &Chart<'_, '_>) -> Drawn {
        let mut marks: BTreeMap<Tick, (String, bool)> = BTreeMap::new();
        marks.extend(self.alarms.iter().map(|(span, alarm)| (span.from, (alarm.to_string(), true))));
        for (tick, fault) in &self.faults {
            marks.entry(*tick).or_insert_with(|| (fault.clone(), false));
        }
        let pixel = |x: f64| f64::from(chart.backend_coord(&(x, y)).0) / f64::from(px(1.0));
        let right = pixel(window.seconds().end);
        let mut taken = f64::NEG_INFINITY;
        for (tick, (text, alarm)) in marks {
            let x = seconds(tick);
            let ink = if alarm { ALARM } else { GREY };
            diamond(chart, (x, y), ink)?;
            let (at, length) = (pixel(x), width(&text, 11.0));
            let words = Words::new(11.0).color(ink);
            if at > taken && at + 8.0 + length <= right {
                words.mark(chart, (x, y), (8.0, 0.0), &text)?;
                taken = at + 12.0 + length;
            } else if at - 8.0 - length > taken.max(pixel(window.seconds().start)) {
                words.ends().mark(chart, (x, y), (-8.0, 0.0), &text)?;
                taken = at + 8.0;
            }
        }
        Ok(())
    }
}

fn diamond(chart: &Chart<'_, '_>, at: (f64, f64), ink: RGBColor) -> Result<(), DrawError> {
    let side = px(5.0);
    let shape = Polygon::new(vec![(0, -side), (side, 0), (0, side), (-side, 0)], ink.filled());
    chart.plotting_area().draw(&(EmptyElement::at(at) + shape))
}

/// Each sample with the span for which its state holds, as far as it lies in the window. The last one of an axis that
/// stands holds to the window's end.
fn spans(trace: &AxisTrace, window: Window) -> impl Iterator<Item = (Window, &Sample)> {
    let ends = trace.samples.iter().skip(1).map(|next| next.tick);
    let end =
        trace.samples.last().map(|last| if last.moves() { last.tick } else { window.to.max(last.tick) });
    trace.samples.iter().zip(ends.chain(end)).filter_map(move |(sample, to)| {
        let (from, to) = (sample.tick.max(window.from), to.min(window.to));
        (from < to).then_some((Window { from, to }, sample))
    })
}

/// When a sense point was on.
fn on(trace: &AxisTrace, point: SensePoint, window: Window) -> Vec<Window> {
    let mut on: Vec<Window> = Vec::new();
    for (span, _) in spans(trace, window).filter(|(_, sample)| sample.sense.has(point)) {
        match on.last_mut().filter(|last| last.to == span.from) {
            Some(last) => last.to = span.to,
            None => on.push(span),
        }
    }
    on
}

/// When the axis was locked, and why.
pub(super) fn alarms(trace: &AxisTrace, window: Window) -> Vec<(Window, Alarm)> {
    let mut alarms: Vec<(Window, Alarm)> = Vec::new();
    for (span, sample) in spans(trace, window) {
        let Some(alarm) = sample.alarm else { continue };
        match alarms.last_mut().filter(|last| last.0.to == span.from && last.1 == alarm) {
            Some(last) => last.0.to = span.to,
            None => alarms.push((span, alarm)),
        }
    }
    alarms
}
