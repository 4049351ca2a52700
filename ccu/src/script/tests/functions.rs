//! Every function of a script, by what it does to the axes and the lines.

use rhai::EvalAltResult;
use supersigma_protocol::{Steps, Ticks};

use super::bench::Rig;
use crate::executive::{Displacement, MovementKind};
use crate::script::functions::SIGNATURES;
use crate::script::language;

#[test]
fn every_function_with_a_signature_exists_and_no_other_does() {
    // A function that exists in no form at all is unknown, however it is called; one that does says how to call it.
    for (name, signature) in SIGNATURES {
        assert!(signature.contains(&format!("`{name}(")), "{signature}");
        let error = Rig::new().fails(&format!("{name}(1, 2, 3, 4)"));
        assert_eq!(
            error.to_string(),
            format!("test.rhai:1:1: `{name}` cannot be called with (int, int, int, int)")
        );
    }
}

#[test]
fn no_function_of_the_language_answers_in_place_of_the_robots() {
    // Rhai prefers a function of just these types to one of any type, which the robot's are. `clear`, which empties
    // strings and arrays, is made up for; there must be no second one.
    let arguments = ["1", "1.5", "\"x\"", "'x'", "[]", "#{}", "true", "()", "0..1"];
    let engine = language::engine();
    for (name, _) in SIGNATURES.into_iter().filter(|(name, _)| *name != "clear") {
        for first in arguments {
            let mut calls = vec![format!("{name}({first})")];
            for second in arguments {
                calls.push(format!("{name}({first}, {second})"));
                calls.extend(arguments.map(|third| format!("{name}({first}, {second}, {third})")));
            }
            for call in calls {
                let error = engine.run(&call).expect_err("nobody answers");
                assert!(matches!(*error, EvalAltResult::ErrorFunctionNotFound(..)), "{call}: {error}");
            }
        }
    }
}

