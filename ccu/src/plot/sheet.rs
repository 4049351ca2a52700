//! The paper: one canvas with a title, a legend and frames with labelled axes, in quarters of a pixel so that curves are
//! smooth. Colours, text sizes and the form of numbers are here, and nowhere else.

use std::io;
use std::ops::Range;

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{BoldPoints, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use supersigma_protocol::AxisNumber;

use super::{Picture, PlotError, Size};

/// Canvas units in a pixel.
const FINE: u32 = 4;
/// The drawing library takes text sizes 1.24 times too large, to be like another renderer.
const TEXT_FACTOR: f64 = 1.24;
/// The average width of a character, of its size; a little more than that of common fonts.
const CHARACTER: f64 = 0.55;

/// The room left of a frame, for its labels.
pub(super) const LEFT: f64 = 92.0;
/// The room right of it.
pub(super) const RIGHT: f64 = 28.0;
/// The room above a frame, for its heading.
pub(super) const HEADING: f64 = 30.0;
/// The room below a frame with labels.
pub(super) const LABELS: f64 = 46.0;
/// The room below a frame whose labels stand below another one.
pub(super) const NO_LABELS: f64 = 8.0;
/// No picture is narrower.
pub(super) const NARROWEST: u32 = 480;

pub(super) const INK: RGBColor = RGBColor(40, 40, 40);
pub(super) const GREY: RGBColor = RGBColor(110, 110, 110);
pub(super) const FAINT: RGBColor = RGBColor(225, 225, 225);
pub(super) const SHADE: RGBColor = RGBColor(240, 240, 240);
pub(super) const ALARM: RGBColor = RGBColor(200, 30, 30);

/// Okabe and Ito's colours, which people with any kind of colour vision tell apart; their yellow is too light on white.
const PALETTE: [RGBColor; AxisNumber::COUNT] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// The colour of an axis, the same in every picture.
pub(super) fn color(axis: AxisNumber) -> RGBColor {
    PALETTE[axis.index()]
}

/// The n-th colour.
pub(super) fn nth_color(n: usize) -> RGBColor {
    PALETTE[n % PALETTE.len()]
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type Plane = Cartesian2d<RangedCoordf64, RangedCoordf64>;
pub(super) type Chart<'c, 'a> = ChartContext<'c, SVGBackend<'a>, Plane>;
pub(super) type DrawError = DrawingAreaErrorKind<io::Error>;
pub(super) type Drawn = Result<(), DrawError>;

/// Pixels in canvas units.
#[expect(clippy::cast_possible_truncation, reason = "no picture is longer than 10 000 pixels")]
pub(super) fn px(pixels: f64) -> i32 {
    (pixels * f64::from(FINE)).round() as i32
}

/// A line's width in pixels, in canvas units.
pub(super) fn stroke(color: &impl Color, pixels: f64) -> ShapeStyle {
    ShapeStyle { color: color.to_rgba(), filled: false, stroke_width: px(pixels).unsigned_abs().max(1) }
}

/// Draws a picture of `size` with `paint`.
pub(super) fn picture(
    size: Size,
    title: &str,
    paint: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<Picture, PlotError> {
    let mut svg = String::new();
    let (width, height) = (size.width * FINE, size.height * FINE);
    {
        let root = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        let painted = root.fill(&WHITE).and_then(|()| paint(&root)).and_then(|()| root.present());
        painted.map_err(|error| PlotError::Draw(error.to_string()))?;
    }
    let natural = format!("width=\"{}\" height=\"{}\"", size.width, size.height);
    let mut svg = svg.replacen(&format!("width=\"{width}\" height=\"{height}\""), &natural, 1);
    if let Some(at) = svg.find('\n') {
        let title = title.replace('&', "&amp;").replace('<', "&lt;");
        svg.insert_str(at, &format!("\n<title>{title}</title>"));
    }
    Ok(Picture { svg, size })
}

/// A text's looks.
pub(super) struct Words {
    size: f64,
    color: RGBColor,
    bold: bool,
    anchor: Pos,
    upright: bool,
}

impl Words {
    /// Text of `size` pixels; its point is at its left, half-way up.
    pub(super) const fn new(size: f64) -> Self {
        Self {
            size,
            color: INK,
            bold: false,
            anchor: Pos { h_pos: HPos::Left, v_pos: VPos::Center },
            upright: true,
        }
    }

    pub(super) const fn bold(mut self) -> Self {
        self.bold = true;
        self
    }

    pub(super) const fn color(mut self, color: RGBColor) -> Self {
        self.color = color;
        self
    }

    /// Its point is at its right.
    pub(super) const fn ends(mut self) -> Self {
        self.anchor.h_pos = HPos::Right;
        self
    }

    /// Its point is in its middle.
    pub(super) const fn centered(mut self) -> Self {
        self.anchor.h_pos = HPos::Center;
        self
    }

    /// Its point is below it.
    pub(super) const fn above(mut self) -> Self {
        self.anchor.v_pos = VPos::Bottom;
        self
    }

    /// Its point is above it.
    pub(super) const fn below(mut self) -> Self {
        self.anchor.v_pos = VPos::Top;
        self
    }

    pub(super) fn style(&self) -> TextStyle<'_> {
        let style = if self.bold { FontStyle::Bold } else { FontStyle::Normal };
        let font = FontDesc::new(FontFamily::SansSerif, self.size * f64::from(FINE) * TEXT_FACTOR, style);
        let font = if self.upright { font } else { font.transform(FontTransform::Rotate270) };
        TextStyle::from(font).color(&self.color).pos(self.anchor)
    }

    /// Writes it on an area, at a point in pixels.
    pub(super) fn write(&self, area: &Area<'_>, (x, y): (f64, f64), text: &str) -> Drawn {
        area.draw(&Text::new(text.to_owned(), (px(x), px(y)), self.style()))
    }

    /// Writes it in a chart, at a point of the chart and so many pixels away from it.
    pub(super) fn mark(
        &self,
        chart: &Chart<'_, '_>,
        at: (f64, f64),
        (dx, dy): (f64, f64),
        text: &str,
    ) -> Drawn {
        let text = Text::new(text.to_owned(), (px(dx), px(dy)), self.style());
        chart.plotting_area().draw(&(EmptyElement::at(at) + text))
    }
}

/// About how many pixels wide a text will be.
pub(super) fn width(text: &str, size: f64) -> f64 {
    f64::from(u32::try_from(text.chars().count()).unwrap_or(u32::MAX)) * size * CHARACTER
}

/// A number with its thousands apart: `15 037.6`.
pub(super) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = text.split_once('.').map_or((text.as_str(), ""), |(whole, rest)| (whole, rest));
    let mut out = String::new();
    if value < 0.0 && text.bytes().any(|byte| (b'1'..=b'9').contains(&byte)) {
        out.push('\u{2212}');
    }
    for (at, digit) in whole.chars().enumerate() {
        if at > 0 && (whole.len() - at) % 3 == 0 {
            out.push('\u{2009}');
        }
        out.push(digit);
    }
    if !fraction.is_empty() {
        out.push('.');
        out.push_str(fraction);
    }
    out
}

/// One entry of a legend.
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) color: RGBColor,
    /// A filled box instead of a line.
    pub(super) filled: bool,
}

