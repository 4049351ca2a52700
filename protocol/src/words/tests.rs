//! Words written out by hand, and every word there is.

use proptest::prelude::*;

use super::*;

fn distance(steps: u16) -> Distance {
    Distance::new(steps).expect("not zero")
}

fn control(word: u16) -> ControlWord {
    ControlWord::try_from(word).expect("no unused bit is set")
}

fn operation(motion: MotionWord, control: ControlWord) -> Result<Operation, WordError> {
    Meaning::of(motion, control).map(Meaning::operation)
}

fn words(operation: Operation) -> Option<(MotionWord, ControlWord)> {
    Meaning::of_operation(operation).map(Meaning::words)
}

fn limited(direction: Direction, steps: u16, limit: u8) -> Operation {
    let limit = SpeedIndex::new(limit).expect("in range");
    Operation::MoveLimited { direction, distance: distance(steps), limit }
}

#[test]
fn golden_words() {
    use Direction::{Forward, TowardsOrigin};
    let full = |direction, steps| Operation::Move { direction, distance: distance(steps) };
    // v1 = 8000, v4 = 1000, v5 v6 v7 = 0800 0400 0200, v8 = 0100.
    let golden = [
        (0x0190, 0x0E00, full(Forward, 400)),
        (0x0190, 0x8E00, full(TowardsOrigin, 400)),
        (0x0001, 0x0000, limited(Forward, 1, 0)),
        (0xFFFF, 0x8000, limited(TowardsOrigin, 65_535, 0)),
        (0x04B0, 0x0200, limited(Forward, 1_200, 33)),
        (0x04B0, 0x0400, limited(Forward, 1_200, 66)),
        (0x04B0, 0x0600, limited(Forward, 1_200, 99)),
        (0x04B0, 0x0800, limited(Forward, 1_200, 133)),
        (0x04B0, 0x8A00, limited(TowardsOrigin, 1_200, 166)),
        (0x04B0, 0x8C00, limited(TowardsOrigin, 1_200, 199)),
        (0x0000, 0x1000, Operation::Halt),
        (0x0000, 0x0100, Operation::SeekReference),
    ];
    for (u, v, meaning) in golden {
        assert_eq!(operation(MotionWord(u), control(v)), Ok(meaning), "U = {u:04X}, V = {v:04X}");
        assert_eq!(words(meaning), Some((MotionWord(u), control(v))), "{meaning:?}");
    }
}

#[test]
fn words_cannot_say_everything() {
    let slew =
        Operation::Slew { direction: Direction::Forward, distance: distance(1), speed: SpeedIndex::TOP };
    let between = limited(Direction::Forward, 1, 34);
    for operation in
        [Operation::Originate, Operation::Status, Operation::Brake, Operation::Clear, slew, between]
    {
        assert_eq!(words(operation), None, "{operation:?}");
    }
}

#[test]
fn halt_wins_over_seeking_and_seeking_over_motion() {
    assert_eq!(operation(MotionWord(400), control(0x9F00)), Ok(Operation::Halt));
    assert_eq!(operation(MotionWord(400), control(0x8F00)), Ok(Operation::SeekReference));
    assert_eq!(operation(MotionWord(0), control(0x8E00)), Err(WordError::NoMotion));
}

#[test]
fn every_control_word_is_understood_or_its_unused_bits_are_named() {
    for word in 0..=u16::MAX {
        match ControlWord::try_from(word) {
            Ok(control) => {
                assert_eq!(word & 0x60FF, 0);
                assert_eq!(control.bits(), word);
                let motion = ControlWord::motion(control.direction(), control.level()).bits();
                let points =
                    u16::from(control.halts()) * 0x1000 + u16::from(control.seeks_reference()) * 0x0100;
                assert_eq!(motion | points, word, "every bit is read by somebody");
            }
            Err(error) => {
                assert_eq!(error, WordError::UnusedBits { word, bits: word & 0x60FF });
                assert_ne!(word & 0x60FF, 0);
            }
        }
    }
}

#[test]
fn errors_say_what_is_wrong_and_what_would_be_right() {
    let unused = |word: u16| ControlWord::try_from(word).expect_err("unused bits").to_string();
    assert_eq!(unused(0x6E01), "V = 6E01 has v2, v3, v16 set; v2, v3 and v9 to v16 are unused and must be 0");
    assert_eq!(unused(0x0080), "V = 0080 has v9 set; v2, v3 and v9 to v16 are unused and must be 0");
    assert_eq!(
        WordError::NoMotion.to_string(),
        "U = 0000 is no motion, and V asks for nothing else (1000 halts, 0100 seeks the reference step)"
    );
    assert_eq!(
        WordAddress::try_from(0x10).expect_err("axis 8").to_string(),
        "no word has address 10; axis n has U at 2n and V at 2n + 1, n is 1 to 7"
    );
}

