//! How ramps are made: the table behind them, movements of various lengths, and what the method of 1980 makes of short
//! ones. What a movement looks like is not planned in here: the machine makes it.

use axis_worker::AxisError;
use axis_worker::ramp::{Curve, Phase, Plan, Table};
use clap::ValueEnum;
use plotters::prelude::*;
use supersigma_config::{AxisConfig, RampConfig, RampError, ShortMoves};
use supersigma_protocol::{Distance, SpeedIndex, Steps, Tick, Ticks};

use super::sheet::{
    Area, Chart, DrawError, Drawn, Entry, Frame, GREY, Head, INK, SHADE, Words, dashes, nth_color, number,
    picture, polyline, px, rectangle, stroke,
};
use super::{Picture, PlotError, Size};
use crate::profile::{Profile, Wanted, describe, profile};

/// What is shown of a ramp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Which {
    /// The curve V(t), the table's steps, and N over time
    Table,
    /// Movements: speed over time, as the machine makes them
    Speed,
    /// The method of 1980: the initial N over the length of the ramp
    Length,
    /// How long movements take, by both methods
    Times,
}

/// No more movements are told apart in one picture.
pub const MOST_LENGTHS: usize = 7;

/// The lengths that are shown if none is named: some below, some above the shortest movement with a whole ramp.
pub const LENGTHS: [u16; MOST_LENGTHS] = [200, 500, 1_000, 2_000, 3_500, 5_184, 8_000];

/// Why there is no picture of a ramp.
#[derive(Debug, thiserror::Error)]
pub enum RampPlotError {
    /// The curve gives no table.
    #[error(transparent)]
    Ramp(#[from] RampError),
    /// The axis cannot be made of its configuration.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// The picture cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

/// A ramp, and the axis that has it.
#[derive(Debug, Clone, Copy)]
pub struct Ramp<'a> {
    /// The axis.
    pub axis: &'a AxisConfig,
    /// Its ramp.
    pub ramp: &'a RampConfig,
}

const WIDTH: u32 = 960;
const CURVE: RGBColor = RGBColor(213, 94, 0);
const STEPS: RGBColor = RGBColor(0, 114, 178);

impl Ramp<'_> {
    /// Draws `which` of it; `lengths` are those of the movements, for [`Which::Speed`].
    ///
    /// # Errors
    /// If the ramp gives no table, or the axis cannot be made of its configuration.
    pub fn picture(&self, which: Which, lengths: &[Distance]) -> Result<Picture, RampPlotError> {
        match which {
            Which::Table => self.table(),
            Which::Speed if lengths.len() == 1 => self.movement(lengths[0]),
            Which::Speed => self.family(lengths),
            Which::Length => self.initial_counts(),
            Which::Times => self.times(),
        }
    }

    fn subtitle(&self) -> String {
        format!("{}: {}", self.axis.name, describe(self.ramp, |speed| number(speed, 0)))
    }

