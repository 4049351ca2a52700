//! What is said of programs that are wrong and of robots that do not, what can be caught, and that every program ends.

use std::sync::Arc;

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme};
use supersigma_protocol::{Alarm, AxisNumber, Fault, Position, Refusal, Steps};

use super::bench::Rig;
use crate::executive::{Failure, LogTrouble};
use crate::script::ScriptError;
use crate::script::trouble::Trouble;

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

/// The error as it is drawn on a terminal must be this.
fn is_drawn(error: &ScriptError, expected: &str) {
    let mut drawn = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor()).with_width(100);
    handler.render_report(&mut drawn, error).expect("a string takes it");
    let drawn: Vec<&str> = drawn.lines().map(str::trim_end).collect();
    assert_eq!(drawn.join("\n").trim_end(), expected.trim_matches('\n'), "\n{}", drawn.join("\n"));
}

#[test]
fn an_unknown_function_is_drawn_with_the_nearest_name() {
    let error = Rig::new().fails("let x = 5;\ngo_too(\"left_x\", x);\n");
    is_drawn(
        &error,
        r#"
  × test.rhai:2:1: there is no function `go_too` that takes (string, int)
   ╭─[test.rhai:2:1]
 1 │ let x = 5;
 2 │ go_too("left_x", x);
   · ───┬──
   ·    ╰── here
   ╰────
  help: did you mean `go_to`? the functions of the robot and of this program are `origin`,
        `reference`, `go_to`, `move_by`, `slew`, `line`, `line_to`, `path`, `path_to`, `wait`,
        `wait_all`, `wait_any`, `is_done`, `now`, `param`, `speed`, `output`, `input`, `wait_for`,
        `position`, `status`, `halt`, `brake`, `clear`"#,
    );
    assert!(!error.is_robots_fault());
}

#[test]
fn an_unknown_axis_is_drawn_with_the_nearest_name() {
    is_drawn(
        &Rig::new().fails("// up\n  go_to(\"lef_x\", 100);"),
        r#"
  × test.rhai:2:3: there is no axis "lef_x"
   ╭─[test.rhai:2:3]
 1 │ // up
 2 │   go_to("lef_x", 100);
   ·   ──┬──
   ·     ╰── here
   ╰────
  help: did you mean `left_x`? the axes are `left_x`, `left_y`, `left_z`, `right_x`, `right_y`,
        `right_z`, `wrist`"#,
    );
}

#[test]
fn a_wrong_type_is_drawn_with_what_it_is_and_what_it_should_be() {
    is_drawn(
        &Rig::new().fails("go_to(\"left_x\", 5.5);"),
        r#"
  × test.rhai:1:1: `position` must be a whole number, not the float 5.5
   ╭─[test.rhai:1:1]
 1 │ go_to("left_x", 5.5);
   · ──┬──
   ·   ╰── here
   ╰────
  help: a step is the least that an axis moves; `.to_int()` cuts"#,
    );
}

