//! `/joint_states`: which moments it tells, in which units, and that its times do not fall.

use std::f64::consts::TAU;

use serde_json::{Value, json};
use supersigma_protocol::{Direction, Pace, Ticks};

use super::*;

/// A frame of a card with this position, sent a little after its moment; it moves if it has a speed.
fn at(
    card: u8,
    sequence: u64,
    moment: u64,
    about: About,
    position: Option<i32>,
    speed: Option<u64>,
) -> Frame {
    let mut frame = answer(card, sequence, moment, about);
    if let Body::Answer(answer) = &mut frame.body {
        answer.acted_at = Tick(moment);
        if let Report::Axis(report) = &mut answer.report {
            report.position = position.map(Position);
            if let Some(speed) = speed {
                report.activity = Activity::Cruising;
                let period = Ticks(Tick::PER_SECOND / speed);
                report.pace = Some(Pace { period, direction: Direction::TowardsOrigin });
            }
        }
    }
    frame.tick = Tick(moment + 40 * u64::from(card));
    frame
}

const SAMPLED: About = About::Unasked(Occasion::Sampled);
const CHANGED: About = About::Unasked(Occasion::Changed);

/// The messages as (nanoseconds since the epoch, positions and velocities in steps), and their publish times checked.
fn joints(header: LogHeader, frames: &[Frame], turn: f64) -> Vec<(u64, Vec<[Value; 2]>)> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = LogWriter::create(&path, header, FLUSH).expect("a new file");
    for frame in frames {
        writer.record(lane(frame), &frame.encode(), frame.tick);
    }
    writer.finish().expect("the disk has room");
    let messages = messages(&path);
    assert!(messages.is_sorted_by_key(|message| message.log_time));
    let steps =
        |value: &Value| value.as_f64().map_or(Value::Null, |radians| json!((radians / TAU * turn).round()));
    on(&messages, "/joint_states")
        .into_iter()
        .map(|message| {
            let states = message.json();
            let [sec, nsec] = ["sec", "nsec"].map(|key| states["timestamp"][key].as_u64().expect("a number"));
            assert_eq!(sec * 1_000_000_000 + nsec, message.publish_time);
            let joints = states["joints"].as_array().expect("a list");
            let names: Vec<&str> = joints.iter().filter_map(|joint| joint["name"].as_str()).collect();
            assert_eq!(names, ["left_x", "left_y"]);
            let values = joints.iter().map(|joint| [steps(&joint["position"]), steps(&joint["velocity"])]);
            (message.publish_time - EPOCH.0, values.collect())
        })
        .collect()
}

#[test]
fn a_point_of_the_grid_is_one_message_with_all_axes() {
    let ms = MILLISECOND;
    let frames = [
        at(1, 0, 1, HEARTBEAT, None, None),
        // Now all have spoken: the first message.
        at(2, 0, 2, HEARTBEAT, Some(7), None),
        at(1, 1, 5 * ms, CHANGED, Some(100), Some(1_000)),
        at(1, 2, 10 * ms, SAMPLED, Some(95), Some(1_000)),
        at(2, 1, 12 * ms, CHANGED, Some(7), Some(500)),
        at(1, 3, 20 * ms, SAMPLED, Some(85), Some(1_000)),
        at(2, 2, 20 * ms, SAMPLED, Some(3), Some(500)),
        // Axis 2 is never heard for this point: it is told before the next.
        at(1, 4, 30 * ms, SAMPLED, Some(75), Some(1_000)),
        at(1, 5, 40 * ms, SAMPLED, Some(65), Some(1_000)),
        at(2, 3, 40 * ms, SAMPLED, Some(-7), Some(500)),
        // Heartbeats tell nothing new; coming to a stand does.
        at(1, 6, 41 * ms, HEARTBEAT, Some(64), Some(1_000)),
        at(1, 7, 44 * ms, CHANGED, Some(60), None),
        at(1, 8, 45 * ms, HEARTBEAT, Some(60), None),
        // The end of the log finds this point open.
        at(1, 9, 46 * ms, CHANGED, Some(60), Some(1_000)),
        at(2, 4, 50 * ms, SAMPLED, Some(-12), Some(500)),
    ];
    let [still, one, two] = [0.0, -1_000.0, -500.0].map(|speed: f64| json!(speed));
    let point = |position: Option<f64>, speed: &Value| [json!(position), speed.clone()];
    let expected = [
        (1_000, vec![point(None, &still), point(Some(7.0), &still)]),
        (10_000_000, vec![point(Some(95.0), &one), point(Some(7.0), &still)]),
        (20_000_000, vec![point(Some(85.0), &one), point(Some(3.0), &two)]),
        (30_000_000, vec![point(Some(75.0), &one), point(Some(3.0), &two)]),
        (40_000_000, vec![point(Some(65.0), &one), point(Some(-7.0), &two)]),
        (44_000_000, vec![point(Some(60.0), &still), point(Some(-7.0), &two)]),
        (50_000_000, vec![point(Some(60.0), &one), point(Some(-12.0), &two)]),
    ];
    assert_eq!(joints(header(), &frames, 400.0), expected);
}

#[test]
fn a_turn_has_the_motor_s_half_steps() {
    let mut config = supersigma_config::Config::default_set();
    for axis in &mut config.axes {
        axis.motor = Some(supersigma_config::MotorConfig { half_steps_per_turn: 800, ..Default::default() });
    }
    let header = LogHeader { config: config.to_toml(), ..header() };
    let frames = [at(1, 0, 1, HEARTBEAT, Some(800), None), at(2, 0, 2, HEARTBEAT, Some(-400), None)];
    let [(_, values)] = &joints(header.clone(), &frames, 800.0)[..] else { panic!("one message") };
    assert_eq!([&values[0][0], &values[1][0]], [&json!(800.0), &json!(-400.0)]);
}

#[test]
fn real_time_is_told_however_fast_the_machine_runs() {
    let timeline = Timeline { epoch: EPOCH, scale: TimeScale::new(4.0).expect("positive") };
    let frames = [at(1, 0, 1, HEARTBEAT, Some(0), None), at(2, 0, 8 * MILLISECOND, HEARTBEAT, Some(0), None)];
    let told = joints(LogHeader { timeline, ..header() }, &frames, 400.0);
    assert_eq!(told[0].0, 2_000_000);
}
