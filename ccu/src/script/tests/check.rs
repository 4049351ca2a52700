//! What `check` finds in a text without running it, and the conversation of a session.

use std::sync::{Arc, Mutex};

use super::bench::{Rig, Seen};
use crate::executive::Movement;
use crate::script::{Entered, Session, Watcher, check, lock};

fn problems(text: &str) -> Vec<String> {
    let rig = Rig::new();
    check("t", text, &rig.knowledge).0.iter().map(ToString::to_string).collect()
}

#[test]
fn every_problem_is_told_with_its_place() {
    let text = r#"origin(["left_x", "lefty"]);
go_to("left_x", 70000); go_to("wrist", -1); go_too(1, 2);
move_by(9, 5); move_by(1, 0); move_by(1, -65536); move_by(1, 5.5);
move_by(1, 10, 9); speed("left_x", 99999); speed(20000);
line(#{ left_x: 0, left_y: 0 }); line_to(#{ wrist: 7000 }); path([#{ lef_x: 1 }]);
output("lamb", true); output(16, true); output(0, 1); wait_for("part", true, 1); wait(-1);
halt(1, 2); fn f(a) { go_to(a); nix } f(); [1].push(1, 2); together { move_by(8, 1) }
let s = status(""); print(undeclared + missing);"#;
    assert_eq!(
        problems(text),
        [
            "t:1:8: there is no axis \"lefty\"",
            "t:2:17: axis 1 (left_x) refused: target 70000 is outside the travel 0 to 66000",
            "t:2:40: axis 7 (wrist) refused: target -1 is outside the travel 0 to 6500",
            "t:2:45: there is no function `go_too`",
            "t:3:9: there is no axis 9",
            "t:3:27: a movement of 0 steps moves nothing",
            "t:3:42: -65536 steps are too many for one movement (at most 65535)",
            "t:3:62: `steps` must be a whole number, not the float 5.5",
            "t:4:16: axis 1 (left_x) cannot run at 9 steps/s; its ramp goes from 650.0 to 15037.6",
            "t:4:36: axis 1 (left_x) cannot run at 99999 steps/s; its ramp goes from 650.0 to 15037.6",
            "t:4:50: axis 1 (left_x) cannot run at 20000 steps/s; its ramp goes from 650.0 to 15037.6",
            "t:5:6: a movement of 0 steps moves nothing",
            "t:5:42: axis 7 (wrist) refused: target 7000 is outside the travel 0 to 6500",
            "t:5:66: there is no axis \"lef_x\"",
            "t:6:8: there is no output \"lamb\"",
            "t:6:30: there is no output 16, a card has the lines 0 to 15",
            "t:6:51: `on` must be true or false, not 1",
            "t:6:64: there is no input \"part\"",
            "t:6:87: `seconds` must be from 0 to 86400 seconds, not -1",
            "t:7:1: `halt` cannot be called with 2 arguments",
            "t:7:23: `go_to` cannot be called with 1 argument",
            "t:7:33: undefined variable: nix",
            "t:7:39: `f` cannot be called with 0 arguments",
            "t:7:48: `push` cannot be called with 2 arguments",
            "t:7:79: there is no axis 8",
            "t:8:16: there is no axis \"\"",
            "t:8:27: undefined variable: undeclared",
            "t:8:40: undefined variable: missing",
        ]
    );
}

#[test]
fn what_a_try_may_wait_for_and_what_is_computed_is_no_problem() {
    let text = "try { go_to(1, 99999); move_by(1, 0) } catch (e) { print(e.kind) }
        let axis = \"lefty\"; let far = 99999; go_to(axis, far); move_by(1, far - far);
        fn sum(a, b) { a + b } print(sum(1, 2)); let h = begin { }; h.done; wait(h); \"ab\".len(); print(1 + -2);";
    assert_eq!(problems(text), [""; 0]);
    for example in ["assembly", "lines", "recover", "together"] {
        let path = format!("{}/../examples/{example}.rhai", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).expect("it is there");
        assert_eq!(problems(&text), [""; 0], "{example}");
    }
}

#[test]
fn a_text_that_is_no_program_has_one_problem() {
    assert_eq!(problems("origin(;\ngo_too()").len(), 1);
    assert_eq!(problems("eval(\"1\")"), ["t:1:1: there is no `eval` in robot programs"]);
    assert_eq!(
        problems("let n = \"a\"; param(n, 3)"),
        ["t:1:14: the name of a parameter must be written out, as text"]
    );
}

struct Notes(Arc<Mutex<Seen>>);

impl Watcher for Notes {
    fn movement(&mut self, movement: &Movement) {
        lock(&self.0).movements.push(*movement);
    }
    fn print(&mut self, text: &str) {
        lock(&self.0).printed.push(text.into());
    }
}

#[test]
fn a_session_remembers_variables_and_functions_and_survives_errors() {
    let rig = Rig::ready();
    let stop = Arc::clone(&rig.limits.stop);
    let notes = Notes(Arc::clone(&rig.seen));
    let mut session = Session::new(Arc::clone(&rig.executive), Arc::clone(&rig.knowledge), notes, &stop);
    let value = |text: &str| Entered::Value(text.into());
    assert_eq!(session.enter("let n = 400;").unwrap(), Entered::Nothing);
    assert_eq!(
        session.enter("fn twice(a) {\n  if a > 1000 { throw \"far\" }\n  a * 2\n}").unwrap(),
        Entered::Nothing
    );
    assert_eq!(session.enter("twice(n)").unwrap(), value("800"));
    assert_eq!(session.enter("\"text\"").unwrap(), value("\"text\""));
    // The place is where the function was entered, not where it would be in the last text.
    assert_eq!(session.enter("twice(2000)").unwrap_err().to_string(), "repl:3:17: far");
    assert_eq!(
        session.enter("let m = 1; nix").unwrap_err().to_string(),
        "repl:9:12: undefined variable: nix"
    );
    session.enter("let h = begin { move_by(1, twice(n)) }").unwrap();
    assert!(session.words().iter().any(|word| word == "twice"));
    assert!(session.words().iter().any(|word| word == "h"));
    assert_eq!(session.enter("wait(h)[0].done").unwrap(), value("800"));
    session.enter("begin { move_by(2, 700) }").unwrap();
    session.leave().unwrap();
    assert_eq!(rig.carriage("left_y"), 700);
    assert_eq!(session.enter("exit()").unwrap(), Entered::Left);
}
