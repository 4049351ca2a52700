//! The rehearsal: a program on a dry set, silently and for a short while. What only a real set can answer, its state and
//! its inputs, it leaves to the real run.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::Duration;

use super::exit::Exit;
use super::progress::Expected;
use super::run::dry_error;
use crate::dry::{DrySet, NoPulses};
use crate::executive::{Executive, Knowledge, Movement, Operate, Request};
use crate::script::{Limits, Program, ScriptError, Watcher};

/// How long a rehearsal may take, in real time, and how many operations of the language.
const REHEARSAL: Duration = Duration::from_secs(2);
const REHEARSED_OPERATIONS: u64 = 5_000_000;

/// What a rehearsal has shown.
pub(super) struct Rehearsal {
    /// What the program fails with, if it does so within the bounds.
    pub(super) failure: Option<ScriptError>,
    /// What it does, if it ends within them.
    pub(super) expected: Option<Expected>,
}

/// Runs the program on a dry set just switched on, or one whose axes have been originated.
pub(super) fn rehearse(
    program: &Program,
    knowledge: &Arc<Knowledge>,
    originated: bool,
) -> Result<Rehearsal, Exit> {
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
    let count = Count::default();
    let movements = Arc::clone(&count.0);
    let result = program.run(Arc::clone(&operator), Arc::clone(knowledge), count, &limits);
    let _ = over.send(());
    let _ = timer.join();
    let set = Arc::into_inner(operator)
        .map(|executive| executive.into_inner().unwrap_or_else(PoisonError::into_inner));
    let expected = set.filter(|_| result.is_ok()).map(|executive| Expected {
        movements: movements.load(Ordering::Relaxed),
        time: executive.into_link().elapsed(),
    });
    // Inputs may come in the real run, a throw may depend on them, and the bounds are the rehearsal's own.
    let failure = result.err().filter(|error| {
        matches!(error, ScriptError::Syntax { .. } | ScriptError::Script { .. } | ScriptError::Robot { .. })
    });
    Ok(Rehearsal { failure, expected })
}

/// Of a rehearsal only the number of movements is told.
#[derive(Default)]
struct Count(Arc<AtomicU64>);

impl Watcher for Count {
    fn movement(&mut self, _: &Movement) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
    fn print(&mut self, _: &str) {}
}
