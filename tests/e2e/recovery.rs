//! Sense, control, wait: what the executive of a live set does about faults that are made on purpose, branch by branch.

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal, changed, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// A set whose first axis is in closed loop, originated.
fn closed_loop() -> Cell {
    let cell = Cell::new(EXE);
    let text =
        changed(&patient(), "name = \"left_x\"\n", "name = \"left_x\"\nmotor = {}\nloop = \"closed\"\n");
    std::fs::write(cell.config(), text).expect("a configuration");
    let _up = cell.up("20");
    cell.ccu("origin left_x left_y").done();
    cell
}

fn movement(cell: &Cell, line: &str) -> Value {
    cell.ccu(line).good().json().remove(0)
}

#[test]
fn a_few_lost_steps_are_made_good_within_the_movement() {
    let cell = closed_loop();
    cell.ccu("inject left_x lost-steps=40").done();
    let movement = movement(&cell, "move left_x 5000 --json");
    assert_eq!((&movement["position"], &movement["done"]), (&json!(5_000), &json!(5_000)));
    assert_eq!((&movement["sense"], &movement["recovered"]), (&json!("00011"), &Value::Null));
    assert_eq!(cell.down(), None);
}

#[test]
fn a_shaft_that_did_not_follow_is_tried_again_and_then_from_the_reference_step() {
    let cell = closed_loop();
    cell.ccu("inject left_x lost-steps=110").done();
    let again = movement(&cell, "move left_x 3000 --json");
    assert_eq!((&again["position"], &again["recovered"]), (&json!(3_000), &json!("tried_again")));
    cell.ccu("inject left_x lost-steps=210").done();
    let reference = movement(&cell, "move left_x 5000 --json");
    assert_eq!(
        (&reference["position"], &reference["recovered"]),
        (&json!(8_000), &json!("sought_reference"))
    );
    assert!(cell.ccu("move left_x -8000").good().stdout.contains("00011"));
    assert!(cell.down().is_some_and(|said| said.contains("steps from where it should be")));
}

#[test]
fn when_nothing_helps_the_operator_is_told_what_was_tried() {
    let cell = closed_loop();
    cell.ccu("inject left_x switch=open lost-steps=210").done();
    cell.ccu("move left_x 5000").fails(
        1,
        &[
            "does not get there",
            "the limit switch did not close",
            "tried again, and sought the reference step",
        ],
    );
    cell.ccu("move left_x 10").fails(1, &["an alarm holds the axis", "`ccu clear`"]);
    cell.ccu("inject left_x switch=free lost-steps=0").done();
    cell.ccu("clear left_x").done();
    cell.ccu("origin left_x").done();
    assert_eq!(movement(&cell, "move left_x 100 --json")["position"], 100);
    assert!(cell.down().is_some_and(|said| said.contains("the limit switch did not close")));
}

#[test]
fn a_card_that_is_held_up_is_asked_until_it_answers() {
    let cell = closed_loop();
    let worker = cell.worker(2);
    let running = cell.start("move left_y 9000 --speed 2000 --json");
    cell.until("left_y", "moves", |axis| axis["activity"] != "standing");
    worker.signal(Signal::STOP);
    // Long past the due time, which is some 0.3 s away: the answer is waited for as long as the configuration says.
    std::thread::sleep(std::time::Duration::from_millis(600));
    worker.signal(Signal::CONT);
    let movement = running.end().good().json().remove(0);
    assert_eq!((&movement["done"], &movement["position"]), (&json!(9_000), &json!(9_000)));
    assert_eq!(cell.down(), None);
}
