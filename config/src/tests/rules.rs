//! Texts that fit the model and break a rule.

use super::{AXIS, axis_and, axis_with, breaks, messages};
use crate::{Config, OnLoss, Problem, SchedulingPolicy};

#[test]
fn one_to_seven_axes() {
    breaks("axis = []", "set.toml:1:8: axis: a set needs at least one axis", "[[axis]]");
    let mut eight = String::new();
    for number in 1..=8 {
        let number = if number == 8 { 7 } else { number };
        eight += &AXIS.replace("address = 1", &format!("address = {number}"));
    }
    let error = Config::from_toml(&eight, "set.toml").expect_err("eight axes");
    let problems: Vec<_> = error.faults().iter().map(|fault| fault.problem().clone()).collect();
    assert!(problems.contains(&Problem::TooManyAxes { count: 8 }), "{problems:?}");
    assert!(error.to_string().contains("36:1 axis[7]"), "{error}");
}

#[test]
fn addresses_are_unique() {
    let text = axis_and(&axis_with("\"a\"", "\"b\""));
    breaks(
        &text,
        "set.toml:7:11: axis[1].address: address 1 is already that of `a`",
        "an address of its own",
    );
    assert!(messages(&text).1.contains("line 2, column 11: first used here"), "{}", messages(&text).1);
}

#[test]
fn names_are_names() {
    for name in ["all", "7", "X", "a-b", "", "über", "_a", "a b"] {
        breaks(
            &axis_with("\"a\"", &format!("\"{name}\"")),
            &format!("set.toml:3:8: axis[0].name: {name:?} cannot be a name"),
            "lower-case letters",
        );
    }
    breaks(
        &axis_and(&axis_with("= 1\n", "= 2\n")),
        "set.toml:8:8: axis[1].name: the name `a` is already taken",
        "a name of its own",
    );
    assert!(Config::from_toml(&axis_with("\"a\"", "\"left_x2\""), "set.toml").is_ok());
}

#[test]
fn rails_are_in_order() {
    breaks(
        &axis_with("lower_zone = 400", "lower_zone = 0"),
        "set.toml:4:39: axis[0].rail.lower_zone: this must not be 0",
        "1 or more",
    );
    breaks(
        &axis_with("reference = 600", "reference = 400"),
        "set.toml:4:56: axis[0].rail.reference: 400 is not more than `lower_zone`, which is 400",
        "0 < lower_zone < reference < upper_zone < length",
    );
    breaks(
        &axis_with("upper_zone = 9600", "upper_zone = 600"),
        "set.toml:4:74: axis[0].rail.upper_zone: 600 is not more than `reference`, which is 600",
        "above `reference`",
    );
    breaks(
        &axis_with("length = 10000", "length = 9600"),
        "set.toml:4:19: axis[0].rail.length: 9600 is not more than `upper_zone`, which is 9600",
        "above `upper_zone`",
    );
    breaks(
        &axis_with("length = 10000", "length = 1000001"),
        "set.toml:4:19: axis[0].rail.length: a rail of 1000001 steps is too long, positions go to 1 000 000",
        "1000000 or less",
    );
    assert!(Config::from_toml(&axis_with("length = 10000", "length = 1000000"), "set.toml").is_ok());
    breaks(
        &axis_with("start = 50", "start = 10001"),
        "set.toml:4:88: axis[0].rail.start: 10001 is beyond the end of the rail, 10000",
        "between 0 and `length`",
    );
    assert!(Config::from_toml(&axis_with("start = 50", "start = 10000"), "set.toml").is_ok());
}

#[test]
fn travel_stays_between_the_limit_zones() {
    breaks(
        &axis_with("min = 0", "min = -1"),
        "set.toml:5:18: axis[0].travel.min: position -1 lies in the lower limit zone",
        "0 is the origin",
    );
    breaks(
        &axis_with("min = 0", "min = 9199"),
        "set.toml:5:30: axis[0].travel.max: 9198 is less than `min`, 9199",
        "exchange `min` and `max`",
    );
    // Position 9 198 is step 400 + 1 + 9 198 = 9 599 of the rail, the last below the upper zone at 9 600.
    breaks(
        &axis_with("max = 9198", "max = 9199"),
        "set.toml:5:27: axis[0].travel.max: position 9199 lies in the upper limit zone or beyond, the last one before it is 9198",
        "9198 or less",
    );
}

#[test]
fn the_origination_ends_in_the_lower_zone() {
    // The sum of 860 / (N + 1) over the entries below 90 is 127.2, below 100 it is 158.03.
    breaks(
        &axis_with("lower_zone = 400", "lower_zone = 100"),
        "set.toml:4:39: axis[0].origination.speed: from speed 90 the carriage needs at least 127 steps to stop, but the lower limit zone has 100",
        "widen `rail.lower_zone`",
    );
    let wide = axis_with("lower_zone = 400", "lower_zone = 128");
    assert!(Config::from_toml(&wide, "set.toml").is_ok());
    breaks(
        &format!("{wide}origination.speed = 100\n"),
        "set.toml:6:21: axis[0].origination.speed: from speed 100 the carriage needs at least 158 steps to stop, but the lower limit zone has 128",
        "lower `origination.speed`",
    );
}

