//! The dashboard on a buffer of any size. What does not fit is left out, from the bottom and the right; nothing in here
//! can fail.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Block, Clear};

use super::axes::{Columns, is};
use super::live::Link;
use super::view::{Mode, View};
use crate::control::{RecorderState, RecorderView};
use crate::watch::{DigitalSnapshot, EventView, LaneName, SetView, Snapshot};

/// What is drawn.
pub(super) struct Scene<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) link: &'a Link,
    pub(super) view: &'a View,
}

/// What the keys do.
const HELP: &str = "\
 h b c   halt, brake, clear the selected axis; all, if none is
 space H halt all         B  brake all         C  clear all
 r       resume what was halted; quitting halts it again
 ↑ ↓ 1-7 select an axis   Esc  select none
 f       frames of the selected axis alone
 a       samples and heartbeats too
 /       only lines with this text; Esc drops it
 q       quit

 rail    ░ limit zone  ┼ reference step  ┤ end of the travel
         █ the axis    · not permitted
 X1..X5  lower zone, upper zone, reference, complete, slow
 curve   speed, half a second a column; full height is the
         fastest of the last minute";

/// Draws the scene.
pub(super) fn draw(frame: &mut Frame<'_>, scene: &Scene<'_>) {
    let area = frame.area();
    let Snapshot { axes, .. } = scene.snapshot;
    let digital = digital(scene.snapshot, area.width);
    let rows = |count: usize| u16::try_from(count).unwrap_or(u16::MAX);
    let digital_rows = if area.height < 16 { 0 } else { rows(digital.lines.len()) };
    let event_rows = match area.height {
        0..20 => 0,
        20..30 => 4,
        height => height / 5,
    };
    let [header, axes_area, digital_area, events, frames, footer] = Layout::vertical([
        Constraint::Length(2),
        Constraint::Length(1 + rows(axes.len())),
        Constraint::Length(digital_rows),
        Constraint::Length(event_rows),
        Constraint::Fill(1),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(Text::from(head(scene, area.width)), header);
    let columns = Columns::new(axes, area.width);
    let selected = scene.view.selected();
    let table = std::iter::once(columns.title())
        .chain(axes.iter().map(|axis| columns.row(axis, is(selected, axis))))
        .collect::<Vec<_>>();
    frame.render_widget(Text::from(table), axes_area);
    frame.render_widget(digital, digital_area);
    frame.render_widget(event_lines(&scene.snapshot.events, events), events);
    frame.render_widget(frame_lines(scene, frames), frames);
    frame.render_widget(foot(scene.view, area.width), footer);
    if scene.view.mode == Mode::Help {
        help(frame, area);
    }
}

fn head(scene: &Scene<'_>, width: u16) -> Vec<Line<'static>> {
    let Snapshot { set, commands, answers, dropped, lost, .. } = scene.snapshot;
    let name = set.as_ref().map_or("?", |set| set.name.as_str());
    let mut first = Line::from(vec![Span::styled(format!(" {name} "), Modifier::REVERSED | Modifier::BOLD)]);
    match scene.link {
        Link::Up => {}
        Link::Silent(since) => {
            let text = format!(" SILENT for {} s", since.as_secs());
            first.push_span(Span::styled(text, Style::new().fg(Color::Red).add_modifier(Modifier::BOLD)));
        }
        Link::Down => {
            let text = " DOWN; waiting for it to come up again";
            first.push_span(Span::styled(text, Style::new().fg(Color::Red).add_modifier(Modifier::BOLD)));
            return vec![first, Line::from(" as it was last:").dim()];
        }
    }
    let lost = set.as_ref().map_or(*lost, |set| set.lost.max(*lost));
    first.push_span(format!("  {} frames/s", commands.per_second + answers.per_second));
    let lost_text = format!("  {lost} lost");
    first.push_span(if lost > 0 { lost_text.red().bold() } else { lost_text.into() });
    if *dropped > 0 {
        first.push_span(format!("  {dropped} not seen here").yellow());
    }
    if let Some(set) = set {
        first.push_span(format!("  up {}  time ×{}", up_time(set.up_s), set.time_scale));
    }
    let restarts: u32 = set.iter().flat_map(|set| &set.processes).map(|process| process.restarts).sum();
    if restarts > 0 {
        first.push_span(format!("  {restarts} restarts").yellow());
    }
    let second = set.as_ref().map_or_else(Line::default, |set| log_line(set, width));
    vec![first, second]
}

fn log_line(set: &SetView, width: u16) -> Line<'static> {
    let RecorderView { state, log, bytes, trouble, .. } = &set.recorder;
    let state = match (state, trouble) {
        (RecorderState::Recording, None) => "● recording".green(),
        (RecorderState::DiskFull, _) => "DISK FULL, NO LOG ANY MORE".red().bold(),
        (RecorderState::Recording | RecorderState::Stopped, _) => "NO LOG ANY MORE".red().bold(),
    };
    let size = crate::cli::show::size(*bytes);
    let path = log.display().to_string();
    let room =
        usize::from(width).saturating_sub(" log   ".len() + 2 + size.len() + state.content.chars().count());
    let surplus = path.chars().count().saturating_sub(room);
    let path = if surplus == 0 {
        path
    } else {
        std::iter::once('…').chain(path.chars().skip(surplus + 1)).collect()
    };
    Line::from(vec![" log ".dim(), path.into(), format!("  {size}  ").into(), state])
}

fn up_time(seconds: f64) -> String {
    let seconds = std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default().as_secs();
    let (hours, minutes, seconds) = (seconds / 3_600, seconds / 60 % 60, seconds % 60);
    format!("{hours}:{minutes:02}:{seconds:02}")
}

/// The named lines of both digital cards, as many a row as fit.
fn digital(snapshot: &Snapshot, width: u16) -> Text<'static> {
    let mut text = Text::default();
    for (title, card) in [("in ", &snapshot.inputs), ("out", &snapshot.outputs)] {
        lamps(title, card, usize::from(width), &mut text);
    }
    text
}

fn lamps(title: &'static str, card: &DigitalSnapshot, width: usize, text: &mut Text<'static>) {
    let mut row = Line::from(vec![format!(" {title}").dim()]);
    for line in &card.lines {
        if row.width() + 4 + line.name.chars().count() > width && row.spans.len() > 1 {
            text.push_line(std::mem::replace(&mut row, Line::from("    ")));
        }
        row.push_span(match line.on {
            Some(true) => format!("  ● {}", line.name).green(),
            Some(false) => format!("  ○ {}", line.name).into(),
            None => format!("  ? {}", line.name).dim(),
        });
    }
    text.push_line(row);
}

fn title(text: &str, area: Rect) -> Line<'static> {
    let text = format!("── {text} ");
    let rest = usize::from(area.width).saturating_sub(text.chars().count());
    Line::from(format!("{text}{}", "─".repeat(rest))).dim()
}

