//! Why a program did not run to its end, and where in its text: plain as `file:line:column: what`, or drawn by miette
//! with the line and a caret. Whether it is the script's fault, the robot's, or nobody's decides the exit code.

use std::fmt;
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode, SourceSpan};
use rhai::{AST, EvalAltResult, ParseError, ParseErrorType, Position};
use supersigma_config::choose;

use crate::executive::Failure;

use super::arguments::describe;
use super::functions::SIGNATURES;
use super::language;
use super::trouble::Trouble;

/// Why a program did not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// It is no program: nothing of it was run.
    #[error("{at}: {message}")]
    Syntax {
        /// What is wrong.
        message: String,
        /// What to do about it.
        help: Option<String>,
        /// Where.
        at: Box<Place>,
    },
    /// It asks for something that does not exist or does not go: a function, a variable, an axis, a type.
    #[error("{at}: {message}")]
    Script {
        /// What is wrong.
        message: String,
        /// What to do about it.
        help: Option<String>,
        /// Where.
        at: Box<Place>,
    },
    /// The robot, or the way to it, did not do what was asked.
    #[error("{at}: {message}")]
    Robot {
        /// Why.
        failure: Failure,
        /// The same in words, with the names of the set's axes and the machine time.
        message: String,
        /// The call that asked for it.
        at: Box<Place>,
    },
    /// An input did not come.
    #[error("{at}: {message}")]
    Timeout {
        /// Which input, and how long it was waited for.
        message: String,
        /// The call that waited.
        at: Box<Place>,
    },
    /// The program itself gave up, with `throw`.
    #[error("{at}: {message}")]
    Thrown {
        /// What it threw.
        message: String,
        /// Where.
        at: Box<Place>,
    },
    /// Somebody ended it.
    #[error("{at}: interrupted")]
    Interrupted {
        /// Where it was.
        at: Box<Place>,
    },
    /// It needs more operations, memory or nested calls than it may have.
    #[error("{at}: {message}")]
    LimitReached {
        /// Which limit.
        message: String,
        /// What to do about it.
        help: String,
        /// Where it was.
        at: Box<Place>,
    },
}

/// A place in the text of a program.
#[derive(Debug, Clone)]
pub struct Place {
    source: NamedSource<Arc<str>>,
    position: Option<(usize, usize)>,
    labels: Vec<LabeledSpan>,
}

impl ScriptError {
    /// Whether the program is right, and it is the robot or the way to it that did not do what was asked.
    #[must_use]
    pub fn is_robots_fault(&self) -> bool {
        match self {
            Self::Robot { failure, .. } => *failure != Failure::Cancelled && failure.exit_code() != 2,
            Self::Timeout { .. } | Self::Thrown { .. } => true,
            Self::Syntax { .. }
            | Self::Script { .. }
            | Self::Interrupted { .. }
            | Self::LimitReached { .. } => false,
        }
    }

