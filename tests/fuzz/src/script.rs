//! The text of a robot program: checked, then run on a dry set.

use std::sync::{Arc, Mutex};

use ccu::dry::{DrySet, NoPulses};
use ccu::executive::{Executive, Movement};
use ccu::script::{Limits, ScriptError, Watcher, check, is_open};
use miette::NarratableReportHandler;

use crate::knowledge;

/// So many operations of the language.
const OPERATIONS: u64 = 3_000;

/// Checks `text` and runs it, whatever the check has found. It always ends, if need be at the limit of its operations.
pub fn script(text: &str) {
    let _ = is_open(text);
    let knowledge = knowledge();
    let (problems, program) = check("garbage.rhai", text, &knowledge);
    for problem in &problems {
        lies_in(text, problem);
    }
    let Some(program) = program else {
        assert!(!problems.is_empty(), "no program, and nobody says why");
        return;
    };
    let set = DrySet::new(Arc::clone(&knowledge), NoPulses, None).expect("a good set");
    let operator = Arc::new(Mutex::new(Executive::new(set)));
    let limits = Limits { operations: Some(OPERATIONS), ..Limits::default() };
    if let Err(error) = program.run(operator, knowledge, Accounts, &limits) {
        lies_in(text, &error);
    }
}

/// The place of an error is one of the text, or right behind it; it can be drawn.
fn lies_in(text: &str, error: &ScriptError) {
    if let Some(line) = error.place().line() {
        // The language counts a line more if the last one ends.
        assert!((1..=text.split('\n').count() + 1).contains(&line), "{error}: line {line}");
    }
    let mut drawn = String::new();
    NarratableReportHandler::new().render_report(&mut drawn, error).expect("drawing into a string");
}

/// Holds every movement that is complete against what was asked.
struct Accounts;

impl Watcher for Accounts {
    fn movement(&mut self, movement: &Movement) {
        if let Some(asked) = movement.asked {
            assert_eq!(u64::from(movement.done.0), asked.0.unsigned_abs(), "{movement:?}");
        }
    }

    fn print(&mut self, _: &str) {}
}
