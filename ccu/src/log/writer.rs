//! The log's writer: frames in, an MCAP file in time order out.
//!
//! It knows no clock: callers say what tick it is now, so everything about it can be tested without waiting. Frames
//! are held back for a few real milliseconds (`order`) so that the file's log times never fall; a frame that comes
//! later still gets the last written time. A chunk is closed and handed to the system while its oldest frame is
//! younger than `flush`: whatever happens to this process, the file holds all but that last moment, and every chunk in it
//! is whole because chunks are built in memory and written at once.

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{About, Body, Frame, FrameError, Sender, Sequence, Tick, Ticks};

use super::LogError;
use super::channels::{Channels, McapFile, write_preamble};
use super::events::Event;
use super::header::{LogHeader, METADATA_NAME, Timeline, WallTime};
use super::messages::{Message, Messages, Seen, event_message};
use super::order::HoldBack;
use super::senders::{Gap, Senders};

/// The real time for which frames are held back, if `flush` leaves room for it.
const HOLD_BACK: Duration = Duration::from_millis(20);
/// The real time after which a caller with nothing to do comes back, if `flush` leaves room for it.
const POLL: Duration = Duration::from_millis(10);

/// What a log holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
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
    /// The length of the file.
    pub bytes: u64,
}

/// A log that is being written.
pub struct LogWriter {
    path: PathBuf,
    header: LogHeader,
    mcap: McapFile,
    channels: Channels,
    order: HoldBack<Noted>,
    hold: Ticks,
    /// The age at which recorded frames are flushed.
    flush_age: Ticks,
    poll: Duration,
    senders: Senders,
    /// Commands that are still held back, with their places in time: an answer never goes before its command.
    held_commands: VecDeque<(Sequence, Tick)>,
    /// When the oldest frame that is not on disk was recorded.
    oldest: Option<Tick>,
    last_time: WallTime,
    messages: Messages,
    /// Events of the daemon that are held back, with their places in time.
    notices: VecDeque<(Tick, Event)>,
    counts: LogSummary,
}

/// A frame that is held back.
#[derive(Debug)]
struct Noted {
    lane: Lane,
    bytes: Vec<u8>,
    frame: Result<Frame, FrameError>,
    gap: Option<Gap>,
    recorded: Tick,
}

impl LogWriter {
    /// Begins a log. Header, attachments and channels are on disk when this returns. `flush` is the real time within
    /// which a recorded frame is readable on disk, for callers who come by every [`LogWriter::poll`].
    ///
    /// # Errors
    /// If the file exists, or cannot be made or written.
    pub fn create(path: &Path, header: LogHeader, flush: Duration) -> Result<Self, LogError> {
        let file =
            OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| {
                match source.kind() {
                    io::ErrorKind::AlreadyExists => LogError::Exists { path: path.to_owned() },
                    _ => LogError::Create { path: path.to_owned(), source },
                }
            })?;
        let write = |source| LogError::Write { path: path.to_owned(), source };
        let mut mcap = WriteOptions::new()
            .profile(METADATA_NAME)
            // One thread is plenty for a bus, and a chunk in memory reaches the file whole or not at all.
            .compression_threads(0)
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(write)?;
        write_preamble(&mut mcap, &header).map_err(write)?;
        let channels = Channels::add(&mut mcap, &header).map_err(write)?;
        mcap.flush().map_err(write)?;

