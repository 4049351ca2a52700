//! The command line: what can be typed, and which room does it. Arguments and help texts stand here, in one place, for
//! help, usage errors and completions alike; what commands print is in `show`.

mod ask;
mod asked;
mod bench;
mod check;
mod config;
mod exit;
mod logs;
mod monitor;
mod panel;
mod paper;
mod plot;
mod profile;
mod progress;
mod ps;
mod rehearsal;
mod repl;
mod replay;
mod run;
mod serve;
mod service;
mod set;
mod show;
mod timing;
mod word;

use std::path::PathBuf;
use std::process::ExitCode;

use axis_worker::clock::TimeScale;
use axis_worker::worker::{self, WorkerArgs};
use clap::{ArgMatches, Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use miette::IntoDiagnostic;

use self::exit::Exit;
use crate::daemon::foxglove::{self, ViewAddress, ViewArgs};
use crate::daemon::recorder::{self, RecorderArgs};
use crate::home::SetName;

/// The central control unit of a SUPERSIGMA robot: seven stepping motors, one command
#[derive(Parser)]
#[command(
    name = "ccu",
    version,
    max_term_width = 100,
    after_help = "\
Examples:
  ccu run examples/assembly.rhai      start a set, run a program, take the set down
  ccu up --detach                     start a set that stays up
  ccu origin                          find the origin of all axes
  ccu move left_x 1200                1200 steps away from the origin
  ccu status                          what every axis is doing
  ccu down                            take the set down

Axes are named by number (1 to 7) or by their configured name.
Exit codes: 0 done, 1 the robot could not, 2 wrongly asked, 3 no set is up or its bus is gone."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Start a set and keep it up
    #[command(after_help = "\
Examples:
  ccu up                              in the foreground; Ctrl-C takes it down
  ccu up --detach                     in the background; `ccu down` takes it down
  ccu up --foxglove 8765              with a live view for Foxglove at ws://127.0.0.1:8765
  ccu up --name cell-2 --config cell-2.toml --log cell-2.mcap")]
    Up(set::UpArgs),
    /// Take a set down: axes stand, the log is finished, nothing is left
    #[command(after_help = "Examples:\n  ccu down\n  ccu down --name cell-2")]
    Down(set::DownArgs),
    /// Run a program, on a set that is up or on one of its own
    #[command(after_help = "\
Examples:
  ccu run examples/assembly.rhai
  ccu run -e 'origin(\"wrist\"); move_by(\"wrist\", 400)'
  ccu run examples/together.rhai --set rounds=5
  ccu run --foxglove 8765 examples/assembly.rhai
  ccu run --dry-run --pulses pulses.csv examples/assembly.rhai
  echo 'print(position(1))' | ccu run -")]
    Run(run::RunArgs),
    /// Look for everything that is wrong with a program; nothing moves, and no set is needed
    #[command(after_help = "\
Every call in the text is looked at, then the program is rehearsed on a dry set just switched on.

Examples:
  ccu check examples/assembly.rhai
  ccu check weld.rhai --config cell-2.toml --set laps=5
  ccu check weld.rhai --originated    for a set whose axes have been originated
  ccu check weld.rhai --json

Exit codes: 0 nothing is wrong, 2 something is.")]
    Check(check::CheckArgs),
    /// Talk to a set in the language of robot programs, a line at a time
    #[command(after_help = "\
Tab completes functions, variables, and the names of axes, inputs and outputs. A text with open brackets
goes on in the next line. Ctrl-C halts what moves, Ctrl-D leaves.

Examples:
  ccu repl                            on the set that is up
  ccu repl --dry-run                  on a dry set, in virtual time
  echo 'origin(); position(1)' | ccu repl --dry-run")]
    Repl(repl::ReplArgs),
    /// Move one axis by so many steps
    #[command(
        allow_negative_numbers = true,
        after_help = "\
Examples:
  ccu move left_x 1200                away from the origin
  ccu move 1 -1200 --speed 4000       towards it, at most 4000 steps/s
  ccu move wrist 400 --constant --speed 650"
    )]
    Move(ask::MoveArgs),
    /// Move several axes on a straight line: they start together and end together
    #[command(after_help = "\