#[test]
fn ramps_are_usable() {
    let ramp = |line: &str| axis_and(&format!("[ramp]\n{line}\n"));
    breaks(
        &ramp("omega = nan"),
        "set.toml:7:9: ramp.omega: this ramp cannot be used: `omega` is not a finite number",
        "a plain number",
    );
    breaks(
        &ramp("interval_ticks = 0"),
        "set.toml:7:18: ramp.interval_ticks: this ramp cannot be used: `interval_ticks` is 0: the ramp would take no time",
        "2580 ticks",
    );
    breaks(
        &ramp("brake_interval_ticks = 0"),
        "set.toml:7:24: ramp.brake_interval_ticks: this ramp cannot be used: `brake_interval_ticks` is 0: no mechanism stops at once",
        "1 or more",
    );
    breaks(
        &ramp("interval_ticks = 800"),
        "set.toml:7:18: ramp.brake_interval_ticks: this ramp cannot be used: `brake_interval_ticks` is 860, longer than \
         `interval_ticks`, 800: braking would be slower than halting",
        "no more than `interval_ticks`",
    );
    breaks(
        &ramp("offset = 65536"),
        "set.toml:7:10: ramp.offset: this ramp cannot be used: `offset` is 65536, more than the 65 535 steps of the longest movement",
        "65535 or less",
    );
    breaks(
        &ramp("amplitude = -15000"),
        "set.toml:6:1: ramp: this ramp cannot be used: entry 0 is -650.0 steps/s, for which N is not in 25 to 65 534: \
         a card makes 30.6 to 76 923 steps/s",
        "change the top speed (`amplitude`",
    );
    breaks(
        &ramp("omega = 5"),
        "set.toml:6:1: ramp: this ramp cannot be used: entry 217 is slower than the one before it (N rises from 132 to 133): \
         the speeds of a ramp must never fall",
        "π/2",
    );
    breaks(
        &ramp("phase = 0.0633"),
        "set.toml:6:1: ramp: this ramp cannot be used: N falls by 5401 at entry 1, more than the 255 that one byte of the table holds; \
         `differences = \"wide\"` would allow it",
        "`differences = \"wide\"`",
    );
}

#[test]
fn digital_lines_exist_and_are_unique() {
    let output = |bit: u8, name: &str| format!("[[digital.output]]\nbit = {bit}\nname = \"{name}\"\n");
    breaks(
        &axis_and(&output(16, "o")),
        "set.toml:7:7: digital.output[0].bit: there is no line 16, a card has the lines 0 to 15",
        "0 to 15",
    );
    breaks(
        &axis_and(&(output(3, "o") + &output(3, "p"))),
        "set.toml:10:7: digital.output[1].bit: line 3 is already `o`",
        "a bit of its own",
    );
    breaks(
        &axis_and(&(output(3, "o") + &output(4, "o"))),
        "set.toml:11:8: digital.output[1].name: the name `o` is already taken",
        "a name of its own",
    );
    breaks(
        &axis_and(&output(3, "All")),
        "set.toml:8:8: digital.output[0].name: \"All\" cannot be a name",
        "lower-case",
    );
    let input =
        |more: &str| axis_and(&(output(0, "gripper") + "[[digital.input]]\nbit = 0\nname = \"i\"\n" + more));
    assert!(Config::from_toml(&input("follows = \"gripper\"\ndelay_ms = 80\n"), "set.toml").is_ok());
    breaks(
        &input("follows = \"griper\"\n"),
        "set.toml:12:11: digital.input[0].follows: there is no output `griper`",
        "did you mean `gripper`?",
    );
    breaks(
        &input("delay_ms = 80\n"),
        "set.toml:12:12: digital.input[0].delay_ms: a delay of 80 ms has no effect without `follows`",
        "name the output",
    );
    breaks(
        &input("[[digital.input]]\nbit = 0\nname = \"j\"\n"),
        "set.toml:13:7: digital.input[1].bit: line 0 is already `i`",
        "a bit of its own",
    );
}

#[test]
fn milliseconds_are_not_zero() {
    for (table, key) in [
        ("line", "lead_ms"),
        ("executive", "answer_ms"),
        ("executive", "overdue_ms"),
        ("supervision", "heartbeat_ms"),
        ("log", "flush_ms"),
    ] {
        breaks(
            &axis_and(&format!("[{table}]\n{key} = 0\n")),
            &format!("set.toml:7:{}: {table}.{key}: this must not be 0", key.len() + 4),
            "1 or more",
        );
    }
}

