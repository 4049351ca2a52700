//! What viewers are told: the JSON messages that follow from the frames, one after the other. The log's writer and the live
//! view share this room, so that both say the same. Where messages go, and when, is theirs.

use supersigma_protocol::{AxisNumber, Body, CardKind, Frame, FrameError, Report, Sequence};

use super::channels::{COMMAND, DIGITAL, EVENTS, JOINTS};
use super::events::{Event, Watch};
use super::header::{AxisNames, LogHeader, WallTime};
use super::joints::Joints;
use super::schema::{joint_states_schema, log_schema, twin_into, view_schema};
use super::senders::Gap;
use super::view::{AnswerView, AxisView, CommandView, DigitalView, FrameView};

/// What the messages on all these topics are.
pub const ENCODING: &str = "json";
/// How their schemas are written.
pub const SCHEMA_ENCODING: &str = "jsonschema";

/// A topic of JSON messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// The commands.
    Command,
    /// The digital cards' answers.
    Digital,
    /// What somebody should look at.
    Events,
    /// All axes in one message.
    Joints,
    /// One axis' answers.
    Axis(AxisNumber),
}

impl Topic {
    /// The topics of a set.
    pub fn of_set(names: &AxisNames) -> impl Iterator<Item = Self> {
        let axes = names.iter().map(|(axis, _)| Self::Axis(axis));
        [Self::Command, Self::Digital, Self::Events, Self::Joints].into_iter().chain(axes)
    }

    /// Its name.
    #[must_use]
    pub fn name(self, names: &AxisNames) -> String {
        match self {
            Self::Command => COMMAND.to_owned(),
            Self::Digital => DIGITAL.to_owned(),
            Self::Events => EVENTS.to_owned(),
            Self::Joints => JOINTS.to_owned(),
            Self::Axis(axis) => format!("/axis/{}/status", names.of(axis)),
        }
    }

    /// The name of its schema: those of Foxglove have meaning to viewers.
    #[must_use]
    pub const fn schema_name(self) -> &'static str {
        match self {
            Self::Command => "supersigma.Command",
            Self::Digital => "supersigma.DigitalStatus",
            Self::Events => "foxglove.Log",
            Self::Joints => "foxglove.JointStates",
            Self::Axis(_) => "supersigma.AxisStatus",
        }
    }

    /// Its schema, a JSON Schema.
    #[must_use]
    pub fn schema(self) -> String {
        let schema = match self {
            Self::Command => view_schema::<CommandView>(),
            Self::Digital => view_schema::<AnswerView<DigitalView>>(),
            Self::Events => log_schema(),
            Self::Joints => joint_states_schema(),
            Self::Axis(_) => view_schema::<AnswerView<AxisView>>(),
        };
        schema.to_string()
    }
}

/// One message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Message<'a> {
    /// Where it belongs.
    pub topic: Topic,
    /// The number that it has by itself: that of its frame.
    pub number: Option<Sequence>,
    /// When it holds; `None` is the time of what it follows from.
    pub time: Option<WallTime>,
    /// JSON.
    pub data: &'a [u8],
}

/// What was on the bus, in its place in time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    /// As it travelled.
    pub(super) bytes: &'a [u8],
    /// What that is.
    pub(super) frame: Result<&'a Frame, &'a FrameError>,
    /// What is missing before it.
    pub(super) gap: Option<Gap>,
    /// When it is written.
    pub(super) time: WallTime,
}

/// Makes the messages. Frames must come in the order of the log.
#[derive(Debug)]
pub(super) struct Teller {
    names: AxisNames,
    watch: Watch,
    joints: Joints,
    /// The message that is being told; kept to reuse its memory.
    text: Vec<u8>,
}

impl Teller {
    /// Nothing has been on the bus yet.
    pub(super) fn new(header: &LogHeader) -> Self {
        let names = header.names.clone();
        Self { names, watch: Watch::default(), joints: Joints::new(header), text: Vec::new() }
    }

    /// The messages that follow from a frame go to `tell`.
    pub(super) fn of(&mut self, seen: Seen<'_>, tell: &mut impl FnMut(Message<'_>)) {
        let Seen { bytes, frame, gap, time } = seen;
        let Self { names, watch, joints, text } = self;
        let mut events: Vec<Event> = gap.map(|gap| Event::gap(gap, names)).into_iter().collect();
        match frame {
            Ok(frame) => {
                events.extend(watch.events(frame, names));
                match twin_of(frame, bytes, names, text) {
                    Some(topic) => {
                        tell(Message { topic, number: Some(frame.sequence), time: None, data: text });
                    }
                    None => events.push(Event::stranger(frame)),
                }
                if let Body::Answer(answer) = &frame.body {
                    joints.hear(answer, &mut |time, data| tell(joint_states(time, data)));
                }
            }
            Err(error) => events.push(Event::undecodable(bytes, error)),
        }
        for event in &events {
            self.event(event, time, tell);
        }
    }

    /// An event as a message.
    pub(super) fn event(&mut self, event: &Event, time: WallTime, tell: &mut impl FnMut(Message<'_>)) {
        self.text.clear();
        twin_into(&event.at(time), &mut self.text);
        tell(Message { topic: Topic::Events, number: None, time: None, data: &self.text });
    }

    /// What waits for frames that will not come any more.
    pub(super) fn rest(&mut self, tell: &mut impl FnMut(Message<'_>)) {
        self.joints.rest(&mut |time, data| tell(joint_states(time, data)));
    }
}

fn joint_states(time: WallTime, data: &[u8]) -> Message<'_> {
    Message { topic: Topic::Joints, number: None, time: Some(time), data }
}

/// Writes the twin that belongs to a frame, and says on which topic. A motor's state under an address that is no axis' has none.
pub fn twin_of(frame: &Frame, bytes: &[u8], names: &AxisNames, into: &mut Vec<u8>) -> Option<Topic> {
    into.clear();
    let topic = topic(frame)?;
    match FrameView::new(bytes, Ok(frame), names) {
        FrameView::Command(view) => twin_into(&view, into),
        FrameView::Answer(view) => twin_into(&view, into),
        FrameView::Undecodable(view) => twin_into(&view, into),
    }
    Some(topic)
}

/// Where the twin of a frame belongs; `None` for a motor's state under an address that is no axis'.
fn topic(frame: &Frame) -> Option<Topic> {
    let Body::Answer(answer) = &frame.body else {
        return Some(Topic::Command);
    };
    match (answer.report, answer.card.kind()) {
        (Report::Digital(_), _) => Some(Topic::Digital),
        (Report::Axis(_), CardKind::Axis(axis)) => Some(Topic::Axis(axis)),
        (Report::Axis(_), _) => None,
    }
}
