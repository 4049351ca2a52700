//! `ccu repl`: a conversation with a set, live or dry, in the language of robot programs. On a terminal it has a line editor
//! with history and completion; otherwise it reads lines, so that a conversation can be piped in.

use std::borrow::Cow;
use std::io::{self, BufRead, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use miette::{IntoDiagnostic, Report};
use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::FileHistory;
use rustyline::validate::{ValidationContext, ValidationResult, Validator};
use rustyline::{CompletionType, Context, Editor, Helper};
use supersigma_config::Config;
use tokio::signal::unix::{SignalKind, signal};

use super::asked::Asked;
use super::exit::Exit;
use super::run::{self, Teller, Totals};
use super::{SetArgs, config, set};
use crate::control::Client;
use crate::dry::{DrySet, NoPulses};
use crate::executive::Executive;
use crate::home::{Home, state_folder};
use crate::script::{Entered, Session, is_open};

/// Lines that are remembered from one conversation to the next.
const REMEMBERED: usize = 1_000;

#[derive(Args)]
pub(super) struct ReplArgs {
    #[command(flatten)]
    set: SetArgs,
    /// On a dry set, in virtual time; no set is needed or touched
    #[arg(long)]
    dry_run: bool,
    /// The dry set's configuration; the built-in set if none is named
    #[arg(long, value_name = "FILE", requires = "dry_run")]
    config: Option<PathBuf>,
}

/// What is moving for the conversation is halted by calling it.
type HangUp = Arc<Mutex<Box<dyn Fn() + Send>>>;

pub(super) fn repl(args: &ReplArgs) -> Result<(), Exit> {
    let stop = Arc::new(AtomicBool::new(false));
    let hang_up: HangUp = Arc::new(Mutex::new(Box::new(|| {})));
    let runtime = set::runtime()?;
    {
        let _guard = runtime.enter();
        let mut interrupt = signal(SignalKind::interrupt()).into_diagnostic().map_err(Exit::could_not)?;
        let (flag, hang_up) = (Arc::clone(&stop), Arc::clone(&hang_up));
        runtime.spawn(async move {
            while interrupt.recv().await.is_some() {
                flag.store(true, Ordering::Release);
                hang_up.lock().unwrap_or_else(PoisonError::into_inner)();
            }
        });
    }
    if args.dry_run {
        let knowledge = run::knowledge(config::load(args.config.as_deref())?)?;
        let set =
            DrySet::new(Arc::clone(&knowledge), NoPulses, None).map_err(|error| run::dry_error(&error))?;
        let teller = Teller::new(false, &knowledge);
        let (totals, names) = (teller.totals(), names(&knowledge.config));
        let operator = Arc::new(Mutex::new(Executive::new(set)));
        let session = Session::new(operator, knowledge, teller, &stop);
        return Conversation { session, totals, stop, again: || Ok(()) }.hold("dry", names);
    }
    let home = Home::of(args.set.name.clone())?;
    let asked = Asked::connect(&args.set)?;
    let knowledge = run::knowledge(asked.config)?;
    let teller = Teller::new(false, &knowledge);
    let (totals, names) = (teller.totals(), names(&knowledge.config));
    let operator = Arc::new(Mutex::new(asked.client.of_a_program()));
    let connect = {
        let operator = Arc::clone(&operator);
        move |client: Client| -> Result<(), Exit> {
            let close = client.hang_up()?;
            *operator.lock().unwrap_or_else(PoisonError::into_inner) = client;
            *hang_up.lock().unwrap_or_else(PoisonError::into_inner) = Box::new(close);
            Ok(())
        }
    };
    connect(Client::connect(&home)?.of_a_program())?;
    let session = Session::new(operator, knowledge, teller, &stop);
    let again = || connect(Client::connect(&home)?.of_a_program());
    Conversation { session, totals, stop, again }.hold(&args.set.name.to_string(), names)
}

/// What is said and heard; after an interruption, `again` makes a new way to the set.
struct Conversation<A> {
    session: Session,
    totals: Arc<Mutex<Totals>>,
    stop: Arc<AtomicBool>,
    again: A,
}

impl<A: FnMut() -> Result<(), Exit>> Conversation<A> {
    fn hold(mut self, name: &str, names: Vec<String>) -> Result<(), Exit> {
        let first_code = if io::stdin().is_terminal() {
            self.with_a_person(name, names)?;
            None
        } else {
            self.with_a_pipe()?
        };
        self.session.leave().map_err(|error| Exit::with_code(error.exit_code(), error))?;
        first_code.map_or(Ok(()), |code| Err(Exit::silent(code)))
    }

    /// Reads lines to their end, whatever becomes of them; gives the exit code of the first that went wrong.
    fn with_a_pipe(&mut self) -> Result<Option<u8>, Exit> {
        let (mut text, mut first) = (String::new(), None);
        for line in io::stdin().lock().lines() {
            if !text.is_empty() {
                text.push('\n');
            }
            text.push_str(&line?);
            if !is_open(&text) {
                match self.answer(&std::mem::take(&mut text))? {
                    Answered::Left => return Ok(first),
                    Answered::Well => {}
                    Answered::Wrong(code) => first = first.or(Some(code)),
                }
            }
        }
        // What is still open then is told to be.
        if let Answered::Wrong(code) = self.answer(&text)? {
            first = first.or(Some(code));
        }
        Ok(first)
    }

    fn with_a_person(&mut self, name: &str, names: Vec<String>) -> Result<(), Exit> {
        let cannot = |error: ReadlineError| Exit::could_not(miette::miette!("the terminal fails: {error}"));
        let config = rustyline::Config::builder()
            .max_history_size(REMEMBERED)
            .map_err(cannot)?
            .completion_type(CompletionType::List)
            .history_ignore_space(true)
            .build();
        let mut editor: Editor<Words, FileHistory> = Editor::with_config(config).map_err(cannot)?;
        let history = state_folder()?.map(|folder| folder.join("history"));
        // The first conversation has no history yet.
        let _ = history.as_ref().map(|file| editor.load_history(file));
        println!("Ctrl-C halts what moves, Ctrl-D leaves, Tab completes");
        editor.set_helper(Some(Words { names, words: vec![] }));
        loop {
            if let Some(helper) = editor.helper_mut() {
                helper.words = self.session.words();
            }
            match editor.readline(&format!("{name}> ")) {
                Ok(text) => {
                    let _ = editor.add_history_entry(&text);
                    if let Answered::Left = self.answer(&text)? {
                        break;
                    }
                }
                Err(ReadlineError::Interrupted) => self.session.halt(),
                Err(ReadlineError::Eof) => break,
                Err(error) => return Err(cannot(error)),
            }
        }
        if let Some(Err(error)) = history.map(|file| editor.save_history(&file)) {
            eprintln!("the history could not be kept: {error}");
        }
        Ok(())
    }

    /// Carries out a text, and says what came of it.
    fn answer(&mut self, text: &str) -> Result<Answered, Exit> {
        self.recover()?;
        if text.trim().is_empty() {
            return Ok(Answered::Well);
        }
        let before = self.movements();
        let answered = match self.session.enter(text) {
            Ok(Entered::Left) => Answered::Left,
            Ok(Entered::Nothing) => Answered::Well,
            // Its movements have been told already, a line each.
            Ok(Entered::Value(_)) if self.movements() > before => Answered::Well,
            Ok(Entered::Value(value)) => {
                writeln!(io::stdout(), "{value}")?;
                Answered::Well
            }
            Err(error) if error.exit_code() == 3 => {
                return Err(Exit::with_code(error.exit_code(), error));
            }
            Err(error) => {
                let code = error.exit_code();
                // If nobody reads it, there is nobody else to tell.
                let _ = writeln!(io::stderr(), "{:?}", Report::new(error));
                Answered::Wrong(code)
            }
        };
        self.recover()?;
        Ok(answered)
    }

    /// After an interruption the old way to the set is closed.
    fn recover(&mut self) -> Result<(), Exit> {
        if self.stop.swap(false, Ordering::AcqRel) {
            self.session.halt();
            (self.again)()?;
        }
        Ok(())
    }

    fn movements(&self) -> u64 {
        self.totals.lock().unwrap_or_else(PoisonError::into_inner).movements
    }
}

/// What became of a text.
enum Answered {
    Well,
    Wrong(u8),
    Left,
}

/// What can be named in quotes.
fn names(config: &Config) -> Vec<String> {
    let axes = config.axes.iter().map(|axis| axis.name.clone());
    let inputs = config.digital.inputs.iter().map(|line| line.name.clone());
    let outputs = config.digital.outputs.iter().map(|line| line.name.clone());
    axes.chain(inputs).chain(outputs).collect()
}

/// What Tab completes, and when a text is at its end.
struct Words {
    names: Vec<String>,
    words: Vec<String>,
}

impl Words {
    /// Where the word before the cursor begins, and everything that it could become.
    fn continuations(&self, line: &str, cursor: usize) -> (usize, Vec<String>) {
        let before = &line[..cursor];
        let is_part = |letter: char| letter.is_alphanumeric() || letter == '_';
        let start = before.trim_end_matches(is_part).len();
        let known = if before[..start].ends_with('"') { &self.names } else { &self.words };
        let word = &before[start..];
        (start, known.iter().filter(|known| known.starts_with(word)).cloned().collect())
    }
}

impl Completer for Words {
    type Candidate = String;
    fn complete(
        &self,
        line: &str,
        cursor: usize,
        _: &Context<'_>,
    ) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(self.continuations(line, cursor))
    }
}

