//! Frames decoded for JSON: what the log's twin channels and `ccu frames --json` show. The keys are a contract.
//!
//! A view repeats what the frame says, by name and by number; it adds no judgement. `bytes` is what travelled, and
//! `operation` is null when they do not decode.

use std::borrow::Cow;
use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::Serialize;
use supersigma_protocol::{
    About, Activity, Address, Alarm, Answer, AxisNumber, AxisReport, Body, Broadcast, CardKind, Command,
    Deviation, Direction, Fault, Frame, FrameError, Occasion, Operation, Pace, Position, Refusal, Report,
    Sender, SensePoint, Sequence, SpeedIndex, Steps, Tick, Ticks,
};

use super::header::AxisNames;

/// What stands where the operation's name would, for a fault on purpose, which is no operation of the MICROBUS.
pub(super) const FAULT: &str = "Fault";

/// Any frame. In JSON, `kind` says which: `command`, `answer` or `undecodable`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FrameView<'a> {
    /// From the CCU.
    Command(CommandView<'a>),
    /// From a card.
    Answer(AnswerView<'a>),
    /// Not a frame.
    Undecodable(UndecodableView),
}

/// A command on the bus.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct CommandView<'a> {
    /// When it was sent, in ticks of 0.5 µs since the set's epoch.
    pub tick: Tick,
    /// The same in seconds of machine time.
    pub time_s: f64,
    /// Who sent it: `ccu`.
    pub sender: Cow<'a, str>,
    /// Its number among the sender's frames.
    pub sequence: Sequence,
    /// The address byte; null if there is none.
    pub to: Option<Address>,
    /// Whom the address names: an axis, `everyone`, `digital inputs`, `digital outputs` or `nobody`.
    pub name: Cow<'a, str>,
    /// The bytes of the command in hexadecimal, as in `01 81 0A 28`.
    pub bytes: String,
    /// What is to be done; null if the bytes do not decode.
    pub operation: Option<&'static str>,
    /// Why the bytes do not decode; null if they do.
    pub refusal: Option<String>,
    /// Where to, for operations that have a direction.
    pub direction: Option<Direction>,
    /// How far, for operations that have steps.
    pub steps: Option<Steps>,
    /// The speed or its ceiling, an index into the ramp table.
    pub speed: Option<SpeedIndex>,
    /// The digital outputs to set.
    pub word: Option<u16>,
    /// A fault that was made on purpose, which is no command of the MICROBUS and has no bytes.
    pub fault: Option<String>,
    /// The tick at which a line starts, halts or brakes; null is at once.
    pub at: Option<Tick>,
}

/// An answer on the bus; `R` is what the card reports.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AnswerView<'a, R = ReportView> {
    /// When it was sent, in ticks of 0.5 µs since the set's epoch.
    pub tick: Tick,
    /// The same in seconds of machine time.
    pub time_s: f64,
    /// Who sent it: an axis' name, or `digital`.
    pub sender: Cow<'a, str>,
    /// Its number among the sender's frames.
    pub sequence: Sequence,
    /// The address of the card.
    pub axis: Address,
    /// Whom the address names.
    pub name: Cow<'a, str>,
    /// What it is about.
    pub about: AboutView,
    /// The tick at which the card acted.
    pub acted_at: Tick,
    /// The card's state at that tick.
    #[serde(flatten)]
    pub report: R,
}

/// What an answer is about.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum AboutView {
    /// A command of the CCU.
    Command {
        /// The command's sequence number.
        command: Sequence,
        /// Why it is not carried out; null if it is.
        refusal: Option<RefusalView>,
    },
    /// Nobody asked.
    Unasked {
        /// `joined`, `changed`, `heartbeat`, `leaving`, `sampled`, `orphaned` or `missed`.
        unasked: &'static str,
    },
}

/// Why a command is not carried out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct RefusalView {
    /// For programs, as in `not_originated`.
    pub reason: String,
    /// For people.
    pub message: String,
}

/// What a card reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ReportView {
    /// A motor card.
    Axis(AxisView),
    /// A digital card.
    Digital(DigitalView),
}

