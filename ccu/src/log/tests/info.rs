//! What `ccu log info` tells of complete, cut and damaged logs.

use std::collections::BTreeMap;

use super::*;
use crate::log::{AlarmInfo, GapInfo, LogError, LogState, info};

fn sample(path: &Path) -> Vec<u8> {
    let mut writer = writer(path);
    let mut digital = answer(8, 0, 40_000, HEARTBEAT);
    if let Body::Answer(answer) = &mut digital.body {
        answer.report = Report::Digital(3);
    }
    for frame in [
        command(0, 2_000, &[1, 5]),
        answer(1, 0, 4_000, About::Command(Sequence(0), Ok(()))),
        answer(2, 0, 4_000, HEARTBEAT),
        digital,
        alarmed(1, 4, 2_000_000, HEARTBEAT, Some(Alarm::Braked)),
        answer(5, 0, 2_000_100, HEARTBEAT),
        command(1, 3_000_000, &[1, 0x0C]),
    ] {
        writer.record(lane(&frame), &frame.encode(), frame.tick);
        writer.advance(frame.tick).expect("the disk has room");
    }
    writer.record(Lane::Answers, &[0xFF], Tick(4_000_000));
    writer.record(Lane::Answers, &answer(12, 0, 4_000_000, HEARTBEAT).encode(), Tick(4_000_000));
    writer.finish().expect("the disk has room");
    fs::read(path).expect("readable")
}

#[test]
fn a_log_is_told_the_same_with_its_index_and_without() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let bytes = sample(&path);
    let told = info(&path).expect("a log");
    assert_eq!((told.state, told.bytes, &*told.set), (LogState::Complete, bytes.len() as u64, "test"));
    assert_eq!(told.version.as_deref(), Some(env!("CARGO_PKG_VERSION")));
    assert_eq!((told.first_s, told.last_s), (Some(0.001), Some(2.0)));
    assert_eq!((told.frames.all, told.frames.commands, told.frames.undecodable), (9, 2, 1));
    let answers = [("5", 1), ("digital", 1), ("left_x", 2), ("left_y", 1)];
    assert_eq!(told.frames.answers, BTreeMap::from(answers.map(|(card, count)| (card.to_owned(), count))));
    assert_eq!(told.gaps, [GapInfo { time_s: 1.0, sender: "left_x".to_owned(), lost: 3 }]);
    let alarm = AlarmInfo { time_s: 1.0, axis: "left_x".to_owned(), alarm: "braked on command".to_owned() };
    assert_eq!(told.alarms, [alarm]);
    let channel = told.channels.iter().find(|channel| channel.topic == "/command").expect("a channel");
    assert_eq!((channel.messages, channel.schema.as_deref()), (2, Some("supersigma.Command")));
    assert_eq!(told.more, BTreeMap::from([("part".to_owned(), "1".to_owned())]));

    fs::write(&path, &bytes[..bytes.len() - 1]).expect("writable");
    let mut cut = info(&path).expect("a log");
    assert_eq!(cut.state, LogState::Cut);
    (cut.state, cut.bytes) = (LogState::Complete, told.bytes);
    assert_eq!(cut, told);
}

#[test]
fn damage_is_told_and_what_stands_before_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut bytes = sample(&path);
    let chunks = mcap::Summary::read(&bytes).expect("MCAP").expect("complete").chunk_indexes;
    let last = chunks.last().expect("chunks");
    let at = usize::try_from(last.chunk_start_offset + last.chunk_length - 2).expect("short");
    bytes[at] ^= 1;
    bytes.pop();
    fs::write(&path, bytes).expect("writable");
    let told = info(&path).expect("a log");
    assert_eq!(told.state, LogState::Damaged);
    assert!(told.damage.expect("a reason").starts_with("after frame "));
    assert!((1..9).contains(&told.frames.all), "{}", told.frames.all);
}

#[test]
fn nothing_is_told_of_what_is_no_log() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let bytes = sample(&path);
    fs::write(&path, &bytes[..60]).expect("writable");
    assert!(matches!(info(&path), Err(LogError::NothingIn { .. })));
    fs::write(&path, "text").expect("writable");
    assert!(matches!(info(&path), Err(LogError::NotALog { .. })));
}
