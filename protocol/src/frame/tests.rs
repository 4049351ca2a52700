//! Frames and their bytes: hand-encoded goldens, the length that no frame exceeds, and properties over all frames.

use proptest::prelude::*;

use super::*;
use crate::command::Operation;
use crate::report::{Activity, Alarm, AxisReport, End, Pace, SensePoint, StatusWord};
use crate::units::{Deviation, Direction, Distance, Position, SpeedIndex, Steps, Ticks};

fn check(frame: &Frame, bytes: &[u8]) {
    let encoded = frame.encode();
    assert_eq!(encoded, bytes, "{encoded:02X?} for {frame:?}");
    assert_eq!(Frame::decode(bytes).as_ref(), Ok(frame));
}

// In postcard an enum is its variant's index, an integer above one byte comes in groups of seven bits, lowest first,
// with bit 7 set on all but the last; signed ones are zigzag-folded; an Option is 00 or 01; a byte string has its length in front.
//   300 = AC 02    5 184 = C0 28    2 000 000 = 80 89 7A    2 000 050 = B2 89 7A    2 000 100 = E4 89 7A
//   60 000 = E0 D4 03    −13 → 25 = 19

#[test]
fn a_command_frame_has_these_bytes() {
    let command = Command::new(
        Address(3),
        Operation::MoveLimited {
            direction: Direction::TowardsOrigin,
            distance: Distance::new(5_184).unwrap(),
            limit: SpeedIndex::TOP,
        },
    );
    let frame = Frame {
        sender: Sender::Ccu,
        sequence: Sequence(300),
        tick: Tick(2_000_000),
        body: Body::Command(command.into()),
    };
    #[rustfmt::skip]
    check(&frame, &[
        0x00,                               // sender: CCU
        0xAC, 0x02,                         // sequence
        0x80, 0x89, 0x7A,                   // tick
        0x00,                               // body: command
        0x05, 0x03, 0x82, 0x14, 0x40, 0xE8, // five command bytes
        0x00,                               // at: at once
    ]);
}

#[test]
fn a_start_frame_carries_its_tick() {
    let start = Broadcast {
        bytes: Command::new(Address::EVERYONE, Operation::Go).encode(),
        at: Some(Tick(2_000_100)),
    };
    let frame = Frame {
        sender: Sender::Ccu,
        sequence: Sequence(0),
        tick: Tick(2_000_000),
        body: Body::Command(start),
    };
    check(&frame, &[0x00, 0x00, 0x80, 0x89, 0x7A, 0x00, 0x02, 0x00, 0x0B, 0x01, 0xE4, 0x89, 0x7A]);
}

#[test]
fn an_answer_frame_has_these_bytes() {
    let answer = Answer {
        card: Address(3),
        about: About::Command(Sequence(300), Ok(())),
        acted_at: Tick(2_000_050),
        report: Report::Axis(AxisReport {
            sense: StatusWord::default().with(SensePoint::X4, true),
            steps: Steps(5_184),
            position: Some(Position(-13)),
            activity: Activity::Standing,
            alarm: None,
            lost: None,
            pace: Some(Pace { period: Ticks(300), direction: Direction::TowardsOrigin }),
        }),
    };
    let frame = Frame {
        sender: Sender::Card(Address(3)),
        sequence: Sequence(1),
        tick: Tick(2_000_100),
        body: Body::Answer(answer),
    };
    #[rustfmt::skip]
    check(&frame, &[
        0x01, 0x03,             // sender: card 3
        0x01,                   // sequence
        0xE4, 0x89, 0x7A,       // tick
        0x01,                   // body: answer
        0x03,                   // card
        0x00, 0xAC, 0x02, 0x00, // about command 300, carried out
        0xB2, 0x89, 0x7A,       // acted at
        0x00,                   // report: axis
        0x08,                   // X1..X5: X4
        0xC0, 0x28,             // steps
        0x01, 0x19,             // position
        0x00,                   // standing
        0x00,                   // no alarm
        0x00,                   // no origination to compare with
        0x01, 0xAC, 0x02, 0x01, // a pulse every 300 ticks, towards the origin
    ]);
}

#[test]
fn an_unasked_alarm_and_a_refusal_have_these_bytes() {
    let report = AxisReport {
        sense: StatusWord::default(),
        steps: Steps(0),
        position: None,
        activity: Activity::SeekingReference,
        alarm: Some(Alarm::SwitchNeverClosed(Steps(60_000))),
        lost: Some(Deviation(-37)),
        pace: None,
    };
    let mut answer = Answer {
        card: Address(7),
        about: About::Unasked(Occasion::Changed),
        acted_at: Tick(5),
        report: Report::Axis(report),
    };
    let mut frame = Frame {
        sender: Sender::Card(Address(7)),
        sequence: Sequence(0),
        tick: Tick(6),
        body: Body::Answer(answer),
    };
    let tail = [0x05, 0x00, 0x00, 0x00, 0x00, 0x08, 0x01, 0x03, 0xE0, 0xD4, 0x03, 0x01, 0x49, 0x00];
    check(&frame, &[&[0x01, 0x07, 0x00, 0x06, 0x01, 0x07, 0x01, 0x01][..], &tail].concat());
    answer.about = About::Command(Sequence(2), Err(Refusal::SpeedOutOfRange { speed: 233 }));
    frame.body = Body::Answer(answer);
    check(&frame, &[&[0x01, 0x07, 0x00, 0x06, 0x01, 0x07, 0x00, 0x02, 0x01, 0x07, 0xE9][..], &tail].concat());
}

