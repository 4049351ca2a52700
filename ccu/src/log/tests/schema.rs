//! The schemas against the messages, and the text of the frame's types against the frame's bytes.

use std::collections::BTreeSet;
use std::fmt::Debug;

use serde::de::DeserializeOwned;
use serde_json::Value;
use supersigma_protocol::{Alarm, Command, Direction, Distance, End, Operation, SpeedIndex};

use super::*;
use crate::log::schema::{FRAME_TYPES, joint_states_schema, log_schema, twin_into, view_schema};
use crate::log::{AnswerView, AxisView, CommandView, DigitalView, FrameView};

/// The dialect that viewers read: an object, and one type for each property, without references or alternatives.
fn check_dialect(schema: &Value, path: &str) {
    assert_eq!(schema["type"], "object", "{path}: {schema:#}");
    let properties = schema["properties"].as_object().unwrap_or_else(|| panic!("{path} has no properties"));
    for (name, property) in properties {
        let path = format!("{path}.{name}");
        for word in ["$ref", "anyOf", "oneOf", "allOf"] {
            assert!(property.get(word).is_none(), "{path} has {word}");
        }
        match property["type"].as_str() {
            Some("object") => check_dialect(property, &path),
            Some("array") => check_dialect(&property["items"], &path),
            Some("string" | "integer" | "number" | "boolean") => {}
            _ => panic!("{path} has type {}", property["type"]),
        }
    }
}

/// Checks a message by hand: known keys, required keys, types, enumerations.
fn check(value: &Value, schema: &Value, path: &str) {
    let fields = value.as_object().unwrap_or_else(|| panic!("{path} is {value}"));
    for required in schema.get("required").and_then(Value::as_array).into_iter().flatten() {
        assert!(fields.contains_key(required.as_str().expect("a name")), "{path} lacks {required}");
    }
    for (name, field) in fields {
        let property = &schema["properties"][name];
        let path = format!("{path}.{name}");
        let fits = match property["type"].as_str() {
            Some("object") => {
                check(field, property, &path);
                true
            }
            Some("string") => field.is_string(),
            Some("integer") => field.is_i64() || field.is_u64(),
            Some("number") => field.is_number(),
            Some("boolean") => field.is_boolean(),
            _ => false,
        };
        assert!(fits, "{path}: {field} against {property}");
        if let Some(words) = property.get("enum").and_then(Value::as_array) {
            assert!(words.contains(field), "{path}: {field} is none of {words:?}");
        }
    }
}

fn twin(view: &impl serde::Serialize) -> Vec<u8> {
    // Behind something else: what stands before a twin is none of its business.
    let mut text = b"\"a\":".to_vec();
    twin_into(view, &mut text);
    text.split_off(4)
}

fn message(frame: &Frame) -> Value {
    let bytes = match FrameView::new(&frame.encode(), Ok(frame), &names()) {
        FrameView::Command(view) => twin(&view),
        FrameView::Answer(view) => twin(&view),
        FrameView::Undecodable(view) => twin(&view),
    };
    serde_json::from_slice(&bytes).expect("JSON")
}

#[test]
fn viewers_can_read_the_schemas() {
    check_dialect(&view_schema::<CommandView>(), "command");
    check_dialect(&view_schema::<AnswerView<AxisView>>(), "axis");
    check_dialect(&view_schema::<AnswerView<DigitalView>>(), "digital");
    check_dialect(&log_schema(), "log");
    check_dialect(&joint_states_schema(), "joints");
    let words = view_schema::<AnswerView<AxisView>>()["properties"]["activity"]["enum"].clone();
    assert_eq!(words.as_array().map(Vec::len), Some(10), "{words}");
}

#[test]
fn messages_fit_their_schemas() {
    let schema = view_schema::<CommandView>();
    let (direction, distance) = (Direction::TowardsOrigin, Distance::MAX);
    for operation in [
        Operation::Slew { direction, distance, speed: SpeedIndex::TOP },
        Operation::Lead { distance, limit: None },
        Operation::Go,
    ] {
        let mut frame = command(3, 4, Command::new(Address(1), operation).encode().as_slice());
        check(&message(&frame), &schema, "command");
        let Body::Command(command) = &mut frame.body else { unreachable!("made above") };
        command.at = Some(Tick(9));
        assert_eq!(message(&frame)["at"], 9);
    }
    check(&message(&command(0, 0, &[])), &schema, "command");
    check(&message(&command(0, 0, &[9, 0x0E, 1, 2])), &schema, "command");

    let schema = view_schema::<AnswerView<AxisView>>();
    for about in [HEARTBEAT, REFUSED, About::Command(Sequence(1), Ok(()))] {
        for alarm in [None, Some(Alarm::EndOfRail(End::Upper))] {
            check(&message(&alarmed(1, 0, 7, about, alarm)), &schema, "axis");
        }
    }
    let digital =
        Answer { card: Address(9), about: HEARTBEAT, acted_at: Tick(1), report: Report::Digital(7) };
    let digital = Frame { body: Body::Answer(digital), ..answer(9, 0, 1, HEARTBEAT) };
    check(&message(&digital), &view_schema::<AnswerView<DigitalView>>(), "digital");
}

