//! `ccu replay --verify`: what the verification has found, for people and for programs.

use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use miette::IntoDiagnostic;
use serde::Serialize;
use serde_json::{Map, Value};
use supersigma_protocol::{Address, Frame, FrameError, Tick};

use super::{Nothing, config_of, log_error, other_version};
use crate::cli::exit::Exit;
use crate::cli::show;
use crate::log::{AxisNames, FrameView, LogError, TwinReader, Twinned};
use crate::replay::{Difference, DifferenceKind, ReplayError, Setting, Verification, Verifier};

/// The result, for programs.
#[derive(Debug, Serialize)]
struct ResultView<'a> {
    /// `identical`, `different` or `unverifiable`.
    result: &'static str,
    frames: u64,
    answers: u64,
    cards: usize,
    lives: u64,
    machine_s: f64,
    took_s: f64,
    /// Machine time through real time.
    speed: f64,
    /// Whether the log ends in the middle of a record.
    truncated: bool,
    /// The file in which it goes on all the same; that is not verified.
    goes_on_in: Option<&'a Path>,
    /// The version that wrote the log.
    version: &'a str,
    difference: Option<DifferenceView>,
    unverifiable: Vec<UnverifiableView>,
}

#[derive(Debug, Serialize)]
struct DifferenceView {
    frame: u64,
    time_s: f64,
    reason: String,
    recorded: Value,
    due: Value,
    /// The keys whose values differ.
    fields: Vec<String>,
}

#[derive(Debug, Serialize)]
struct UnverifiableView {
    card: u8,
    name: String,
    frame: u64,
    time_s: f64,
    reason: String,
}

pub(super) fn verify(path: &Path, json: bool) -> Result<(), Exit> {
    let began = Instant::now();
    let mut reader = TwinReader::open(path).map_err(log_error)?;
    let header = reader.header().cloned().ok_or_else(|| Exit::with_code(2, Nothing(path.to_owned())))?;
    let config = config_of(path, &header)?;
    let setting = Setting { config: &config, names: &header.names, twins: true };
    let mut verifier = Verifier::new(setting);
    let bar = progress();
    // What stands before a damage is verified all the same.
    let broken = read(&mut reader, &mut verifier, &bar);
    bar.finish_and_clear();
    let found = verifier.finish();
    let goes_on_in = if reader.truncated() { reader.next_file().map_err(log_error)? } else { None };
    let result = Told { found: &found, names: &header.names, took: began.elapsed() };
    let mut out = io::stdout().lock();
    if json {
        let view = result.view(reader.truncated(), goes_on_in.as_deref(), &header.version);
        show::print_json(&view, &mut out)?;
    } else {
        result.print(&mut out)?;
    }
    out.flush()?;
    if reader.truncated() {
        eprintln!(
            "the log ends in the middle of a record; the {} frames before that are verified",
            found.frames
        );
    }
    if let Some(next) = &goes_on_in {
        eprintln!(
            "the log goes on in {}: its recorder was started again, and what happened meanwhile nobody knows; from \
             there on nothing is verified",
            next.display()
        );
    }
    if let Some(version) = other_version(&header) {
        let ours = crate::log::LogHeader::VERSION;
        eprintln!("the log was written by version {version} of this program, and verified by {ours}");
    }
    match broken {
        Err(ReplayError::Log(error @ LogError::Damaged { .. })) => {
            Err(error).into_diagnostic().map_err(Exit::could_not)
        }
        Err(ReplayError::Log(error)) => Err(log_error(error)),
        Err(error) => Err(error).into_diagnostic().map_err(Exit::wrong),
        Ok(()) if found.is_identical() => Ok(()),
        Ok(()) => Err(Exit::silent(1)),
    }
}

/// Frames that are read while others are being verified: so many at a time, and so many times.
const BATCH: usize = 1_024;
const BATCHES: usize = 8;

