//! One frame of the bus: an envelope (sender, sequence, tick) round a command or an answer, encoded with postcard.
//! The same bytes go over shared memory and into the log. Decoding never panics; bytes left over are an error.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::command::{Command, CommandBytes};
use crate::refusal::Refusal;
use crate::report::{End, Report};
use crate::units::{Address, AxisNumber, Sequence, Steps, Tick};

/// No frame is longer.
pub const MAX_FRAME_BYTES: usize = 128;

/// What stands on the bus at one moment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Frame {
    /// Who sent it.
    pub sender: Sender,
    /// Its place in what that sender sent.
    pub sequence: Sequence,
    /// When it was sent.
    pub tick: Tick,
    /// What it says.
    pub body: Body,
}

/// Who sends frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Sender {
    /// The central control unit.
    Ccu,
    /// The process that plays the card (or, for the digital ones, both cards) with this address.
    Card(Address),
}

impl std::fmt::Display for Sender {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ccu => f.write_str("CCU"),
            Self::Card(address) => address.fmt(f),
        }
    }
}

/// A command or an answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Body {
    /// From the CCU to one card or to every axis.
    Command(Broadcast),
    /// From a card to the CCU.
    Answer(Answer),
    /// From the CCU to one card's test socket: a fault on purpose. The card answers it like a command.
    Fault(AxisNumber, Fault),
}

/// A fault that is made on purpose, to see what happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The excessive-force input closes for a moment.
    Force,
    /// The end-of-rail input of this end closes for a moment.
    Limit(End),
    /// The next pulses do not reach the motor.
    LostSteps(Steps),
    /// The limit switch of the origination sticks, or is free again.
    Switch(Switch),
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Force => f.write_str("excessive force"),
            Self::Limit(end) => write!(f, "{end} end of the rail"),
            Self::LostSteps(steps) => write!(f, "the next {steps} pulses are lost"),
            Self::Switch(Switch::Free) => f.write_str("limit switch free"),
            Self::Switch(Switch::StuckOpen) => f.write_str("limit switch stuck open"),
            Self::Switch(Switch::StuckClosed) => f.write_str("limit switch stuck closed"),
        }
    }
}

/// What is wrong with a limit switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Switch {
    /// Nothing.
    Free,
    /// It never closes.
    StuckOpen,
    /// It never opens.
    StuckClosed,
}

/// The command bytes and, for those that begin at a common moment, that moment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Broadcast {
    /// \[C\] Table 1; possibly wrong, then a card refuses it.
    pub bytes: CommandBytes,
    /// When Go, Halt or Brake take effect on a line; `None` is at once.
    pub at: Option<Tick>,
}

impl From<Command> for Broadcast {
    fn from(command: Command) -> Self {
        Self { bytes: command.encode(), at: None }
    }
}

/// What a card says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// The card.
    pub card: Address,
    /// What it answers.
    pub about: About,
    /// When the card acted: for an answer, the tick at which it took the command; unasked, the tick of the event.
    pub acted_at: Tick,
    /// Its state at that tick.
    pub report: Report,
}

/// What an answer is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum About {
    /// The command that the CCU sent with this sequence number, and what became of it.
    Command(Sequence, Result<(), Refusal>),
    /// Nobody asked.
    Unasked(Occasion),
}

/// Why a card speaks without being asked. The order is on the wire: new ones come last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Occasion {
    /// The card has come to life.
    Joined,
    /// A sense point, the activity or the alarm changed.
    Changed,
    /// Nothing: it is just alive.
    Heartbeat,
    /// The card goes; this is its last frame.
    Leaving,
    /// Nothing: the axis is on its way, and this is how far it has come.
    Sampled,
    /// The lifeline has ended: the CCU is gone. What follows from it comes after this.
    Orphaned,
    /// So many frames of the CCU never came here. What follows from it comes after this.
    Missed(u32),
}

/// Why bytes are not a frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// They do not decode.
    #[error("not a frame: {0}")]
    Undecodable(postcard::Error),
    /// They decode, and there are more of them.
    #[error("not a frame: {0} bytes too many")]
    Trailing(usize),
}

impl Frame {
    /// The bytes on the bus and in the log; never more than [`MAX_FRAME_BYTES`].
    ///
    /// # Panics
    /// Never: no part of a frame can fail to serialise.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        postcard::to_stdvec(self).expect("frames hold nothing that postcard cannot write")
    }

    /// The frame in `bytes`.
    ///
    /// # Errors
    /// If `bytes` are not exactly one frame.
    pub fn decode(bytes: &[u8]) -> Result<Self, FrameError> {
        match postcard::take_from_bytes(bytes) {
            Ok((frame, [])) => Ok(frame),
            Ok((_, rest)) => Err(FrameError::Trailing(rest.len())),
            Err(error) => Err(FrameError::Undecodable(error)),
        }
    }
}

#[cfg(test)]
mod tests;
