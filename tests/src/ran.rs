//! A command that has ended: what it said, and how it ended.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use serde_json::Value;

/// What a command has left.
#[derive(Debug)]
pub struct Ran {
    /// The command, as typed.
    pub what: String,
    /// How it ended.
    pub status: ExitStatus,
    /// Its standard output.
    pub stdout: String,
    /// Its standard error.
    pub stderr: String,
}

impl Ran {
    /// Its exit code; `None` if a signal ended it.
    #[must_use]
    pub fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// It has done what it should, without a word on standard error.
    #[must_use = "or call `done`"]
    pub fn good(self) -> Self {
        assert!(self.code() == Some(0) && self.stderr.is_empty(), "should have gone well: {self}");
        self
    }

    /// The same for those whose output does not matter.
    pub fn done(self) {
        let _ = self.good();
    }

    /// It has failed with `code`, and its complaint contains every one of `says`. Line breaks do not count.
    pub fn fails(&self, code: i32, says: &[&str]) {
        assert_eq!(self.code(), Some(code), "should have failed with code {code}: {self}");
        let complaint = self.complaint();
        for say in says {
            assert!(complaint.contains(say), "does not say {say:?}: {self}");
        }
    }

    /// Standard error as running text: without the line breaks and the margin of a report.
    #[must_use]
    pub fn complaint(&self) -> String {
        self.stderr.replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Standard output as JSON, an object a line.
    #[must_use]
    pub fn json(&self) -> Vec<Value> {
        let parse =
            |line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error} in {line:?}: {self}"));
        self.stdout.lines().map(parse).collect()
    }

    /// The signal that has ended it.
    #[must_use]
    pub fn signal(&self) -> Option<i32> {
        self.status.signal()
    }
}

impl fmt::Display for Ran {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, status, stdout, stderr } = self;
        let (stdout, stderr) = (end_of(stdout), end_of(stderr));
        write!(f, "`{what}` ended with {status}\n--- stdout\n{stdout}\n--- stderr\n{stderr}\n---")
    }
}

/// So much of a long text that a failed test can still be read.
fn end_of(text: &str) -> &str {
    let lines = text.rmatch_indices('\n').map(|(at, _)| at + 1).nth(30);
    lines.map_or(text, |start| &text[start..])
}
