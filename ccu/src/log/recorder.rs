//! The recorder process's loop: bus to log. It only listens; it sleeps between two looks and never spins.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use supersigma_protocol::bus::Tap;
use supersigma_protocol::{Tick, Ticks};

use super::LogError;
use super::events::Event;
use super::senders::Gap;
use super::writer::{LogSummary, LogWriter};

/// The real time without a frame after which nobody is expected to speak any more, once the set goes down.
const SILENCE: Duration = Duration::from_millis(600);
/// The real time between two words about what has changed.
const NEWS: Duration = Duration::from_millis(250);
/// The real time for which a full disk's reserve is used, so that the log tells how the axes came to a stand.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// What the recorder tells about itself while it records.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RecorderStatus {
    /// What the log holds.
    #[serde(flatten)]
    pub log: LogSummary,
    /// The greatest real time, in milliseconds, by which the recorder lately was behind the bus.
    pub behind_ms: u64,
    /// Whether the disk has no more room than what is set aside for the end of the log.
    pub full: bool,
}

/// Records the bus until `stop` is set and then until every card that spoke has sent its last frame, or nothing has
/// been on the bus for 600 ms. `clock` tells the set's tick; `events` brings what the daemon has to say. `tell` is told
/// what has changed, every 250 ms, and at once when the disk is full; gaps are logged through `tracing` as they are found.
///
/// On a full disk it goes on for a second and then finishes the log.
///
/// # Errors
/// If the bus or the file fails, or the disk is full. The log is finished all the same, or, if it cannot be written any
/// more, closed behind the last frame that is whole; `tell` has then been told what it holds.
pub fn run(
    mut tap: impl Tap,
    mut writer: LogWriter,
    clock: impl Fn() -> Tick,
    events: &Receiver<(Tick, Event)>,
    stop: &AtomicBool,
    mut tell: impl FnMut(&RecorderStatus),
) -> Result<LogSummary, LogError> {
    let scale = writer.timeline().scale;
    let (silence, last_words) = (scale.ticks(SILENCE), scale.ticks(LAST_WORDS));
    // When it was last known that somebody may still speak.
    let mut heard = clock();
    let mut news = News { interval: scale.ticks(NEWS), told: RecorderStatus::default(), at: heard };
    let mut full_since = None;
    loop {
        // Read before the bus: what was sent before the order to stop is then found below.
        let stopping = stop.load(Ordering::Acquire);
        let drained = tap.drain(&mut |lane, _, bytes| {
            if let Some(gap) = writer.record(lane, bytes, clock()) {
                warn(&gap);
            }
        });
        let now = clock();
        let drained = match drained {
            Ok(drained) => drained,
            Err(error) => {
                finish(writer, &mut tell)?;
                return Err(error.into());
            }
        };
        for (at, event) in events.try_iter() {
            writer.note(at, event, now);
        }
        if let Err(error) = writer.advance(now) {
            tell(&RecorderStatus { log: writer.saved().clone(), ..news.told });
            return Err(error);
        }
        news.tell(&mut writer, now, &mut tell);
        if drained > 0 || !stopping {
            heard = now;
        }
        let over = stopping && (writer.all_cards_left() || now.since(heard) >= silence);
        if writer.is_full() {
            let since = *full_since.get_or_insert(now);
            if over || now.since(since) >= last_words {
                let path = writer.path().to_owned();
                finish(writer, &mut tell)?;
                return Err(LogError::Full { path });
            }
        } else if over && drained == 0 {
            return finish(writer, &mut tell);
        }
        thread::sleep(writer.poll());
    }
}

/// What was told, and when.
struct News {
    interval: Ticks,
    told: RecorderStatus,
    at: Tick,
}

impl News {
    fn tell(&mut self, writer: &mut LogWriter, now: Tick, tell: &mut impl FnMut(&RecorderStatus)) {
        let full = writer.is_full();
        if now.since(self.at) < self.interval && full == self.told.full {
            return;
        }
        let behind = writer.timeline().scale.real(writer.take_lag());
        let behind_ms = behind.as_millis().try_into().unwrap_or(u64::MAX);
        let status = RecorderStatus { log: writer.counts().clone(), behind_ms, full };
        self.at = now;
        if status != self.told {
            tell(&status);
            self.told = status;
        }
    }
}

/// Finishes the log, and tells what it holds even if that fails.
fn finish(writer: LogWriter, tell: &mut impl FnMut(&RecorderStatus)) -> Result<LogSummary, LogError> {
    let (saved, full) = (writer.saved().clone(), writer.is_full());
    let finished = writer.finish();
    tell(&RecorderStatus { log: finished.as_ref().unwrap_or(&saved).clone(), behind_ms: 0, full });
    finished
}

fn warn(gap: &Gap) {
    tracing::error!(
        sender = %gap.sender,
        expected = gap.expected.0,
        got = gap.got.0,
        lost = gap.lost(),
        "frames are missing from the log"
    );
}
