//! Robot programs: Rhai scripts over whatever carries out requests, a live set or a dry run. This room compiles them,
//! keeps them within bounds, and says what is wrong with them and where. It moves nothing itself: every function of a
//! script becomes a [`Request`](crate::executive::Request), and machine time passes only in there.

mod arguments;
mod begun;
mod check;
mod error;
mod functions;
mod language;
mod parameters;
mod robot;
mod session;
#[cfg(test)]
mod tests;
mod trouble;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use miette::NamedSource;
use rhai::{AST, Dynamic, Engine, EvalAltResult};

use crate::executive::{Knowledge, Movement, Operate};

pub use check::check;
pub use error::{Place, ScriptError};
pub use parameters::Settings;
pub use session::{Entered, Session, is_open};

use robot::Robot;

/// A compiled robot program, with its text. It can be run any number of times, on any set.
#[derive(Debug, Clone)]
pub struct Program {
    source: NamedSource<Arc<str>>,
    ast: AST,
    settings: Arc<Settings>,
}

/// Who is told what a program does, while it does it.
pub trait Watcher: Send {
    /// A movement is complete.
    fn movement(&mut self, movement: &Movement);

    /// The program prints.
    fn print(&mut self, text: &str);
}

/// What ends a program that does not end by itself.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// So many operations of the language (statements, expressions, calls) and no more; `None` is no limit, as for a
    /// robot that works until somebody stops it.
    pub operations: Option<u64>,
    /// Whoever sets it ends the program, even in an endless loop; the movement under way is its operator's business.
    pub stop: Arc<AtomicBool>,
}

impl Program {
    /// Compiles a program; `name` is what errors call its text.
    ///
    /// # Errors
    /// [`ScriptError::Syntax`] if it is no program, or uses a variable that it does not declare.
    pub fn compile(name: &str, source: &str) -> Result<Self, ScriptError> {
        let text = NamedSource::new(name, Arc::from(source));
        match language::engine().compile(source) {
            Ok(ast) => Ok(Self { source: text, ast, settings: Arc::default() }),
            Err(error) => Err(ScriptError::syntax(&error, &text)),
        }
    }

    /// The same program with its parameters set so.
    ///
    /// # Errors
    /// [`ScriptError::Script`] if it has no such parameter, or a parameter whose name is not written out.
    pub fn with(self, settings: Settings) -> Result<Self, ScriptError> {
        let declared = parameters::declared(&self.ast, &self.source)?;
        match settings.keys().find(|name| !declared.contains(name)) {
            Some(name) => Err(parameters::unknown(name, &declared, &self.source)),
            None => Ok(Self { settings: Arc::new(settings), ..self }),
        }
    }

    /// What its text is called.
    #[must_use]
    pub fn name(&self) -> &str {
        self.source.name()
    }

    /// Runs it from the first line to the last. `knowledge` is about the set that `operator` works on; the operator is
    /// held only while it carries out a request.
    ///
    /// # Errors
    /// Why the program ended before its last line, and where.
    pub fn run(
        &self,
        operator: Arc<Mutex<impl Operate + Send + 'static>>,
        knowledge: Arc<Knowledge>,
        watcher: impl Watcher + 'static,
        limits: &Limits,
    ) -> Result<(), ScriptError> {
        let watcher: Arc<Mutex<dyn Watcher>> = Arc::new(Mutex::new(watcher));
        let mut engine = language::engine();
        engine.set_max_operations(limits.operations.unwrap_or(0));
        let stop = Arc::clone(&limits.stop);
        engine.on_progress(move |_| stop.load(Ordering::Relaxed).then_some(Dynamic::UNIT));
        print_to(&mut engine, &watcher, self.name());
        let (stop, settings) = (Arc::clone(&limits.stop), Arc::clone(&self.settings));
        let robot = Arc::new(Mutex::new(Robot::new(operator, knowledge, watcher, stop, settings)));
        functions::register(&mut engine, &robot);
        let result = match engine.run_ast(&self.ast).map_err(|error| *error) {
            Ok(()) | Err(EvalAltResult::Exit(..)) => lock(&robot).finish().map_err(|error| *error),
            Err(error) => Err(error),
        };
        result.map_err(|error| {
            lock(&robot).abandon();
            ScriptError::at_run_time(error, &self.source, &self.ast)
        })
    }
}

/// Has what a text prints go to a watcher.
fn print_to(engine: &mut Engine, watcher: &Arc<Mutex<dyn Watcher>>, name: &str) {
    let printed = Arc::clone(watcher);
    engine.on_print(move |text| lock(&printed).print(text));
    let (debugged, name) = (Arc::clone(watcher), name.to_owned());
    engine.on_debug(move |text, _, position| {
        let line = position.line().unwrap_or(0);
        lock(&debugged).print(&format!("{name}:{line}: {text}"));
    });
}

/// The value, even if somebody panicked with it: a robot that moves has to be stopped all the same.
fn lock<T: ?Sized>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
