//! The axes' rows: rail, position, lamps, speed and its curve, activity or alarm, within whatever width there is.

use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use supersigma_protocol::{AxisNumber, Position};

use crate::watch::{AxisSnapshot, RailView};

/// How many slots of 100 ms are one column of a curve.
const SLOTS_A_COLUMN: usize = 5;
/// Below this many steps a second a curve is not stretched any more.
const LEAST_SCALE: f64 = 100.0;

/// The columns of the rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns {
    name: usize,
    rail: usize,
    curve: usize,
    last: usize,
}

impl Columns {
    /// The longest activity, `seeking reference`, has 17 letters.
    const ACTIVITY: usize = 17;
    /// Marker and number, position, lamps, speed, each with the blanks round it, and the one behind the curve.
    const FIXED: usize = 5 + 10 + 5 + 9 + 1;

    /// What fits into `width`: the rail gets what the others leave; narrow screens do without it, and cut the right end.
    pub(super) fn new(axes: &[AxisSnapshot], width: u16) -> Self {
        let width = usize::from(width);
        let name = axes.iter().map(|axis| axis.name.chars().count()).max().unwrap_or(0).clamp(4, 16);
        let curve = 8 + width.saturating_sub(80) / 4;
        let last = if width < 100 { 13 } else { Self::ACTIVITY + width.saturating_sub(100) / 3 };
        let rail = width.saturating_sub(name + Self::FIXED + curve + last);
        Self { name, rail: if rail < 6 { 0 } else { rail }, curve, last }
    }

    /// The titles.
    pub(super) fn title(&self) -> Line<'static> {
        let Self { name, rail, curve, .. } = *self;
        let text = format!(
            "  # {:<name$} {:<rail$} {:>7} X1..5 {:>7} {:<curve$} {}",
            "axis",
            if rail == 0 { "" } else { "rail" },
            "position",
            "steps/s",
            "",
            "activity"
        );
        Line::from(text).dim()
    }

    /// One axis.
    pub(super) fn row(&self, axis: &AxisSnapshot, selected: bool) -> Line<'static> {
        let Self { name, curve, last, .. } = *self;
        let locked = axis.alarm.is_some();
        let marker = if selected { "▶" } else { " " };
        let style = if selected { Style::new().add_modifier(Modifier::BOLD) } else { Style::new() };
        let title = format!("{marker} {} {:<name$.name$} ", axis.axis.get(), axis.name);
        let mut row = Line::from(vec![Span::styled(title, style)]);
        self.rail(axis, &mut row);
        if !axis.alive {
            row.push_span(Span::styled("  its card is not heard", Color::Red));
            return row;
        }
        let position = axis.position.map_or_else(|| "?".to_owned(), |position| position.to_string());
        row.push_span(format!(" {position:>8} "));
        for lamp in axis.sense.as_deref().unwrap_or("?????").chars() {
            row.push_span(match lamp {
                '1' => "●".yellow(),
                '0' => "○".dim(),
                _ => "?".dim(),
            });
        }
        match &axis.alarm {
            Some(alarm) if locked => {
                let width = 8 + curve + 1 + last;
                let text = format!(" {:.width$}", alarm.message);
                row.push_span(Span::styled(text, Style::new().fg(Color::Red).add_modifier(Modifier::BOLD)));
            }
            _ => {
                row.push_span(format!(" {:>7.0} ", axis.speed));
                row.push_span(format!("{:>curve$} ", curve_of(&axis.speed_history, curve)).cyan());
                let activity = axis.activity.map_or_else(|| "?".to_owned(), |activity| activity.to_string());
                let text = format!("{activity:.last$}");
                row.push_span(if activity == "standing" { text.dim() } else { text.green() });
            }
        }
        row
    }

    fn rail(&self, axis: &AxisSnapshot, row: &mut Line<'static>) {
        for (index, cell) in cells(&axis.rail, self.rail).into_iter().enumerate() {
            let here =
                axis.position.filter(|_| axis.alive).map(|position| cell_of(&axis.rail, self.rail, position));
            row.push_span(if here == Some(index) {
                Span::styled("█", if axis.alarm.is_some() { Color::Red } else { Color::Cyan })
            } else {
                match cell {
                    Cell::Zone => Span::styled("░", Color::Yellow),
                    Cell::Beyond => "·".dim(),
                    Cell::Travel => "─".dim(),
                    Cell::Reference => Span::styled("┼", Color::Magenta),
                    Cell::Limit => "┤".into(),
                }
            });
        }
    }
}

