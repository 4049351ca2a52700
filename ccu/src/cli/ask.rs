//! Commands that ask a set which is up: over its control socket, one request each.

use std::io::{self, BufWriter, Write};
use std::thread;
use std::time::Duration;

use clap::{Args, ValueEnum};
use miette::{Diagnostic, miette};
use supersigma_config::Config;
use supersigma_protocol::{Address, AxisNumber, CommandBytes, End, Fault, Report, Steps, Switch};

use super::exit::Exit;
use super::{SetArgs, show};
use crate::control::{Client, Description};
use crate::executive::{AxisState, Displacement, Failure, Knowledge, Operate, Outcome, RawAnswer, Request};
use crate::home::Home;

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
    /// One JSON object an axis
    #[arg(long)]
    json: bool,
    /// Again and again, until Ctrl-C
    #[arg(long)]
    watch: bool,
}

#[derive(Args)]
pub(super) struct InputArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The line, by number (0 to 15) or name; all named ones if none is given
    line: Option<String>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct OutputArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The line, by number (0 to 15) or name; all named ones are shown if none is given
    line: Option<String>,
    /// Its level
    level: Option<Level>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Level {
    On,
    Off,
}

#[derive(Args)]
pub(super) struct SendArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The bytes, in hexadecimal; the first one is the address
    #[arg(required = true, value_name = "BYTE", value_parser = hex)]
    bytes: Vec<u8>,
    /// One JSON object an answer
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct InjectArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The axis, by number or name
    axis: String,
    /// force, limit, limit=upper, lost-steps=N, switch=open, switch=closed or switch=free
    #[arg(required = true, value_name = "FAULT", value_parser = fault)]
    faults: Vec<Fault>,
}

fn fault(text: &str) -> Result<Fault, String> {
    let steps = |steps: &str| steps.parse().map(|steps| Fault::LostSteps(Steps(steps)));
    match text.split_once('=').unwrap_or((text, "")) {
        ("force", "") => Ok(Fault::Force),
        ("limit", "" | "lower") => Ok(Fault::Limit(End::Lower)),
        ("limit", "upper") => Ok(Fault::Limit(End::Upper)),
        ("lost-steps", number) => steps(number).map_err(|_| format!("{number:?} is no number of steps")),
        ("switch", "open") => Ok(Fault::Switch(Switch::StuckOpen)),
        ("switch", "closed") => Ok(Fault::Switch(Switch::StuckClosed)),
        ("switch", "free") => Ok(Fault::Switch(Switch::Free)),
        _ => Err("no such fault; there are force, limit, limit=upper, lost-steps=N, switch=open|closed|free"
            .into()),
    }
}

fn hex(text: &str) -> Result<u8, String> {
    u8::from_str_radix(text.trim_start_matches("0x"), 16)
        .map_err(|_| format!("{text:?} is no byte; 00 to FF are"))
}

/// A name that means nothing in this set.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("this set has no {what} {name:?}")]
#[diagnostic(help("it has {known}{}", nearest.as_ref().map(|near| format!("; did you mean `{near}`?")).unwrap_or_default()))]
struct Unknown {
    what: &'static str,
    name: String,
    known: String,
    nearest: Option<String>,
}

fn unknown<'a>(what: &'static str, name: &str, known: impl Iterator<Item = &'a str> + Clone) -> Exit {
    let nearest = known
        .clone()
        .map(|one| (strsim::damerau_levenshtein(one, name), one))
        .min()
        .filter(|(distance, one)| *distance * 2 < one.len())
        .map(|(_, one)| one.to_owned());
    let known = known.collect::<Vec<_>>().join(", ");
    Exit::with_code(2, Unknown { what, name: name.to_owned(), known, nearest })
}

/// A set that is up, and what it is.
pub(super) struct Asked {
    pub(super) client: Client,
    pub(super) description: Description,
    pub(super) config: Config,
}