#[test]
fn levels_are_evenly_spaced_from_start_to_top() {
    let limits: Vec<u8> = SpeedLevel::all().map(|level| level.limit().get()).collect();
    assert_eq!(limits, [0, 33, 66, 99, 133, 166, 199, 232]);
    for index in (0..=u8::MAX).filter_map(SpeedIndex::new) {
        let expected = limits.iter().position(|limit| *limit == index.get());
        assert_eq!(SpeedLevel::with_limit(index).map(|level| usize::from(level.get())), expected);
    }
    assert_eq!(SpeedLevel::new(7), Some(SpeedLevel::TOP));
    assert_eq!(SpeedLevel::new(8), None);
}

#[test]
fn the_sense_word_has_x1_first() {
    for bits in 0..32_u16 {
        let on = |number: u16| bits >> (5 - number) & 1 == 1;
        let status = (1..)
            .zip(SensePoint::ALL)
            .fold(StatusWord::default(), |status, (number, point)| status.with(point, on(number)));
        let sense = SenseWord::from(status);
        assert_eq!(sense.bits(), bits << 11);
        assert_eq!(format!("{:016b}", sense.bits()), format!("{status}00000000000"));
    }
    let open_loop_success = StatusWord::default().with(SensePoint::X4, true);
    assert_eq!(SenseWord::from(open_loop_success).to_string(), "1000");
    assert_eq!(SenseWord::from(open_loop_success.with(SensePoint::X5, true)).to_string(), "1800");
}

#[test]
fn each_axis_has_two_addresses() {
    let mut expected = 2;
    for axis in AxisNumber::all() {
        for address in [WordAddress::Motion(axis), WordAddress::Control(axis)] {
            assert_eq!(address.get(), expected);
            assert_eq!(WordAddress::try_from(expected), Ok(address));
            expected += 1;
        }
    }
    for address in [0, 1].into_iter().chain(16..=u8::MAX) {
        assert_eq!(WordAddress::try_from(address), Err(WordError::NoSuchAddress { address }));
    }
}

#[test]
fn words_are_read_in_hexadecimal() {
    assert_eq!("190".parse(), Ok(MotionWord(400)));
    assert_eq!("0x0190".parse(), Ok(MotionWord(400)));
    assert_eq!("8e00".parse(), Ok(control(0x8E00)));
    for wrong in ["", "0x", "10000", "-1", "+1", "12G", "0x0x1", " 1"] {
        assert_eq!(wrong.parse::<MotionWord>(), Err(WordError::NoWord), "{wrong:?}");
        assert_eq!(wrong.parse::<ControlWord>(), Err(WordError::NoWord), "{wrong:?}");
    }
}

proptest! {
    #[test]
    fn what_words_mean_is_said_by_the_same_words(u: u16, v: u16) {
        let (motion, control) = (MotionWord(u), control(v & !UNUSED));
        match operation(motion, control) {
            Err(error) => {
                prop_assert_eq!(error, WordError::NoMotion);
                prop_assert!(u == 0 && control.bits() & 0x1100 == 0);
            }
            Ok(Operation::Halt) => prop_assert!(control.halts()),
            Ok(Operation::SeekReference) => prop_assert!(control.seeks_reference() && !control.halts()),
            Ok(meaning) => prop_assert_eq!(words(meaning), Some((motion, control))),
        }
    }

    #[test]
    fn what_words_can_say_they_say(steps in 1_u16.., limit in 0_u8..=232, towards_origin: bool) {
        let direction = if towards_origin { Direction::TowardsOrigin } else { Direction::Forward };
        let meaning = limited(direction, steps, limit);
        match words(meaning) {
            None => prop_assert!(![0, 33, 66, 99, 133, 166, 199, 232].contains(&limit)),
            // No ceiling and a ceiling at the top are the same movement.
            Some((u, v)) if limit == 232 => {
                let free = Operation::Move { direction, distance: distance(steps) };
                prop_assert_eq!(operation(u, v), Ok(free));
            }
            Some((u, v)) => prop_assert_eq!(operation(u, v), Ok(meaning)),
        }
    }
}
