//! What the channels hold, in the words that MCAP viewers understand: JSON Schemas made from the views' types, the
//! schemas `foxglove.Log` and `foxglove.JointStates`, and the Rust types behind the raw frames.
//!
//! Viewers take a narrow dialect of JSON Schema: each property has exactly one `type`, there are no references and no
//! alternatives. So the derived schemas are narrowed here, and a value that a view shows as `null` is left out of
//! the twins altogether ([`twin_into`]), which keeps messages and schemas true to each other.

use memchr::memmem::Finder;
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::Serialize;
use serde_json::{Map, Value, json};

/// The Rust types of a frame, from which postcard's encoding follows.
pub(super) const FRAME_TYPES: &str = include_str!("frame_types.txt");

/// The JSON Schema of a view, narrowed.
pub(crate) fn view_schema<V: JsonSchema>() -> Value {
    let settings =
        SchemaSettings::draft2020_12().for_serialize().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<V>().to_value();
    narrow(&mut schema);
    schema
}

/// The JSON Schema of `foxglove.Log`, as Foxglove publishes it, but for two fields that may be left out (`message_id`,
/// `lineage`) and the levels, which are alternatives there.
pub(super) fn log_schema() -> Value {
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "foxglove.Log",
        "description": "A log message",
        "type": "object",
        "properties": {
            "timestamp": time_schema("Timestamp of log message"),
            "level": {
                "type": "integer",
                "enum": [0, 1, 2, 3, 4, 5],
                "description": "0 unknown, 1 debug, 2 info, 3 warning, 4 error, 5 fatal",
            },
            "message": { "type": "string", "description": "Log message" },
            "name": { "type": "string", "description": "Process or node name" },
            "file": { "type": "string", "description": "Filename" },
            "line": { "type": "integer", "minimum": 0, "description": "Line number in the file" },
        },
        "required": ["timestamp", "level", "message", "name", "file", "line"],
    })
}

/// The JSON Schema of `foxglove.JointStates`, as Foxglove publishes it. Accelerations and efforts are never written.
pub(super) fn joint_states_schema() -> Value {
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "foxglove.JointStates",
        "description": "The state of a set of joints at a given time.",
        "type": "object",
        "properties": {
            "timestamp": time_schema("Timestamp of the joint states"),
            "joints": {
                "type": "array",
                "description": "Joint states",
                "items": {
                    "title": "foxglove.JointState",
                    "description": "The state of a single joint (revolute or prismatic).",
                    "type": "object",
                    "properties": {
                        "name": { "type": "string", "description": "Joint name" },
                        "position": { "type": "number", "description": "Radians of the motor's shaft from the origin" },
                        "velocity": { "type": "number", "description": "Rad/s, negative towards the origin" },
                        "acceleration": { "type": "number", "description": "Rad/s²" },
                        "effort": { "type": "number", "description": "Nm" },
                    },
                    "required": ["name"],
                },
            },
        },
        "required": ["timestamp", "joints"],
    })
}

fn time_schema(description: &str) -> Value {
    json!({
        "type": "object",
        "title": "time",
        "description": description,
        "properties": {
            "sec": { "type": "integer", "minimum": 0 },
            "nsec": { "type": "integer", "minimum": 0, "maximum": 999_999_999 },
        },
    })
}

/// Appends a view as a twin's message: its JSON without the values that are null.
pub(super) fn twin_into(view: &impl Serialize, text: &mut Vec<u8>) {
    let start = text.len();
    // Views are structs of plain values: they always serialise, and memory takes all.
    if let Err(error) = serde_json::to_writer(&mut *text, view) {
        tracing::error!(%error, "a view is no JSON");
    }
    drop_nulls(text, start);
}