impl Asked {
    pub(super) fn connect(set: &SetArgs) -> Result<Self, Exit> {
        let home = Home::of(set.name.clone()).map_err(|error| Exit::with_code(3, error))?;
        let mut client = Client::connect(&home)?;
        let description = client.describe()?;
        let config = Config::from_toml(&description.config, "the set's configuration")
            .map_err(|error| Failure::Control { reason: error.to_string() })?;
        Ok(Self { client, description, config })
    }

    pub(super) fn axis(&self, name: &str) -> Result<AxisNumber, Exit> {
        match self.config.find_axis(name) {
            Some(axis) => Ok(axis.address),
            None => Err(unknown("axis", name, self.config.axes.iter().map(|axis| axis.name.as_str()))),
        }
    }

    /// None named, or `all`: an empty list, which means all.
    fn axes(&self, names: &[String]) -> Result<Vec<AxisNumber>, Exit> {
        if names.iter().any(|name| name == "all") {
            return Ok(vec![]);
        }
        names.iter().map(|name| self.axis(name)).collect()
    }

    pub(super) fn axis_states(&mut self, request: Request) -> Result<Vec<AxisState>, Exit> {
        match self.client.operate(request)? {
            Outcome::Axes(states) => Ok(states),
            _ => Ok(vec![]),
        }
    }

    fn word(&mut self, card: Address) -> Result<u16, Exit> {
        match self.client.operate(Request::Digital { card })? {
            Outcome::Digital(word) => Ok(word),
            other => Err(Failure::Control { reason: format!("{other:?} is no digital word") }.into()),
        }
    }

    /// Carries out something that moves axes, and prints a line a movement.
    fn moved(&mut self, request: Request, json: bool) -> Result<(), Exit> {
        let outcome = self.client.operate(request)?;
        self.tell_outcome(&outcome, json)
    }

    /// Prints a line a movement.
    fn tell_outcome(&self, outcome: &Outcome, json: bool) -> Result<(), Exit> {
        let knowledge = Knowledge::new(self.config.clone())
            .map_err(|error| Failure::Control { reason: error.to_string() })?;
        let mut out = BufWriter::new(io::stdout().lock());
        match outcome {
            Outcome::Moved(movements) => {
                if !json && movements.is_empty() {
                    writeln!(out, "nothing to move")?;
                } else if !json {
                    writeln!(out, "{}", show::movement_title())?;
                }
                for movement in movements {
                    if json {
                        show::print_json(&show::MovementView::new(movement, &knowledge), &mut out)?;
                    } else {
                        writeln!(out, "{}", show::movement_line(movement, &knowledge))?;
                    }
                }
            }
            _ if json => {}
            _ => writeln!(out, "started")?,
        }
        Ok(out.flush()?)
    }
}

