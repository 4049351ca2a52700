//! Movements that are begun and waited for later, and blocks of them.

use super::bench::Rig;
use crate::executive::Movement;

/// From its first to its last tick.
fn span(movement: &Movement) -> (u64, u64) {
    (movement.start.0, movement.start.0 + movement.took.0)
}

#[test]
fn a_block_begins_all_at_once_and_ends_with_the_last() {
    let rig = Rig::ready();
    let before = rig.seconds();
    let printed = rig.prints(
        "let moved = together { move_by(\"left_x\", 9000); go_to(\"wrist\", 500); line(#{ left_y: 40, left_z: 7 }); };
         for one in moved { print(`${one.axis} ${one.kind} ${one.asked} ${one.done} ${one.position}`) }",
    );
    assert_eq!(
        printed,
        ["left_x move 9000 9000 9000", "wrist move 500 500 500", "left_y line 40 40 40", "left_z line 7 7 7"]
    );
    let movements = rig.movements();
    let longest = movements.iter().map(|movement| movement.took.as_seconds()).fold(0.0, f64::max);
    let took = rig.seconds() - before;
    assert!(took < longest + 0.1, "{took} s for {longest} s");
    let (first, second) = (span(&movements[0]), span(&movements[1]));
    assert!(first.0 < second.1 && second.0 < first.1, "{first:?} and {second:?} overlap");
}

#[test]
fn what_is_begun_goes_on_while_the_program_does_something_else() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "let long = begin { move_by(1, 20000) };
         print(long.done);
         move_by(\"wrist\", 300);
         print(is_done(long));
         let moved = wait(long);
         print(`${moved[0].done} ${long.done} ${position(1)}`);
         print(wait(long) == moved);
         print(wait(begin { }) == []);",
    );
    assert_eq!(printed, ["false", "false", "20000 true 20000", "true", "true"]);
    // The short one has ended, and was told, first.
    assert_eq!(rig.movements().iter().map(|one| one.axis.get()).collect::<Vec<_>>(), [7, 1]);
}

#[test]
fn the_end_of_a_movement_is_known_though_nobody_was_waiting_then() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "let short = begin { move_by(1, 300) };
         wait(5);
         move_by(1, 50); // the same axis moves on
         print(short.done);
         print(wait(short)[0].position);",
    );
    assert_eq!(printed, ["true", "300"]);
}

#[test]
fn waiting_for_all_and_for_any() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "let long = begin { move_by(1, 20000) };
         let short = begin { move_by(2, 100); move_by(3, 100) };
         let first = wait_any([long, short]);
         print(`${first.done} ${short.done} ${long.done}`);
         let moved = wait_all([long, short]);
         for one in moved { print(one.axis) }
         print(wait_all([]) == []);",
    );
    assert_eq!(printed, ["true true false", "left_x", "left_y", "left_z", "true"]);
    assert_eq!(rig.fails("wait_any([])").to_string(), "test.rhai:1:1: `wait_any` needs at least one handle");
    assert_eq!(
        rig.fails("wait_all([3])").to_string(),
        "test.rhai:1:1: what is waited for is a handle, not 3"
    );
}

#[test]
fn looking_at_a_handle_lets_time_pass() {
    let rig = Rig::ready();
    assert_eq!(
        rig.prints("let h = begin { move_by(1, 900) }; while !h.done { } print(position(1))"),
        ["900"]
    );
}

