//! From a file or a text to a [`Config`] that keeps all rules, and back to a text. The only room that opens a file.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use miette::NamedSource;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::document::{self, floor_char_boundary, key_near, locate};
use crate::fault::{ConfigError, Fault};
use crate::problem::Problem;
use crate::rules::{self, Finding};
use crate::{Config, KeyPath, deserialize};

/// The seven-axis SUPERSIGMA set, the text that people copy and change.
pub const DEFAULT_TOML: &str = include_str!("../supersigma.toml");

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    ///
    /// [`ConfigError`]: the file cannot be read, is not TOML, does not fit the model, or breaks rules.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Self::from_toml(&read(path)?, &path.display().to_string())
    }

    /// Reads and checks a text. `source_name` is what errors call it: a file, or where else it came from.
    ///
    /// An axis's own ramp has from the set's ramp what it leaves out.
    ///
    /// # Errors
    ///
    /// [`ConfigError`]: the first syntax error, the first value that does not fit the model, or all broken rules.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, ConfigError> {
        let source =
            || NamedSource::new(source_name, Arc::<str>::from(printable(text))).with_language("toml");
        let mut root = document::parse(text).map_err(|error| {
            let key = key_near(text, error.span.start);
            let problem = match text[floor_char_boundary(text, error.span.start)..].chars().next() {
                Some(character) if is_control(character) => Problem::Control { character },
                _ => Problem::Syntax { reason: error.message },
            };
            ConfigError::One(Box::new(Fault::new(&source(), key, &error.span, None, problem)))
        })?;
        inherit_ramp(&mut root);
        let config: Self = deserialize::deserialize(&root).map_err(|mismatch| {
            let span = mismatch.span.unwrap_or_default();
            let problem = match mismatch.problem {
                Problem::MissingKey { key: "axis" } => Problem::NoAxis,
                problem => problem,
            };
            ConfigError::One(Box::new(Fault::new(&source(), mismatch.key, &span, None, problem)))
        })?;
        let findings = rules::check(&config);
        if findings.is_empty() {
            return Ok(config);
        }
        let source = source();
        let mut faults: Vec<Fault> =
            findings.into_iter().map(|finding| place(&source, &root, finding)).collect();
        faults.sort_by_key(|fault| (fault.line(), fault.column()));
        Err(match <[Fault; 1]>::try_from(faults) {
            Ok([fault]) => ConfigError::One(Box::new(fault)),
            Err(faults) => ConfigError::Several(faults),
        })
    }

    /// The compiled-in set, [`DEFAULT_TOML`].
    ///
    /// # Panics
    ///
    /// If [`DEFAULT_TOML`] is not valid, which the tests of this crate rule out.
    #[must_use]
    pub fn default_set() -> Self {
        Self::from_toml(DEFAULT_TOML, "supersigma.toml")
            .unwrap_or_else(|error| panic!("the built-in set: {error}"))
    }

    /// The effective configuration as TOML: every value is written out, defaults too. [`Config::from_toml`] gives the
    /// same configuration back.
    ///
    /// # Panics
    ///
    /// Never: all of the model can be written as TOML, which the tests of this crate show.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_else(|error| panic!("a configuration that TOML cannot hold: {error}"))
    }
}

/// The text of a file.
pub(crate) fn read(path: &Path) -> Result<String, ConfigError> {
    let bytes = fs::read(path).map_err(|reason| ConfigError::Unreadable { path: path.to_owned(), reason })?;
    String::from_utf8(bytes).map_err(|error| {
        let offset = error.utf8_error().valid_up_to();
        let is_utf16 = matches!(error.as_bytes(), [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..]);
        let text = String::from_utf8_lossy(error.as_bytes());
        let span = offset..offset + char::REPLACEMENT_CHARACTER.len_utf8();
        // In the midst of a text somebody may have typed an odd letter; otherwise no key is meant.
        let is_text = !text[..offset].is_empty() && !text.contains(is_control);
        let key = if is_text { key_near(&text, offset) } else { KeyPath::default() };
        let source = NamedSource::new(path.display().to_string(), Arc::from(printable(&text)));
        ConfigError::One(Box::new(Fault::new(&source, key, &span, None, Problem::NotUtf8 { is_utf16 })))
    })
}

/// Characters that no text has, and that a terminal may obey.
fn is_control(character: char) -> bool {
    character.is_control() && !matches!(character, '\t' | '\n' | '\r')
}

/// The text as it may be shown: a control character is a `?`, or a `·` where it has two bytes, so that places stay true.
fn printable(text: &str) -> String {
    let shown = |character: char| match character {
        control if is_control(control) && control.len_utf8() == 1 => '?',
        control if is_control(control) => '·',
        other => other,
    };
    text.chars().map(shown).collect()
}

/// Gives each axis's own ramp, in the tree, what it leaves out of the set's; so places stay true.
pub(crate) fn inherit_ramp(root: &mut Spanned<DeValue<'_>>) {
    let DeValue::Table(root) = root.get_mut() else {
        return;
    };
    let Some(set_ramp) = root.get("ramp").and_then(|ramp| ramp.get_ref().as_table()).cloned() else {
        return;
    };
    let Some(DeValue::Array(elements)) = root.get_mut("axis").map(Spanned::get_mut) else {
        return;
    };
    for element in elements.iter_mut() {
        let DeValue::Table(axis) = element.get_mut() else {
            continue;
        };
        if let Some(DeValue::Table(own)) = axis.get_mut("ramp").map(Spanned::get_mut) {
            fill_up(own, &set_ramp);
        }
    }
}

fn fill_up<'i>(own: &mut DeTable<'i>, from: &DeTable<'i>) {
    for (key, value) in from {
        if !own.contains_key(key.get_ref().as_ref()) {
            own.insert(key.clone(), value.clone());
        }
    }
}

/// Finds a broken rule's place: its value, or the other value when only that is written, or the table around it.
fn place(text: &NamedSource<Arc<str>>, root: &Spanned<DeValue<'_>>, finding: Finding) -> Fault {
    let Finding { key, other, problem } = finding;
    let find = |key: &KeyPath| locate(root, key);
    let other = other.as_ref().and_then(|other| find(other).ok());
    match (find(&key), other) {
        (Ok(span), other) => Fault::new(text, key, &span, other.as_ref(), problem),
        (Err(_), Some(span)) | (Err(span), None) => Fault::new(text, key, &span, None, problem),
    }
}
