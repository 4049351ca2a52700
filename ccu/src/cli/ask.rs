//! Commands that ask a set which is up: over its control socket, one request each.

use std::io::{self, BufWriter, Write};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use miette::miette;
use supersigma_config::Config;
use supersigma_protocol::{AxisNumber, Distance, Refusal};

use super::asked::Asked;
use super::exit::Exit;
use super::show::Pictures;
use super::{SetArgs, set, show};
use crate::control::Description;
use crate::executive::{AxisState, Displacement, Failure, Outcome, Request};

/// How often `status --watch` looks.
const WATCH: Duration = Duration::from_millis(250);

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
    if args.watch {
        return watch(&mut asked, &axes, args.json);
    }
    let states = asked.axis_states(Request::Status { axes })?;
    let mut out = BufWriter::new(io::stdout().lock());
    tell_states(&states, &asked.config, args.json, &mut out)?;
    if args.axes.is_empty() {
        tell_set(&asked.client_description()?, None, args.json, &mut out)?;
    }
    Ok(out.flush()?)
}

/// Again and again what the cards have said last; nobody asks them for it.
fn watch(asked: &mut Asked, axes: &[AxisNumber], json: bool) -> Result<(), Exit> {
    let (over, until) = mpsc::channel();
    let runtime = set::runtime()?;
    let _guard = runtime.enter();
    let asked_to_end = set::asked_to_end()?;
    runtime.spawn(async move {
        asked_to_end.await;
        let _ = over.send(());
    });
    let mut pictures = Pictures::new(!json);
    let mut before: Option<(Instant, u64)> = None;
    loop {
        let set = asked.client_description()?;
        let now = Instant::now();
        let rate =
            before.map(|(then, frames)| show::per_second(set.frames.saturating_sub(frames), now - then));
        before = Some((now, set.frames));
        let chosen = |state: &&AxisState| axes.is_empty() || axes.contains(&state.axis);
        let states: Vec<AxisState> = set.axes.iter().filter(chosen).copied().collect();
        let mut picture = Vec::new();
        tell_states(&states, &asked.config, json, &mut picture)?;
        if axes.is_empty() {
            tell_set(&set, rate, json, &mut picture)?;
        }
        pictures.show(&picture)?;
        match until.recv_timeout(WATCH) {
            Err(RecvTimeoutError::Timeout) => {}
            Ok(()) | Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}

fn tell_states(states: &[AxisState], config: &Config, json: bool, out: &mut dyn Write) -> io::Result<()> {
    if !json {
        return show::axes(states, config, out);
    }
    states.iter().try_for_each(|state| show::print_json(&show::AxisView::new(state, config), out))
}

fn tell_set(set: &Description, rate: Option<f64>, json: bool, out: &mut dyn Write) -> io::Result<()> {
    if json {
        return show::print_json(&serde_json::json!({ "recorder": set.recorder }), out);
    }
    show::set(set, rate, out)
}
