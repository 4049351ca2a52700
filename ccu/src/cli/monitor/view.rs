//! What the one who looks has chosen, and what a key means. Pure: it asks for things, it does not do them.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::layout::Rect;
use supersigma_protocol::AxisNumber;

use crate::executive::Request;
use crate::watch::{Detail, Filter};

/// A minute of speed: what its curve is scaled by.
const HISTORY: usize = 600;

/// What a key asks for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Wish {
    /// No more of this.
    Quit,
    /// This of the set; in words for the one who asked.
    Ask(Request, String),
}

/// Where keys go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Mode {
    /// They command.
    #[default]
    Commands,
    /// They command, and the help tells what.
    Help,
    /// Into the filter.
    Typing,
}

/// What is chosen.
#[derive(Debug, Clone, Default)]
pub(super) struct View {
    axes: Vec<(AxisNumber, String)>,
    /// The selected axis: an index into `axes`.
    selected: Option<usize>,
    filter: String,
    /// Frames of the selected axis alone.
    only_selected: bool,
    all_frames: bool,
    pub(super) mode: Mode,
    pub(super) said: Option<String>,
    changed: bool,
}

impl View {
    pub(super) fn new(axes: Vec<(AxisNumber, String)>) -> Self {
        Self { axes, ..Self::default() }
    }

    /// The selected axis.
    pub(super) fn selected(&self) -> Option<(AxisNumber, &str)> {
        self.selected.and_then(|index| self.axes.get(index)).map(|(axis, name)| (*axis, name.as_str()))
    }

    /// Whom halt, brake and clear are for.
    pub(super) fn whom(&self) -> &str {
        self.selected().map_or("all axes", |(_, name)| name)
    }

    /// Which frames are shown.
    pub(super) fn filter(&self) -> Filter {
        let axis = self.selected().filter(|_| self.only_selected).map(|(axis, _)| axis);
        Filter { axis, text: self.filter.clone(), all: self.all_frames }
    }

    /// What a screen of this size has room for.
    pub(super) fn detail(&self, area: Rect) -> Detail {
        let rows = usize::from(area.height);
        Detail { frames: rows, filter: self.filter(), events: rows, history: HISTORY }
    }

    /// Tells what came of a request.
    pub(super) fn say(&mut self, text: String) {
        (self.said, self.changed) = (Some(text), true);
    }

    /// Whether there is something new to draw since it was asked last.
    pub(super) fn is_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// A key.
    pub(super) fn press(&mut self, key: KeyEvent) -> Option<Wish> {
        if key.kind == KeyEventKind::Release {
            return None;
        }
        self.changed = true;
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            return (key.code == KeyCode::Char('c')).then_some(Wish::Quit);
        }
        if self.mode == Mode::Typing {
            self.type_in(key.code);
            return None;
        }
        self.said = None;
        match key.code {
            KeyCode::Char('q') => return Some(Wish::Quit),
            KeyCode::Char('h') => return Some(self.of_selected("halt", |axes| Request::Halt { axes })),
            KeyCode::Char('b') => return Some(self.of_selected("brake", |axes| Request::Brake { axes })),
            KeyCode::Char('c') => return Some(self.of_selected("clear", |axes| Request::Clear { axes })),
            KeyCode::Char('H' | ' ') => return Some(of_all("halt", Request::Halt { axes: vec![] })),
            KeyCode::Char('B') => return Some(of_all("brake", Request::Brake { axes: vec![] })),
            KeyCode::Char('C') => return Some(of_all("clear", Request::Clear { axes: vec![] })),
            KeyCode::Char('r') => return Some(Wish::Ask(Request::Resume, "resume".to_owned())),
            KeyCode::Char('f') => self.only_selected = !self.only_selected,
            KeyCode::Char('a') => self.all_frames = !self.all_frames,
            KeyCode::Char('/') => self.mode = Mode::Typing,
            KeyCode::Char('?') if self.mode == Mode::Commands => self.mode = Mode::Help,
            KeyCode::Char('?') | KeyCode::Esc if self.mode == Mode::Help => self.mode = Mode::Commands,
            KeyCode::Esc => (self.selected, self.only_selected) = (None, false),
            KeyCode::Down | KeyCode::Char('j') => self.select(self.selected.map_or(0, |index| index + 1)),
            KeyCode::Up | KeyCode::Char('k') => {
                self.select(self.selected.unwrap_or(self.axes.len()).saturating_sub(1));
            }
            KeyCode::Char(digit @ '1'..='7') => {
                let number = digit.to_digit(10).and_then(|digit| u8::try_from(digit).ok());
                let axis = number.and_then(AxisNumber::new);
                self.selected =
                    self.axes.iter().position(|(known, _)| Some(*known) == axis).or(self.selected);
            }
            _ => {}
        }
        None
    }

    fn type_in(&mut self, code: KeyCode) {
        match code {
            KeyCode::Enter => self.mode = Mode::Commands,
            KeyCode::Esc => {
                self.mode = Mode::Commands;
                self.filter.clear();
            }
            KeyCode::Backspace => drop(self.filter.pop()),
            KeyCode::Char(char) => self.filter.push(char),
            _ => {}
        }
    }

    fn select(&mut self, index: usize) {
        self.selected = self.axes.len().checked_sub(1).map(|last| index.min(last));
    }

    fn of_selected(&self, what: &str, request: impl Fn(Vec<AxisNumber>) -> Request) -> Wish {
        match self.selected() {
            Some((axis, name)) => Wish::Ask(request(vec![axis]), format!("{what} {name}")),
            None => of_all(what, request(vec![])),
        }
    }
}

fn of_all(what: &str, request: Request) -> Wish {
    Wish::Ask(request, format!("{what} all axes"))
}
