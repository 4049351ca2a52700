//! The book's pictures, made of dry runs, of the built-in set's ramp and of the bench motor:
//!
//! ```sh
//! cargo run --release -p supersigma-ccu --example pictures -- --out docs/src/generated
//! ```
//!
//! Two runs make the same bytes.

use std::fs;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use axis_worker::bench::{Clocks, Frequency, Hold, Positioning, Sampling, Train};
use axis_worker::clock::TimeScale;
use axis_worker::motor::Load;
use axis_worker::tune::{CardShape, Margin};
use ccu::bench::filter::{Cutoff, Taps};
use ccu::bench::limits::{sweep, torques};
use ccu::bench::tune::{Wanted, compare};
use ccu::bench::{BenchMotor, Program as BenchProgram, Recording};
use ccu::dry::{DrySet, NoPulses};
use ccu::executive::{Executive, Knowledge, Movement};
use ccu::log::{AxisNames, LogHeader, LogReader, Timeline, WallTime};
use ccu::plot::bench::{self, Filters, Graph, Plotted};
use ccu::plot::limits::limits;
use ccu::plot::profile::{LENGTHS, Ramp, Which};
use ccu::plot::tune::{Shown as TuneShown, tune};
use ccu::plot::{Picture, Shown, Subject, Timing, Trace, What, gantt, moves};
use ccu::script::{Limits, Program, Watcher};
use clap::Parser;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use supersigma_config::{Config, MotorConfig, RampConfig, ShortMoves};
use supersigma_protocol::{AxisNumber, Direction, Distance};

/// Draws the book's pictures
#[derive(Parser)]
struct Args {
    /// The folder for them; made if it is not there
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

fn main() -> Result<()> {
    let Args { out } = Args::parse();
    fs::create_dir_all(&out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make the folder {}", out.display()))?;
    for (name, picture) in pictures()? {
        let path = out.join(name);
        picture.save(&path).into_diagnostic()?;
        println!("{}", path.display());
    }
    Ok(())
}

/// Every picture with the name of its file.
fn pictures() -> Result<Vec<(&'static str, Picture)>> {
    let config = Config::default_set();
    let three = Run::of("plots.rhai", include_str!("../../docs/src/guide/plots.rhai"), &config)?;
    let assembly = Run::of("assembly.rhai", include_str!("../../examples/assembly.rhai"), &config)?;
    let mut pictures = vec![
        ("plot_moves.svg", three.moves(&[What::Speed, What::Position, What::Sense])?),
        ("plot_plane.svg", three.moves(&[What::Plane])?),
        ("plot_assembly.svg", assembly.gantt()?),
    ];
    let axis = &config.axes[0];
    let paper = RampConfig { short_moves: ShortMoves::Paper, ..config.ramp.clone() };
    let whole: Vec<_> = LENGTHS.into_iter().filter_map(Distance::new).collect();
    let one: Vec<_> = Distance::new(6_000).into_iter().collect();
    for (name, ramp, which, lengths) in [
        ("ramp_table.svg", &config.ramp, Which::Table, &whole),
        ("ramp_movement.svg", &config.ramp, Which::Speed, &one),
        ("ramp_lengths.svg", &config.ramp, Which::Speed, &whole),
        ("ramp_lengths_1980.svg", &paper, Which::Speed, &whole),
        ("ramp_initial_n.svg", &paper, Which::Length, &whole),
        ("ramp_times.svg", &config.ramp, Which::Times, &whole),
    ] {
        pictures.push((name, Ramp { axis, ramp }.picture(which, lengths).into_diagnostic()?));
    }
    pictures.extend([("bench_limits.svg", characteristic()?), ("bench_tune.svg", tuned(&config.ramp)?)]);
    pictures.extend(bench_pictures()?);
    Ok(pictures)
}

/// The limits of the bench motor.
fn characteristic() -> Result<Picture> {
    const TOP: f64 = 100_000.0;
    let motor = MotorConfig::bench();
    let found = sweep(&motor, &[0.0], &torques(&motor, 12), TOP, &|| {}).into_diagnostic()?;
    limits(&found, TOP, "Limits of the bench motor", "no disc, a brake on the shaft").into_diagnostic()
}

/// The built-in ramp with five times the inertia for which it is made, and what holds instead.
fn tuned(current: &RampConfig) -> Result<Picture> {
    let motor = MotorConfig { load_inertia: 4.8e-4, ..MotorConfig::bench() };
    let distance = Distance::new(2_000).ok_or_else(|| miette!("no movement"))?;
    let margin = Margin::new(0.3).ok_or_else(|| miette!("no margin"))?;
    let shapes = &[CardShape::Linear, CardShape::Sin2];
    let wanted = Wanted { motor: &motor, current, distance, margin, shapes };
    let ways = compare(&wanted).into_diagnostic()?;
    tune(&TuneShown { wanted: &wanted, name: "the bench motor and a disc", ways: &ways }).into_diagnostic()
}

/// The runs of [M]: a low frequency without a load, and a whole positioning cycle, of the bench motor; and the filters.
fn bench_pictures() -> Result<Vec<(&'static str, Picture)>> {
    let sampling = Sampling::new(40_000).into_diagnostic()?;
    let hertz = |hertz: u64| Frequency::from_millihertz(hertz * 1_000).into_diagnostic();
    let low = Train::constant(hertz(20)?, 16).into_diagnostic()?;
    let cycle = Train::positioning(Positioning {
        start: hertz(400)?,
        max: hertz(4_000)?,
        t_a: Clocks(250_000),
        hold: Hold::For(Clocks(250_000)),
        t_c: Clocks(150_000),
    })
    .into_diagnostic()?;
    let taps = [21, 41, 81].map(Taps::new).into_iter().collect::<Result<Vec<_>, _>>().into_diagnostic()?;
    let cutoffs = [Cutoff::RAMPS, Cutoff::SWINGS, Cutoff::HIGHEST];
    let (constant, positioning) = (BenchProgram::Constant, BenchProgram::Positioning);
    Ok(vec![
        ("bench_position.svg", benched(constant, low.clone(), sampling, Graph::Position)?),
        ("bench_speed.svg", benched(constant, low, sampling, Graph::Speed)?),
        ("bench_profile.svg", benched(positioning, cycle, sampling, Graph::Profile)?),
        ("bench_filters.svg", bench::filters(sampling, &taps, &cutoffs).into_diagnostic()?),
    ])
}

/// A picture of what the bench motor does on a pulse train.
fn benched(program: BenchProgram, train: Train, sampling: Sampling, graph: Graph) -> Result<Picture> {
    let load = Load::default();
    let motor = BenchMotor { name: "the bench motor".into(), config: MotorConfig::bench(), load };
    let run = ccu::bench::Run { motor: &motor, program, train, direction: Direction::Forward, sampling };
    let mut recording = Recording::default();
    let mut go_on = |_| ControlFlow::Continue(());
    let report = run.go(None, Some(&mut recording), &mut go_on).into_diagnostic()?;
    Plotted::new(&run, &report, &recording).picture(graph, Filters::default()).into_diagnostic()
}

/// A program's dry run, as its log tells it.
struct Run<'a> {
    name: &'a str,
    config: &'a Config,
    names: AxisNames,
    trace: Trace,
    timing: Timing,
}

impl<'a> Run<'a> {
    fn of(name: &'a str, source: &str, config: &'a Config) -> Result<Self> {
        let folder = tempfile::tempdir().into_diagnostic()?;
        let path = folder.path().join("run.mcap");
        let header = LogHeader {
            version: LogHeader::VERSION.to_owned(),
            set: "supersigma".into(),
            names: AxisNames::from(config),
            timeline: Timeline { epoch: WallTime(0), scale: TimeScale::REAL },
            config: config.to_toml(),
            script: None,
        };
        let knowledge = Knowledge::new(config.clone()).into_diagnostic()?;
        let set = DrySet::new(Arc::clone(&knowledge), NoPulses, Some((&path, header))).into_diagnostic()?;
        let operator = Arc::new(Mutex::new(Executive::new(set)));
        let program = Program::compile(name, source)?;
        program.run(Arc::clone(&operator), knowledge, Silence, &Limits::default())?;
        let executive = Arc::into_inner(operator).ok_or_else(|| miette!("the dry set is still held"))?;
        let set = executive.into_inner().unwrap_or_else(PoisonError::into_inner).into_link();
        let timing = set.timing();
        set.finish().into_diagnostic()?;
        let mut trace = Trace::default();
        for logged in LogReader::open(&path).into_diagnostic()? {
            trace.hear(&logged.into_diagnostic()?.frame.into_diagnostic()?);
        }
        trace.sort();
        Ok(Self { name, config, names: AxisNames::from(config), trace, timing })
    }

