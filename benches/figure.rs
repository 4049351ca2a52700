//! What the rooms hand over, and the tables made of it: for the terminal, for the book, and as rows for comparing runs.
//! Measures nothing.

use std::error::Error;
use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::path::Path;

use jiff::Timestamp;
use supersigma_tests::machine;

/// One measured number.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// What belongs together in the table: "bus", "machine".
    pub(crate) room: &'static str,
    /// What was measured, with its statistic: "command to answer, p50".
    pub(crate) what: String,
    pub(crate) value: f64,
    pub(crate) unit: &'static str,
    /// How it stands to something measured beside it.
    pub(crate) against: Option<Against>,
    /// What was promised, in words that name the bound: "≤ 1.3 ×".
    pub(crate) goal: Option<Goal>,
}

/// A ratio to a reference of the same run.
#[derive(Debug, Clone)]
pub(crate) struct Against {
    pub(crate) reference: &'static str,
    pub(crate) ratio: f64,
}

/// A bound, and whether it was kept.
#[derive(Debug, Clone)]
pub(crate) struct Goal {
    pub(crate) bound: String,
    pub(crate) met: bool,
}

impl Figure {
    pub(crate) fn new(room: &'static str, what: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { room, what: what.into(), value, unit, against: None, goal: None }
    }

    /// Sets it beside `of`, measured in the same run.
    pub(crate) fn against(mut self, reference: &'static str, of: f64) -> Self {
        self.against = Some(Against { reference, ratio: self.value / of });
        self
    }

    /// Promises a ratio of at most so much.
    pub(crate) fn ratio_at_most(mut self, bound: f64) -> Self {
        let met = self.against.as_ref().is_some_and(|against| against.ratio <= bound);
        self.goal = Some(Goal { bound: format!("≤ {bound} ×"), met });
        self
    }

    /// Promises a ratio of at least so much.
    pub(crate) fn ratio_at_least(mut self, bound: f64) -> Self {
        let met = self.against.as_ref().is_some_and(|against| against.ratio >= bound);
        self.goal = Some(Goal { bound: format!("≥ {bound} ×"), met });
        self
    }

    /// Promises a value of at most so much.
    pub(crate) fn at_most(mut self, bound: f64) -> Self {
        self.goal =
            Some(Goal { bound: format!("≤ {} {}", number(bound), self.unit), met: self.value <= bound });
        self
    }

    /// Promises a value of at least so much.
    pub(crate) fn at_least(mut self, bound: f64) -> Self {
        self.goal =
            Some(Goal { bound: format!("≥ {} {}", number(bound), self.unit), met: self.value >= bound });
        self
    }

    fn cells(&self) -> [String; 5] {
        let (reference, ratio) = match &self.against {
            Some(against) => (against.reference.to_owned(), format!("{:.2} ×", against.ratio)),
            None => (String::new(), String::new()),
        };
        let goal = self.goal.as_ref().map_or_else(String::new, |goal| {
            format!("{}: {}", goal.bound, if goal.met { "met" } else { "missed" })
        });
        [self.what.clone(), format!("{} {}", number(self.value), self.unit), ratio, reference, goal]
    }
}

/// Three or four digits that mean something.
fn number(value: f64) -> String {
    let digits = match value.abs() {
        size if size >= 100.0 || size == 0.0 => 0,
        size if size >= 10.0 => 1,
        size if size >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.digits$}")
}

const HEAD: [&str; 5] = ["what", "measured", "ratio", "to", "goal"];

/// All figures of a run, and the machine that they were measured on.
#[derive(Debug)]
pub(crate) struct Report {
    machine: String,
    figures: Vec<Figure>,
}

impl Report {
    pub(crate) fn of_this_machine() -> Self {
        Self { machine: machine(), figures: Vec::new() }
    }

    /// Keeps a room's figures, and gives them as a table for the terminal.
    pub(crate) fn add(&mut self, figures: Vec<Figure>) -> String {
        let rows: Vec<[String; 5]> = figures.iter().map(Figure::cells).collect();
        let mut widths = HEAD.map(|title| title.chars().count());
        for row in &rows {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = (*width).max(cell.chars().count());
            }
        }
        let mut table = format!("\n{}\n", figures.first().map_or("", |figure| figure.room));
        for row in std::iter::once(&HEAD.map(str::to_owned)).chain(&rows) {
            let [what, measured, ratio, reference, goal] = row;
            let [of_what, of_measured, of_ratio, of_reference, _] = widths;
            let line = format!(
                "  {what:<of_what$}  {measured:>of_measured$}  {ratio:>of_ratio$}  {reference:<of_reference$}  {goal}"
            );
            let _ = writeln!(table, "{}", line.trim_end());
        }
        self.figures.extend(figures);
        table
    }

    /// Writes `performance.md` anew and appends a row a figure to `performance.csv`.
    pub(crate) fn record(&self, folder: &Path) -> Result<(), Box<dyn Error>> {
        fs::write(folder.join("performance.md"), self.markdown())?;
        let path = folder.join("performance.csv");
        let fresh = !path.exists();
        let mut rows = csv::Writer::from_writer(OpenOptions::new().create(true).append(true).open(path)?);
        if fresh {
            rows.write_record([
                "day",
                "machine",
                "room",
                "what",
                "value",
                "unit",
                "reference",
                "ratio",
                "goal",
                "met",
            ])?;
        }
        let day = Timestamp::now().strftime("%Y-%m-%d").to_string();
        for figure in &self.figures {
            let against = figure.against.as_ref();
            let goal = figure.goal.as_ref();
            rows.write_record([
                day.as_str(),
                self.machine.as_str(),
                figure.room,
                figure.what.as_str(),
                format!("{:.6}", figure.value).as_str(),
                figure.unit,
                against.map_or("", |against| against.reference),
                against.map_or_else(String::new, |against| format!("{:.4}", against.ratio)).as_str(),
                goal.map_or("", |goal| goal.bound.as_str()),
                goal.map_or("", |goal| if goal.met { "yes" } else { "no" }),
            ])?;
        }
        rows.flush()?;
        Ok(())
    }

    fn markdown(&self) -> String {
        let mut text = String::from(
            "<!-- Made by `cargo bench -p supersigma-ccu --bench performance -- --record docs`; do not edit. -->\n",
        );
        let _ = writeln!(text, "\nMeasured on {}.", self.machine);
        for of_one in self.figures.chunk_by(|one, next| one.room == next.room) {
            let _ = writeln!(text, "\n## {}\n", of_one[0].room);
            let _ = writeln!(text, "| {} |\n|---|---:|---:|---|---|", HEAD.join(" | "));
            for figure in of_one {
                let _ = writeln!(text, "| {} |", figure.cells().join(" | "));
            }
        }
        text
    }
}
