//! Ways to make one movement: their speed over time, and how far the rotor lags behind, on the motor as it is and weakened
//! by the margin.

use std::ops::Range;

use axis_worker::tune::{Outcome, lags};
use plotters::prelude::*;
use supersigma_config::{MotorConfig, MotorError};
use supersigma_protocol::{Tick, Ticks};

use super::moves::{clipped, thinned};
use super::sheet::{
    ALARM, Area, Drawn, Entry, Frame, GREY, Head, Words, dashes, nth_color, number, picture, polyline, px,
    stroke,
};
use super::{Picture, PlotError, Size};
use crate::bench::tune::{Wanted, Way};

const WIDTH: u32 = 960;
/// Half steps of lag at which the spring is strongest, and at which it has given way.
const STRONGEST: f64 = 2.0;
const GIVEN_WAY: f64 = 4.0;
const MEAN: Ticks = Ticks(2 * Tick::PER_SECOND / 1_000);
/// The lags that are shown.
const LAGS: Range<f64> = -5.0..7.0;

/// What is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Shown<'a> {
    /// What was looked for.
    pub wanted: &'a Wanted<'a>,
    /// Whose motor it is.
    pub name: &'a str,
    /// What was found.
    pub ways: &'a [Way],
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum TunePlotError {
    /// The motor cannot be.
    #[error(transparent)]
    Motor(#[from] MotorError),
    /// The picture cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

/// Points over time.
type Curve = Vec<(f64, f64)>;

/// Draws all ways.
///
/// # Errors
/// If the motor cannot be, or the drawing library refuses.
pub fn tune(shown: &Shown<'_>) -> Result<Picture, TunePlotError> {
    let Shown { wanted, name, ways } = *shown;
    let weak = wanted.margin.weakened(wanted.motor);
    let lagging = |motor: &MotorConfig| -> Result<Vec<Curve>, MotorError> {
        ways.iter().map(|way| Ok(until_lost(lags(motor, &way.pulses)?))).collect()
    };
    let (nominal, weakened) = (lagging(wanted.motor)?, lagging(&weak)?);
    let title = format!("{} half steps with {name}", number(f64::from(wanted.distance.get()), 0));
    let subtitle = format!(
        "{} N·m, {:.2e} kg·m², load {} N·m; {} of the torque in hand",
        wanted.motor.holding_torque,
        wanted.motor.inertia(),
        number(wanted.motor.friction + wanted.motor.load_torque, 2),
        wanted.margin
    );
    let legend = ways.iter().enumerate().map(|(n, way)| Entry::line(words(way), nth_color(n))).collect();
    let head = Head { title: &title, subtitle: &subtitle, legend };
    let longest = ways.iter().map(|way| way.assessment.duration.as_seconds()).fold(0.0, f64::max);
    let fastest = ways.iter().map(|way| way.assessment.top_speed).fold(0.0, f64::max);
    let x = 0.0..longest * 1.04;
    let draw = |root: &Area<'_>| -> Drawn {
        head.draw(root, WIDTH)?;
        let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
        let (speed, rest) = rest.split_vertically(px(290.0));
        let (as_it_is, weaker) = rest.split_vertically(px(255.0));
        let frame = Frame {
            heading: "Speed of the pulses",
            x: x.clone(),
            y: 0.0..fastest * 1.1,
            x_name: None,
            y_name: Some("half steps/s"),
        };
        let chart = frame.draw(&speed)?;
        for (n, way) in ways.iter().enumerate() {
            polyline(&chart, thinned(speeds(way), &speed), stroke(&nth_color(n), 1.75))?;
            if let Outcome::Slips(slip) = way.assessment.nominal {
                let at = (slip.at.as_seconds(), slip.speed);
                chart.plotting_area().draw(&Cross::new(at, px(5.0), stroke(&ALARM, 2.0)))?;
            }
        }
        lag(&nominal, &x, "Lag of the rotor, the motor as it is", None, &as_it_is)?;
        let heading = format!("Lag of the rotor, {} weaker", wanted.margin);
        lag(&weakened, &x, &heading, Some("time from the start of the movement, s"), &weaker)
    };
    Ok(picture(Size { width: WIDTH, height: 920 }, &title, draw)?)
}

fn words(way: &Way) -> String {
    let verdict = match (way.assessment.nominal, way.assessment.at_margin) {
        (Outcome::Slips(_), _) => ", loses steps (×)",
        (_, Outcome::Slips(_)) => ", not with the margin (×)",
        _ => "",
    };
    let duration = way.assessment.duration.as_seconds() * 1e3;
    format!("{}: {} ms{verdict}", way.maker.name(), number(duration, 0))
}

/// The mean speed of [`MEAN`] each, or of one period if that is longer: a clock of 1 MHz makes most speeds of two periods.
fn speeds(way: &Way) -> Curve {
    let speed = |pulses: u32, span: u64| f64::from(pulses) / Ticks(span).as_seconds();
    let mut points = Vec::new();
    let (mut now, mut pulses, mut span) = (Ticks(0), 0, 0);
    for period in way.pulses.periods() {
        if points.is_empty() {
            points.push((0.0, speed(1, u64::from(*period))));
        }
        (pulses, span) = (pulses + 1, span + u64::from(*period));
        if span >= MEAN.0 {
            points.push((Ticks(now.0 + span / 2).as_seconds(), speed(pulses, span)));
            now.0 += span;
            (pulses, span) = (0, 0);
        }
    }
    let last = way.pulses.periods().last().map(|period| speed(1, u64::from(*period)));
    points.extend(last.map(|speed| (Ticks(now.0 + span).as_seconds(), speed)));
    points
}

/// Up to where the rotor is out of the picture.
fn until_lost(lags: Vec<(Ticks, f64)>) -> Curve {
    let end = lags.iter().position(|(_, lag)| !LAGS.contains(lag)).unwrap_or(lags.len());
    lags.into_iter().take(end).map(|(at, lag)| (at.as_seconds(), lag)).collect()
}

fn lag(curves: &[Curve], x: &Range<f64>, heading: &str, x_name: Option<&str>, area: &Area<'_>) -> Drawn {
    let chart = Frame { heading, x: x.clone(), y: LAGS, x_name, y_name: Some("half steps") }.draw(area)?;
    for (lag, name) in [(STRONGEST, "largest torque"), (GIVEN_WAY, "gives way: slips from here")] {
        for sense in [1.0, -1.0] {
            dashes(&chart, (x.start, lag * sense), (x.end, lag * sense), &GREY, 4.0)?;
        }
        Words::new(11.5).color(GREY).ends().above().mark(&chart, (x.end, lag), (-4.0, -1.0), name)?;
    }
    for (n, curve) in curves.iter().enumerate() {
        polyline(&chart, thinned(clipped(curve, x), area), stroke(&nth_color(n), 1.25))?;
        // Where it has left the picture, it will not come back to where it was.
        if let Some(last) = curve.last().filter(|last| last.1 > GIVEN_WAY || last.1 < -GIVEN_WAY) {
            chart.plotting_area().draw(&Cross::new(*last, px(5.0), stroke(&ALARM, 2.0)))?;
        }
    }
    Ok(())
}
