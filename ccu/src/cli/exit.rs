//! How a command ends when it does not end well: a report for people on standard error, and an exit code for programs.

use std::io::{self, Write};
use std::process::ExitCode;

use miette::{Diagnostic, IntoDiagnostic, Report};

use crate::executive::Failure;

/// Why the command ends, and with which code.
#[derive(Debug)]
pub(super) struct Exit {
    code: u8,
    report: Option<Report>,
}

impl Exit {
    /// 1: the robot, or the machine, could not.
    pub(super) fn could_not(report: Report) -> Self {
        Self { code: 1, report: Some(report) }
    }

    /// 2: wrongly asked.
    pub(super) fn wrong(report: Report) -> Self {
        Self { code: 2, report: Some(report) }
    }

    /// As the error itself says.
    pub(super) fn with_code(code: u8, error: impl Diagnostic + Send + Sync + 'static) -> Self {
        Self { code, report: Some(Report::new(error)) }
    }

    /// Everything has been said already.
    pub(super) fn silent(code: u8) -> Self {
        Self { code, report: None }
    }

    /// Whoever read the output does not want more of it, which is no failure.
    fn quiet() -> Self {
        Self::silent(0)
    }

    /// Tells people, and gives the code.
    pub(super) fn report(self) -> ExitCode {
        if let Some(report) = self.report {
            // If nobody reads it, there is nobody else to tell.
            let _ = writeln!(io::stderr(), "{report:?}");
        }
        ExitCode::from(self.code)
    }
}

impl From<Failure> for Exit {
    fn from(failure: Failure) -> Self {
        Self::with_code(failure.exit_code(), failure)
    }
}

impl From<io::Error> for Exit {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe {
            return Self::quiet();
        }
        Self { code: 1, report: Err::<(), _>(error).into_diagnostic().err() }
    }
}