#[test]
fn a_syntax_error_is_drawn_before_anything_moves() {
    let rig = Rig::new();
    let error = rig.fails("origin();\nif input(\"part_present\") {\n  wait(1);\n");
    assert!(matches!(error, ScriptError::Syntax { .. }), "{error:?}");
    is_drawn(
        &error,
        r#"
  × test.rhai:3:10: expecting '}' to terminate this block
   ╭─[test.rhai:3:10]
 2 │ if input("part_present") {
 3 │   wait(1);
   ·          ┬
   ·          ╰── here
   ╰────"#,
    );
    assert_eq!((error.place().line(), error.place().column()), (Some(3), Some(10)));
    assert!(rig.seconds().abs() < f64::EPSILON);
}

#[test]
fn a_refusal_is_drawn_with_its_axis_and_the_calls_that_led_there() {
    let error = Rig::ready().fails("fn up(axis) {\n    move_by(axis, -5);\n}\nup(3);");
    let (min, max) = (Position(0), Position(18_300));
    let refusal = Refusal::OutOfTravel { target: Position(-5), min, max };
    let ScriptError::Robot { failure, .. } = &error else { panic!("{error:?}") };
    assert!(
        matches!(failure, Failure::Refused { axis: who, refusal: why, at: Some(_) } if (*who, *why) == (axis(3), refusal))
    );
    is_drawn(
        &error,
        r"
  × test.rhai:2:5: axis 3 (left_z) refused at 1.1769220 s: target -5 is outside the travel 0 to
  │ 18300
   ╭─[test.rhai:2:5]
 1 │ fn up(axis) {
 2 │     move_by(axis, -5);
   ·     ───┬───
   ·        ╰── left_z
 3 │ }
 4 │ up(3);
   · ─┬
   ·  ╰── called here
   ╰────
  help: the permitted travel is in the configuration: `ccu config show`",
    );
    assert!(error.is_robots_fault());
    assert_eq!(error.exit_code(), 1);
}

#[test]
fn what_is_wrong_with_a_script_is_told_with_its_place() {
    let cases = [
        ("let x = ;", "1:9: unexpected ';'"),
        ("\n let x = \"abc", "2:10: open string is not terminated"),
        ("go_to(left_x, 5)", "1:7: undefined variable: left_x"),
        ("goto(1, 5)", "1:1: there is no `goto` in robot programs"),
        ("eval(\"1\")", "1:1: there is no `eval` in robot programs"),
        ("import \"x\" as y;", "1:1: there is no `import` in robot programs"),
        ("fn f() { this }", "1:10: there is no `this` in robot programs"),
        ("let f = Fn(\"wait\"); f.curry(1)", "1:23: there is no `curry` in robot programs"),
        ("let f = |x| x;", "1:9: unexpected '|'"),
        ("sleep(1)", "1:1: there is no function `sleep`"),
        ("fn a(x) { } a(1, 2)", "1:13: `a` cannot be called with (int, int)"),
        ("go_to(\"left_x\")", "1:1: `go_to` cannot be called with (string)"),
        ("1 + ()", "1:3: `+` does not work on (int, ())"),
        ("let x = 0; 5 / x", "1:14: division by zero: 5 / 0"),
        ("let a = [1]; a[4]", "1:16: array index 4 out of bounds: only 1 element in array"),
        ("print(status(1).x9)", "1:17: property not found: x9"),
        ("go_to(8, 5)", "1:1: there is no axis 8"),
        ("go_to([], 5)", "1:1: an axis is a name or a number, not an array"),
        ("move_by(1, \"far\")", "1:1: `steps` must be a whole number, not the string \"far\""),
        ("move_by(1, ())", "1:1: `steps` must be a whole number, not ()"),
        ("move_by(1, 5, true)", "1:1: `speed` must be a number, not true"),
        ("slew(1, 5, 0.0/0.0)", "1:1: `speed` must be a number, not the float NaN"),
        ("origin([1, \"left_x\"])", "1:1: left_x (axis 1) is named twice"),
        ("clear([\"left_q\"])", "1:1: there is no axis \"left_q\""),
        ("line(#{ left_x: 5, \"1\": 3 })", "1:1: left_x (axis 1) is named twice"),
        ("line([1, 2])", "1:1: the axes of a line are a map, not an array"),
        ("line(#{ left_x: 1.5 })", "1:1: `left_x` must be a whole number, not the float 1.5"),
        ("wait(-1)", "1:1: `seconds` must be from 0 to 86400 seconds, not -1"),
        ("output(\"lmap\", true)", "1:1: there is no output \"lmap\""),
        ("output(\"lamp\", 1)", "1:1: `on` must be true or false, not 1"),
        ("output(16, true)", "1:1: there is no output 16, a card has the lines 0 to 15"),
        ("input(1.0)", "1:1: an input is a name or a number, not the float 1.0"),
        ("wait_for(0, 1, 1)", "1:1: `level` must be true or false, not 1"),
        // These are the robot's words, but the program asked for what no robot can do.
        (
            "speed(20000)",
            "1:1: axis 1 (left_x) cannot run at 20000 steps/s; its ramp goes from 650.0 to 15037.6",
        ),
        ("speed(7, 10)", "1:1: axis 7 (wrist) cannot run at 10 steps/s; its ramp goes from 650.0 to 15037.6"),
        ("move_by(1, 70000)", "1:1: 70000 steps are too many for one movement (at most 65535)"),
        ("line(#{})", "1:1: no axis of the line has any steps to make"),
    ];
    let rig = Rig::new();
    for (source, expected) in cases {
        let error = rig.fails(source);
        assert_eq!(error.to_string(), format!("test.rhai:{expected}"), "{source}");
        assert_eq!(error.exit_code(), 2, "{source}");
        assert!(!error.is_robots_fault(), "{source}");
    }
}

#[test]
fn a_place_counts_characters_not_bytes() {
    let error = Rig::new().fails("let s = \"→→\"; wait(s);");
    assert_eq!(error.to_string(), "test.rhai:1:15: `seconds` must be a number, not the string \"→→\"");
    let labels: Vec<_> = error.labels().expect("a place").collect();
    assert_eq!((labels[0].offset(), labels[0].len()), ("let s = \"→→\"; ".len(), "wait".len()));
}

#[test]
fn what_the_robot_could_not_is_its_fault() {
    let cases = [
        ("go_to(1, 5)", "1:1: axis 1 (left_x) refused: the position is unknown; originate first"),
        ("position(\"wrist\")", "1:1: axis 7 (wrist) refused: the position is unknown; originate first"),
        ("line_to(#{ left_y: 5 })", "1:1: axis 2 (left_y) refused: the position is unknown; originate first"),
        (
            "brake(2); origin(2)",
            "1:11: axis 2 (left_y) refused at 0.0000000 s: an alarm holds the axis; clear it first",
        ),
        ("wait_for(0, true, 0.1)", "1:1: input 0 did not become true within 0.1 s"),
        ("throw \"no part\"", "1:1: no part"),
        ("throw 5", "1:1: the program threw 5"),
    ];
    for (source, expected) in cases {
        let error = Rig::new().fails(source);
        assert_eq!(error.to_string(), format!("test.rhai:{expected}"), "{source}");
        assert_eq!(error.exit_code(), 1, "{source}");
        assert!(error.is_robots_fault(), "{source}");
    }
}

#[test]
fn a_caught_refusal_says_what_it_is_and_the_program_goes_on() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "try { go_to(\"left_x\", 70000) } catch (err) {
             print(err.kind); print(err.axis); print(err.message); print(err); debug(err); print(type_of(err));
         }
         try { wait(\"x\") } catch (err) { print(err.kind); print(err.axis == ()) }
         try { wait_for(0, true, 0) } catch (err) { print(err.kind) }
         go_to(\"left_x\", 500)",
    );
    let message = "axis 1 (left_x) refused: target 70000 is outside the travel 0 to 66000";
    let debugged = format!("test.rhai:2: refused: {message}");
    let expected =
        ["refused", "left_x", message, message, &debugged, "RobotError", "wrong_argument", "true", "timeout"];
    assert_eq!(printed, expected);
    assert_eq!(rig.carriage("left_x"), 500);
}

#[test]
fn what_is_caught_and_thrown_on_is_what_it_was() {
    for thrown in ["throw err", "throw"] {
        let error = Rig::new().fails(&format!("try {{ go_to(2, 5) }} catch (err) {{ {thrown} }}"));
        let ScriptError::Robot { failure, at, .. } = &error else { panic!("{error:?}") };
        assert_eq!(*failure, Failure::Refused { axis: axis(2), refusal: Refusal::NotOriginated, at: None });
        assert_eq!(at.to_string(), "test.rhai:1:35");
    }
    let error = Rig::new().fails("try { let a = []; a[1] } catch (err) { throw err }");
    assert!(matches!(error, ScriptError::Script { .. }), "{error:?}");
    assert_eq!(error.to_string(), "test.rhai:1:40: array index 1 out of bounds: array is empty");
}

#[test]
fn an_alarm_ends_a_movement_and_can_be_caught() {
    let alarmed = || {
        let rig = Rig::ready();
        rig.later(500, |bench, tick| bench.emergency = Some((tick, axis(1), Fault::Force)));
        rig
    };
    let rig = alarmed();
    let printed = rig.prints(
        "try { move_by(1, 20000) } catch (err) { print(`${err.kind} of ${err.axis}`) }
         clear(1);
         go_to(1, 20000)",
    );
    assert_eq!(printed, ["alarm of left_x"]);
    assert_eq!(rig.carriage("left_x"), 20_000);

    let error = alarmed().fails("move_by(1, 20000)");
    let ScriptError::Robot { failure: Failure::Alarm { alarm: Alarm::ExcessiveForce, done, .. }, .. } = error
    else {
        panic!("{error:?}")
    };
    assert!(done < Steps(20_000));
}

#[test]
fn nobody_catches_the_end_of_the_set_or_of_somebodys_patience() {
    let source = "try { wait(10) } catch { print(\"caught\") }";
    let rig = Rig::new();
    rig.later(500, |bench, tick| bench.failure = Some((tick, Failure::GoingDown)));
    let error = rig.fails(source);
    assert_eq!(error.to_string(), "test.rhai:1:7: the set is going down");
    assert_eq!((error.exit_code(), error.is_robots_fault()), (3, true));

    rig.later(500, |bench, tick| bench.failure = Some((tick, Failure::Cancelled)));
    let error = rig.fails(source);
    assert_eq!(error.to_string(), "test.rhai:1:7: interrupted");
    assert!(matches!(error, ScriptError::Interrupted { .. }), "{error:?}");
    assert!(!error.is_robots_fault());
    assert!(rig.prints("").is_empty());
}

#[test]
fn kinds_are_called_as_in_json() {
    let rig = Rig::new();
    let (axis, position) = (axis(1), None);
    let no_log = LogTrouble { reason: "the recorder is gone".into(), advice: "begin anew".into() };
    let cases = [
        (Failure::Stopped { axis, done: Steps(3), position, at: None }, "stopped", Some("left_x")),
        (Failure::Overdue { axis, milliseconds: 500, done: Steps(3), at: None }, "overdue", Some("left_x")),
        (Failure::NotConfirmed { axis }, "not_confirmed", Some("left_x")),
        (Failure::NoAnswer { card: axis.address(), milliseconds: 500 }, "no_answer", Some("left_x")),
        (Failure::NoLog(no_log), "no_log", None),
    ];
    for (failure, kind, name) in cases {
        let trouble = Trouble::robot(failure, &rig.knowledge, None);
        assert_eq!(trouble.kind(), kind);
        let Trouble::Robot { axis, .. } = trouble else { panic!("{trouble:?}") };
        assert_eq!(axis.as_deref(), name);
    }
}

#[test]
fn an_endless_loop_ends_at_its_limit_or_when_it_is_stopped() {
    let mut rig = Rig::new();
    rig.limits.operations = Some(10_000);
    let error = rig.fails("let i = 0;\nloop { i += 1; }");
    assert!(matches!(error, ScriptError::LimitReached { .. }), "{error:?}");
    assert_eq!(error.place().line(), Some(2));
    assert_eq!(error.exit_code(), 2);

    rig.limits.operations = None;
    rig.stop_at = Some("here it comes");
    let error = rig.fails("print(\"here it comes\");\ntry { loop { } } catch { }");
    assert!(matches!(error, ScriptError::Interrupted { .. }), "{error:?}");
    assert_eq!(error.place().line(), Some(2));
}

#[test]
fn waiting_for_an_input_can_be_stopped() {
    let rig = Rig::new();
    rig.later(500, |bench, tick| bench.stop = Some((tick, Arc::clone(&rig.limits.stop))));
    let error = rig.fails("wait_for(0, true, 80000)");
    assert!(matches!(error, ScriptError::Interrupted { .. }), "{error:?}");
    assert!(rig.seconds() < 0.52, "{}", rig.seconds());
}

#[test]
fn no_program_can_take_the_memory_or_the_stack() {
    let hostile = [
        "fn f(n) { f(n + 1) } f(0)",
        "fn f(n) { 1 + [#{ a: [f(n + 1), 2] }][0].a[1] } f(0)",
        "fn f(n) { if true { for i in 0..1 { while true { let x = (1 + (2 + (3 + f(n)))); } } } } f(0)",
        "let s = \"x\"; loop { s += s; }",
        "let s = \"x\"; loop { s = `${s}${s}`; }",
        "let s = \"x\"; loop { s.replace(\"x\", \"xxxxxxxx\"); }",
        "let s = \"x\"; s.pad(1000000000, 'y');",
        "let a = []; loop { a.push(1); }",
        "let a = []; a.pad(1000000000, 0);",
        "let a = [1]; loop { a += a; }",
        "let a = [1]; loop { a.append(a); }",
        "let a = [[]]; loop { a[0].push(1); }",
        "let a = [\"x\"]; loop { a[0] += a[0]; }",
        "let a = []; let s = \"\"; s.pad(10000, 'x'); loop { a.push(s); }",
        "let a = []; loop { a = [a]; }",
        "let a = [0]; loop { a[0] = a; }",
        "let a = #{}; loop { a.x = a; }",
        "let a = #{}; let i = 0; loop { i += 1; a[`${i}`] = i; }",
        "let a = #{ b: [#{}] }; let i = 0; loop { i += 1; a.b[0][`${i}`] = i; }",
    ];
    for source in hostile {
        let mut rig = Rig::new();
        rig.limits.operations = Some(100_000);
        let error = rig.fails(source);
        let ScriptError::LimitReached { message, .. } = &error else { panic!("{source}: {error:?}") };
        assert!(!message.contains("operations"), "{source}: {error}");
    }
    let many: Vec<String> = (0..200).map(|number| format!("let v{number} = 0;")).collect();
    assert!(Rig::new().fails(&many.concat()).to_string().ends_with("more than 128 variables exist at once"));
}
