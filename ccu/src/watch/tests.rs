//! The picture, from frames that are written by hand.

use std::time::Duration;

use serde_json::{Value, json};
use supersigma_config::Config;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Address, Alarm, Answer, AxisNumber, AxisReport, Body, Command, Deviation, Direction,
    Distance, Frame, Occasion, Operation, Pace, Position, Report, Sender, SensePoint, Sequence, StatusWord,
    Steps, Tick, Ticks,
};

use super::{Detail, Filter, Picture};

const MS: fn(u64) -> Duration = Duration::from_millis;

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

fn standing(position: Option<i32>) -> AxisReport {
    AxisReport {
        sense: StatusWord::default().with(SensePoint::X4, true),
        steps: Steps(12),
        position: position.map(Position),
        activity: Activity::Standing,
        alarm: None,
        lost: Some(Deviation(-3)),
        pace: None,
    }
}

/// 2 000 000 ticks a second: 800 of them a step are 2 500 steps a second.
fn moving(position: i32, direction: Direction) -> AxisReport {
    AxisReport {
        sense: StatusWord::default(),
        activity: Activity::Cruising,
        pace: Some(Pace { period: Ticks(800), direction }),
        ..standing(Some(position))
    }
}

fn answer(number: u8, sequence: u64, tick: u64, about: About, report: AxisReport) -> Vec<u8> {
    let card = Address(number);
    let answer = Answer { card, about, acted_at: Tick(tick), report: Report::Axis(report) };
    let sender = Sender::Card(card);
    Frame { sender, sequence: Sequence(sequence), tick: Tick(tick), body: Body::Answer(answer) }.encode()
}

fn command(sequence: u64, tick: u64, to: u8, operation: Operation) -> Vec<u8> {
    let body = Body::Command(Command::new(Address(to), operation).into());
    Frame { sender: Sender::Ccu, sequence: Sequence(sequence), tick: Tick(tick), body }.encode()
}

fn picture() -> Picture {
    Picture::new(Config::default_set())
}

fn json_of(picture: &Picture, detail: &Detail) -> Value {
    serde_json::to_value(picture.snapshot(detail)).expect("plain data")
}

const SAMPLED: About = About::Unasked(Occasion::Sampled);

#[test]
fn an_axis_is_as_its_card_said_last() {
    let mut picture = picture();
    picture.take(MS(50), Lane::Answers, &answer(2, 0, 100, SAMPLED, moving(700, Direction::TowardsOrigin)));
    let detail = Detail { history: 1, ..Detail::default() };
    let seen = json_of(&picture, &detail);
    assert_eq!(
        seen["axes"][1],
        json!({
            "axis": 2, "name": "left_y", "alive": true, "activity": "cruising", "sense": "00000", "steps": 12,
            "position": 700, "speed": -2500.0, "lost": -3, "alarm": null,
            "rail": seen["axes"][1]["rail"], "speed_history": [-2500.0], "position_history": [700],
        })
    );
    assert_eq!(seen["axes"][0]["alive"], false);
    assert_eq!(seen["set"], Value::Null);
    assert_eq!(seen["tick"], 100);
    let left = About::Unasked(Occasion::Leaving);
    picture.take(MS(60), Lane::Answers, &answer(2, 1, 200, left, moving(650, Direction::TowardsOrigin)));
    let seen = json_of(&picture, &detail);
    assert_eq!((&seen["axes"][1]["alive"], &seen["axes"][1]["speed"]), (&json!(false), &json!(0.0)));
}

#[test]
fn a_rail_is_told_from_the_origin() {
    let config = Config::default_set();
    let rail = &config.axes[0].rail;
    let origin = i64::from(rail.lower_zone.0) + 1;
    let seen = json_of(&picture(), &Detail::default());
    let told = &seen["axes"][0]["rail"];
    assert_eq!(told["lower_zone"], -1);
    assert_eq!(told["lower_stop"], -origin);
    assert_eq!(told["upper_stop"], i64::from(rail.length.0) - origin);
    assert_eq!(told["reference"], i64::from(rail.reference.0) - origin);
    assert_eq!(told["travel_max"], config.axes[0].travel.max.0);
}

#[test]
fn an_axis_that_is_silent_for_too_long_is_gone() {
    let mut picture = picture();
    let limit = u64::from(picture.config().supervision.silent_ms);
    picture.take(MS(1_000), Lane::Answers, &answer(1, 0, 0, SAMPLED, standing(None)));
    picture.advance(MS(1_000 + limit));
    assert!(picture.snapshot(&Detail::default()).axes[0].alive);
    picture.advance(MS(1_001 + limit));
    assert!(!picture.snapshot(&Detail::default()).axes[0].alive);
    picture.take(MS(3_000), Lane::Answers, &answer(1, 1, 0, SAMPLED, standing(None)));
    assert!(picture.snapshot(&Detail::default()).axes[0].alive);
}

#[test]
fn histories_go_on_while_nothing_is_said() {
    let mut picture = picture();
    picture.take(MS(50), Lane::Answers, &answer(1, 0, 0, SAMPLED, moving(10, Direction::Forward)));
    picture.take(MS(310), Lane::Answers, &answer(1, 1, 1, SAMPLED, standing(Some(90))));
    picture.advance(MS(500));
    let seen = json_of(&picture, &Detail { history: 5, ..Detail::default() });
    assert_eq!(seen["axes"][0]["speed_history"], json!([2500.0, 2500.0, 2500.0, 0.0, 0.0]));
    assert_eq!(seen["axes"][0]["position_history"], json!([10, 10, 90, 90, 90]));
}

