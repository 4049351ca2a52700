//! `ccu bench tune`.

use std::fmt::Write as _;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use axis_worker::ramp::Table;
use axis_worker::tune::{Assessment, CardShape, LinearProposal, Margin, Outcome, TuneError};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Value, json};
use supersigma_config::{MotorError, RampConfig};
use supersigma_protocol::Distance;

use super::motor::MotorArgs;
use crate::bench::tune::{Maker, Wanted, Way, best_ramp, compare, toml};
use crate::cli::exit::Exit;
use crate::cli::{plot, show};
use crate::plot::Format;
use crate::plot::tune::{Shown, tune as draw};

#[derive(Args)]
pub(in crate::cli) struct TuneArgs {
    /// The movement, half steps, 1 to 65535
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    steps: u16,
    /// The part of the holding torque to keep in hand: 30%, or 0.3
    #[arg(long, value_name = "PART", default_value = "30%", value_parser = margin)]
    margin: Margin,
    /// What to propose
    #[arg(long, default_value = "both")]
    profile: Shapes,
    /// Draw the current ramp and the proposals; the name ends in .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Write the card's fastest ramp: .toml for a configuration, .table for its numbers N, one a line
    #[arg(long, value_name = "FILE", value_parser = written)]
    write: Option<(PathBuf, Written)>,
    /// One JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    motor: MotorArgs,
}

#[derive(Clone, Copy, ValueEnum)]
pub(in crate::cli) enum Shapes {
    /// Straight slopes: for `ccu bench positioning`, and for the card
    Linear,
    /// The card's sin² curve
    Sin2,
    /// Both
    Both,
}

/// What `--write` writes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::cli) enum Written {
    Toml,
    Counts,
}

impl Shapes {
    const fn shapes(self) -> &'static [CardShape] {
        match self {
            Self::Linear => &[CardShape::Linear],
            Self::Sin2 => &[CardShape::Sin2],
            Self::Both => &[CardShape::Linear, CardShape::Sin2],
        }
    }
}

