//! The rehearsal: a program on a dry set, silently and for a short while. What only a real set can answer, its state and
//! its inputs, it leaves to the real run.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::Duration;

use super::exit::Exit;
use super::run::dry_error;
use crate::dry::{DrySet, NoPulses};
use crate::executive::{Executive, Knowledge, Movement, Operate, Request};
use crate::script::{Limits, Program, ScriptError, Watcher};

/// How long a rehearsal may take, in real time, and how many operations of the language.
const REHEARSAL: Duration = Duration::from_secs(2);
const REHEARSED_OPERATIONS: u64 = 5_000_000;

/// Runs the program on a dry set just switched on, or one whose axes have been originated; what it fails with, if it does
/// so within the bounds.
pub(super) fn rehearse(
    program: &Program,
    knowledge: &Arc<Knowledge>,
    originated: bool,
) -> Result<Option<ScriptError>, Exit> {
    let set = DrySet::new(Arc::clone(knowledge), NoPulses, None).map_err(|error| dry_error(&error))?;
    let limits = Limits { operations: Some(REHEARSED_OPERATIONS), stop: Arc::new(AtomicBool::new(false)) };
    let (over, wait) = mpsc::channel::<()>();
    let stop = Arc::clone(&limits.stop);
    let timer = thread::spawn(move || {
        if wait.recv_timeout(REHEARSAL).is_err() {
            stop.store(true, Ordering::Release);
        }
    });
    let mut executive = Executive::new(set);
    if originated {
        executive.operate(Request::Originate { axes: vec![] })?;
    }
    let operator = Arc::new(Mutex::new(executive));
    let result = program.run(operator, Arc::clone(knowledge), Silence, &limits);
    let _ = over.send(());
    let _ = timer.join();
    // Inputs may come in the real run, a throw may depend on them, and the bounds are the rehearsal's own.
    Ok(result.err().filter(|error| {
        matches!(error, ScriptError::Syntax { .. } | ScriptError::Script { .. } | ScriptError::Robot { .. })
    }))
}

/// Nobody listens to a rehearsal.
struct Silence;

impl Watcher for Silence {
    fn movement(&mut self, _: &Movement) {}
    fn print(&mut self, _: &str) {}
}
