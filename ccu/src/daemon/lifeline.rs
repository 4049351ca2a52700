//! A listener's end of its lifeline: the daemon's events come along it, a line of JSON each, and its end is the daemon's.

use std::io::{self, BufRead};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::thread;

use axis_worker::clock::{Clock, Monotonic};
use supersigma_protocol::Tick;

use crate::log::Event;
use crate::notices::Notice;

/// What comes along the standard input.
#[derive(Debug)]
pub(super) struct Lifeline {
    /// The daemon's events, with the ticks at which they happened.
    pub(super) events: Receiver<(Tick, Event)>,
    /// Set when it has ended; by then all events are there.
    pub(super) ended: Arc<AtomicBool>,
}

impl Lifeline {
    /// Begins to listen to the standard input.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn watch(clock: Clock) -> io::Result<Self> {
        let ended = Arc::new(AtomicBool::new(false));
        let (sender, events) = mpsc::channel();
        let flag = Arc::clone(&ended);
        thread::Builder::new().name("lifeline".into()).spawn(move || {
            for line in io::stdin().lock().split(b'\n').map_while(Result::ok) {
                match serde_json::from_slice(&line) {
                    Ok(Notice { at_ns, event }) => {
                        // Nobody listens any more only when this process is about to end.
                        let _ = sender.send((clock.tick(Monotonic::from_nanos(at_ns)), event));
                    }
                    Err(error) => tracing::warn!(%error, "what came along the lifeline is no event"),
                }
            }
            flag.store(true, Ordering::Release);
        })?;
        Ok(Self { events, ended })
    }
}
