//! Commands that ask a set which is up: over its control socket, one request each.

use std::io::{self, BufWriter, Write};
use std::thread;
use std::time::Duration;

use clap::{Args, ValueEnum};
use miette::miette;
use supersigma_protocol::{AxisNumber, Distance, Refusal};

use super::asked::Asked;
use super::exit::Exit;
use super::{SetArgs, show};
use crate::control::{Description, RecorderState, RecorderView};
use crate::executive::{Displacement, Failure, Outcome, Request};

/// How often `status --watch` looks.
const WATCH: Duration = Duration::from_millis(250);
/// A recorder that is further behind the bus than this is worth a word.
const BEHIND_MS: u64 = 200;

#[derive(Args)]
pub(super) struct MoveArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The axis, by number or name
    axis: String,
    /// How far; negative is towards the origin
    #[arg(allow_negative_numbers = true)]
    steps: i64,
    /// The ceiling in steps/s; with --constant, the speed
    #[arg(long, value_name = "V")]
    speed: Option<f64>,
    /// At one speed, without a ramp
    #[arg(long)]
    constant: bool,
    #[command(flatten)]
    how: HowArgs,
}

#[derive(Args)]
struct HowArgs {
    /// Return as soon as the cards have consented
    #[arg(long)]
    no_wait: bool,
    /// One JSON object a movement
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct LineArgs {
    #[command(flatten)]
    set: SetArgs,
    /// Each axis and how far it goes
    #[arg(required = true, value_name = "AXIS=STEPS")]
    parts: Vec<String>,
    /// The ceiling of the axis with the most steps, in steps/s
    #[arg(long, value_name = "V")]
    speed: Option<f64>,
    #[command(flatten)]
    how: HowArgs,
}

#[derive(Args)]
pub(super) struct JogArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The axis, by number or name
    axis: String,
    /// Away from the origin, or towards it
    direction: Way,
    /// The ceiling in steps/s
    #[arg(long, value_name = "V")]
    speed: Option<f64>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Way {
    Forward,
    Back,
}

#[derive(Args)]
pub(super) struct OriginArgs {
    #[command(flatten)]
    set: SetArgs,
    /// Which axes; all if none, or `all`, is named
    axes: Vec<String>,
    /// One JSON object a movement
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct ReferenceArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The axis, by number or name
    axis: String,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct AxesArgs {
    #[command(flatten)]
    set: SetArgs,
    /// Which axes; all if none, or `all`, is named
    axes: Vec<String>,
}

#[derive(Args)]
pub(super) struct ResumeArgs {
    #[command(flatten)]
    set: SetArgs,
    /// One JSON object a movement
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct StatusArgs {
    #[command(flatten)]
    set: SetArgs,
    /// Which axes; all if none is named
    axes: Vec<String>,
    /// One JSON object an axis, and one of the recorder if no axis is named
    #[arg(long)]
    json: bool,
    /// Again and again, until Ctrl-C
    #[arg(long)]
    watch: bool,
}

pub(super) fn movement(args: &MoveArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    let by = Displacement(args.steps);
    let request =
        Request::Move { axis, by, speed: args.speed, constant: args.constant, wait: !args.how.no_wait };
    asked.moved(request, args.how.json)
}

/// The daemon halts what it moves for a client that is gone, so Ctrl-C ends a jog in order.
pub(super) fn jog(args: &JogArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    let states = asked.axis_states(Request::Status { axes: vec![axis] })?;
    let position = states.first().and_then(|state| state.report?.position);
    let travel = asked.config.axis(axis).map(|axis| axis.travel.clone());
    let (Some(position), Some(travel)) = (position, travel) else {
        let failure = Failure::Refused { axis, refusal: Refusal::NotOriginated, at: None };
        return Err(Exit::told(failure, &asked.knowledge));
    };
    let end = if args.direction == Way::Forward { travel.max } else { travel.min };
    let longest = i64::from(Distance::MAX.get());
    let by = Displacement(i64::from(end.deviation_from(position).0).clamp(-longest, longest));
    asked.moved(Request::Move { axis, by, speed: args.speed, constant: false, wait: true }, args.json)
}

pub(super) fn line(args: &LineArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let mut parts: Vec<(AxisNumber, Displacement)> = Vec::with_capacity(args.parts.len());
    for part in &args.parts {
        let Some((axis, steps)) = part.split_once('=') else {
            return Err(Exit::wrong(miette!("{part:?} is not of the form AXIS=STEPS, as in left_x=400")));
        };
        let Ok(steps) = steps.parse() else {
            return Err(Exit::wrong(miette!("{steps:?} in {part:?} is no number of steps")));
        };
        let axis = asked.axis(axis)?;
        if parts.iter().any(|(other, _)| *other == axis) {
            return Err(Exit::wrong(miette!("{part:?} names an axis that the line has already")));
        }
        parts.push((axis, Displacement(steps)));
    }
    asked.moved(Request::Line { parts, speed: args.speed, wait: !args.how.no_wait }, args.how.json)
}

pub(super) fn origin(args: &OriginArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axes = asked.axes(&args.axes)?;
    asked.moved(Request::Originate { axes }, args.json)
}

pub(super) fn reference(args: &ReferenceArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    asked.moved(Request::SeekReference { axis }, args.json)
}

pub(super) fn halt(args: &AxesArgs) -> Result<(), Exit> {
    tell(args, |axes| Request::Halt { axes })
}

pub(super) fn resume(args: &ResumeArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    match asked.operate(Request::Resume)? {
        // Only programs waited; they tell of their movements themselves.
        Outcome::Moved(movements) if movements.is_empty() && !args.json => {
            Ok(writeln!(io::stdout(), "the program goes on")?)
        }
        outcome => asked.tell_outcome(&outcome, args.json),
    }
}

pub(super) fn brake(args: &AxesArgs) -> Result<(), Exit> {
    tell(args, |axes| Request::Brake { axes })
}

pub(super) fn clear(args: &AxesArgs) -> Result<(), Exit> {
    tell(args, |axes| Request::Clear { axes })
}

fn tell(args: &AxesArgs, request: impl Fn(Vec<AxisNumber>) -> Request) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axes = asked.axes(&args.axes)?;
    let states = asked.axis_states(request(axes))?;
    show::axes(&states, &asked.config, &mut io::stdout().lock())?;
    Ok(())
}

pub(super) fn status(args: &StatusArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axes = asked.axes(&args.axes)?;
    loop {
        let states = asked.axis_states(Request::Status { axes: axes.clone() })?;
        let mut out = BufWriter::new(io::stdout().lock());
        if args.json {
            for state in &states {
                show::print_json(&show::AxisView::new(state, &asked.config), &mut out)?;
            }
            if args.axes.is_empty() {
                let recorder = asked.client_description()?.recorder;
                show::print_json(&serde_json::json!({ "recorder": recorder }), &mut out)?;
            }
        } else {
            if args.watch {
                show::redraw(&mut out)?;
            }
            show::axes(&states, &asked.config, &mut out)?;
            if args.axes.is_empty() {
                set_line(&asked.client_description()?, &mut out)?;
            }
        }
        out.flush()?;
        drop(out);
        if !args.watch {
            return Ok(());
        }
        thread::sleep(WATCH);
    }
}

fn set_line(set: &Description, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "\nset {}: up {:.0} s, time scale {}, {} frames, {} lost",
        set.name, set.up_s, set.time_scale, set.frames, set.lost,
    )?;
    let RecorderView { state, log, parts, frames, lost, bytes, behind_ms, trouble } = &set.recorder;
    let what = match (state, trouble) {
        (RecorderState::Recording, None) => "log",
        (RecorderState::DiskFull, _) => "DISK FULL, NO LOG ANY MORE, was",
        (RecorderState::Recording | RecorderState::Stopped, _) => "NO LOG ANY MORE, was",
    };
    write!(out, "{what} {}", log.display())?;
    if parts.len() > 1 {
        write!(out, ", file {} of it", parts.len())?;
    }
    write!(out, ": {frames} frames, {}", show::size(*bytes))?;
    if *lost > 0 {
        write!(out, ", {lost} FRAMES ARE MISSING")?;
    }
    if *behind_ms > BEHIND_MS {
        write!(out, ", {behind_ms} ms behind")?;
    }
    writeln!(out)?;
    match trouble {
        Some(trouble) => writeln!(out, "{}; nothing moves without a log\n{}", trouble.reason, trouble.advice),
        None => Ok(()),
    }
}
