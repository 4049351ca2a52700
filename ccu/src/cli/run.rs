//! `ccu run`: a program on a set that is up, on a set of its own, or in a dry run.
//!
//! Before anything moves, the program is rehearsed: run on a dry set, silently and for a short while. A program that is
//! wrong, on the way that it takes there, is refused with file, line and column. What only the real set can answer, its
//! state and its inputs, the rehearsal leaves to the real run.

use std::fs::{self, File};
use std::io::{self, BufWriter, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::Args;
use miette::{IntoDiagnostic, WrapErr, miette};
use supersigma_protocol::Ticks;

use super::asked::Asked;
use super::exit::Exit;
use super::progress::{Expected, Progress};
use super::rehearsal::{Rehearsal, rehearse};
use super::{SetArgs, StartArgs, set, show, timing};
use crate::control::{Client, DownReport};
use crate::daemon::{Daemon, Options};
use crate::dry::{DryError, DrySet, NoPulses, PulseCsv, PulseWriter};
use crate::executive::{Executive, Failure, Knowledge, Movement};
use crate::home::Home;
use crate::log::{AxisNames, LogError, LogHeader, Timeline, WallTime};
use crate::script::{Limits, Program, Settings, Watcher};

#[derive(Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    set: SetArgs,
    #[command(flatten)]
    start: StartArgs,
    /// The program, a Rhai script; `-` is standard input
    #[arg(required_unless_present = "text")]
    script: Option<PathBuf>,
    /// The program's text
    #[arg(short = 'e', value_name = "TEXT", conflicts_with = "script")]
    text: Option<String>,
    /// On the same machines in virtual time, as fast as it goes; no set is needed or touched
    #[arg(long)]
    dry_run: bool,
    /// Write every pulse of a dry run: tick,axis,position
    #[arg(long, value_name = "FILE", requires = "dry_run")]
    pulses: Option<PathBuf>,
    #[command(flatten)]
    parameters: ParameterArgs,
    /// Draw a dry run, movements and digital lines as bars: .svg or .png
    #[arg(long, value_name = "FILE", requires = "dry_run")]
    plot: Option<PathBuf>,
    /// One JSON object a movement, print or summary
    #[arg(long)]
    json: bool,
}

/// What the parameters of a program are set to.
#[derive(Args)]
pub(super) struct ParameterArgs {
    /// Set a parameter of the program, which it has with `param("NAME", DEFAULT)`
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting)]
    settings: Vec<(String, String)>,
}

impl ParameterArgs {
    /// All of them; of two values for one name the last counts.
    pub(super) fn settings(&self) -> Settings {
        self.settings.iter().cloned().collect()
    }
}

fn setting(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("it is a name and a value, as in laps=3".into()),
    }
}

pub(super) fn run(args: &RunArgs) -> Result<(), Exit> {
    let (name, source) = source(args.text.as_deref(), args.script.as_deref())?;
    let program = Program::compile(&name, &source)
        .and_then(|program| program.with(args.parameters.settings()))
        .map_err(|error| Exit::with_code(error.exit_code(), error))?;
    if args.dry_run {
        return dry_run(args, &program, source);
    }
    let home = Home::of(args.set.name.clone())?;
    match Client::connect(&home) {
        Ok(_) => on_a_set_that_is_up(args, &program),
        Err(Failure::NoSet { .. }) => on_a_set_of_its_own(args, &home, &program, source),
        Err(failure) => Err(failure.into()),
    }
}

/// What a program is called, and its text.
pub(super) fn source(text: Option<&str>, script: Option<&Path>) -> Result<(String, String), Exit> {
    let read = |text: io::Result<String>, name: String| {
        let text = text.into_diagnostic().wrap_err_with(|| format!("cannot read the program {name}"));
        text.map(|text| (name, text)).map_err(Exit::wrong)
    };
    match (text, script) {
        (Some(text), _) => Ok(("-e".into(), text.to_owned())),
        (None, Some(path)) if path.as_os_str() == "-" => {
            let mut text = String::new();
            read(io::stdin().read_to_string(&mut text).map(|_| text), "standard input".into())
        }
        (None, Some(path)) => read(fs::read_to_string(path), path.display().to_string()),
        (None, None) => Err(Exit::wrong(miette!("no program is named"))),
    }
}

