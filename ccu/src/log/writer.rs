//! The log's writer: frames in, an MCAP file in time order out.
//!
//! It knows no clock: callers say what tick it is now, so everything about it can be tested without waiting. Frames
//! are held back for a few real milliseconds (`order`) so that the file's log times never fall; a frame that comes
//! later still gets the last written time. A chunk is closed and handed to the system while its oldest frame is
//! younger than `flush`: whatever happens to this process, the file holds all but that last moment, and every chunk in it
//! is whole because chunks are built in memory and written at once. A log may go on in another file (`rotation`); what is
//! held back and what is remembered of the senders goes over, so that the files together hold every frame once.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use supersigma_protocol::bus::Lane;
use supersigma_protocol::{About, Body, Frame, FrameError, Occasion, Sender, Sequence, Tick, Ticks};

use super::LogError;
use super::batch::{Batch, Label, Place};
use super::events::Event;
use super::header::{LogHeader, Timeline, WallTime};
use super::order::HoldBack;
use super::part::PartPlace;
use super::press::Press;
use super::rotation::{Rotation, part_path};
use super::senders::{Gap, Senders};
use super::told::{Message, Seen, Teller};

/// The real time for which frames are held back, if `flush` leaves room for it.
const HOLD_BACK: Duration = Duration::from_millis(20);
/// The real time after which a caller with nothing to do comes back while axes move, if `flush` leaves room for it.
const POLL: Duration = Duration::from_millis(10);

/// Frames after which a chunk is closed in any case, so that memory stays small when many come at once.
const FRAMES_OF_A_FLUSH: u32 = 8_192;

/// What a log holds.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct LogSummary {
    /// Everything that was on the bus.
    pub frames: u64,
    /// Frames with a command.
    pub commands: u64,
    /// Frames with an answer.
    pub answers: u64,
    /// Gaps in senders' sequence numbers.
    pub gaps: u64,
    /// Frames that are missing in them.
    pub lost: u64,
    /// Bytes on the bus that are no frame.
    pub undecodable: u64,
    /// The length of its files.
    pub bytes: u64,
    /// Its files, in order.
    pub parts: Vec<PathBuf>,
}

/// A log that is being written.
pub struct LogWriter {
    path: PathBuf,
    header: LogHeader,
    part: Press,
    number: u32,
    rotation: Rotation,
    /// The file before this one, on its way to the disk.
    settling: Option<JoinHandle<io::Result<()>>>,
    order: HoldBack<Noted>,
    hold: Ticks,
    /// The age at which recorded frames are flushed.
    flush_age: Ticks,
    poll: Duration,
    /// The longest `poll` that keeps to `flush`.
    rest: Duration,
    /// Whether anything but heartbeats has come since the last look.
    lively: bool,
    senders: Senders,
    /// Commands that are still held back, with their places in time: an answer never goes before its command.
    held_commands: VecDeque<(Sequence, Tick)>,
    /// From when on something that is not on disk yet might have been lost.
    oldest: Option<Tick>,
    /// Frames since the last flush.
    unflushed: u32,
    last_time: WallTime,
    teller: Teller,
    /// Events of the daemon that are held back, with their places in time.
    notices: VecDeque<(Tick, Event)>,
    counts: LogSummary,
    /// What the files hold that cannot be lost any more.
    saved: LogSummary,
    /// The length of the files before this one.
    earlier_bytes: u64,
    /// The greatest age at which a frame came.
    lag: Ticks,
}

/// A frame that is held back.
#[derive(Debug)]
struct Noted {
    lane: Lane,
    bytes: Vec<u8>,
    frame: Result<Frame, FrameError>,
    gap: Option<Gap>,
    /// From when on it might have been lost.
    since: Tick,
}

impl LogSummary {
    /// What is in this and in what follows it.
    #[must_use]
    pub fn and(mut self, next: Self) -> Self {
        self.frames += next.frames;
        self.commands += next.commands;
        self.answers += next.answers;
        self.gaps += next.gaps;
        self.lost += next.lost;
        self.undecodable += next.undecodable;
        self.bytes += next.bytes;
        self.parts.extend(next.parts);
        self
    }
}

