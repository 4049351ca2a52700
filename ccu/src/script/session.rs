//! A conversation in the language of robot programs: one text after the other, with the variables and functions of those
//! before it. Who types it, and where, is not decided here.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use miette::NamedSource;
use rhai::{AST, Dynamic, Engine, EvalAltResult, Position, Scope};

use crate::executive::{Knowledge, Operate};

use super::functions::{self, SIGNATURES};
use super::robot::Robot;
use super::{ScriptError, Settings, Watcher, language, lock, print_to};

/// Words of the language that begin something.
const WORDS: [&str; 16] = [
    "let", "const", "fn", "if", "else", "while", "loop", "for", "in", "switch", "try", "catch", "throw",
    "return", "print", "debug",
];

/// What came of a text that was entered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entered {
    /// Its value, in words.
    Value(String),
    /// It has no value.
    Nothing,
    /// It was `exit()`.
    Left,
}

/// A conversation.
pub struct Session {
    engine: Engine,
    scope: Scope<'static>,
    /// The functions that have been defined.
    functions: AST,
    robot: Arc<Mutex<Robot>>,
    /// Raised by `exit()`.
    left: Arc<AtomicBool>,
    /// All that has been entered; a place in it is what an error points at.
    text: String,
    name: &'static str,
}

impl Session {
    /// A conversation that has not begun. Whoever sets `stop` ends the text that is being carried out.
    pub fn new(
        operator: Arc<Mutex<impl Operate + Send + 'static>>,
        knowledge: Arc<Knowledge>,
        watcher: impl Watcher + 'static,
        stop: &Arc<AtomicBool>,
    ) -> Self {
        let name = "repl";
        let watcher: Arc<Mutex<dyn Watcher>> = Arc::new(Mutex::new(watcher));
        let mut engine = language::engine();
        let asked = Arc::clone(stop);
        engine.on_progress(move |_| asked.load(Ordering::Relaxed).then_some(Dynamic::UNIT));
        print_to(&mut engine, &watcher, name);
        let settings = Arc::new(Settings::new());
        let robot = Robot::new(operator, knowledge, watcher, Arc::clone(stop), settings);
        let robot = Arc::new(Mutex::new(robot));
        functions::register(&mut engine, &robot);
        let left = Arc::new(AtomicBool::new(false));
        let leaves = Arc::clone(&left);
        // The engine takes an exit for a value.
        engine.register_fn("exit", move || -> Result<(), Box<EvalAltResult>> {
            leaves.store(true, Ordering::Relaxed);
            Err(EvalAltResult::Exit(Dynamic::UNIT, Position::NONE).into())
        });
        Self { left, engine, scope: Scope::new(), functions: AST::empty(), robot, text: String::new(), name }
    }

    /// Carries out a text. What it has begun goes on when it is over.
    ///
    /// # Errors
    /// What is wrong with it, or why it ended early; then whatever was begun is halted.
    pub fn enter(&mut self, text: &str) -> Result<Entered, ScriptError> {
        // Behind what was entered before, so that every place in a definition stays what it was.
        let lines = self.text.matches('\n').count();
        self.text.push_str(text);
        self.text.push('\n');
        let source = NamedSource::new(self.name, Arc::from(self.text.as_str()));
        let behind = format!("{}{text}", "\n".repeat(lines));
        let compiled = self.engine.compile_with_scope(&self.scope, behind);
        let entered = compiled.map_err(|error| ScriptError::syntax(&error, &source))?;
        let ast = self.functions.merge(&entered);
        let variables = self.scope.len();
        match self.engine.eval_ast_with_scope::<Dynamic>(&mut self.scope, &ast) {
            Ok(_) if self.left.swap(false, Ordering::Relaxed) => Ok(Entered::Left),
            Ok(value) => {
                self.functions = ast.clone_functions_only();
                Ok(if value.is_unit() { Entered::Nothing } else { Entered::Value(shown(&value)) })
            }
            Err(error) => {
                // A text that fails in its middle leaves no half of its variables.
                self.scope.rewind(variables);
                lock(&self.robot).abandon();
                Err(ScriptError::at_run_time(*error, &source, &ast))
            }
        }
    }

    /// Halts what was begun.
    pub fn halt(&mut self) {
        lock(&self.robot).abandon();
    }

    /// The conversation is over: what was begun is waited for.
    ///
    /// # Errors
    /// What became of it, if it did not go well.
    pub fn leave(&mut self) -> Result<(), ScriptError> {
        let result = lock(&self.robot).finish().map_err(|error| *error);
        result.map_err(|error| {
            lock(&self.robot).abandon();
            let source = NamedSource::new(self.name, Arc::from(self.text.as_str()));
            ScriptError::at_run_time(error, &source, &self.functions)
        })
    }

    /// Every word that can be typed: functions, blocks, words of the language, and the variables that exist.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let own = self.functions.iter_functions().map(|function| function.name.to_owned());
        let variables = self.scope.iter_raw().map(|(name, _, _)| name.to_owned());
        let fixed = SIGNATURES.iter().map(|(name, _)| *name).chain(language::BLOCKS).chain(WORDS);
        let mut words: Vec<String> = fixed.map(str::to_owned).chain(own).chain(variables).collect();
        words.sort_unstable();
        words.dedup();
        words
    }
}

/// A value, for people.
fn shown(value: &Dynamic) -> String {
    match value.as_immutable_string_ref() {
        Ok(text) => format!("{:?}", text.as_str()),
        Err(_) => value.to_string(),
    }
}

/// Whether a text ends inside brackets, a string or a comment, so that there is more to come.
#[must_use]
pub fn is_open(text: &str) -> bool {
    let mut letters = text.chars().peekable();
    // Brackets, and strings with a place for an expression that it is in.
    let mut inside: Vec<char> = Vec::new();
    while let Some(letter) = letters.next() {
        if inside.last() == Some(&'`') {
            match letter {
                '`' => drop(inside.pop()),
                '$' if letters.next_if_eq(&'{').is_some() => inside.push('{'),
                _ => {}
            }
            continue;
        }
        match letter {
            '`' | '(' | '[' | '{' => inside.push(letter),
            ')' | ']' | '}' => drop(inside.pop()),
            '"' | '\'' => loop {
                match letters.next() {
                    Some('\\') => drop(letters.next()),
                    Some(end) if end == letter => break,
                    // The text is at its end, or the line: a string that goes on is an error to be told, not awaited.
                    None | Some('\n') => break,
                    Some(_) => {}
                }
            },
            '/' if letters.next_if_eq(&'/').is_some() => {
                let _ = letters.by_ref().find(|letter| *letter == '\n');
            }
            '/' if letters.next_if_eq(&'*').is_some() => {
                let mut last = ' ';
                loop {
                    match letters.next() {
                        Some('/') if last == '*' => break,
                        Some(letter) => last = letter,
                        None => return true,
                    }
                }
            }
            _ => {}
        }
    }
    !inside.is_empty()
}

#[cfg(test)]
mod tests {
    use super::is_open;

    #[test]
    fn a_text_is_open_until_its_last_bracket_closes() {
        for open in
            ["fn f() {", "line(#{ left_x: 1,", "together {\n move_by(1, 2);", "/* a", "`a ${b", "[1, [2]"]
        {
            assert!(is_open(open), "{open}");
        }
        for closed in [
            "",
            "origin()",
            "print(\"{\")",
            "// {",
            "fn f() { '}' }",
            "`a ${[1]} {`",
            "\"open",
            ") too many",
            "/* { */ 1",
            "\"\\\"{\"",
        ] {
            assert!(!is_open(closed), "{closed}");
        }
    }
}
