//! From a file or a text to a [`Config`] that keeps all rules, and back to a text. Only here, and in `ramps` for
//! their tables, a file is opened.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use miette::NamedSource;
use toml::Spanned;
use toml::de::DeValue;

use crate::document::{self, floor_char_boundary, key_near, locate};
use crate::fault::{ConfigError, Fault};
use crate::problem::Problem;
use crate::ramps::{self, TableFile};
use crate::rules::{self, Finding};
use crate::{Config, KeyPath, deserialize};

/// The seven-axis SUPERSIGMA set, the text that people copy and change.
pub const DEFAULT_TOML: &str = include_str!("../supersigma.toml");

impl Config {
    /// Reads and checks a file. The tables that its ramps name are looked for beside it.
    ///
    /// # Errors
    ///
    /// [`ConfigError`]: the file cannot be read, is not TOML, does not fit the model, or breaks rules.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Ok(Self::beside(path.parent(), &read(path)?, &path.display().to_string())?.0)
    }

    /// Reads and checks a text. `source_name` is what errors call it: a file, or where else it came from.
    ///
    /// An axis's own ramp has from the set's ramp what it leaves out. A text names no files, since it is beside nothing.
    ///
    /// # Errors
    ///
    /// [`ConfigError`]: the first syntax error, the first value that does not fit the model, or all broken rules.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, ConfigError> {
        Ok(Self::beside(None, text, source_name)?.0)
    }

    /// Reads and checks a text that stands in `folder`, and says where the tables are that were read from files.
    pub(crate) fn beside(
        folder: Option<&Path>,
        text: &str,
        source_name: &str,
    ) -> Result<(Self, Vec<TableFile>), ConfigError> {
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
        let files = ramps::prepare(&mut root, folder, &source).map_err(ConfigError::One)?;
        let mut config: Self = deserialize::deserialize(&root).map_err(|mismatch| {
            let span = mismatch.span.unwrap_or_default();
            let problem = match mismatch.problem {
                Problem::MissingKey { key: "axis" } => Problem::NoAxis,
                problem => problem,
            };
            ConfigError::One(Box::new(Fault::new(&source(), mismatch.key, &span, None, problem)))
        })?;
        ramps::fill(&mut config, &files);
        let findings = rules::check(&config);
        if findings.is_empty() {
            return Ok((config, files));
        }
        let source = source();
        let mut faults: Vec<Fault> =
            findings.into_iter().map(|finding| place(&source, &root, &files, finding)).collect();
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
pub(crate) fn printable(text: &str) -> String {
    let shown = |character: char| match character {
        control if is_control(control) && control.len_utf8() == 1 => '?',
        control if is_control(control) => '·',
        other => other,
    };
    text.chars().map(shown).collect()
}

/// Finds a broken rule's place: its value, or the other value when only that is written, or the table around it.
fn place(
    text: &NamedSource<Arc<str>>,
    root: &Spanned<DeValue<'_>>,
    files: &[TableFile],
    finding: Finding,
) -> Fault {
    let Finding { key, other, problem } = finding;
    if let Some((table, span)) = files.iter().find_map(|file| file.place(&key)) {
        return Fault::new(table, key, &span, None, problem);
    }
    let find = |key: &KeyPath| locate(root, key);
    let other = other.as_ref().and_then(|other| find(other).ok());
    match (find(&key), other) {
        (Ok(span), other) => Fault::new(text, key, &span, other.as_ref(), problem),
        (Err(_), Some(span)) | (Err(span), None) => Fault::new(text, key, &span, None, problem),
    }
}
