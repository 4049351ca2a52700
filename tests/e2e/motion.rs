//! A set that is up: what is refused and why, straight lines, and the digital cards.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use supersigma_tests::Cell;

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// Axis 1 towards the upper end, slowly: long enough for everything that has to happen meanwhile.
const LONG: &str = "move left_x 65000 --constant --speed 650";

fn reasons(frames: &[Value]) -> BTreeSet<&str> {
    frames.iter().filter_map(|frame| frame["about"]["refusal"]["reason"].as_str()).collect()
}

#[test]
fn wrong_bytes_are_refused_with_the_reason_and_change_nothing() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    let before = cell.status();
    for (bytes, reason) in [
        ("2A 05", "no card has address 42 (0 everyone, 1 to 7 axes, 8 digital inputs, 9 digital outputs)"),
        ("01 7F", "op-code 7F is unknown"),
        ("00 7F", "op-code 7F is unknown"),
        ("01 05 00", "op-code 05 does not come in 3 bytes"),
        ("01 01 10", "op-code 01 does not come in 3 bytes"),
        ("01", "a command has 2 to 5 bytes, this one has 1"),
        ("01 02 01 00 E9", "speed 233 is above 232, the last entry of the ramp table"),
        ("01 01 00 00", "0 steps are no movement (1 to 65535 are)"),
        ("01 85", "op-code 05 has no direction, its bit 7 must be 0"),
        ("01 0D", "op-code 0D is not for address 1"),
        ("09 01 00 10", "op-code 01 is not for address 9"),
        ("01 01 00 10", "the position is unknown; originate first"),
        ("01 0A 00 10", "no leading axis is set; send Lead before ArmLine"),
        ("01 0B", "no line is armed; send Lead and ArmLine before Go"),
    ] {
        let ran = cell.ccu(&format!("send {bytes}"));
        ran.fails(1, &[&format!("refused: {reason}")]);
        assert!(ran.stdout.contains(reason), "{ran}");
    }
    assert_eq!(cell.status(), before);
    // The robot goes on.
    cell.ccu("origin left_x").done();
    let ran = cell.ccu("send 01 01 01 90 --json").good();
    assert_eq!((&ran.json()[0]["card"], &ran.json()[0]["result"]), (&json!(1), &json!({ "Ok": null })));
    cell.until("left_x", "has made 400 steps", |axis| {
        axis["position"] == 400 && axis["activity"] == "standing"
    });
    assert_eq!(cell.down(), None);
    let frames = cell.frames(&up.log);
    assert_eq!(
        reasons(&frames),
        [
            "direction_not_allowed",
            "no_lead",
            "not_armed",
            "not_originated",
            "speed_out_of_range",
            "too_short",
            "unknown_op_code",
            "wrong_card",
            "wrong_length",
            "zero_steps",
        ]
        .into()
    );
    // Nobody answers for an address that nobody has; but what was sent is in the log, and why it was wrong.
    let unheard: Vec<&Value> = frames.iter().filter(|frame| frame["to"] == 0x2A).collect();
    assert_eq!(
        (unheard.len(), &unheard[0]["name"], &unheard[0]["bytes"]),
        (1, &json!("nobody"), &json!("2A 05"))
    );
    assert!(
        unheard[0]["refusal"].as_str().is_some_and(|why| why.contains("no card has address 42")),
        "{unheard:?}"
    );
}