        let Timeline { epoch, .. } = header.timeline;
        // The hold-back, its allowance for clocks that disagree, and a caller's poll together must fit into `flush`.
        let quarter = flush / 4;
        let hold = header.timeline.scale.ticks(HOLD_BACK.min(quarter));
        Ok(Self {
            path: path.to_owned(),
            channels,
            order: HoldBack::new(hold),
            hold,
            flush_age: header.timeline.scale.ticks(quarter * 3),
            poll: POLL.min(quarter).max(Duration::from_millis(1)),
            mcap,
            senders: Senders::default(),
            held_commands: VecDeque::new(),
            oldest: None,
            last_time: epoch,
            messages: Messages::new(&header),
            notices: VecDeque::new(),
            header,
            counts: LogSummary::default(),
        })
    }

    /// How time runs in this log.
    #[must_use]
    pub const fn timeline(&self) -> Timeline {
        self.header.timeline
    }

    /// The real time after which [`LogWriter::advance`] should be called again.
    #[must_use]
    pub const fn poll(&self) -> Duration {
        self.poll
    }

    /// What the log holds so far, without its length.
    #[must_use]
    pub const fn counts(&self) -> LogSummary {
        self.counts
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
        self.counts.frames += 1;
        match &frame {
            Ok(Frame { body: Body::Command(_) | Body::Fault(..), .. }) => self.counts.commands += 1,
            Ok(Frame { body: Body::Answer(_), .. }) => self.counts.answers += 1,
            Err(_) => self.counts.undecodable += 1,
        }
        if let Some(gap) = gap {
            self.counts.gaps += 1;
            self.counts.lost = self.counts.lost.saturating_add(gap.lost());
        }
        self.oldest.get_or_insert(now);
        self.order.push(at, Noted { lane, bytes: bytes.to_vec(), frame, gap, recorded: now });
        gap
    }

    /// Takes an event of the daemon that happened at tick `at`.
    pub fn note(&mut self, at: Tick, event: Event, now: Tick) {
        // One process says them all, so that they keep their order; its clock is this one.
        let at = self.notices.back().map_or(at, |(last, _)| at.max(*last)).min(now);
        self.oldest.get_or_insert(now);
        self.notices.push_back((at, event));
    }

    /// Writes what has been held back long enough, and flushes what is due.
    ///
    /// # Errors
    /// If the file cannot be written. What was flushed before stays readable.
    pub fn advance(&mut self, now: Tick) -> Result<(), LogError> {
        while let Some((at, noted)) = self.order.pop_due(now) {
            self.write(at, &noted)?;
        }
        self.write_notices(Tick(now.0.saturating_sub(self.hold.0)))?;
        if self.oldest.is_some_and(|oldest| now.since(oldest) >= self.flush_age) {
            self.mcap.flush().map_err(|source| self.failed(source))?;
            let notices = self.notices.iter().map(|(at, _)| *at);
            self.oldest = self.order.iter().map(|noted| noted.recorded).chain(notices).min();
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
        if let Some(message) = self.messages.rest() {
            self.tell(&message, self.last_time, self.last_time)?;
        }
        self.mcap.finish().map_err(|source| self.failed(source))?;
        let Self { path, mcap, counts, .. } = self;
        let synced =
            mcap.into_inner().into_inner().map_err(io::IntoInnerError::into_error).and_then(|file| {
                file.sync_all()?;
                Ok(file.metadata()?.len())
            });
        match synced {
            Ok(bytes) => Ok(LogSummary { bytes, ..counts }),
            Err(source) => Err(LogError::Write { path, source: source.into() }),
        }
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
        self.write_notices(at)?;
        let time = self.time_of(at);
        let published = self.header.timeline.wall(frame.as_ref().map_or(at, |frame| frame.tick));
        self.put(self.channels.microbus(*lane), None, time, published, bytes)?;
        let mut told = Vec::new();
        let seen = Seen { bytes, frame: frame.as_ref(), gap: *gap, time };
        self.messages.of(seen, &mut |message| told.push(message));
        told.into_iter().try_for_each(|message| self.tell(&message, time, published))
    }

    /// Writes the daemon's events up to a place in time.
    fn write_notices(&mut self, until: Tick) -> Result<(), LogError> {
        while self.notices.front().is_some_and(|(at, _)| *at <= until)
            && let Some((at, event)) = self.notices.pop_front()
        {
            let (time, published) = (self.time_of(at), self.header.timeline.wall(at));
            self.tell(&event_message(&event, published), time, published)?;
        }
        Ok(())
    }

    /// The log time of a place in time: it never falls.
    fn time_of(&mut self, at: Tick) -> WallTime {
        self.last_time = self.header.timeline.wall(at).max(self.last_time);
        self.last_time
    }

    fn tell(&mut self, message: &Message, time: WallTime, published: WallTime) -> Result<(), LogError> {
        let channel = self.channels.topic(message.topic, &mut self.mcap, &self.header);
        let channel = channel.map_err(|source| self.failed(source))?;
        self.put(channel, message.number, time, message.time.unwrap_or(published), &message.data)
    }

    /// Writes one message. `number` is its place on the channel; without one, messages are counted.
    fn put(
        &mut self,
        channel: u16,
        number: Option<Sequence>,
        log_time: WallTime,
        publish_time: WallTime,
        data: &[u8],
    ) -> Result<(), LogError> {
        let counted = self.channels.count(channel);
        let number = number.map_or(counted, |number| number.0);
        let header = MessageHeader {
            channel_id: channel,
            // The format has 32 bits for it; they wrap.
            sequence: (number & u64::from(u32::MAX)).try_into().unwrap_or_default(),
            log_time: log_time.0,
            publish_time: publish_time.0,
        };
        self.mcap.write_to_known_channel(&header, data).map_err(|source| self.failed(source))
    }

    fn failed(&self, source: McapError) -> LogError {
        LogError::Write { path: self.path.clone(), source }
    }
}

fn is_ccu_command(frame: &Frame) -> bool {
    frame.sender == Sender::Ccu && matches!(frame.body, Body::Command(_))
}