#[test]
fn required_is_what_is_never_null() {
    let required = |schema: Value| -> BTreeSet<String> {
        let names = schema["required"].as_array().expect("a list").clone();
        names.iter().map(|name| name.as_str().expect("a name").to_owned()).collect()
    };
    let of = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<BTreeSet<_>>();
    assert_eq!(
        required(view_schema::<CommandView>()),
        of(&["tick", "time_s", "sender", "sequence", "name", "bytes"])
    );
    let envelope = ["tick", "time_s", "sender", "sequence", "axis", "name", "about", "acted_at"];
    let axis = ["sense", "x1", "x2", "x3", "x4", "x5", "steps", "activity", "speed"];
    assert_eq!(required(view_schema::<AnswerView<AxisView>>()), of(&[&envelope[..], &axis[..]].concat()));
    assert_eq!(required(view_schema::<AnswerView<DigitalView>>()), of(&[&envelope[..], &["word"]].concat()));
}

/// The variants of an enum in the text, in their order.
fn variants(name: &str) -> Vec<String> {
    let start = FRAME_TYPES.find(&format!("enum {name} {{")).unwrap_or_else(|| panic!("no enum {name}"));
    let (mut variants, mut word, mut depth) = (Vec::new(), String::new(), 0);
    for letter in FRAME_TYPES[start..].chars().skip_while(|letter| *letter != '{') {
        match letter {
            '{' | '(' => depth += 1,
            '}' | ')' => depth -= 1,
            _ if depth == 1 && letter.is_alphanumeric() => word.push(letter),
            _ => {}
        }
        if (depth == 1 && letter == ',') || depth == 0 {
            variants.extend((!word.is_empty()).then(|| std::mem::take(&mut word)));
        }
        if depth == 0 {
            break;
        }
    }
    variants
}

/// Each number that the wire knows has its variant in the text, at that place, and no other has.
fn check_variants<T: DeserializeOwned + Debug>(name: &str) {
    let variants = variants(name);
    for number in 0..100u8 {
        let mut bytes = [1; 16];
        bytes[0] = number;
        let decoded = postcard::take_from_bytes::<T>(&bytes).ok().map(|(value, _)| format!("{value:?}"));
        let decoded = decoded.as_deref().map(|text| text.split(|c: char| !c.is_alphanumeric()).next());
        assert_eq!(
            decoded.flatten(),
            variants.get(usize::from(number)).map(String::as_str),
            "{name} {number}"
        );
    }
}

#[test]
fn the_text_names_every_variant_at_its_number() {
    check_variants::<Refusal>("Refusal");
    check_variants::<Alarm>("Alarm");
    check_variants::<End>("End");
    check_variants::<Activity>("Activity");
    check_variants::<Occasion>("Occasion");
    check_variants::<About>("About");
    check_variants::<Report>("Report");
    check_variants::<Sender>("Sender");
    check_variants::<Body>("Body");
}

/// The oracle: nulls are dropped from the value, not from the text.
fn without_nulls(value: &mut Value) {
    if let Value::Object(fields) = value {
        fields.retain(|_, field| !field.is_null());
        fields.values_mut().for_each(without_nulls);
    }
}

#[test]
fn a_value_that_begins_like_a_null_is_kept() {
    let value = serde_json::json!({ "message": ":null", "all": [":null", ":null,"], "none": null });
    let message: Value = serde_json::from_slice(&twin(&value)).expect("JSON");
    assert_eq!(message, serde_json::json!({ "message": ":null", "all": [":null", ":null,"] }));
}

proptest::proptest! {
    #[test]
    fn nulls_are_dropped_wherever_they_stand(
        fields in proptest::collection::vec((0..4_u8, r#"[a:,{}"\\nul]{0,8}"#), 0..12),
        depth in 0..3_usize,
    ) {
        let mut value = serde_json::Map::new();
        for (number, (kind, text)) in fields.into_iter().enumerate() {
            let field = match kind {
                0 => Value::Null,
                1 => Value::from(format!("{text}\":null")),
                2 => Value::from(number),
                _ => Value::from(text),
            };
            value.insert(format!("k{number}"), field);
        }
        let mut value = Value::Object(value);
        for _ in 0..depth {
            value = serde_json::json!({ "a": null, "inner": value.clone(), "last": null, "m": value });
        }
        let message: Value = serde_json::from_slice(&twin(&value)).expect("JSON");
        without_nulls(&mut value);
        proptest::prop_assert_eq!(message, value);
    }
}