    /// The exit code of the command line: 1 the robot could not (or was not allowed to), 2 the script is wrong, 3 the
    /// set is gone.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Robot { failure, .. } => failure.exit_code(),
            Self::Timeout { .. } | Self::Thrown { .. } | Self::Interrupted { .. } => 1,
            Self::Syntax { .. } | Self::Script { .. } | Self::LimitReached { .. } => 2,
        }
    }

    /// What kind of error it is, for programs.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Syntax { .. } => "syntax",
            Self::Script { .. } => "script",
            Self::Robot { .. } => "robot",
            Self::Timeout { .. } => "timeout",
            Self::Thrown { .. } => "thrown",
            Self::Interrupted { .. } => "interrupted",
            Self::LimitReached { .. } => "limit_reached",
        }
    }

    /// What is wrong, without the place.
    #[must_use]
    pub fn message(&self) -> String {
        match self {
            Self::Syntax { message, .. }
            | Self::Script { message, .. }
            | Self::Timeout { message, .. }
            | Self::Thrown { message, .. }
            | Self::Robot { message, .. }
            | Self::LimitReached { message, .. } => message.clone(),
            Self::Interrupted { .. } => "interrupted".into(),
        }
    }

    /// Where in the text.
    #[must_use]
    pub fn place(&self) -> &Place {
        match self {
            Self::Syntax { at, .. }
            | Self::Script { at, .. }
            | Self::Robot { at, .. }
            | Self::Timeout { at, .. }
            | Self::Thrown { at, .. }
            | Self::Interrupted { at }
            | Self::LimitReached { at, .. } => at,
        }
    }

    /// Something that is wrong with the text.
    pub(super) fn script(
        message: String,
        help: Option<String>,
        position: Position,
        source: &NamedSource<Arc<str>>,
    ) -> Self {
        Self::Script { message, help, at: Box::new(Place::new(source, position, &[], "here")) }
    }

    /// What the parser says.
    pub(super) fn syntax(error: &ParseError, source: &NamedSource<Arc<str>>) -> Self {
        let at = Place::new(source, error.position(), &[], "here");
        let word = at.word();
        let said = lower_first(&error.err_type().to_string());
        let (message, help) = match (language::instead_of(word), error.err_type()) {
            (Some(advice), _) if word.starts_with(char::is_alphabetic) => {
                (format!("there is no `{word}` in robot programs"), Some(advice.to_owned()))
            }
            (Some(advice), _) => (said, Some(advice.to_owned())),
            (None, ParseErrorType::Reserved(_)) => (said, Some("choose another name".to_owned())),
            (None, ParseErrorType::VariableUndefined(name)) => {
                let help = format!(
                    "declare it with `let`; axes, inputs and outputs are named in quotes: \"{name}\"; \
                     a function sees its parameters, its own variables, and constants as `global::{name}`"
                );
                (said, Some(help))
            }
            _ => (said, None),
        };
        Self::Syntax { message, help, at: Box::new(at) }
    }

    /// What the engine says of a run.
    pub(super) fn at_run_time(error: EvalAltResult, source: &NamedSource<Arc<str>>, ast: &AST) -> Self {
        let (error, calls) = innermost(error);
        let position = error.position();
        let at = |label: &str| Box::new(Place::new(source, position, &calls, label));
        if let Some((message, help)) = language::excess(&error) {
            return Self::LimitReached { message, help, at: at("here") };
        }
        match error {
            EvalAltResult::ErrorRuntime(thrown, _) | EvalAltResult::ErrorTerminated(thrown, _)
                if thrown.is::<Trouble>() =>
            {
                Self::of_trouble(thrown.cast::<Trouble>(), at)
            }
            EvalAltResult::ErrorTerminated(..) => Self::Interrupted { at: at("here") },
            EvalAltResult::ErrorRuntime(thrown, _) => {
                // An error of the language that was caught and thrown on is a map with these two entries.
                let caught = thrown.as_map_ref().ok().and_then(|map| {
                    map.get("error")?;
                    map.get("message").map(ToString::to_string)
                });
                match caught {
                    Some(message) => {
                        Self::Script { message: lower_first(&message), help: None, at: at("here") }
                    }
                    None => Self::Thrown {
                        message: match thrown.as_immutable_string_ref() {
                            Ok(text) => text.to_string(),
                            Err(_) => format!("the program threw {}", describe(&thrown)),
                        },
                        at: at("thrown here"),
                    },
                }
            }
            EvalAltResult::ErrorFunctionNotFound(signature, _) => {
                let (message, help) = no_such_call(&signature, ast);
                Self::Script { message, help: Some(help), at: at("here") }
            }
            other => Self::Script { message: said(other), help: None, at: at("here") },
        }
    }

    fn of_trouble(trouble: Trouble, at: impl Fn(&str) -> Box<Place>) -> Self {
        let message = trouble.to_string();
        match trouble {
            Trouble::Robot { failure, axis: Some(axis), .. } => {
                Self::Robot { failure, message, at: at(&axis) }
            }
            Trouble::Robot { failure: Failure::Cancelled, .. } | Trouble::Interrupted => {
                Self::Interrupted { at: at("here") }
            }
            Trouble::Robot { failure, axis: None, .. } => Self::Robot { failure, message, at: at("here") },
            Trouble::Timeout { .. } => Self::Timeout { message, at: at("here") },
            Trouble::Wrong { message, help } => Self::Script { message, help, at: at("here") },
        }
    }
}

impl Diagnostic for ScriptError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        let fixed = match self {
            Self::Syntax { help, .. } | Self::Script { help, .. } => {
                return help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>);
            }
            Self::Robot { failure, .. } => return failure.help(),
            Self::Timeout { .. } => "look at what should have changed the input, or allow it more time",
            Self::LimitReached { help, .. } => help,
            Self::Thrown { .. } | Self::Interrupted { .. } => return None,
        };
        Some(Box::new(fixed))
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.place().source)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        Some(Box::new(self.place().labels.iter().cloned()))
    }
}

