//! Gaps, lives, refusals, alarms and bytes that are no frame: counted, returned, and written to `/events`.

use supersigma_protocol::Alarm;

use super::*;
use crate::log::Gap;

/// Records frames in this order and returns the gaps, the summary, and the events as (level, name, message).
fn record(frames: &[Frame]) -> (Vec<Gap>, LogSummary, Vec<(u64, String, String)>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let gaps =
        frames.iter().filter_map(|frame| writer.record(lane(frame), &frame.encode(), frame.tick)).collect();
    let summary = writer.finish().expect("the disk has room");
    (gaps, summary, events(&path))
}

fn events(path: &Path) -> Vec<(u64, String, String)> {
    let text = |value: &serde_json::Value| value.as_str().expect("a text").to_owned();
    on(&messages(path), "/events")
        .into_iter()
        .map(|message| {
            let event = message.json();
            let stamp = &event["timestamp"];
            let nanoseconds =
                stamp["sec"].as_u64().zip(stamp["nsec"].as_u64()).map(|(s, n)| s * 1_000_000_000 + n);
            assert_eq!(nanoseconds, Some(message.log_time));
            (event["level"].as_u64().expect("a level"), text(&event["name"]), text(&event["message"]))
        })
        .collect()
}

#[test]
fn a_gap_is_an_alarm() {
    let frames = [
        command(0, 1, &[1, 5]),
        answer(1, 0, 2, HEARTBEAT),
        answer(1, 4, 3, HEARTBEAT),
        answer(1, 5, 4, HEARTBEAT),
        command(2, 5, &[1, 5]),
    ];
    let (gaps, summary, events) = record(&frames);
    let expected = [
        Gap { sender: Sender::Card(Address(1)), expected: Sequence(1), got: Sequence(4) },
        Gap { sender: Sender::Ccu, expected: Sequence(1), got: Sequence(2) },
    ];
    assert_eq!(gaps, expected);
    assert_eq!((summary.gaps, summary.lost, summary.frames), (2, 4, 5));
    let text = |number: u64, due: u64, came: u64| {
        format!("{number} frames are missing from the log: number {due} was due, {came} came")
    };
    assert_eq!(events, [(4, "left_x".to_owned(), text(3, 1, 4)), (4, "ccu".to_owned(), text(1, 1, 2))]);
}

#[test]
fn a_new_life_is_no_gap() {
    let frames = [
        answer(1, 0, 1, HEARTBEAT),
        answer(1, 1, 2, HEARTBEAT),
        answer(1, 0, 3, HEARTBEAT),
        answer(1, 1, 4, HEARTBEAT),
    ];
    let (gaps, summary, events) = record(&frames);
    assert_eq!((gaps, summary.gaps, summary.lost, events), (vec![], 0, 0, vec![]));
}

#[test]
fn a_new_life_without_its_first_frames_is_one() {
    let frames = [answer(1, 3, 1, HEARTBEAT), answer(1, 4, 2, HEARTBEAT), answer(1, 2, 3, HEARTBEAT)];
    let (gaps, summary, _) = record(&frames);
    assert_eq!(gaps.iter().map(Gap::lost).collect::<Vec<_>>(), [3, 2]);
    assert_eq!((summary.gaps, summary.lost), (2, 5));
}

#[test]
fn the_last_number_of_all_is_survived() {
    let (gaps, summary, _) = record(&[answer(1, u64::MAX, 1, HEARTBEAT), answer(1, u64::MAX, 2, HEARTBEAT)]);
    assert_eq!((gaps.len(), summary.frames), (1, 2));
}

#[test]
fn a_refusal_names_its_command() {
    let (_, _, events) = record(&[command(0, 1, &[1, 1, 0, 9]), answer(1, 0, 2, REFUSED)]);
    let message = "refused command 0 (Move): the position is unknown; originate first".to_owned();
    assert_eq!(events, [(3, "left_x".to_owned(), message)]);
    let (_, _, events) = record(&[command(0, 1, &[1, 0x7F]), answer(1, 0, 2, REFUSED)]);
    assert!(events[0].2.starts_with("refused command 0 [01 7F]: "), "{events:?}");
}

#[test]
fn a_lasting_alarm_is_one_event() {
    let alarm = |sequence, alarm| alarmed(2, sequence, sequence + 1, HEARTBEAT, alarm);
    let frames = [
        alarm(0, None),
        alarm(1, Some(Alarm::ExcessiveForce)),
        alarm(2, Some(Alarm::ExcessiveForce)),
        alarm(3, Some(Alarm::Braked)),
        alarm(4, None),
        alarm(5, Some(Alarm::Braked)),
    ];
    let (_, _, events) = record(&frames);
    let locked = |why| (4, "left_y".to_owned(), format!("left_y is locked: {why}"));
    let expected = [locked("excessive force"), locked("braked on command"), locked("braked on command")];
    assert_eq!(events, expected);
}