/// Reading and verifying take about as long, so each has a thread of its own.
fn read(reader: &mut TwinReader, verifier: &mut Verifier<'_>, bar: &ProgressBar) -> Result<(), ReplayError> {
    thread::scope(|scope| {
        let (batches, read) = mpsc::sync_channel::<Vec<Result<Twinned, LogError>>>(BATCHES);
        scope.spawn(move || {
            loop {
                let batch: Vec<_> = reader.by_ref().take(BATCH).collect();
                // Whoever has found a difference reads no further.
                if batch.is_empty() || batches.send(batch).is_err() {
                    break;
                }
            }
        });
        for batch in read {
            for twinned in batch {
                if !verifier.take(twinned?)? {
                    return Ok(());
                }
            }
            let found = verifier.found();
            let seconds = found.machine_time().as_seconds();
            bar.set_message(format!("{} frames, {seconds:.0} s of machine time", grouped(found.frames)));
            bar.tick();
        }
        Ok(())
    })
}

/// A log does not say how long it is before its end, so this shows how far it is.
fn progress() -> ProgressBar {
    if io::stderr().is_terminal() { ProgressBar::new_spinner() } else { ProgressBar::hidden() }
}

/// What has been found, and how long it took.
struct Told<'a> {
    found: &'a Verification,
    names: &'a AxisNames,
    took: Duration,
}

impl Told<'_> {
    fn speed(&self) -> f64 {
        self.found.machine_time().as_seconds() / self.took.as_secs_f64().max(1e-9)
    }

    fn view<'b>(&self, truncated: bool, goes_on_in: Option<&'b Path>, version: &'b str) -> ResultView<'b> {
        let found = self.found;
        ResultView {
            result: match (&found.difference, found.unverifiable.is_empty()) {
                (Some(_), _) => "different",
                (None, false) => "unverifiable",
                (None, true) => "identical",
            },
            frames: found.frames,
            answers: found.answers,
            cards: found.cards,
            lives: found.lives,
            machine_s: found.machine_time().as_seconds(),
            took_s: self.took.as_secs_f64(),
            speed: self.speed(),
            truncated,
            goes_on_in,
            version,
            difference: found.difference.as_ref().map(|difference| self.difference(difference)),
            unverifiable: found
                .unverifiable
                .iter()
                .map(|one| UnverifiableView {
                    card: one.card.0,
                    name: self.card(one.card),
                    frame: one.number,
                    time_s: seconds(one.tick),
                    reason: one.why.to_string(),
                })
                .collect(),
        }
    }

    fn difference(&self, difference: &Difference) -> DifferenceView {
        let (recorded, due) = self.sides(difference);
        let rows = rows(&recorded, &due);
        DifferenceView {
            frame: difference.number,
            time_s: seconds(difference.tick),
            reason: difference.kind.to_string(),
            recorded,
            due,
            fields: rows.into_iter().filter(|row| row.differs).map(|row| row.key).collect(),
        }
    }

    /// What stands in the log, and what should.
    fn sides(&self, difference: &Difference) -> (Value, Value) {
        let recorded = self.decoded(&difference.bytes, &difference.recorded);
        let parsed = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| Value::from(text));
        match &difference.kind {
            DifferenceKind::Answer(frame) => {
                (recorded, self.decoded(&frame.encode(), &Ok((**frame).clone())))
            }
            DifferenceKind::Twin { recorded: twin, due } => {
                (due.as_deref().map_or(recorded, parsed), parsed(twin))
            }
            DifferenceKind::Silence
            | DifferenceKind::NoTwin
            | DifferenceKind::SentBeforeActing
            | DifferenceKind::SentBackwards(_)
            | DifferenceKind::ActedTooSoon(_)
            | DifferenceKind::ActedBackwards(_) => (recorded, Value::Null),
        }
    }

    fn decoded(&self, bytes: &[u8], frame: &Result<Frame, FrameError>) -> Value {
        serde_json::to_value(FrameView::new(bytes, frame.as_ref(), self.names)).unwrap_or_default()
    }

    fn card(&self, card: Address) -> String {
        match card.kind() {
            supersigma_protocol::CardKind::Axis(axis) => self.names.of(axis).into_owned(),
            _ => card.to_string(),
        }
    }

    fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let found = self.found;
        let word = if found.is_identical() { "identical" } else { "verified" };
        writeln!(
            out,
            "{word}: {} answers of {} cards, {} s of machine time in {:.2} s ({} × real time)",
            grouped(found.answers),
            found.cards,
            decimal(found.machine_time().as_seconds()),
            self.took.as_secs_f64(),
            decimal(self.speed())
        )?;
        if found.undecodable > 0 {
            writeln!(
                out,
                "{} times there were bytes on the bus that no card sends",
                grouped(found.undecodable)
            )?;
        }
        for one in &found.unverifiable {
            writeln!(
                out,
                "not verifiable: {} from frame {} at {:.7} s on: {}",
                self.card(one.card),
                one.number,
                seconds(one.tick),
                one.why
            )?;
        }
        let Some(difference) = &found.difference else { return Ok(()) };
        writeln!(
            out,
            "different: frame {} at {:.7} s: {}",
            difference.number,
            seconds(difference.tick),
            difference.kind
        )?;
        let (recorded, due) = self.sides(difference);
        let titles = match difference.kind {
            DifferenceKind::Twin { .. } | DifferenceKind::NoTwin => ("the raw frame", "its twin"),
            _ => ("the log", "the machine"),
        };
        out.write_all(side_by_side(titles, &rows(&recorded, &due)).as_bytes())
    }
}

