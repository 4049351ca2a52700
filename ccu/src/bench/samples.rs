//! The samples of a run in a file, row by row as they come: an MCAP that viewers plot, or CSV. Nothing is held but the chunk
//! that is being filled. It does not know what the samples mean.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use axis_worker::bench::Sample;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, WriteOptions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use supersigma_protocol::Tick;

use super::BenchMotor;
use crate::log::{ENCODING, LogFile, SCHEMA_ENCODING, WallTime, view_schema};

/// The topic of the samples.
const TOPIC: &str = "/bench";
const SCHEMA: &str = "supersigma.BenchSample";
/// The metadata record, and the profile of the file.
const METADATA: &str = "supersigma.bench";
/// What is known at the end.
const OUTCOME: &str = "supersigma.bench.outcome";
/// The motor, with its load, as JSON.
const MOTOR: &str = "motor.json";
const TITLE: &str = "time_s,position,l,r,commanded,measured,frequency";
/// A chunk: half a second at the least.
const SAMPLES_OF_A_CHUNK: u64 = 8_192;
const TICK_NS: u64 = 1_000_000_000 / Tick::PER_SECOND;

/// A message of the topic `/bench`, and a row of the CSV.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SampleView {
    /// Seconds since the start of the pulse train
    pub time_s: f64,
    /// Counts of the encoder, L less R: 1/8000 turns with a disc of 2 000 lines
    pub position: i64,
    /// Pulses on L, clockwise, since the start
    pub l: u64,
    /// Pulses on R, anticlockwise, since the start
    pub r: u64,
    /// Pulses given to the motor, half steps; negative towards the origin
    pub commanded: i64,
    /// The position in half steps
    pub measured: f64,
    /// That of the last pulse, pulses per second; 0 before the first
    pub frequency: f64,
}

/// What can go wrong with a file of samples.
#[derive(Debug, thiserror::Error)]
pub enum SampleError {
    /// Measurements are never overwritten.
    #[error("{} exists already; choose another name or move it away", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be made.
    #[error("cannot create {}: {error}", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// A full disk, for example. An MCAP is whole up to the last chunk then.
    #[error("cannot write {}: {error}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system or the format said.
        error: McapError,
    },
}

/// How samples are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleForm {
    /// For viewers.
    Mcap,
    /// For tables.
    Csv,
}

impl SampleForm {
    /// By the name's end: `.mcap` or `.csv`.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "mcap" => Some(Self::Mcap),
            "csv" => Some(Self::Csv),
            _ => None,
        }
    }
}

/// A file that is being written.
pub struct SampleFile {
    path: PathBuf,
    writer: Writer,
    half_steps_per_count: f64,
    row: Vec<u8>,
}

enum Writer {
    Mcap { mcap: Box<mcap::Writer<LogFile>>, channel: u16, epoch: WallTime, samples: u64 },
    Csv(BufWriter<File>),
}

impl SampleFile {
    /// Begins a file, which must not exist yet. `about` is what is known of the run, by name; the time 0 of the samples is
    /// `epoch` in an MCAP.
    ///
    /// # Errors
    /// If it exists, or cannot be made or written.
    pub fn create(
        path: &Path,
        form: SampleForm,
        motor: &BenchMotor,
        about: &BTreeMap<String, String>,
        epoch: WallTime,
    ) -> Result<Self, SampleError> {
        let writer = match form {
            SampleForm::Mcap => {
                let file = LogFile::create(path).map_err(|error| not_created(path, error))?;
                begin_mcap(file, motor, about, epoch).map_err(|error| {
                    // It was made just now, and holds nothing.
                    let _ = fs::remove_file(path);
                    SampleError::Write { path: path.to_owned(), error }
                })?
            }
            SampleForm::Csv => begin_csv(path)?,
        };
        let half_steps_per_count =
            f64::from(motor.config.half_steps_per_turn) / f64::from(motor.counts_per_turn());
        Ok(Self { path: path.to_owned(), writer, half_steps_per_count, row: Vec::new() })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a sample.
    ///
    /// # Errors
    /// If it cannot be written. An MCAP is whole up to the last chunk then.
    pub fn write(&mut self, sample: &Sample) -> Result<(), SampleError> {
        let Self { path, writer, half_steps_per_count, row } = self;
        row.clear();
        let written = match writer {
            Writer::Mcap { mcap, channel, epoch, samples } => {
                let time = epoch.0 + sample.at.0 * TICK_NS;
                json_row(sample, *half_steps_per_count, row).map_err(McapError::from).and_then(|()| {
                    let header = MessageHeader {
                        channel_id: *channel,
                        // The format has 32 bits for it; they wrap.
                        sequence: (*samples & u64::from(u32::MAX)).try_into().unwrap_or_default(),
                        log_time: time,
                        publish_time: time,
                    };
                    *samples += 1;
                    mcap.write_to_known_channel(&header, row)?;
                    if samples.is_multiple_of(SAMPLES_OF_A_CHUNK) { mcap.flush() } else { Ok(()) }
                })
            }
            Writer::Csv(file) => csv_row(sample, *half_steps_per_count, row)
                .and_then(|()| file.write_all(row))
                .map_err(McapError::from),
        };
        written.map_err(|error| SampleError::Write { path: path.clone(), error })
    }

    /// Ends the file, with what came of the run if its form has a place for that.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self, outcome: BTreeMap<String, String>) -> Result<(), SampleError> {
        let finished = match self.writer {
            Writer::Mcap { mut mcap, .. } => mcap
                .write_metadata(&Metadata { name: OUTCOME.to_owned(), metadata: outcome })
                .and_then(|()| mcap.flush())
                .and_then(|()| mcap.finish().map(|_| ()))
                .and_then(|()| Ok(mcap.into_inner().finish().map(|_| ())?)),
            Writer::Csv(mut file) => file.flush().map_err(McapError::from),
        };
        finished.map_err(|error| SampleError::Write { path: self.path, error })
    }
}