    fn table(&self) -> Result<Picture, RampPlotError> {
        let table = Table::new(self.ramp)?;
        let curve = Curve::new(self.ramp);
        let interval = table.interval().as_seconds();
        let end = interval * f64::from(SpeedIndex::TOP.get());
        let top = table.speed(SpeedIndex::TOP);
        let entries: Vec<_> = (0..=SpeedIndex::TOP.get()).filter_map(SpeedIndex::new).collect();
        let at = |index: SpeedIndex| interval * f64::from(index.get());
        let speeds: Vec<_> = entries.iter().map(|&index| (at(index), table.speed(index))).collect();
        let counts: Vec<_> =
            entries.iter().map(|&index| (at(index), f64::from(table.period(index) - 1))).collect();
        let smooth: Vec<_> = (0..=600).map(|part| end * f64::from(part) / 600.0).collect();
        // Beyond its last entry a short table holds its speed; the other curves do not end before the table.
        let smooth: Vec<_> = smooth.into_iter().map(|t| (t, curve.speed(t.min(curve.end())))).collect();
        let legend =
            vec![Entry::line("the curve V(t)", CURVE), Entry::line("the table, entry by entry", STEPS)];
        let subtitle = self.subtitle();
        let title = "The ramp table";
        let head = Head { title, subtitle: &subtitle, legend };
        let both = |chart: &Chart<'_, '_>, x: &std::ops::Range<f64>| -> Drawn {
            let within = |points: Vec<(f64, f64)>| super::moves::clipped(&points, x);
            polyline(chart, within(staircase(&speeds, end + interval)), stroke(&STEPS, 1.75))?;
            polyline(chart, within(smooth.clone()), stroke(&CURVE, 1.5))
        };
        let seconds = "time from the start of the ramp, s";
        let draw = |root: &Area<'_>| -> Drawn {
            head.draw(root, WIDTH)?;
            let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
            let (whole, rest) = rest.split_vertically(px(290.0));
            let (close, counted) = rest.split_vertically(px(260.0));
            let x = 0.0..end;
            let heading = "Speed of every entry: 2 000 000 / (N + 1)";
            frame(heading, x.clone(), 0.0..top * 1.06, Some(seconds), "steps/s")
                .draw(&whole)
                .and_then(|chart| both(&chart, &x))?;
            let (slow, fast) = close.split_horizontally(px(f64::from(WIDTH) / 2.0));
            let x = 0.0..12.0 * interval;
            let y = curve.speed(0.0) / 1.3..curve.speed(x.end) * 1.05;
            frame("The start, enlarged", x.clone(), y, Some("s"), "steps/s")
                .draw(&slow)
                .and_then(|chart| both(&chart, &x))?;
            let x = end * 0.85..end;
            let y = curve.speed(x.start) * 0.995..top * 1.008;
            frame("The top, enlarged: N is a whole number", x.clone(), y, Some("s"), "steps/s")
                .draw(&fast)
                .and_then(|chart| both(&chart, &x))?;
            let most = counts.first().map_or(1.0, |count| count.1);
            let counted =
                frame("N of every entry", 0.0..end, 0.0..most * 1.08, Some(seconds), "N").draw(&counted)?;
            polyline(&counted, staircase(&counts, end), stroke(&STEPS, 1.75))?;
            for (t, n) in [counts.first(), counts.last()].into_iter().flatten().copied() {
                let (words, dx) =
                    if t > 0.0 { (Words::new(12.0).ends(), -8.0) } else { (Words::new(12.0), 10.0) };
                words.above().mark(&counted, (t, n), (dx, -4.0), &format!("N = {}", number(n, 0)))?;
            }
            Ok(())
        };
        Ok(picture(Size { width: WIDTH, height: 860 }, title, draw)?)
    }

    fn made(&self, distance: Distance) -> Result<Profile, AxisError> {
        profile(self.axis, self.ramp, Wanted { distance, speed: None, constant: false })
    }

    fn movement(&self, distance: Distance) -> Result<Picture, RampPlotError> {
        let made = self.made(distance)?;
        let played = played(&made);
        let duration = made.duration_ticks.as_seconds();
        let curve = Curve::new(self.ramp);
        let theory = theory(&curve, duration, made.peak_speed);
        let legend = vec![
            Entry::line("the curve V(t), up and down", CURVE),
            Entry::line("what the machine makes: 2 000 000 / period", STEPS),
            Entry::filled("where synchronism is lost most easily", SHADE_DARK),
        ];
        let title = format!("A movement of {} steps", number(f64::from(distance.get()), 0));
        let subtitle = format!(
            "{}; {} method, {} ms, at most {} steps/s",
            self.subtitle(),
            method(self.ramp),
            number(duration * 1e3, 1),
            number(made.peak_speed, 0)
        );
        let head = Head { title: &title, subtitle: &subtitle, legend };
        let critical = critical(&made, &played);
        let draw = |root: &Area<'_>| -> Drawn {
            head.draw(root, WIDTH)?;
            let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
            let (whole, close) = rest.split_vertically(px(330.0));
            let y = 0.0..made.peak_speed * 1.08;
            let both = |x: std::ops::Range<f64>,
                        y: std::ops::Range<f64>,
                        heading: &str,
                        name: &str,
                        area: &Area<'_>|
             -> Drawn {
                let chart = frame(heading, x.clone(), y.clone(), Some(name), "steps/s").draw(area)?;
                for span in &critical {
                    let span = span.start.max(x.start)..span.end.min(x.end);
                    if span.start < span.end {
                        rectangle(&chart, span, y.clone(), &SHADE_DARK)?;
                    }
                }
                polyline(&chart, super::moves::clipped(&played, &x), stroke(&STEPS, 1.75))?;
                polyline(&chart, super::moves::clipped(&theory, &x), stroke(&CURVE, 1.25))
            };
            both(0.0..duration, y, "Speed over time", "time from the start of the movement, s", &whole)?;
            let first = (duration / 4.0).min(0.03);
            let x = 0.0..first;
            let y = 0.0..curve.speed(first).min(made.peak_speed) * 1.1;
            both(
                x,
                y,
                "The start, enlarged: each period has the entry that is due when it begins",
                "s",
                &close,
            )
        };
        Ok(picture(Size { width: WIDTH, height: 690 }, &title, draw)?)
    }

    fn family(&self, lengths: &[Distance]) -> Result<Picture, RampPlotError> {
        let made = lengths.iter().map(|&distance| self.made(distance)).collect::<Result<Vec<_>, _>>()?;
        let steps = |profile: &Profile| number(f64::from(profile.steps.0), 0);
        let legend = made
            .iter()
            .enumerate()
            .map(|(n, profile)| Entry::line(format!("{} steps", steps(profile)), nth_color(n)))
            .collect();
        let title = "Speed-time curves of movements of various lengths";
        let subtitle = format!("{}; {} method", self.subtitle(), method(self.ramp));
        let head = Head { title, subtitle: &subtitle, legend };
        let longest = made.iter().map(|profile| profile.duration_ticks.as_seconds()).fold(0.0, f64::max);
        let fastest = made.iter().map(|profile| profile.peak_speed).fold(0.0, f64::max);
        let draw = |root: &Area<'_>| -> Drawn {
            head.draw(root, WIDTH)?;
            let (_, area) = root.split_vertically(px(head.height(WIDTH)));
            let name = "time from the start of the movement, s";
            let chart = frame("Speed", 0.0..longest * 1.02, 0.0..fastest * 1.08, Some(name), "steps/s")
                .draw(&area)?;
            // The longest first, so that the shorter ones are on top of it.
            for (n, profile) in made.iter().enumerate().rev() {
                polyline(&chart, super::moves::thinned(played(profile), &area), stroke(&nth_color(n), 1.75))?;
            }
            Ok(())
        };
        Ok(picture(Size { width: WIDTH, height: 520 }, title, draw)?)
    }

    fn initial_counts(&self) -> Result<Picture, RampPlotError> {
        let paper = Table::new(&RampConfig { short_moves: ShortMoves::Paper, ..self.ramp.clone() })?;
        let points = family_of_1980(&paper);
        let title = "The initial N and the length of the ramp, by the method of 1980";
        let subtitle = self.subtitle();
        let mut legend = vec![Entry::line("found by search, one point a length of the movement", STEPS)];
        let fit = Hyperbola::through(&points);
        if let Some(fit) = fit {
            let (worst, at) = fit.worst(&points);
            legend.push(Entry::line(
                format!(
                    "the nearest hyperbola; off by up to {} % at {} steps",
                    number(worst * 100.0, 1),
                    number(at, 0)
                ),
                CURVE,
            ));
        }
        let head = Head { title, subtitle: &subtitle, legend };
        let (first, last) =
            (points.first().copied().unwrap_or((0.0, 1.0)), points.last().copied().unwrap_or((1.0, 0.0)));
        let (x, y) = (0.0..last.0 * 1.05, 0.0..first.1 * 1.06);
        let draw = |root: &Area<'_>| -> Drawn {
            head.draw(root, WIDTH)?;
            let (_, area) = root.split_vertically(px(head.height(WIDTH)));
            let name = "length of the ramp, steps";
            let chart =
                frame("Initial N over the ramp's length", x.clone(), y.clone(), Some(name), "initial N")
                    .draw(&area)?;
            polyline(&chart, points.clone(), stroke(&STEPS, 2.5))?;
            if let Some(fit) = fit {
                let curve = (0..=400).map(|part| first.0 + (last.0 - first.0) * f64::from(part) / 400.0);
                let curve = curve.map(|na| (na, fit.at(na))).filter(|point| y.contains(&point.1)).collect();
                polyline(&chart, curve, stroke(&CURVE, 1.25))?;
            }
            let label = format!("N = {}: the whole ramp, {} steps", number(last.1, 0), number(last.0, 0));
            dot(&chart, last)?;
            Words::new(12.0).ends().above().mark(&chart, last, (4.0, -10.0), &label)
        };
        Ok(picture(Size { width: WIDTH, height: 520 }, title, draw)?)
    }

    fn times(&self) -> Result<Picture, RampPlotError> {
        let of = |short_moves| Table::new(&RampConfig { short_moves, ..self.ramp.clone() });
        let (optimal, paper) = (of(ShortMoves::Optimal)?, of(ShortMoves::Paper)?);
        let whole = shortest_with_a_whole_ramp(&paper);
        let lengths = || {
            (1..=1_000_u32).filter_map(|part| Distance::new(u16::try_from(part * whole * 2 / 1_000).ok()?))
        };
        let times = |table: &Table| -> Vec<(f64, f64)> {
            let seconds =
                |distance| Ticks(Plan::ramped(table, distance, SpeedIndex::TOP).duration()).as_seconds();
            lengths().map(|distance| (f64::from(distance.get()), 1e3 * seconds(distance))).collect()
        };
        let lines = [("method of 1980", times(&paper), CURVE), ("optimal method", times(&optimal), STEPS)];
        let title = "The time that a movement takes";
        let subtitle = self.subtitle();
        let legend = lines.iter().map(|(name, _, color)| Entry::line(*name, *color)).collect();
        let head = Head { title, subtitle: &subtitle, legend };
        let most = lines.iter().flat_map(|(_, points, _)| points).map(|point| point.1).fold(0.0, f64::max);
        let draw = |root: &Area<'_>| -> Drawn {
            head.draw(root, WIDTH)?;
            let (_, area) = root.split_vertically(px(head.height(WIDTH)));
            let (x, y) = (0.0..f64::from(2 * whole), 0.0..most * 1.08);
            let name = "length of the movement, steps";
            let chart = frame("Time over length", x, y.clone(), Some(name), "ms").draw(&area)?;
            let shortest = f64::from(whole);
            dashes(&chart, (shortest, y.start), (shortest, y.end), &GREY, 4.0)?;
            let label = format!("{}: from here on with the whole ramp of 1980", number(shortest, 0));
            Words::new(12.0).color(GREY).below().mark(&chart, (shortest, y.end), (6.0, 6.0), &label)?;
            for (_, points, color) in &lines {
                polyline(&chart, points.clone(), stroke(color, 2.0))?;
            }
            Ok(())
        };
        Ok(picture(Size { width: WIDTH, height: 480 }, title, draw)?)
    }
}

