//! What commands print: aligned, with units, for people; JSON with stable keys for programs. Nothing is decided here.

use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};
use std::mem;
use std::time::Duration;

use serde::Serialize;
use supersigma_config::Config;
use supersigma_protocol::{AxisReport, Deviation, Pace};

use crate::control::{Description, RecorderState, RecorderView};
use crate::executive::{AxisState, Knowledge, Movement, MovementKind, Recovery};

/// A recorder that is further behind the bus than this is worth a word.
const BEHIND_MS: u64 = 200;

/// A movement, for programs.
#[derive(Debug, Serialize)]
pub(super) struct MovementView<'a> {
    axis: u8,
    name: &'a str,
    kind: MovementKind,
    asked: Option<i64>,
    done: u32,
    sense: String,
    ticks: u64,
    seconds: f64,
    position: Option<i32>,
    lost: Option<i32>,
    recovered: Option<Recovery>,
}

impl<'a> MovementView<'a> {
    pub(super) fn new(movement: &Movement, knowledge: &'a Knowledge) -> Self {
        Self {
            axis: movement.axis.get(),
            name: knowledge.name(movement.axis),
            kind: movement.kind,
            asked: movement.asked.map(|asked| asked.0),
            done: movement.done.0,
            sense: movement.sense.to_string(),
            ticks: movement.took.0,
            seconds: movement.took.as_seconds(),
            position: movement.position.map(|position| position.0),
            lost: movement.lost.map(|lost| lost.0),
            recovered: movement.recovered,
        }
    }
}

/// The titles over [`movement_line`].
pub(super) fn movement_title() -> String {
    format!(
        "{:<12} {:<9} {:>8} {:>8}  {:<6} {:>9}  {:>9}",
        "axis", "movement", "asked", "done", "X1..X5", "seconds", "position"
    )
}

/// A movement in a line.
pub(super) fn movement_line(movement: &Movement, knowledge: &Knowledge) -> String {
    let asked = movement.asked.map_or_else(|| "-".into(), |asked| format!("{:+}", asked.0));
    let position = movement.position.map_or_else(|| "unknown".into(), |position| position.to_string());
    let mut notes = String::new();
    if let Some(Deviation(lost @ (..=-1 | 1..))) = movement.lost {
        let _ = write!(notes, "  {lost:+} steps from where it was believed to be");
    }
    if let Some(recovered) = movement.recovered {
        let _ = write!(notes, "  {recovered}");
    }
    format!(
        "{:<12} {:<9} {:>8} {:>8}  {:<6} {:>9.3}  {:>9}{notes}",
        knowledge.name(movement.axis),
        movement.kind,
        asked,
        movement.done.0,
        movement.sense,
        movement.took.as_seconds(),
        position
    )
}

/// An axis' state, for programs.
#[derive(Debug, Serialize)]
pub(super) struct AxisView<'a> {
    axis: u8,
    name: &'a str,
    alive: bool,
    activity: Option<supersigma_protocol::Activity>,
    /// X1..X5 as digits, X1 first.
    sense: Option<String>,
    steps: Option<u32>,
    position: Option<i32>,
    /// Steps per second, negative towards the origin.
    speed: Option<f64>,
    lost: Option<i32>,
    alarm: Option<AlarmView>,
}

#[derive(Debug, Serialize)]
struct AlarmView {
    cause: supersigma_protocol::Alarm,
    message: String,
}

impl<'a> AxisView<'a> {
    pub(super) fn new(state: &AxisState, config: &'a Config) -> Self {
        let report = state.report.as_ref();
        Self {
            axis: state.axis.get(),
            name: config.axis(state.axis).map_or("?", |axis| &axis.name),
            alive: report.is_some(),
            activity: report.map(|report| report.activity),
            sense: report.map(|report| report.sense.to_string()),
            steps: report.map(|report| report.steps.0),
            position: report.and_then(|report| report.position).map(|position| position.0),
            speed: report.map(speed),
            lost: report.and_then(|report| report.lost).map(|lost| lost.0),
            alarm: report
                .and_then(|report| report.alarm)
                .map(|cause| AlarmView { cause, message: cause.to_string() }),
        }
    }
}

/// The axes as a table.
pub(super) fn axes(states: &[AxisState], config: &Config, out: &mut dyn Write) -> io::Result<()> {
    writeln!(
        out,
        "{:>4} {:<12} {:<17} {:<6} {:>6} {:>8} {:>7}  alarm",
        "axis", "name", "state", "X1..X5", "steps", "position", "steps/s"
    )?;
    for state in states {
        let name = config.axis(state.axis).map_or("?", |axis| &axis.name);
        match state.report {
            Some(report) => {
                let AxisReport { sense, steps, position, activity, alarm, .. } = report;
                let position = position.map_or_else(|| "unknown".into(), |position| position.to_string());
                let alarm = alarm.map_or_else(|| "-".into(), |alarm| alarm.to_string());
                writeln!(
                    out,
                    "{:>4} {name:<12} {activity:<17} {sense:<6} {:>6} {position:>8} {:>7.0}  {alarm}",
                    state.axis.get(),
                    steps.0,
                    speed(&report)
                )?;
            }
            None => writeln!(out, "{:>4} {name:<12} its worker is gone", state.axis.get())?,
        }
    }
    Ok(())
}

