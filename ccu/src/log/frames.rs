//! `ccu frames`: the frames of a log, one line each, for people or as JSON.

use std::io::{self, Write};
use std::path::Path;

use supersigma_protocol::{Address, AxisNumber, Body, Frame};

use super::LogError;
use super::header::AxisNames;
use super::line::Lines;
use super::reader::LogReader;
use super::view::FrameView;

/// What was printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FramesCount {
    /// Lines with a frame.
    pub printed: u64,
    /// Frames that were read.
    pub read: u64,
    /// Whether the log ends before its footer.
    pub truncated: bool,
}

/// Prints the frames of the log at `path`: all, or with `axis` (a name or a number) those that are for this axis or
/// from it. With `json`, each is one JSON object on a line of its own; without, a title stands above them.
/// A reader of `out` who goes away ends the printing quietly.
///
/// # Errors
/// If the log cannot be read, has no such axis or is damaged (after everything readable has been printed), or `out`
/// cannot be written.
pub fn frames(
    path: &Path,
    axis: Option<&str>,
    json: bool,
    out: &mut dyn Write,
) -> Result<FramesCount, LogError> {
    let mut reader = LogReader::open(path)?;
    let mut count = FramesCount::default();
    let names = reader.header().map(|header| header.names.clone()).unwrap_or_default();
    let axis = axis.map(|name| find(path, &names, name)).transpose()?;
    let lines = Lines::new(&names);
    let printed = |result: io::Result<()>| match result {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        other => other.map(|()| true).map_err(LogError::Output),
    };
    if !json && !printed(writeln!(out, "{}", lines.title()))? {
        return Ok(count);
    }
    for logged in reader.by_ref() {
        let logged = logged?;
        count.read += 1;
        if axis.is_some_and(|axis| !logged.frame.as_ref().is_ok_and(|frame| concerns(frame, axis))) {
            continue;
        }
        let view = FrameView::new(&logged.bytes, logged.frame.as_ref(), &names);
        let written = if json {
            serde_json::to_writer(&mut *out, &view).map_err(io::Error::from).and_then(|()| writeln!(out))
        } else {
            writeln!(out, "{}", lines.line(&view))
        };
        if !printed(written)? {
            return Ok(count);
        }
        count.printed += 1;
    }
    printed(out.flush())?;
    count.truncated = reader.truncated();
    Ok(count)
}

fn find(path: &Path, names: &AxisNames, name: &str) -> Result<AxisNumber, LogError> {
    names.find(name).ok_or_else(|| LogError::NoSuchAxis {
        path: path.to_owned(),
        name: name.to_owned(),
        known: match names.iter().map(|(axis, name)| format!("{} {name}", axis.get())).collect::<Vec<_>>() {
            none if none.is_empty() => "none".to_owned(),
            known => known.join(", "),
        },
    })
}

/// Whether a frame is for this axis or from it.
pub(crate) fn concerns(frame: &Frame, axis: AxisNumber) -> bool {
    match &frame.body {
        Body::Command(command) => command
            .bytes
            .as_slice()
            .first()
            .is_some_and(|&to| [Address::EVERYONE, axis.address()].contains(&Address(to))),
        Body::Answer(answer) => answer.card == axis.address(),
        Body::Fault(failing, _) => *failing == axis,
    }
}
