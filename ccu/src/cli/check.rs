//! `ccu check`: everything that is wrong with a program, as far as that can be known without a set.

use std::io::{self, Write};
use std::path::PathBuf;

use clap::Args;
use miette::{Diagnostic, Report};

use super::exit::Exit;
use super::rehearsal::rehearse;
use super::run::{self, ParameterArgs};
use super::{config, show};
use crate::script::{self, ScriptError};

#[derive(Args)]
pub(super) struct CheckArgs {
    /// The program, a Rhai script; `-` is standard input
    #[arg(required_unless_present = "text")]
    script: Option<PathBuf>,
    /// The program's text
    #[arg(short = 'e', value_name = "TEXT", conflicts_with = "script")]
    text: Option<String>,
    /// The configuration of the set that it is for; the built-in set if none is named
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    parameters: ParameterArgs,
    /// It is for a set whose axes have been originated already
    #[arg(long)]
    originated: bool,
    /// One JSON object a problem
    #[arg(long)]
    json: bool,
}

pub(super) fn check(args: &CheckArgs) -> Result<(), Exit> {
    let (name, text) = run::source(args.text.as_deref(), args.script.as_deref())?;
    let knowledge = run::knowledge(config::load(args.config.as_deref())?)?;
    let (mut problems, program) = script::check(&name, &text, &knowledge);
    if let Some(program) = program {
        match program.with(args.parameters.settings()) {
            Ok(program) => {
                let failed = rehearse(&program, &knowledge, args.originated)?.failure;
                // On its way the rehearsal comes to the first of the places that have been found by reading.
                let line = |problem: &ScriptError| problem.place().line();
                let known = failed.as_ref().is_some_and(|failed| {
                    problems.iter().any(|one| line(one) == line(failed) && one.message() == failed.message())
                });
                let is_calls = |failed: &ScriptError| problems.iter().any(|one| line(one) == line(failed));
                problems.extend(failed.filter(|failed| !known && !is_calls(failed)));
            }
            Err(problem) => problems.push(problem),
        }
    }
    problems.sort_by_key(|problem| (problem.place().line(), problem.place().column()));
    tell(&name, problems, args.json)
}

fn tell(name: &str, problems: Vec<ScriptError>, json: bool) -> Result<(), Exit> {
    let count = problems.len();
    for problem in problems {
        if json {
            let place = problem.place();
            let object = serde_json::json!({
                "file": place.file(),
                "line": place.line(),
                "column": place.column(),
                "kind": problem.kind(),
                "message": problem.message(),
                "help": problem.help().map(|help| help.to_string()),
            });
            show::print_json(&object, &mut io::stdout().lock())?;
        } else {
            // If nobody reads it, there is nobody else to tell.
            let _ = writeln!(io::stderr(), "{:?}", Report::new(problem));
        }
    }
    match count {
        0 if json => Ok(()),
        0 => Ok(writeln!(io::stdout(), "{name}: nothing is wrong")?),
        _ if json => Err(Exit::silent(2)),
        _ => {
            let problems = if count == 1 { "1 problem".into() } else { format!("{count} problems") };
            let _ = writeln!(io::stderr(), "{name}: {problems}");
            Err(Exit::silent(2))
        }
    }
}
