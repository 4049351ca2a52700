//! The recorder process's loop: bus to log. It only listens; it sleeps between two looks and never spins.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::Duration;

use supersigma_protocol::Tick;
use supersigma_protocol::bus::Tap;

use super::LogError;
use super::events::Event;
use super::senders::Gap;
use super::writer::{LogSummary, LogWriter};

/// The real time without a frame after which nobody is expected to speak any more, once the set goes down.
const SILENCE: Duration = Duration::from_millis(600);

/// Records the bus until `stop` is set and then until every card that spoke has sent its last frame, or nothing has
/// been on the bus for 600 ms. `clock` tells the set's tick; `events` brings what the daemon has to say. Gaps are logged through `tracing` as they are found.
///
/// # Errors
/// If the bus or the file fails. When the bus fails, the log is finished all the same.
pub fn run(
    mut tap: impl Tap,
    mut writer: LogWriter,
    clock: impl Fn() -> Tick,
    events: &Receiver<(Tick, Event)>,
    stop: &AtomicBool,
) -> Result<LogSummary, LogError> {
    let silence = writer.timeline().scale.ticks(SILENCE);
    // When it was last known that somebody may still speak.
    let mut heard = clock();
    loop {
        // Read before the bus: what was sent before the order to stop is then found below.
        let stopping = stop.load(Ordering::Acquire);
        let drained = tap.drain(&mut |lane, bytes| {
            if let Some(gap) = writer.record(lane, bytes, clock()) {
                warn(&gap);
            }
        });
        let now = clock();
        let drained = match drained {
            Ok(drained) => drained,
            Err(error) => {
                writer.finish()?;
                return Err(error.into());
            }
        };
        for (at, event) in events.try_iter() {
            writer.note(at, event, now);
        }
        writer.advance(now)?;
        if drained > 0 || !stopping {
            heard = now;
        } else if writer.all_cards_left() || now.since(heard) >= silence {
            return writer.finish();
        }
        thread::sleep(writer.poll());
    }
}

fn warn(gap: &Gap) {
    tracing::warn!(
        sender = %gap.sender,
        expected = gap.expected.0,
        got = gap.got.0,
        lost = gap.lost(),
        "frames are missing from the log"
    );
}
