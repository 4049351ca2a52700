//! Bytes into the two decoders of the wire: command bytes and frames.

use supersigma_protocol::{Command, Frame, MAX_FRAME_BYTES, Refusal};

/// Takes `bytes` for a command, and for a frame.
pub fn commands(bytes: &[u8]) {
    match Command::decode(bytes) {
        Ok(command) => assert_eq!(command.encode().as_slice(), bytes, "{command:?}"),
        Err(refusal) => names_what_is_there(refusal, bytes),
    }
    if let Ok(frame) = Frame::decode(bytes) {
        let encoded = frame.encode();
        assert!(encoded.len() <= bytes.len().min(MAX_FRAME_BYTES), "{frame:?} from {bytes:02X?}");
        assert_eq!(Frame::decode(&encoded).as_ref(), Ok(&frame), "{bytes:02X?}");
    }
}

/// A refusal by the decoder is about these very bytes.
fn names_what_is_there(refusal: Refusal, bytes: &[u8]) {
    let length = |told: u8| usize::from(told) == bytes.len().min(u8::MAX.into());
    let op_code = |told: u8| told == bytes[1] & 0x7F;
    let holds = match refusal {
        Refusal::TooShort { bytes: told } => bytes.len() < 2 && length(told),
        Refusal::UnknownAddress { address } => address == bytes[0] && address > 9,
        Refusal::UnknownOpCode { op_code: told } => op_code(told),
        Refusal::WrongLength { op_code: told, bytes: count } => op_code(told) && length(count),
        Refusal::DirectionNotAllowed { op_code: told } => op_code(told) && bytes[1] & 0x80 != 0,
        Refusal::WrongCard { address, op_code: told } => address == bytes[0] && op_code(told),
        Refusal::ZeroSteps => bytes[2..4] == [0, 0],
        Refusal::SpeedOutOfRange { speed } => bytes.last() == Some(&speed),
        // Only a card knows any other.
        _ => false,
    };
    assert!(holds, "{refusal:?} of {bytes:02X?}");
    assert!(!refusal.to_string().is_empty());
}
