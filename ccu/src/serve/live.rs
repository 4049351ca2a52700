//! The set as the server sees it: the newest picture while it is up, the reason while it is not. One thread follows the
//! feed, and begins anew when the set comes back.

use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::executive::Failure;
use crate::home::Home;
use crate::watch::{Detail, Feed, Picture, Snapshot};

/// How long after a set was not found it is looked for again.
const AGAIN: Duration = Duration::from_millis(500);

/// What is known of the set by now.
#[derive(Debug)]
pub(super) struct Live(Mutex<Seen>);

/// The same, for one who may look.
#[derive(Debug)]
pub(super) struct Seen {
    /// Counts the sets that have been watched.
    pub(super) life: u64,
    /// What is watched, or why nothing is.
    pub(super) set: Result<Watched, String>,
    /// Whether there is something new since somebody has set this to false.
    pub(super) changed: bool,
}

/// A set that is being watched.
#[derive(Debug)]
pub(super) struct Watched {
    pub(super) picture: Picture,
    /// The zero of the picture's times.
    pub(super) since: Instant,
}

/// A snapshot for browsers.
#[derive(Debug, Serialize)]
pub(super) struct Pictured {
    /// Which of the sets that this server has watched.
    pub(super) life: u64,
    /// Seconds of real time since it is being watched.
    pub(super) at_s: f64,
    #[serde(flatten)]
    pub(super) snapshot: Snapshot,
}

impl Live {
    pub(super) fn new() -> Self {
        Self(Mutex::new(Seen { life: 0, set: Err("not looked for yet".to_owned()), changed: true }))
    }

    pub(super) fn look(&self) -> MutexGuard<'_, Seen> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Seen {
    pub(super) fn up(&mut self, watched: Watched) {
        self.life += 1;
        (self.set, self.changed) = (Ok(watched), true);
    }

    pub(super) fn down(&mut self, reason: String) {
        self.changed |= self.set.as_ref().err() != Some(&reason);
        self.set = Err(reason);
    }

    /// The picture now; `None` while the set is not up.
    pub(super) fn picture(&mut self, detail: &Detail) -> Option<Pictured> {
        let watched = self.set.as_mut().ok()?;
        let at = watched.since.elapsed();
        watched.picture.advance(at);
        let snapshot = watched.picture.snapshot(detail);
        Some(Pictured { life: self.life, at_s: at.as_secs_f64(), snapshot })
    }
}

/// Follows the set for as long as anybody has `live`.
pub(super) fn follow(home: Home, live: &Arc<Live>) -> io::Result<()> {
    let live = Arc::downgrade(live);
    thread::Builder::new().name("feed".to_owned()).spawn(move || {
        while let Some(failure) = watch(&home, &live) {
            let Some(live) = live.upgrade() else { return };
            live.look().down(failure.to_string());
            drop(live);
            thread::sleep(AGAIN);
        }
    })?;
    Ok(())
}

/// Watches the set until something happens to it; `None` if nobody has `live` any more.
fn watch(home: &Home, live: &Weak<Live>) -> Option<Failure> {
    let (mut feed, picture) = match Feed::open(home) {
        Ok(open) => open,
        Err(failure) => return Some(failure),
    };
    let since = feed.since();
    live.upgrade()?.look().up(Watched { picture, since });
    loop {
        let news = match feed.news() {
            Ok(news) => news,
            Err(failure) => return Some(failure),
        };
        let live = live.upgrade()?;
        let mut seen = live.look();
        seen.changed = true;
        if let Ok(watched) = &mut seen.set {
            news.put_into(&mut watched.picture, since);
        }
    }
}