#[test]
fn a_part_of_the_log_is_not_too_small() {
    for (key, value, least) in [
        ("rotate_mb", "0.05", "at least 0.1 megabytes"),
        ("rotate_mb", "inf", "at least 0.1 megabytes"),
        ("rotate_min", "0", "at least 0.01 minutes"),
        ("rotate_min", "nan", "at least 0.01 minutes"),
    ] {
        breaks(
            &axis_and(&format!("[log]\n{key} = {value}\n")),
            &format!(
                "set.toml:7:{}: log.{key}: a part of the log has {least}; leave the key out to have one file",
                key.len() + 4
            ),
            "goes on in another file",
        );
    }
    let set = Config::from_toml(&axis_and("[log]\nrotate_mb = 100\nrotate_min = 0.5\n"), "set.toml");
    let log = set.expect("sound").log;
    assert_eq!((log.rotate_mb, log.rotate_min, log.on_loss), (Some(100.0), Some(0.5), OnLoss::Warn));
    assert!(Config::from_toml(&axis_and("[log]\non_loss = \"shrug\"\n"), "set.toml").is_err());
}

#[test]
fn silence_is_longer_than_two_heartbeats() {
    breaks(
        &axis_and("[supervision]\nsilent_ms = 200\n"),
        "set.toml:7:13: supervision.silent_ms: 200 ms of silence is not more than two heartbeats of 100 ms",
        "2 · heartbeat_ms",
    );
    // Only the other value is written: the place is there.
    breaks(
        &axis_and("[supervision]\nheartbeat_ms = 300\n"),
        "set.toml:7:16: supervision.silent_ms: 450 ms of silence is not more than two heartbeats of 300 ms",
        "2 · heartbeat_ms",
    );
    assert!(Config::from_toml(&axis_and("[supervision]\nsilent_ms = 201\n"), "set.toml").is_ok());
}

#[test]
fn all_broken_rules_are_told_at_once() {
    let text = axis_and("[log]\nflush_ms = 0\n")
        .replace("start = 50", "start = 50000")
        .replace("min = 0", "min = -5");
    let (message, drawn) = messages(&text);
    assert_eq!(
        message,
        "set.toml has 3 faults, at 4:88 axis[0].rail.start, 5:18 axis[0].travel.min, 7:12 log.flush_ms"
    );
    for part in ["50000 is beyond the end", "position -5 lies", "this must not be 0"] {
        assert!(drawn.contains(part), "no {part:?} in\n{drawn}");
    }
}

#[test]
fn motors_can_be() {
    breaks(
        &axis_and("motor = { friction = -1 }\n"),
        "set.toml:6:22: axis[0].motor.friction: -1 is less than 0",
        "Dry friction, the same at every speed",
    );
    breaks(
        &axis_and("motor = { load_torque = 3.0 }\n"),
        "set.toml:6:9: axis[0].motor.holding_torque: friction and load torque, 3.03 N·m together, are not less than the holding torque, 2.5 N·m",
        "holds its detent",
    );
    breaks(
        &axis_and("motor = { half_steps_per_turn = 404 }\n"),
        "set.toml:6:33: axis[0].motor.half_steps_per_turn: 404 half steps are not a turn, which has 8 to 25 600, a multiple of 8",
        "multiple of 8",
    );
    let bench = Config::from_toml(&axis_and("motor = {}\n"), "set.toml").expect("sound");
    assert_eq!(bench.axes[0].motor, Some(crate::MotorConfig::bench()));
}

#[test]
fn what_processes_may_ask_of_the_machine() {
    for priority in [0, 100] {
        breaks(
            &axis_and(&format!("[real_time]\npriority = {priority}\n")),
            "set.toml:7:12: real_time.priority: a priority is 1 to 99, the highest",
            "`real_time.priority` means: Their priority under `fifo`, 1 to 99, the highest.",
        );
    }
    breaks(
        &axis_and("[real_time]\ncpus = [0, 1024]\n"),
        "set.toml:7:12: real_time.cpus[1]: there is no processor 1024; they are numbered from 0, to 1023 at most",
        "here",
    );
    breaks(
        &axis_and("[real_time]\ncpus = [3, 3]\n"),
        "set.toml:7:12: real_time.cpus[1]: processor 3 is named twice",
        "label at line 7, column 9: compared with this",
    );
    breaks(
        &axis_and("[real_time]\npolicy = \"rr\"\n"),
        "set.toml:7:10: real_time.policy: \"rr\" is not one of the words for this",
        "the words are `normal`, `fifo`",
    );
    let text =
        axis_and("[real_time]\npolicy = \"fifo\"\npriority = 99\nlock_memory = true\ncpus = [0, 1023]\n");
    let real_time = Config::from_toml(&text, "set.toml").expect("sound").real_time;
    assert_eq!((real_time.policy, real_time.cpus), (SchedulingPolicy::Fifo, vec![0, 1023]));
}