impl LogWriter {
    /// Begins a log. Header, attachments and channels are on disk when this returns. `flush` is the real time within
    /// which a recorded frame is readable on disk, for callers who come by every [`LogWriter::poll`].
    ///
    /// # Errors
    /// If the file exists, or cannot be made or written; then nothing is left of it.
    pub fn create(path: &Path, header: LogHeader, flush: Duration) -> Result<Self, LogError> {
        Self::resume(path, 1, header, flush)
    }

    /// The same from this part on, of a log whose earlier parts, from 1, somebody else has written. What came between them
    /// and this one is not known to be missing here.
    ///
    /// # Errors
    /// As for [`LogWriter::create`].
    pub fn resume(path: &Path, part: u32, header: LogHeader, flush: Duration) -> Result<Self, LogError> {
        let number = part.max(1);
        let file = part_path(path, number);
        let before = (number > 1).then(|| part_path(path, number - 1));
        let previous = before.and_then(|file| Some(file.file_name()?.to_string_lossy().into_owned()));
        let part = Press::create(&file, &header, &PartPlace { number, previous }, Tick(0))?;
        let Timeline { epoch, scale } = header.timeline;
        // The hold-back, its allowance for clocks that disagree, and a caller's poll together must fit into `flush`; so must
        // the age at which a flush is due, and one poll more.
        let eighth = flush / 8;
        let rest = (eighth * 3).max(Duration::from_millis(1));
        let hold = scale.ticks(HOLD_BACK.min(eighth * 2));
        let counts = LogSummary { parts: vec![file], bytes: part.bytes(), ..LogSummary::default() };
        Ok(Self {
            path: path.to_owned(),
            part,
            number,
            rotation: Rotation::default(),
            settling: None,
            order: HoldBack::new(hold),
            hold,
            flush_age: scale.ticks(eighth * 5),
            poll: POLL.min(rest),
            rest,
            lively: false,
            teller: Teller::new(&header),
            header,
            senders: if number > 1 { Senders::joined_late() } else { Senders::default() },
            held_commands: VecDeque::new(),
            oldest: None,
            unflushed: 0,
            last_time: epoch,
            notices: VecDeque::new(),
            saved: counts.clone(),
            counts,
            earlier_bytes: 0,
            lag: Ticks(0),
        })
    }

    /// The same log, in several files.
    #[must_use]
    pub fn rotating(self, rotation: Rotation) -> Self {
        Self { rotation, ..self }
    }

    /// How time runs in this log.
    #[must_use]
    pub const fn timeline(&self) -> Timeline {
        self.header.timeline
    }

    /// The real time after which [`LogWriter::advance`] should be called again; longer when nothing but heartbeats comes.
    #[must_use]
    pub const fn poll(&self) -> Duration {
        self.poll
    }

    /// What the log holds so far. Its length is that of what is on disk.
    #[must_use]
    pub const fn counts(&self) -> &LogSummary {
        &self.counts
    }

    /// What is on disk, readable, whatever happens from now on.
    #[must_use]
    pub const fn saved(&self) -> &LogSummary {
        &self.saved
    }