/// Darker than the shade of idle times, because curves lie on it.
const SHADE_DARK: RGBColor = RGBColor(SHADE.0 - 15, SHADE.1 - 15, SHADE.2 - 15);

fn method(ramp: &RampConfig) -> &'static str {
    match ramp.short_moves {
        ShortMoves::Optimal => "optimal",
        ShortMoves::Paper => "paper's",
    }
}

fn frame<'a>(
    heading: &'a str,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
    x_name: Option<&'a str>,
    y_name: &'a str,
) -> Frame<'a> {
    Frame { heading, x, y, x_name, y_name: Some(y_name) }
}

fn dot(chart: &Chart<'_, '_>, at: (f64, f64)) -> Result<(), DrawError> {
    chart.plotting_area().draw(&Circle::new(at, px(3.5), INK.filled()))
}

/// Every value holds until the next one.
fn staircase(points: &[(f64, f64)], end: f64) -> Vec<(f64, f64)> {
    let ends = points.iter().skip(1).map(|next| next.0).chain([end]);
    points.iter().zip(ends).flat_map(|(&(from, value), to)| [(from, value), (to, value)]).collect()
}

/// Speed over time, as periods say it; equal ones in a row are one step of the staircase.
#[expect(clippy::cast_precision_loss, reason = "periods and the clock's frequency are small")]
fn played(profile: &Profile) -> Vec<(f64, f64)> {
    let pulses = profile.pulses.as_deref().unwrap_or_default();
    let mut points = vec![(0.0, 0.0)];
    let mut period_before = 0;
    let mut begin = Ticks(0);
    for &pulse in pulses {
        let period = pulse.0 - begin.0;
        let speed = Tick::PER_SECOND as f64 / period as f64;
        if period == period_before {
            points.pop();
        } else {
            points.push((begin.as_seconds(), speed));
        }
        points.push((pulse.as_seconds(), speed));
        (period_before, begin) = (period, pulse);
    }
    points.push((begin.as_seconds(), 0.0));
    points
}

