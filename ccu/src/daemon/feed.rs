//! What the daemon hears and says on the bus, for whoever watches from outside. One ring for all watchers: they read as
//! fast as they can, and who is too slow misses frames and is told how many. Nobody who sends ever waits for a watcher.
//!
//! Watchers do not tap the bus themselves: its slots are few, each tap is one reader more that every card's process
//! has to serve, and one that was killed keeps its slot until somebody clears it away.

use std::sync::{Arc, Mutex, PoisonError};

use supersigma_protocol::bus::Lane;
use tokio::sync::broadcast;

/// How many frames a watcher may leave unread before it misses some.
const FRAMES: usize = 4_096;

/// One frame's bytes.
pub(super) type Overheard = (Lane, Arc<[u8]>);

/// The ring; `None` once the set is down.
pub(super) struct Feed(Mutex<Option<broadcast::Sender<Overheard>>>);

impl Default for Feed {
    fn default() -> Self {
        Self(Mutex::new(Some(broadcast::Sender::new(FRAMES))))
    }
}

impl Feed {
    /// Everything from now on; `None` once the set is down.
    pub(super) fn subscribe(&self) -> Option<broadcast::Receiver<Overheard>> {
        self.lock().as_ref().map(broadcast::Sender::subscribe)
    }

    /// Tells all watchers. Costs next to nothing when there are none.
    pub(super) fn tell(&self, lane: Lane, bytes: &[u8]) {
        if let Some(ring) = self.lock().as_ref().filter(|ring| ring.receiver_count() > 0) {
            // The last of them may just have gone.
            let _ = ring.send((lane, bytes.into()));
        }
    }

    /// Whether anybody watches.
    pub(super) fn is_watched(&self) -> bool {
        self.lock().as_ref().is_some_and(|ring| ring.receiver_count() > 0)
    }

    /// Nothing comes any more; watchers read what is in the ring, and then its end.
    pub(super) fn end(&self) {
        self.lock().take();
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<broadcast::Sender<Overheard>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::broadcast::error::TryRecvError;

    use super::*;

    #[test]
    fn who_is_too_slow_misses_frames_and_is_told_how_many() {
        let feed = Feed::default();
        feed.tell(Lane::Commands, b"nobody");
        assert!(!feed.is_watched());
        let mut slow = feed.subscribe().expect("a set that is up");
        assert!(feed.is_watched());
        for number in 0..FRAMES + 100 {
            feed.tell(Lane::Answers, &number.to_be_bytes());
        }
        assert_eq!(slow.try_recv(), Err(TryRecvError::Lagged(100)));
        let (lane, bytes) = slow.try_recv().expect("the oldest that is left");
        assert_eq!((lane, &*bytes), (Lane::Answers, &100_usize.to_be_bytes()[..]));
        feed.end();
        feed.tell(Lane::Commands, b"nobody");
        let rest = std::iter::from_fn(|| slow.try_recv().ok()).count();
        assert_eq!(rest, FRAMES - 1);
        assert_eq!(slow.try_recv(), Err(TryRecvError::Closed));
        assert!(feed.subscribe().is_none() && !feed.is_watched());
    }
}
