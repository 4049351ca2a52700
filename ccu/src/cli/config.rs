//! `ccu config`: is a file a good configuration, what is in force, and what may stand in one.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Subcommand;
use supersigma_config::{Config, DEFAULT_TOML};

use super::exit::Exit;

#[derive(Subcommand)]
pub(super) enum ConfigCommand {
    /// Say whether a file is a good configuration
    Check {
        /// The file
        file: PathBuf,
    },
    /// Print a configuration: the built-in set, or a file with all defaults written out
    Show {
        /// The file; the built-in set, with its comments, if none is named
        file: Option<PathBuf>,
    },
    /// Print the JSON Schema of configurations, for editors
    Schema,
}

/// Reads a configuration, or takes the built-in set.
pub(super) fn load(file: Option<&Path>) -> Result<Config, Exit> {
    match file {
        Some(file) => Config::load(file).map_err(|error| Exit::with_code(2, error)),
        None => Ok(Config::default_set()),
    }
}

pub(super) fn config(command: &ConfigCommand) -> Result<(), Exit> {
    let mut out = io::stdout().lock();
    match command {
        ConfigCommand::Check { file } => {
            let config = load(Some(file))?;
            writeln!(out, "{}: good, {} axes", file.display(), config.axes.len())?;
        }
        ConfigCommand::Show { file: None } => out.write_all(DEFAULT_TOML.as_bytes())?,
        ConfigCommand::Show { file } => out.write_all(load(file.as_deref())?.to_toml().as_bytes())?,
        ConfigCommand::Schema => writeln!(out, "{:#}", Config::json_schema())?,
    }
    Ok(())
}