/// The state of a motor card.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[expect(clippy::struct_excessive_bools, reason = "five sense points are five lamps on the panel")]
pub struct AxisView {
    /// X1..X5, X1 first, as in `00010`.
    pub sense: String,
    /// In the lower limit zone.
    pub x1: bool,
    /// In the upper limit zone.
    pub x2: bool,
    /// At the reference step.
    pub x3: bool,
    /// Motion complete.
    pub x4: bool,
    /// Measured speed below S1.
    pub x5: bool,
    /// Steps done in this movement, or in the last one.
    pub steps: Steps,
    /// Steps from the origin; null if the card does not know.
    pub position: Option<Position>,
    /// What it is doing.
    pub activity: Activity,
    /// Why it is locked; null if it is not.
    pub alarm: Option<AlarmView>,
    /// By how many steps the last origination found it off from where it was believed to be; null if nothing was believed.
    pub lost: Option<Deviation>,
    /// Its speed in steps per second, negative towards the origin.
    pub speed: f64,
    /// The pulse period that is running, in ticks of 0.5 µs; null if no pulse is to come.
    pub period: Option<Ticks>,
}

/// Why an axis is locked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct AlarmView {
    /// For programs, as in `excessive_force`.
    pub cause: String,
    /// For people.
    pub message: String,
}

/// The state of a digital card.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct DigitalView {
    /// Bit n is line n.
    pub word: u16,
}

/// Bytes on the bus that are not a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct UndecodableView {
    /// The bytes in hexadecimal.
    pub bytes: String,
    /// Why they are not a frame.
    pub error: String,
}

impl<'a> FrameView<'a> {
    /// The view of what was on the bus: `bytes`, and the frame in them.
    #[must_use]
    pub fn new(bytes: &[u8], frame: Result<&Frame, &FrameError>, names: &'a AxisNames) -> Self {
        match frame {
            Ok(frame) => match &frame.body {
                Body::Command(command) => Self::Command(command_view(frame, command, names)),
                Body::Fault(axis, fault) => Self::Command(fault_view(frame, *axis, *fault, names)),
                Body::Answer(answer) => Self::Answer(answer_view(frame, answer, names)),
            },
            Err(error) => Self::Undecodable(UndecodableView { bytes: hex(bytes), error: error.to_string() }),
        }
    }
}

/// Who sent a frame, as the views name it.
pub(crate) fn sender_name(sender: Sender, names: &AxisNames) -> Cow<'_, str> {
    match sender {
        Sender::Ccu => "ccu".into(),
        Sender::Card(address) => match address.kind() {
            CardKind::Axis(axis) => names.of(axis),
            CardKind::DigitalInput | CardKind::DigitalOutput => "digital".into(),
            CardKind::Everyone | CardKind::Unknown(_) => format!("card {}", address.0).into(),
        },
    }
}

/// Whom an address names.
pub(super) fn address_name(address: Address, names: &AxisNames) -> Cow<'_, str> {
    match address.kind() {
        CardKind::Everyone => "everyone".into(),
        CardKind::Axis(axis) => names.of(axis),
        CardKind::DigitalInput => "digital inputs".into(),
        CardKind::DigitalOutput => "digital outputs".into(),
        CardKind::Unknown(_) => "nobody".into(),
    }
}

/// The bytes as `01 81 0A 28`.
pub(super) fn hex(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(3 * bytes.len());
    for byte in bytes {
        let gap = if text.is_empty() { "" } else { " " };
        let _ = write!(text, "{gap}{byte:02X}");
    }
    text
}