/// In steps per second, negative towards the origin.
fn speed(report: &AxisReport) -> f64 {
    report.pace.map_or(0.0, Pace::steps_per_second)
}

/// The set and its log, below its axes.
pub(super) fn set(set: &Description, frames_a_second: Option<f64>, out: &mut dyn Write) -> io::Result<()> {
    let rate = frames_a_second.map(|rate| format!("{rate:.0} frames/s, ")).unwrap_or_default();
    let Description { name, up_s, time_scale, frames, lost, .. } = set;
    writeln!(
        out,
        "\nset {name}: up {up_s:.0} s, time scale {time_scale}, {rate}{frames} frames, {lost} lost"
    )?;
    let RecorderView { state, log, parts, frames, lost, bytes, behind_ms, trouble } = &set.recorder;
    let what = match (state, trouble) {
        (RecorderState::Recording, None) => "log",
        (RecorderState::DiskFull, _) => "DISK FULL, NO LOG ANY MORE, was",
        (RecorderState::Recording | RecorderState::Stopped, _) => "NO LOG ANY MORE, was",
    };
    write!(out, "{what} {}", log.display())?;
    if parts.len() > 1 {
        write!(out, ", file {} of it", parts.len())?;
    }
    write!(out, ": {frames} frames, {}", size(*bytes))?;
    if *lost > 0 {
        write!(out, ", {lost} FRAMES ARE MISSING")?;
    }
    if *behind_ms > BEHIND_MS {
        write!(out, ", {behind_ms} ms behind")?;
    }
    writeln!(out)?;
    match trouble {
        Some(trouble) => writeln!(out, "{}; nothing moves without a log\n{}", trouble.reason, trouble.advice),
        None => Ok(()),
    }
}

/// How many of something there are in a second.
#[expect(clippy::cast_precision_loss, reason = "for people")]
pub(super) fn per_second(many: u64, time: Duration) -> f64 {
    many as f64 / time.as_secs_f64().max(f64::EPSILON)
}

/// Named lines of a digital card.
pub(super) fn digital<'a>(
    word: u16,
    lines: impl Iterator<Item = (u8, &'a str)>,
    json: bool,
    out: &mut dyn Write,
) -> io::Result<()> {
    let level = |bit: u8| word >> bit & 1 == 1;
    if json {
        let lines: serde_json::Map<_, _> =
            lines.map(|(bit, name)| (name.to_owned(), level(bit).into())).collect();
        return print_json(&serde_json::json!({ "word": word, "lines": lines }), out);
    }
    for (bit, name) in lines {
        writeln!(out, "{bit:>3} {name:<16} {}", if level(bit) { "on" } else { "off" })?;
    }
    Ok(())
}

/// One JSON object, on a line.
pub(super) fn print_json(value: &impl Serialize, out: &mut dyn Write) -> io::Result<()> {
    let text = serde_json::to_string(value)?;
    writeln!(out, "{text}")
}

/// A number of bytes for people.
#[expect(clippy::cast_precision_loss, reason = "for people")]
pub(super) fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// Pictures that follow each other: on a terminal each takes the place of the one before, on a screen of their own;
/// elsewhere they stand one below the other.
pub(super) struct Pictures {
    on_a_terminal: bool,
    apart: bool,
    first: bool,
}

impl Pictures {
    /// The first is to come. `apart`, with an empty line between them where they stand below each other.
    pub(super) fn new(apart: bool) -> Self {
        Self { on_a_terminal: apart && io::stdout().is_terminal(), apart, first: true }
    }

    /// Shows the next one, in one piece, so that it does not flicker.
    pub(super) fn show(&mut self, picture: &[u8]) -> io::Result<()> {
        let mut whole = Vec::with_capacity(picture.len() + 64);
        let first = mem::replace(&mut self.first, false);
        if self.on_a_terminal {
            whole.extend_from_slice(if first { b"\x1b[?1049h\x1b[?25l\x1b[H" } else { b"\x1b[H" });
            for line in picture.split_inclusive(|byte| *byte == b'\n') {
                whole.extend_from_slice(line.strip_suffix(b"\n").unwrap_or(line));
                whole.extend_from_slice(b"\x1b[K\r\n");
            }
            whole.extend_from_slice(b"\x1b[J");
        } else {
            if self.apart && !first {
                whole.push(b'\n');
            }
            whole.extend_from_slice(picture);
        }
        let mut out = io::stdout().lock();
        out.write_all(&whole)?;
        out.flush()
    }
}

impl Drop for Pictures {
    fn drop(&mut self) {
        if self.on_a_terminal && !self.first {
            // If the terminal is gone, there is nothing to give back.
            let _ = io::stdout().write_all(b"\x1b[?25h\x1b[?1049l");
            let _ = io::stdout().flush();
        }
    }
}