/// Up the curve to `peak`, level, and back down it, in `duration` seconds.
fn theory(curve: &Curve, duration: f64, peak: f64) -> Vec<(f64, f64)> {
    let half: Vec<_> = (0..=500)
        .map(|part| duration / 2.0 * f64::from(part) / 500.0)
        .map(|t| (t, if t < curve.end() { curve.speed(t).min(peak) } else { peak }))
        .collect();
    let back = half.iter().rev().map(|&(t, speed)| (duration - t, speed));
    half.iter().copied().chain(back).collect()
}

/// Where acceleration meets constant speed, on both sides: from nine tenths of the top speed on.
fn critical(made: &Profile, played: &[(f64, f64)]) -> Vec<std::ops::Range<f64>> {
    let pulses = made.pulses.as_deref().unwrap_or_default();
    let at = |steps: Steps| {
        let pulse = usize::try_from(steps.0).ok()?.checked_sub(1)?;
        pulses.get(pulse).map(|tick| tick.as_seconds())
    };
    let fast = |point: &&(f64, f64)| point.1 >= 0.9 * made.peak_speed;
    let (first, last) = (played.iter().find(fast), played.iter().rfind(fast));
    let (Some(up), Some(down), Some(first), Some(last)) =
        (at(made.accel_steps), at(made.decel_at), first, last)
    else {
        return Vec::new();
    };
    if up < down { vec![first.0..up, down..last.0] } else { vec![first.0..last.0] }
}

