//! The board: what browsers are told, written once for all of them. It keeps the newest picture and the last frames and
//! events; each reader has a place in them. Who reads slowly finds newer things, and how many it has missed; there is no
//! queue that could grow, and nobody waits for anybody.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Serialize;
use serde_json::json;
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;

use super::live::{Live, Seen};
use crate::watch::Detail;

/// How often the board is written, if there is something new.
const TURN: Duration = Duration::from_millis(40);
/// How many lines of a kind are kept.
const KEPT: usize = 2_000;
/// How many lines of a kind a reader is given at once.
const AT_ONCE: usize = 500;

/// The board.
#[derive(Debug)]
pub(super) struct Board {
    written: Mutex<Written>,
    turns: watch::Sender<u64>,
    control: bool,
    /// How many readers want samples and heartbeats too; nobody else pays for them.
    wanting_all: AtomicUsize,
}

#[derive(Debug, Default)]
struct Written {
    life: u64,
    set: Arc<str>,
    /// Counts what `set` has been.
    sets: u64,
    picture: Option<Arc<str>>,
    telling: Lines,
    all: Lines,
    events: Lines,
    last_event: u64,
}

/// The last lines of a kind, each JSON already.
#[derive(Debug, Default)]
struct Lines {
    kept: VecDeque<Arc<str>>,
    /// The place after the last one.
    next: u64,
    /// The place up to which the picture has been read.
    read: u64,
}

/// What a browser wants to be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Frames {
    /// Without samples and heartbeats.
    Telling,
    /// All of them.
    All,
}

/// A browser's place.
#[derive(Debug)]
pub(super) struct Reader {
    board: Arc<Board>,
    turns: watch::Receiver<u64>,
    wants: Frames,
    life: u64,
    sets: u64,
    frames: u64,
    events: u64,
}

impl Board {
    pub(super) fn new(control: bool) -> Self {
        Self {
            written: Mutex::default(),
            turns: watch::Sender::new(0),
            control,
            wanting_all: AtomicUsize::new(0),
        }
    }

    /// A place at the beginning of what is kept.
    pub(super) fn reader(self: &Arc<Self>, wants: Frames) -> Reader {
        if wants == Frames::All {
            self.wanting_all.fetch_add(1, Ordering::AcqRel);
        }
        let mut turns = self.turns.subscribe();
        turns.mark_changed();
        Reader { board: Arc::clone(self), turns, wants, life: 0, sets: 0, frames: 0, events: 0 }
    }

    /// Writes what is new.
    pub(super) fn write(&self, seen: &mut Seen) {
        let mut written = self.lock();
        let set = match &seen.set {
            Ok(_) => json!({ "up": true, "life": seen.life, "reason": null, "control": self.control }),
            Err(reason) => {
                json!({ "up": false, "life": seen.life, "reason": reason, "control": self.control })
            }
        };
        let set: Arc<str> = set.to_string().into();
        if set != written.set {
            (written.set, written.sets) = (set, written.sets + 1);
        }
        if seen.life != written.life {
            let (set, sets) = (Arc::clone(&written.set), written.sets);
            *written = Written { life: seen.life, set, sets, ..Written::default() };
        }
        written.picture = seen.picture(&BARE).map(|picture| json_of(&picture));
        if let Ok(watched) = &seen.set {
            let picture = &watched.picture;
            let read = |lines: &mut Lines, all| {
                let passage = picture.frames_from(lines.read, all);
                lines.read = passage.next;
                lines.skip(passage.missed);
                lines.put(passage.lines.iter().map(json_of));
            };
            read(&mut written.telling, false);
            if self.wanting_all.load(Ordering::Acquire) > 0 {
                read(&mut written.all, true);
            }
            let new: Vec<_> = picture.events_after(written.last_event).collect();
            written.last_event = new.last().map_or(written.last_event, |event| event.number);
            written.events.put(new.into_iter().map(json_of));
        }
        drop(written);
        self.turns.send_modify(|turns| *turns += 1);
    }

    fn lock(&self) -> MutexGuard<'_, Written> {
        self.written.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Writes the board, again and again, while anybody reads it.
pub(super) async fn turn(board: Arc<Board>, live: Arc<Live>) {
    let mut times = tokio::time::interval(TURN);
    times.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        times.tick().await;
        if board.turns.receiver_count() == 0 {
            continue;
        }
        let mut seen = live.look();
        if std::mem::take(&mut seen.changed) {
            board.write(&mut seen);
        }
    }
}

impl Reader {
    /// What is new, as server-sent events, oldest first; waits for it. `None` when the server ends.
    pub(super) async fn next(&mut self) -> Option<String> {
        loop {
            self.turns.changed().await.ok()?;
            let text = self.read();
            if !text.is_empty() {
                return Some(text);
            }
        }
    }

