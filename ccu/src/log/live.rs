//! The view of a set that runs: what the log's twin channels will hold, at once. Frames are held back as for the log, so
//! that they come in the order of time. It knows no clock and no network. Gaps are the log's business: a view may begin
//! at any time, and may miss frames when its machine is busy.

use std::time::Duration;

use supersigma_protocol::{Frame, FrameError, Tick, Ticks};

use super::events::Event;
use super::header::{LogHeader, Timeline, WallTime};
use super::order::HoldBack;
use super::told::{Message, Seen, Teller};

/// The real time for which frames are held back.
const HOLD_BACK: Duration = Duration::from_millis(20);

/// A view that has begun.
pub struct LiveView {
    order: HoldBack<Held>,
    hold: Ticks,
    timeline: Timeline,
    teller: Teller,
}

enum Held {
    Frame(Vec<u8>, Result<Frame, FrameError>),
    Event(Event),
}

impl LiveView {
    /// A view of the set with this header.
    #[must_use]
    pub fn new(header: &LogHeader) -> Self {
        let hold = header.timeline.scale.ticks(HOLD_BACK);
        Self { order: HoldBack::new(hold), hold, timeline: header.timeline, teller: Teller::new(header) }
    }

    /// Takes what was on the bus, frame or not.
    pub fn record(&mut self, bytes: &[u8], now: Tick) {
        let frame = Frame::decode(bytes);
        let latest = Tick(now.0.saturating_add(self.hold.0));
        let at = frame.as_ref().map_or(now, |frame| frame.tick.min(latest));
        self.order.push(at, Held::Frame(bytes.to_vec(), frame));
    }

    /// Takes an event of the daemon that happened at tick `at`.
    pub fn note(&mut self, at: Tick, event: Event, now: Tick) {
        self.order.push(at.min(now), Held::Event(event));
    }

    /// Gives what has been held back long enough, with its time.
    pub fn advance(&mut self, now: Tick, tell: &mut impl FnMut(WallTime, Message<'_>)) {
        while let Some((at, held)) = self.order.pop_due(now) {
            let time = self.timeline.wall(at);
            let mut tell = |message: Message<'_>| tell(time, message);
            match held {
                Held::Event(event) => self.teller.event(&event, time, &mut tell),
                Held::Frame(bytes, frame) => {
                    let seen = Seen { bytes: &bytes, frame: frame.as_ref(), gap: None, time };
                    self.teller.of(seen, &mut tell);
                }
            }
        }
    }
}