fn dry_run(args: &RunArgs, program: &Program, source: String) -> Result<(), Exit> {
    args.plot.as_deref().map_or(Ok(()), timing::check_name)?;
    let config = set::start_config(&args.start)?;
    let header = LogHeader {
        set: args.set.name.to_string(),
        names: AxisNames::from(&config),
        timeline: Timeline { epoch: WallTime::now(), scale: args.start.time_scale },
        config: config.to_toml(),
        script: Some(source),
    };
    let knowledge = knowledge(config)?;
    let log = args.start.log.as_deref().map(|path| (path, header));
    match &args.pulses {
        None => {
            let set =
                DrySet::new(Arc::clone(&knowledge), NoPulses, log).map_err(|error| dry_error(&error))?;
            run_dry(args, program, &knowledge, set).map(|_| ())
        }
        Some(path) => {
            let cannot =
                |error: io::Error| Exit::could_not(miette!("cannot write {}: {error}", path.display()));
            let file = File::create(path).map_err(cannot)?;
            let pulses = PulseCsv::new(BufWriter::new(file)).map_err(cannot)?;
            let set = DrySet::new(Arc::clone(&knowledge), pulses, log).map_err(|error| dry_error(&error))?;
            run_dry(args, program, &knowledge, set)?.finish().map_err(cannot)
        }
    }
}

fn run_dry<P: PulseWriter + Send + 'static>(
    args: &RunArgs,
    program: &Program,
    knowledge: &Arc<Knowledge>,
    set: DrySet<P>,
) -> Result<P, Exit> {
    let operator = Arc::new(Mutex::new(Executive::new(set)));
    let teller = Teller::new(args.json, knowledge);
    let totals = teller.totals();
    let result = program.run(Arc::clone(&operator), Arc::clone(knowledge), teller, &Limits::default());
    let executive =
        Arc::into_inner(operator).ok_or_else(|| Exit::could_not(miette!("the dry set is still held")))?;
    let set = executive.into_inner().unwrap_or_else(PoisonError::into_inner).into_link();
    let timing = set.timing();
    let elapsed = set.elapsed();
    let log = args.start.log.as_ref();
    let (pulses, summary) = set.finish().map_err(|error| dry_error(&error))?;
    // How far a program came that failed is worth seeing, too.
    timing::tell(&timing, &knowledge.config, args.json)?;
    if let Some(path) = &args.plot {
        timing::draw(&timing, &knowledge.config, program.name(), path)?;
    }
    result.map_err(|error| Exit::of_program(error, knowledge))?;
    let log = log.zip(summary).map(|(path, summary)| DownReport {
        log: path.clone(),
        sent: summary.frames,
        logged: Some(summary.frames),
        lost: Some(summary.lost),
        bytes: Some(summary.bytes),
        parts: summary.parts,
    });
    tell_summary(args.json, &totals, elapsed, log.as_ref())?;
    Ok(pulses)
}

