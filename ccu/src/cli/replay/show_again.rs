//! `ccu replay`: a log before people's eyes, at the machine's pace or another: its frames as they went over the bus, or the
//! table of the axes.

use std::collections::BTreeMap;
use std::io::{self, IsTerminal, Write};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use axis_worker::clock::TimeScale;
use indicatif::{ProgressBar, ProgressStyle};
use supersigma_config::Config;
use supersigma_protocol::{Activity, AxisNumber, AxisReport, Body, Report, Tick};

use super::{Nothing, ReplayArgs, Speed, config_of, log_error};
use crate::cli::asked::unknown;
use crate::cli::exit::Exit;
use crate::cli::show::Pictures;
use crate::cli::{set, show};
use crate::executive::AxisState;
use crate::log::{AxisNames, Filter, FrameView, Judge, Lines, LogReader, LoggedFrame};

/// The table is not drawn more often than this.
const DRAWN: Duration = Duration::from_millis(100);

pub(super) fn show(args: &ReplayArgs) -> Result<(), Exit> {
    let mut reader = LogReader::open(&args.log).map_err(log_error)?;
    let header = reader.header().cloned().ok_or_else(|| Exit::with_code(2, Nothing(args.log.clone())))?;
    let config = config_of(&args.log, &header)?;
    let names = header.names;
    let axes = args.axis.iter().map(|name| {
        let known = names.iter().map(|(_, name)| name);
        names.find(name).ok_or_else(|| unknown("axis", name, known.collect::<Vec<_>>().into_iter()))
    });
    let axes = axes.collect::<Result<Vec<_>, _>>()?;
    let span = args.from.map_or(Tick(0), tick)..=args.to.map_or(Tick(u64::MAX), tick);
    if span.is_empty() {
        return Err(Exit::wrong(miette::miette!("--from comes after --to: there is nothing between them")));
    }
    let runtime = set::runtime()?;
    let stop = interrupted(&runtime)?;
    let bar = progress(args, *span.end())?;
    let speed = args.speed.unwrap_or(Speed::Times(TimeScale::REAL));
    let judge = |axis: &AxisNumber| Filter { axis: Some(*axis), ..Filter::default() }.start(header.timeline);
    let judges = axes.iter().map(judge).collect();
    let view: Box<dyn View> = if args.watch {
        Box::new(Table {
            config: &config,
            axes,
            states: BTreeMap::new(),
            now: Tick(0),
            drawn: None,
            stale: true,
            pictures: Pictures::new(true),
        })
    } else {
        Box::new(Rows { json: args.json, lines: Lines::new(&names), names: &names, judges })
    };
    let mut player = Player { view, bar, stop, speed, began: None };
    player.bar.suspend(|| player.view.begin())?;
    for logged in reader.by_ref() {
        let logged = logged.map_err(log_error)?;
        let at = logged.frame.as_ref().map_or(player.reached(), |frame| frame.tick);
        if at > *span.end() {
            return player.end();
        }
        if at < *span.start() {
            player.view.pass(&logged);
        } else if !player.play(&logged, at, *span.start())? {
            return player.end();
        }
    }
    player.end()?;
    if reader.truncated() {
        eprintln!("the log ends in the middle of a record; everything before that has been shown");
    }
    Ok(())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1e9 s, as parsed")]
fn tick(seconds: f64) -> Tick {
    Tick((seconds * 2e6).round() as u64)
}

/// What receives something when a signal asks the process to end.
fn interrupted(runtime: &tokio::runtime::Runtime) -> Result<Receiver<()>, Exit> {
    let _guard = runtime.enter();
    let asked_to_end = set::asked_to_end()?;
    let (tell, told) = mpsc::channel();
    runtime.spawn(async move {
        asked_to_end.await;
        // If nobody waits any more, everything has been shown.
        let _ = tell.send(());
    });
    Ok(told)
}

/// On a terminal, the log is read once before, to know where it ends.
fn progress(args: &ReplayArgs, to: Tick) -> Result<ProgressBar, Exit> {
    if !io::stderr().is_terminal() {
        return Ok(ProgressBar::hidden());
    }
    let mut end = Tick(0);
    for logged in LogReader::open(&args.log).map_err(log_error)? {
        // What is wrong with the log is told when it is shown.
        let Ok(logged) = logged else { break };
        end = logged.frame.map_or(end, |frame| end.max(frame.tick));
    }
    let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {msg}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    Ok(ProgressBar::new(end.min(to).0).with_style(style))
}

/// What is shown of a log.
trait View {
    /// Before the first frame.
    fn begin(&mut self) -> io::Result<()>;
    /// A frame that is not shown, but may change what is shown later.
    fn pass(&mut self, logged: &LoggedFrame);
    /// A frame whose time has come.
    fn show(&mut self, logged: &LoggedFrame, at: Tick) -> io::Result<()>;
    /// Nothing comes for so long.
    fn idle(&mut self, wait: Duration) -> io::Result<()>;
    /// After the last frame.
    fn end(&mut self) -> io::Result<()>;
}

/// A line a frame.
struct Rows<'a> {
    json: bool,
    lines: Lines,
    names: &'a AxisNames,
    /// One an axis that was named.
    judges: Vec<Judge>,
}

