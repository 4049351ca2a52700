//! `ccu config`: is a file a good configuration, what is in force, and what may stand in one.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use axis_worker::stall::{Strain, strain};
use clap::{Args, Subcommand};
use miette::miette;
use serde::Serialize;
use supersigma_config::{AxisConfig, Config, DEFAULT_TOML, Origin, RampConfig, Source};
use supersigma_protocol::AxisNumber;

use super::exit::Exit;
use super::show;

#[derive(Subcommand)]
pub(super) enum ConfigCommand {
    /// Say whether a file is a good configuration, and warn if a motor cannot follow its ramp
    #[command(after_help = "Examples:\n  ccu config check cell.toml")]
    Check {
        /// The file
        file: PathBuf,
        /// What is wrong, if anything, as a JSON object
        #[arg(long)]
        json: bool,
    },
    /// Print a configuration: the built-in set, or a file with all defaults written out
    #[command(after_help = "\
Examples:
  ccu config show > cell.toml
  ccu config show cell.toml
  ccu config show --origin cell.toml
  ccu config show --origin --json --config cell.toml")]
    Show(ShowArgs),
    /// Print the JSON Schema of configurations, for editors
    #[command(after_help = "Examples:\n  ccu config schema > supersigma.schema.json")]
    Schema,
}

#[derive(Args)]
pub(super) struct ShowArgs {
    /// The file; the built-in set, with its comments, if none is named
    file: Option<PathBuf>,
    /// The same as FILE, as other commands have it
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    config: Option<PathBuf>,
    /// Every value in force, and where it comes from: file, line and column, or `default`
    #[arg(long)]
    origin: bool,
    /// One JSON object a value
    #[arg(long, requires = "origin")]
    json: bool,
}

/// Reads a configuration, or takes the built-in set.
pub(super) fn load(file: Option<&Path>) -> Result<Config, Exit> {
    match file {
        Some(file) => Config::load(file).map_err(|error| Exit::with_code(2, error)),
        None => Ok(Config::default_set()),
    }
}

pub(super) fn config(command: &ConfigCommand) -> Result<(), Exit> {
    let mut out = BufWriter::new(io::stdout().lock());
    match command {
        ConfigCommand::Check { file, json } => {
            let config = load(Some(file))?;
            let count = config.axes.len();
            let warnings = stalls(&config)?;
            if *json {
                let told = serde_json::json!({ "file": file, "axes": count, "warnings": warnings });
                show::print_json(&told, &mut out)?;
            } else {
                let axes = if count == 1 { "axis" } else { "axes" };
                writeln!(out, "{}: good, {count} {axes}", file.display())?;
                out.flush()?;
                for Warning { axis, name, message } in &warnings {
                    eprintln!("warning: {}: {axis} ({name}): {message}", file.display());
                }
            }
        }
        ConfigCommand::Show(args) => {
            let file = args.file.as_deref().or(args.config.as_deref());
            match file {
                _ if args.origin => origins(file, args.json, &mut out)?,
                None => out.write_all(DEFAULT_TOML.as_bytes())?,
                Some(_) => out.write_all(load(file)?.to_toml().as_bytes())?,
            }
        }
        ConfigCommand::Schema => writeln!(out, "{:#}", Config::json_schema())?,
    }
    Ok(out.flush()?)
}

/// The axis of this number or name.
///
/// # Errors
/// If there is none.
pub(super) fn axis<'a>(config: &'a Config, wanted: &str) -> Result<&'a AxisConfig, Exit> {
    config.find_axis(wanted).ok_or_else(|| {
        let names: Vec<_> = config.axes.iter().map(|axis| axis.name.as_str()).collect();
        Exit::wrong(miette!("there is no axis {wanted:?}; there are {}", names.join(", ")))
    })
}

/// What an axis' motor makes of a ramp, if it has one that can lose steps.
///
/// # Errors
/// If the ramp gives no table, or the motor cannot be.
pub(super) fn strained(axis: &AxisConfig, ramp: &RampConfig) -> Result<Option<Strain>, Exit> {
    let strain = axis.motor.as_ref().map(|motor| strain(motor, ramp)).transpose();
    strain.map_err(|error| Exit::wrong(miette!("{error}")))
}

/// Something that is allowed and does not work.
#[derive(Serialize)]
struct Warning<'a> {
    axis: AxisNumber,
    name: &'a str,
    message: String,
}

/// The axes whose motors cannot follow their ramps, and where they fall out of step.
fn stalls(config: &Config) -> Result<Vec<Warning<'_>>, Exit> {
    let mut warnings = Vec::new();
    for axis in &config.axes {
        let strain = strained(axis, config.ramp_of(axis))?;
        if let Some(stall) = strain.and_then(|strain| strain.stall) {
            warnings.push(Warning { axis: axis.address, name: &axis.name, message: stall.to_string() });
        }
    }
    Ok(warnings)
}

/// Every value in force with its origin, in columns, or an object a line.
fn origins(file: Option<&Path>, json: bool, out: &mut dyn Write) -> Result<(), Exit> {
    let origins = Config::origins(file).map_err(|error| Exit::with_code(2, error))?;
    if json {
        for Origin { key, value, source } in &origins {
            let (text, line, column) = match source {
                Source::Written { text, line, column } => (Some(text), Some(line), Some(column)),
                Source::Default => (None, None, None),
            };
            let key = key.to_string();
            let one = serde_json::json!({ "key": key, "value": value, "file": text, "line": line, "column": column });
            show::print_json(&one, out)?;
        }
        return Ok(());
    }
    let rows: Vec<_> =
        origins.iter().map(|one| (one.key.to_string(), one.value.to_string(), &one.source)).collect();
    let widest = |width: fn(&(String, String, &Source)) -> usize| rows.iter().map(width).max().unwrap_or(0);
    let (keys, values) = (widest(|row| row.0.len()), widest(|row| row.1.len()));
    for (key, value, source) in &rows {
        writeln!(out, "{key:<keys$}  {value:<values$}  {source}")?;
    }
    Ok(())
}
