//! Every alarm and refusal has its advice, and the book's chapter says the same.

use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use supersigma_protocol::{End, Steps, Ticks};

use super::*;

const CHAPTER: &str = include_str!("../../../docs/src/guide/alarms.md");

fn alarms() -> Vec<Alarm> {
    vec![
        Alarm::Braked,
        Alarm::EndOfRail(End::Lower),
        Alarm::ExcessiveForce,
        Alarm::SwitchNeverClosed(Steps(20_000)),
        Alarm::SwitchNeverOpened(Steps(900)),
        Alarm::ReferenceNotFound(Steps(1_234)),
        Alarm::CcuLost,
        Alarm::FramesLost(3),
        Alarm::FollowingError(Steps(66)),
    ]
}

fn refusals() -> Vec<Refusal> {
    vec![
        Refusal::TooShort { bytes: 1 },
        Refusal::WrongLength { op_code: 1, bytes: 3 },
        Refusal::UnknownAddress { address: 10 },
        Refusal::UnknownOpCode { op_code: 0x7F },
        Refusal::DirectionNotAllowed { op_code: 4 },
        Refusal::WrongCard { address: 8, op_code: 1 },
        Refusal::ZeroSteps,
        Refusal::SpeedOutOfRange { speed: 233 },
        Refusal::Moving,
        Refusal::NotOriginated,
        Refusal::InAlarm,
        Refusal::OutOfTravel { target: Position(-400), min: Position(0), max: Position(66_000) },
        Refusal::NoLead,
        Refusal::LongerThanLead { steps: 6, lead: 5 },
        Refusal::NotArmed,
        Refusal::Late { by: Ticks(2_580) },
        Refusal::NoStartTick,
        Refusal::AtEnd { end: End::Lower },
        Refusal::PathFull,
        Refusal::PathTooLong { steps: 70_000 },
    ]
}

fn name(value: &impl Serialize) -> String {
    match serde_json::to_value(value).expect("JSON") {
        Value::String(name) => name,
        Value::Object(fields) => fields.keys().next().expect("a name").clone(),
        other => panic!("{other} is no variant"),
    }
}

/// All variants of an enum with their documentation, in the order of their declaration.
fn documented<T: JsonSchema>() -> Vec<(String, String)> {
    let schema = schemars::schema_for!(T).to_value();
    let mut found = vec![];
    for one in schema["oneOf"].as_array().expect("an enum") {
        let meaning = one["description"].as_str().expect("documented").replace('\n', " ");
        let properties = one["properties"].as_object();
        match (properties, one["const"].as_str()) {
            (Some(properties), _) => found.push((properties.keys().next().expect("a name").clone(), meaning)),
            (None, Some(name)) => found.push((name.to_owned(), meaning)),
            (None, None) => panic!("{one} is no variant"),
        }
    }
    found
}

/// The meaning of each; panics unless `all` are all.
fn meanings<T: JsonSchema + Serialize>(all: &[T]) -> Vec<String> {
    let mut documented = documented::<T>();
    assert_eq!(documented.len(), all.len(), "{documented:?}");
    all.iter()
        .map(|one| {
            let found = documented.iter().position(|(known, _)| *known == name(one));
            documented.remove(found.unwrap_or_else(|| panic!("{} is not documented", name(one)))).1
        })
        .collect()
}

fn must_stand_in_the_chapter(table: &str) {
    assert!(CHAPTER.contains(table), "docs/src/guide/alarms.md must have this table:\n\n{table}");
}

#[test]
fn the_chapter_has_every_alarm() {
    let mut table =
        "| alarm | on the terminal | what happened | position | what to do |\n|---|---|---|---|---|\n"
            .to_owned();
    let all = alarms();
    for (one, meaning) in all.iter().zip(meanings(&all)) {
        let position = match place(one) {
            Place::Kept => "kept",
            Place::Lost => "lost",
            Place::Gone => "the card's process ends",
        };
        let advice = match place(one) {
            Place::Lost => format!("{}, and `ccu origin`", alarm(one)),
            Place::Kept | Place::Gone => alarm(one).to_owned(),
        };
        let _ = writeln!(table, "| `{}` | {one} | {meaning} | {position} | {advice} |", name(one));
    }
    must_stand_in_the_chapter(&table);
}

#[test]
fn the_chapter_has_every_refusal() {
    let mut table = "| refusal | on the terminal | meaning | what to do |\n|---|---|---|---|\n".to_owned();
    let all = refusals();
    for (one, meaning) in all.iter().zip(meanings(&all)) {
        let _ = writeln!(table, "| `{}` | {one} | {meaning} | {} |", name(one), refusal(one));
    }
    must_stand_in_the_chapter(&table);
}

#[test]
fn the_help_of_an_alarm_says_whether_the_position_is_kept() {
    let axis = supersigma_protocol::AxisNumber::new(1).expect("an axis");
    for one in alarms() {
        let of = |position| {
            let failure = Failure::Alarm { axis, alarm: one, done: Steps(5), position, at: None };
            super::failure(&failure)
        };
        let rest = matches!(one, Alarm::Braked | Alarm::ExcessiveForce);
        assert!(of(Some(Position(7))).contains("its position is kept"), "{one}");
        assert_eq!(of(Some(Position(7))).contains("`ccu resume`"), rest, "{one}");
        assert!(of(None).ends_with("its position is lost"), "{one}");
    }
}
