//! A frame as one line for people, in columns that stay aligned through a log. It only lays out what `view` decoded.

use std::fmt::Write as _;

use supersigma_protocol::{Direction, Tick};

use super::header::AxisNames;
use super::view::{AboutView, AnswerView, CommandView, FrameView, ReportView, UndecodableView};

/// The layout of the lines of one log.
#[derive(Debug, Clone)]
pub struct Lines {
    /// The width of a name's column.
    names: usize,
    narrow: bool,
}

impl Lines {
    /// Columns wide enough for these names, and for `digital outputs`.
    #[must_use]
    pub fn new(names: &AxisNames) -> Self {
        let longest = names.iter().map(|(_, name)| name.len()).max().unwrap_or(0);
        Self { names: longest.max("digital outputs".len()), narrow: false }
    }

    /// Columns for a narrow place: only the other end of a frame is named, and time is told to the millisecond.
    #[must_use]
    pub fn narrow(names: &AxisNames) -> Self {
        let longest = names.iter().map(|(_, name)| name.len()).max().unwrap_or(0);
        Self { names: longest.max("digital".len()), narrow: true }
    }

    /// The columns' titles.
    #[must_use]
    pub fn title(&self) -> String {
        if self.narrow {
            return format!(
                "{:>9}    {:<width$}  {:<14} {:<5} {:>6} {:>8} {:>7}  {}",
                "seconds",
                "card",
                "what",
                "X1..5",
                "steps",
                "position",
                "steps/s",
                "activity",
                width = self.names
            );
        }
        format!(
            "{:>15}  {:<width$}   {:<width$}  {:<29} {:<5} {:>6} {:>8} {:>7}  {}",
            "seconds",
            "from",
            "to",
            "what",
            "X1..5",
            "steps",
            "position",
            "steps/s",
            "activity",
            width = self.names
        )
    }

    /// One frame.
    #[must_use]
    pub fn line(&self, frame: &FrameView) -> String {
        let mut line = match frame {
            FrameView::Command(command) => self.command(command),
            FrameView::Answer(answer) => self.answer(answer),
            FrameView::Undecodable(UndecodableView { bytes, error }) => {
                format!("{}{error} [{bytes}]", self.start(None, "?", "?"))
            }
        };
        line.truncate(line.trim_end().len());
        line
    }

    fn start(&self, tick: Option<Tick>, from: &str, to: &str) -> String {
        let width = self.names;
        if self.narrow {
            let seconds = tick.map_or_else(|| "-".to_owned(), milliseconds);
            let (arrow, card) = if to == "ccu" { ('←', from) } else { ('→', to) };
            return format!("{seconds:>9}  {arrow} {card:<width$}  ");
        }
        let seconds = tick.map_or_else(|| "-".to_owned(), seconds);
        format!("{seconds:>15}  {from:<width$} → {to:<width$}  ")
    }

    fn command(&self, view: &CommandView) -> String {
        let mut line = self.start(Some(view.tick), &view.sender, &view.name);
        let _ = write!(line, "#{}", view.sequence.0);
        match (view.operation, &view.refusal) {
            (Some(operation), _) => line.extend([" ", operation]),
            (None, Some(refusal)) => {
                let _ = write!(line, " [{}] not a command: {refusal}", view.bytes);
            }
            (None, None) => {}
        }
        if let Some(direction) = view.direction {
            line.push_str(match direction {
                Direction::Forward => " +",
                Direction::TowardsOrigin => " -",
            });
        } else if view.steps.is_some() {
            line.push(' ');
        }
        if let Some(steps) = view.steps {
            let _ = write!(line, "{steps}");
        }
        if let Some(speed) = view.speed {
            let _ = write!(line, " speed {}", speed.get());
        }
        if let Some(word) = view.word {
            let _ = write!(line, " {word:016b}");
        }
        if let Some(fault) = &view.fault {
            let _ = write!(line, ": {fault}");
        }
        if let Some(at) = view.at {
            let _ = write!(line, " at {} s", seconds(at));
        }
        line
    }

    fn answer(&self, view: &AnswerView) -> String {
        let mut line = self.start(Some(view.tick), &view.sender, "ccu");
        let (what, refusal) = match &view.about {
            AboutView::Command { command, refusal: None } => (format!("takes #{}", command.0), None),
            AboutView::Command { command, refusal: Some(refusal) } => {
                (format!("refuses #{}", command.0), Some(&refusal.message))
            }
            AboutView::Unasked { unasked } => ((*unasked).to_owned(), None),
        };
        let width = if self.narrow { 14 } else { 29 };
        let _ = write!(line, "{what:<width$} ");
        match &view.report {
            ReportView::Axis(axis) => {
                let position = axis.position.map_or_else(|| "?".to_owned(), |position| position.to_string());
                let _ = write!(
                    line,
                    "{} {:>6} {position:>8} {:>7.0}  {:<17}",
                    axis.sense, axis.steps, axis.speed, axis.activity
                );
                if let Some(alarm) = &axis.alarm {
                    let _ = write!(line, "  alarm: {}", alarm.message);
                }
            }
            ReportView::Digital(digital) => {
                let _ = write!(line, "{}: {:016b}", view.name, digital.word);
            }
        }
        if let Some(refusal) = refusal {
            let _ = write!(line, "  refused: {refusal}");
        }
        line
    }
}

/// Exact: a tick is 0.000 000 5 s.
fn seconds(tick: Tick) -> String {
    format!("{}.{:07}", tick.0 / Tick::PER_SECOND, tick.0 % Tick::PER_SECOND * 5)
}

/// Cut, not rounded: a frame is not shown before its time.
fn milliseconds(tick: Tick) -> String {
    format!("{}.{:03}", tick.0 / Tick::PER_SECOND, tick.0 % Tick::PER_SECOND / (Tick::PER_SECOND / 1_000))
}