impl View for Rows<'_> {
    fn begin(&mut self) -> io::Result<()> {
        if self.json { Ok(()) } else { writeln!(io::stdout(), "{}", self.lines.title()) }
    }

    fn pass(&mut self, _: &LoggedFrame) {}

    fn show(&mut self, logged: &LoggedFrame, _: Tick) -> io::Result<()> {
        if !self.judges.is_empty() && !self.judges.iter_mut().any(|judge| judge.wants(logged)) {
            return Ok(());
        }
        let view = FrameView::new(&logged.bytes, logged.frame.as_ref(), self.names);
        let mut out = io::stdout().lock();
        if self.json {
            show::print_json(&view, &mut out)
        } else {
            writeln!(out, "{}", self.lines.line(&view))
        }
    }

    fn idle(&mut self, _: Duration) -> io::Result<()> {
        Ok(())
    }

    fn end(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The table of the axes.
struct Table<'a> {
    config: &'a Config,
    /// All, if empty.
    axes: Vec<AxisNumber>,
    states: BTreeMap<AxisNumber, AxisReport>,
    now: Tick,
    drawn: Option<Instant>,
    stale: bool,
    pictures: Pictures,
}

impl Table<'_> {
    fn draw(&mut self) -> io::Result<()> {
        let wanted = |axis: &AxisNumber| self.axes.is_empty() || self.axes.contains(axis);
        let axes = self.config.axes.iter().map(|axis| axis.address).filter(wanted);
        let states: Vec<_> =
            axes.map(|axis| AxisState { axis, report: self.states.get(&axis).copied() }).collect();
        let mut out = Vec::new();
        show::axes(&states, self.config, &mut out)?;
        let moving = self.states.values().filter(|state| state.activity != Activity::Standing).count();
        writeln!(out, "\n{:.3} s of machine time, {moving} axes on their way", seconds(self.now))?;
        self.pictures.show(&out)?;
        (self.drawn, self.stale) = (Some(Instant::now()), false);
        Ok(())
    }
}

impl View for Table<'_> {
    fn begin(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn pass(&mut self, logged: &LoggedFrame) {
        let Ok(frame) = &logged.frame else { return };
        self.now = self.now.max(frame.tick);
        if let Body::Answer(answer) = &frame.body
            && let Report::Axis(report) = answer.report
            && let Some(axis) = AxisNumber::new(answer.card.0)
        {
            self.states.insert(axis, report);
            self.stale = true;
        }
    }

    fn show(&mut self, logged: &LoggedFrame, _: Tick) -> io::Result<()> {
        self.pass(logged);
        if self.stale && self.drawn.is_none_or(|drawn| drawn.elapsed() >= DRAWN) {
            self.draw()
        } else {
            Ok(())
        }
    }

    fn idle(&mut self, wait: Duration) -> io::Result<()> {
        if self.stale && wait >= DRAWN { self.draw() } else { Ok(()) }
    }

    fn end(&mut self) -> io::Result<()> {
        if self.pictures.are_on_a_terminal() {
            // What was shown last stays when the screen of its own is gone.
            self.pictures = Pictures::new(false);
            self.stale = true;
        }
        if self.stale { self.draw() } else { Ok(()) }
    }
}

/// A log that is being shown.
struct Player<'a> {
    view: Box<dyn View + 'a>,
    bar: ProgressBar,
    stop: Receiver<()>,
    speed: Speed,
    /// When the first frame was shown, and its tick.
    began: Option<(Instant, Tick)>,
}

impl Player<'_> {
    fn reached(&self) -> Tick {
        Tick(self.bar.position()).max(self.began.map_or(Tick(0), |(_, tick)| tick))
    }

    /// Shows a frame when its time has come. Returns whether to go on.
    fn play(&mut self, logged: &LoggedFrame, at: Tick, from: Tick) -> io::Result<bool> {
        // What is to be shown from a moment on begins at that moment.
        let first = if from > Tick(0) { from } else { at };
        let (began, first) = *self.began.get_or_insert_with(|| (Instant::now(), first));
        if let Speed::Times(speed) = self.speed {
            let wait = (began + speed.real(at.since(first))).saturating_duration_since(Instant::now());
            if !wait.is_zero() {
                self.bar.suspend(|| self.view.idle(wait))?;
                if self.stop.recv_timeout(wait) != Err(RecvTimeoutError::Timeout) {
                    return Ok(false);
                }
            }
        }
        if self.stop.try_recv().is_ok() {
            return Ok(false);
        }
        self.bar.suspend(|| self.view.show(logged, at))?;
        self.bar.set_message(format!("{:.1} s", seconds(at)));
        self.bar.set_position(at.0);
        Ok(true)
    }

    fn end(&mut self) -> Result<(), Exit> {
        self.bar.finish_and_clear();
        Ok(self.view.end()?)
    }
}

fn seconds(at: Tick) -> f64 {
    at.since(Tick(0)).as_seconds()
}
