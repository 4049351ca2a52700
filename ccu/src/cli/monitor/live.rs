//! The set as it is now: one thread that reads the feed into a picture, and connects again when the set has gone.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use supersigma_config::AxisConfig;
use supersigma_protocol::AxisNumber;

use super::Exit;
use crate::executive::Failure;
use crate::home::Home;
use crate::watch::{Detail, Feed, Picture, Snapshot};

/// How often a set that has gone is looked for.
const AGAIN: Duration = Duration::from_millis(300);
/// The daemon tells something every second at least.
const SILENCE: Duration = Duration::from_millis(2_500);

/// How it stands between the dashboard and the set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Link {
    /// All is well.
    Up,
    /// The daemon is there, and has not said anything for so long.
    Silent(Duration),
    /// The set is down.
    Down,
}

/// A set, watched.
pub(super) struct Live {
    seen: Arc<Mutex<Seen>>,
    name: String,
}

struct Seen {
    picture: Picture,
    since: Instant,
    heard: Instant,
    down: bool,
}

impl Live {
    /// Begins to watch.
    ///
    /// # Errors
    /// If no such set is up.
    pub(super) fn start(home: &Home) -> Result<Self, Exit> {
        let (mut feed, picture) = Feed::open(home)?;
        let seen = Seen { picture, since: feed.since(), heard: Instant::now(), down: false };
        let seen = Arc::new(Mutex::new(seen));
        let (into, home, name) = (Arc::clone(&seen), home.clone(), home.name().to_string());
        thread::Builder::new().name("feed".into()).spawn(move || {
            loop {
                read(&mut feed, &into);
                feed = again(&home, &into);
            }
        })?;
        Ok(Self { seen, name })
    }

    /// The axes of the set.
    pub(super) fn axes(&self) -> Vec<(AxisNumber, String)> {
        let axis = |axis: &AxisConfig| (axis.address, axis.name.clone());
        lock(&self.seen).picture.config().axes.iter().map(axis).collect()
    }

    /// The set at this moment.
    pub(super) fn look(&self, detail: &Detail) -> (Snapshot, Link) {
        let mut seen = lock(&self.seen);
        let at = seen.since.elapsed();
        seen.picture.advance(at);
        let silence = seen.heard.elapsed();
        let link = match silence {
            _ if seen.down => Link::Down,
            silence if silence > SILENCE => Link::Silent(silence),
            _ => Link::Up,
        };
        (seen.picture.snapshot(detail), link)
    }

    /// Somebody quits while it stands so.
    pub(super) fn end(&self, link: Link) -> Result<(), Exit> {
        match link {
            Link::Down => Err(Failure::NoSet { name: self.name.clone() }.into()),
            Link::Up | Link::Silent(_) => Ok(()),
        }
    }
}

/// Reads the feed to its end.
fn read(feed: &mut Feed, seen: &Mutex<Seen>) {
    while let Ok(news) = feed.news() {
        let mut seen = lock(seen);
        let since = seen.since;
        news.put_into(&mut seen.picture, since);
        seen.heard = Instant::now();
    }
    lock(seen).down = true;
}

/// Waits until the set is up again: a new life, a new picture.
fn again(home: &Home, seen: &Mutex<Seen>) -> Feed {
    loop {
        thread::sleep(AGAIN);
        if let Ok((feed, picture)) = Feed::open(home) {
            *lock(seen) = Seen { picture, since: feed.since(), heard: Instant::now(), down: false };
            return feed;
        }
    }
}

/// A picture is whole after every frame, even if a thread has panicked while it held the lock.
fn lock(seen: &Mutex<Seen>) -> MutexGuard<'_, Seen> {
    seen.lock().unwrap_or_else(PoisonError::into_inner)
}
