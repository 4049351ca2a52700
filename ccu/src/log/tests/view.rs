//! Goldens of the decoded forms: their keys and columns are a contract.

use std::sync::LazyLock;

use serde_json::json;
use supersigma_protocol::{Alarm, Command, Direction, Distance, FrameError, Operation, SpeedIndex};

use super::*;
use crate::log::{FrameView, Lines};

/// Views borrow the names.
static NAMES: LazyLock<AxisNames> = LazyLock::new(names);

fn view(frame: &Frame) -> FrameView<'static> {
    FrameView::new(&frame.encode(), Ok(frame), &NAMES)
}

fn json_of(frame: &Frame) -> serde_json::Value {
    serde_json::to_value(view(frame)).expect("views serialise")
}

fn limited_move() -> Frame {
    let operation = Operation::MoveLimited {
        direction: Direction::TowardsOrigin,
        distance: Distance::new(2_600).expect("not zero"),
        limit: SpeedIndex::new(90).expect("in the table"),
    };
    let mut frame = command(17, 3, Command::new(Address(1), operation).encode().as_slice());
    let Body::Command(command) = &mut frame.body else { unreachable!("made above") };
    command.at = Some(Tick(5_000_001));
    frame
}

#[test]
fn a_command_in_json() {
    assert_eq!(
        json_of(&limited_move()),
        json!({
            "kind": "command",
            "tick": 3, "time_s": 0.000_001_5, "sender": "ccu", "sequence": 17,
            "to": 1, "name": "left_x", "bytes": "01 82 0A 28 5A",
            "operation": "MoveLimited", "refusal": null,
            "direction": "towards_origin", "steps": 2600, "speed": 90, "word": null, "fault": null, "at": 5_000_001,
        })
    );
}

#[test]
fn bytes_that_are_no_command_in_json() {
    assert_eq!(
        json_of(&command(0, 2_000_000, &[0, 0x7F])),
        json!({
            "kind": "command",
            "tick": 2_000_000, "time_s": 1.0, "sender": "ccu", "sequence": 0,
            "to": 0, "name": "everyone", "bytes": "00 7F",
            "operation": null, "refusal": "op-code 7F is unknown (01 to 0E, 21 and 22 are known)",
            "direction": null, "steps": null, "speed": null, "word": null, "fault": null, "at": null,
        })
    );
    let empty = json_of(&command(0, 0, &[]));
    assert_eq!((&empty["to"], &empty["name"], &empty["bytes"]), (&json!(null), &json!("nobody"), &json!("")));
}

#[test]
fn outputs_in_json() {
    let outputs = json_of(&command(0, 0, &[9, 0x0E, 0x80, 0x01]));
    assert_eq!(
        (&outputs["operation"], &outputs["name"], &outputs["word"]),
        (&json!("WriteOutputs"), &json!("digital outputs"), &json!(0x8001))
    );
}

#[test]
fn an_answer_in_json() {
    let frame = alarmed(2, 4, 4_000_000, REFUSED, Some(Alarm::SwitchNeverClosed(Steps(900))));
    assert_eq!(
        json_of(&frame),
        json!({
            "kind": "answer",
            "tick": 4_000_000, "time_s": 2.0, "sender": "left_y", "sequence": 4,
            "axis": 2, "name": "left_y",
            "about": {
                "command": 0,
                "refusal": { "reason": "not_originated", "message": "the position is unknown; originate first" },
            },
            "acted_at": 3_999_997,
            "sense": "00010", "x1": false, "x2": false, "x3": false, "x4": true, "x5": false,
            "steps": 2600, "position": -17, "activity": "standing",
            "lost": null, "speed": 0.0, "period": null,
            "alarm": {
                "cause": "switch_never_closed",
                "message": "the limit switch did not close within 900 steps",
            },
        })
    );
}

#[test]
fn an_unasked_answer_in_json() {
    let mut frame = answer(5, 0, 0, HEARTBEAT);
    let Body::Answer(Answer { report: Report::Axis(report), .. }) = &mut frame.body else {
        unreachable!("made above")
    };
    report.position = None;
    let json = json_of(&frame);
    assert_eq!(json["about"], json!({ "unasked": "heartbeat" }));
    // Axis 5 is not in the configuration: its number is its name.
    assert_eq!((&json["sender"], &json["name"]), (&json!("5"), &json!("5")));
    assert!(json.as_object().is_some_and(|json| json.contains_key("position")), "null is said, not left out");
    assert_eq!((&json["position"], &json["alarm"]), (&json!(null), &json!(null)));

    let taken = json_of(&answer(1, 0, 0, About::Command(Sequence(9), Ok(()))));
    assert_eq!(taken["about"], json!({ "command": 9, "refusal": null }));
}

#[test]
fn a_digital_answer_in_json() {
    let mut frame = answer(8, 1, 0, HEARTBEAT);
    let Body::Answer(answer) = &mut frame.body else { unreachable!("made above") };
    answer.report = Report::Digital(0b101);
    assert_eq!(
        json_of(&frame),
        json!({
            "kind": "answer", "tick": 0, "time_s": 0.0, "sender": "digital", "sequence": 1,
            "axis": 8, "name": "digital inputs", "about": { "unasked": "heartbeat" }, "acted_at": 0, "word": 5,
        })
    );
}

#[test]
fn bytes_that_are_no_frame_in_json() {
    let bytes = [0xFF, 0x00];
    let error = Frame::decode(&bytes).expect_err("no such sender");
    let view = FrameView::new(&bytes, Err(&error), &NAMES);
    assert_eq!(
        serde_json::to_value(view).expect("views serialise"),
        json!({ "kind": "undecodable", "bytes": "FF 00", "error": error.to_string() })
    );
}

#[test]
fn lines_for_people() {
    let lines = Lines::new(&NAMES);
    let refused = alarmed(2, 4, 4_000_001, REFUSED, Some(Alarm::Braked));
    let error = FrameError::Trailing(3);
    let frames = [
        view(&limited_move()),
        view(&command(18, 20_000_000, &[2, 0x01, 0x00, 0x02])),
        view(&command(19, 20_000_001, &[0, 0x7F])),
        view(&answer(1, 3, 3_000_000, HEARTBEAT)),
        view(&refused),
        FrameView::new(&[1, 2], Err(&error), &NAMES),
    ];
    let text: Vec<String> =
        std::iter::once(lines.title()).chain(frames.iter().map(|frame| lines.line(frame))).collect();
    let expected = [
        "        seconds  from              to               what                          X1..5  steps position steps/s  activity",
        "      0.0000015  ccu             → left_x           #17 MoveLimited -2600 speed 90 at 2.5000005 s",
        "     10.0000000  ccu             → left_y           #18 Move +2",
        "     10.0000005  ccu             → everyone         #19 [00 7F] not a command: op-code 7F is unknown (01 to 0E, 21 and 22 are known)",
        "      1.5000000  left_x          → ccu              heartbeat                     00010   2600      -17       0  standing",
        "      2.0000005  left_y          → ccu              refuses #0                    00010   2600      -17       0  standing           alarm: braked on command  refused: the position is unknown; originate first",
        "              -  ?               → ?                not a frame: 3 bytes too many [01 02]",
    ];
    assert_eq!(text, expected, "\n{}\n", text.join("\n"));
}