fn on_a_set_that_is_up(args: &RunArgs, program: &Program) -> Result<(), Exit> {
    let start = &args.start;
    if start.config.is_some()
        || start.log.is_some()
        || start.log_rotate.is_some()
        || start.foxglove.is_some()
        || start.time_scale != axis_worker::clock::TimeScale::REAL
    {
        let name = &args.set.name;
        return Err(Exit::wrong(miette!(
            help = format!("leave these options out, or take the set down first: `ccu down --name {name}`"),
            "set {name} is up already; --config, --log, --log-rotate, --foxglove and --time-scale are for a set that is \
             started"
        )));
    }
    let asked = Asked::connect(&args.set)?;
    let scale = asked.description.time_scale;
    let knowledge = Arc::clone(&asked.knowledge);
    let failed = |error| Exit::of_program(error, &knowledge);
    // The state of the set is not known here, so only what is wrong with the program itself counts.
    let Rehearsal { failure, expected } = rehearse(program, &knowledge, false)?;
    failure.filter(|error| !error.is_robots_fault()).map_or(Ok(()), Err).map_err(failed)?;
    let stop = Arc::new(AtomicBool::new(false));
    let hang_up = asked.client.hang_up()?;
    let runtime = set::runtime()?;
    let _guard = runtime.enter();
    let asked_to_end = set::asked_to_end()?;
    let flag = Arc::clone(&stop);
    runtime.spawn(async move {
        asked_to_end.await;
        flag.store(true, Ordering::Release);
        hang_up();
    });
    let teller = Teller::new(args.json, &knowledge).with_progress(expected, scale);
    let (totals, progress, began) = (teller.totals(), teller.progress(), Instant::now());
    let client = Arc::new(Mutex::new(asked.client.of_a_program()));
    let limits = Limits { operations: None, stop };
    let result = program.run(client, Arc::clone(&knowledge), teller, &limits);
    progress.end();
    result.map_err(failed)?;
    tell_summary(args.json, &totals, machine_time(began, scale), None)
}

fn on_a_set_of_its_own(args: &RunArgs, home: &Home, program: &Program, source: String) -> Result<(), Exit> {
    let config = set::start_config(&args.start)?;
    let knowledge = knowledge(config.clone())?;
    // The set will be just switched on, as the rehearsed one: what the robot refuses there, it will refuse here.
    let known = Arc::clone(&knowledge);
    let failed = |error| Exit::of_program(error, &known);
    let Rehearsal { failure, expected } = rehearse(program, &knowledge, false)?;
    failure.map_or(Ok(()), Err).map_err(failed)?;
    let log = set::log_path(args.start.log.as_ref(), &args.set.name)?;
    let scale = args.start.time_scale;
    let foxglove = args.start.foxglove;
    let options = Options { home: home.clone(), config, scale, log, script: Some(source), foxglove };
    let stop = Arc::new(AtomicBool::new(false));
    set::runtime()?.block_on(async {
        let asked_to_end = set::asked_to_end()?;
        let began_to_start = Instant::now();
        let daemon = Daemon::start(options)?;
        if !args.json {
            let took = began_to_start.elapsed().as_secs_f64();
            let (name, workers) = (home.name(), daemon.workers());
            let _ = writeln!(io::stderr(), "set {name} is up in {took:.2} s: {workers} cards");
            let _ = set::say_view(daemon.foxglove(), &mut io::stderr());
        }
        let began = Instant::now();
        let teller = Teller::new(args.json, &knowledge).with_progress(expected, scale.get());
        let (totals, progress) = (teller.totals(), teller.progress());
        let client = Client::connect(home)?.of_a_program();
        let hang_up = client.hang_up()?;
        let (wanted_down, closer, flag) = (daemon.wanted_down(), daemon.closer(), Arc::clone(&stop));
        tokio::spawn(async move {
            tokio::select! {
                () = asked_to_end => hang_up(),
                () = wanted_down => closer(),
            }
            flag.store(true, Ordering::Release);
        });
        let (program, limits) = (program.clone(), Limits { operations: None, stop });
        let running = tokio::task::spawn_blocking(move || {
            program.run(Arc::new(Mutex::new(client)), knowledge, teller, &limits)
        });
        let result = running.await;
        progress.end();
        let result = result.into_diagnostic().map_err(Exit::could_not)?;
        let elapsed = machine_time(began, scale.get());
        let report = daemon.stop().await;
        match result {
            Ok(()) => tell_summary(args.json, &totals, elapsed, Some(&report)),
            Err(error) => {
                if !args.json {
                    let _ = set::down_line(&report, &mut io::stderr());
                }
                Err(failed(error))
            }
        }
    })
}

