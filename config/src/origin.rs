//! Where every value of a configuration in force comes from: a place in the text, or a default that is built in.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use miette::NamedSource;
use toml::de::DeValue;
use toml::{Spanned, Table, Value};

use crate::document::{self, line_and_column, locate};
use crate::load::read;
use crate::ramps::{self, TableFile};
use crate::{Config, ConfigError, DEFAULT_TOML, KeyPath};

/// What the text of the built-in set is called.
const BUILT_IN: &str = "built-in supersigma.toml";

/// One value in force.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// Its key.
    pub key: KeyPath,
    /// The value.
    pub value: Value,
    /// Where it comes from.
    pub source: Source,
}

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// Written in a text.
    Written {
        /// The file, or what the text is called.
        text: String,
        /// From 1.
        line: usize,
        /// From 1, in characters.
        column: usize,
    },
    /// Not written; what is built in is in force.
    Default,
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Written { text, line, column } => write!(f, "{text}:{line}:{column}"),
            Self::Default => f.write_str("default"),
        }
    }
}

impl Config {
    /// Every value in force, sorted by its key, and where it comes from. Without a file, the built-in set's.
    ///
    /// # Errors
    ///
    /// As [`load`](Self::load).
    ///
    /// # Panics
    ///
    /// Never: all of the model can be written as TOML, which the tests of this crate show.
    pub fn origins(file: Option<&Path>) -> Result<Vec<Origin>, ConfigError> {
        let (text, name) = match file {
            Some(path) => (read(path)?, path.display().to_string()),
            None => (DEFAULT_TOML.to_owned(), BUILT_IN.to_owned()),
        };
        let folder = file.and_then(Path::parent);
        let (config, tables) = Self::beside(folder, &text, &name)?;
        let effective: Table = toml::from_str(&config.to_toml())
            .unwrap_or_else(|error| panic!("a configuration that TOML cannot hold: {error}"));
        let mut values = vec![];
        flatten(&Value::Table(effective), &KeyPath::default(), &mut values);
        let mut root = document::parse(&text).ok();
        if let Some(root) = &mut root {
            // It was good a moment ago, and the tables are known.
            let _ = ramps::prepare(root, folder, &|| NamedSource::new(&name, Arc::from("")));
        }
        let source = |key: &KeyPath| {
            let in_file = || tables.iter().find_map(|table| in_table(table, key));
            in_file().or_else(|| root.as_ref().and_then(|root| written(root, key, &text, &name)))
        };
        let origin = |(key, value)| Origin { source: source(&key).unwrap_or(Source::Default), key, value };
        Ok(values.into_iter().map(origin).collect())
    }
}

fn in_table(table: &TableFile, key: &KeyPath) -> Option<Source> {
    let (text, span) = table.place(key)?;
    let (line, column) = line_and_column(text.inner(), span.start);
    Some(Source::Written { text: text.name().to_owned(), line, column })
}

fn written(root: &Spanned<DeValue<'_>>, key: &KeyPath, text: &str, name: &str) -> Option<Source> {
    let span = locate(root, key).ok()?;
    let (line, column) = line_and_column(text, span.start);
    Some(Source::Written { text: name.to_owned(), line, column })
}

/// The values that are no tables and no arrays of them; an empty one is a value.
fn flatten(value: &Value, key: &KeyPath, into: &mut Vec<(KeyPath, Value)>) {
    match value {
        Value::Table(table) if !table.is_empty() => {
            for (name, value) in table {
                flatten(value, &key.key(name), into);
            }
        }
        Value::Array(elements) if !elements.is_empty() => {
            for (index, value) in elements.iter().enumerate() {
                flatten(value, &key.index(index), into);
            }
        }
        value => into.push((key.clone(), value.clone())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
[ramp]
omega = 4.6
[[axis]]
address = 1
name = \"x\"
rail = { length = 20_000, lower_zone = 450, reference = 650, upper_zone = 19_000, start = 1_900 }
travel = { min = 0, max = 18_300 }
ramp.phase = 0.21
";

    fn of(text: &str) -> Vec<(String, String, String)> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cell.toml");
        std::fs::write(&path, text).expect("a file");
        let origins = Config::origins(Some(&path)).expect("it is good");
        let name = path.display().to_string();
        let told = |one: &Origin| {
            (one.key.to_string(), one.value.to_string(), one.source.to_string().replace(&name, "cell.toml"))
        };
        origins.iter().map(told).collect()
    }

    #[test]
    fn every_value_has_its_place_or_is_a_default() {
        let found = of(TEXT);
        let one = |key: &str| {
            let found = found.iter().find(|(known, ..)| known == key);
            let (_, value, source) = found.unwrap_or_else(|| panic!("no {key} in {found:?}"));
            (value.as_str(), source.as_str())
        };
        assert_eq!(one("ramp.omega"), ("4.6", "cell.toml:2:9"));
        assert_eq!(one("ramp.phase"), ("0.2097", "default"));
        assert_eq!(one("axis[0].name"), ("\"x\"", "cell.toml:5:8"));
        assert_eq!(one("axis[0].rail.length"), ("20000", "cell.toml:6:19"));
        assert_eq!(one("axis[0].ramp.phase"), ("0.21", "cell.toml:8:14"));
        assert_eq!(one("axis[0].ramp.omega"), ("4.6", "cell.toml:2:9"), "it is the set's");
        assert_eq!(one("axis[0].ramp.amplitude"), ("15000.0", "default"));
        assert_eq!(one("log.flush_ms"), ("100", "default"));
        assert_eq!(one("digital.output"), ("[]", "default"));
    }

    #[test]
    fn the_built_in_set_has_places_too() {
        let origins = Config::origins(None).expect("it is good");
        let name = origins.iter().find(|one| one.key.to_string() == "axis[6].name").expect("seven axes");
        let Source::Written { text, line, column } = &name.source else { panic!("{name:?}") };
        let written = DEFAULT_TOML.lines().nth(line - 1).expect("a line");
        assert!(written[column - 1..].starts_with("\"wrist\""), "{written}");
        assert_eq!(text, BUILT_IN);
    }
}