impl Validator for Words {
    fn validate(&self, context: &mut ValidationContext) -> rustyline::Result<ValidationResult> {
        Ok(if is_open(context.input()) {
            ValidationResult::Incomplete
        } else {
            ValidationResult::Valid(None)
        })
    }
}

impl Hinter for Words {
    type Hint = String;
}

impl Highlighter for Words {
    fn highlight_prompt<'b, 's: 'b, 'p: 'b>(&'s self, prompt: &'p str, _: bool) -> Cow<'b, str> {
        Cow::Borrowed(prompt)
    }
}

impl Helper for Words {}

#[cfg(test)]
mod tests {
    use super::Words;

    #[test]
    fn names_are_completed_in_quotes_and_words_elsewhere() {
        let words = Words {
            names: vec!["left_x".into(), "left_y".into(), "wrist".into()],
            words: vec!["move_by".into(), "laps".into()],
        };
        let complete = |line: &str| words.continuations(line, line.len());
        assert_eq!(complete("mo"), (0, vec!["move_by".to_owned()]));
        assert_eq!(complete("move_by(\"le"), (9, vec!["left_x".to_owned(), "left_y".to_owned()]));
        assert_eq!(complete("move_by(\"wrist\", la"), (17, vec!["laps".to_owned()]));
        assert_eq!(complete("zz"), (0, vec![]));
    }
}
