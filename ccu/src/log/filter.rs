//! Which frames of a log are wanted: of an axis, of a span of time, of an operation. It judges frames one by one, in the
//! order of the log; what it must remember for that is bounded.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use supersigma_config::choose;
use supersigma_protocol::{
    About, Address, AxisNumber, Body, Command, Frame, Operation, Sender, Sequence, Tick,
};

use super::header::{Timeline, WallTime};
use super::reader::LoggedFrame;
use super::view::FAULT;

/// How far a frame's log time may lie from its tick, in real nanoseconds. Log times are ticks put into one order: a frame
/// that came to the recorder late has the time of the one before it. A frame is late when its sender was held up
/// between taking the time and sending, which nobody survives for longer than `supervision.silent_ms` (450 ms unless
/// configured otherwise). So this is twenty times more than can be expected.
const SLACK_NS: u64 = 10_000_000_000;

/// What is wanted; nothing named is everything.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Filter {
    /// Frames of this axis, and to it or to everyone.
    pub axis: Option<AxisNumber>,
    /// Frames from this tick on.
    pub from: Option<Tick>,
    /// Frames before this tick.
    pub to: Option<Tick>,
    /// Commands of this operation, as [`operation`] gives it, and the answers to those that are wanted.
    pub operation: Option<&'static str>,
}

impl Filter {
    /// The log times among which all wanted frames are; `None` if that is everywhere.
    #[must_use]
    pub fn log_times(&self, timeline: &Timeline) -> Option<RangeInclusive<WallTime>> {
        if self.from.is_none() && self.to.is_none() {
            return None;
        }
        let from = self.from.map_or(0, |from| timeline.wall(from).0.saturating_sub(SLACK_NS));
        let to = self.to.map_or(u64::MAX, |to| timeline.wall(to).0.saturating_add(SLACK_NS));
        Some(WallTime(from)..=WallTime(to))
    }

    /// Begins to judge a log.
    #[must_use]
    pub fn start(self, timeline: Timeline) -> Judge {
        Judge { filter: self, timeline, asked: BTreeSet::new() }
    }
}

/// The operation that is called so, in whatever letters, with or without `-` and `_`.
///
/// # Errors
/// If none is: a sentence that says which there are, and which may have been meant.
pub fn operation(name: &str) -> Result<&'static str, String> {
    let plain = |name: &str| name.replace(['-', '_'], "").to_lowercase();
    let wanted = plain(name);
    let all = || Operation::NAMES.into_iter().chain([FAULT]);
    all().find(|known| plain(known) == wanted).ok_or_else(|| {
        let lower: Vec<String> = all().map(str::to_lowercase).collect();
        // What was typed is compared in one case, and told in the other.
        let meant = choose(&wanted, lower.iter().map(String::as_str), "the operations are");
        all()
            .zip(&lower)
            .fold(meant, |text, (name, lower)| text.replace(&format!("`{lower}`"), &format!("`{name}`")))
    })
}

/// A filter at work.
#[derive(Debug, Clone)]
pub struct Judge {
    filter: Filter,
    timeline: Timeline,
    /// The wanted commands of the CCU's present life, the latest [`Judge::REMEMBERED`] of them.
    asked: BTreeSet<Sequence>,
}

impl Judge {
    /// Answers come within milliseconds; this many commands cover seconds.
    const REMEMBERED: usize = 1_024;

    /// Whether a frame is wanted. Bytes that are no frame have no tick, no axis and no operation: their log time counts,
    /// and they belong to no axis and no operation.
    pub fn wants(&mut self, logged: &LoggedFrame) -> bool {
        let Filter { axis, from, to, operation } = self.filter;
        let in_time = |tick| from.is_none_or(|from| from <= tick) && to.is_none_or(|to| tick < to);
        let Ok(frame) = &logged.frame else {
            return axis.is_none() && operation.is_none() && in_time(self.timeline.tick(logged.log_time));
        };
        let is_command = frame.sender == Sender::Ccu;
        if is_command && frame.sequence == Sequence(0) {
            self.asked.clear();
        }
        let wanted = in_time(frame.tick)
            && axis.is_none_or(|axis| concerns(frame, axis))
            && operation.is_none_or(|operation| self.is_about(frame, operation));
        if wanted && is_command && operation.is_some() {
            if self.asked.len() == Self::REMEMBERED {
                self.asked.pop_first();
            }
            self.asked.insert(frame.sequence);
        }
        wanted
    }

    fn is_about(&self, frame: &Frame, operation: &str) -> bool {
        match &frame.body {
            Body::Command(command) => Command::decode(command.bytes.as_slice())
                .is_ok_and(|command| command.operation.name() == operation),
            Body::Fault(..) => operation == FAULT,
            Body::Answer(answer) => {
                matches!(answer.about, About::Command(sequence, _) if self.asked.contains(&sequence))
            }
        }
    }
}

/// Whether a frame is for this axis or from it.
pub(crate) fn concerns(frame: &Frame, axis: AxisNumber) -> bool {
    match &frame.body {
        Body::Command(command) => command
            .bytes
            .as_slice()
            .first()
            .is_some_and(|&to| [Address::EVERYONE, axis.address()].contains(&Address(to))),
        Body::Answer(answer) => answer.card == axis.address(),
        Body::Fault(failing, _) => *failing == axis,
    }
}