Examples:
  ccu line left_x=7919 left_y=13
  ccu line 1=400 2=300 3=-100 --speed 5000")]
    Line(ask::LineArgs),
    /// Move one axis until Ctrl-C, or to the end of its travel
    #[command(after_help = "Examples:\n  ccu jog left_x forward\n  ccu jog left_x back --speed 1000")]
    Jog(ask::JogArgs),
    /// Find the origin of axes: back to the limit switch, forward until it opens
    #[command(after_help = "Examples:\n  ccu origin\n  ccu origin left_x left_y")]
    Origin(ask::OriginArgs),
    /// Find the reference step of an axis
    #[command(after_help = "Examples:\n  ccu reference left_x\n  ccu reference 1 --json")]
    Reference(ask::ReferenceArgs),
    /// Stop axes with the normal ramp; positions are kept
    #[command(
        after_help = "Examples:\n  ccu halt                            all axes\n  ccu halt left_x left_y"
    )]
    Halt(ask::AxesArgs),
    /// Finish what was halted, or braked and cleared: the remaining steps, alone or on a line
    #[command(after_help = "Examples:\n  ccu resume\n  ccu resume --json")]
    Resume(ask::ResumeArgs),
    /// Stop axes with the steep ramp and lock them; positions are kept
    #[command(after_help = "Examples:\n  ccu brake                           all axes\n  ccu brake wrist")]
    Brake(ask::AxesArgs),
    /// Acknowledge alarms, so that axes may move again
    #[command(after_help = "Examples:\n  ccu clear                           all axes\n  ccu clear left_x")]
    Clear(ask::AxesArgs),
    /// What the axes are doing
    #[command(after_help = "Examples:\n  ccu status\n  ccu status left_x --json\n  ccu status --watch")]
    Status(ask::StatusArgs),
    /// Show a set in a browser: a small web server for this machine
    #[command(after_help = "\
Examples:
  ccu serve                           look at http://127.0.0.1:8748/
  ccu serve --listen 0 --control      any free port; orders from those who have the printed token
  ccu serve --listen 0.0.0.0:8748 --token-file ~/.config/supersigma/token

The set need not be up: the page waits for it, and for its return. Everything below /api asks for the
token, if there is one; what programs can read and order there is described in the book, \"The web
interface\".")]
    Serve(serve::ServeArgs),
    /// A dashboard: rails, speeds, lamps, frames and events as they happen, and keys that halt and brake
    #[command(after_help = "\
Examples:
  ccu monitor                         the keys are shown with `?`; `q` quits
  ccu monitor --name cell-2
  ccu monitor --once --size 120x40    one picture as text, for a file or a message")]
    Monitor(monitor::MonitorArgs),
    /// Show the digital inputs, or one of them
    #[command(after_help = "Examples:\n  ccu input\n  ccu input guard_closed\n  ccu input --json")]
    Input(panel::InputArgs),
    /// Show the digital outputs, or switch one
    #[command(after_help = "Examples:\n  ccu output\n  ccu output left_gripper on\n  ccu output 3 off")]
    Output(panel::OutputArgs),
    /// Put raw command bytes on the MICROBUS and show the answers
    #[command(after_help = "\
Examples:
  ccu send 01 05                      status of axis 1
  ccu send 01 81 01 90                axis 1, 400 steps towards the origin
  ccu send 00 06                      halt everyone")]
    Send(panel::SendArgs),
    /// Give an axis the control words U and V of Fredriksen's interface, and read its sense word R
    #[command(after_help = "\
U is the motion in steps. V, from the most significant bit: v1 towards the origin, v4 halt, v5 v6 v7
maximum speed (000 the slowest, 111 the top of the ramp), v8 seek the reference step; its other bits
must be 0. Halting wins over seeking, seeking over the motion. R, from the most significant bit: X1
to X5; 1000 (X4 alone) is the success of an open-loop motion, 1800 (X4 and X5) of a closed-loop one.

Examples:
  ccu word left_x 04B0 0E00           1200 steps away from the origin, full speed
  ccu word 1 190 8600                 400 steps towards it, speed level 3
  ccu word 1 0 1000                   halt
  ccu word 1 0 0100                   seek the reference step
  ccu word 1                          only read R")]
    Word(word::WordArgs),
    /// Make a fault on purpose, to see what happens
    #[command(after_help = "\
