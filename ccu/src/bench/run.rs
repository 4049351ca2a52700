//! A program on the bench, from the first pulse to the confirmed steps: samples go to a file as they come, and to a recording
//! if a picture wants them. It knows no terminal.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;

use axis_worker::bench::{Bench, Observer, Outcome, PartSteps, Pulse, Sample, Sampling, Train};
use serde::Serialize;
use supersigma_config::MotorError;
use supersigma_protocol::{Direction, Tick, Ticks};

use super::{BenchMotor, CommandedPulse, Recording, SampleError, SampleFile};

/// How many samples pass between two calls of who watches.
const SAMPLES_OF_A_CALL: u64 = 2_048;

/// The subroutines of \[M\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Program {
    /// CONST. FREQ.
    Constant,
    /// POSITIONING.
    Positioning,
}

impl Program {
    /// As it is typed.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Positioning => "positioning",
        }
    }
}

/// What is run.
#[derive(Debug, Clone)]
pub struct Run<'a> {
    /// The motor.
    pub motor: &'a BenchMotor,
    /// Which program made the train.
    pub program: Program,
    /// The pulses.
    pub train: Train,
    /// Where they turn the motor.
    pub direction: Direction,
    /// How often it is looked at.
    pub sampling: Sampling,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Which program.
    pub program: Program,
    /// Whose motor.
    pub motor: String,
    /// N·m of the bench's brake.
    pub load_torque: f64,
    /// kg·m² of its disc.
    pub load_inertia: f64,
    /// Pulses of the whole train.
    pub pulses: u64,
    /// `Ns_a`, accelerating.
    pub ns_a: u32,
    /// `Ns_b`, at a constant frequency.
    pub ns_b: u32,
    /// `Ns_c`, decelerating.
    pub ns_c: u32,
    /// From the start to the last pulse of the train.
    pub train_s: f64,
    /// To the rotor's rest.
    pub total_s: f64,
    /// Half steps that were given, negative towards the origin.
    pub commanded: i64,
    /// Half steps that were made.
    pub measured: i64,
    /// Half steps given and not made; negative if more were made.
    pub lost: i64,
    /// Where that began.
    pub first_lost: Option<FirstLost>,
    /// The shaft's position at rest, in counts.
    pub position: i64,
    /// Counts of the encoder in a turn.
    pub counts_per_turn: u32,
    /// Pulses on L.
    pub l: u64,
    /// Pulses on R.
    pub r: u64,
    /// How often the sense changed.
    pub direction_changes: u64,
    /// How often both signals of the encoder had changed at once.
    pub illegal_transitions: u64,
    /// Samples taken.
    pub samples: u64,
    /// Samples per second.
    pub sampling_hertz: u32,
    /// Whether the rotor came to rest.
    pub at_rest: bool,
    /// Whether the run was ended before its end.
    pub interrupted: bool,
    /// Where the samples are.
    pub file: Option<PathBuf>,
}

/// The place of the first lost step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FirstLost {
    /// The last pulse given until then, from 1.
    pub pulse: u64,
    /// Seconds from the start.
    pub time_s: f64,
    /// Of that pulse, pulses/s.
    pub frequency: f64,
}

impl Report {
    /// Whether the motor made the steps that it was given, all of them.
    #[must_use]
    pub const fn is_confirmed(&self) -> bool {
        self.lost == 0 && self.at_rest && !self.interrupted
    }
}

