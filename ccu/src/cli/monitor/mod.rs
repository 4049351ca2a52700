//! `ccu monitor`: a dashboard on a terminal. It draws [snapshots](crate::watch::Snapshot) and turns keys into requests.
//!
//! ```text
//!   live   ─► picture of the set, connecting again when it has gone
//!   view   ─► keys: what is selected, filtered, wished       (pure)
//!   draw   ─► a snapshot and a view on a buffer of any size  (pure)
//!   screen ─► the terminal, given back however this ends
//! ```
//!
//! A key that stops axes is sent at once, on a connection of its own, from a thread of its own: it waits neither for the
//! drawing nor for an earlier key's answer.

mod axes;
mod draw;
mod live;
mod screen;
#[cfg(test)]
mod tests;
mod view;

use std::io::{self, IsTerminal, Write};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use miette::miette;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{self, Event};
use ratatui::layout::{Position, Rect, Size};

use self::draw::Scene;
use self::live::Live;
use self::screen::Screen;
use self::view::{View, Wish};
use super::exit::Exit;
use super::{SetArgs, set};
use crate::control::Client;
use crate::executive::{Operate, Outcome, Request};
use crate::home::Home;

/// How often the screen is drawn anew, if no key is pressed.
const DRAW: Duration = Duration::from_millis(100);
/// How long a set is watched before one picture of it is drawn: rates are those of a whole second.
const LOOK: Duration = Duration::from_millis(1_200);

/// What the dashboard waits for.
enum Input {
    /// A key, or another size.
    Terminal(Event),
    /// What came of a request.
    Said(String),
    /// The process shall end, or nobody sits at the terminal any more.
    End,
}

#[derive(Args)]
pub(super) struct MonitorArgs {
    #[command(flatten)]
    set: SetArgs,
    /// One picture as text, after a look of a second; needs no terminal
    #[arg(long)]
    once: bool,
    /// Its size
    #[arg(long, value_name = "COLUMNSxROWS", requires = "once", default_value = "80x24", value_parser = size)]
    size: Size,
}

/// At most what anybody has on a desk: every cell costs memory.
fn size(text: &str) -> Result<Size, String> {
    let side = |text: &str| text.parse::<u16>().ok().filter(|side| (1..=1_000).contains(side));
    text.split_once('x')
        .and_then(|(columns, rows)| Some(Size::new(side(columns)?, side(rows)?)))
        .ok_or_else(|| "columns and rows, 1 to 1000 each, as in 120x40".to_owned())
}

pub(super) fn monitor(args: &MonitorArgs) -> Result<(), Exit> {
    let home = Home::of(args.set.name.clone()).map_err(|error| Exit::with_code(3, error))?;
    if args.once {
        let text = picture(&home, Rect::from((Position::ORIGIN, args.size)))?;
        io::stdout().lock().write_all(text.as_bytes())?;
        return Ok(());
    }
    if !io::stdout().is_terminal() || !io::stdin().is_terminal() {
        return Err(Exit::wrong(miette!(
            help = "`ccu status` prints what the axes are doing, `ccu status --watch` again and again, and \
                    `ccu monitor --once` one picture of this dashboard",
            "the dashboard needs a terminal, and standard input and output are not both one"
        )));
    }
    let (sender, inputs) = mpsc::channel();
    let runtime = set::runtime()?;
    let _guard = runtime.enter();
    let asked_to_end = set::asked_to_end()?;
    let ender = sender.clone();
    runtime.spawn(async move {
        asked_to_end.await;
        let _ = ender.send(Input::End);
    });
    show(&home, &sender, &inputs)
}

/// Shows the set until somebody quits.
fn show(home: &Home, sender: &Sender<Input>, inputs: &Receiver<Input>) -> Result<(), Exit> {
    let live = Live::start(home)?;
    let mut view = View::new(live.axes());
    let mut screen = Screen::take()?;
    let keys = sender.clone();
    thread::Builder::new().name("keys".into()).spawn(move || {
        while let Ok(event) = event::read() {
            if keys.send(Input::Terminal(event)).is_err() {
                return;
            }
        }
        let _ = keys.send(Input::End);
    })?;
    loop {
        let size = screen.size()?;
        let (snapshot, link) = live.look(&view.detail(Rect::from((Position::ORIGIN, size))));
        screen.draw(&Scene { snapshot: &snapshot, link: &link, view: &view })?;
        let deadline = Instant::now() + DRAW;
        loop {
            match inputs.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Input::Terminal(Event::Key(key))) => match view.press(key) {
                    Some(Wish::Quit) => return live.end(link),
                    Some(Wish::Ask(request, what)) => ask(home.clone(), request, what, sender),
                    None => {}
                },
                Ok(Input::Terminal(_)) => {}
                Ok(Input::Said(text)) => view.say(text),
                Ok(Input::End) => return Ok(()),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
            if view.is_changed() {
                break;
            }
        }
    }
}

/// The set as the dashboard shows it after a moment's look.
fn picture(home: &Home, area: Rect) -> Result<String, Exit> {
    let live = Live::start(home)?;
    let view = View::new(live.axes());
    thread::sleep(LOOK);
    let (snapshot, link) = live.look(&view.detail(area));
    Ok(draw_as_text(&Scene { snapshot: &snapshot, link: &link, view: &view }, area))
}

/// What a screen of this size would show.
fn draw_as_text(scene: &Scene<'_>, area: Rect) -> String {
    let Ok(mut terminal) = Terminal::new(TestBackend::new(area.width, area.height));
    let Ok(completed) = terminal.draw(|frame| draw::draw(frame, scene));
    let mut text = String::new();
    for row in 0..area.height {
        let symbols = (0..area.width).filter_map(|column| completed.buffer.cell((column, row)));
        let line: String = symbols.map(ratatui::buffer::Cell::symbol).collect();
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// Asks for something, and tells what came of it.
fn ask(home: Home, request: Request, what: String, inputs: &Sender<Input>) {
    let asking = thread::Builder::new().name("ask".into());
    let told = inputs.clone();
    let asked = asking.spawn(move || {
        let outcome = Client::connect(&home).and_then(|mut client| client.operate(request));
        let text = match outcome {
            Ok(Outcome::Moved(movements)) => format!("{what}: {} movements completed", movements.len()),
            Ok(_) => format!("{what}: done"),
            Err(failure) => format!("{what}: {failure}"),
        };
        let _ = told.send(Input::Said(text));
    });
    if let Err(error) = asked {
        let _ = inputs.send(Input::Said(format!("cannot ask: {error}")));
    }
}
