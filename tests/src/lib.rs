//! What the end-to-end tests share: a cell to put a set in, real processes of the real `ccu`, and a look at what people
//! see. The tests themselves are in `tests/e2e`; cargo builds them with the package that owns the binary, so that they
//! never start a stale one.
//!
//! A [`Cell`] is a set's whole world: runtime folder, home, logs, all in one temporary folder. Tests run side by side and
//! do not meet. Nothing in here waits for a time; it waits for events, with limits that only a broken set exceeds.
//!
//! Everything panics with what was seen: this is the half of the tests that is not written twice. Which processes there
//! are is read from `/proc`, so the tests need Linux.
#![expect(clippy::missing_panics_doc, reason = "a test's tools fail by panicking, all of them")]

mod account;
mod browser;
mod cell;
mod config;
pub mod http;
mod process;
mod program;
mod ran;
mod terminal;
mod vitals;

use std::thread;
use std::time::{Duration, Instant};

pub use account::{Account, log_files};
pub use browser::Browser;
pub use cell::{Cell, Up, counts};
pub use config::{changed, patient};
pub use process::{Process, Running};
pub use program::{Program, Programmer};
pub use ran::Ran;
pub use rustix::process::Signal;
pub use terminal::Terminal;
pub use vitals::{Vitals, machine};

/// What only a broken set exceeds.
pub const LIMIT: Duration = Duration::from_secs(60);

/// Waits until `look` sees something, and gives that. It looks again and again, because what it waits for has nobody who
/// would tell.
pub fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + LIMIT;
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(Instant::now() < deadline, "{what} has not come about within {LIMIT:?}");
        thread::sleep(Duration::from_millis(10));
    }
}
