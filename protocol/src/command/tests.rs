//! Commands in both directions: hand-written bytes for every op-code, and properties over all byte strings.

use proptest::prelude::*;

use super::*;

const FORWARD: Direction = Direction::Forward;
const TO_ORIGIN: Direction = Direction::TowardsOrigin;

const fn distance(steps: u16) -> Distance {
    Distance::new(steps).unwrap()
}

const fn speed(index: u8) -> SpeedIndex {
    SpeedIndex::new(index).unwrap()
}

/// Every op-code, in both directions where it has one. 5 184 = 0x1440, 65 535 = 0xFFFF, 300 = 0x012C, 232 = 0xE8.
const GOLDENS: &[(&[u8], Address, Operation)] = &[
    (&[1, 0x01, 0x14, 0x40], Address(1), Operation::Move { direction: FORWARD, distance: distance(5_184) }),
    (&[7, 0x81, 0xFF, 0xFF], Address(7), Operation::Move { direction: TO_ORIGIN, distance: Distance::MAX }),
    (
        &[2, 0x02, 0x14, 0x40, 0xE8],
        Address(2),
        Operation::MoveLimited { direction: FORWARD, distance: distance(5_184), limit: SpeedIndex::TOP },
    ),
    (
        &[2, 0x82, 0x00, 0x01, 0x07],
        Address(2),
        Operation::MoveLimited { direction: TO_ORIGIN, distance: distance(1), limit: speed(7) },
    ),
    (
        &[3, 0x03, 0x01, 0x2C, 0x00],
        Address(3),
        Operation::Slew { direction: FORWARD, distance: distance(300), speed: SpeedIndex::START },
    ),
    (
        &[3, 0x83, 0x01, 0x2C, 0x64],
        Address(3),
        Operation::Slew { direction: TO_ORIGIN, distance: distance(300), speed: speed(100) },
    ),
    (&[0, 0x04], Address::EVERYONE, Operation::Originate),
    (&[8, 0x05], Address::DIGITAL_INPUT, Operation::Status),
    (&[4, 0x06], Address(4), Operation::Halt),
    (&[0, 0x07], Address::EVERYONE, Operation::Brake),
    (&[5, 0x08], Address(5), Operation::SeekReference),
    (&[6, 0x09, 0x14, 0x40], Address(6), Operation::Lead { distance: distance(5_184), limit: None }),
    (
        &[6, 0x09, 0x14, 0x40, 0x0A],
        Address(6),
        Operation::Lead { distance: distance(5_184), limit: Some(speed(10)) },
    ),
    (&[6, 0x0A, 0x01, 0x2C], Address(6), Operation::ArmLine { direction: FORWARD, distance: distance(300) }),
    (
        &[6, 0x8A, 0x01, 0x2C],
        Address(6),
        Operation::ArmLine { direction: TO_ORIGIN, distance: distance(300) },
    ),
    (&[0, 0x0B], Address::EVERYONE, Operation::Go),
    (&[1, 0x0C], Address(1), Operation::Clear),
    (&[8, 0x0D], Address::DIGITAL_INPUT, Operation::ReadInputs),
    (&[9, 0x0E, 0x80, 0x01], Address::DIGITAL_OUTPUT, Operation::WriteOutputs { word: 0x8001 }),
    (&[5, 0x21], Address(5), Operation::Rest),
    (&[6, 0x22, 0x20], Address(6), Operation::Join { limit: speed(0x20) }),
];

#[test]
fn every_op_code_has_its_bytes() {
    for &(bytes, to, operation) in GOLDENS {
        let command = Command::new(to, operation);
        assert_eq!(command.encode().as_slice(), bytes, "{command:?}");
        assert_eq!(Command::decode(bytes), Ok(command), "{bytes:02X?}");
        assert_eq!(operation.code(), bytes[1] & 0x7F);
    }
    let mut codes: Vec<_> = GOLDENS.iter().map(|(_, _, operation)| operation.code()).collect();
    codes.dedup();
    assert_eq!(codes, (0x01..=0x0E).chain([0x21, 0x22]).collect::<Vec<_>>(), "an op-code is missing above");
}

#[test]
fn what_is_wrong_is_named_in_the_order_of_the_bytes() {
    let cases: &[(&[u8], Refusal)] = &[
        (&[], Refusal::TooShort { bytes: 0 }),
        (&[1], Refusal::TooShort { bytes: 1 }),
        (&[10, 0x7F], Refusal::UnknownAddress { address: 10 }),
        (&[1, 0x00], Refusal::UnknownOpCode { op_code: 0x00 }),
        (&[1, 0x8F], Refusal::UnknownOpCode { op_code: 0x0F }),
        (&[1, 0x01, 0x00], Refusal::WrongLength { op_code: 0x01, bytes: 3 }),
        (&[1, 0x05, 0x00], Refusal::WrongLength { op_code: 0x05, bytes: 3 }),
        (&[1, 0x09, 0, 1, 2, 3], Refusal::WrongLength { op_code: 0x09, bytes: 6 }),
        (&[1, 0x84], Refusal::DirectionNotAllowed { op_code: 0x04 }),
        (&[1, 0x89, 0x00, 0x00], Refusal::DirectionNotAllowed { op_code: 0x09 }),
        (&[1, 0xA2, 0x00], Refusal::DirectionNotAllowed { op_code: 0x22 }),
        (&[1, 0x22, 0xE9], Refusal::SpeedOutOfRange { speed: 233 }),
        (&[1, 0x22], Refusal::WrongLength { op_code: 0x22, bytes: 2 }),
        (&[9, 0x8E, 0x00, 0x00], Refusal::DirectionNotAllowed { op_code: 0x0E }),
        (&[1, 0x01, 0x00, 0x00], Refusal::ZeroSteps),
        (&[1, 0x02, 0x00, 0x00, 0xFF], Refusal::ZeroSteps),
        (&[1, 0x02, 0x00, 0x01, 0xE9], Refusal::SpeedOutOfRange { speed: 233 }),
        (&[8, 0x04], Refusal::WrongCard { address: 8, op_code: 0x04 }),
        (&[9, 0x0D], Refusal::WrongCard { address: 9, op_code: 0x0D }),
        (&[0, 0x0D], Refusal::WrongCard { address: 0, op_code: 0x0D }),
    ];
    for (bytes, refusal) in cases {
        assert_eq!(Command::decode(bytes), Err(*refusal), "{bytes:02X?}");
    }
}