fn not_created(path: &Path, error: io::Error) -> SampleError {
    match error.kind() {
        io::ErrorKind::AlreadyExists => SampleError::Exists { path: path.to_owned() },
        _ => SampleError::Create { path: path.to_owned(), error },
    }
}

fn begin_mcap(
    file: LogFile,
    motor: &BenchMotor,
    about: &BTreeMap<String, String>,
    epoch: WallTime,
) -> Result<Writer, McapError> {
    let mut mcap =
        WriteOptions::new().profile(METADATA).compression_threads(0).disable_seeking(true).create(file)?;
    let loaded = serde_json::to_vec(&motor.load.on(&motor.config)).map_err(io::Error::from)?;
    mcap.attach(&Attachment {
        log_time: epoch.0,
        create_time: epoch.0,
        name: MOTOR.to_owned(),
        media_type: "application/json".to_owned(),
        data: loaded.into(),
    })?;
    mcap.write_metadata(&Metadata { name: METADATA.to_owned(), metadata: about.clone() })?;
    let schema = view_schema::<SampleView>().to_string();
    let schema = mcap.add_schema(SCHEMA, SCHEMA_ENCODING, schema.as_bytes())?;
    let channel = mcap.add_channel(schema, TOPIC, ENCODING, &BTreeMap::new())?;
    mcap.flush()?;
    Ok(Writer::Mcap { mcap: Box::new(mcap), channel, epoch, samples: 0 })
}

fn begin_csv(path: &Path) -> Result<Writer, SampleError> {
    let file = File::create_new(path).map_err(|error| not_created(path, error))?;
    let mut file = BufWriter::with_capacity(1 << 16, file);
    writeln!(file, "{TITLE}")
        .map_err(|error| SampleError::Write { path: path.to_owned(), error: error.into() })?;
    Ok(Writer::Csv(file))
}

/// [`SampleView`] as JSON, written by hand: there may be millions, and ticks are exact in decimals.
fn json_row(sample: &Sample, half_steps_per_count: f64, row: &mut Vec<u8>) -> io::Result<()> {
    let Numbers { seconds, places, position, measured, frequency } =
        Numbers::of(sample, half_steps_per_count);
    let Sample { l, r, commanded, .. } = sample;
    write!(
        row,
        "{{\"time_s\":{seconds}.{places:07},\"position\":{position},\"l\":{l},\"r\":{r},\
         \"commanded\":{commanded},\"measured\":{measured:.3},\"frequency\":{frequency:.3}}}"
    )
}

fn csv_row(sample: &Sample, half_steps_per_count: f64, row: &mut Vec<u8>) -> io::Result<()> {
    let Numbers { seconds, places, position, measured, frequency } =
        Numbers::of(sample, half_steps_per_count);
    let Sample { l, r, commanded, .. } = sample;
    writeln!(row, "{seconds}.{places:07},{position},{l},{r},{commanded},{measured:.3},{frequency:.3}")
}

/// What is not in a sample as it is.
struct Numbers {
    seconds: u64,
    /// Seven decimals of a second: a tick is 0.000 000 5 s.
    places: u64,
    position: i64,
    measured: f64,
    frequency: f64,
}

impl Numbers {
    #[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
    fn of(sample: &Sample, half_steps_per_count: f64) -> Self {
        let position = sample.position().0;
        Self {
            seconds: sample.at.0 / Tick::PER_SECOND,
            places: sample.at.0 % Tick::PER_SECOND * 5,
            position,
            measured: position as f64 * half_steps_per_count,
            frequency: sample.period.map_or(0.0, axis_worker::bench::Period::hertz),
        }
    }
}

#[cfg(test)]
mod tests {
    use axis_worker::bench::Period;

    use super::*;

    fn sample() -> Sample {
        Sample { number: 5, at: Tick(2_000_001), l: 12, r: 25, commanded: -1, period: Period::new(3) }
    }

    #[test]
    fn a_row_is_its_view() {
        let mut row = Vec::new();
        json_row(&sample(), 0.05, &mut row).expect("memory");
        let view: SampleView = serde_json::from_slice(&row).expect("a view");
        let expected = SampleView {
            time_s: 1.000_000_5,
            position: -13,
            l: 12,
            r: 25,
            commanded: -1,
            measured: -0.65,
            frequency: 333_333.333,
        };
        assert_eq!(view, expected);
        row.clear();
        csv_row(&Sample { period: None, ..sample() }, 0.05, &mut row).expect("memory");
        assert_eq!(String::from_utf8(row).expect("text"), "1.0000005,-13,12,25,-1,-0.650,0.000\n");
        assert_eq!(TITLE.split(',').count(), 7);
    }

    #[test]
    fn the_form_is_the_name_s_end() {
        let form = |name: &str| SampleForm::of(Path::new(name));
        assert_eq!(form("a/b.mcap"), Some(SampleForm::Mcap));
        assert_eq!(form("b.CSV"), Some(SampleForm::Csv));
        assert_eq!(form("b.txt"), None);
        assert_eq!(form("mcap"), None);
    }
}