impl Run<'_> {
    /// What a file says of the run before its samples.
    #[must_use]
    pub fn about(&self) -> BTreeMap<String, String> {
        let Self { motor, program, train, direction, sampling } = self;
        let PartSteps { a, b, c } = train.steps();
        let direction = match direction {
            Direction::Forward => "forward",
            Direction::TowardsOrigin => "towards_origin",
        };
        [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("program", program.name().to_owned()),
            ("motor", motor.name.clone()),
            ("direction", direction.to_owned()),
            ("ns_a", a.to_string()),
            ("ns_b", b.to_string()),
            ("ns_c", c.to_string()),
            ("sampling_hertz", sampling.hertz().to_string()),
            ("counts_per_turn", motor.counts_per_turn().to_string()),
            ("half_steps_per_turn", motor.config.half_steps_per_turn.to_string()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }

    /// Runs it. `watch` is called every few samples with the time reached, and ends the run with [`ControlFlow::Break`]; the
    /// file is ended properly then too.
    ///
    /// # Errors
    /// If the motor cannot be, or the file cannot be written.
    pub fn go(
        &self,
        file: Option<SampleFile>,
        mut recording: Option<&mut Recording>,
        watch: &mut dyn FnMut(Tick) -> ControlFlow<()>,
    ) -> Result<Report, RunError> {
        let bench = Bench::new(&self.motor.loaded()?)?;
        let path = file.as_ref().map(|file| file.path().to_owned());
        if let Some(recording) = &mut recording {
            recording.sampling_hertz = self.sampling.hertz();
            recording.counts_per_turn = self.motor.counts_per_turn();
            recording.half_steps_per_turn = self.motor.config.half_steps_per_turn;
        }
        let mut scribe = Scribe { file, recording, watch, error: None };
        let outcome = bench.run(&self.train, self.direction, self.sampling, &mut scribe);
        if let Some(error) = scribe.error {
            return Err(error.into());
        }
        let report = self.report(&outcome, path);
        if let Some(file) = scribe.file {
            file.finish(outcome_entries(&report))?;
        }
        Ok(report)
    }

    fn report(&self, outcome: &Outcome, file: Option<PathBuf>) -> Report {
        let PartSteps { a, b, c } = self.train.steps();
        let seconds = |tick: Tick| Ticks(tick.0).as_seconds();
        let Outcome { confirmed, l, r, reversals, illegal, samples, ended, at_rest, interrupted, .. } =
            *outcome;
        Report {
            program: self.program,
            motor: self.motor.name.clone(),
            load_torque: self.motor.load.torque,
            load_inertia: self.motor.load.inertia,
            pulses: self.train.steps().total(),
            ns_a: a,
            ns_b: b,
            ns_c: c,
            train_s: self.train.duration().ticks().as_seconds(),
            total_s: seconds(ended),
            commanded: confirmed.commanded,
            measured: confirmed.measured,
            lost: confirmed.lost(),
            first_lost: confirmed.first_lost.map(|place| FirstLost {
                pulse: place.pulse,
                time_s: seconds(place.at),
                frequency: place.period.map_or(0.0, axis_worker::bench::Period::hertz),
            }),
            position: l.cast_signed() - r.cast_signed(),
            counts_per_turn: self.motor.counts_per_turn(),
            l,
            r,
            direction_changes: reversals,
            illegal_transitions: illegal,
            samples,
            sampling_hertz: self.sampling.hertz(),
            at_rest,
            interrupted,
            file,
        }
    }
}

/// Why a run has no report.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The motor cannot be.
    #[error(transparent)]
    Motor(#[from] MotorError),
    /// The file cannot be written.
    #[error(transparent)]
    File(#[from] SampleError),
}

/// Writes what the bench tells.
struct Scribe<'a> {
    file: Option<SampleFile>,
    recording: Option<&'a mut Recording>,
    watch: &'a mut dyn FnMut(Tick) -> ControlFlow<()>,
    error: Option<SampleError>,
}

impl Observer for Scribe<'_> {
    fn pulse(&mut self, pulse: Pulse) {
        if let Some(recording) = &mut self.recording {
            recording.commanded.push(CommandedPulse { at: pulse.at, clocks: pulse.period.clocks() });
        }
    }

    fn sample(&mut self, sample: Sample) -> ControlFlow<()> {
        if let Some(recording) = &mut self.recording {
            recording.positions.push(sample.position().0);
        }
        if let Some(file) = &mut self.file
            && let Err(error) = file.write(&sample)
        {
            self.error = Some(error);
            return ControlFlow::Break(());
        }
        if sample.number.is_multiple_of(SAMPLES_OF_A_CALL) {
            return (self.watch)(sample.at);
        }
        ControlFlow::Continue(())
    }
}

/// What a file says of the run after its samples.
fn outcome_entries(report: &Report) -> BTreeMap<String, String> {
    [
        ("commanded", report.commanded.to_string()),
        ("measured", report.measured.to_string()),
        ("lost", report.lost.to_string()),
        ("direction_changes", report.direction_changes.to_string()),
        ("illegal_transitions", report.illegal_transitions.to_string()),
        ("samples", report.samples.to_string()),
        ("interrupted", report.interrupted.to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

#[cfg(test)]
mod tests {
    use axis_worker::bench::Frequency;
    use axis_worker::motor::Load;
    use supersigma_config::MotorConfig;

    use super::*;

    #[test]
    fn a_recording_has_every_sample_and_every_pulse() {
        let motor = BenchMotor {
            name: "the bench motor".to_owned(),
            config: MotorConfig::bench(),
            load: Load { torque: 0.1, inertia: 1e-5 },
        };
        let train = Train::constant(Frequency::from_millihertz(300_000).expect("possible"), 30);
        let run = Run {
            motor: &motor,
            program: Program::Constant,
            train: train.expect("possible"),
            direction: Direction::Forward,
            sampling: Sampling::HIGHEST,
        };
        let mut recording = Recording::default();
        let mut calls = 0_u64;
        let watch = &mut |_: Tick| {
            calls += 1;
            ControlFlow::Continue(())
        };
        let report = run.go(None, Some(&mut recording), watch).expect("a motor that can be");
        assert!(report.is_confirmed(), "{report:?}");
        assert_eq!((recording.sampling_hertz, recording.counts_per_turn), (60_000, 8_000));
        assert_eq!(recording.positions.len() as u64, report.samples);
        assert_eq!(
            (recording.positions.first(), recording.positions.last()),
            (Some(&0), Some(&report.position))
        );
        assert_eq!(calls, report.samples.div_ceil(SAMPLES_OF_A_CALL));
        assert_eq!(recording.commanded.len(), 30);
        // 10 000 clocks of 1 µs for three pulses.
        let third = recording.commanded[2];
        assert_eq!((third.at, third.clocks), (Tick(20_000), 3_333));
        assert_eq!(recording.commanded[1].clocks, 3_334);
    }
}