pub(super) fn movement(args: &MoveArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    let by = Displacement(args.steps);
    let request =
        Request::Move { axis, by, speed: args.speed, constant: args.constant, wait: !args.how.no_wait };
    asked.moved(request, args.how.json)
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
    match asked.client.operate(Request::Resume)? {
        // Only programs waited; they tell of their movements themselves.
        Outcome::Moved(movements) if movements.is_empty() && !args.json => {
            println!("the program goes on");
            Ok(())
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

pub(super) fn inject(args: &InjectArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    let mut states = vec![];
    for fault in &args.faults {
        states = asked.axis_states(Request::Inject { axis, fault: *fault })?;
    }
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

impl Asked {
    fn client_description(&mut self) -> Result<Description, Exit> {
        self.description = self.client.describe()?;
        Ok(self.description.clone())
    }
}

fn set_line(set: &Description, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "\nset {}: up {:.0} s, time scale {}, {} frames, {} lost, {} {}",
        set.name,
        set.up_s,
        set.time_scale,
        set.frames,
        set.lost,
        if set.recording { "log" } else { "NO LOG ANY MORE, was" },
        set.log.display()
    )
}

pub(super) fn input(args: &InputArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    let word = asked.word(Address::DIGITAL_INPUT)?;
    let lines = asked.config.digital.inputs.iter().map(|line| (line.bit, line.name.as_str()));
    digital(word, lines, args.line.as_deref(), args.json, "input")
}

pub(super) fn output(args: &OutputArgs) -> Result<(), Exit> {
    let mut asked = Asked::connect(&args.set)?;
    if let (Some(line), Some(level)) = (&args.line, args.level) {
        let lines = asked.config.digital.outputs.iter().map(|line| (line.bit, line.name.as_str()));
        let (bit, _) = find_line(lines, line, "output")?;
        asked.client.operate(Request::Output { bit, on: level == Level::On })?;
    }
    let word = asked.word(Address::DIGITAL_OUTPUT)?;
    let lines = asked.config.digital.outputs.iter().map(|line| (line.bit, line.name.as_str()));
    digital(word, lines, args.line.as_deref(), args.json, "output")
}

fn digital<'a>(
    word: u16,
    lines: impl Iterator<Item = (u8, &'a str)> + Clone,
    only: Option<&str>,
    json: bool,
    what: &'static str,
) -> Result<(), Exit> {
    let mut out = io::stdout().lock();
    match only {
        Some(name) => {
            let (bit, name) = find_line(lines, name, what)?;
            show::digital(word, std::iter::once((bit, name.as_str())), json, &mut out)?;
        }
        None => show::digital(word, lines, json, &mut out)?,
    }
    Ok(())
}

fn find_line<'a>(
    lines: impl Iterator<Item = (u8, &'a str)> + Clone,
    name: &str,
    what: &'static str,
) -> Result<(u8, String), Exit> {
    let number = name.parse::<u8>().ok().filter(|bit| *bit < 16);
    let named = lines.clone().find(|(bit, line)| *line == name || Some(*bit) == number);
    match (named, number) {
        (Some((bit, line)), _) => Ok((bit, line.to_owned())),
        (None, Some(bit)) => Ok((bit, bit.to_string())),
        (None, None) => Err(unknown(what, name, lines.map(|(_, line)| line))),
    }
}

pub(super) fn send(args: &SendArgs) -> Result<(), Exit> {
    let bytes =
        CommandBytes::try_from(args.bytes.clone()).map_err(|error| Exit::wrong(miette!("{error}")))?;
    let mut asked = Asked::connect(&args.set)?;
    let Outcome::Answers(answers) = asked.client.operate(Request::Send { bytes })? else {
        return Ok(());
    };
    let mut out = BufWriter::new(io::stdout().lock());
    for answer in &answers {
        if args.json {
            show::print_json(answer, &mut out)?;
        } else {
            raw_answer(answer, &mut out)?;
        }
    }
    out.flush()?;
    // Said to everyone, it is done if anybody has done it.
    let done = answers.iter().any(|answer| answer.result.is_ok());
    match answers.iter().find_map(|answer| answer.result.err()) {
        Some(refusal) if !done => Err(Exit::could_not(miette!("refused: {refusal}"))),
        _ => Ok(()),
    }
}

fn raw_answer(answer: &RawAnswer, out: &mut dyn Write) -> io::Result<()> {
    let who = answer.card.map_or_else(|| "CCU".to_owned(), |card| card.to_string());
    let what = match answer.result {
        Ok(()) => "carried out".to_owned(),
        Err(refusal) => format!("refused: {refusal}"),
    };
    let state = match answer.report {
        Some(Report::Axis(report)) => format!(
            "; {}, X {}, {} steps, position {}",
            report.activity,
            report.sense,
            report.steps,
            report.position.map_or_else(|| "unknown".into(), |position| position.to_string())
        ),
        Some(Report::Digital(word)) => format!("; lines {word:016b}"),
        None => String::new(),
    };
    writeln!(out, "{who}: {what}{state}")
}