fn event_lines(events: &[EventView], area: Rect) -> Text<'static> {
    let mut text = Text::from(title("events", area));
    let room = usize::from(area.height).saturating_sub(1);
    for event in &events[events.len().saturating_sub(room)..] {
        let line = format!("{:>9.3}  {}: {}", event.time_s, event.name, event.message);
        text.push_line(if event.error { line.red() } else { line.yellow() });
    }
    text
}

fn frame_lines(scene: &Scene<'_>, area: Rect) -> Text<'static> {
    let filter = scene.view.filter();
    let mut what = "frames".to_owned();
    if let Some((_, name)) = scene.view.selected().filter(|_| filter.axis.is_some()) {
        what = format!("{what} of {name}");
    }
    if filter.all {
        what.push_str(", all");
    }
    if !filter.text.is_empty() {
        what = format!("{what} with /{}", filter.text);
    }
    let mut text = Text::from(title(&what, area));
    let mut room = usize::from(area.height).saturating_sub(1);
    if room > 8 {
        text.push_line(Line::from(scene.snapshot.frames_title.clone()).dim());
        room -= 1;
    }
    let frames = &scene.snapshot.frames;
    for line in &frames[frames.len().saturating_sub(room)..] {
        let row = line.text.clone();
        text.push_line(if line.lane == LaneName::Commands { row.cyan() } else { row.into() });
    }
    text
}

fn foot(view: &View, width: u16) -> Line<'static> {
    if view.mode == Mode::Typing {
        return Line::from(format!(" /{}▏  Enter keeps it, Esc drops it", view.filter().text)).yellow();
    }
    if let Some(said) = &view.said {
        return Line::from(format!(" {said}")).yellow();
    }
    let whom = view.whom();
    let keys = match width {
        0..60 => format!(" h halt  b brake {whom}  q quit"),
        _ => format!(" h halt  b brake  c clear: {whom}   r resume  / filter  ? help  q quit"),
    };
    Line::from(keys).dim()
}

fn help(frame: &mut Frame<'_>, area: Rect) {
    let text = Text::from(HELP);
    let (width, height) = (text.width() + 3, text.height() + 2);
    let fit = |length: usize| Constraint::Max(u16::try_from(length).unwrap_or(u16::MAX));
    let inside = area.centered(fit(width), fit(height));
    frame.render_widget(Clear, inside);
    let block = Block::bordered().title(" keys ");
    let within = block.inner(inside);
    frame.render_widget(block, inside);
    frame.render_widget(text, within);
}