fn command_view<'a>(frame: &Frame, command: &Broadcast, names: &'a AxisNames) -> CommandView<'a> {
    let bytes = command.bytes.as_slice();
    let to = bytes.first().copied().map(Address);
    let decoded = Command::decode(bytes);
    let mut view = CommandView {
        tick: frame.tick,
        time_s: frame.tick.since(Tick(0)).as_seconds(),
        sender: sender_name(frame.sender, names),
        sequence: frame.sequence,
        to,
        name: to.map_or("nobody".into(), |to| address_name(to, names)),
        bytes: hex(bytes),
        operation: decoded.as_ref().ok().map(|command| command.operation.name()),
        refusal: decoded.as_ref().err().map(Refusal::to_string),
        direction: None,
        steps: None,
        speed: None,
        word: None,
        fault: None,
        at: command.at,
    };
    match decoded.map(|command| command.operation) {
        Ok(Operation::Move { direction, distance } | Operation::ArmLine { direction, distance }) => {
            (view.direction, view.steps) = (Some(direction), Some(distance.steps()));
        }
        Ok(
            Operation::MoveLimited { direction, distance, limit: speed }
            | Operation::Slew { direction, distance, speed },
        ) => {
            (view.direction, view.steps, view.speed) = (Some(direction), Some(distance.steps()), Some(speed));
        }
        Ok(Operation::Lead { distance, limit }) => {
            (view.steps, view.speed) = (Some(distance.steps()), limit);
        }
        Ok(Operation::Join { limit }) => view.speed = Some(limit),
        Ok(Operation::WriteOutputs { word }) => view.word = Some(word),
        Ok(
            Operation::Originate
            | Operation::Status
            | Operation::Halt
            | Operation::Brake
            | Operation::SeekReference
            | Operation::Go
            | Operation::Rest
            | Operation::Clear
            | Operation::ReadInputs,
        )
        | Err(_) => {}
    }
    view
}

fn fault_view<'a>(frame: &Frame, axis: AxisNumber, fault: Fault, names: &'a AxisNames) -> CommandView<'a> {
    CommandView {
        tick: frame.tick,
        time_s: frame.tick.since(Tick(0)).as_seconds(),
        sender: sender_name(frame.sender, names),
        sequence: frame.sequence,
        to: Some(axis.address()),
        name: names.of(axis),
        bytes: String::new(),
        operation: Some(FAULT),
        refusal: None,
        direction: None,
        steps: None,
        speed: None,
        word: None,
        fault: Some(fault.to_string()),
        at: None,
    }
}

fn answer_view<'a>(frame: &Frame, answer: &Answer, names: &'a AxisNames) -> AnswerView<'a> {
    AnswerView {
        tick: frame.tick,
        time_s: frame.tick.since(Tick(0)).as_seconds(),
        sender: sender_name(frame.sender, names),
        sequence: frame.sequence,
        axis: answer.card,
        name: address_name(answer.card, names),
        about: match answer.about {
            About::Command(command, outcome) => {
                AboutView::Command { command, refusal: outcome.err().map(RefusalView::from) }
            }
            About::Unasked(occasion) => AboutView::Unasked {
                unasked: match occasion {
                    Occasion::Joined => "joined",
                    Occasion::Changed => "changed",
                    Occasion::Heartbeat => "heartbeat",
                    Occasion::Leaving => "leaving",
                    Occasion::Sampled => "sampled",
                    Occasion::Orphaned => "orphaned",
                    Occasion::Missed(_) => "missed",
                },
            },
        },
        acted_at: answer.acted_at,
        report: match answer.report {
            Report::Axis(report) => ReportView::Axis(report.into()),
            Report::Digital(word) => ReportView::Digital(DigitalView { word }),
        },
    }
}

impl From<AxisReport> for AxisView {
    fn from(report: AxisReport) -> Self {
        let AxisReport { sense, steps, position, activity, alarm, lost, pace } = report;
        Self {
            sense: sense.to_string(),
            x1: sense.has(SensePoint::X1),
            x2: sense.has(SensePoint::X2),
            x3: sense.has(SensePoint::X3),
            x4: sense.has(SensePoint::X4),
            x5: sense.has(SensePoint::X5),
            steps,
            position,
            activity,
            alarm: alarm.map(AlarmView::from),
            lost,
            speed: pace.map_or(0.0, Pace::steps_per_second),
            period: pace.map(|pace| pace.period),
        }
    }
}

impl From<Refusal> for RefusalView {
    fn from(refusal: Refusal) -> Self {
        Self { reason: variant_name(&refusal), message: refusal.to_string() }
    }
}

impl From<Alarm> for AlarmView {
    fn from(alarm: Alarm) -> Self {
        Self { cause: variant_name(&alarm), message: alarm.to_string() }
    }
}

/// The name serde gives to an enum's variant, without what the variant holds.
fn variant_name(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        Ok(serde_json::Value::Object(fields)) => fields.keys().next().cloned().unwrap_or_default(),
        _ => String::new(),
    }
}
