//! Files as people have them: of the wrong kind, saved wrongly, with slips of the hand. Each message says what, where, and
//! what to do; nothing that a terminal would obey is shown.

use std::path::PathBuf;

use miette::GraphicalReportHandler;

use super::{AXIS, axis_and, axis_with};
use crate::{Config, ConfigError};

/// The plain message, without the folder, and the drawing.
fn told(bytes: &[u8]) -> (String, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cell.toml");
    std::fs::write(&path, bytes).expect("a file");
    let error = Config::load(&path).expect_err("it is wrong");
    let mut drawn = String::new();
    GraphicalReportHandler::new()
        .with_width(400)
        .render_report(&mut drawn, &error)
        .expect("drawing into a string");
    let here = format!("{}/", folder.path().display());
    let obeyed = |c: &char| c.is_control() && !matches!(c, '\n' | '\t' | '\r' | '\u{1b}');
    assert_eq!(drawn.chars().find(obeyed), None, "{drawn:?}");
    (error.to_string().replace(&here, ""), drawn.replace(&here, ""))
}

/// Each is told with this message and this advice.
fn are_told(cases: Vec<(Vec<u8>, &str, &str)>) {
    for (bytes, message, advice) in cases {
        let (said, drawn) = told(&bytes);
        assert!(said.starts_with(message), "{message:?} is expected of {said:?}");
        assert!(drawn.contains(advice), "no {advice:?} in\n{drawn}");
    }
}

fn of(text: impl Into<String>) -> Vec<u8> {
    text.into().into_bytes()
}

