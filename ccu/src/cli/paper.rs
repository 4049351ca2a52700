//! What describes the command line to others: completions for shells, manual pages. Both are made on demand out of the
//! same definitions as the help, so they cannot disagree with it. Commands that only the daemon types are left out.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::{Args, Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};
use miette::miette;

use super::Cli;
use super::exit::Exit;

#[derive(Args)]
pub(super) struct CompletionsArgs {
    /// For which shell
    shell: Shell,
}

#[derive(Args)]
pub(super) struct ManArgs {
    /// Where all pages go, a file each; without it, the page of `ccu` itself is printed
    dir: Option<PathBuf>,
}

pub(super) fn completions(args: &CompletionsArgs) -> Result<(), Exit> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut visible(), "ccu", &mut script);
    io::stdout().lock().write_all(&script)?;
    Ok(())
}

pub(super) fn man(args: &ManArgs) -> Result<(), Exit> {
    let mut ccu = visible().disable_help_subcommand(true);
    ccu.build();
    let Some(dir) = &args.dir else {
        io::stdout().lock().write_all(&page(&ccu, "ccu")?)?;
        return Ok(());
    };
    let cannot = |path: &Path, error: &io::Error| {
        Exit::could_not(miette!("cannot write the manual pages to {}: {error}", path.display()))
    };
    fs::create_dir_all(dir).map_err(|error| cannot(dir, &error))?;
    let mut pages = vec![];
    collect(&ccu, "ccu", &mut pages)?;
    for (name, text) in &pages {
        let path = dir.join(format!("{name}.1"));
        fs::write(&path, text).map_err(|error| cannot(&path, &error))?;
    }
    writeln!(
        io::stdout().lock(),
        "{} pages in {}; `man -l {}` shows one",
        pages.len(),
        dir.display(),
        dir.join("ccu.1").display()
    )?;
    Ok(())
}

/// The command line without what is not for people.
fn visible() -> Command {
    without_hidden(&Cli::command()).version(env!("CARGO_PKG_VERSION"))
}

/// clap has no way to take something away from a command, so it is made anew from what it shows.
fn without_hidden(command: &Command) -> Command {
    let mut bare = Command::new(command.get_name().to_owned())
        .args(command.get_arguments().filter(|arg| !arg.is_hide_set()).cloned())
        .subcommands(command.get_subcommands().filter(|sub| !sub.is_hide_set()).map(without_hidden))
        .subcommand_required(command.is_subcommand_required_set());
    if let Some(about) = command.get_about() {
        bare = bare.about(about.clone());
    }
    if let Some(after) = command.get_after_help() {
        bare = bare.after_help(after.clone());
    }
    bare
}

/// The pages of a command and of everything below it.
fn collect(command: &Command, name: &str, pages: &mut Vec<(String, Vec<u8>)>) -> io::Result<()> {
    pages.push((name.to_owned(), page(command, name)?));
    for sub in command.get_subcommands() {
        collect(sub, &format!("{name}-{}", sub.get_name()), pages)?;
    }
    Ok(())
}

fn page(command: &Command, name: &str) -> io::Result<Vec<u8>> {
    let man = Man::new(command.clone().display_name(name))
        .title(name.to_uppercase())
        .date("")
        .source(format!("ccu {}", env!("CARGO_PKG_VERSION")))
        .manual("SUPERSIGMA");
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    man.render_options_section(&mut page)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    if let Some(after) = command.get_after_help() {
        more(&after.to_string(), &mut page)?;
    }
    Ok(page)
}

/// What stands under the options in the help: examples line by line, and notes before and behind them.
fn more(after: &str, page: &mut dyn Write) -> io::Result<()> {
    let (before, examples) = after.split_once("Examples:\n").unwrap_or((after, ""));
    let (examples, behind) = examples.split_once("\n\n").unwrap_or((examples, ""));
    let mut roff = Roff::new();
    for notes in [before, behind].map(str::trim).into_iter().filter(|notes| !notes.is_empty()) {
        roff.control("SH", ["NOTES"]);
        for line in notes.lines() {
            roff.text([roman(line)]);
            // Lines are filled anew, but a list of sentences stays a list.
            if line.ends_with('.') {
                roff.control("br", []);
            }
        }
    }
    if !examples.is_empty() {
        roff.control("SH", ["EXAMPLES"]).control("nf", []);
        for line in examples.lines() {
            roff.text([roman(line)]);
        }
        roff.control("fi", []);
    }
    roff.to_writer(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves<'a>(command: &'a Command, name: &str, found: &mut Vec<(String, &'a Command)>) {
        if command.get_subcommands().next().is_none() {
            found.push((name.to_owned(), command));
        }
        for sub in command.get_subcommands() {
            leaves(sub, &format!("{name} {}", sub.get_name()), found);
        }
    }

    #[test]
    fn every_command_for_people_has_examples_that_begin_with_it_and_are_right() {
        let ccu = visible();
        let mut found = vec![];
        leaves(&ccu, "ccu", &mut found);
        assert!(found.len() > 20, "{} commands", found.len());
        for (name, command) in found {
            let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let Some((_, examples)) = after.split_once("Examples:\n") else {
                panic!("`{name} --help` has no examples");
            };
            let examples = examples.split("\n\n").next().unwrap_or_default();
            let mut typed = 0;
            for line in examples.lines() {
                // What is typed, without the explanation behind two spaces; a pipe's second half is ours.
                let line = line.trim().split("  ").next().unwrap_or_default();
                let line =
                    line.rsplit_once("| ccu").map_or(line.to_owned(), |(_, ours)| format!("ccu{ours}"));
                let line = line.split(" > ").next().unwrap_or_default();
                assert!(line.starts_with(&name), "`{line}` is no example of `{name}`");
                let words = shell_words(line);
                let parsed = Cli::command().try_get_matches_from(&words);
                assert!(
                    parsed.is_ok(),
                    "`{line}`: {}",
                    parsed.err().map(|e| e.to_string()).unwrap_or_default()
                );
                typed += 1;
            }
            assert!(typed > 0, "`{name} --help` has no examples");
        }
    }

    /// Words, of which those in single quotes may have spaces.
    fn shell_words(line: &str) -> Vec<String> {
        let mut words = vec![];
        for (place, part) in line.split('\'').enumerate() {
            if place % 2 == 1 {
                words.push(part.to_owned());
            } else {
                words.extend(part.split_whitespace().map(str::to_owned));
            }
        }
        words
    }

    #[test]
    fn what_only_the_daemon_types_is_left_out() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::Elvish, Shell::PowerShell] {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut visible(), "ccu", &mut script);
            let script = String::from_utf8(script).expect("UTF-8");
            for known in ["origin", "completions", "time-scale"] {
                assert!(script.contains(known), "{known} for {shell}");
            }
            for hidden in ["axis-worker", "wall-epoch", "detached"] {
                assert!(!script.contains(&format!("{hidden} ")), "{hidden} for {shell}");
            }
        }
        let mut pages = vec![];
        let mut ccu = visible();
        ccu.build();
        collect(&ccu, "ccu", &mut pages).expect("a page");
        for (name, page) in pages {
            let page = String::from_utf8(page).expect("UTF-8");
            assert!(!page.contains("detached") && !page.contains(r"axis\-worker"), "{name}: {page}");
        }
    }
}
