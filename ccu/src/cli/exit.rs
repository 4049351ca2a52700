//! How a command ends when it does not end well: a report on standard error, and an exit code. The report is drawn for
//! people; with `--json` it is one line of JSON with stable keys; for the journal its lines have a priority.

use std::fmt::{self, Write as _};
use std::io::{self, Write};
use std::process::ExitCode;

use axis_worker::journal;
use miette::{Diagnostic, IntoDiagnostic, MietteHandlerOpts, Report, ReportHandler};
use serde_json::{Value, json};

use crate::executive::{Failure, Knowledge};
use crate::script::ScriptError;

/// Why the command ends, and with which code.
#[derive(Debug)]
pub(super) struct Exit {
    code: u8,
    report: Option<Report>,
    /// What is known about it beyond message and help.
    facts: Facts,
}

/// What programs want to know of a failure without reading its message.
#[derive(Debug, Default)]
struct Facts {
    /// The failure's name; one of the exit code if it has none.
    code: Option<String>,
    axis: Option<u8>,
    name: Option<String>,
    tick: Option<u64>,
    /// The name of the refusal or the alarm, with its values.
    reason: Option<Value>,
}

impl Exit {
    /// 1: the robot, or the machine, could not.
    pub(super) fn could_not(report: Report) -> Self {
        Self::new(1, Some(report))
    }

    /// 2: wrongly asked.
    pub(super) fn wrong(report: Report) -> Self {
        Self::new(2, Some(report))
    }

    /// As the error itself says.
    pub(super) fn with_code(code: u8, error: impl Diagnostic + Send + Sync + 'static) -> Self {
        Self::new(code, Some(Report::new(error)))
    }

    /// Everything has been said already.
    pub(super) fn silent(code: u8) -> Self {
        Self::new(code, None)
    }

    /// A failure in a set that is known: its axes are told with their names.
    pub(super) fn told(failure: Failure, knowledge: &Knowledge) -> Self {
        let facts = Facts::of(&failure, Some(knowledge));
        let told = Told { message: failure.told(knowledge), failure };
        Self { facts, ..Self::with_code(told.failure.exit_code(), told) }
    }

    /// A program that has failed in a set that is known.
    pub(super) fn of_program(error: ScriptError, knowledge: &Knowledge) -> Self {
        let facts = match &error {
            ScriptError::Robot { failure, .. } => Facts::of(failure, Some(knowledge)),
            _ => Facts::default(),
        };
        Self { facts, ..Self::with_code(error.exit_code(), error) }
    }

    fn new(code: u8, report: Option<Report>) -> Self {
        Self { code, report, facts: Facts::default() }
    }

    /// Tells people, or programs, and gives the code.
    pub(super) fn report(self, as_json: bool) -> ExitCode {
        if let Some(report) = &self.report {
            if as_json {
                say(&self.json(report).to_string());
            } else {
                say(&drawn(report));
            }
        }
        ExitCode::from(self.code)
    }

    fn json(&self, report: &Report) -> Value {
        let Facts { code, axis, name, tick, reason } = &self.facts;
        error_object(
            code.as_deref().unwrap_or(code_name(self.code)),
            self.code,
            json!({ "axis": axis, "name": name, "tick": tick, "reason": reason }),
            &in_words(report),
            report.help().map(|help| help.to_string()).as_deref(),
        )
    }
}

impl Facts {
    fn of(failure: &Failure, knowledge: Option<&Knowledge>) -> Self {
        let axis = failure.axis();
        let reason = match failure {
            Failure::Refused { refusal, .. } | Failure::DigitalRefused { refusal, .. } => {
                serde_json::to_value(refusal).ok()
            }
            Failure::Alarm { alarm, .. } => serde_json::to_value(alarm).ok(),
            _ => None,
        };
        Self {
            code: Some(failure.kind()),
            axis: axis.map(supersigma_protocol::AxisNumber::get),
            name: axis.zip(knowledge).and_then(|(axis, known)| Some(known.config.axis(axis)?.name.clone())),
            tick: failure.at().map(|tick| tick.0),
            reason,
        }
    }
}