Examples:
  ccu inject left_x force                  the excessive-force input closes
  ccu inject left_x limit                  the end-of-rail input closes
  ccu inject left_x lost-steps=40          the next 40 pulses do not reach the motor
  ccu inject left_x switch=open            the limit switch never closes (closed, free)")]
    Inject(panel::InjectArgs),
    /// Show a log as it happened, verify it on fresh machines, or put its commands on a live bus again
    #[command(after_help = "\
Examples:
  ccu replay run.mcap --verify                     every answer again, byte for byte
  ccu replay run.mcap                              the frames at the machine's pace
  ccu replay run.mcap --watch --speed 5 --from 60  the axes' table, five times as fast, from second 60 on
  ccu replay run.mcap --bus                        the same movements again, on a set started for it
  ccu replay run.mcap --bus --name cell-2          the same on a set that is up

Exit codes of --verify: 0 identical, 1 a difference, or something that cannot be verified, 2 no such log.")]
    Replay(replay::ReplayArgs),
    /// The processes of the sets that are up
    #[command(after_help = "Examples:\n  ccu ps\n  ccu ps --name cell-2 --json")]
    Ps(ps::PsArgs),
    /// Kill a worker on purpose, or let it hang, to see what happens
    #[command(after_help = "\
Examples:
  ccu kill-worker left_x                   its process ends; it is started again, and its axis has no position
  ccu kill-worker left_x --signal stop     it hangs
  ccu kill-worker left_x --signal cont     it goes on
  ccu kill-worker digital")]
    KillWorker(ps::KillWorkerArgs),
    /// Show the frames of a log
    #[command(after_help = "\
Examples:
  ccu frames run.mcap
  ccu frames run.mcap --axis left_x --json
  ccu frames run.mcap --from 12.5 --to 13     the frames of half a second
  ccu frames run.mcap --op move --csv         the Move commands and the answers to them, as a table")]
    Frames(logs::FramesArgs),
    /// Look at a log as a whole
    #[command(subcommand)]
    Log(logs::LogCommand),
    /// Make a complete log of one that was cut or damaged
    #[command(after_help = "\
Everything that is whole is kept as it is, and nothing is made up. What was lost is told.

Examples:
  ccu recover run.mcap -o whole.mcap
  ccu recover run.mcap -o whole.mcap --json")]
    Recover(logs::RecoverArgs),
    /// The ramp table of an axis, or the pulses of one movement
    #[command(after_help = "\
Examples:
  ccu profile                         the ramp table of axis 1
  ccu profile --config cell.toml --axis lift
  ccu profile --steps 5184            a movement, planned and run on the machine
  ccu profile --steps 200 --method paper --json --pulses")]
    Profile(profile::ProfileArgs),
    /// Draw what a log holds, or how a ramp is made, as SVG or PNG
    #[command(after_help = "\
Examples:
  ccu plot run.mcap -o run.svg                  speed, position and sense points of what moved
  ccu plot run.mcap -o run.png --axis left_x,left_y --from 2 --to 3.5
  ccu plot run.mcap -o plane.svg --what plane   speed over position, with the limit zones
  ccu plot run.mcap -o gantt.svg --what timing  movements and digital lines as bars
  ccu plot --profile -o table.svg               the ramp table
  ccu plot --profile --steps 5184 -o move.svg   one movement, and the curve behind it
  ccu plot --profile --which speed -o fig10.svg --method paper

A file that is there already is replaced.")]
    Plot(plot::PlotArgs),
    /// The test bench: run a motor, and see whether it makes its steps
    #[command(subcommand)]
    Bench(bench::BenchCommand),
    /// Check, show and describe configurations
    #[command(subcommand)]
    Config(config::ConfigCommand),
    /// Print the completions of a shell
    #[command(after_help = "\
Examples:
  ccu completions bash > ~/.local/share/bash-completion/completions/ccu
  ccu completions zsh > ~/.zfunc/_ccu
  ccu completions fish > ~/.config/fish/completions/ccu.fish")]
    Completions(paper::CompletionsArgs),
    /// Print the manual page, or write those of all commands
    #[command(after_help = "Examples:\n  ccu man > ccu.1\n  ccu man ~/.local/share/man/man1")]
    Man(paper::ManArgs),
    /// One card's process; the daemon starts them
    #[command(hide = true)]
    AxisWorker(WorkerArgs),
    /// The recorder's process; the daemon starts it
    #[command(hide = true)]
    Recorder(RecorderArgs),
    /// The live view's process; the daemon starts it
    #[command(hide = true)]
    FoxgloveServer(ViewArgs),
}

