//! What both programs of the bench share on the command line: how a run is sampled and where its samples go, its progress,
//! Ctrl-C, and the report.

use std::fmt::Display;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, TryRecvError};

use axis_worker::bench::{Sampling, SamplingError, Train};
use clap::{Args, ValueHint};
use indicatif::{ProgressBar, ProgressStyle};
use miette::{Report as Diagnosis, miette};
use supersigma_protocol::{Direction, Tick};

use super::motor::MotorArgs;
use super::pictures::PictureArgs;
use crate::bench::{Program, Report, Run, RunError, SampleError, SampleFile, SampleForm};
use crate::cli::exit::Exit;
use crate::cli::{set, show};
use crate::log::WallTime;

/// How a run is sampled, and what becomes of the samples.
#[derive(Args)]
pub(super) struct RunArgs {
    /// Samples per second, 20000 to 60000
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = sampling)]
    sampling: Sampling,
    /// Towards the origin instead of forward
    #[arg(long)]
    reverse: bool,
    /// Write all samples to this file: .mcap for viewers, .csv for tables; must not exist yet
    #[arg(long, value_name = "FILE", value_parser = sample_file, value_hint = ValueHint::FilePath)]
    out: Option<(PathBuf, SampleForm)>,
    /// One JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pictures: PictureArgs,
    #[command(flatten)]
    motor: MotorArgs,
}

impl RunArgs {
    /// Runs the train, and prints what came of it.
    pub(super) fn run(&self, program: Program, train: Train) -> Result<(), Exit> {
        let motor = self.motor.motor()?;
        let direction = if self.reverse { Direction::TowardsOrigin } else { Direction::Forward };
        let run = Run { motor: &motor, program, train, direction, sampling: self.sampling };
        let mut recording = self.pictures.recording(&run.train)?;
        let file = self
            .out
            .as_ref()
            .map(|(path, form)| SampleFile::create(path, *form, &motor, &run.about(), WallTime::now()))
            .transpose()
            .map_err(|error| file_error(&error))?;
        let (progress, signals) = (progress(run.train.duration().ticks().0), Signals::listen()?);
        let report = run.go(file, recording.as_mut(), &mut |now: Tick| {
            progress.set_position(now.0);
            if signals.came() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        progress.finish_and_clear();
        let report = report.map_err(|error| match error {
            RunError::File(error) => file_error(&error),
            RunError::Motor(error) => Exit::wrong(miette!("{error}")),
        })?;
        let mut out = BufWriter::new(io::stdout().lock());
        if self.json {
            show::print_json(&report, &mut out)?;
        } else {
            print(&report, &mut out)?;
        }
        out.flush()?;
        if let Some(recording) = &recording {
            self.pictures.save(&run, &report, recording)?;
        }
        trouble(&report).map_or(Ok(()), |trouble| Err(Exit::could_not(trouble)))
    }
}

/// What is wrong with a run, if something is.
fn trouble(report: &Report) -> Option<Diagnosis> {
    if report.is_confirmed() {
        return None;
    }
    let end = report.total_s;
    if report.interrupted {
        return Some(miette!("the run was ended after {end:.6} s; report and file go so far"));
    }
    if !report.at_rest {
        return Some(miette!("the rotor does not come to rest: it still moves after {end:.6} s"));
    }
    let (lost, given) = (report.lost, report.commanded.abs());
    let what = if lost > 0 {
        format!("{lost} of {given} steps were lost")
    } else {
        format!("{} steps more than the {given} commanded were made", -lost)
    };
    let place = match report.first_lost {
        Some(first) => format!(
            "the first at pulse {}, at {:.6} s, with {:.1} pulses/s",
            first.pulse, first.time_s, first.frequency
        ),
        None => "and no sample shows where".to_owned(),
    };
    Some(if report.illegal_transitions > 0 {
        miette!(
            help = "the encoder's edges came faster than the discriminator's clock of 1 MHz: its count is wrong, \
                    which says nothing of the motor; turn slower, or take a disc with fewer lines",
            "{what}: {place}"
        )
    } else {
        miette!(
            help = "start with a lower frequency, or accelerate and decelerate for longer",
            "{what}: {place}"
        )
    })
}

fn print(report: &Report, out: &mut dyn Write) -> io::Result<()> {
    let mut row = |name: &str, value: &dyn Display| writeln!(out, "{name:<20} {value}");
    row("program", &report.program.name())?;
    row("motor", &report.motor)?;
    if report.load_torque > 0.0 || report.load_inertia > 0.0 {
        row("load", &format_args!("{} N·m, {} kg·m²", report.load_torque, report.load_inertia))?;
    }
    row("pulses", &report.pulses)?;
    if report.program == Program::Positioning {
        row("  accelerating", &format_args!("{} (Ns_a)", report.ns_a))?;
        row("  constant", &format_args!("{} (Ns_b)", report.ns_b))?;
        row("  decelerating", &format_args!("{} (Ns_c)", report.ns_c))?;
    }
    row("last pulse", &format_args!("{:.6} s", report.train_s))?;
    row(
        "at rest",
        &match (report.at_rest, report.total_s) {
            (true, end) => format!("{end:.6} s"),
            (false, end) => format!("not after {end:.6} s"),
        },
    )?;
    row("steps commanded", &report.commanded)?;
    row("steps measured", &report.measured)?;
    row("steps lost", &report.lost)?;
    if let Some(first) = report.first_lost {
        row(
            "  first",
            &format_args!("pulse {}, {:.6} s, {:.1} pulses/s", first.pulse, first.time_s, first.frequency),
        )?;
    }
    row("position", &format_args!("{} of {} counts a turn", report.position, report.counts_per_turn))?;
    row("L pulses", &report.l)?;
    row("R pulses", &report.r)?;
    row("direction changes", &report.direction_changes)?;
    row("illegal transitions", &report.illegal_transitions)?;
    row("samples", &format_args!("{} at {} Hz", report.samples, report.sampling_hertz))?;
    if let Some(file) = &report.file {
        row("file", &file.display())?;
    }
    Ok(())
}

/// How far a run of so many ticks is, on a terminal.
fn progress(ticks: u64) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {eta} left");
    ProgressBar::new(ticks).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Whether the process has been asked to end.
struct Signals {
    told: Receiver<()>,
    /// It listens for as long as it is there.
    _runtime: tokio::runtime::Runtime,
}

impl Signals {
    fn listen() -> Result<Self, Exit> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let (tell, told) = mpsc::channel();
        let asked_to_end = {
            let _guard = runtime.enter();
            set::asked_to_end()?
        };
        runtime.spawn(async move {
            asked_to_end.await;
            // If nobody listens any more, the run is over.
            let _ = tell.send(());
        });
        Ok(Self { told, _runtime: runtime })
    }

    fn came(&self) -> bool {
        !matches!(self.told.try_recv(), Err(TryRecvError::Empty))
    }
}

fn file_error(error: &SampleError) -> Exit {
    match error {
        SampleError::Exists { .. } | SampleError::Create { .. } => Exit::wrong(miette!("{error}")),
        SampleError::Write { .. } => Exit::could_not(miette!("{error}")),
    }
}

fn sampling(text: &str) -> Result<Sampling, String> {
    let asked = text.parse().map_err(|_| "samples per second are a whole number".to_owned())?;
    Sampling::new(asked).map_err(|error: SamplingError| error.to_string())
}

fn sample_file(text: &str) -> Result<(PathBuf, SampleForm), String> {
    let path = PathBuf::from(text);
    let form = SampleForm::of(&path).ok_or("the name must end in .mcap or .csv")?;
    Ok((path, form))
}