#[test]
fn more_than_eight_bytes_never_become_a_command() {
    let error = CommandBytes::try_from(vec![0; 9]).unwrap_err();
    assert_eq!(error.to_string(), "9 bytes are too many, a command has 2 to 5");
    assert!(CommandBytes::try_from(vec![0; 8]).is_ok());
}

fn any_operation() -> impl Strategy<Value = Operation> {
    let direction = prop_oneof![Just(FORWARD), Just(TO_ORIGIN)];
    let distance = (1..=u16::MAX).prop_map(distance);
    let index = (0..=SpeedIndex::TOP.get()).prop_map(speed);
    prop_oneof![
        (direction.clone(), distance.clone())
            .prop_map(|(direction, distance)| Operation::Move { direction, distance }),
        (direction.clone(), distance.clone(), index.clone())
            .prop_map(|(direction, distance, limit)| Operation::MoveLimited { direction, distance, limit }),
        (direction.clone(), distance.clone(), index.clone())
            .prop_map(|(direction, distance, speed)| Operation::Slew { direction, distance, speed }),
        Just(Operation::Originate),
        Just(Operation::Rest),
        index.clone().prop_map(|limit| Operation::Join { limit }),
        Just(Operation::Status),
        Just(Operation::Halt),
        Just(Operation::Brake),
        Just(Operation::SeekReference),
        (distance.clone(), proptest::option::of(index))
            .prop_map(|(distance, limit)| Operation::Lead { distance, limit }),
        (direction, distance).prop_map(|(direction, distance)| Operation::ArmLine { direction, distance }),
        Just(Operation::Go),
        Just(Operation::Clear),
        Just(Operation::ReadInputs),
        any::<u16>().prop_map(|word| Operation::WriteOutputs { word }),
    ]
}

/// Any operation, with an address whose card carries it out.
fn any_command() -> impl Strategy<Value = Command> {
    (any_operation(), 0..=7_u8).prop_map(|(operation, axis)| {
        let to = match operation {
            Operation::ReadInputs => Address::DIGITAL_INPUT,
            Operation::WriteOutputs { .. } => Address::DIGITAL_OUTPUT,
            _ => Address(axis),
        };
        Command::new(to, operation)
    })
}

/// Byte strings of which many are nearly commands, so that decoding gets past the first byte.
fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    let likely = (0..=10_u8, 0..=0x0F_u8, any::<bool>(), proptest::collection::vec(any::<u8>(), 0..=4))
        .prop_map(|(address, code, towards_origin, rest)| {
            let mut bytes = vec![address, code | if towards_origin { 0x80 } else { 0 }];
            bytes.extend(rest);
            bytes
        });
    prop_oneof![likely, proptest::collection::vec(any::<u8>(), 0..=8)]
}

proptest! {
    #[test]
    fn a_command_survives_its_bytes(command in any_command()) {
        let bytes = command.encode();
        prop_assert!((2..=5).contains(&bytes.as_slice().len()));
        prop_assert_eq!(Command::decode(bytes.as_slice()), Ok(command));
    }

    #[test]
    fn bytes_that_decode_are_the_only_ones_of_their_command(bytes in any_bytes()) {
        if let Ok(command) = Command::decode(&bytes) {
            let encoded = command.encode();
            prop_assert_eq!(encoded.as_slice(), &bytes[..]);
        }
    }
}

/// All of the 65 536 two-byte strings, and each of them with every length that a longer command can have.
#[test]
fn every_address_and_op_code_decodes_or_is_refused() {
    let mut commands = 0;
    for head in 0..=u16::MAX {
        let [address, code] = head.to_be_bytes();
        for length in 2..=CommandBytes::MAX {
            let bytes = &[address, code, 0x01, 0x2C, 0x07, 0, 0, 0][..length];
            if let Ok(command) = Command::decode(bytes) {
                assert_eq!(command.encode().as_slice(), bytes);
                commands += 1;
            }
        }
    }
    // Addresses 0 to 7 take 8 directed forms (01, 02, 03 and 0A), Lead in 2, Join, and 8 bare ones; 8 and 9 take 2 each.
    assert_eq!(commands, 8 * (8 + 2 + 1 + 8) + 2 + 2);
}
