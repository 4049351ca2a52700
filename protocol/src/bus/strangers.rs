//! Processes that speak on the bus and are no part of the set. What they say is counted, not read; each is told of once,
//! and then now and then for as long as it goes on, however much it says. Who belongs to the set is not known here.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::time::{Duration, Instant};

use super::Origin;

/// A stranger that goes on is told of again after this time.
const AGAIN: Duration = Duration::from_secs(10);
/// So many are remembered; then the one that was told of longest ago is forgotten.
const REMEMBERED: usize = 32;

/// All that have spoken.
#[derive(Debug, Default)]
pub struct Strangers {
    seen: BTreeMap<Origin, Seen>,
}

#[derive(Debug, Default)]
struct Seen {
    frames: u64,
    /// When it was told of last, and how many frames it had sent then.
    told: Option<(Instant, u64)>,
}

impl Seen {
    fn is_due(&self, now: Instant) -> bool {
        self.told
            .is_none_or(|(at, frames)| self.frames > frames && now.saturating_duration_since(at) >= AGAIN)
    }
}

/// What there is to tell of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stranger {
    /// The process.
    pub origin: Origin,
    /// The name of its program, if it still runs and may be looked at.
    pub command: Option<String>,
    /// How many frames it has sent so far.
    pub frames: u64,
}

impl fmt::Display for Stranger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.command {
            Some(command) => write!(f, "{} ({command})", self.origin),
            None => self.origin.fmt(f),
        }
    }
}

impl Strangers {
    /// Takes note of a frame.
    pub fn note(&mut self, origin: Origin) {
        if self.seen.len() >= REMEMBERED && !self.seen.contains_key(&origin) {
            let told = |(_, seen): &(&Origin, &Seen)| seen.told.map(|(at, _)| at);
            // Those that nobody has been told of yet stay.
            let oldest = self.seen.iter().filter(|one| told(one).is_some()).min_by_key(told);
            if let Some((&oldest, _)) = oldest {
                self.seen.remove(&oldest);
            }
        }
        self.seen.entry(origin).or_default().frames += 1;
    }

    /// Those of whom there is something to tell now.
    pub fn news(&mut self, now: Instant) -> Vec<Stranger> {
        let due = self.seen.iter_mut().filter(|(_, seen)| seen.is_due(now));
        due.map(|(&origin, seen)| {
            seen.told = Some((now, seen.frames));
            Stranger { origin, command: command_of(origin), frames: seen.frames }
        })
        .collect()
    }
}

/// The name of a process' program. Anybody may choose what it is, so only what can be printed is kept of it.
fn command_of(Origin(process): Origin) -> Option<String> {
    let name = fs::read(format!("/proc/{process}/comm")).ok()?;
    Some(String::from_utf8_lossy(&name).trim_end().escape_debug().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stranger_is_told_of_once_and_then_now_and_then() {
        let mut strangers = Strangers::default();
        let begun = Instant::now();
        let after = |seconds| begun + Duration::from_secs(seconds);
        let mut told = |frames: u64, origin: Origin, now| {
            (0..frames).for_each(|_| strangers.note(origin));
            let news = strangers.news(now);
            news.into_iter().map(|stranger| (stranger.origin.0, stranger.frames)).collect::<Vec<_>>()
        };
        let (one, other) = (Origin(u32::MAX), Origin(u32::MAX - 1));
        assert_eq!(told(3, one, begun), [(one.0, 3)]);
        assert_eq!(told(1_000, one, after(1)), []);
        assert_eq!(told(1, other, after(2)), [(other.0, 1)]);
        // What was said meanwhile is told when its time has come, even if nothing is said any more; and not again.
        assert_eq!(told(0, one, after(10)), [(one.0, 1_003)]);
        assert_eq!(told(0, one, after(60)), []);
    }

    #[test]
    fn a_crowd_is_told_of_too_and_not_remembered() {
        let mut strangers = Strangers::default();
        for process in 1..=10 * u32::try_from(REMEMBERED).unwrap() {
            strangers.note(Origin(process));
            assert_eq!(strangers.news(Instant::now()).len(), 1);
        }
        assert_eq!(strangers.seen.len(), REMEMBERED);
    }

    #[test]
    fn a_process_is_called_by_its_program() {
        let of = |origin| Stranger { origin, command: command_of(origin), frames: 1 }.to_string();
        let own = fs::read_to_string("/proc/self/comm").unwrap();
        assert_eq!(of(Origin::own()), format!("process {} ({})", std::process::id(), own.trim_end()));
        assert_eq!(of(Origin::UNKNOWN), "process 0");
    }
}