    fn moves(&self, what: &[What]) -> Result<Picture> {
        let window = self.trace.moving().ok_or_else(|| miette!("{} moves nothing", self.name))?;
        let axes: Vec<AxisNumber> =
            self.trace.axes.iter().filter(|trace| trace.moved(window)).map(|trace| trace.axis).collect();
        self.drawn(|subject| {
            moves(&self.trace, &self.timing, &Shown { subject, axes: &axes, what, window, size: None })
        })
    }

    fn gantt(&self) -> Result<Picture> {
        self.drawn(|subject| gantt(&self.timing, &subject))
    }

    fn drawn<E: std::error::Error + Send + Sync + 'static>(
        &self,
        draw: impl FnOnce(Subject<'_>) -> Result<Picture, E>,
    ) -> Result<Picture> {
        let title = format!("Dry run of {}", self.name);
        let subtitle = self.timing.totals();
        let subject = Subject { title: &title, subtitle: &subtitle, names: &self.names, config: self.config };
        draw(subject).into_diagnostic()
    }
}

/// Nobody listens.
struct Silence;

impl Watcher for Silence {
    fn movement(&mut self, _: &Movement) {}
    fn print(&mut self, _: &str) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pictures_in_the_book_are_current() {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/src/generated");
        let stale: Vec<_> = pictures()
            .expect("they can be drawn")
            .into_iter()
            .filter(|(name, picture)| {
                fs::read_to_string(folder.join(name)).ok().as_deref() != Some(picture.svg())
            })
            .map(|(name, _)| name)
            .collect();
        assert!(stale.is_empty(), "{stale:?} are stale; `just pictures` makes them anew");
    }
}
