//! A problem with its place: what people read. Plain as `file:line:column: key: problem`, or drawn by miette.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::{error, io};

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode, SourceSpan};
use thiserror::Error;

use crate::document::{floor_char_boundary, line_and_column};
use crate::problem::Problem;
use crate::{KeyPath, schema};

/// Why there is no configuration.
#[derive(Debug, Error, Diagnostic)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {}: {reason}", path.display())]
    #[diagnostic(help("{}", match reason.kind() {
        io::ErrorKind::IsADirectory => "name a file, not a folder",
        io::ErrorKind::PermissionDenied => "see who may read it: `ls -l`",
        _ => "name a file that exists; without one, the built-in set is used, and `ccu config show` prints it",
    }))]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// One thing is wrong with it.
    #[error(transparent)]
    #[diagnostic(transparent)]
    One(Box<Fault>),
    /// Several rules are broken; each is told.
    #[error("{}", summary(.0))]
    Several(#[related] Vec<Fault>),
}

impl ConfigError {
    /// What is wrong, in the order of the text's tables; empty when there was no text.
    #[must_use]
    pub fn faults(&self) -> &[Fault] {
        match self {
            Self::Unreadable { .. } => &[],
            Self::One(fault) => std::slice::from_ref(fault),
            Self::Several(faults) => faults,
        }
    }
}

fn summary(faults: &[Fault]) -> String {
    let places: Vec<String> =
        faults.iter().map(|fault| format!("{}:{} {}", fault.line, fault.column, fault.key)).collect();
    let file = faults.first().map_or("", |fault| fault.text.name());
    format!("{file} has {} faults, at {}", faults.len(), places.join(", "))
}

/// One thing that is wrong, and where.
#[derive(Debug, Clone)]
pub struct Fault {
    text: NamedSource<Arc<str>>,
    key: KeyPath,
    line: usize,
    column: usize,
    labels: Vec<LabeledSpan>,
    problem: Problem,
}

impl Fault {
    /// `other` is a second place that the problem has to do with.
    pub(crate) fn new(
        text: &NamedSource<Arc<str>>,
        key: KeyPath,
        span: &Range<usize>,
        other: Option<&Range<usize>>,
        problem: Problem,
    ) -> Self {
        let (line, column) = line_and_column(text.inner(), span.start);
        let whole_characters = |span: &Range<usize>| {
            let [start, end] = [span.start, span.end].map(|end| floor_char_boundary(text.inner(), end));
            SourceSpan::from(start..end.max(start))
        };
        // The drawing is headed by the place of its primary label.
        let here = LabeledSpan::new_primary_with_span(Some("here".to_owned()), whole_characters(span));
        let there = other.map(|other| {
            let words = problem.about_the_other().to_owned();
            LabeledSpan::new_with_span(Some(words), whole_characters(other))
        });
        let labels = [here].into_iter().chain(there).collect();
        Self { text: text.clone(), key, line, column, labels, problem }
    }

    /// The file, or what else the text was said to be.
    #[must_use]
    pub fn source_name(&self) -> &str {
        self.text.name()
    }

    /// The key of the value; the root when the text ends before any.
    #[must_use]
    pub const fn key(&self) -> &KeyPath {
        &self.key
    }

    /// From 1.
    #[must_use]
    pub const fn line(&self) -> usize {
        self.line
    }

    /// From 1, in characters.
    #[must_use]
    pub const fn column(&self) -> usize {
        self.column
    }

    /// What is wrong.
    #[must_use]
    pub const fn problem(&self) -> &Problem {
        &self.problem
    }

    /// What to do about it, and what the key means where that helps.
    #[must_use]
    pub fn advice(&self) -> Option<String> {
        self.problem
            .advice()
            .or_else(|| Some(format!("`{}` means: {}", self.key, schema::meaning(&self.key)?)))
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}: ", self.text.name(), self.line, self.column)?;
        if !self.key.is_root() {
            write!(f, "{}: ", self.key)?;
        }
        self.problem.fmt(f)
    }
}

impl error::Error for Fault {}

impl Diagnostic for Fault {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.advice().map(|advice| Box::new(advice) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.text)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        Some(Box::new(self.labels.iter().cloned()))
    }
}