impl Entry {
    pub(super) fn line(name: impl Into<String>, color: RGBColor) -> Self {
        Self { name: name.into(), color, filled: false }
    }

    pub(super) fn filled(name: impl Into<String>, color: RGBColor) -> Self {
        Self { name: name.into(), color, filled: true }
    }

    fn width(&self) -> f64 {
        30.0 + width(&self.name, LEGEND_SIZE) + 14.0
    }
}

const LEGEND_SIZE: f64 = 12.5;
const LEGEND_ROW: f64 = 20.0;

/// What stands above the frames: title, subtitle, legend.
pub(super) struct Head<'a> {
    pub(super) title: &'a str,
    pub(super) subtitle: &'a str,
    pub(super) legend: Vec<Entry>,
}

impl Head<'_> {
    /// How many pixels it takes on a picture of this width.
    pub(super) fn height(&self, width: u32) -> f64 {
        let rows = self.rows(width).last().map_or(0, |(_, row, _)| row + 1);
        58.0 + LEGEND_ROW * f64::from(rows)
    }

    /// Every entry with its row and its place there.
    fn rows(&self, width: u32) -> Vec<(f64, u32, &Entry)> {
        let (mut x, mut row) = (0.0, 0);
        let mut placed = Vec::new();
        for entry in &self.legend {
            if x > 0.0 && x + entry.width() > f64::from(width) - 32.0 {
                (x, row) = (0.0, row + 1);
            }
            placed.push((16.0 + x, row, entry));
            x += entry.width();
        }
        placed
    }

    pub(super) fn draw(&self, area: &Area<'_>, width: u32) -> Drawn {
        Words::new(18.0).bold().write(area, (16.0, 22.0), self.title)?;
        Words::new(12.5).color(GREY).write(area, (16.0, 43.0), self.subtitle)?;
        for (x, row, entry) in self.rows(width) {
            let y = 66.0 + LEGEND_ROW * f64::from(row);
            if entry.filled {
                let corners = [(px(x), px(y - 5.0)), (px(x + 22.0), px(y + 5.0))];
                area.draw(&Rectangle::new(corners, entry.color.filled()))?;
            } else {
                let points = [(px(x), px(y)), (px(x + 22.0), px(y))];
                area.draw(&PathElement::new(points, stroke(&entry.color, 2.5)))?;
            }
            Words::new(LEGEND_SIZE).write(area, (x + 28.0, y), &entry.name)?;
        }
        Ok(())
    }
}

/// A frame with axes.
pub(super) struct Frame<'a> {
    pub(super) heading: &'a str,
    pub(super) x: Range<f64>,
    pub(super) y: Range<f64>,
    /// What is along the bottom; its labels are left out if it has no name.
    pub(super) x_name: Option<&'a str>,
    /// What is up the side; without a name the side has no labels and no lines.
    pub(super) y_name: Option<&'a str>,
}

