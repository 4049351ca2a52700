//! What is said to systemd's journal: if standard error is connected to it, lines have a priority in front (`<3>`, as in
//! `sd-daemon(3)`) and neither time nor colours, since the journal knows the one and keeps the other for ever.

use std::fmt::{self, Write as _};
use std::fs::File;
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::fmt::format::{FormatEvent, FormatFields, Writer};
use tracing_subscriber::fmt::{FmtContext, FormattedFields};
use tracing_subscriber::registry::{LookupSpan, Scope};

/// Whether standard error is the very stream that `JOURNAL_STREAM` names, by device and inode. If it has been redirected
/// since, it is not.
#[must_use]
pub fn is_connected() -> bool {
    let Ok(named) = std::env::var("JOURNAL_STREAM") else { return false };
    let stderr = std::io::stderr().as_fd().try_clone_to_owned().map(File::from);
    let Ok(file) = stderr.and_then(|stderr| stderr.metadata()) else { return false };
    named == format!("{}:{}", file.dev(), file.ino())
}

/// A message of priority 3, error; every line has its priority, since the journal takes each for an entry.
#[must_use]
pub fn error(text: &str) -> String {
    marked(3, text)
}

fn marked(priority: u8, text: &str) -> String {
    let lines: Vec<String> = text.lines().map(|line| format!("<{priority}>{line}")).collect();
    lines.join("\n")
}

/// `syslog(3)`'s number.
fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => 3,
        Level::WARN => 4,
        Level::INFO => 6,
        Level::DEBUG | Level::TRACE => 7,
    }
}

/// Events as lines of the journal: priority, place, message, fields.
pub(crate) struct Lines;

impl<S, N> FormatEvent<S, N> for Lines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut text = format!("{}: ", event.metadata().target());
        for span in context.event_scope().into_iter().flat_map(Scope::from_root) {
            let extensions = span.extensions();
            let fields = extensions.get::<FormattedFields<N>>().map_or("", |fields| fields.fields.as_str());
            write!(text, "{}{{{fields}}}: ", span.name())?;
        }
        context.format_fields(Writer::new(&mut text), event)?;
        writeln!(out, "{}", marked(priority(*event.metadata().level()), &text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_has_its_priority() {
        assert_eq!(error("a\nb"), "<3>a\n<3>b");
        assert_eq!(marked(priority(Level::WARN), "c"), "<4>c");
        assert_eq!([Level::INFO, Level::DEBUG, Level::TRACE].map(priority), [6, 7, 7]);
    }
}
