//! `ccu bench limits`.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use axis_worker::motor::Characteristic;
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Value, json};

use super::motor::{MotorArgs, load};
use crate::bench::limits::{Limits, sweep, torques};
use crate::cli::exit::Exit;
use crate::cli::{plot, show};
use crate::plot::Format;
use crate::plot::limits::{MOST_DISCS, limits as draw};

/// A point takes some tenths of a second.
const MOST_POINTS: i64 = 200;

#[derive(Args)]
pub(in crate::cli) struct LimitsArgs {
    #[command(flatten)]
    motor: MotorArgs,
    /// Torques of the brake, N·m, besides --load-torque; if none are named, --points of them
    #[arg(long, value_name = "N·M", value_delimiter = ',', value_parser = load)]
    torques: Vec<f64>,
    /// How many torques, from none up to nearly all that the motor holds
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(2..=MOST_POINTS),
        conflicts_with = "torques")]
    points: u32,
    /// Moments of inertia of discs, kg·m², each besides --load-inertia; up to five
    #[arg(long, value_name = "KG·M²", value_delimiter = ',', default_value = "0", value_parser = load)]
    inertia: Vec<f64>,
    /// Look for the pull-out up to this speed, half steps/s
    #[arg(long, value_name = "HZ", default_value_t = 100_000.0, value_parser = top)]
    top: f64,
    /// Draw it; the name ends in .svg or .png
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write it as a table
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn limits(args: &LimitsArgs) -> Result<(), Exit> {
    if let Some(output) = &args.output {
        Format::of(output).map_err(|error| plot::exit(&error))?;
        if args.inertia.len() > MOST_DISCS {
            return Err(Exit::wrong(miette!("{MOST_DISCS} discs at most can be told apart in one picture")));
        }
    }
    let stand = args.motor.motor()?;
    let motor = stand.load.on(&stand.config);
    let mut wanted =
        if args.torques.is_empty() { torques(&motor, args.points) } else { args.torques.clone() };
    wanted.sort_by(f64::total_cmp);
    wanted.dedup();
    let bar = progress(wanted.len() * args.inertia.len());
    let found = sweep(&motor, &args.inertia, &wanted, args.top, &|| bar.inc(1));
    bar.finish_and_clear();
    let found = found.map_err(|error| Exit::wrong(miette!("{}: {error}", stand.name)))?;
    let title = format!("Limits of {}", stand.name);
    let subtitle = format!(
        "holding torque {} N·m, inertia {:.2e} kg·m², friction {} N·m; brake and disc besides",
        motor.holding_torque,
        motor.inertia(),
        motor.friction
    );
    if let Some(output) = &args.output {
        let picture = draw(&found, args.top, &title, &subtitle).map_err(|error| plot::exit(&error))?;
        picture.save(output).map_err(|error| plot::exit(&error))?;
    }
    if let Some(csv) = &args.csv {
        write_csv(csv, &found)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", csv.display()))
            .map_err(Exit::could_not)?;
    }
    let mut out = BufWriter::new(io::stdout().lock());
    if args.json {
        let points = |limits: &Limits| {
            limits.points.iter().map(|point| object(limits.inertia, point)).collect::<Vec<_>>()
        };
        let points: Vec<_> = found.iter().flat_map(points).collect();
        show::print_json(&json!({ "motor": stand.name, "top": args.top, "points": points }), &mut out)?;
    } else {
        writeln!(out, "{title}: {subtitle}")?;
        print(&found, args.top, &mut out)?;
    }
    Ok(out.flush()?)
}

/// A line on a terminal, nothing elsewhere.
fn progress(points: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(points as u64), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{bar:20} {pos}/{len} loads, {elapsed}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("█▉▊▋▌▍▎▏ "))
}

fn object(inertia: f64, point: &Characteristic) -> Value {
    let Characteristic { torque, start_stop, pull_in, pull_out } = point;
    json!({
        "inertia": inertia, "torque": torque, "start_stop": start_stop, "pull_in": pull_in, "pull_out": pull_out,
    })
}

fn write_csv(path: &Path, found: &[Limits]) -> Result<(), csv::Error> {
    let mut table = csv::Writer::from_path(path)?;
    table.write_record(["inertia_kgm2", "torque_nm", "start_stop_hz", "pull_in_hz", "pull_out_hz"])?;
    for limits in found {
        for Characteristic { torque, start_stop, pull_in, pull_out } in &limits.points {
            let limit = |limit: &Option<f64>| limit.map_or_else(String::new, |limit| format!("{limit:.1}"));
            let (inertia, torque) = (limits.inertia.to_string(), torque.to_string());
            table.write_record([inertia, torque, limit(start_stop), limit(pull_in), limit(pull_out)])?;
        }
    }
    Ok(table.flush()?)
}

fn print(found: &[Limits], top: f64, out: &mut dyn Write) -> io::Result<()> {
    for limits in found {
        if found.len() > 1 {
            writeln!(out, "\na disc of {} kg·m²", limits.inertia)?;
        }
        writeln!(
            out,
            "\n{:>9} {:>10} {:>10} {:>10}   half steps/s",
            "brake N·m", "start-stop", "pull-in", "pull-out"
        )?;
        for Characteristic { torque, start_stop, pull_in, pull_out } in &limits.points {
            let starts =
                |limit: &Option<f64>| limit.map_or_else(|| "-".to_owned(), |limit| format!("{limit:.0}"));
            let out_at = pull_out.map_or_else(|| format!("> {top:.0}"), |limit| format!("{limit:.0}"));
            writeln!(out, "{torque:>9.3} {:>10} {:>10} {out_at:>10}", starts(start_stop), starts(pull_in))?;
        }
    }
    let regions = [
        ("up to start-stop", "it starts, and stops after any pulse"),
        ("up to pull-in", "it starts"),
        ("up to pull-out", "only a ramp leads there"),
        ("beyond", "it slips"),
    ];
    writeln!(out)?;
    regions.iter().try_for_each(|(limit, region)| writeln!(out, "{limit:<17} {region}"))
}

/// A speed up to which a motor can be accelerated.
fn top(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (100.0..=100_000.0).contains(&value) => Ok(value),
        Ok(_) => Err("it is a speed from 100 to 100000".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}