/// (na, initial N) of every length of movement for which the method of 1980 makes another ramp.
fn family_of_1980(paper: &Table) -> Vec<(f64, f64)> {
    let longest = shortest_with_a_whole_ramp(paper);
    let lengths = (1..=longest).filter_map(|steps| Distance::new(u16::try_from(steps).ok()?));
    let mut points: Vec<(f64, f64)> = lengths
        .filter_map(|distance| {
            let plan = Plan::ramped(paper, distance, SpeedIndex::TOP);
            let ramp = climb(&plan);
            let first = plan.runs().next()?;
            (ramp > 0).then(|| (f64::from(ramp), f64::from(first.period - 1)))
        })
        .collect();
    points.dedup();
    points
}

/// na: the steps of a plan up to the end of its acceleration.
fn climb(plan: &Plan) -> u32 {
    plan.runs().filter(|run| run.phase == Phase::Accelerating).map(|run| run.pulses).sum()
}

/// 2 na + offset: shorter movements have a ramp of their own in the method of 1980.
fn shortest_with_a_whole_ramp(paper: &Table) -> u32 {
    2 * climb(&Plan::ramped(paper, Distance::MAX, SpeedIndex::TOP)) + paper.offset().0
}

/// (N − n) · (na − m) = c.
#[derive(Debug, Clone, Copy)]
struct Hyperbola {
    n: f64,
    m: f64,
    c: f64,
}

impl Hyperbola {
    /// The one of the least squares of N · na = n · na + m · N + (c − n · m), each point weighted by its product.
    fn through(points: &[(f64, f64)]) -> Option<Self> {
        let mut sums = [[0.0; 4]; 3];
        for &(na, count) in points {
            let weight = 1.0 / (na * count);
            let row = [na * weight, count * weight, weight, 1.0];
            for (line, factor) in sums.iter_mut().zip(row) {
                for (sum, term) in line.iter_mut().zip(row) {
                    *sum += factor * term;
                }
            }
        }
        // Gauss; the matrix is symmetric and positive, so its diagonal serves as pivots.
        for pivot in 0..3 {
            let line = sums[pivot];
            if line[pivot].abs() < 1e-18 {
                return None;
            }
            for (_, other) in sums.iter_mut().enumerate().filter(|(at, _)| *at != pivot) {
                let factor = other[pivot] / line[pivot];
                for (value, term) in other.iter_mut().zip(line) {
                    *value -= factor * term;
                }
            }
        }
        let [n, m, rest] = [0, 1, 2].map(|at| sums[at][3] / sums[at][at]);
        Some(Self { n, m, c: rest + n * m })
    }

    /// N for a ramp of `na` steps.
    fn at(&self, na: f64) -> f64 {
        self.n + self.c / (na - self.m)
    }

    /// The largest relative error, and the ramp's length there.
    fn worst(&self, points: &[(f64, f64)]) -> (f64, f64) {
        let errors = points.iter().map(|&(na, count)| ((self.at(na) - count).abs() / count, na));
        errors.fold((0.0, 0.0), |worst, error| if error.0 > worst.0 { error } else { worst })
    }
}
