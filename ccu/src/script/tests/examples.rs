//! The programs of `examples/`, each to its end on real machines.

use supersigma_protocol::SensePoint;

use super::bench::Rig;

/// Runs an example to its end, and says what it printed. Every movement of it must be complete, step for step.
fn run(source: &str) -> (Rig, Vec<String>) {
    let rig = Rig::new();
    let printed = rig.prints(source);
    for movement in rig.movements() {
        assert!(movement.sense.has(SensePoint::X4), "{movement:?}");
        if let Some(asked) = movement.asked {
            assert_eq!(u64::from(movement.done.0), asked.0.unsigned_abs(), "{movement:?}");
        }
    }
    (rig, printed)
}

fn stand(rig: &Rig) -> Vec<i32> {
    rig.knowledge.config.axes.iter().map(|axis| rig.carriage(&axis.name)).collect()
}

#[test]
fn the_assembly_is_made_in_time_and_ends_at_home() {
    let (rig, printed) = run(include_str!("../../../../examples/assembly.rhai"));
    assert_eq!(printed, ["base picked", "base placed", "cover picked", "cover placed", "2 screws driven"]);
    assert_eq!(stand(&rig), [0; 7]);
    assert!(rig.seconds() < 20.0, "{} s of machine time", rig.seconds());
    assert_eq!(rig.prints("print(input(\"left_grasped\") || input(\"right_grasped\"))"), ["false"]);
}

#[test]
fn the_lines_end_where_they_should() {
    let (rig, printed) = run(include_str!("../../../../examples/lines.rhai"));
    // 4 000 + 7 919 + 8 000 and 4 000 - 13 + 4 000; the rest comes back.
    assert_eq!(printed, ["at 19919, 7987"]);
    assert_eq!((rig.carriage("left_x"), rig.carriage("left_y")), (19_919, 7_987));
}

#[test]
fn the_recovery_recovers() {
    let (rig, printed) = run(include_str!("../../../../examples/recover.rhai"));
    assert_eq!(
        printed,
        [
            "axis 7 (wrist) refused: the position is unknown; originate first",
            "axis 7 (wrist) refused at 0.8378725 s: target 60000 is outside the travel 0 to 6500",
            "axis 7 (wrist) refused at 1.3224225 s: an alarm holds the axis; clear it first (braked on command)",
            "timeout: input left_grasped did not become true within 0.5 s",
            "the wrist is at 5000",
        ]
    );
    assert_eq!(rig.carriage("wrist"), 5_000);
}

#[test]
fn the_arms_move_together_and_come_home() {
    let (rig, printed) = run(include_str!("../../../../examples/together.rhai"));
    assert_eq!(
        printed,
        [
            "round 1: right_x is the last",
            "the wrist still turns",
            "round 2: right_x is the last",
            "the wrist still turns"
        ]
    );
    assert_eq!(stand(&rig), [0; 7]);
}
