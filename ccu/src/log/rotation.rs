//! When a log goes on in another file, and how that is called. Nothing is opened in here.

use std::path::{Path, PathBuf};
use std::time::Duration;

use supersigma_config::LogConfig;

/// When a part of the log is long enough. By default never.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rotation {
    /// At this length of the file in bytes.
    pub bytes: Option<u64>,
    /// After this real time.
    pub time: Option<Duration>,
}

impl Rotation {
    /// Whether a part of this length, begun so long ago, is long enough.
    pub(super) fn is_due(self, bytes: u64, age: Duration) -> bool {
        self.bytes.is_some_and(|limit| bytes >= limit) || self.time.is_some_and(|limit| age >= limit)
    }
}

impl From<&LogConfig> for Rotation {
    fn from(config: &LogConfig) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the configuration's rules have it positive, and the cast saturates"
        )]
        let bytes = config.rotate_mb.map(|megabytes| (megabytes * 1e6) as u64);
        let time = config.rotate_min.and_then(|minutes| Duration::try_from_secs_f64(minutes * 60.0).ok());
        Self { bytes, time }
    }
}

/// The file of a part: `run.mcap`, `run.2.mcap`, `run.3.mcap` …
pub(super) fn part_path(log: &Path, number: u32) -> PathBuf {
    if number <= 1 {
        return log.to_owned();
    }
    let mut name = log.file_stem().unwrap_or_default().to_owned();
    name.push(format!(".{number}"));
    if let Some(extension) = log.extension() {
        name.push(".");
        name.push(extension);
    }
    log.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_numbered_before_the_extension() {
        for (log, number, part) in [
            ("a/run.mcap", 1, "a/run.mcap"),
            ("a/run.mcap", 2, "a/run.2.mcap"),
            ("/v/cell.1.mcap", 10, "/v/cell.1.10.mcap"),
            ("log", 3, "log.3"),
        ] {
            assert_eq!(part_path(Path::new(log), number), Path::new(part));
        }
    }

    #[test]
    fn whichever_limit_is_reached_first() {
        let config = LogConfig { rotate_mb: Some(1.5), rotate_min: Some(0.5), ..LogConfig::default() };
        let rotation = Rotation::from(&config);
        assert_eq!(rotation, Rotation { bytes: Some(1_500_000), time: Some(Duration::from_secs(30)) });
        let seconds = Duration::from_secs;
        assert!(!rotation.is_due(1_499_999, seconds(29)));
        assert!(rotation.is_due(1_500_000, seconds(0)));
        assert!(rotation.is_due(0, seconds(30)));
        assert!(!Rotation::from(&LogConfig::default()).is_due(u64::MAX, Duration::MAX));
    }
}
