//! Texts that are not TOML, or that do not fit the model.

use super::{AXIS, axis_and, axis_with, breaks, messages};

#[test]
fn texts_that_are_not_toml() {
    breaks(
        "[ramp]\nomega = \n",
        "set.toml:2:9: ramp.omega: this is not TOML: string values must be quoted, expected literal string",
        "key = value",
    );
    breaks(
        &axis_and("[log]\nflush_ms = 5\nflush_ms = 6\n"),
        "set.toml:8:1: log.flush_ms: this is not TOML: duplicate key",
        "a key, or a table, is written once",
    );
    let (message, _) = messages("[ramp\n");
    assert!(message.starts_with("set.toml:1:6: ramp: this is not TOML: "), "{message}");
    let (message, _) = messages(&format!("{AXIS}{}", AXIS.replace("\"a\"", "\"a")));
    assert!(message.starts_with("set.toml:8:10: axis[1].name: this is not TOML: "), "{message}");
}

#[test]
fn keys_that_do_not_exist() {
    breaks(
        &axis_with("address", "adress"),
        "set.toml:2:1: axis[0].adress: there is no key `adress` here",
        "did you mean `address`? the keys here are `address`, `name`, `rail`, `travel`, `origination`, `ramp`",
    );
    breaks(
        &axis_with("lower_zone", "lowerzone"),
        "set.toml:4:26: axis[0].rail.lowerzone: there is no key `lowerzone` here",
        "did you mean `lower_zone`?",
    );
    breaks(
        &axis_and("[lag]\nflush_ms = 1\n"),
        "set.toml:6:2: lag: there is no key `lag` here",
        "did you mean `log`?",
    );
    breaks(
        &axis_and("[log]\nflush_ms = 1\ncolour = 3\n"),
        "set.toml:8:1: log.colour: there is no key `colour` here",
        "the keys here are `flush_ms`",
    );
}

#[test]
fn words_that_do_not_exist() {
    breaks(
        &axis_and("[ramp]\nshort_moves = \"optimum\"\n"),
        "set.toml:7:15: ramp.short_moves: \"optimum\" is not one of the words for this",
        "did you mean `optimal`? the words are `optimal`, `paper`",
    );
    breaks(
        &axis_and("[ramp]\nshort_moves = 1\n"),
        "set.toml:7:15: ramp.short_moves: 1 stands where a word in quotes is needed",
        "How movements too short for the whole ramp are made.",
    );
}

#[test]
fn keys_that_are_missing() {
    breaks(
        "[log]\nflush_ms = 5\n",
        "set.toml:1:1: axis: a set needs at least one axis",
        "add an [[axis]] table",
    );
    breaks(
        &axis_with("length = 10000, ", ""),
        "set.toml:4:8: axis[0].rail.length: the key `length` is missing",
        "`axis[0].rail.length` means: em, the last step",
    );
    breaks(
        &axis_with("name = \"a\"\n", ""),
        "set.toml:1:1: axis[0].name: the key `name` is missing",
        "What people call it",
    );
}

#[test]
fn values_of_another_type() {
    breaks(
        &axis_with("10000", "\"long\""),
        "set.toml:4:19: axis[0].rail.length: the string \"long\" stands where a whole number from 0 to 4 294 967 295 is needed",
        "em, the last step",
    );
    breaks(
        &axis_with("\"a\"", "7"),
        "set.toml:3:8: axis[0].name: 7 stands where a string is needed",
        "What people call it",
    );
    breaks(
        &axis_with("{ min = 0, max = 9198 }", "[0, 9198]"),
        "set.toml:5:10: axis[0].travel: an array stands where a table is needed",
        "Where movements may end.",
    );
    breaks(
        &axis_with("9198", "9198.5"),
        "set.toml:5:27: axis[0].travel.max: 9198.5 stands where a whole number from -2 147 483 648 to 2 147 483 647 is needed",
        "The highest",
    );
    breaks(
        &axis_and("[ramp]\nomega = 1979-05-27\n"),
        "set.toml:7:9: ramp.omega: a date or time stands where a number is needed",
        "Radians per second.",
    );
    breaks(
        "axis = 7",
        "set.toml:1:8: axis: 7 stands where an array of tables is needed",
        "in double brackets",
    );
}

#[test]
fn numbers_outside_their_type() {
    breaks(
        &axis_with("= 1\n", "= 300\n"),
        "set.toml:2:11: axis[0].address: 300 is not a whole number from 0 to 255",
        "The address of its card, 1 to 7.",
    );
    breaks(
        &axis_with("= 1\n", "= 8\n"),
        "set.toml:2:11: axis[0].address: axis 8 does not exist, axes are 1 to 7",
        "The address of its card, 1 to 7.",
    );
    breaks(
        &axis_and("origination.speed = 233"),
        "set.toml:6:21: axis[0].origination.speed: speed index 233 is above 232",
        "an index into the ramp table, 0 to 232",
    );
    breaks(
        &axis_with("start = 50", "start = -1"),
        "set.toml:4:88: axis[0].rail.start: -1 is not a whole number from 0 to 4 294 967 295",
        "Where the carriage stands",
    );
    breaks(
        &axis_with("start = 50", "start = 99999999999999999999"),
        "set.toml:4:88: axis[0].rail.start: 99999999999999999999 is not a whole number of 64 bits",
        "Where the carriage stands",
    );
}
