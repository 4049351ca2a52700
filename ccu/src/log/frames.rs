//! `ccu frames`: the frames of a log, one line each, for people, as JSON or as a table.

use std::io::{self, Write};
use std::path::Path;

use supersigma_protocol::{AxisNumber, Tick};

use super::LogError;
use super::filter::{Filter, operation};
use super::header::AxisNames;
use super::line::Lines;
use super::reader::LogReader;
use super::table::{COLUMNS, Row};
use super::view::FrameView;

/// How frames are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// In aligned columns, with a title above them.
    #[default]
    People,
    /// One JSON object on a line each.
    Json,
    /// Comma-separated values (RFC 4180, lines ending with LF), with the columns' titles above them.
    Csv,
}

/// What is asked of a log; nothing named is everything.
#[derive(Debug, Clone, Copy, Default)]
pub struct FramesAsked<'a> {
    /// The frames for this axis or from it: a name or a number.
    pub axis: Option<&'a str>,
    /// The frames from this tick on.
    pub from: Option<Tick>,
    /// The frames before this tick.
    pub to: Option<Tick>,
    /// The commands of this operation, and the answers to them.
    pub operation: Option<&'a str>,
    /// How they are printed.
    pub form: Form,
}

/// What was printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FramesCount {
    /// Frames that were printed.
    pub printed: u64,
    /// Frames that were read.
    pub read: u64,
    /// Whether the log ends before its footer.
    pub truncated: bool,
}

/// Prints those frames of the log at `path` that are `asked` for. A reader of `out` who goes away ends the printing
/// quietly.
///
/// # Errors
/// If the log cannot be read, has no such axis or is damaged (after everything readable has been printed), if there is
/// no such operation, or if `out` cannot be written.
pub fn frames(path: &Path, asked: &FramesAsked<'_>, out: &mut dyn Write) -> Result<FramesCount, LogError> {
    let mut reader = LogReader::open(path)?;
    let Some(header) = reader.header() else {
        return Ok(FramesCount { truncated: true, ..FramesCount::default() });
    };
    let (names, timeline) = (header.names.clone(), header.timeline);
    let operation = asked.operation.map(|name| {
        operation(name).map_err(|known| LogError::NoSuchOperation { name: name.to_owned(), known })
    });
    let filter = Filter {
        axis: asked.axis.map(|name| find(path, &names, name)).transpose()?,
        from: asked.from,
        to: asked.to,
        operation: operation.transpose()?,
    };
    if let Some(times) = filter.log_times(&timeline) {
        reader.narrow(&times)?;
    }
    let mut judge = filter.start(timeline);
    let mut printer = Printer::new(asked.form, &names, out);
    let mut count = FramesCount::default();
    let heard = |result: io::Result<()>| match result {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        other => other.map(|()| true).map_err(LogError::Output),
    };
    if !heard(printer.title())? {
        return Ok(count);
    }
    for logged in reader.by_ref() {
        let logged = match logged {
            Ok(logged) => logged,
            Err(damage) => {
                heard(printer.flush())?;
                return Err(damage);
            }
        };
        count.read += 1;
        if judge.wants(&logged) {
            let view = FrameView::new(&logged.bytes, logged.frame.as_ref(), &names);
            if !heard(printer.frame(&view))? {
                return Ok(count);
            }
            count.printed += 1;
        }
    }
    heard(printer.flush())?;
    count.truncated = reader.truncated();
    Ok(count)
}

enum Printer<'a> {
    People(Lines, &'a mut dyn Write),
    Json(&'a mut dyn Write),
    Csv(Box<csv::Writer<&'a mut dyn Write>>),
}

impl<'a> Printer<'a> {
    fn new(form: Form, names: &AxisNames, out: &'a mut dyn Write) -> Self {
        match form {
            Form::People => Self::People(Lines::new(names), out),
            Form::Json => Self::Json(out),
            Form::Csv => Self::Csv(Box::new(csv::WriterBuilder::new().has_headers(false).from_writer(out))),
        }
    }

    fn title(&mut self) -> io::Result<()> {
        match self {
            Self::People(lines, out) => writeln!(out, "{}", lines.title()),
            Self::Json(_) => Ok(()),
            Self::Csv(table) => table.write_record(COLUMNS).map_err(plain),
        }
    }

    fn frame(&mut self, view: &FrameView<'_>) -> io::Result<()> {
        match self {
            Self::People(lines, out) => writeln!(out, "{}", lines.line(view)),
            Self::Json(out) => {
                serde_json::to_writer(&mut *out, view).map_err(io::Error::from)?;
                writeln!(out)
            }
            Self::Csv(table) => table.serialize(Row::from(view)).map_err(plain),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::People(_, out) | Self::Json(out) => out.flush(),
            Self::Csv(table) => table.flush(),
        }
    }
}

/// The system's own error: wrapped in the table's, a reader who went away could not be told from a full disk.
fn plain(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    }
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
