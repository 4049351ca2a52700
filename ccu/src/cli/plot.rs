//! `ccu plot`: pictures of a log, or of a ramp.

use std::path::{Path, PathBuf};

use clap::Args;
use miette::{IntoDiagnostic, miette};
use supersigma_config::{AxisConfig, Config, ShortMoves};
use supersigma_protocol::{AxisNumber, Distance, Tick, Ticks};

use super::asked::unknown;
use super::config;
use super::exit::Exit;
use super::profile::Way;
use crate::log::{LogReader, WallTime};
use crate::plot::profile::{LENGTHS, MOST_LENGTHS, Ramp, Which};
use crate::plot::{Format, PlotError, Shown, Size, Subject, Timing, Trace, What, Window, moves};

#[derive(Args)]
pub(super) struct PlotArgs {
    /// The log; one that is cut short is shown as far as it goes
    #[arg(required_unless_present = "profile")]
    log: Option<PathBuf>,
    /// The picture, .svg or .png; one that is there already is replaced
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Only these axes, by name or number [default: all that moved; with --profile, the first]
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    axis: Vec<String>,
    /// From this second of machine time on [default: the first movement]
    #[arg(long, value_name = "S", conflicts_with = "profile")]
    from: Option<f64>,
    /// Up to this second of machine time [default: the last movement]
    #[arg(long, value_name = "S", conflicts_with = "profile")]
    to: Option<f64>,
    /// Which panels, one below the other
    #[arg(
        long,
        value_name = "PANEL",
        value_delimiter = ',',
        default_value = "speed,position,sense",
        conflicts_with = "profile"
    )]
    what: Vec<What>,
    /// Width and height in pixels, as 1200x800; a PNG has twice as many [default: as it takes]
    #[arg(long, value_name = "WxH", conflicts_with = "profile")]
    size: Option<Size>,
    /// The ramp of an axis instead of a log
    #[arg(long, conflicts_with = "log")]
    profile: bool,
    /// What of the ramp [default: speed with --steps, table without]
    #[arg(long, requires = "profile")]
    which: Option<Which>,
    /// The lengths of the movements of `--which speed`
    #[arg(
        long,
        value_name = "N",
        value_delimiter = ',',
        requires = "profile",
        value_parser = clap::value_parser!(u16).range(1..)
    )]
    steps: Vec<u16>,
    /// How they are made; as configured if not given
    #[arg(long, requires = "profile")]
    method: Option<Way>,
    /// The configuration of the ramp; the built-in set if none is named
    #[arg(long, value_name = "FILE", requires = "profile")]
    config: Option<PathBuf>,
}

pub(super) fn plot(args: &PlotArgs) -> Result<(), Exit> {
    Format::of(&args.output).map_err(|error| exit(&error))?;
    match &args.log {
        Some(log) => of_a_log(args, log),
        None => of_a_ramp(args),
    }
}

/// Neither a wrong name nor a size is the machine's fault.
pub(super) fn exit(error: &PlotError) -> Exit {
    let exit = match error {
        PlotError::Extension { .. } | PlotError::TooSmall { .. } => Exit::wrong,
        PlotError::Write { .. } | PlotError::Draw(_) => Exit::could_not,
    };
    exit(miette!("{error}"))
}

fn of_a_ramp(args: &PlotArgs) -> Result<(), Exit> {
    let config = config::load(args.config.as_deref())?;
    let axis = match args.axis.as_slice() {
        [] => &config.axes[0],
        [name] => find_axis(&config, name)?,
        [..] => return Err(Exit::wrong(miette!("a ramp is that of one axis; --axis names several"))),
    };
    let which = args.which.unwrap_or(if args.steps.is_empty() { Which::Table } else { Which::Speed });
    if which != Which::Speed && !args.steps.is_empty() {
        return Err(Exit::wrong(miette!(
            "--steps is for --which speed; the other pictures show all lengths"
        )));
    }
    if args.steps.len() > MOST_LENGTHS {
        return Err(Exit::wrong(miette!("{MOST_LENGTHS} lengths at most can be told apart in one picture")));
    }
    let mut ramp = config.ramp_of(axis).clone();
    if let Some(way) = args.method {
        ramp.short_moves = ShortMoves::from(way);
    }
    let lengths = if args.steps.is_empty() { &LENGTHS[..] } else { &args.steps };
    let lengths: Vec<_> = lengths.iter().filter_map(|&steps| Distance::new(steps)).collect();
    let picture = Ramp { axis, ramp: &ramp }
        .picture(which, &lengths)
        .map_err(|error| Exit::wrong(miette!("{error}")))?;
    picture.save(&args.output).map_err(|error| exit(&error))
}

fn find_axis<'a>(config: &'a Config, name: &str) -> Result<&'a AxisConfig, Exit> {
    let names = config.axes.iter().map(|axis| axis.name.as_str());
    config.find_axis(name).ok_or_else(|| unknown("axis", name, names))
}

