//! The filter against one that looks at all frames at once, through the index and without it; and the table.

use proptest::prelude::*;
use supersigma_protocol::{Command, Fault, Operation};

use super::*;
use crate::log::{Form, FramesAsked, frames, operation};

/// Seconds of a small set, with pauses, so that chunks lie far apart: every `wait` milliseconds one of four frames.
fn frames_of(waits: &[(u16, u8)]) -> Vec<Frame> {
    let mut tick = 0;
    let mut numbers = [0_u64; 10];
    let mut next = |sender: usize| {
        numbers[sender] += 1;
        numbers[sender] - 1
    };
    let mut asked = None;
    let mut made = Vec::new();
    for &(wait, kind) in waits {
        tick += u64::from(wait) * 4 * MILLISECOND;
        let card = kind % 3;
        made.push(match kind / 3 % 4 {
            0 => {
                let number = next(0);
                asked = Some(Sequence(number));
                let bytes = match kind % 5 % 3 {
                    0 => vec![card, 0x01, 0x0A, 0x28],
                    1 => vec![card, 0x06],
                    _ => vec![card, 0x05],
                };
                command(number, tick, &bytes)
            }
            1 => {
                let about = asked.map_or(HEARTBEAT, |number| About::Command(number, Ok(())));
                answer(card + 1, next(usize::from(card) + 1), tick, about)
            }
            2 => answer(card + 1, next(usize::from(card) + 1), tick, HEARTBEAT),
            _ => {
                let number = next(0);
                asked = Some(Sequence(number));
                let body = Body::Fault(axis(card + 1), Fault::Force);
                Frame { body, ..command(number, tick, &[1, 5]) }
            }
        });
    }
    made
}

/// Which frames are wanted, by looking at all of them at once.
fn naive(all: &[Frame], asked: &FramesAsked<'_>) -> Vec<Frame> {
    let axis = asked.axis.map(|name| if name == "left_x" { 1 } else { 2 });
    let passes = |frame: &Frame| {
        let about = match &frame.body {
            Body::Command(command) => command.bytes.as_slice()[0],
            Body::Fault(axis, _) => axis.get(),
            Body::Answer(answer) => answer.card.0,
        };
        let to_everyone = about == 0 && matches!(frame.body, Body::Command(_));
        asked.from.is_none_or(|from| frame.tick >= from)
            && asked.to.is_none_or(|to| frame.tick < to)
            && axis.is_none_or(|axis| axis == about || to_everyone)
    };
    let is_asked = |frame: &Frame| {
        passes(frame)
            && match &frame.body {
                Body::Command(command) => {
                    let command = Command::decode(command.bytes.as_slice()).expect("a command");
                    Some(command.operation.name()) == asked.operation
                }
                Body::Fault(..) => asked.operation == Some("Fault"),
                Body::Answer(_) => false,
            }
    };
    let numbers: Vec<Sequence> =
        all.iter().filter(|&frame| is_asked(frame)).map(|frame| frame.sequence).collect();
    let answers = |frame: &Frame| match &frame.body {
        Body::Answer(answer) => {
            matches!(answer.about, About::Command(number, _) if numbers.contains(&number))
        }
        _ => false,
    };
    let wanted =
        |frame: &&Frame| passes(frame) && (asked.operation.is_none() || is_asked(frame) || answers(frame));
    all.iter().filter(wanted).cloned().collect()
}

fn printed(path: &Path, asked: &FramesAsked<'_>) -> (Vec<serde_json::Value>, u64) {
    let mut out = Vec::new();
    let count = frames(path, asked, &mut out).expect("readable");
    let lines = out.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
    (lines.map(|line| serde_json::from_slice(line).expect("JSON")).collect(), count.read)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_filter_is_the_naive_one(
        waits in prop::collection::vec((0_u16..4_000, 0_u8..36), 1..120),
        axis in prop::option::of(prop::sample::select(vec!["left_x", "left_y"])),
        from in prop::option::of(any::<prop::sample::Index>()),
        to in prop::option::of(any::<prop::sample::Index>()),
        operation in prop::option::of(prop::sample::select(vec!["Move", "Halt", "Fault"])),
    ) {
        let all = frames_of(&waits);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("run.mcap");
        write(&path, &all);
        let moment = |index: prop::sample::Index| all[index.index(all.len())].tick;
        let asked = FramesAsked { axis, from: from.map(moment), to: to.map(moment), operation, form: Form::Json };
        let expected = naive(&all, &asked);
        let number = |frame: &Frame| (frame.tick.0, frame.sequence.0);
        let expected: Vec<_> = expected.iter().map(number).collect();
        let numbers = |frames: &[serde_json::Value]| -> Vec<(u64, u64)> {
            let number = |frame: &serde_json::Value, key: &str| frame[key].as_u64().expect("a number");
            frames.iter().map(|frame| (number(frame, "tick"), number(frame, "sequence"))).collect()
        };
        let (whole, _) = printed(&path, &asked);
        prop_assert_eq!(numbers(&whole), expected.clone());
        // Without its footer the log is read from its beginning.
        let bytes = fs::read(&path).expect("readable");
        fs::write(&path, &bytes[..bytes.len() - 1]).expect("writable");
        let (cut, _) = printed(&path, &asked);
        prop_assert_eq!(numbers(&cut), expected);
    }

    /// Every tick of a log comes back from its wall time.
    #[test]
    fn a_timeline_goes_both_ways(tick in 0_u64..1 << 44, scale in 0.01_f64..=400.0) {
        let timeline = Timeline { epoch: EPOCH, scale: TimeScale::new(scale).expect("in range") };
        let back = timeline.tick(timeline.wall(Tick(tick))).0;
        // Nanoseconds are cut off: less than one, which is less than a tick.
        prop_assert!(back.abs_diff(tick) <= 1, "{} for {}", back, tick);
        let real = Timeline { epoch: EPOCH, scale: TimeScale::REAL };
        prop_assert_eq!(real.tick(real.wall(Tick(tick))), Tick(tick));
    }
}

