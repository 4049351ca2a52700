//! The recorder's loop over a scripted bus and a scripted clock.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;

use supersigma_protocol::bus::{BusError, Origin, Tap};

use super::*;
use crate::log::{LogError, RecorderStatus, run};

/// Hands over one batch per look at the bus. The set goes down when the `stop_after`th has been taken.
struct Script<'a> {
    batches: VecDeque<Vec<Frame>>,
    stop: &'a AtomicBool,
    stop_after: usize,
    looks: &'a AtomicU64,
    broken: bool,
}

impl Tap for Script<'_> {
    fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError> {
        let looks = self.looks.fetch_add(1, Ordering::Relaxed) + 1;
        if looks >= self.stop_after as u64 {
            self.stop.store(true, Ordering::Release);
        }
        let batch = match self.batches.pop_front() {
            Some(batch) => batch,
            None if self.broken => {
                return Err(BusError::Broken { what: "receive", reason: "scripted".to_owned() });
            }
            None => Vec::new(),
        };
        for frame in &batch {
            each(lane(frame), Origin::own(), &frame.encode());
        }
        Ok(batch.len())
    }
}

struct Run {
    result: Result<LogSummary, LogError>,
    logged: Vec<LoggedFrame>,
    truncated: bool,
    looks: u64,
    told: Vec<RecorderStatus>,
}

/// Ten milliseconds pass with every look at the bus.
fn record(batches: Vec<Vec<Frame>>, stop_after: usize, broken: bool) -> Run {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let (stop, looks) = (AtomicBool::new(false), AtomicU64::new(0));
    let script = Script { batches: batches.into(), stop: &stop, stop_after, looks: &looks, broken };
    let clock = || Tick(looks.load(Ordering::Relaxed) * 10 * MILLISECOND);
    let mut told = Vec::new();
    let tell = |status: &RecorderStatus| told.push(status.clone());
    let result = run(script, writer(&path), clock, &mpsc::channel().1, &stop, tell);
    let (logged, reader) = read(&path);
    Run { result, logged, truncated: reader.truncated(), looks: looks.into_inner(), told }
}

#[test]
fn it_ends_when_every_card_has_left() {
    let batches = vec![
        vec![command(0, 1, &[0, 5]), answer(1, 0, 2, HEARTBEAT), answer(2, 0, 3, HEARTBEAT)],
        vec![answer(1, 1, 10 * MILLISECOND, LEAVING)],
        vec![],
        // Axis 1 lives anew, and goes again.
        vec![answer(1, 0, 30 * MILLISECOND, HEARTBEAT), answer(2, 1, 30 * MILLISECOND + 1, LEAVING)],
        vec![],
        vec![answer(1, 1, 50 * MILLISECOND, LEAVING)],
    ];
    let run = record(batches, 2, false);
    let summary = run.result.expect("nothing failed");
    assert_eq!((summary.frames, summary.gaps, run.logged.len(), run.truncated), (7, 0, 7, false));
    assert_eq!(run.looks, 7, "one more look than batches, to find nothing more");
}

#[test]
fn it_ends_after_600_ms_of_silence() {
    let run = record(vec![vec![answer(1, 0, 2, HEARTBEAT)], vec![answer(1, 1, 3, HEARTBEAT)]], 1, false);
    assert_eq!(run.result.expect("nothing failed").frames, 2);
    assert_eq!(run.looks, 2 + 60);
}

#[test]
fn it_waits_as_long_as_the_set_lives() {
    // Everybody has left, or nobody ever came: until the order to stop it goes on listening.
    let run = record(vec![vec![answer(1, 0, 2, LEAVING)]], 90, false);
    assert_eq!((run.result.expect("nothing failed").frames, run.looks), (1, 91));
}

#[test]
fn a_broken_bus_leaves_a_finished_log() {
    let run = record(vec![vec![answer(1, 0, 2, HEARTBEAT)]], 90, true);
    assert!(matches!(run.result, Err(LogError::Bus(_))));
    assert_eq!((run.logged.len(), run.truncated), (1, false));
}

#[test]
fn what_has_changed_is_told_every_quarter_of_a_second() {
    // A look is 10 ms. A frame that is 70 ms old when it comes, then a gap of three, then nothing.
    let mut batches = vec![Vec::new(); 60];
    batches[8] = vec![answer(1, 0, 20 * MILLISECOND, HEARTBEAT)];
    batches[30] = vec![answer(1, 4, 310 * MILLISECOND, HEARTBEAT)];
    let run = record(batches, 200, false);
    let told: Vec<_> =
        run.told.iter().map(|status| (status.log.frames, status.log.lost, status.behind_ms)).collect();
    // The last is told when the log is finished: all of it is then on disk.
    assert_eq!(told, [(1, 0, 70), (2, 3, 0), (2, 3, 0)], "{:?}", run.told);
    let summary = run.result.expect("nothing failed");
    assert_eq!(run.told.last().map(|status| &status.log), Some(&summary));
    assert_eq!((summary.gaps, summary.lost), (1, 3));
}