fn of_a_log(args: &PlotArgs, log: &Path) -> Result<(), Exit> {
    let mut reader = LogReader::open(log).into_diagnostic().map_err(Exit::wrong)?;
    let header = reader.header().cloned();
    let (mut trace, mut timing) = (Trace::default(), Timing::default());
    for logged in reader.by_ref() {
        // Bytes that are no frame say nothing about axes; `ccu frames` shows them.
        if let Ok(frame) = logged.into_diagnostic().map_err(Exit::wrong)?.frame {
            trace.hear(&frame);
            timing.hear(&frame);
        }
    }
    trace.sort();
    let truncated = reader.truncated();
    let name = log.display();
    let (Some(header), Some(span)) = (header, trace.span) else {
        return Err(Exit::wrong(miette!("the log {name} holds no frames, so there is nothing to show")));
    };
    timing.close(span.to);
    let config = Config::from_toml(&header.config, "config.toml").map_err(|error| {
        Exit::wrong(miette!("the configuration in the log {name} cannot be read: {error}"))
    })?;
    let window = window(args, &trace, span, log)?;
    let axes = axes(args, &config, &trace, window, log)?;
    timing.axes.retain(|timing| axes.contains(&timing.axis));
    let title = format!("{} at {}", header.set, wall(header.timeline.wall(window.from)));
    let file = log.file_name().map_or_else(|| name.to_string(), |file| file.to_string_lossy().into_owned());
    let (from, to) = (window.seconds().start, window.seconds().end);
    let cut = if truncated { ", which is cut short" } else { "" };
    let subtitle = format!("{from:.3} to {to:.3} s of machine time, from {file}{cut}");
    let subject = Subject { title: &title, subtitle: &subtitle, names: &header.names, config: &config };
    let shown = Shown { subject, axes: &axes, what: &args.what, window, size: args.size };
    moves(&trace, &timing, &shown)
        .and_then(|picture| picture.save(&args.output))
        .map_err(|error| exit(&error))?;
    if truncated {
        eprintln!("the log ends in the middle of a record; what comes before that is shown");
    }
    Ok(())
}

/// The axes that are asked for; if none are named, those that moved.
fn axes(
    args: &PlotArgs,
    config: &Config,
    trace: &Trace,
    window: Window,
    log: &Path,
) -> Result<Vec<AxisNumber>, Exit> {
    let named = args.axis.iter().map(|name| find_axis(config, name).map(|axis| axis.address));
    let named = named.collect::<Result<Vec<_>, _>>()?;
    if !named.is_empty() {
        return Ok(named);
    }
    let moved: Vec<_> =
        trace.axes.iter().filter(|trace| trace.moved(window)).map(|trace| trace.axis).collect();
    if moved.is_empty() {
        let (from, to) = (window.seconds().start, window.seconds().end);
        return Err(Exit::wrong(miette!(
            help = "`--axis NAME` shows an axis although it stands still",
            "nothing moves in the log {} from {from:.3} s to {to:.3} s",
            log.display()
        )));
    }
    Ok(moved)
}

/// From the first movement to the last one, or as asked for.
fn window(args: &PlotArgs, trace: &Trace, span: Window, log: &Path) -> Result<Window, Exit> {
    let whole = trace.moving().unwrap_or(span);
    let from = args.from.map_or(whole.from, tick);
    // A beginning that is after all movements still has what comes then.
    let end = if from < whole.to { whole.to } else { span.to };
    let window = Window { from, to: args.to.map_or(end.max(whole.from + Ticks(1)), tick) };
    let (from, to) = (window.seconds().start, window.seconds().end);
    if args.to.is_some() && window.from >= window.to {
        return Err(Exit::wrong(miette!(
            "from {from:.3} s to {to:.3} s there is nothing: it ends before it begins"
        )));
    }
    if window.to < span.from || window.from >= span.to.max(span.from + Ticks(1)) {
        return Err(Exit::wrong(miette!(
            help = format!("it goes from {:.3} s to {:.3} s", span.seconds().start, span.seconds().end),
            "the log {} has nothing from {from:.3} s on{}",
            log.display(),
            args.to.map_or(String::new(), |to| format!(" up to {to:.3} s"))
        )));
    }
    Ok(window)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast saturates")]
fn tick(seconds: f64) -> Tick {
    Tick((seconds * 2e6).round() as u64)
}

/// A moment for people: `2026-03-01 12:30:00 UTC`.
fn wall(time: WallTime) -> String {
    let time = jiff::Timestamp::from_nanosecond(time.0.into());
    time.map_or_else(|_| "an unknown time".into(), |time| time.strftime("%Y-%m-%d %H:%M:%S UTC").to_string())
}