#[test]
fn only_the_chunks_of_the_time_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let beats: Vec<Frame> =
        (0..3_000).map(|beat| answer(1, beat, beat * 100 * MILLISECOND, HEARTBEAT)).collect();
    write(&path, &beats);
    let second = |second: u64| Some(Tick(second * 1_000 * MILLISECOND));
    let asked =
        FramesAsked { from: second(100), to: second(101), form: Form::Json, ..FramesAsked::default() };
    let (frames, read) = printed(&path, &asked);
    assert_eq!(frames.len(), 10);
    // Ten seconds before and behind, and what else is in the outermost chunks.
    assert!((210..=220).contains(&read), "{read} frames were read");
    // A changed bit in the index, and the log is read from its beginning, with the same result.
    let mut bytes = fs::read(&path).expect("readable");
    let summary = bytes.len() - 200;
    bytes[summary] ^= 1;
    fs::write(&path, bytes).expect("writable");
    let (again, read) = printed(&path, &FramesAsked { to: second(101), ..asked });
    assert_eq!((again, read), (frames, 3_000));
}

#[test]
fn operations_are_known_by_their_names() {
    for (typed, name) in
        [("move", "Move"), ("GO", "Go"), ("seek-reference", "SeekReference"), ("fault", "Fault")]
    {
        assert_eq!(operation(typed), Ok(name));
    }
    let error = operation("mvoe").expect_err("none");
    assert!(error.starts_with("did you mean `Move`? the operations are `Move`, `MoveLimited`, "), "{error}");
    assert!(error.ends_with("`Join`, `Fault`"), "{error}");
    let error = operation("dance").expect_err("none");
    assert!(error.starts_with("the operations are "), "{error}");
    // Every byte that is an operation has its name in the list, and no name stands there for nothing.
    let mut names: Vec<&str> = (0..=u8::MAX)
        .flat_map(|byte| {
            let long = [1, byte, 1, 90, 9, 0, 0];
            let digital = [8, 9].map(|card| [card, byte, 0, 0]);
            let motor = (2..=7).filter_map(move |length| Command::decode(&long[..length]).ok());
            let cards = digital
                .into_iter()
                .flat_map(|bytes| (2..=4).filter_map(move |length| Command::decode(&bytes[..length]).ok()));
            motor.chain(cards).map(|command| command.operation.name()).collect::<Vec<_>>()
        })
        .collect();
    names.sort_unstable();
    names.dedup();
    let mut known = Operation::NAMES.to_vec();
    known.sort_unstable();
    assert_eq!(names, known);
}

#[test]
fn a_table_has_its_columns() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let frames_written = [
        command(0, 2_000_000, &[1, 1, 10, 0x28]),
        alarmed(1, 0, 2_000_100, REFUSED, Some(Alarm::ExcessiveForce)),
    ];
    for frame in &frames_written {
        writer.record(lane(frame), &frame.encode(), frame.tick);
    }
    writer.record(Lane::Answers, &[0xFF], Tick(3_000_000));
    writer.finish().expect("the disk has room");
    let mut out = Vec::new();
    let asked = FramesAsked { form: Form::Csv, ..FramesAsked::default() };
    frames(&path, &asked, &mut out).expect("readable");
    let text = String::from_utf8(out).expect("UTF-8");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "kind,time_s,tick,sender,sequence,address,name,bytes,operation,direction,steps,speed,word,fault,at,about,command,\
         refusal,acted_at,sense,position,activity,steps_per_s,period,alarm,lost,reason,cause,error"
    );
    assert_eq!(
        lines[1],
        "command,1.0,2000000,ccu,0,1,left_x,01 01 0A 28,Move,forward,2600,,,,,,,,,,,,,,,,,,"
    );
    assert_eq!(
        lines[2],
        "answer,1.00005,2000100,left_x,0,1,left_x,,,,2600,,,,,command,0,the position is unknown; originate first,\
         2000097,00010,-17,standing,0.0,,excessive force,,not_originated,excessive_force,"
    );
    assert!(lines[3].starts_with("undecodable,,,,,,,FF,,"), "{}", lines[3]);
    assert_eq!(lines.len(), 4);
    // What has commas or quotes in it is quoted, so that every row has all columns.
    let mut rows = csv::ReaderBuilder::new().from_reader(text.as_bytes());
    assert!(rows.records().all(|row| row.expect("as many fields as columns").len() == 29));
}