#[test]
fn files_of_the_wrong_kind_are_told_with_place_and_advice() {
    let utf16: Vec<u8> = format!("\u{feff}{AXIS}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    let rubbish: Vec<u8> = (0..=250_u8).rev().collect();
    let latin = axis_and("# f").bytes().chain([0xFC]).chain(*b"r\n").collect::<Vec<u8>>();
    are_told(vec![
        (of(String::new()), "cell.toml:1:1: axis: a set needs at least one axis", "ccu config show"),
        (of("# nothing\n"), "cell.toml:1:1: axis: a set needs at least one axis", "[[axis]]"),
        (of("axis = []\n"), "cell.toml:1:8: axis: a set needs at least one axis", "[[axis]]"),
        (utf16, "cell.toml:1:1: this is not UTF-8 text", "UTF-16"),
        (rubbish, "cell.toml:1:1: this is not UTF-8 text", "name a text file"),
        (latin, "cell.toml:6:4: axis[0]: this is not UTF-8 text", "saved as UTF-8"),
        (of("{\"axis\": []}"), "cell.toml:1:1: this is not TOML: ", "key = value"),
        (of("axis:\n  - address: 1\n"), "cell.toml:1:6: this is not TOML: ", "key = value"),
        (
            of(axis_with("\"a\"", "\"a\0\"")),
            "cell.toml:3:10: axis[0].name: this is not TOML: there is the control character U+0000",
            "remove it",
        ),
        (
            of(axis_with("\"a\"", "\"\u{1b}[2J\"")),
            "cell.toml:3:9: axis[0].name: this is not TOML: there is the control character U+001B",
            "remove it",
        ),
        (of(axis_with("\"a\"", "a")), "cell.toml:3:8: axis[0].name: this is not TOML: ", "strings in quotes"),
        (of(axis_with("name = ", "name ")), "cell.toml:3:6: axis[0]: this is not TOML: ", "key = value"),
    ]);
}

#[test]
fn slips_of_the_hand_are_told_with_place_and_advice() {
    let crlf = |text: &str| text.replace('\n', "\r\n");
    are_told(vec![
        (
            of(axis_with("[[axis]]", "[axis]")),
            "cell.toml:1:1: axis: a table stands where an array of tables is needed",
            "in double brackets",
        ),
        (
            of(axis_with("address", "adress")),
            "cell.toml:2:1: axis[0].adress: there is no key `adress` here",
            "did you mean `address`?",
        ),
        (
            of(axis_with("= 1\n", "= \"one\"\n")),
            "cell.toml:2:11: axis[0].address: the string \"one\" stands where",
            "1 to 7",
        ),
        (
            of(axis_with("= 1\n", "= 8\n")),
            "cell.toml:2:11: axis[0].address: axis 8 does not exist, axes are 1 to 7",
            "1 to 7",
        ),
        (
            of(crlf(&axis_with("= 1\n", "= 9\n"))),
            "cell.toml:2:11: axis[0].address: axis 9 does not exist",
            "1 to 7",
        ),
        (
            of(format!("\u{feff}{}", axis_with("[[axis]]", "[[axes]]"))),
            "cell.toml:1:3: axes: there is no key `axes` here",
            "did you mean `axis`?",
        ),
        (
            of(axis_with("address = 1", "\taddress\t=\t9")),
            "cell.toml:2:12: axis[0].address: axis 9",
            "1 to 7",
        ),
        (
            of(axis_with("10000", "-5")),
            "cell.toml:4:19: axis[0].rail.length: -5 is not a whole number",
            "1 000 000 at most",
        ),
        (
            of(axis_with("10000", "2.5")),
            "cell.toml:4:19: axis[0].rail.length: 2.5 stands where a whole number",
            "1 000 000 at most",
        ),
        (
            of(axis_with("\"a\"", "\"X 1\"")),
            "cell.toml:3:8: axis[0].name: \"X 1\" cannot be a name",
            "lower-case letters",
        ),
        (
            of(axis_and("[log]\nflush_ms = 99999999999999999999999\n")),
            "cell.toml:7:12: log.flush_ms: 99999999999999999999999 is not",
            "Real milliseconds",
        ),
        (
            of(axis_and("[log]\n[log]\n")),
            "cell.toml:7:2: log: this is not TOML: duplicate key",
            "is written once",
        ),
        (
            of(axis_and("[ramp]\namplitude = nan\n")),
            "cell.toml:7:13: ramp.amplitude: this ramp cannot be used",
            "a plain number",
        ),
        (
            of(axis_and("loop = \"closd\"\n")),
            "cell.toml:6:8: axis[0].loop: \"closd\" is not one of the words",
            "did you mean `closed`?",
        ),
        (
            of(axis_and("[executive]\nrecover = \"yes\"\n")),
            "cell.toml:7:11: executive.recover: the string \"yes\" stands where a boolean",
            "tried again",
        ),
        (
            of(axis_and("ramp = 5\n")),
            "cell.toml:6:8: axis[0].ramp: 5 stands where a table is needed",
            "A ramp of its own",
        ),
        (
            of(axis_and("[motor]\n")),
            "cell.toml:6:2: motor: there is no key `motor` here",
            "the keys here are",
        ),
        (
            of(axis_and(AXIS)),
            "cell.toml has 2 faults, at 7:11 axis[1].address, 8:8 axis[1].name",
            "give each a name of its own",
        ),
    ]);
}

#[test]
fn how_a_text_is_saved_does_not_matter() {
    for text in [AXIS.replace('\n', "\r\n"), format!("\u{feff}{AXIS}"), AXIS.replace(" = ", "\t=\t")] {
        let config = Config::from_toml(&text, "cell.toml").expect("it is good");
        assert_eq!(config, Config::from_toml(AXIS, "cell.toml").expect("it is good"));
    }
}

#[test]
fn what_cannot_be_read_is_told_once_and_with_advice() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = folder.path().join("no.toml");
    for (path, advice) in
        [(folder.path().to_owned(), "name a file, not a folder"), (missing, "name a file that exists")]
    {
        let error = Config::load(&path).expect_err("there is nothing to read");
        assert!(matches!(error, ConfigError::Unreadable { .. }));
        assert!(
            error
                .to_string()
                .starts_with(&format!("cannot read the configuration {}: ", PathBuf::from(&path).display()))
        );
        assert!(std::error::Error::source(&error).is_none(), "the system's words are in the message");
        let help = miette::Diagnostic::help(&error).map(|help| help.to_string()).unwrap_or_default();
        assert!(help.contains(advice), "{help}");
    }
}