pub(super) fn tune(args: &TuneArgs) -> Result<(), Exit> {
    if let Some(plot) = &args.plot {
        Format::of(plot).map_err(|error| plot::exit(&error))?;
    }
    let stand = args.motor.motor()?;
    let motor = stand.load.on(&stand.config);
    let current = args.motor.ramp()?;
    let distance = Distance::new(args.steps).ok_or_else(|| Exit::wrong(miette!("a movement has steps")))?;
    let shapes = args.profile.shapes();
    let wanted = Wanted { motor: &motor, current: &current, distance, margin: args.margin, shapes };
    let bar = ProgressBar::new_spinner().with_style(
        ProgressStyle::with_template("{spinner} playing movements to the rotor, {elapsed}")
            .unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    bar.enable_steady_tick(Duration::from_millis(200));
    let ways = compare(&wanted);
    bar.finish_and_clear();
    let ways = ways.map_err(|error| cannot(&error, &stand.name))?;
    if let Some(path) = &args.plot {
        let shown = Shown { wanted: &wanted, name: &stand.name, ways: &ways };
        let picture = draw(&shown).map_err(|error| Exit::could_not(miette!("{error}")))?;
        picture.save(path).map_err(|error| plot::exit(&error))?;
    }
    if let (Some((path, form)), Some(ramp)) = (&args.write, best_ramp(&ways)) {
        write_ramp(path, *form, ramp, args.motor.axis())?;
    }
    let mut out = BufWriter::new(io::stdout().lock());
    if args.json {
        show::print_json(&object(args, &stand.name, &ways), &mut out)?;
    } else {
        print(args, &stand.name, &ways, &mut out)?;
    }
    Ok(out.flush()?)
}

/// A motor that cannot do it is no typing error.
fn cannot(error: &TuneError, name: &str) -> Exit {
    let exit = match error {
        TuneError::Motor(MotorError::Overloaded { .. })
        | TuneError::NoMargin { .. }
        | TuneError::WillNotStart { .. }
        | TuneError::NoTable { .. } => Exit::could_not,
        TuneError::Motor(_) => Exit::wrong,
    };
    exit(miette!(
        help = "try a smaller --margin, less load, or a motor with more torque",
        "there is nothing to propose for {name}: {error}"
    ))
}

fn write_ramp(path: &Path, form: Written, ramp: &RampConfig, axis: Option<&str>) -> Result<(), Exit> {
    let text = match form {
        Written::Toml => toml(ramp, axis),
        Written::Counts => {
            let table = Table::new(ramp).map_err(|error| Exit::could_not(miette!("{error}")))?;
            table.counts().iter().fold(String::new(), |mut text, n| {
                let _ = writeln!(text, "{n}");
                text
            })
        }
    };
    fs::write(path, text)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
        .map_err(Exit::could_not)
}

/// The key of a configuration with which a ramp is taken from a file of its numbers.
fn table_key(path: &Path, ramp: &RampConfig) -> String {
    format!(
        "ramp = {{ profile = \"table\", file = {:?}, interval_ticks = {}, brake_interval_ticks = {}, differences = \"{}\" }}",
        path.display().to_string(),
        ramp.interval_ticks(),
        ramp.brake_interval_ticks,
        ramp.differences.word()
    )
}

/// The command that plays a linear profile on the bench.
fn command(proposal: &LinearProposal, motor: &str) -> String {
    let hertz = |millihertz: u64| millihertz / 1_000;
    let seconds = |clocks: u64| format!("{}.{:06}", clocks / 1_000_000, clocks % 1_000_000);
    let profile = &proposal.profile;
    format!(
        "ccu bench positioning --f-start {} --f-max {} --ta {} --tb {} --tc {}{motor}",
        hertz(profile.start.millihertz()),
        hertz(profile.max.millihertz()),
        seconds(profile.t_a.0),
        seconds(proposal.t_b().0),
        seconds(profile.t_c.0)
    )
}

fn print(args: &TuneArgs, name: &str, ways: &[Way], out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{} half steps with {name}, {} of its torque in hand\n", args.steps, args.margin)?;
    writeln!(
        out,
        "{:<14} {:>9} {:>9} {:>11} {:>7}  follows",
        "", "pulses ms", "settle ms", "top steps/s", "margin"
    )?;
    for way in ways {
        let Assessment { duration, top_speed, margin, .. } = way.assessment;
        let settled = match way.assessment.nominal {
            Outcome::Follows { settled } => format!("{:.1}", settled.as_seconds() * 1e3),
            Outcome::Slips(_) => "-".into(),
        };
        let margin = margin.map_or_else(|| "-".to_owned(), |margin| margin.to_string());
        writeln!(
            out,
            "{:<14} {:>9.1} {settled:>9} {top_speed:>11.0} {margin:>7}  {}",
            way.maker.name(),
            duration.as_seconds() * 1e3,
            in_words(&way.assessment, args.margin)
        )?;
    }
    for way in ways {
        match &way.maker {
            Maker::Current(_) => {}
            Maker::Bench(proposal) => {
                writeln!(out, "\n{}, of {} movements tried:\n", way.maker.name(), way.trials)?;
                writeln!(out, "{}", command(proposal, &args.motor.typed()))?;
            }
            Maker::Card(_, ramp) => {
                writeln!(out, "\n{}, of {} movements tried:\n", way.maker.name(), way.trials)?;
                write!(out, "{}", toml(ramp, args.motor.axis()))?;
            }
        }
    }
    if let (Some((path, form)), Some(ramp)) = (&args.write, best_ramp(ways)) {
        writeln!(out, "\nthe fastest one of the card's is in {}", path.display())?;
        if *form == Written::Counts {
            writeln!(out, "{}", table_key(path, ramp))?;
        }
    }
    Ok(())
}

/// Whether steps are lost, and where.
fn in_words(assessment: &Assessment, margin: Margin) -> String {
    let (outcome, when) = match (assessment.nominal, assessment.at_margin) {
        (slips @ Outcome::Slips(_), _) => (slips, String::new()),
        (_, slips) => (slips, format!(" within {margin} of the torque")),
    };
    match outcome {
        Outcome::Follows { .. } => "yes".into(),
        Outcome::Slips(slip) => format!(
            "no: slips{when} at pulse {}, {:.0} steps/s, after {:.3} s; {} lost",
            slip.pulse,
            slip.speed,
            slip.at.as_seconds(),
            slip.lost
        ),
    }
}

fn object(args: &TuneArgs, name: &str, ways: &[Way]) -> Value {
    let ways: Vec<_> = ways
        .iter()
        .map(|way| {
            let Assessment { duration, top_speed, nominal, at_margin, margin } = way.assessment;
            let mut object = json!({
                "name": way.maker.name(),
                "seconds": duration.as_seconds(),
                "top_speed": top_speed,
                "nominal": outcome(nominal),
                "at_margin": outcome(at_margin),
                "margin": margin.map(Margin::part),
                "trials": way.trials,
            });
            match &way.maker {
                Maker::Current(ramp) => object["ramp"] = json!(ramp),
                Maker::Card(_, ramp) => {
                    object["ramp"] = json!(ramp);
                    object["toml"] = json!(toml(ramp, args.motor.axis()));
                }
                Maker::Bench(proposal) => {
                    let profile = &proposal.profile;
                    let seconds = |clocks: axis_worker::bench::Clocks| clocks.ticks().as_seconds();
                    object["positioning"] = json!({
                        "f_start": profile.start.hertz(),
                        "f_max": profile.max.hertz(),
                        "t_a": seconds(profile.t_a),
                        "t_b": seconds(proposal.t_b()),
                        "t_c": seconds(profile.t_c),
                        "steps": { "a": proposal.steps.a, "b": proposal.steps.b, "c": proposal.steps.c },
                    });
                    object["command"] = json!(command(proposal, &args.motor.typed()));
                }
            }
            object
        })
        .collect();
    json!({ "motor": name, "steps": args.steps, "margin": args.margin.part(), "ways": ways })
}

fn outcome(outcome: Outcome) -> Value {
    match outcome {
        Outcome::Follows { settled } => json!({ "follows": true, "settled_seconds": settled.as_seconds() }),
        Outcome::Slips(slip) => json!({
            "follows": false, "pulse": slip.pulse, "seconds": slip.at.as_seconds(), "speed": slip.speed, "lost": slip.lost,
        }),
    }
}

/// `30%` or `0.3`.
fn margin(text: &str) -> Result<Margin, String> {
    let part = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse(),
    };
    part.ok()
        .and_then(Margin::new)
        .ok_or_else(|| "a margin is a part of the torque: 30%, or 0.3; less than 100%".into())
}

fn written(text: &str) -> Result<(PathBuf, Written), String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(std::ffi::OsStr::to_str) {
        Some("toml") => Ok((path, Written::Toml)),
        Some("table") => Ok((path, Written::Counts)),
        _ => Err("the name of a ramp ends in .toml or .table".into()),
    }
}