/// A failure with the names of its axes.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct Told {
    message: String,
    failure: Failure,
}

impl Diagnostic for Told {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.failure.help()
    }
}

/// What the command line itself is wrong about, or the help that was asked for.
pub(super) fn usage(error: &clap::Error) -> ExitCode {
    let wrong = error.use_stderr();
    if wrong && std::env::args_os().any(|argument| argument == "--json") {
        let text = error.to_string();
        let mut parts = text.trim().split("\n\n");
        let message = parts.next().unwrap_or_default().trim_start_matches("error: ");
        let help = parts.collect::<Vec<_>>().join(" ");
        say(&error_object("usage", 2, json!({}), &one_line(message), Some(&one_line(&help))).to_string());
    } else {
        // If nobody reads it, there is nobody else to tell.
        let _ = error.print();
    }
    ExitCode::from(if wrong { 2 } else { 0 })
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn error_object(code: &str, exit: u8, facts: Value, message: &str, help: Option<&str>) -> Value {
    let mut error = json!({
        "code": code, "exit": exit, "axis": null, "name": null, "tick": null, "reason": null,
        "message": message, "help": help,
    });
    if let (Value::Object(error), Value::Object(facts)) = (&mut error, facts) {
        error.extend(facts);
    }
    json!({ "error": error })
}

fn code_name(code: u8) -> &'static str {
    match code {
        2 => "wrongly_asked",
        3 => "nobody_there",
        _ => "could_not",
    }
}

/// Says a line, or several, on standard error. If nobody reads them, there is nobody else to tell.
pub(super) fn say(text: &str) {
    let text = if journal::is_connected() { journal::error(text) } else { text.to_owned() };
    let _ = writeln!(io::stderr(), "{text}");
}

/// What stands behind the message without being in it.
fn causes(report: &Report) -> impl Iterator<Item = String> {
    let message = report.to_string();
    report.chain().skip(1).map(ToString::to_string).filter(move |cause| !message.contains(cause.as_str()))
}

/// The report without a drawing: the message, what stands behind it, and everything else that is wrong at once.
fn in_words(report: &Report) -> String {
    let mut words = report.to_string();
    for cause in causes(report) {
        let _ = write!(words, ": {cause}");
    }
    for other in report.related().into_iter().flatten() {
        let _ = write!(words, "; {other}");
        if let Some(help) = other.help() {
            let _ = write!(words, " ({help})");
        }
    }
    words
}

/// The report as it is drawn: in colours on a terminal that has them, within its width; for the journal, as plain text.
fn drawn(report: &Report) -> String {
    struct Drawing<'a>(Box<dyn ReportHandler>, &'a dyn Diagnostic);
    impl fmt::Display for Drawing<'_> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            self.0.debug(self.1, f)
        }
    }
    if journal::is_connected() {
        let help = report.help().map(|help| format!("\nhelp: {help}")).unwrap_or_default();
        return format!("{}{help}", in_words(report));
    }
    let mut how = MietteHandlerOpts::new();
    if let Some(columns) = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok()) {
        how = how.width(columns);
    }
    // What the message says already is not said twice.
    if causes(report).next().is_none() {
        how = how.without_cause_chain();
    }
    Drawing(Box::new(how.build()), report.as_ref()).to_string()
}

impl From<Failure> for Exit {
    fn from(failure: Failure) -> Self {
        let facts = Facts::of(&failure, None);
        Self { facts, ..Self::with_code(failure.exit_code(), failure) }
    }
}

impl From<io::Error> for Exit {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe {
            // Whoever read the output does not want more of it, which is no failure.
            return Self::silent(0);
        }
        Self::new(1, Err::<(), _>(error).into_diagnostic().err())
    }
}
