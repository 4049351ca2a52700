//! Commands for people who debug: the digital cards, raw bytes on the bus, faults on purpose.

use std::io::{self, BufWriter, Write};

use clap::{Args, ValueEnum};
use miette::miette;
use supersigma_protocol::{Address, CardKind, CommandBytes, End, Fault, Report, Steps, Switch};

use super::asked::{Asked, unknown};
use super::exit::Exit;
use super::{SetArgs, show};
use crate::executive::{Failure, Outcome, RawAnswer, Request, advice};

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
        asked.operate(Request::Output { bit, on: level == Level::On })?;
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
    let Outcome::Answers(answers) = asked.operate(Request::Send { bytes })? else {
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
    let refused = answers.iter().find_map(|answer| Some((answer.card, answer.result.err()?)));
    match refused.filter(|_| !done) {
        Some((Some(card), refusal)) => {
            let failure = match card.kind() {
                CardKind::Axis(axis) => Failure::Refused { axis, refusal, at: None },
                _ => Failure::DigitalRefused { card, refusal },
            };
            Err(Exit::told(failure, &asked.knowledge))
        }
        Some((None, refusal)) => {
            Err(Exit::could_not(miette!(help = advice::refusal(&refusal), "refused: {refusal}")))
        }
        None => Ok(()),
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
