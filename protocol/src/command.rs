//! Commands ⇄ the 2 to 5 bytes of \[C\] Table 1: address, op-code, steps MSB, steps LSB, speed.
//!
//! ```text
//!   byte 1    byte 2               bytes 3 4          byte 5
//!   address   d o o o o o o o      steps, MSB first   index into the ramp table
//!             │ └ op-code 01 … 0E, and 21, 22 for paths
//!             └ direction: 1 is towards the origin
//! ```
//!
//! `decode` is total and never panics; whatever it does not take comes back as a [`Refusal`] that names the reason.
//! What a command *does* is the card's business, not this module's.

use serde::{Deserialize, Serialize};

use crate::refusal::Refusal;
use crate::units::{Address, CardKind, Direction, Distance, SpeedIndex};

const TOWARDS_ORIGIN: u8 = 0x80;

/// A command, addressed to one card or to every axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Command {
    /// Whom it is for.
    pub to: Address,
    /// What is to be done.
    pub operation: Operation,
}

/// What a command asks for. The op-codes are those of the wire table in `docs/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Operation {
    /// 01: a movement with the full ramp, or as much of it as fits.
    Move {
        /// Where to.
        direction: Direction,
        /// How far.
        distance: Distance,
    },
    /// 02: a movement whose ramp stops at `limit`.
    MoveLimited {
        /// Where to.
        direction: Direction,
        /// How far.
        distance: Distance,
        /// The ceiling.
        limit: SpeedIndex,
    },
    /// 03: a movement at one constant speed, without a ramp.
    Slew {
        /// Where to.
        direction: Direction,
        /// How far.
        distance: Distance,
        /// The speed.
        speed: SpeedIndex,
    },
    /// 04: backward until the limit switch closes, forward until it opens; that point is 0.
    Originate,
    /// 05: report.
    Status,
    /// 06: stop with the normal ramp, keep the position.
    Halt,
    /// 07: emergency stop with the steep ramp, keep the position, lock until cleared.
    Brake,
    /// 08: find the reference step.
    SeekReference,
    /// 09: the leading axis of the line to come, and its speed ceiling if it has one.
    Lead {
        /// The steps of the axis that has most of them.
        distance: Distance,
        /// The ceiling for the leading axis.
        limit: Option<SpeedIndex>,
    },
    /// 0A: this card's own part of the line.
    ArmLine {
        /// Where to.
        direction: Direction,
        /// How far; not further than the leading axis.
        distance: Distance,
    },
    /// 0B: start the armed line at the tick that the frame names.
    Go,
    /// 21: this card stands in the leg that `Lead` has named.
    Rest,
    /// 22: how fast the joint after the last armed leg may be passed; without it, at start speed.
    Join {
        /// The ceiling of the leading axis there.
        limit: SpeedIndex,
    },
    /// 0C: acknowledge an alarm.
    Clear,
    /// 0D: report the digital inputs (card 8).
    ReadInputs,
    /// 0E: set the sixteen digital outputs (card 9).
    WriteOutputs {
        /// Bit n is output n.
        word: u16,
    },
}

impl Operation {
    /// Bits 6..0 of the second byte.
    #[must_use]
    pub const fn code(&self) -> u8 {
        match self {
            Self::Move { .. } => 0x01,
            Self::MoveLimited { .. } => 0x02,
            Self::Slew { .. } => 0x03,
            Self::Originate => 0x04,
            Self::Status => 0x05,
            Self::Halt => 0x06,
            Self::Brake => 0x07,
            Self::SeekReference => 0x08,
            Self::Lead { .. } => 0x09,
            Self::ArmLine { .. } => 0x0A,
            Self::Go => 0x0B,
            Self::Clear => 0x0C,
            Self::ReadInputs => 0x0D,
            Self::WriteOutputs { .. } => 0x0E,
            Self::Rest => 0x21,
            Self::Join { .. } => 0x22,
        }
    }