    fn read(&mut self) -> String {
        let mut text = String::new();
        let board = Arc::clone(&self.board);
        let written = board.lock();
        if self.life != written.life {
            (self.life, self.frames, self.events) = (written.life, 0, 0);
        }
        if self.sets != written.sets {
            self.sets = written.sets;
            event(&mut text, "set", &written.set);
        }
        if let Some(picture) = &written.picture {
            event(&mut text, "picture", picture);
        }
        let frames = match self.wants {
            Frames::Telling => &written.telling,
            Frames::All => &written.all,
        };
        // Who has not read anything yet, has not missed anything.
        let mut more = false;
        for (name, lines, place) in
            [("frames", frames, &mut self.frames), ("events", &written.events, &mut self.events)]
        {
            let (missed, new) = lines.from(*place);
            let missed = if *place == 0 { 0 } else { missed };
            if missed > 0 || !new.is_empty() {
                *place = new.next;
                more |= *place < lines.next;
                event(&mut text, name, &format!("{{\"missed\":{missed},\"{name}\":[{}]}}", new.text));
            }
        }
        drop(written);
        if more {
            self.turns.mark_changed();
        }
        text
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        if self.wants == Frames::All {
            self.board.wanting_all.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

/// Lines from a place on, at most [`AT_ONCE`].
#[derive(Debug, PartialEq, Eq)]
struct New {
    text: String,
    next: u64,
}

impl New {
    fn is_empty(&self) -> bool {
        self.text.is_empty()
    }
}

impl Lines {
    fn put(&mut self, lines: impl Iterator<Item = Arc<str>>) {
        for line in lines {
            if self.kept.len() == KEPT {
                self.kept.pop_front();
            }
            self.kept.push_back(line);
            self.next += 1;
        }
    }

    /// So many that are not known have gone by; who reads on from before them has missed what is kept from then, too.
    fn skip(&mut self, missed: u64) {
        if missed > 0 {
            self.kept.clear();
            self.next += missed;
        }
    }

    fn from(&self, place: u64) -> (u64, New) {
        let first = self.next - self.kept.len() as u64;
        let skipped = usize::try_from(place.saturating_sub(first)).unwrap_or(usize::MAX);
        let new: Vec<&str> = self.kept.iter().skip(skipped).take(AT_ONCE).map(AsRef::as_ref).collect();
        let next = place.max(first) + new.len() as u64;
        (first.saturating_sub(place), New { text: new.join(","), next })
    }
}

/// What a picture needs for lamps and needles; frames and events are told once each, curves grow in the browser.
const BARE: Detail = Detail {
    frames: 0,
    filter: crate::watch::Filter { axis: None, text: String::new(), all: false },
    events: 0,
    history: 0,
};

fn event(text: &mut String, name: &str, data: &str) {
    // Writing into a string cannot fail; JSON has no line breaks of its own.
    let _ = write!(text, "event: {name}\ndata: {data}\n\n");
}

fn json_of(value: &impl Serialize) -> Arc<str> {
    serde_json::to_string(value)
        .unwrap_or_else(|error| json!({ "error": error.to_string() }).to_string())
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(range: std::ops::Range<u64>) -> impl Iterator<Item = Arc<str>> {
        range.map(|number| number.to_string().into())
    }

    #[test]
    fn who_is_slow_misses_the_oldest_and_is_told_how_many() {
        let mut lines = Lines::default();
        lines.put(numbers(0..10));
        assert_eq!(lines.from(7), (0, New { text: "7,8,9".into(), next: 10 }));
        assert!(lines.from(10).1.is_empty());
        lines.put(numbers(10..2_100));
        let (missed, new) = lines.from(10);
        assert_eq!((missed, new.next), (90, 600));
        assert!(new.text.starts_with("100,101,") && new.text.ends_with(",599"));
        lines.skip(7);
        lines.put(numbers(2_107..2_108));
        assert_eq!(lines.from(600), (1_507, New { text: "2107".into(), next: 2_108 }));
    }

    #[test]
    fn a_reader_gets_what_is_new_and_nothing_twice() {
        let board = Arc::new(Board::new(false));
        let mut reader = board.reader(Frames::Telling);
        let live = Live::new();
        board.write(&mut live.look());
        let first = reader.read();
        assert_eq!(
            first,
            "event: set\ndata: {\"control\":false,\"life\":0,\"reason\":\"not looked for yet\",\"up\":false}\n\n"
        );
        board.write(&mut live.look());
        assert_eq!(reader.read(), "");
        board.lock().telling.put(numbers(0..3));
        assert_eq!(reader.read(), "event: frames\ndata: {\"missed\":0,\"frames\":[0,1,2]}\n\n");
        board.lock().telling.put(numbers(3..2_500));
        let late = reader.read();
        assert!(late.starts_with("event: frames\ndata: {\"missed\":497,\"frames\":[500,501,"), "{late:.80}");
        assert!(reader.turns.has_changed().expect("the board lives"), "there is more");
        // One who comes only now has not missed anything.
        assert!(board.reader(Frames::Telling).read().contains("{\"missed\":0,\"frames\":[500,"));
    }

    #[test]
    fn samples_are_written_only_for_those_who_want_them() {
        let board = Arc::new(Board::new(true));
        let reader = board.reader(Frames::All);
        assert_eq!(board.wanting_all.load(Ordering::Acquire), 1);
        drop(reader);
        assert_eq!(board.wanting_all.load(Ordering::Acquire), 0);
    }
}