#[test]
fn origin_finds_the_origins_of_all_of_some_and_of_one() {
    let rig = Rig::new();
    rig.run("origin(\"wrist\")").unwrap();
    let alone = rig.movements();
    assert_eq!(alone.len(), 1);
    assert_eq!((alone[0].axis.get(), alone[0].kind, alone[0].asked), (7, MovementKind::Origin, None));
    assert_eq!(rig.carriage("wrist"), 0);
    assert_eq!(rig.carriage("left_x"), 4_500 - 601);

    rig.run("origin([1, \"left_y\"])").unwrap();
    assert_eq!(rig.movements().iter().map(|movement| movement.axis.get()).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(rig.prints("print(position(1)); print(position(\"left_y\"))"), ["0", "0"]);

    rig.run("origin([])").unwrap();
    assert_eq!(rig.movements(), [], "none are none, not all");

    rig.run("origin()").unwrap();
    assert_eq!(rig.movements().len(), 7);
}

#[test]
fn reference_stands_at_the_reference_step() {
    let rig = Rig::ready();
    rig.run("reference(\"right_z\")").unwrap();
    assert_eq!(rig.movements()[0].kind, MovementKind::Reference);
    // From the origin, 451, to the reference, 650.
    assert_eq!(rig.carriage("right_z"), 650 - 451);
    assert_eq!(rig.prints("print(status(\"right_z\").x3)"), ["true"]);
}

#[test]
fn go_to_moves_by_the_difference_and_not_at_all_when_there_is_none() {
    let rig = Rig::ready();
    rig.run("go_to(\"left_x\", 7919); go_to(1, 5000); go_to(\"1\", 5000)").unwrap();
    let asked: Vec<_> = rig.movements().iter().map(|movement| movement.asked.unwrap().0).collect();
    assert_eq!(asked, [7_919, -2_919]);
    assert_eq!(rig.carriage("left_x"), 5_000);
}

#[test]
fn go_to_takes_more_than_one_command_for_a_way_that_is_too_long_for_one() {
    let rig = Rig::ready();
    rig.run("go_to(\"left_x\", 66000)").unwrap();
    let movements = rig.movements();
    assert_eq!(
        movements.iter().map(|movement| movement.asked.unwrap().0).collect::<Vec<_>>(),
        [33_000, 33_000]
    );
    assert_eq!(rig.carriage("left_x"), 66_000);
    rig.run("go_to(\"left_x\", 0)").unwrap();
    assert_eq!(rig.carriage("left_x"), 0);

    // 65 535 is the most of one command.
    rig.run("go_to(\"left_x\", 65535)").unwrap();
    assert_eq!(rig.movements().len(), 3);
    // Nothing of it is made if the last part would end outside the travel.
    let error = rig.fails("go_to(\"left_x\", -5)");
    assert!(
        error.to_string().ends_with("axis 1 (left_x) refused: target -5 is outside the travel 0 to 66000"),
        "{error}"
    );
    assert_eq!(rig.carriage("left_x"), 65_535);
}

#[test]
fn move_by_goes_both_ways() {
    let rig = Rig::ready();
    rig.run("move_by(\"left_y\", 700); move_by(\"left_y\", -13); move_by(\"left_y\", 0)").unwrap();
    let movements = rig.movements();
    assert_eq!(movements.len(), 2);
    assert_eq!(movements[1].asked, Some(Displacement(-13)));
    assert_eq!(movements[1].done, Steps(13));
    assert_eq!(rig.carriage("left_y"), 687);
}

#[test]
fn a_ceiling_makes_a_movement_longer_and_a_slew_has_one_speed() {
    let rig = Rig::ready();
    rig.run("move_by(1, 10000); move_by(1, 10000, 2000); move_by(1, -10000, 2000.5); slew(1, -1000, 650)")
        .unwrap();
    let movements = rig.movements();
    let took: Vec<f64> = movements.iter().map(|movement| movement.took.as_seconds()).collect();
    // 10 000 steps at no more than 2 000 steps/s, and the ramps.
    assert!(took[0] < 1.3 && 5.0 < took[1] && took[1] < 5.5, "{took:?}");
    assert_eq!(movements[1].took, movements[2].took, "one entry of the table");
    assert_eq!(movements[3].kind, MovementKind::Slew);
    // 1 000 periods of entry 0: N(0) + 1 = 3 077 ticks.
    assert_eq!(movements[3].took, Ticks(1_000 * 3_077));
}

#[test]
fn a_line_ends_on_all_axes_at_about_one_time() {
    let rig = Rig::ready();
    rig.run("line(#{ left_x: 7919, \"2\": 1300, right_z: 0 })").unwrap();
    let movements = rig.movements();
    assert_eq!(movements.iter().map(|movement| movement.axis.get()).collect::<Vec<_>>(), [1, 2]);
    assert!(movements.iter().all(|movement| movement.kind == MovementKind::Line));
    assert_eq!((rig.carriage("left_x"), rig.carriage("left_y")), (7_919, 1_300));
    let gap = movements[0].took.0.abs_diff(movements[1].took.0);
    assert!(gap < 20_000, "{gap} ticks");

    rig.run("line(#{ left_x: -7919, left_y: -1300 }, 3000)").unwrap();
    assert_eq!((rig.carriage("left_x"), rig.carriage("left_y")), (0, 0));
    assert!(rig.movements()[0].took.as_seconds() > 7_919.0 / 3_000.0);
}

#[test]
fn line_to_goes_to_positions_and_is_nothing_when_it_is_there() {
    let rig = Rig::ready();
    rig.run(
        "line_to(#{ left_x: 5000, left_y: 250 });
         line_to(#{ left_x: 5000, left_y: 500 });
         line_to(#{ left_x: 5000, left_y: 500 });
         line_to(#{ left_x: 0, left_y: 0 }, 14000)",
    )
    .unwrap();
    let asked: Vec<_> = rig.movements().iter().map(|movement| movement.asked.unwrap().0).collect();
    assert_eq!(asked.len(), 5, "{asked:?}");
    assert_eq!((rig.carriage("left_x"), rig.carriage("left_y")), (0, 0));
}

#[test]
fn speed_sets_a_ceiling_for_all_or_for_one_until_it_is_taken_away() {
    let rig = Rig::ready();
    rig.run(
        "speed(3000);          go_to(1, 20000); go_to(2, 20000);
         speed(2, 1000);       go_to(1, 0);     go_to(2, 10000);
         speed(2, ());         go_to(2, 20000);
         speed(0);             go_to(1, 20000); go_to(1, 0, 5000)",
    )
    .unwrap();
    let speeds: Vec<f64> = rig
        .movements()
        .iter()
        .map(|movement| f64::from(movement.done.0) / movement.took.as_seconds())
        .collect();
    let expected = [3_000.0, 3_000.0, 3_000.0, 1_000.0, 11_000.0, 12_500.0, 5_000.0];
    assert_eq!(speeds.len(), expected.len());
    for (index, (speed, most)) in speeds.iter().zip(expected).enumerate() {
        assert!(most * 0.85 < *speed && *speed <= most * 1.05, "{index}: {speed} of {most}");
    }
}

#[test]
fn no_axis_of_a_line_is_above_its_own_ceiling() {
    let rig = Rig::ready();
    // The follower makes half of the steps, so the leader may have twice its speed and no more.
    rig.run("speed(2, 1000); line(#{ left_x: 8000, left_y: 4000 }); speed(2, 9000); line(#{ left_x: 8000, left_y: 4000 })")
        .unwrap();
    let movements = rig.movements();
    let seconds = movements[0].took.as_seconds();
    assert!((4.0..4.5).contains(&seconds), "{seconds}");
    // Twice 9 000 is above the top of the leader's ramp: no ceiling at all.
    assert!(movements[2].took.as_seconds() < 1.2, "{:?}", movements[2].took);
}

#[test]
fn waiting_lets_machine_time_pass() {
    let rig = Rig::new();
    rig.run("wait(2); wait(0.25); wait(0)").unwrap();
    assert!((rig.seconds() - 2.25).abs() < 1e-9, "{}", rig.seconds());
}

#[test]
fn outputs_switch_and_inputs_follow_by_name_and_by_place() {
    let rig = Rig::new();
    let printed = rig.prints(
        "print(input(\"left_grasped\"));
         output(\"left_gripper\", true);
         print(input(0));
         wait(0.08);
         print(input(\"left_grasped\"));
         output(0, false);
         output(\"lamp\", true);
         wait(0.1);
         print(input(0));
         print(input(\"part_present\"))",
    );
    assert_eq!(printed, ["false", "false", "true", "false", "true"]);
}

#[test]
fn wait_for_returns_when_the_input_is_there_and_not_before() {
    let rig = Rig::new();
    rig.run("output(\"screwdriver\", true); wait_for(\"screw_driven\", true, 1)").unwrap();
    // It comes 400 ms after the output; the looks are 10 ms apart.
    assert!((0.4..0.411).contains(&rig.seconds()), "{}", rig.seconds());
    rig.run("wait_for(2, true, 0)").unwrap();
    assert!(rig.seconds() < 0.411);
}

#[test]
fn status_tells_what_the_card_says() {
    let rig = Rig::new();
    let printed = rig.prints(
        "let s = status(\"left_z\");
         print(`${s.x1} ${s.x2} ${s.x3} ${s.x4} ${s.x5} ${s.steps} ${s.position == ()} ${s.activity} ${s.alarm == ()} ${s.axis}`);
         origin(3); move_by(3, 900);
         let s = status(3);
         print(`${s.x4} ${s.steps} ${s.position}`);
         brake(3);
         print(status(3).alarm);
         clear(3);
         print(status(3).alarm == ());
         print(status(3).position)",
    );
    assert_eq!(
        printed,
        [
            "false false false true false 0 true standing true left_z",
            "true 900 900",
            "braked on command",
            "true",
            "900"
        ]
    );
}

#[test]
fn halt_brake_and_clear_are_for_one_for_some_and_for_all() {
    let rig = Rig::ready();
    let printed = rig.prints(
        "fn locked() { let n = 0; for axis in 1..=7 { if status(axis).alarm != () { n += 1; } } n }
         halt(); halt(1); halt([1, \"wrist\"]);
         print(locked());
         brake(1); print(locked());
         brake([2, 3]); print(locked());
         brake(); print(locked());
         clear(\"left_x\"); print(locked());
         clear([2, 3]); print(locked());
         clear(); print(locked())",
    );
    assert_eq!(printed, ["0", "1", "3", "7", "6", "4", "0"]);
}

#[test]
fn a_script_prints_and_debugs_and_may_end_early() {
    let rig = Rig::new();
    let printed = rig.prints("print(40 + 2);\ndebug(\"x\");\nprint([1, 2.5]); exit(); print(\"never\")");
    assert_eq!(printed, ["42", "test.rhai:2: \"x\"", "[1, 2.5]"]);
}

#[test]
fn constants_loops_and_functions_work_together() {
    let rig = Rig::ready();
    rig.run(
        "const STEP = 250;
         fn advance(axis) { move_by(axis, global::STEP); }
         for axis in [\"left_x\", \"left_y\"] { for i in 0..3 { advance(axis); } }",
    )
    .unwrap();
    assert_eq!((rig.carriage("left_x"), rig.carriage("left_y")), (750, 750));
}

#[test]
fn a_path_runs_on_over_its_joints() {
    let lines = Rig::new();
    lines.run("origin([1, 2]); for i in 0..4 { line(#{ left_x: 3000, left_y: 1500 }) }").unwrap();
    let stopping = lines.movements().iter().skip(2).step_by(2).map(|one| one.took.0).sum::<u64>();

    let path = Rig::new();
    path.run("origin([1, 2]); let leg = #{ left_x: 3000, left_y: 1500 }; path([leg, leg, leg, leg])")
        .unwrap();
    let movements = path.movements();
    let [.., one, other] = &movements[..] else { panic!("two axes moved: {movements:?}") };
    assert_eq!((one.kind, one.done, other.done), (MovementKind::Path, Steps(12_000), Steps(6_000)));
    assert_eq!((path.carriage("left_x"), path.carriage("left_y")), (12_000, 6_000));
    assert!(one.took.0 < stopping * 2 / 3, "{} ticks without stopping, {stopping} with", one.took.0);

    path.run("path_to([#{ left_x: 100 }, #{ left_x: 200, left_y: 0 }, #{ left_y: 50 }])").unwrap();
    assert_eq!((path.carriage("left_x"), path.carriage("left_y")), (200, 50));
    let error = path.fails("path([#{ left_x: 10 }, #{ left_x: -999 }])");
    assert!(error.to_string().contains("target -789 is outside the travel"), "{error}");
    path.run("path([]); path([#{ left_x: 0 }])").unwrap();
    assert!(path.fails("path(#{ left_x: 1 })").to_string().contains("an array of maps"));
}
