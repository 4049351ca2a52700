//! Writer and reader on whole files, and what others make of them.

use std::io::{self, Write};
use std::process::Command as Process;

use supersigma_protocol::Ticks;

use super::*;
use crate::log::{Form, FramesAsked, LogError, frames};

/// A second of a small set: commands, answers, heartbeats, digital frames, an axis that is not configured.
fn second() -> Vec<Frame> {
    let mut frames = vec![command(0, 100, &[0, 0x05])];
    for (number, card) in [1, 2, 5].into_iter().enumerate() {
        let tick = 200 + number as u64;
        frames.push(answer(card, 0, tick, About::Command(Sequence(0), Ok(()))));
    }
    for beat in 1..=10 {
        let tick = beat * 100 * MILLISECOND;
        frames.push(command(beat, tick, &[1, 0x01, 0x0A, 0x28]));
        frames.extend([1, 2, 5].map(|card| answer(card, beat, tick + u64::from(card), HEARTBEAT)));
        let mut digital = answer(8, beat - 1, tick + 9, HEARTBEAT);
        if let Body::Answer(answer) = &mut digital.body {
            answer.report = Report::Digital(3);
        }
        frames.push(digital);
    }
    frames
}

fn asked(axis: Option<&str>, json: bool) -> FramesAsked<'_> {
    FramesAsked { axis, form: if json { Form::Json } else { Form::People }, ..FramesAsked::default() }
}

#[test]
fn what_was_written_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let frames = second();
    let summary = write(&path, &frames);
    assert_eq!(
        summary,
        LogSummary {
            frames: 54,
            commands: 11,
            answers: 43,
            gaps: 0,
            lost: 0,
            undecodable: 0,
            bytes: fs::metadata(&path).expect("there").len(),
            parts: vec![path.clone()],
        }
    );
    let (logged, reader) = read(&path);
    assert!(!reader.truncated());
    assert_eq!(reader.header(), Some(&header()));
    assert_eq!(logged.len(), frames.len());
    for (logged, frame) in logged.iter().zip(&frames) {
        assert_eq!(logged.frame.as_ref(), Ok(frame));
        assert_eq!(logged.bytes, frame.encode());
        assert_eq!(logged.lane, lane(frame));
        assert_eq!(logged.log_time, WallTime(EPOCH.0 + frame.tick.0 * 500));
    }
}

#[test]
fn every_frame_has_its_twin() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    write(&path, &second());
    let messages = messages(&path);
    for (topic, count) in [
        ("/microbus", 54),
        ("/command", 11),
        ("/axis/left_x/status", 11),
        ("/axis/left_y/status", 11),
        ("/axis/5/status", 11),
        ("/digital/status", 10),
        ("/events", 0),
        ("/joint_states", 1),
    ] {
        assert_eq!(on(&messages, topic).len(), count, "{topic}");
    }
    let of_frames = |message: &&Message| message.topic != "/joint_states";
    assert!(messages.iter().filter(of_frames).all(|message| message.log_time == message.publish_time));
    assert!(messages.is_sorted_by_key(|message| message.log_time));
    assert_eq!(on(&messages, "/command")[1].json()["bytes"], "01 01 0A 28");
    assert_eq!(on(&messages, "/axis/left_x/status")[0].json()["sense"], "00010");
    assert_eq!(on(&messages, "/digital/status")[0].json()["word"], 3);
}

#[test]
fn an_existing_file_is_never_touched() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    fs::write(&path, "precious").expect("writable");
    let error = LogWriter::create(&path, header(), FLUSH).err().expect("refused");
    assert!(matches!(error, LogError::Exists { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.contains("run.mcap exists already"), "{text}");
    assert_eq!(fs::read(&path).expect("readable"), b"precious");
    let error =
        LogWriter::create(&folder.path().join("no/run.mcap"), header(), FLUSH).err().expect("no folder");
    assert!(matches!(error, LogError::Create { .. }), "{error:?}");
}

#[test]
fn other_files_are_named_as_such() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("else");
    assert!(matches!(LogReader::open(&path), Err(LogError::Read { .. })));
    fs::write(&path, "abc").expect("writable");
    assert!(matches!(LogReader::open(&path), Err(LogError::NotALog { .. })));
    fs::write(&path, "this is a text file").expect("writable");
    assert!(matches!(LogReader::open(&path), Err(LogError::NotALog { .. })));
    let mut foreign = mcap::Writer::new(fs::File::create(&path).expect("writable")).expect("writable");
    foreign.finish().expect("writable");
    let error = LogReader::open(&path).err().expect("refused").to_string();
    assert!(error.contains("no metadata record `supersigma`"), "{error}");
}

/// At every caller's poll, everything recorded `FLUSH` ago or earlier is readable in the unfinished file.
#[test]
fn what_is_old_enough_is_on_disk() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let poll = writer.timeline().scale.ticks(writer.poll()).0;
    let flush = writer.timeline().scale.ticks(FLUSH);
    assert_eq!((poll, flush), (10 * MILLISECOND, Ticks(100 * MILLISECOND)));
    let mut recorded: Vec<u64> = Vec::new();
    for turn in 0..60 {
        let now = turn * poll;
        // Now and then nothing, now and then a sender whose clock is ahead.
        for frame in 0..turn % 4 {
            let sequence = recorded.len() as u64;
            let frame = answer(1, sequence, now + frame * 15 * MILLISECOND, HEARTBEAT);
            writer.record(Lane::Answers, &frame.encode(), Tick(now));
            recorded.push(now);
        }
        writer.advance(Tick(now)).expect("the disk has room");
        let due = recorded.iter().filter(|&&recorded| recorded + flush.0 <= now).count();
        let (on_disk, reader) = read(&path);
        assert!(reader.truncated());
        assert!(on_disk.len() >= due, "{} of {due} at turn {turn}", on_disk.len());
    }
    assert_eq!(writer.finish().expect("the disk has room").frames, recorded.len() as u64);
}