/// Removes every `"key":null` from the JSON without white space that begins at `start`. Keys are names of fields: nothing
/// in them is escaped.
///
/// A quote that closes a string, followed by `:null`, is a key with its value: after a string as a value comes a comma
/// or a brace, a quote inside a string has a backslash before it, and before one that opens a value stands what no key ends
/// with.
fn drop_nulls(json: &mut Vec<u8>, start: usize) {
    const NULL: &[u8] = b"\":null";
    let nulls = Finder::new(NULL);
    let (mut kept, mut at) = (start, start);
    while let Some(next) = nulls.find(&json[at..]) {
        json.copy_within(at..at + next, kept);
        (kept, at) = (kept + next, at + next);
        if is_escaped(&json[start..kept]) || opens_a_value(&json[start..kept]) {
            json[kept] = b'"';
            (kept, at) = (kept + 1, at + 1);
            continue;
        }
        // Back to the key's first quote, and to the comma before it; without one, the comma after it goes.
        while kept > start && json[kept - 1] != b'"' {
            kept -= 1;
        }
        kept = kept.saturating_sub(1).max(start);
        at += NULL.len();
        if kept > start && json[kept - 1] == b',' {
            kept -= 1;
        } else if json.get(at) == Some(&b',') {
            at += 1;
        }
    }
    json.copy_within(at.., kept);
    let left = json.len() - at;
    json.truncate(kept + left);
}

/// Whether what follows this text has an odd number of backslashes before it.
fn is_escaped(before: &[u8]) -> bool {
    before.iter().rev().take_while(|&&byte| byte == b'\\').count() % 2 == 1
}

/// Whether a quote after this text is the first one of a value.
fn opens_a_value(before: &[u8]) -> bool {
    matches!(before.last(), Some(b':' | b'[' | b','))
}

/// Gives a schema and the schemas in it exactly one `type` each, and no alternatives.
fn narrow(schema: &mut Value) {
    let Value::Object(fields) = schema else {
        return;
    };
    for alternatives in ["anyOf", "oneOf"] {
        if let Some(Value::Array(alternatives)) = fields.remove(alternatives) {
            for (key, value) in merge(alternatives) {
                fields.entry(key).or_insert(value);
            }
        }
    }
    if let Some(Value::Array(types)) = fields.get("type")
        && let Some(only) = types.iter().find(|name| *name != "null").cloned()
    {
        fields.insert("type".to_owned(), only);
    }
    let mut optional = Vec::new();
    if let Some(Value::Object(properties)) = fields.get_mut("properties") {
        for (name, property) in properties {
            if takes_null(property) {
                optional.push(Value::from(name.as_str()));
            }
            narrow(property);
        }
    }
    if let Some(Value::Array(required)) = fields.get_mut("required") {
        required.retain(|name| !optional.contains(name));
    }
}

fn takes_null(schema: &Value) -> bool {
    let among = |key: &str, test: fn(&Value) -> bool| {
        schema.get(key).and_then(Value::as_array).is_some_and(|values| values.iter().any(test))
    };
    among("type", |name| name == "null") || among("anyOf", |alternative| alternative["type"] == "null")
}

/// One schema for several: strings become one enumeration; objects one object with the properties of all, of which
/// none is required.
fn merge(alternatives: Vec<Value>) -> Map<String, Value> {
    let mut kept: Vec<Map<String, Value>> = alternatives
        .into_iter()
        .filter_map(|alternative| match alternative {
            Value::Object(fields) if fields.get("type") != Some(&Value::from("null")) => Some(fields),
            _ => None,
        })
        .collect();
    if kept.len() == 1 {
        return kept.swap_remove(0);
    }
    let mut words = Vec::new();
    let mut properties = Map::new();
    for mut fields in kept {
        words.extend(fields.remove("const"));
        if let Some(Value::Array(more)) = fields.remove("enum") {
            words.extend(more);
        }
        if let Some(Value::Object(more)) = fields.remove("properties") {
            properties.extend(more);
        }
    }
    let (kind, key, value) = if words.is_empty() {
        ("object", "properties", Value::Object(properties))
    } else {
        ("string", "enum", Value::Array(words))
    };
    Map::from_iter([("type".to_owned(), Value::from(kind)), (key.to_owned(), value)])
}
