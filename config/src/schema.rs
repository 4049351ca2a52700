//! The configuration's own description: the JSON Schema for editors, and from it the meaning of a key for messages.

use serde_json::Value;

use crate::Config;
use crate::document::{KeyPath, Segment};

impl Config {
    /// The JSON Schema of a configuration, for editors that complete and check TOML. It holds what can be said of one
    /// value alone; the rules between values are checked on loading only.
    #[must_use]
    pub fn json_schema() -> Value {
        schemars::schema_for!(Config).to_value()
    }
}

/// What the value at `path` is, in the words of its documentation.
pub(crate) fn meaning(path: &KeyPath) -> Option<String> {
    let root = Config::json_schema();
    let mut here = &root;
    for segment in path.segments() {
        here = match (segment, resolve(&root, here)) {
            (Segment::Key(key), table) => table.get("properties")?.get(key)?,
            (Segment::Index(_), array) => array.get("items")?,
        };
    }
    let text = here.get("description").or_else(|| resolve(&root, here).get("description"))?.as_str()?;
    Some(text.replace("\\[", "[").replace("\\]", "]").replace('\n', " "))
}

/// Follows references, and takes an optional value for the value.
fn resolve<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let target = schema
        .get("$ref")
        .and_then(Value::as_str)
        .and_then(|name| root.pointer(name.trim_start_matches('#')));
    match target.or_else(|| schema.pointer("/anyOf/0")) {
        Some(next) => resolve(root, next),
        None => schema,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_a_meaning() {
        let axis = KeyPath::default().key("axis").index(3);
        assert_eq!(meaning(&axis.key("address")).as_deref(), Some("The address of its card, 1 to 7."));
        assert_eq!(meaning(&axis.key("ramp").key("amplitude")).as_deref(), Some("Steps per second."));
        assert_eq!(
            meaning(&KeyPath::default().key("digital").key("input").index(0).key("bit")).as_deref(),
            Some("The line's place on the card, 0 to 15.")
        );
        assert_eq!(meaning(&axis.key("adress")), None);
    }

    #[test]
    fn the_schema_knows_the_ranges() {
        let schema = Config::json_schema();
        let of = |pointer: &str| schema.pointer(pointer).cloned().unwrap_or_default();
        assert_eq!(of("/$defs/AxisConfig/properties/address/minimum"), 1);
        assert_eq!(of("/$defs/AxisConfig/properties/address/maximum"), 7);
        assert_eq!(of("/$defs/OriginationConfig/properties/speed/maximum"), 232);
        assert_eq!(of("/$defs/RampConfig/additionalProperties"), false);
        assert_eq!(of("/properties/axis/maxItems"), 7);
    }
}