#[test]
fn the_longest_frame_fits() {
    let answer = Answer {
        card: Address(u8::MAX),
        about: About::Command(
            Sequence(u64::MAX),
            Err(Refusal::OutOfTravel {
                target: Position(i32::MIN),
                min: Position(i32::MIN),
                max: Position(i32::MIN),
            }),
        ),
        acted_at: Tick(u64::MAX),
        report: Report::Axis(AxisReport {
            sense: StatusWord::default(),
            steps: Steps(u32::MAX),
            position: Some(Position(i32::MIN)),
            activity: Activity::SeekingReference,
            alarm: Some(Alarm::ReferenceNotFound(Steps(u32::MAX))),
            lost: Some(Deviation(i32::MIN)),
            pace: Some(Pace { period: Ticks(u64::MAX), direction: Direction::TowardsOrigin }),
        }),
    };
    let frame = Frame {
        sender: Sender::Card(Address(u8::MAX)),
        sequence: Sequence(u64::MAX),
        tick: Tick(u64::MAX),
        body: Body::Answer(answer),
    };
    // A u64 takes 10 bytes at most, a 32-bit integer 5: envelope 2 + 10 + 10, answer 1 + 1, about 1 + 10 + 1 + 1 + 3·5,
    // acted at 10, report 1 + 1 + 5 + (1 + 5) + 1 + (1 + 1 + 5) + (1 + 5) + (1 + 10 + 1).
    assert_eq!(frame.encode().len(), 22 + 2 + 28 + 10 + 39);
}

#[test]
fn bytes_left_over_are_an_error_that_counts_them() {
    let frame = Frame {
        sender: Sender::Ccu,
        sequence: Sequence(0),
        tick: Tick(0),
        body: Body::Command(Command::new(Address(1), Operation::Halt).into()),
    };
    let mut bytes = frame.encode();
    bytes.extend([0, 0, 0]);
    assert_eq!(Frame::decode(&bytes), Err(FrameError::Trailing(3)));
    assert_eq!(FrameError::Trailing(3).to_string(), "not a frame: 3 bytes too many");
    assert!(matches!(Frame::decode(&bytes[..4]), Err(FrameError::Undecodable(_))));
}

#[test]
fn nine_command_bytes_do_not_come_through_a_frame() {
    let bytes = [0x00, 0x00, 0x00, 0x00, 0x09, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0x00];
    assert!(matches!(Frame::decode(&bytes), Err(FrameError::Undecodable(_))));
}

#[test]
fn senders_print_as_people_name_them() {
    assert_eq!(Sender::Ccu.to_string(), "CCU");
    assert_eq!(Sender::Card(Address(3)).to_string(), "axis 3");
    assert_eq!(Sender::Card(Address(8)).to_string(), "card 8 (digital inputs)");
}

fn any_refusal() -> impl Strategy<Value = Refusal> {
    let position = || any::<i32>().prop_map(Position);
    prop_oneof![
        any::<u8>().prop_map(|bytes| Refusal::TooShort { bytes }),
        any::<(u8, u8)>().prop_map(|(op_code, bytes)| Refusal::WrongLength { op_code, bytes }),
        any::<u8>().prop_map(|address| Refusal::UnknownAddress { address }),
        any::<u8>().prop_map(|op_code| Refusal::UnknownOpCode { op_code }),
        any::<u8>().prop_map(|op_code| Refusal::DirectionNotAllowed { op_code }),
        any::<(u8, u8)>().prop_map(|(address, op_code)| Refusal::WrongCard { address, op_code }),
        Just(Refusal::ZeroSteps),
        any::<u8>().prop_map(|speed| Refusal::SpeedOutOfRange { speed }),
        Just(Refusal::Moving),
        Just(Refusal::NotOriginated),
        Just(Refusal::InAlarm),
        (position(), position(), position()).prop_map(|(target, min, max)| Refusal::OutOfTravel {
            target,
            min,
            max
        }),
        Just(Refusal::NoLead),
        any::<(u16, u16)>().prop_map(|(steps, lead)| Refusal::LongerThanLead { steps, lead }),
        Just(Refusal::NotArmed),
        any::<u64>().prop_map(|by| Refusal::Late { by: Ticks(by) }),
        Just(Refusal::NoStartTick),
    ]
}