#[test]
fn gaps_are_lost_frames_unless_the_watcher_has_missed_them() {
    let mut picture = picture();
    let hear = |picture: &mut Picture, sequence| {
        picture.take(MS(1), Lane::Answers, &answer(3, sequence, sequence, SAMPLED, standing(None)));
    };
    // Watching begins in the middle.
    hear(&mut picture, 500);
    hear(&mut picture, 501);
    assert_eq!(picture.snapshot(&Detail::default()).lost, 0);
    hear(&mut picture, 504);
    let seen = picture.snapshot(&Detail::default());
    assert_eq!(seen.lost, 2);
    assert_eq!(seen.events[0].message, "2 frames lost: number 502 was due, 504 came");
    assert_eq!(seen.events[0].name, "left_z");
    picture.miss(40);
    hear(&mut picture, 540);
    // A new life of the card.
    hear(&mut picture, 0);
    let seen = picture.snapshot(&Detail::default());
    assert_eq!((seen.lost, seen.dropped, seen.events.len()), (2, 40, 1));
}

#[test]
fn alarms_and_refusals_and_noise_are_events() {
    let mut picture = picture();
    let alarmed = AxisReport { alarm: Some(Alarm::ExcessiveForce), ..standing(None) };
    picture.take(MS(1), Lane::Answers, &answer(1, 0, 2_000_000, SAMPLED, alarmed));
    picture.take(MS(2), Lane::Answers, &answer(1, 1, 2_000_001, SAMPLED, alarmed));
    picture.take(MS(3), Lane::Answers, b"\xff\xff\xff");
    let seen = picture.snapshot(&Detail::default());
    assert_eq!(seen.events.len(), 2, "{:?}", seen.events);
    assert_eq!(seen.events[0].message, "left_x is locked: excessive force");
    assert!(seen.events[0].error && (seen.events[0].time_s - 1.0).abs() < 1e-9);
    assert_eq!(seen.axes[0].alarm.as_ref().map(|alarm| alarm.cause.as_str()), Some("excessive_force"));
    assert_eq!((seen.events[1].name.as_str(), seen.answers.total), ("bus", 3));
}

#[test]
fn the_last_frames_are_those_that_are_asked_for() {
    let mut picture = picture();
    let distance = Distance::new(400).expect("not 0");
    let forward = Operation::Move { direction: Direction::Forward, distance };
    picture.take(MS(1), Lane::Commands, &command(0, 0, 1, forward));
    picture.take(
        MS(2),
        Lane::Answers,
        &answer(1, 0, 50, About::Command(Sequence(0), Ok(())), standing(None)),
    );
    picture.take(MS(3), Lane::Answers, &answer(1, 1, 60, SAMPLED, moving(1, Direction::Forward)));
    picture.take(MS(4), Lane::Commands, &command(1, 70, 0, Operation::Halt));
    picture.take(MS(5), Lane::Commands, &command(2, 80, 5, Operation::Status));
    let texts = |frames, filter: Filter| -> Vec<String> {
        let seen = picture.snapshot(&Detail { frames, filter, ..Detail::default() });
        seen.frames.into_iter().map(|line| line.text).collect()
    };
    let all = texts(10, Filter { all: true, ..Filter::default() });
    assert_eq!(all.len(), 5);
    assert!(all[2].contains("sampled") && all[2].contains("2500"), "{all:?}");
    assert_eq!(texts(10, Filter::default()).len(), 4);
    assert_eq!(texts(2, Filter::default()), all[3..]);
    let mine = texts(10, Filter { axis: Some(axis(1)), ..Filter::default() });
    assert_eq!(mine, [&*all[0], &*all[1], &*all[3]]);
    let moves = texts(10, Filter { text: "MOVE".into(), ..Filter::default() });
    assert_eq!(moves, ["    0.000  → left_x   #0 Move +400"]);
}

#[test]
fn digital_lines_have_names_and_are_unknown_before_they_are_told() {
    let mut picture = picture();
    let seen = json_of(&picture, &Detail::default());
    assert_eq!((&seen["outputs"]["word"], &seen["outputs"]["lines"][0]["on"]), (&Value::Null, &Value::Null));
    let card = Address::DIGITAL_OUTPUT;
    let answer = Answer { card, about: SAMPLED, acted_at: Tick(0), report: Report::Digital(0b1) };
    let sender = Sender::Card(Address::DIGITAL_INPUT);
    let frame = Frame { sender, sequence: Sequence(0), tick: Tick(0), body: Body::Answer(answer) };
    picture.take(MS(1), Lane::Answers, &frame.encode());
    let seen = json_of(&picture, &Detail::default());
    let first = &seen["outputs"]["lines"][0];
    assert_eq!((&seen["outputs"]["word"], &first["bit"], &first["on"]), (&json!(1), &json!(0), &json!(true)));
    assert_eq!(seen["inputs"]["word"], Value::Null);
}

#[test]
fn frames_are_counted_by_direction_and_second() {
    let mut picture = picture();
    for sequence in 0..300 {
        let at = MS(sequence * 10);
        picture.take(at, Lane::Answers, &answer(1, sequence, sequence, SAMPLED, standing(None)));
        if sequence % 10 == 0 {
            picture.take(at, Lane::Commands, &command(sequence / 10, sequence, 1, Operation::Status));
        }
    }
    let seen = json_of(&picture, &Detail::default());
    assert_eq!(seen["answers"], json!({ "total": 300, "per_second": 100 }));
    assert_eq!(seen["commands"], json!({ "total": 30, "per_second": 10 }));
}
