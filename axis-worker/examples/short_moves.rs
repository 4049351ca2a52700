//! How good short movements are: every length from 1 to 10 000 steps by both methods, against the time that it takes
//! along the continuous speed-time curve. Writes a table and a plot:
//!
//! ```sh
//! cargo run --release -p supersigma-axis-worker --example short_moves -- --out docs/src/generated
//! ```

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use axis_worker::ramp::{Curve, Plan, Table};
use clap::Parser;
use miette::{Context, IntoDiagnostic, Result, miette};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use supersigma_config::{RampConfig, ShortMoves};
use supersigma_protocol::{Distance, SpeedIndex, Ticks};

/// Every length up to here is measured.
const LONGEST: u16 = 10_000;
/// The lengths of the printed table.
const SHOWN: [u16; 18] =
    [1, 2, 3, 5, 10, 20, 30, 50, 100, 199, 200, 500, 1_000, 2_000, 2_600, 5_183, 5_184, 10_000];
/// The ceilings, as entries of the table, under which every length is measured too.
const CEILINGS: [u8; 5] = [20, 60, 100, 150, 200];
/// Below this length the grain of whole periods shows, so the excess is given in periods and not as a ratio.
const GRAINY: u16 = 30;

const OPTIMAL_COLOR: RGBColor = RGBColor(0, 90, 160);
const PAPER_COLOR: RGBColor = RGBColor(190, 70, 20);

/// Measures short movements against the continuous curve; writes a table and a plot
#[derive(Parser)]
struct Args {
    /// The folder for the two files; made if it is not there
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

fn main() -> Result<()> {
    let Args { out } = Args::parse();
    let measured = measure()?;
    fs::create_dir_all(&out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make the folder {}", out.display()))?;
    let text = out.join("short_moves.md");
    fs::write(&text, measured.report())
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", text.display()))?;
    let picture = out.join("short_moves.svg");
    plot(&measured.full, &picture).wrap_err_with(|| format!("cannot draw {}", picture.display()))?;
    println!("{}\n{}", text.display(), picture.display());
    Ok(())
}

/// One length: seconds along the curve, and by each method.
#[derive(Clone, Copy)]
struct Row {
    steps: u16,
    curve: f64,
    optimal: f64,
    paper: f64,
}

/// One method, as it is chosen from a row.
type Method = fn(&Row) -> f64;
const OPTIMAL: Method = |row| row.optimal;
const PAPER: Method = |row| row.paper;

impl Row {
    fn ratio(&self, method: Method) -> f64 {
        method(self) / self.curve
    }
}

/// Everything that was measured.
struct Measured {
    /// With the whole table.
    full: Vec<Row>,
    /// Under ceilings: entry, its speed in steps per second, the rows.
    limited: Vec<(u8, f64, Vec<Row>)>,
    /// Seconds of one period at start speed.
    start_period: f64,
}

fn measure() -> Result<Measured> {
    let ramp = RampConfig { short_moves: ShortMoves::Optimal, ..RampConfig::default() };
    let optimal = Table::new(&ramp).into_diagnostic()?;
    let paper =
        Table::new(&RampConfig { short_moves: ShortMoves::Paper, ..ramp.clone() }).into_diagnostic()?;
    let curve = Curve::new(&ramp);
    let rows = |limit| -> Vec<Row> {
        let seconds = |table, distance| Ticks(Plan::ramped(table, distance, limit).duration()).as_seconds();
        (1..=LONGEST)
            .filter_map(Distance::new)
            .map(|distance| Row {
                steps: distance.get(),
                curve: curve.seconds(&optimal, distance, limit),
                optimal: seconds(&optimal, distance),
                paper: seconds(&paper, distance),
            })
            .collect()
    };
    let limited = CEILINGS.into_iter().filter_map(SpeedIndex::new);
    Ok(Measured {
        full: rows(SpeedIndex::TOP),
        limited: limited.map(|limit| (limit.get(), optimal.speed(limit), rows(limit))).collect(),
        start_period: Ticks(optimal.period(SpeedIndex::START).into()).as_seconds(),
    })
}

/// The row with the largest ratio.
fn worst(rows: &[Row], method: Method) -> Option<&Row> {
    rows.iter().max_by(|a, b| a.ratio(method).total_cmp(&b.ratio(method)))
}

/// The row with the smallest ratio.
fn best(rows: &[Row], method: Method) -> Option<&Row> {
    rows.iter().min_by(|a, b| a.ratio(method).total_cmp(&b.ratio(method)))
}

#[expect(clippy::cast_precision_loss, reason = "some thousands of rows")]
fn mean(rows: &[Row], method: Method) -> f64 {
    rows.iter().map(|row| row.ratio(method)).sum::<f64>() / rows.len() as f64
}

impl Measured {
    fn report(&self) -> String {
        let mut lines = vec![
            "<!-- Made by the example `short_moves` of the crate axis-worker; do not edit. -->".to_owned(),
            String::new(),
            "| steps | along the curve, ms | optimal, ms | × | paper, ms | × |".into(),
            "|---:|---:|---:|---:|---:|---:|".into(),
        ];
        lines.extend(self.full.iter().filter(|row| SHOWN.contains(&row.steps)).map(|row| {
            format!(
                "| {} | {:.2} | {:.2} | {:.4} | {:.2} | {:.2} |",
                row.steps,
                row.curve * 1e3,
                row.optimal * 1e3,
                row.ratio(OPTIMAL),
                row.paper * 1e3,
                row.ratio(PAPER)
            )
        }));
        lines.push(format!(
            "\nAll lengths from 1 to {LONGEST} steps, as multiples of the time along the curve:\n"
        ));
        lines.push("| ceiling, steps/s | method | worst | at steps | mean | least | at steps |".into());
        lines.push("|---:|---|---:|---:|---:|---:|---:|".into());
        lines.extend(summary("none", &self.full));
        for (entry, speed, rows) in &self.limited {
            lines.extend(summary(&format!("{speed:.0} (entry {entry})"), rows));
        }
        lines.push(format!(
            "\nUnder {GRAINY} steps, the largest excess over the time along the curve is {:.3} periods at start \
             speed ({:.2} ms) by the optimal method, {:.1} by the paper's.\n",
            self.excess(OPTIMAL),
            self.start_period * 1e3,
            self.excess(PAPER)
        ));
        lines.push(EXPLANATION.into());
        lines.join("\n")
    }

    /// The largest excess of short movements, in periods at start speed.
    fn excess(&self, method: Method) -> f64 {
        let short = self.full.iter().filter(|row| row.steps < GRAINY);
        short.map(|row| (method(row) - row.curve) / self.start_period).fold(f64::NEG_INFINITY, f64::max)
    }
}

fn summary(ceiling: &str, rows: &[Row]) -> Vec<String> {
    let line = |(name, method): (&str, Method)| {
        let (worst, best) = (worst(rows, method)?, best(rows, method)?);
        Some(format!(
            "| {ceiling} | {name} | {:.4} | {} | {:.4} | {:.4} | {} |",
            worst.ratio(method),
            worst.steps,
            mean(rows, method),
            best.ratio(method),
            best.steps
        ))
    };
    [("optimal", OPTIMAL), ("paper", PAPER)].into_iter().filter_map(line).collect()
}

const EXPLANATION: &str = "\
\"Along the curve\" is the continuous V(t) = 15 000 sin²(4.544 26 t + 0.209 7): up along it, at the ceiling if the movement
gets there, and back down along it, so that the area is the number of steps. A ratio a little below 1 is no error: the
card plays the curve as a staircase, of which entry i + 1 rules from i intervals after the start on, not from i + 1. So
a ramp is ahead of the curve by half an interval of 1.29 ms on average, and a movement by a whole one at most.
";

fn plot(rows: &[Row], path: &Path) -> Result<()> {
    draw(rows, path).map_err(|error| miette!("{error}"))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn draw(rows: &[Row], path: &Path) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::new(path, (960, 820)).into_drawing_area();
    root.fill(&WHITE)?;
    let (both, close) = root.split_vertically(500);
    let methods = [("paper, 1980", PAPER, PAPER_COLOR), ("optimal", OPTIMAL, OPTIMAL_COLOR)];
    let all = Panel {
        title: "Time of a movement by both methods ÷ time along the continuous curve",
        ratio: "ratio (logarithmic)",
        decimals: 0,
        labels: 12,
        rows,
        methods: &methods,
    };
    all.draw(&both, (0.8..7.0).log_scale())?;
    let optimal = Panel {
        title: "The optimal method alone, enlarged",
        ratio: "ratio",
        decimals: 2,
        labels: 7,
        methods: &methods[1..],
        ..all
    };
    optimal.draw(&close, 0.98..1.04)?;
    root.present()?;
    Ok(())
}

/// The ratios of some methods over the length.
struct Panel<'a> {
    title: &'a str,
    /// The name of the vertical axis.
    ratio: &'a str,
    /// Of its labels.
    decimals: usize,
    /// How many there may be.
    labels: usize,
    rows: &'a [Row],
    methods: &'a [(&'a str, Method, RGBColor)],
}