impl Place {
    /// `calls` are the calls that led there, the innermost last.
    fn new(source: &NamedSource<Arc<str>>, position: Position, calls: &[Position], label: &str) -> Self {
        let text = source.inner();
        let here = offset(text, position);
        let primary =
            here.map(|here| LabeledSpan::new_primary_with_span(Some(label.into()), span(text, here)));
        let mut called: Vec<usize> = calls.iter().filter_map(|call| offset(text, *call)).collect();
        // A recursion calls from one place many times.
        called.sort_unstable();
        called.dedup();
        let called = called
            .into_iter()
            .map(|call| LabeledSpan::new_with_span(Some("called here".into()), span(text, call)));
        Self {
            source: source.clone(),
            position: here.map(|here| line_and_column(text, here)),
            labels: primary.into_iter().chain(called).collect(),
        }
    }

    /// The word or sign that stands there.
    fn word(&self) -> &str {
        let label = self.labels.first();
        label.map_or("", |label| &self.source.inner()[label.offset()..label.offset() + label.len()])
    }

    /// What the text is called.
    #[must_use]
    pub fn file(&self) -> &str {
        self.source.name()
    }

    /// From 1; `None` if it is nowhere in particular.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        self.position.map(|(line, _)| line)
    }

    /// From 1, in characters; `None` if it is nowhere in particular.
    #[must_use]
    pub fn column(&self) -> Option<usize> {
        self.position.map(|(_, column)| column)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.file())?;
        self.position.map_or(Ok(()), |(line, column)| write!(f, ":{line}:{column}"))
    }
}

/// The error itself, and the calls that led to it, the innermost last.
fn innermost(mut error: EvalAltResult) -> (EvalAltResult, Vec<Position>) {
    let mut calls = Vec::new();
    while let EvalAltResult::ErrorInFunctionCall(_, _, inner, position) = error {
        calls.push(position);
        error = *inner;
    }
    (error, calls)
}

/// What the engine calls it, without the place.
fn said(mut error: EvalAltResult) -> String {
    error.set_position(Position::NONE);
    lower_first(&error.to_string())
}

fn lower_first(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// A call that fits no function: what is wrong with it, and what would be right. `signature` is `name (type, type)`.
fn no_such_call(signature: &str, ast: &AST) -> (String, String) {
    let (name, types) = signature.split_once(' ').unwrap_or((signature, "()"));
    let types = types
        .replace("&str | ImmutableString | String", "string")
        .replace("i64", "int")
        .replace("f64", "float");
    if let Some((_, calls)) = SIGNATURES.iter().find(|(function, _)| *function == name) {
        return (format!("`{name}` cannot be called with {types}"), format!("call it as {calls}"));
    }
    if !name.starts_with(|first: char| first.is_alphabetic() || first == '_') {
        return (
            format!("`{name}` does not work on {types}"),
            "make both of one type, with `to_int()`, `to_float()` or `to_string()`".into(),
        );
    }
    if let Some(advice) = language::instead_of(name) {
        return (format!("there is no function `{name}`"), advice.to_owned());
    }
    let own: Vec<(&str, Vec<&str>)> =
        ast.iter_functions().map(|function| (function.name, function.params)).collect();
    if let Some((_, parameters)) = own.iter().find(|(function, _)| *function == name) {
        return (
            format!("`{name}` cannot be called with {types}"),
            format!("it is defined as `{name}({})`", parameters.join(", ")),
        );
    }
    let functions = SIGNATURES.iter().map(|(function, _)| *function).chain(own.iter().map(|(name, _)| *name));
    (
        format!("there is no function `{name}` that takes {types}"),
        choose(name, functions, "the functions of the robot and of this program are"),
    )
}

/// Where a position is in a text. What is missing at the end of a text is missing after its last visible character.
fn offset(text: &str, position: Position) -> Option<usize> {
    let (line, column) = (position.line()?, position.position().unwrap_or(1));
    let start: usize = text.split_inclusive('\n').take(line - 1).map(str::len).sum();
    let line = text[start..].split('\n').next().unwrap_or("");
    let before = line.char_indices().nth(column - 1).map_or(line.len(), |(offset, _)| offset);
    let last = text.trim_end().char_indices().next_back().map_or(0, |(offset, _)| offset);
    Some((start + before).min(last))
}

/// From 1, in characters.
fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..offset];
    let start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[start..].chars().count() + 1)
}

/// The word, text in quotes, or sign that begins there.
fn span(text: &str, offset: usize) -> SourceSpan {
    let rest = &text[offset..];
    let quoted = rest.strip_prefix('"').and_then(|inside| inside.split_once('"'));
    if let Some((inside, _)) = quoted.filter(|(inside, _)| !inside.contains('\n')) {
        return SourceSpan::from((offset, inside.len() + 2));
    }
    let word = rest.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(rest.len());
    let sign = rest.chars().next().map_or(0, char::len_utf8);
    SourceSpan::from((offset, word.max(sign)))
}