#[test]
fn time_runs_faster_than_the_wall() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let fast = Timeline { epoch: EPOCH, scale: TimeScale::new(8.0).expect("positive") };
    let header = LogHeader { timeline: fast, script: None, ..header() };
    let mut writer = LogWriter::create(&path, header.clone(), FLUSH).expect("a new file");
    // Eight seconds of machine time are one of the wall's.
    let frame = answer(1, 0, 16_000_000, HEARTBEAT);
    writer.record(Lane::Answers, &frame.encode(), frame.tick);
    writer.finish().expect("the disk has room");
    let (logged, reader) = read(&path);
    assert_eq!(logged[0].log_time, WallTime(EPOCH.0 + 1_000_000_000));
    assert_eq!(reader.header(), Some(&header));
}

#[test]
fn a_line_for_every_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let frames_written = second();
    let mut writer = writer(&path);
    for frame in &frames_written {
        writer.record(lane(frame), &frame.encode(), frame.tick);
    }
    writer.record(Lane::Answers, &[0xFF], Tick(1));
    writer.finish().expect("the disk has room");

    let print = |axis: Option<&str>, json| {
        let mut out = Vec::new();
        let count = frames(&path, &asked(axis, json), &mut out).expect("readable");
        (count, String::from_utf8(out).expect("UTF-8"))
    };
    let (count, text) = print(None, true);
    assert_eq!((count.printed, count.read, count.truncated), (55, 55, false));
    let kinds: Vec<String> = text
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON")["kind"].to_string())
        .collect();
    let of = |kind: &str| kinds.iter().filter(|other| *other == kind).count();
    assert_eq!((of("\"command\""), of("\"answer\""), of("\"undecodable\"")), (11, 43, 1));

    let (count, text) = print(None, false);
    assert_eq!((count.printed, text.lines().count()), (55, 56));
    // One command to everyone, ten to axis 1, eleven answers of it.
    assert_eq!(print(Some("left_x"), true).0.printed, 22);
    assert_eq!(print(Some("1"), true).0.printed, 22);
    assert_eq!(print(Some("left_y"), true).0.printed, 12);
    let error =
        frames(&path, &asked(Some("elbow"), true), &mut io::sink()).expect_err("no such axis").to_string();
    assert!(error.ends_with("knows no axis `elbow`; it has 1 left_x, 2 left_y"), "{error}");
}

/// `ccu frames LOG | head`.
#[test]
fn a_reader_may_go_away() {
    struct Pipe(usize);
    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::BrokenPipe)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    write(&path, &second());
    for form in [Form::People, Form::Json, Form::Csv] {
        let asked = FramesAsked { form, ..FramesAsked::default() };
        let count = frames(&path, &asked, &mut Pipe(2_000)).expect("a quiet end");
        assert!(form == Form::Csv || (1..54).contains(&count.printed), "{count:?}");
        assert_eq!(frames(&path, &asked, &mut Pipe(0)).expect("a quiet end").printed > 0, form == Form::Csv);
    }
}

/// The file through the reference implementation in Python, where it is installed: nothing of ours takes part.
#[test]
fn the_reference_reader_agrees() {
    const SCRIPT: &str = r#"
import sys, json, jsonschema
from collections import Counter
from mcap.reader import make_reader
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    summary, topics, last = reader.get_summary(), Counter(), 0
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        assert message.log_time >= last, "log times fall"
        last = message.log_time
        topics[channel.topic] += 1
        if channel.message_encoding == "json":
            value, shape = json.loads(message.data), json.loads(schema.data)
            assert schema.encoding == "jsonschema"
            assert set(value) <= set(shape["properties"]), (set(value), schema.name)
            jsonschema.Draft202012Validator.check_schema(shape)
            jsonschema.Draft202012Validator(shape).validate(value)
    attachments = sorted(attachment.name for attachment in reader.iter_attachments())
    metadata = {record.name: record.metadata for record in reader.iter_metadata()}
print(json.dumps({
    "topics": topics, "count": summary.statistics.message_count,
    "channels": summary.statistics.channel_count, "attachments": attachments,
    "epoch_ns": metadata["supersigma"]["epoch_ns"],
}))
"#;
    let importable = Process::new("python3").args(["-c", "import mcap, jsonschema"]).output();
    match importable {
        Ok(output) if output.status.success() => {}
        _ => {
            println!("skipped: python3 with mcap and jsonschema (pip install mcap jsonschema) is not here");
            return;
        }
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    write(&path, &second());
    let output = Process::new("python3").arg("-c").arg(SCRIPT).arg(&path).output().expect("it ran before");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    println!("{told}");
    assert_eq!(told["count"], 109);
    assert_eq!(told["channels"], 9);
    assert_eq!(told["topics"]["/microbus"], 54);
    assert_eq!(told["topics"]["/axis/5/status"], 11);
    assert_eq!(told["attachments"], serde_json::json!(["config.toml", "script.rhai"]));
    assert_eq!(told["epoch_ns"], EPOCH.0.to_string());
}
