//! Why a command was not carried out. A refusal changes nothing on the card that gives it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::report::End;
use crate::units::{Position, SpeedIndex, Ticks};

/// The reasons, each with what one needs to mend it. New reasons are added at the end: their order is on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// Fewer than two bytes.
    #[error("a command has 2 to 5 bytes, this one has {bytes}")]
    TooShort {
        /// How many there were.
        bytes: u8,
    },
    /// The op-code is known, but not with so many bytes.
    #[error("op-code {op_code:02X} does not come in {bytes} bytes")]
    WrongLength {
        /// Bits 6..0 of the second byte.
        op_code: u8,
        /// How many bytes there were in all.
        bytes: u8,
    },
    /// No card has this address.
    #[error("no card has address {address} (0 everyone, 1 to 7 axes, 8 digital inputs, 9 digital outputs)")]
    UnknownAddress {
        /// The first byte.
        address: u8,
    },
    /// Not in the table of op-codes.
    #[error("op-code {op_code:02X} is unknown (01 to 0E, 21 and 22 are known)")]
    UnknownOpCode {
        /// Bits 6..0 of the second byte.
        op_code: u8,
    },
    /// Bit 7 is set although the operation has no direction.
    #[error("op-code {op_code:02X} has no direction, its bit 7 must be 0")]
    DirectionNotAllowed {
        /// Bits 6..0 of the second byte.
        op_code: u8,
    },
    /// The card does not carry out such operations.
    #[error("op-code {op_code:02X} is not for address {address}")]
    WrongCard {
        /// The first byte.
        address: u8,
        /// Bits 6..0 of the second byte.
        op_code: u8,
    },
    /// A movement of no steps.
    #[error("0 steps are no movement (1 to 65535 are)")]
    ZeroSteps,
    /// The fifth byte does not index the ramp table.
    #[error("speed {speed} is above {top}, the last entry of the ramp table", top = SpeedIndex::TOP.get())]
    SpeedOutOfRange {
        /// The fifth byte.
        speed: u8,
    },
    /// A movement is under way (or armed); halt it, or wait for X4.
    #[error("a movement is under way; wait for it, or halt it first")]
    Moving,
    /// The position is unknown.
    #[error("the position is unknown; originate first")]
    NotOriginated,
    /// An alarm holds the axis.
    #[error("an alarm holds the axis; clear it first")]
    InAlarm,
    /// The target is outside the configured travel.
    #[error("target {target} is outside the travel {min} to {max}")]
    OutOfTravel {
        /// Where the movement would have ended.
        target: Position,
        /// The lowest permitted position.
        min: Position,
        /// The highest permitted position.
        max: Position,
    },
    /// An arm-line command without a leading axis.
    #[error("no leading axis is set; send Lead before ArmLine")]
    NoLead,
    /// A follower of a line cannot have more steps than the leading axis.
    #[error("{steps} steps are more than the {lead} of the leading axis")]
    LongerThanLead {
        /// The steps asked of this axis.
        steps: u16,
        /// The steps of the leading axis.
        lead: u16,
    },
    /// A start without an armed line.
    #[error("no line is armed; send Lead and ArmLine before Go")]
    NotArmed,
    /// The start tick has passed already.
    #[error("late: the start tick passed {by} ticks ago", by = by.0)]
    Late {
        /// By how much.
        by: Ticks,
    },
    /// The frame of a start names no tick to start at.
    #[error("the frame names no tick to start at")]
    NoStartTick,
    /// The carriage stands in a limit zone; only movements away from that end are possible.
    #[error("the carriage stands in the {end} limit zone; it can only move away from that end")]
    AtEnd {
        /// Which end.
        end: End,
    },
    /// No more legs can be armed.
    #[error("the path has as many legs as a card can hold; start it, or halt it to begin anew")]
    PathFull,
    /// The axis' steps in all legs of a path together are more than its counter counts.
    #[error("the legs have {steps} steps on this axis, a path has 65535 at most; make it in parts")]
    PathTooLong {
        /// The steps of this axis in all legs.
        steps: u32,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_what_is_wrong_and_what_would_be_right() {
        let cases = [
            (Refusal::TooShort { bytes: 1 }, "a command has 2 to 5 bytes, this one has 1"),
            (Refusal::WrongLength { op_code: 0x0A, bytes: 2 }, "op-code 0A does not come in 2 bytes"),
            (
                Refusal::UnknownOpCode { op_code: 0x7F },
                "op-code 7F is unknown (01 to 0E, 21 and 22 are known)",
            ),
            (
                Refusal::SpeedOutOfRange { speed: 233 },
                "speed 233 is above 232, the last entry of the ramp table",
            ),
            (
                Refusal::OutOfTravel { target: Position(-13), min: Position(0), max: Position(40_000) },
                "target -13 is outside the travel 0 to 40000",
            ),
            (
                Refusal::LongerThanLead { steps: 301, lead: 300 },
                "301 steps are more than the 300 of the leading axis",
            ),
            (Refusal::Late { by: Ticks(2_580) }, "late: the start tick passed 2580 ticks ago"),
        ];
        for (refusal, message) in cases {
            assert_eq!(refusal.to_string(), message);
        }
    }
}