#[test]
fn what_an_axis_cannot_do_is_refused_with_advice() {
    let cell = Cell::new(EXE);
    let up = cell.up("5");
    cell.ccu("move left_x 100")
        .fails(1, &["axis 1 (left_x) refused at", "the position is unknown", "`ccu origin`"]);
    cell.ccu("line left_x=100 left_y=5").fails(1, &["the position is unknown", "`ccu origin`"]);
    cell.ccu("origin left_x left_y").done();
    cell.ccu("move left_x -1").fails(
        1,
        &["axis 1 (left_x) refused at", "target -1 is outside the travel 0 to 66000", "`ccu config show`"],
    );
    cell.ccu("move left_y 38001")
        .fails(1, &["axis 2 (left_y) refused at", "target 38001 is outside the travel 0 to 38000"]);
    assert_eq!(cell.axis("left_x")["position"], 0);

    assert_eq!(cell.ccu(&format!("{LONG} --no-wait")).good().stdout, "started\n");
    cell.ccu("move left_x 10")
        .fails(1, &["axis 1 (left_x) refused at", "a movement is under way", "`ccu halt`"]);
    cell.ccu("origin left_x").fails(1, &["axis 1 (left_x) refused at", "a movement is under way"]);
    cell.ccu("clear left_x").fails(1, &["axis 1 (left_x) refused at", "a movement is under way"]);
    cell.ccu("line left_x=10 left_y=10").fails(1, &["axis 1 (left_x) refused at", "a movement is under way"]);
    // The other axes are not concerned.
    cell.ccu("move left_y 300").done();
    assert_eq!(cell.axis("left_x")["activity"], "cruising");

    cell.ccu("brake left_x").done();
    let braked = cell.until("left_x", "stands", |axis| axis["activity"] == "standing");
    assert_eq!(braked["alarm"], json!({ "cause": "braked", "message": "braked on command" }));
    assert_eq!(braked["position"], braked["steps"], "it began at 0");
    for line in ["move left_x 10", "origin left_x", "line left_x=10 left_y=10"] {
        cell.ccu(line).fails(1, &["axis 1 (left_x) refused at", "an alarm holds the axis", "`ccu clear`"]);
    }
    assert!(cell.ccu("status").good().stdout.contains("braked on command"));
    cell.ccu("clear left_x").done();
    let cleared = cell.axis("left_x");
    assert_eq!((&cleared["alarm"], &cleared["position"]), (&Value::Null, &braked["position"]));
    let back = cell.ccu(&format!("move left_x -{} --json", braked["position"])).good().json().remove(0);
    assert_eq!(back["position"], 0);
    let said = cell.down().expect("an alarm is worth a word");
    assert!(said.contains("alarm card=axis 1 alarm=braked on command"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert_eq!(
        reasons(&cell.frames(&up.log)),
        ["in_alarm", "moving", "not_originated", "out_of_travel"].into()
    );
}

#[test]
fn lines_end_where_they_should_or_do_not_begin() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    cell.ccu("origin left_x left_y wrist").done();
    cell.ccu("move left_y 13").done();
    let positions = || ["left_x", "left_y", "wrist"].map(|axis| cell.axis(axis)["position"].as_i64());
    let line = cell.ccu("line left_x=7919 left_y=-13 --json").good().json();
    assert_eq!(line.len(), 2);
    for (movement, (asked, position)) in line.iter().zip([(7919, 7919), (-13, 0)]) {
        assert_eq!((&movement["asked"], &movement["position"]), (&json!(asked), &json!(position)));
        assert_eq!((&movement["kind"], &movement["sense"]), (&json!("line"), &json!("00010")));
    }
    // Both end within one step at start speed, 3 077 ticks.
    let ticks = |one: usize| line[one]["ticks"].as_u64().expect("ticks");
    assert!(ticks(0).abs_diff(ticks(1)) <= 3_077, "{line:?}");
    assert_eq!(positions(), [Some(7919), Some(0), Some(0)]);

    // One axis that cannot, and nobody moves; and nobody stays armed.
    cell.ccu("line left_x=-100 wrist=50 left_y=-1")
        .fails(1, &["axis 2 (left_y) refused at", "target -1 is outside the travel"]);
    cell.ccu("line left_x=-100 wrist=50 left_y=60000").fails(1, &["outside the travel 0 to 38000"]);
    assert_eq!(positions(), [Some(7919), Some(0), Some(0)]);
    cell.ccu("line left_x=-7919 wrist=50 left_y=4000 --speed 5000").done();
    assert_eq!(positions(), [Some(0), Some(4000), Some(50)]);
    cell.ccu("line left_x=0 wrist=0").fails(2, &["no axis of the line has any steps"]);
    assert_eq!(cell.down(), None);
    // All start at one tick, the one that the frame names.
    let frames = cell.frames(&up.log);
    let starts: BTreeSet<u64> = frames
        .iter()
        .filter(|frame| frame["operation"] == "Go")
        .filter_map(|frame| frame["at"].as_u64())
        .collect();
    assert_eq!(starts.len(), 2, "two lines were started");
    for start in starts {
        let began = |frame: &&Value| frame["acted_at"] == start && frame["activity"] == "accelerating";
        assert!(frames.iter().filter(began).count() >= 2, "not all began at {start}");
    }
}

#[test]
fn an_input_follows_its_output_to_the_tick() {
    let cell = Cell::new(EXE);
    let up = cell.up("2");
    let lines = |what: &str| cell.ccu(&format!("{what} --json")).good().json().remove(0)["lines"].clone();
    assert_eq!(
        lines("input"),
        json!({ "left_grasped": false, "right_grasped": false, "screw_driven": false,
                "part_present": true, "guard_closed": true })
    );
    assert_eq!(
        lines("output"),
        json!({ "left_gripper": false, "right_gripper": false, "screwdriver": false, "lamp": false })
    );
    assert_eq!(cell.ccu("output screwdriver on").good().stdout, "  2 screwdriver      on\n");
    cell.ccu("output 3 on").done();
    supersigma_tests::eventually("screw_driven", || {
        (lines("input screw_driven") == json!({ "screw_driven": true })).then_some(())
    });
    assert_eq!(cell.ccu("input 2").good().stdout, "  2 screw_driven     on\n");
    cell.ccu("output screwdriver off").done();
    assert_eq!(
        lines("output"),
        json!({ "left_gripper": false, "right_gripper": false, "screwdriver": false, "lamp": true })
    );
    supersigma_tests::eventually("screw_driven", || {
        (lines("input screw_driven") == json!({ "screw_driven": false })).then_some(())
    });
    cell.ccu("output lamb on").fails(2, &["this set has no output \"lamb\"", "did you mean `lamp`?"]);
    cell.ccu("input 16").fails(2, &["this set has no input \"16\""]);
    assert_eq!(cell.down(), None);
    // `screw_driven` follows after 400 ms, 800 000 ticks.
    let frames = cell.frames(&up.log);
    let writes: Vec<&Value> = frames.iter().filter(|frame| frame["operation"] == "WriteOutputs").collect();
    let acted = |write: &&Value| {
        let taken = frames.iter().find(|frame| frame["about"]["command"] == write["sequence"]);
        taken.and_then(|answer| answer["acted_at"].as_u64()).expect("an answer")
    };
    let changes = frames.iter().filter(|frame| frame["about"]["unasked"] == "changed" && frame["axis"] == 8);
    let changes: Vec<u64> = changes.filter_map(|frame| frame["acted_at"].as_u64()).collect();
    assert_eq!(changes, [acted(&writes[0]) + 800_000, acted(&writes[2]) + 800_000]);
}