#[test]
fn bytes_that_are_no_frame_are_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let mut long = command(0, 1, &[1, 5]).encode();
    long.push(7);
    assert_eq!(writer.record(Lane::Commands, &long, Tick(10)), None);
    assert_eq!(writer.record(Lane::Answers, &[], Tick(20)), None);
    let summary = writer.finish().expect("the disk has room");
    assert_eq!((summary.frames, summary.undecodable, summary.commands), (2, 2, 0));
    let (logged, _) = read(&path);
    assert_eq!((&logged[0].bytes, logged[0].lane), (&long, Lane::Commands));
    assert_eq!(logged[0].log_time, WallTime(EPOCH.0 + 10 * 500));
    assert_eq!((logged[1].bytes.len(), logged[1].lane), (0, Lane::Answers));
    assert!(logged.iter().all(|logged| logged.frame.is_err()));
    let events = events(&path);
    assert_eq!(events.len(), 2);
    assert_eq!((events[0].0, events[0].1.as_str()), (4, "bus"));
    assert!(events[0].2.starts_with("not a frame: 1 bytes too many ["), "{events:?}");
}

#[test]
fn a_motor_report_of_no_motor_has_no_twin() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    write(&path, &[answer(12, 0, 1, HEARTBEAT)]);
    assert_eq!(messages(&path).len(), 2);
    assert_eq!(events(&path)[0].2, "address 12 reports as a motor card, and is none");
}

#[test]
fn what_the_daemon_says_stands_where_it_belongs() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let event = |message: &str| crate::log::Event {
        level: crate::log::Level::Info,
        name: "ccu::daemon".to_owned(),
        message: message.to_owned(),
        file: "ccu/src/daemon/mod.rs".to_owned(),
        line: 7,
    };
    let frame = answer(1, 0, 20 * MILLISECOND, HEARTBEAT);
    writer.record(lane(&frame), &frame.encode(), frame.tick);
    writer.note(Tick(10 * MILLISECOND), event("before the frame"), frame.tick);
    writer.note(Tick(9 * MILLISECOND), event("in the order of saying"), frame.tick);
    // Nothing comes from the bus, and it is on disk all the same.
    let mut now = frame.tick;
    for _ in 0..20 {
        now = Tick(now.0 + 10 * MILLISECOND);
        writer.advance(now).expect("the disk has room");
    }
    writer.note(Tick(now.0 - MILLISECOND), event("alone"), now);
    for _ in 0..10 {
        now = Tick(now.0 + 10 * MILLISECOND);
        writer.advance(now).expect("the disk has room");
    }
    let on_disk = fs::metadata(&path).expect("there").len();
    writer.note(now, event("last"), now);
    writer.finish().expect("the disk has room");
    assert!(fs::metadata(&path).expect("there").len() > on_disk);
    let told = messages(&path);
    let topics: Vec<&str> = told.iter().map(|message| message.topic.as_str()).collect();
    let frame = ["/microbus", "/axis/left_x/status"];
    let expected = [&["/events"; 2][..], &frame[..], &["/events"; 2][..]].concat();
    assert_eq!(topics, expected);
    let event = told[0].json();
    assert_eq!(
        (&event["level"], &event["file"], &event["line"]),
        (&2.into(), &"ccu/src/daemon/mod.rs".into(), &7.into())
    );
    let words: Vec<String> = events(&path).into_iter().map(|(_, _, message)| message).collect();
    assert_eq!(words, ["before the frame", "in the order of saying", "alone", "last"]);
}

#[test]
fn who_comes_late_misses_nothing_that_was_said_before() {
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("run.mcap");
    let mut writer = LogWriter::resume(&log, 2, header(), FLUSH).expect("a new file");
    for frame in [answer(1, 70, 1, HEARTBEAT), answer(2, 9, 2, HEARTBEAT), answer(1, 72, 3, HEARTBEAT)] {
        let _ = writer.record(lane(&frame), &frame.encode(), frame.tick);
    }
    let summary = writer.finish().expect("room");
    assert_eq!((summary.frames, summary.gaps, summary.lost), (3, 1, 1));
    assert_eq!(summary.parts, [dir.path().join("run.2.mcap")]);
}