/// What lies on a column of a rail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cell {
    /// A limit zone.
    Zone,
    /// Neither limit zone nor permitted.
    Beyond,
    /// Permitted.
    Travel,
    /// The reference step.
    Reference,
    /// The highest permitted position.
    Limit,
}

fn cells(rail: &RailView, width: usize) -> Vec<Cell> {
    if width == 0 {
        return Vec::new();
    }
    let at = |position| cell_of(rail, width, position);
    let mut cells: Vec<Cell> = (0..width)
        .map(|index| match index {
            index if index <= at(rail.lower_zone) || index >= at(rail.upper_zone) => Cell::Zone,
            index if index < at(rail.travel_min) || index > at(rail.travel_max) => Cell::Beyond,
            _ => Cell::Travel,
        })
        .collect();
    for (position, mark) in [(rail.travel_max, Cell::Limit), (rail.reference, Cell::Reference)] {
        let cell = &mut cells[at(position)];
        if *cell == Cell::Travel {
            *cell = mark;
        }
    }
    cells
}

/// The column, of `width`, that a position lies on; the first or the last for what lies beyond the stops.
fn cell_of(rail: &RailView, width: usize, position: Position) -> usize {
    let [lower, upper, position] = [rail.lower_stop, rail.upper_stop, position].map(|at| i64::from(at.0));
    let (width, length) = (i64::try_from(width).unwrap_or(i64::MAX), upper - lower + 1);
    let cell = (position.clamp(lower, upper) - lower) * width / length.max(1);
    usize::try_from(cell).unwrap_or(0)
}

/// Speed over time, half a second a column, the newest on the right; full height is the fastest of the last minute.
fn curve_of(history: &[f64], width: usize) -> String {
    const STEPS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let fastest = |slots: &[f64]| slots.iter().fold(0.0_f64, |fastest, speed| fastest.max(speed.abs()));
    let scale = fastest(history).max(LEAST_SCALE);
    let columns = history.rchunks(SLOTS_A_COLUMN).take(width).map(|slots| {
        let part = fastest(slots) / scale;
        let step =
            (1..STEPS.len()).rev().find(|step| part * 8.0 >= f64::from(u8::try_from(*step).unwrap_or(8)));
        match step {
            Some(step) => STEPS[step],
            None if part > 0.0 => STEPS[1],
            None => STEPS[0],
        }
    });
    columns.collect::<Vec<_>>().into_iter().rev().collect()
}

/// Whether a row is that of the selected axis.
pub(super) fn is(selected: Option<(AxisNumber, &str)>, axis: &AxisSnapshot) -> bool {
    selected.is_some_and(|(number, _)| number == axis.axis)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rail() -> RailView {
        let [lower_stop, lower_zone, upper_zone, upper_stop] = [-101, -1, 799, 898].map(Position);
        let [reference, travel_min, travel_max] = [250, 0, 650].map(Position);
        RailView { lower_stop, lower_zone, upper_zone, upper_stop, reference, travel_min, travel_max }
    }

    #[test]
    fn a_column_is_a_part_of_the_rail() {
        // 1000 steps on 10 columns.
        for (position, cell) in [(-500, 0), (-101, 0), (-2, 0), (-1, 1), (99, 2), (898, 9), (5_000, 9)] {
            assert_eq!(cell_of(&rail(), 10, Position(position)), cell, "{position}");
        }
        assert_eq!(cell_of(&rail(), 1, Position(400)), 0);
    }

    #[test]
    fn a_rail_shows_zones_reference_and_limit() {
        let signs = |cell| match cell {
            Cell::Zone => '#',
            Cell::Beyond => '.',
            Cell::Travel => '-',
            Cell::Reference => 'R',
            Cell::Limit => ']',
        };
        let drawn: String = cells(&rail(), 20).into_iter().map(signs).collect();
        assert_eq!(drawn, "###----R-------]..##");
        assert!(cells(&rail(), 0).is_empty());
    }

    #[test]
    fn a_curve_is_half_a_second_a_column_and_scaled_to_the_minute() {
        let mut history = vec![-8_000.0; 5];
        history.extend([4_000.0, 0.0, 0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(curve_of(&history, 8), "█▄▁ ");
        assert_eq!(curve_of(&history, 2), "▁ ");
        assert_eq!(curve_of(&[50.0; 5], 3), "▄");
    }
}