impl Panel<'_> {
    fn draw<Y>(&self, area: &Area<'_>, ratios: Y) -> Result<(), Box<dyn Error>>
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, ("sans-serif", 21))
            .margin(12)
            .margin_right(36)
            .x_label_area_size(48)
            .y_label_area_size(64)
            .build_cartesian_2d((1.0..f64::from(LONGEST)).log_scale(), ratios)?;
        chart
            .configure_mesh()
            .x_desc("length of the movement, steps (logarithmic)")
            .y_desc(self.ratio)
            .x_label_formatter(&|steps| format!("{steps:.0}"))
            .y_label_formatter(&|ratio| format!("{ratio:.*}×", self.decimals))
            .y_labels(self.labels)
            .y_max_light_lines(2)
            .axis_desc_style(("sans-serif", 17))
            .label_style(("sans-serif", 16))
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(210, 210, 210))
            .draw()?;
        for (name, method, color) in self.methods {
            let points = thinned(self.rows).map(|row| (f64::from(row.steps), row.ratio(*method)));
            chart
                .draw_series(LineSeries::new(points, color.stroke_width(2)))?
                .label(*name)
                .legend(|(x, y)| PathElement::new([(x, y), (x + 24, y)], color.stroke_width(2)));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE)
            .border_style(RGBColor(180, 180, 180))
            .label_font(("sans-serif", 17))
            .draw()?;
        Ok(())
    }
}

/// No more rows than can be told apart: all up to 400 steps, then one for each four-hundredth of the length.
fn thinned(rows: &[Row]) -> impl Iterator<Item = &Row> {
    let mut next = 0.0;
    rows.iter().filter(move |row| {
        let steps = f64::from(row.steps);
        let shown = steps >= next;
        if shown {
            next = steps * (1.0 + 1.0 / 400.0);
        }
        shown
    })
}