impl Frame<'_> {
    /// Draws the frame onto an area of so many pixels, and gives the chart in it.
    pub(super) fn draw<'c, 'a>(&self, area: &'c Area<'a>) -> Result<Chart<'c, 'a>, DrawError> {
        let (width, height) = area.dim_in_pixel();
        let [width, height] = [width, height].map(|side| f64::from(side) / f64::from(FINE));
        let below = if self.x_name.is_some() { LABELS } else { NO_LABELS };
        let mut chart = ChartBuilder::on(area)
            .margin_top(px(HEADING))
            .margin_right(px(RIGHT))
            .y_label_area_size(px(LEFT))
            .x_label_area_size(px(below))
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        let [columns, rows] = [(width - LEFT - RIGHT) / 76.0, (height - HEADING - below) / 34.0].map(labels);
        let [x_decimals, y_decimals] = [decimals(&self.x, columns), decimals(&self.y, rows)];
        let show_x = self.x_name.is_some();
        let show_y = self.y_name.is_some();
        let x_label = |x: &f64| if show_x { number(*x, x_decimals) } else { String::new() };
        let y_label = |y: &f64| if show_y { number(*y, y_decimals) } else { String::new() };
        let ticks = Words::new(12.0);
        let mut mesh = chart.configure_mesh();
        mesh.x_labels(columns)
            .y_labels(rows)
            .max_light_lines(0)
            .bold_line_style(stroke(&FAINT, 1.0))
            .axis_style(stroke(&GREY, 1.0))
            .label_style(ticks.style())
            .set_tick_mark_size(LabelAreaPosition::Left, px(if show_y { 5.0 } else { 0.0 }))
            .set_tick_mark_size(LabelAreaPosition::Bottom, px(if show_x { 5.0 } else { 0.0 }))
            .x_label_formatter(&x_label)
            .y_label_formatter(&y_label);
        if !show_y {
            mesh.disable_y_mesh().y_labels(0);
        }
        mesh.draw()?;
        let (left, right, top, bottom) = (LEFT, width - RIGHT, HEADING, height - below);
        Words::new(13.5).bold().write(area, (left, HEADING / 2.0 + 2.0), self.heading)?;
        if let Some(name) = self.x_name {
            let words = Words::new(12.5).centered();
            words.write(area, (f64::midpoint(left, right), height - 11.0), name)?;
        }
        if let Some(name) = self.y_name {
            let words = Words { upright: false, ..Words::new(12.5).centered() };
            words.write(area, (14.0, f64::midpoint(top, bottom)), name)?;
        }
        Ok(chart)
    }
}

/// How many labels have room.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozens, and not negative")]
fn labels(room: f64) -> usize {
    room.clamp(2.0, 40.0) as usize
}

/// The decimals that tell the labels of an axis apart.
fn decimals(range: &Range<f64>, labels: usize) -> usize {
    let points = RangedCoordf64::from(range.clone()).key_points(BoldPoints(labels));
    let step = points.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(f64::INFINITY, f64::min);
    (0..6)
        .find(|&decimals| {
            let scaled = step * 10_f64.powi(decimals);
            (scaled - scaled.round()).abs() < 1e-6 * scaled.max(1.0) && scaled > 0.5
        })
        .map_or(0, |decimals| decimals.unsigned_abs() as usize)
}

/// A rectangle in chart coordinates; one that is too narrow to be seen is a pixel wide.
pub(super) fn rectangle(chart: &Chart<'_, '_>, x: Range<f64>, y: Range<f64>, color: &impl Color) -> Drawn {
    let [left, right] = [x.start, x.end].map(|x| chart.backend_coord(&(x, y.start)).0);
    if right - left < px(1.0) {
        return polyline(chart, vec![(x.start, y.start), (x.start, y.end)], stroke(color, 1.0));
    }
    let corners = [(x.start, y.start), (x.end, y.end)];
    chart.plotting_area().draw(&Rectangle::new(corners, color.to_rgba().filled()))
}

/// Lines from point to point.
pub(super) fn polyline(chart: &Chart<'_, '_>, points: Vec<(f64, f64)>, style: ShapeStyle) -> Drawn {
    if points.len() < 2 {
        return Ok(());
    }
    chart.plotting_area().draw(&PathElement::new(points, style))
}

/// Dashes, so many pixels on and as many off, between two points of a chart, one above or beside the other.
pub(super) fn dashes(
    chart: &Chart<'_, '_>,
    from: (f64, f64),
    to: (f64, f64),
    color: &impl Color,
    on: f64,
) -> Drawn {
    let (begin, end) = (chart.backend_coord(&from), chart.backend_coord(&to));
    let length = f64::from((end.0 - begin.0).abs() + (end.1 - begin.1).abs());
    let step = f64::from(px(on));
    let mut at = 0.0;
    while at < length {
        let part = |at: f64| {
            let share = (at / length).min(1.0);
            (from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share)
        };
        polyline(chart, vec![part(at), part(at + step)], stroke(color, 1.0))?;
        at += 2.0 * step;
    }
    Ok(())
}