    /// Whether it may set something going: everything but asking, stopping and acknowledging.
    #[must_use]
    pub const fn sets_going(&self) -> bool {
        !matches!(self, Self::Status | Self::Halt | Self::Brake | Self::Clear | Self::ReadInputs)
    }

    /// All names, in the order of the operation bytes.
    pub const NAMES: [&'static str; 16] = [
        "Move",
        "MoveLimited",
        "Slew",
        "Originate",
        "Status",
        "Halt",
        "Brake",
        "SeekReference",
        "Lead",
        "ArmLine",
        "Go",
        "Clear",
        "ReadInputs",
        "WriteOutputs",
        "Rest",
        "Join",
    ];

    /// The operation's name, as people read it in tables and logs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Move { .. } => "Move",
            Self::MoveLimited { .. } => "MoveLimited",
            Self::Slew { .. } => "Slew",
            Self::Originate => "Originate",
            Self::Status => "Status",
            Self::Halt => "Halt",
            Self::Brake => "Brake",
            Self::SeekReference => "SeekReference",
            Self::Lead { .. } => "Lead",
            Self::ArmLine { .. } => "ArmLine",
            Self::Go => "Go",
            Self::Clear => "Clear",
            Self::ReadInputs => "ReadInputs",
            Self::WriteOutputs { .. } => "WriteOutputs",
            Self::Rest => "Rest",
            Self::Join { .. } => "Join",
        }
    }

    /// Whether a card of this kind carries out such an operation.
    const fn suits(self, kind: CardKind) -> bool {
        match kind {
            CardKind::Everyone | CardKind::Axis(_) => {
                !matches!(self, Self::ReadInputs | Self::WriteOutputs { .. })
            }
            CardKind::DigitalInput => matches!(self, Self::ReadInputs | Self::Status),
            CardKind::DigitalOutput => matches!(self, Self::WriteOutputs { .. } | Self::Status),
            CardKind::Unknown(_) => false,
        }
    }
}

impl Command {
    /// A command for `to`.
    #[must_use]
    pub const fn new(to: Address, operation: Operation) -> Self {
        Self { to, operation }
    }

    /// The bytes on the bus, 2 to 5 of them.
    #[must_use]
    pub fn encode(&self) -> CommandBytes {
        let mut bytes = vec![self.to.0, self.operation.code()];
        let mut movement = |direction: Direction, distance: Distance, speed: Option<SpeedIndex>| {
            if direction == Direction::TowardsOrigin {
                bytes[1] |= TOWARDS_ORIGIN;
            }
            bytes.extend(distance.get().to_be_bytes());
            bytes.extend(speed.map(SpeedIndex::get));
        };
        match self.operation {
            Operation::Move { direction, distance } | Operation::ArmLine { direction, distance } => {
                movement(direction, distance, None);
            }
            Operation::MoveLimited { direction, distance, limit } => {
                movement(direction, distance, Some(limit));
            }
            Operation::Slew { direction, distance, speed } => movement(direction, distance, Some(speed)),
            Operation::Lead { distance, limit } => movement(Direction::Forward, distance, limit),
            Operation::WriteOutputs { word } => bytes.extend(word.to_be_bytes()),
            Operation::Join { limit } => bytes.push(limit.get()),
            Operation::Originate
            | Operation::Status
            | Operation::Halt
            | Operation::Brake
            | Operation::SeekReference
            | Operation::Go
            | Operation::Rest
            | Operation::Clear
            | Operation::ReadInputs => {}
        }
        CommandBytes(bytes)
    }

    /// The meaning of `bytes`.
    ///
    /// # Errors
    /// The first thing that is wrong with them, in the order of the bytes: length, address, op-code, direction,
    /// steps, speed.
    pub fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        let &[address, code, ref rest @ ..] = bytes else {
            return Err(Refusal::TooShort { bytes: bytes.len().try_into().unwrap_or(u8::MAX) });
        };
        let to = Address(address);
        if let CardKind::Unknown(address) = to.kind() {
            return Err(Refusal::UnknownAddress { address });
        }
        let operation = decode_operation(code, rest, bytes.len())?;
        if !operation.suits(to.kind()) {
            return Err(Refusal::WrongCard { address, op_code: operation.code() });
        }
        Ok(Self { to, operation })
    }
}