/// Movements and steps so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Totals {
    pub(super) movements: u64,
    steps: u64,
}

/// Prints what a program does, a line each.
pub(super) struct Teller {
    json: bool,
    knowledge: Arc<Knowledge>,
    totals: Arc<Mutex<Totals>>,
    progress: Arc<Progress>,
}

impl Teller {
    pub(super) fn new(json: bool, knowledge: &Arc<Knowledge>) -> Self {
        let progress = Arc::new(Progress::none());
        Self { json, knowledge: Arc::clone(knowledge), totals: Arc::default(), progress }
    }

    /// Shows people how far the program is, from now on.
    fn with_progress(self, expected: Option<Expected>, scale: f64) -> Self {
        if self.json { self } else { Self { progress: Arc::new(Progress::start(expected, scale)), ..self } }
    }

    fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.progress)
    }

    pub(super) fn totals(&self) -> Arc<Mutex<Totals>> {
        Arc::clone(&self.totals)
    }
}

impl Watcher for Teller {
    fn movement(&mut self, movement: &Movement) {
        let first = {
            let mut totals = self.totals.lock().unwrap_or_else(PoisonError::into_inner);
            totals.movements += 1;
            totals.steps += u64::from(movement.done.0);
            totals.movements == 1
        };
        self.progress.moved();
        if self.json {
            let view = show::MovementView::new(movement, &self.knowledge);
            self.progress.say(&serde_json::json!({ "movement": view }).to_string());
        } else {
            if first {
                self.progress.say(&show::movement_title());
            }
            self.progress.say(&show::movement_line(movement, &self.knowledge));
        }
    }

    fn print(&mut self, text: &str) {
        if self.json {
            self.progress.say(&serde_json::json!({ "print": text }).to_string());
        } else {
            self.progress.say(text);
        }
    }
}

fn tell_summary(
    json: bool,
    totals: &Mutex<Totals>,
    elapsed: Ticks,
    log: Option<&DownReport>,
) -> Result<(), Exit> {
    let Totals { movements, steps } = *totals.lock().unwrap_or_else(PoisonError::into_inner);
    let mut out = io::stdout().lock();
    if json {
        let summary = serde_json::json!({
            "movements": movements,
            "steps": steps,
            "seconds": elapsed.as_seconds(),
            "frames_sent": log.map(|log| log.sent),
            "frames_logged": log.and_then(|log| log.logged),
            "frames_lost": log.and_then(|log| log.lost),
            "log": log.map(|log| &log.log),
            "log_parts": log.map(|log| &log.parts),
        });
        show::print_json(&serde_json::json!({ "summary": summary }), &mut out)?;
        return Ok(());
    }
    writeln!(out, "\n{movements} movements, {steps} steps, {:.3} s of machine time", elapsed.as_seconds())?;
    if let Some(log) = log {
        set::down_line(log, &mut out)?;
        if out.is_terminal() {
            writeln!(out, "        `ccu frames {}` shows its frames", log.log.display())?;
        }
    }
    Ok(())
}

pub(super) fn knowledge(config: supersigma_config::Config) -> Result<Arc<Knowledge>, Exit> {
    Knowledge::new(config).into_diagnostic().map_err(Exit::wrong)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, for people")]
fn machine_time(began: Instant, scale: f64) -> Ticks {
    Ticks((began.elapsed().as_secs_f64() * scale * 2e6) as u64)
}

pub(super) fn dry_error(error: &DryError) -> Exit {
    match error {
        // As `ccu up` and a run on a set have it.
        DryError::Log(LogError::Exists { .. }) => Exit::wrong(miette!("{error}")),
        _ => Exit::could_not(miette!("{error}")),
    }
}
