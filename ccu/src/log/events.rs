//! What somebody should look at: gaps, bytes that are no frame, refusals, alarms, and what the daemon has to say. Their
//! shape is `foxglove.Log`, which MCAP viewers list with its levels. This room words the events of the bus; it does not
//! decide what follows from them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use supersigma_protocol::{
    About, Address, Alarm, Answer, Body, Command, CommandBytes, Frame, FrameError, Occasion, Report,
};

use super::header::{AxisNames, WallTime};
use super::senders::Gap;
use super::view::{address_name, hex, sender_name};

/// The levels of `foxglove.Log` that occur.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// What happens.
    Info = 2,
    /// What should not happen.
    Warning = 3,
    /// What is wrong.
    Error = 4,
}

/// One event, still without its time.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// How grave it is.
    pub level: Level,
    /// Whom it is about, or who says it.
    pub name: String,
    /// What there is to say.
    pub message: String,
    /// The place in the source text that says it; events of the bus have none.
    pub file: String,
    /// The line there.
    pub line: u32,
}

/// What an event of a log was about, told from its words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Told {
    /// [`Event::gap`].
    Gap { sender: String, lost: u64 },
    /// An alarm that an answer brought.
    Alarm { axis: String, alarm: String },
    /// [`Event::undecodable`].
    Undecodable,
}

/// The beginnings and ends of the words above and below, by which events are told apart.
const MISSING: &str = " frames are missing from the log: ";
const LOCKED: &str = " is locked: ";
const STRANGER: &str = " reports as a motor card, and is none";
const BUS: &str = "bus";

impl Told {
    /// What a message of `/events` is about; `None` for what is neither of these.
    pub(super) fn read(message: &[u8]) -> Option<Self> {
        #[derive(Deserialize)]
        struct Logged {
            level: u8,
            name: String,
            message: String,
        }
        let Logged { level, name, message } = serde_json::from_slice(message).ok()?;
        if level != Level::Error as u8 {
            return None;
        }
        if name == BUS {
            return (!message.ends_with(STRANGER)).then_some(Self::Undecodable);
        }
        if let Some((lost, _)) = message.split_once(MISSING) {
            return Some(Self::Gap { sender: name, lost: lost.parse().ok()? });
        }
        let (axis, alarm) = message.split_once(LOCKED)?;
        Some(Self::Alarm { axis: axis.to_owned(), alarm: alarm.to_owned() })
    }
}

/// `foxglove.Log` as JSON.
#[derive(Debug, Serialize)]
pub(super) struct LogMessage<'a> {
    timestamp: Timestamp,
    level: u8,
    message: &'a str,
    name: &'a str,
    file: &'a str,
    line: u32,
}

/// A time as Foxglove's schemas have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) struct Timestamp {
    sec: u64,
    nsec: u64,
}

impl From<WallTime> for Timestamp {
    fn from(time: WallTime) -> Self {
        Self { sec: time.0 / 1_000_000_000, nsec: time.0 % 1_000_000_000 }
    }
}

impl From<Timestamp> for WallTime {
    fn from(Timestamp { sec, nsec }: Timestamp) -> Self {
        Self(sec.saturating_mul(1_000_000_000).saturating_add(nsec))
    }
}

impl Event {
    pub(crate) fn new(level: Level, name: String, message: String) -> Self {
        Self { level, name, message, file: String::new(), line: 0 }
    }

    /// The event as it is written.
    pub(super) fn at(&self, time: WallTime) -> LogMessage<'_> {
        LogMessage {
            timestamp: time.into(),
            level: self.level as u8,
            message: &self.message,
            name: &self.name,
            file: &self.file,
            line: self.line,
        }
    }

    /// Frames that never arrived.
    pub(super) fn gap(gap: Gap, names: &AxisNames) -> Self {
        let message = format!("{}{MISSING}number {} was due, {} came", gap.lost(), gap.expected.0, gap.got.0);
        Self::new(Level::Error, sender_name(gap.sender, names).into_owned(), message)
    }

    /// A motor's state under an address that is no axis'.
    pub(super) fn stranger(frame: &Frame) -> Self {
        let message = format!("{}{STRANGER}", frame.sender);
        Self::new(Level::Error, BUS.to_owned(), message)
    }

    /// Bytes that are no frame.
    pub(crate) fn undecodable(bytes: &[u8], error: &FrameError) -> Self {
        Self::new(Level::Error, BUS.to_owned(), format!("{error} [{}]", hex(bytes)))
    }
}

/// What is remembered of earlier frames, so that a lasting alarm is one event and a refusal names the command.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    alarms: BTreeMap<Address, Alarm>,
    /// The latest commands by sequence number, at most [`Watch::COMMANDS`].
    commands: BTreeMap<u64, CommandBytes>,
}

impl Watch {
    /// Answers come within milliseconds; this many commands cover seconds.
    const COMMANDS: usize = 1_024;

    /// The events in a frame. Frames must come in the order of the log.
    pub(crate) fn events(&mut self, frame: &Frame, names: &AxisNames) -> Vec<Event> {
        match &frame.body {
            Body::Command(command) => {
                if self.commands.len() == Self::COMMANDS {
                    self.commands.pop_first();
                }
                if frame.sequence.0 == 0 {
                    self.commands.clear();
                }
                self.commands.insert(frame.sequence.0, command.bytes.clone());
                Vec::new()
            }
            Body::Fault(axis, fault) => {
                let text = format!("{}: {fault}, on purpose", names.of(*axis));
                vec![Event::new(Level::Warning, sender_name(frame.sender, names).into_owned(), text)]
            }
            Body::Answer(answer) => {
                let event =
                    |level, text| Event::new(level, sender_name(frame.sender, names).into_owned(), text);
                let refusal = self.refusal(answer).map(|text| event(Level::Warning, text));
                let trouble = match answer.about {
                    About::Unasked(Occasion::Orphaned) => Some("the CCU is gone".to_owned()),
                    About::Unasked(Occasion::Missed(frames)) => {
                        Some(format!("{frames} frames of the CCU never came here"))
                    }
                    _ => None,
                };
                let trouble = trouble.map(|text| event(Level::Error, text));
                let alarm = self.alarm(answer).map(|alarm| {
                    let card = address_name(answer.card, names);
                    event(Level::Error, format!("{card}{LOCKED}{alarm}"))
                });
                refusal.into_iter().chain(trouble).chain(alarm).collect()
            }
        }
    }

    fn refusal(&self, answer: &Answer) -> Option<String> {
        let About::Command(sequence, Err(refusal)) = answer.about else {
            return None;
        };
        let what = match self.commands.get(&sequence.0).map(CommandBytes::as_slice) {
            None => String::new(),
            Some(bytes) => match Command::decode(bytes) {
                Ok(command) => format!(" ({})", command.operation.name()),
                Err(_) => format!(" [{}]", hex(bytes)),
            },
        };
        Some(format!("refused command {}{what}: {refusal}", sequence.0))
    }

    /// The alarm that this answer brings and the one before it did not.
    fn alarm(&mut self, answer: &Answer) -> Option<Alarm> {
        if answer.about == About::Unasked(Occasion::Joined) {
            self.alarms.remove(&answer.card);
        }
        let alarm = match answer.report {
            Report::Axis(report) => report.alarm,
            Report::Digital(_) => None,
        };
        let before = match alarm {
            Some(alarm) => self.alarms.insert(answer.card, alarm),
            None => self.alarms.remove(&answer.card),
        };
        alarm.filter(|_| alarm != before)
    }
}