fn decode_operation(code: u8, rest: &[u8], length: usize) -> Result<Operation, Refusal> {
    let op_code = code & !TOWARDS_ORIGIN;
    let direction = if code & TOWARDS_ORIGIN == 0 { Direction::Forward } else { Direction::TowardsOrigin };
    let wrong_length = || Refusal::WrongLength { op_code, bytes: length.try_into().unwrap_or(u8::MAX) };
    let undirected = || match direction {
        Direction::Forward => Ok(()),
        Direction::TowardsOrigin => Err(Refusal::DirectionNotAllowed { op_code }),
    };
    let bare = |operation| match rest {
        [] => undirected().map(|()| operation),
        _ => Err(wrong_length()),
    };
    let distance = |msb, lsb| Distance::new(u16::from_be_bytes([msb, lsb])).ok_or(Refusal::ZeroSteps);
    let index = |speed| SpeedIndex::new(speed).ok_or(Refusal::SpeedOutOfRange { speed });
    match (op_code, rest) {
        (0x01, &[msb, lsb]) => Ok(Operation::Move { direction, distance: distance(msb, lsb)? }),
        (0x02, &[msb, lsb, speed]) => {
            Ok(Operation::MoveLimited { direction, distance: distance(msb, lsb)?, limit: index(speed)? })
        }
        (0x03, &[msb, lsb, speed]) => {
            Ok(Operation::Slew { direction, distance: distance(msb, lsb)?, speed: index(speed)? })
        }
        (0x04, _) => bare(Operation::Originate),
        (0x05, _) => bare(Operation::Status),
        (0x06, _) => bare(Operation::Halt),
        (0x07, _) => bare(Operation::Brake),
        (0x08, _) => bare(Operation::SeekReference),
        (0x09, &[msb, lsb]) => {
            undirected()?;
            Ok(Operation::Lead { distance: distance(msb, lsb)?, limit: None })
        }
        (0x09, &[msb, lsb, speed]) => {
            undirected()?;
            Ok(Operation::Lead { distance: distance(msb, lsb)?, limit: Some(index(speed)?) })
        }
        (0x0A, &[msb, lsb]) => Ok(Operation::ArmLine { direction, distance: distance(msb, lsb)? }),
        (0x0B, _) => bare(Operation::Go),
        (0x0C, _) => bare(Operation::Clear),
        (0x0D, _) => bare(Operation::ReadInputs),
        (0x0E, &[msb, lsb]) => {
            undirected()?;
            Ok(Operation::WriteOutputs { word: u16::from_be_bytes([msb, lsb]) })
        }
        (0x21, _) => bare(Operation::Rest),
        (0x22, &[limit]) => {
            undirected()?;
            Ok(Operation::Join { limit: index(limit)? })
        }
        (0x01..=0x03 | 0x09 | 0x0A | 0x0E | 0x22, _) => Err(wrong_length()),
        _ => Err(Refusal::UnknownOpCode { op_code }),
    }
}

/// The bytes of one command as they travel: whatever the sender put there, right or wrong, up to
/// [`CommandBytes::MAX`] of them.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "Vec<u8>")]
pub struct CommandBytes(Vec<u8>);

impl CommandBytes {
    /// More than the longest command, so that a wrong length can still be sent, refused and logged.
    pub const MAX: usize = 8;

    /// The bytes, first the address.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.0
    }
}

/// More bytes than a command can ever have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0} bytes are too many, a command has 2 to 5")]
pub struct TooManyBytes(pub usize);

impl TryFrom<Vec<u8>> for CommandBytes {
    type Error = TooManyBytes;
    fn try_from(bytes: Vec<u8>) -> Result<Self, TooManyBytes> {
        if bytes.len() <= Self::MAX { Ok(Self(bytes)) } else { Err(TooManyBytes(bytes.len())) }
    }
}

#[cfg(test)]
mod tests;