fn any_alarm() -> impl Strategy<Value = Alarm> {
    let steps = || any::<u32>().prop_map(Steps);
    prop_oneof![
        Just(Alarm::Braked),
        Just(Alarm::EndOfRail(End::Lower)),
        Just(Alarm::EndOfRail(End::Upper)),
        Just(Alarm::ExcessiveForce),
        steps().prop_map(Alarm::SwitchNeverClosed),
        steps().prop_map(Alarm::SwitchNeverOpened),
        steps().prop_map(Alarm::ReferenceNotFound),
        Just(Alarm::CcuLost),
        any::<u32>().prop_map(Alarm::FramesLost),
    ]
}

fn any_axis_report() -> impl Strategy<Value = AxisReport> {
    let activity = proptest::sample::select(vec![
        Activity::Standing,
        Activity::Armed,
        Activity::Accelerating,
        Activity::Cruising,
        Activity::Decelerating,
        Activity::Creeping,
        Activity::Braking,
        Activity::Originating,
        Activity::SeekingReference,
    ]);
    let pace = (1..=u64::MAX, any::<bool>()).prop_map(|(period, forward)| Pace {
        period: Ticks(period),
        direction: if forward { Direction::Forward } else { Direction::TowardsOrigin },
    });
    let parts = (
        any::<[bool; 5]>(),
        any::<u32>(),
        any::<Option<i32>>(),
        activity,
        proptest::option::of(any_alarm()),
        proptest::option::of(pace),
    );
    parts.prop_map(|(points, steps, position, activity, alarm, pace)| AxisReport {
        sense: SensePoint::ALL
            .into_iter()
            .zip(points)
            .fold(StatusWord::default(), |word, (point, on)| word.with(point, on)),
        steps: Steps(steps),
        position: position.map(Position),
        activity,
        alarm,
        lost: position.map(|position| Deviation(position / 2)),
        pace,
    })
}

fn any_answer() -> impl Strategy<Value = Answer> {
    let occasion = proptest::sample::select(vec![
        Occasion::Joined,
        Occasion::Changed,
        Occasion::Heartbeat,
        Occasion::Leaving,
        Occasion::Sampled,
        Occasion::Orphaned,
        Occasion::Missed(3),
    ]);
    let about = prop_oneof![
        (any::<u64>(), proptest::option::of(any_refusal())).prop_map(|(sequence, refusal)| {
            About::Command(Sequence(sequence), refusal.map_or(Ok(()), Err))
        }),
        occasion.prop_map(About::Unasked),
    ];
    let report =
        prop_oneof![any_axis_report().prop_map(Report::Axis), any::<u16>().prop_map(Report::Digital)];
    (any::<u8>(), about, any::<u64>(), report).prop_map(|(card, about, acted_at, report)| Answer {
        card: Address(card),
        about,
        acted_at: Tick(acted_at),
        report,
    })
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let command = (proptest::collection::vec(any::<u8>(), 0..=CommandBytes::MAX), any::<Option<u64>>())
        .prop_map(|(bytes, at)| Broadcast { bytes: bytes.try_into().unwrap(), at: at.map(Tick) });
    let body = prop_oneof![command.prop_map(Body::Command), any_answer().prop_map(Body::Answer)];
    (any::<Option<u8>>(), any::<u64>(), any::<u64>(), body).prop_map(|(card, sequence, tick, body)| Frame {
        sender: card.map_or(Sender::Ccu, |address| Sender::Card(Address(address))),
        sequence: Sequence(sequence),
        tick: Tick(tick),
        body,
    })
}

proptest! {
    #[test]
    fn a_frame_survives_its_bytes(frame in any_frame()) {
        let bytes = frame.encode();
        prop_assert!(bytes.len() <= MAX_FRAME_BYTES);
        prop_assert_eq!(Frame::decode(&bytes), Ok(frame));
    }

    #[test]
    fn a_frame_cut_short_is_no_frame(frame in any_frame(), cut in any::<proptest::sample::Index>()) {
        let bytes = frame.encode();
        let cut = cut.index(bytes.len());
        prop_assert!(matches!(Frame::decode(&bytes[..cut]), Err(FrameError::Undecodable(_))));
    }

    #[test]
    fn garbage_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..=2 * MAX_FRAME_BYTES)) {
        if let Ok(frame) = Frame::decode(&bytes) {
            prop_assert_eq!(Frame::decode(&frame.encode()), Ok(frame));
        }
    }

    #[test]
    fn a_damaged_frame_never_panics(
        frame in any_frame(),
        at in any::<proptest::sample::Index>(),
        byte in any::<u8>(),
    ) {
        let mut bytes = frame.encode();
        let at = at.index(bytes.len());
        bytes[at] = byte;
        if let Ok(frame) = Frame::decode(&bytes) {
            prop_assert_eq!(Frame::decode(&frame.encode()), Ok(frame));
        }
    }
}
