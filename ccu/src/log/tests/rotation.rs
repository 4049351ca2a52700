//! A log in several files: together they hold every frame once, and each is a whole log.

use std::path::PathBuf;

use proptest::prelude::*;

use super::*;
use crate::log::Rotation;

/// Writes `count` frames of two senders, one a millisecond, in a log that is rotated.
fn rotated(path: &Path, rotation: Rotation, count: u64) -> LogSummary {
    let mut writer = writer(path).rotating(rotation);
    for number in 0..count {
        let (card, sequence) = (1 + u8::from(number % 2 == 1), number / 2);
        let frame = answer(card, sequence, number * MILLISECOND, HEARTBEAT);
        writer.record(Lane::Answers, &frame.encode(), frame.tick);
        writer.advance(frame.tick).expect("the disk has room");
    }
    writer.finish().expect("the disk has room")
}

/// The frames of all parts; each part is finished, and says where it stands.
fn parts(summary: &LogSummary) -> Vec<Vec<LoggedFrame>> {
    let name = |path: &PathBuf| path.file_name().expect("a name").to_string_lossy().into_owned();
    let mut previous = None;
    (1..)
        .zip(&summary.parts)
        .map(|(number, part)| {
            let (frames, reader) = read(part);
            assert!(!reader.truncated());
            assert_eq!(reader.header(), Some(&header()));
            let bytes = fs::read(part).expect("readable");
            let file = mcap::Summary::read(&bytes).expect("MCAP").expect("with a summary");
            let index =
                file.metadata_indexes.iter().find(|index| index.name == "supersigma").expect("metadata");
            let entries = mcap::read::metadata(&bytes, index).expect("whole").metadata;
            assert_eq!(entries["part"], u32::to_string(&number));
            assert_eq!(entries.get("previous").cloned(), previous.replace(name(part)));
            frames
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Nothing is lost and nothing doubled at the seams, wherever they are.
    #[test]
    fn the_parts_are_the_whole(count in 1..1_500_u64, milliseconds in 1..400_u64, bytes in proptest::option::of(20_000..40_000_u64)) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("run.mcap");
        let rotation = Rotation { bytes, time: Some(Duration::from_millis(milliseconds)) };
        let summary = rotated(&path, rotation, count);
        let parts = parts(&summary);
        let numbers: Vec<(Sender, u64)> = parts
            .iter()
            .flatten()
            .map(|logged| logged.frame.as_ref().expect("a frame"))
            .map(|frame| (frame.sender, frame.sequence.0))
            .collect();
        let expected: Vec<(Sender, u64)> =
            (0..count).map(|number| (Sender::Card(Address(1 + u8::from(number % 2 == 1))), number / 2)).collect();
        prop_assert_eq!(numbers, expected);
        prop_assert_eq!((summary.frames, summary.gaps), (count, 0));
        let on_disk: u64 = summary.parts.iter().map(|part| fs::metadata(part).expect("there").len()).sum();
        prop_assert_eq!(summary.bytes, on_disk);
        // A part is looked at when it is flushed, after 75 ms at the most.
        if count > 2 * (milliseconds + 100) {
            prop_assert!(parts.len() > 1, "{} parts", parts.len());
        }
        let times: Vec<u64> = parts.iter().flatten().map(|logged| logged.log_time.0).collect();
        prop_assert!(times.is_sorted());
    }
}

#[test]
fn what_stands_in_the_way_is_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    fs::write(folder.path().join("run.2.mcap"), "precious").expect("writable");
    let rotation = Rotation { bytes: None, time: Some(Duration::from_millis(300)) };
    let summary = rotated(&path, rotation, 700);
    let names: Vec<_> = summary.parts.iter().map(|part| part.file_name().expect("a name")).collect();
    assert_eq!(names[..2], ["run.mcap", "run.3.mcap"]);
    assert_eq!(parts(&summary).iter().map(Vec::len).sum::<usize>(), 700);
    assert_eq!(fs::read(folder.path().join("run.2.mcap")).expect("readable"), b"precious");
}

#[test]
fn without_another_file_the_log_stays_in_this_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path).rotating(Rotation { bytes: Some(1), time: None });
    let moved = folder.path().with_extension("elsewhere");
    fs::rename(folder.path(), &moved).expect("the folder can be moved");
    for number in 0..500 {
        let frame = answer(1, number, number * MILLISECOND, HEARTBEAT);
        writer.record(Lane::Answers, &frame.encode(), frame.tick);
        writer.advance(frame.tick).expect("the disk has room");
    }
    let summary = writer.finish().expect("the disk has room");
    assert_eq!((summary.frames, summary.parts.len()), (500, 1));
    assert_eq!(read(&moved.join("run.mcap")).0.len(), 500);
    fs::remove_dir_all(moved).expect("it is there");
}