    /// The file that is being written.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.part.path()
    }

    /// Whether the disk has no more room than what is set aside for the end of the log. Who goes on recording for long
    /// will see it fail.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.part.is_full()
    }

    /// The greatest age at which a frame has come since this was asked last.
    pub fn take_lag(&mut self) -> Ticks {
        std::mem::replace(&mut self.lag, Ticks(0))
    }

    /// Whether cards were on the bus and each of them has sent its last frame.
    #[must_use]
    pub fn all_cards_left(&self) -> bool {
        self.senders.all_cards_left()
    }

    /// Takes what was on the bus, frame or not. Returns the gap in its sender's numbers, if it shows one: an alarm.
    pub fn record(&mut self, lane: Lane, bytes: &[u8], now: Tick) -> Option<Gap> {
        let frame = Frame::decode(bytes);
        let (gap, at) = self.place(&frame, now);
        let mut since = now;
        if let Ok(frame) = &frame {
            self.lag = self.lag.max(now.since(frame.tick.min(now)));
            // It may have lain on the bus since the last look.
            let look = self.header.timeline.scale.ticks(self.rest);
            since = Tick(frame.tick.0.clamp(now.0.saturating_sub(look.0), now.0));
        }
        self.lively |= !frame.as_ref().is_ok_and(is_heartbeat);
        self.oldest = Some(self.oldest.map_or(since, |oldest| oldest.min(since)));
        self.order.push(at, Noted { lane, bytes: bytes.to_vec(), frame, gap, since });
        gap
    }

    /// Takes an event of the daemon that happened at tick `at`.
    pub fn note(&mut self, at: Tick, event: Event, now: Tick) {
        // One process says them all, so that they keep their order; its clock is this one.
        let at = self.notices.back().map_or(at, |(last, _)| at.max(*last)).min(now);
        self.oldest.get_or_insert(now);
        self.notices.push_back((at, event));
    }

    /// Writes what has been held back long enough, flushes what is due, and goes on in another file when it is time.
    ///
    /// # Errors
    /// If the file cannot be written. What was flushed before stays readable, and the file is closed: only
    /// [`LogWriter::saved`] makes sense then.
    pub fn advance(&mut self, now: Tick) -> Result<(), LogError> {
        self.poll = if std::mem::take(&mut self.lively) { POLL.min(self.rest) } else { self.rest };
        while let Some((at, noted)) = self.order.pop_due(now) {
            self.write(at, &noted)?;
            if self.unflushed >= FRAMES_OF_A_FLUSH {
                self.flush(now)?;
            }
        }
        self.write_notices(Tick(now.0.saturating_sub(self.hold.0)))?;
        if self.oldest.is_some_and(|oldest| now.since(oldest) >= self.flush_age) {
            self.flush(now)?;
        }
        Ok(())
    }

    /// Writes everything, the summary and the footer, and waits until the disk has it.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<LogSummary, LogError> {
        while let Some((at, noted)) = self.order.pop() {
            self.write(at, &noted)?;
        }
        self.write_notices(Tick(u64::MAX))?;
        let (time, batch) = (self.last_time, self.part.batch());
        self.teller.rest(&mut |message| tell(batch, message, time, time));
        let Self { part, settling, mut counts, earlier_bytes, .. } = self;
        let path = part.path().to_owned();
        let (bytes, file) = part.finish()?;
        counts.bytes = earlier_bytes + bytes;
        match file.sync_all().and_then(|()| settled(settling)) {
            Ok(()) => Ok(counts),
            Err(error) => Err(LogError::Write { path, error: error.into() }),
        }
    }

    fn flush(&mut self, now: Tick) -> Result<(), LogError> {
        self.part.flush()?;
        self.unflushed = 0;
        let notices = self.notices.iter().map(|(at, _)| *at);
        self.oldest = self.order.iter().map(|noted| noted.since).chain(notices).min();
        self.save();
        let age = self.header.timeline.scale.real(now.since(self.part.began.min(now)));
        // A full disk has no room for another file either.
        if self.rotation.is_due(self.part.bytes(), age) && !self.part.is_full() {
            self.rotate(now)?;
        }
        Ok(())
    }

    /// Goes on in another file. If there cannot be one, the log stays in this one: that is better than none.
    fn rotate(&mut self, now: Tick) -> Result<(), LogError> {
        let previous = self.part.path().file_name().map(|name| name.to_string_lossy().into_owned());
        let next = loop {
            self.number += 1;
            let place = PartPlace {
                number: u32::try_from(self.counts.parts.len()).unwrap_or(u32::MAX).saturating_add(1),
                previous: previous.clone(),
            };
            match Press::create(&part_path(&self.path, self.number), &self.header, &place, now) {
                Ok(next) => break next,
                // Somebody else's, and precious.
                Err(LogError::Exists { .. }) => {}
                Err(error) => {
                    tracing::error!(%error, "the log does not go on in another file, it stays in this one");
                    self.rotation = Rotation::default();
                    return Ok(());
                }
            }
        };
        let part = std::mem::replace(&mut self.part, next);
        let path = part.path().to_owned();
        let (bytes, file) = part.finish()?;
        self.earlier_bytes += bytes;
        self.counts.parts.push(self.part.path().to_owned());
        self.save();
        // Frames go on coming while the disk takes its time.
        let before = self.settling.take();
        let settle = move || file.sync_all().and_then(|()| settled(before));
        match thread::Builder::new().name("settle".into()).spawn(settle) {
            Ok(settling) => self.settling = Some(settling),
            Err(error) => return Err(LogError::Write { path, error: error.into() }),
        }
        Ok(())
    }

    fn save(&mut self) {
        self.counts.bytes = self.earlier_bytes + self.part.bytes();
        self.saved.clone_from(&self.counts);
    }

    /// The gap that a frame shows, and the tick at which it is put into the file's order: its own; but not before an
    /// earlier frame of its sender or the command that it answers, and not in the future.
    fn place(&mut self, frame: &Result<Frame, FrameError>, now: Tick) -> (Option<Gap>, Tick) {
        let Ok(frame) = frame else { return (None, now) };
        let mut wanted = frame.tick.min(Tick(now.0.saturating_add(self.hold.0)));
        if let Body::Answer(answer) = &frame.body
            && let About::Command(sequence, _) = answer.about
            && let Some(&(_, command)) = self.held_commands.iter().rev().find(|(held, _)| *held == sequence)
        {
            wanted = wanted.max(command);
        }
        let (gap, at) = self.senders.note(frame, wanted);
        if is_ccu_command(frame) {
            self.held_commands.push_back((frame.sequence, at));
        }
        (gap, at)
    }

    fn write(&mut self, at: Tick, noted: &Noted) -> Result<(), LogError> {
        let Noted { lane, bytes, frame, gap, .. } = noted;
        // Frames of one sender leave in the order in which they came, so this is the front one's turn.
        if frame.as_ref().is_ok_and(is_ccu_command) {
            self.held_commands.pop_front();
        }
        self.count(frame.as_ref().ok(), *gap);
        self.write_notices(at)?;
        let time = self.time_of(at);
        let published = self.header.timeline.wall(frame.as_ref().map_or(at, |frame| frame.tick));
        let batch = self.part.batch();
        let place = Place::Microbus(*lane);
        batch.put(Label { place, number: None, log_time: time, publish_time: published }, bytes);
        let seen = Seen { bytes, frame: frame.as_ref(), gap: *gap, time };
        self.teller.of(seen, &mut |message| tell(batch, message, time, published));
        self.part.pass_on()
    }

    /// Writes the daemon's events up to a place in time.
    fn write_notices(&mut self, until: Tick) -> Result<(), LogError> {
        while self.notices.front().is_some_and(|(at, _)| *at <= until)
            && let Some((at, event)) = self.notices.pop_front()
        {
            let (time, published) = (self.time_of(at), self.header.timeline.wall(at));
            let batch = self.part.batch();
            self.teller.event(&event, published, &mut |message| tell(batch, message, time, published));
        }
        self.part.pass_on()
    }

    /// The log time of a place in time: it never falls.
    fn time_of(&mut self, at: Tick) -> WallTime {
        self.last_time = self.header.timeline.wall(at).max(self.last_time);
        self.last_time
    }

    fn count(&mut self, frame: Option<&Frame>, gap: Option<Gap>) {
        self.unflushed += 1;
        self.counts.frames += 1;
        match frame.map(|frame| &frame.body) {
            Some(Body::Command(_) | Body::Fault(..)) => self.counts.commands += 1,
            Some(Body::Answer(_)) => self.counts.answers += 1,
            None => self.counts.undecodable += 1,
        }
        if let Some(gap) = gap {
            self.counts.gaps += 1;
            self.counts.lost = self.counts.lost.saturating_add(gap.lost());
        }
    }
}

/// Puts what viewers are told beside what it follows from.
fn tell(batch: &mut Batch, message: Message<'_>, log_time: WallTime, published: WallTime) {
    let Message { topic, number, time, data } = message;
    let publish_time = time.unwrap_or(published);
    batch.put(Label { place: Place::Topic(topic), number, log_time, publish_time }, data);
}

/// Waits until an earlier file is on the disk.
fn settled(settling: Option<JoinHandle<io::Result<()>>>) -> io::Result<()> {
    let joined = settling.map(JoinHandle::join);
    joined.map_or(Ok(()), |result| {
        result.unwrap_or_else(|_| Err(io::Error::other("the thread that waits for the disk has failed")))
    })
}

fn is_heartbeat(frame: &Frame) -> bool {
    matches!(&frame.body, Body::Answer(answer) if answer.about == About::Unasked(Occasion::Heartbeat))
}

fn is_ccu_command(frame: &Frame) -> bool {
    frame.sender == Sender::Ccu && matches!(frame.body, Body::Command(_))
}
