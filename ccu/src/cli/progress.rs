//! How far a program is: a line on the terminal while it runs, below what it prints. The rehearsal has told how many
//! movements it makes and how long it takes; what inputs and chance make of it, the line does not know.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use supersigma_protocol::Ticks;

/// How often the line is drawn anew.
const DRAW: Duration = Duration::from_millis(200);

/// What a program that has been rehearsed to its end will do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Expected {
    /// How many movements.
    pub(super) movements: u64,
    /// How long, in machine time.
    pub(super) time: Ticks,
}

/// The line; without a terminal, nothing.
#[derive(Debug)]
pub(super) struct Progress(ProgressBar);

impl Progress {
    /// For who does not want it.
    pub(super) fn none() -> Self {
        Self(ProgressBar::hidden())
    }

    /// Of a program that begins now, on a machine that runs `scale` times as fast as real time.
    pub(super) fn start(expected: Option<Expected>, scale: f64) -> Self {
        let bar = ProgressBar::with_draw_target(
            expected.map(|expected| expected.movements),
            ProgressDrawTarget::stderr_with_hz(10),
        );
        let template = match expected {
            Some(_) => "{bar:20} {pos}/{len} movements, {elapsed}{left}",
            None => "{spinner} {pos} movements, {elapsed}",
        };
        let style =
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner());
        let whole = expected.map(|expected| expected.time.as_seconds() / scale);
        bar.set_style(style.progress_chars("█▉▊▋▌▍▎▏ ").with_key(
            "left",
            move |state: &ProgressState, line: &mut dyn std::fmt::Write| {
                // What cannot be written on a terminal's line is not missed.
                let _ = line.write_str(&left(whole, state.elapsed()));
            },
        ));
        bar.enable_steady_tick(DRAW);
        Self(bar)
    }

    /// A movement is complete.
    pub(super) fn moved(&self) {
        self.0.inc(1);
        // Inputs may lead it another way than the rehearsal.
        if let Some(length) = self.0.length() {
            self.0.set_length(length.max(self.0.position()));
        }
    }

    /// Prints a line above. A program goes on when nobody reads what it prints: a robot does not stop in the middle for
    /// that.
    pub(super) fn say(&self, line: &str) {
        self.0.suspend(|| {
            let _ = writeln!(io::stdout(), "{line}");
        });
    }

    /// The program has ended.
    pub(super) fn end(&self) {
        self.0.finish_and_clear();
    }
}

/// How long it will still take, in words.
fn left(whole: Option<f64>, elapsed: Duration) -> String {
    let Some(whole) = whole else { return String::new() };
    let seconds = (whole - elapsed.as_secs_f64()).ceil();
    if seconds < 1.0 {
        return ", longer than rehearsed".to_owned();
    }
    let mut text = ", about ".to_owned();
    let _ = match Duration::try_from_secs_f64(seconds).map(|left| left.as_secs()) {
        Ok(left @ ..120) => write!(text, "{left} s left"),
        Ok(left @ ..7_200) => write!(text, "{} min left", left.div_ceil(60)),
        Ok(left) => write!(text, "{} h left", left.div_ceil(3_600)),
        Err(_) => write!(text, "for ever left"),
    };
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_told_in_the_unit_that_suits() {
        let after = |whole, elapsed| left(Some(whole), Duration::from_millis(elapsed));
        assert_eq!(after(12.5, 500), ", about 12 s left");
        assert_eq!(after(12.5, 700), ", about 12 s left");
        assert_eq!(after(119.0, 0), ", about 119 s left");
        assert_eq!(after(121.0, 0), ", about 3 min left");
        assert_eq!(after(9_000.0, 0), ", about 3 h left");
        assert_eq!(after(3.0, 3_100), ", longer than rehearsed");
        assert_eq!(left(None, Duration::ZERO), "");
    }
}