fn seconds(tick: Tick) -> f64 {
    tick.since(Tick(0)).as_seconds()
}

/// A field of two frames.
struct Row {
    key: String,
    left: String,
    right: String,
    differs: bool,
}

/// The fields of both frames, in the order of the first one's.
fn rows(left: &Value, right: &Value) -> Vec<Row> {
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    flatten("", left, &mut ours);
    flatten("", right, &mut theirs);
    // A twin leaves out what is null.
    ours.retain(|(_, value)| value != "null");
    theirs.retain(|(_, value)| value != "null");
    let of = |fields: &[(String, String)], key: &str| {
        fields
            .iter()
            .find(|(other, _)| other == key)
            .map_or_else(|| "-".to_owned(), |(_, value)| value.clone())
    };
    let mut keys: Vec<String> = ours.iter().map(|(key, _)| key.clone()).collect();
    keys.extend(
        theirs.iter().map(|(key, _)| key.clone()).filter(|key| !ours.iter().any(|(our, _)| our == key)),
    );
    // The decoded frame says what kind it is; a twin's channel does.
    keys.retain(|key| key != "kind");
    keys.into_iter()
        .map(|key| {
            let (left, right) = (of(&ours, &key), of(&theirs, &key));
            Row { differs: left != right, key, left, right }
        })
        .collect()
}

fn flatten(prefix: &str, value: &Value, into: &mut Vec<(String, String)>) {
    let name = |key: &str| if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") };
    match value {
        Value::Object(fields) => flatten_all(fields, &name, into),
        Value::String(text) => into.push((prefix.to_owned(), text.clone())),
        other => into.push((prefix.to_owned(), other.to_string())),
    }
}

fn flatten_all(fields: &Map<String, Value>, name: &dyn Fn(&str) -> String, into: &mut Vec<(String, String)>) {
    for (key, value) in fields {
        flatten(&name(key), value, into);
    }
}

fn side_by_side((left, right): (&str, &str), rows: &[Row]) -> String {
    let width = |of: fn(&Row) -> &str, title: &str| {
        rows.iter().map(|row| of(row).chars().count()).max().unwrap_or(0).max(title.len())
    };
    let (keys, lefts) = (width(|row| &row.key, ""), width(|row| &row.left, left));
    let mut text = format!("  {:<keys$}  {left:<lefts$}    {right}\n", "");
    for row in rows {
        let mark = if row.differs { "≠" } else { " " };
        let _ = writeln!(text, "  {:<keys$}  {:<lefts$}  {mark} {}", row.key, row.left, row.right);
    }
    text
}

/// A number with its thousands apart, as in `12 345`.
pub(super) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// Whole from a hundred on, with two decimals below.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "for people, and positive")]
fn decimal(number: f64) -> String {
    if number < 100.0 { format!("{number:.2}") } else { grouped(number.round() as u64) }
}
