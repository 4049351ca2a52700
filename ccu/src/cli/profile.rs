//! `ccu profile`: the ramp table, or one movement as the machine makes it.

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use axis_worker::ramp::Table;
use axis_worker::stall::{Demand, Strain};
use clap::{Args, ValueEnum};
use miette::miette;
use supersigma_config::{AxisConfig, RampConfig, ShortMoves};
use supersigma_protocol::{Activity, Direction, Distance, SpeedIndex};

use super::exit::Exit;
use super::{config, show};
use crate::profile::{Profile, Wanted, describe, profile as make};

#[derive(Args)]
pub(super) struct ProfileArgs {
    /// The configuration; the built-in set if none is named
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The axis, by number or name
    #[arg(long, default_value = "1")]
    axis: String,
    /// A movement of so many steps, 1 to 65535
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    steps: Option<u16>,
    /// Its ceiling in steps/s; with --constant, its speed
    #[arg(long, value_name = "V", requires = "steps")]
    speed: Option<f64>,
    /// At one speed, without a ramp
    #[arg(long, requires = "steps")]
    constant: bool,
    /// How it is made; as configured if not given
    #[arg(long, requires = "steps")]
    method: Option<Way>,
    /// With the tick of every pulse
    #[arg(long, requires = "steps")]
    pulses: bool,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
pub(super) enum Way {
    /// Up the curve and back down it
    Optimal,
    /// As in 1980
    Paper,
}

impl From<Way> for ShortMoves {
    fn from(way: Way) -> Self {
        match way {
            Way::Optimal => Self::Optimal,
            Way::Paper => Self::Paper,
        }
    }
}

pub(super) fn profile(args: &ProfileArgs) -> Result<(), Exit> {
    let config = config::load(args.config.as_deref())?;
    let axis = config::axis(&config, &args.axis)?;
    let mut ramp = config.ramp_of(axis).clone();
    if let Some(way) = args.method {
        ramp.short_moves = way.into();
    }
    let table = Table::new(&ramp).map_err(|error| Exit::wrong(miette!("{error}")))?;
    let mut out = BufWriter::new(io::stdout().lock());
    let Some(distance) = args.steps.and_then(Distance::new) else {
        print_table(axis, &ramp, &table, args.json, &mut out)?;
        return Ok(out.flush()?);
    };
    let speed = args.speed.map(|speed| index(&table, speed)).transpose()?;
    let wanted = Wanted { distance, speed, constant: args.constant };
    let mut profile = make(axis, &ramp, wanted).map_err(|error| Exit::wrong(miette!("{error}")))?;
    if args.json {
        if !args.pulses {
            profile.pulses = None;
        }
        show::print_json(&profile, &mut out)?;
    } else {
        print_profile(&profile, args.pulses, &mut out)?;
    }
    Ok(out.flush()?)
}

fn index(table: &Table, speed: f64) -> Result<SpeedIndex, Exit> {
    table.index_of(speed).ok_or_else(|| {
        let (slowest, fastest) = (table.speed(SpeedIndex::START), table.speed(SpeedIndex::TOP));
        Exit::wrong(miette!("{speed} steps/s is outside the ramp, {slowest:.1} to {fastest:.1}"))
    })
}

fn print_table(
    axis: &AxisConfig,
    ramp: &RampConfig,
    table: &Table,
    json: bool,
    out: &mut dyn Write,
) -> Result<(), Exit> {
    let strain = config::strained(axis, ramp)?;
    let entries = (0..=SpeedIndex::TOP.get()).filter_map(SpeedIndex::new);
    let difference = |index: SpeedIndex| table.differences().get(usize::from(index.get())).copied();
    if json {
        let entries: Vec<_> = entries
            .map(|index| {
                serde_json::json!({
                    "index": index.get(),
                    "n": table.period(index) - 1,
                    "count": table.period(index),
                    "steps_per_second": table.speed(index),
                    "difference": difference(index),
                })
            })
            .collect();
        let motor = strain.map(|Strain { tightest, stall }| {
            serde_json::json!({
                "tightest": demand(&tightest),
                "stall": stall.map(|stall| {
                    serde_json::json!({
                        "pulse": stall.pulse,
                        "ticks": stall.at.0,
                        "activity": Activity::from(stall.phase),
                        "towards_origin": stall.direction == Direction::TowardsOrigin,
                        "demand": demand(&stall.demand),
                    })
                }),
            })
        });
        let whole = serde_json::json!({
            "profile": ramp.profile.name(),
            "differences": ramp.differences,
            "interval_ticks": table.interval().0,
            "brake_interval_ticks": ramp.brake_interval_ticks,
            "entries": entries,
            "motor": motor,
        });
        return Ok(show::print_json(&whole, out)?);
    }
    writeln!(out, "{}: {}", axis.name, describe(ramp, |speed| speed.to_string()))?;
    if let Some(Strain { tightest, stall }) = &strain {
        match stall {
            None => writeln!(out, "the motor follows; the tightest place: {tightest}")?,
            Some(stall) => writeln!(out, "{stall}")?,
        }
    }
    writeln!(out, "{:>5} {:>7} {:>6} {:>6} {:>9} {:>6}", "index", "ms", "N", "count", "steps/s", "diff")?;
    for index in entries {
        let at = table.interval().as_seconds() * 1e3 * f64::from(index.get());
        let difference = difference(index).map_or_else(|| "-".into(), |difference| difference.to_string());
        let (count, speed) = (table.period(index), table.speed(index));
        writeln!(
            out,
            "{:>5} {at:>7.2} {:>6} {count:>6} {speed:>9.1} {difference:>6}",
            index.get(),
            count - 1
        )?;
    }
    Ok(())
}

fn demand(demand: &Demand) -> serde_json::Value {
    serde_json::json!({
        "index": demand.entry.get(),
        "steps_per_second": demand.speed,
        "needed_newton_metres": demand.needed,
        "available_newton_metres": demand.available,
    })
}

fn print_profile(profile: &Profile, pulses: bool, out: &mut dyn Write) -> io::Result<()> {
    let method = match profile.method {
        crate::profile::Method::Optimal => "optimal",
        crate::profile::Method::Paper => "paper",
        crate::profile::Method::Constant => "constant speed",
    };
    writeln!(out, "{} steps, {method}, {}", profile.steps, profile.profile.word())?;
    writeln!(out, "duration      {:>10.6} s", profile.duration_ticks.as_seconds())?;
    writeln!(out, "peak speed    {:>10.1} steps/s", profile.peak_speed)?;
    writeln!(out, "accelerates   {:>10} steps", profile.accel_steps)?;
    writeln!(out, "decelerates   {:>10} steps before the end", profile.steps - profile.decel_at)?;
    writeln!(out, "loads         {:>10} counts written to counter 0", profile.loads.len())?;
    writeln!(out, "\n{:>12} {:>6}", "load at ms", "count")?;
    for load in &profile.loads {
        writeln!(out, "{:>12.4} {:>6}", load.tick.as_seconds() * 1e3, load.count)?;
    }
    if let Some(ticks) = profile.pulses.as_ref().filter(|_| pulses) {
        writeln!(out, "\n{:>12}", "pulse at ms")?;
        for tick in ticks {
            writeln!(out, "{:>12.4}", tick.as_seconds() * 1e3)?;
        }
    }
    Ok(())
}