#[test]
fn a_ramp_in_a_block_is_a_function_call_away_and_blocks_stand_in_functions() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "fn both(n) { together { one(\"left_x\", n); one(\"left_y\", 2 * n) } }
         fn one(axis, n) { move_by(axis, n) }
         print(both(200).len());
         let h = begin { let inner = begin { move_by(3, 70) }; together { move_by(\"wrist\", 60) } wait(inner); };
         print(wait(h).len());
         print(`${position(1)} ${position(2)} ${position(3)} ${position(7)}`);",
    );
    assert_eq!(printed, ["2", "0", "200 400 70 60"]);
}

#[test]
fn when_one_of_a_block_fails_the_others_are_halted_and_each_is_named() {
    let rig = Rig::ready();
    rig.later(400, |bench, tick| {
        let axis = bench.axis("left_y");
        bench.emergency = Some((tick, axis, supersigma_protocol::Fault::Force));
    });
    let printed = rig.prints(
        "try { together { move_by(\"left_x\", 20000); move_by(\"left_y\", 20000) } }
         catch (err) {
             print(`${err.kind} ${err.axis} ${err.tick > 0}`);
             for one in err.each { print(`${one.kind} ${one.axis}`) }
         }
         print(position(\"left_x\") < 15000);
         print(status(\"left_x\").activity);",
    );
    assert_eq!(printed, ["alarm left_y true", "alarm left_y", "stopped left_x", "true", "standing"]);
}

#[test]
fn waiting_for_all_halts_nobody_and_tells_what_failed() {
    let rig = Rig::ready();
    rig.later(400, |bench, tick| {
        let axis = bench.axis("left_y");
        bench.emergency = Some((tick, axis, supersigma_protocol::Fault::Force));
    });
    let printed = rig.prints(
        "let one = begin { move_by(\"left_x\", 20000) };
         let other = begin { move_by(\"left_y\", 20000) };
         try { wait_all([one, other]) } catch (err) { print(`${err.kind} ${err.axis}`) }
         print(position(\"left_x\"));",
    );
    assert_eq!(printed, ["alarm left_y", "20000"]);
}

#[test]
fn what_a_block_has_begun_stops_when_the_block_fails() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "try { together { move_by(\"left_x\", 20000); move_by(\"left_y\", 99999) } } catch (err) { print(err.kind) }
         print(position(\"left_x\") < 100);
         try { begin { move_by(\"left_x\", 500); move_by(\"left_x\", 5) } } catch (err) { print(err.kind) }
         print(status(\"left_x\").activity);",
    );
    assert_eq!(printed, ["too_far", "true", "refused", "standing"]);
}

#[test]
fn a_program_that_halts_what_it_has_begun_is_told_so_where_it_waits() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "let h = begin { move_by(1, 20000) };
         wait(0.3);
         halt(1);
         print(h.done);
         try { wait(h) } catch (err) { print(`${err.kind} ${err.axis}`) }",
    );
    assert_eq!(printed, ["true", "stopped left_x"]);
}

#[test]
fn what_nobody_waits_for_is_waited_for_at_the_end_and_tells_its_block_when_it_fails() {
    let rig = Rig::ready();
    rig.run("begin { move_by(1, 8000) }").unwrap();
    assert_eq!(rig.carriage("left_x"), 8_000);
    assert_eq!(rig.movements().len(), 1);
    rig.later(300, |bench, tick| {
        let axis = bench.axis("left_x");
        bench.emergency = Some((tick, axis, supersigma_protocol::Fault::Force));
    });
    let error = rig.fails("wait(0.01);\nbegin { move_by(1, 20000) }\nprint(1);");
    assert!(error.to_string().starts_with("test.rhai:2:7: axis 1 (left_x) is in alarm at "), "{error}");
}

#[test]
fn what_is_begun_stops_when_the_program_fails_or_is_interrupted() {
    let rig = Rig::ready();
    let error = rig.fails("begin { move_by(1, 20000) } wait(0.2); throw \"enough\"");
    assert_eq!(error.message(), "enough");
    rig.run("wait(1)").unwrap();
    let stood = rig.carriage("left_x");
    assert!((1..10_000).contains(&stood), "{stood}");

    let mut rig = Rig::ready();
    rig.stop_at = Some("now");
    rig.fails("begin { move_by(2, 20000) } print(\"now\"); loop { }");
    rig.stop_at = None;
    rig.limits.stop.store(false, std::sync::atomic::Ordering::Relaxed);
    rig.run("wait(3)").unwrap();
    assert!(rig.carriage("left_y") < 10, "{}", rig.carriage("left_y"));
}

#[test]
fn parameters_have_the_type_of_their_default() {
    let rig = Rig::ready();
    let source = "print(param(\"n\", 3)); print(param(\"f\", 0.5)); print(param(\"b\", false));
                  const NAME = param(\"s\", \"left_x\"); fn name() { global::NAME } print(name());
                  print(type_of(param(\"free\")));";
    let set = |settings: &[(&str, &str)]| {
        let settings = settings.iter().map(|(name, value)| ((*name).into(), (*value).into())).collect();
        rig.run_with(source, settings).map(|()| rig.printed())
    };
    let all = [("n", "-7"), ("f", "2"), ("b", "true"), ("s", "5"), ("free", "1.5")];
    assert_eq!(set(&all).unwrap(), ["-7", "2.0", "true", "5", "f64"]);
    assert_eq!(set(&[("free", "x")]).unwrap(), ["3", "0.5", "false", "left_x", "string"]);
    for (settings, says) in [
        (vec![("n", "1.5")], "test.rhai:1:7: the parameter \"n\" must be a whole number, not \"1.5\""),
        (vec![("b", "yes")], "test.rhai:1:53: the parameter \"b\" must be true or false, not \"yes\""),
        (vec![], "test.rhai:3:33: the parameter \"free\" is not set"),
        (vec![("m", "1")], "test.rhai: the program has no parameter \"m\""),
    ] {
        assert_eq!(set(&settings).unwrap_err().to_string(), says);
        rig.printed();
    }
}