/// Which set.
#[derive(Args, Clone)]
struct SetArgs {
    /// The set's name
    #[arg(long, value_name = "NAME", env = "CCU_NAME", default_value = "supersigma")]
    name: SetName,
}

/// How a set is started.
#[derive(Args, Clone)]
struct StartArgs {
    /// The set's configuration; the built-in set if none is named
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The log; must not exist yet [default: a new file in ~/.local/state/supersigma]
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Go on in another file when one is so long, or so old: 100MB, 2GB, 10min, 1h
    #[arg(long, value_name = "SIZE|TIME")]
    log_rotate: Option<set::LogRotate>,
    /// How many times faster than real time
    #[arg(long, value_name = "K", default_value_t = TimeScale::REAL)]
    time_scale: TimeScale,
    /// Serve a live view for Foxglove, on this machine alone unless an address is named
    #[arg(long, value_name = "[ADDR:]PORT")]
    foxglove: Option<ViewAddress>,
}

/// Runs the command that was typed.
#[must_use]
pub fn main() -> ExitCode {
    crate::program::take_name();
    let parsed = Cli::command()
        .try_get_matches()
        .and_then(|matches| Ok((asks_for_json(&matches), Cli::from_arg_matches(&matches)?)));
    let (json, cli) = match parsed {
        Ok(parsed) => parsed,
        Err(error) => return exit::usage(&error),
    };
    // A daemon's events go to its log too.
    if matches!(cli.command, Command::Up(_) | Command::Run(_)) {
        crate::notices::start_logging();
    } else {
        axis_worker::start_logging();
    }
    match cli.command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(exit) => exit.report(json),
    }
}

/// Whether the innermost command that was typed has `--json`: then its failures are JSON too.
fn asks_for_json(matches: &ArgMatches) -> bool {
    match matches.subcommand() {
        Some((_, inner)) => asks_for_json(inner),
        None => matches.try_get_one::<bool>("json").ok().flatten().copied().unwrap_or(false),
    }
}

impl Command {
    fn run(self) -> Result<(), Exit> {
        match self {
            Self::Up(args) => set::up(&args),
            Self::Down(args) => set::down(&args),
            Self::Run(args) => run::run(&args),
            Self::Check(args) => check::check(&args),
            Self::Repl(args) => repl::repl(&args),
            Self::Move(args) => ask::movement(&args),
            Self::Line(args) => ask::line(&args),
            Self::Jog(args) => ask::jog(&args),
            Self::Origin(args) => ask::origin(&args),
            Self::Reference(args) => ask::reference(&args),
            Self::Halt(args) => ask::halt(&args),
            Self::Resume(args) => ask::resume(&args),
            Self::Brake(args) => ask::brake(&args),
            Self::Clear(args) => ask::clear(&args),
            Self::Status(args) => ask::status(&args),
            Self::Serve(args) => serve::serve(&args),
            Self::Monitor(args) => monitor::monitor(&args),
            Self::Input(args) => panel::input(&args),
            Self::Output(args) => panel::output(&args),
            Self::Send(args) => panel::send(&args),
            Self::Word(args) => word::word(&args),
            Self::Inject(args) => panel::inject(&args),
            Self::Replay(args) => replay::replay(&args),
            Self::Ps(args) => ps::ps(&args),
            Self::KillWorker(args) => ps::kill_worker(&args),
            Self::Frames(args) => logs::frames(&args),
            Self::Log(command) => logs::log(&command),
            Self::Recover(args) => logs::recover(&args),
            Self::Profile(args) => profile::profile(&args),
            Self::Plot(args) => plot::plot(&args),
            Self::Bench(command) => bench::bench(&command),
            Self::Config(command) => config::config(&command),
            Self::Completions(args) => paper::completions(&args),
            Self::Man(args) => paper::man(&args),
            Self::AxisWorker(args) => worker::run(&args).into_diagnostic().map_err(Exit::could_not),
            Self::Recorder(args) => match recorder::record(&args) {
                Ok(true) => Ok(()),
                Ok(false) => Err(Exit::silent(1)),
                Err(report) => Err(Exit::could_not(report)),
            },
            Self::FoxgloveServer(args) => foxglove::serve(&args).map_err(Exit::could_not),
        }
    }
}
