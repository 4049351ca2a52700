//! Logs cut at every byte, and logs with every byte changed: what is whole in them is kept, and reads as what it was.
//! What is expected is found with the format library's own readers.

use std::io::Cursor;
use std::ops::Range;

use proptest::prelude::*;

use super::*;
use crate::log::recover::{Trouble, rebuild};
use crate::log::{LogError, Lost, Recovery, recover};

/// A message as it stands in a file: channel, number, times, bytes.
type Raw = (u16, u32, u64, u64, Vec<u8>);

/// A small log: its bytes, its chunks, the messages in each of them.
struct Sample {
    bytes: Vec<u8>,
    chunks: Vec<Range<usize>>,
    messages: Vec<Vec<Raw>>,
}

impl Sample {
    fn new(turns: u64) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("run.mcap");
        let mut writer = writer(&path);
        for turn in 0..turns {
            let tick = turn * 25 * MILLISECOND;
            let mut record = |frame: Frame| {
                writer.record(lane(&frame), &frame.encode(), frame.tick);
            };
            record(answer(1, turn, tick, HEARTBEAT));
            if turn % 3 == 0 {
                record(command(turn / 3, tick, &[1, 5]));
            }
            writer.advance(Tick(tick)).expect("the disk has room");
        }
        writer.finish().expect("the disk has room");
        let bytes = fs::read(&path).expect("readable");
        let summary = mcap::Summary::read(&bytes).expect("MCAP").expect("complete");
        let place = |number: u64| usize::try_from(number).expect("short");
        let chunks: Vec<_> = summary
            .chunk_indexes
            .iter()
            .map(|chunk| {
                let start = place(chunk.chunk_start_offset);
                start..start + place(chunk.chunk_length)
            })
            .collect();
        let messages = summary.chunk_indexes.iter().map(|chunk| {
            let messages = summary.stream_chunk(&bytes, chunk).expect("whole");
            messages.map(|message| raw(&message.expect("whole"))).collect()
        });
        Self { messages: messages.collect(), chunks, bytes: bytes.clone() }
    }

    /// The messages of these chunks.
    fn of(&self, chunks: impl Iterator<Item = usize>) -> Vec<Raw> {
        chunks.flat_map(|chunk| self.messages[chunk].clone()).collect()
    }
}

fn raw(message: &mcap::Message) -> Raw {
    let mcap::Message { channel, sequence, log_time, publish_time, data } = message;
    (channel.id, *sequence, *log_time, *publish_time, data.to_vec())
}

/// What is made of `log`, and its messages as the format library finds them, in the chunks of its index.
fn rebuilt(log: &[u8]) -> Result<(Recovery, Vec<Raw>, Vec<u8>), Trouble> {
    let mut out = Cursor::new(Vec::new());
    let recovery = rebuild(Cursor::new(log), &mut out)?;
    let bytes = out.into_inner();
    let summary = mcap::Summary::read(&bytes).expect("MCAP").expect("complete");
    let messages = summary.chunk_indexes.iter().flat_map(|chunk| {
        let messages = summary.stream_chunk(&bytes, chunk).expect("the index is right");
        messages.map(|message| raw(&message.expect("whole")))
    });
    let messages: Vec<Raw> = messages.collect();
    assert_eq!(recovery.messages, messages.len() as u64);
    assert_eq!(summary.stats.expect("statistics").message_count, recovery.messages);
    Ok((recovery, messages, bytes))
}

#[test]
fn a_log_cut_at_any_byte_keeps_every_whole_chunk() {
    let sample = Sample::new(13);
    let Sample { bytes, chunks, .. } = &sample;
    assert!(chunks.len() >= 4, "{chunks:?}");
    // The metadata record is what stands before the first chunk.
    let preamble = chunks[0].start;
    for cut in 0..bytes.len() {
        match rebuilt(&bytes[..cut]) {
            Ok((recovery, messages, _)) => {
                assert!(cut >= preamble, "cut at {cut}");
                let whole = chunks.iter().filter(|chunk| chunk.end <= cut).count();
                assert_eq!(messages, sample.of(0..whole), "cut at {cut}");
                assert_eq!(recovery.chunks, whole as u64, "cut at {cut}");
                assert_eq!((recovery.attachments, recovery.metadata), (2, 1), "cut at {cut}");
                assert_eq!((recovery.complete, recovery.lost.len(), recovery.orphans), (false, 0, 0));
                assert!(recovery.tail.is_none_or(|tail| tail.end == cut as u64), "cut at {cut}");
            }
            Err(Trouble::NothingIn) => assert!(cut < preamble, "cut at {cut}"),
            Err(trouble) => panic!("cut at {cut}: {trouble:?}"),
        }
    }
    let (recovery, messages, copy) = rebuilt(bytes).expect("whole");
    assert_eq!(messages, sample.of(0..chunks.len()));
    assert!(recovery.complete && recovery.tail.is_none(), "{recovery:?}");
    // Attachments and metadata are the same records.
    assert_eq!(copy[..preamble], bytes[..preamble]);
}

#[test]
fn a_changed_bit_costs_at_most_the_chunk_in_which_it_is() {
    let sample = Sample::new(10);
    let Sample { bytes, chunks, .. } = &sample;
    let (second, mut cost) = (chunks[1].start, 0);
    for at in second..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        let (recovery, messages, _) = rebuilt(&changed).unwrap_or_else(|trouble| panic!("{at}: {trouble:?}"));
        // The times in a chunk's head are outside of its checksum, and made anew; some bits of zstd mean nothing.
        if messages == sample.of(0..chunks.len()) {
            continue;
        }
        cost += 1;
        let hit = chunks.iter().position(|chunk| chunk.contains(&at));
        let hit = hit.unwrap_or_else(|| panic!("changed at {at}, which is in no chunk"));
        assert_eq!(messages, sample.of((0..chunks.len()).filter(|&chunk| chunk != hit)), "changed at {at}");
        assert!(!recovery.complete, "changed at {at}");
        let place = recovery.lost.first().map(|lost| lost.bytes.clone()).or(recovery.tail);
        let place = place.unwrap_or_else(|| panic!("nobody says what is lost at {at}"));
        assert_eq!(place.start, chunks[hit].start as u64, "changed at {at}");
        assert!(hit + 1 == chunks.len() || place.end >= chunks[hit].end as u64, "changed at {at}");
    }
    let in_chunks: usize = chunks[1..].iter().map(|chunk| chunk.len() - 16).sum();
    assert!((in_chunks - in_chunks / 20..=in_chunks).contains(&cost), "{cost} of {in_chunks}");
}

#[test]
fn what_was_lost_is_told() {
    let sample = Sample::new(40);
    let Sample { bytes, chunks, messages } = &sample;
    let mut changed = bytes.clone();
    changed[chunks[4].end - 3] ^= 0x20;
    let (recovery, ..) = rebuilt(&changed).expect("recovered");
    let tick = |raw: &Raw| Tick((raw.3 - EPOCH.0) / 500);
    let frames = |chunk: usize| messages[chunk].iter().filter(|raw| raw.0 <= 2).count() as u64;
    let lost = Lost {
        bytes: chunks[4].start as u64..chunks[4].end as u64,
        after: messages[3].last().map(tick),
        before: messages[5].first().map(tick),
        frames: frames(4),
    };
    assert!(lost.frames >= 3);
    assert_eq!(recovery.lost, [lost]);
    assert_eq!(recovery.frames, (0..chunks.len()).map(frames).sum::<u64>() - frames(4));
}

/// The channels stand in the first chunk only; a complete log repeats them in its summary.
#[test]
fn without_their_channels_messages_are_of_no_use() {
    let sample = Sample::new(16);
    let mut changed = sample.bytes.clone();
    changed[sample.chunks[0].end - 3] ^= 1;
    let (recovery, messages, _) = rebuilt(&changed).expect("the summary has the channels");
    assert_eq!((messages, recovery.orphans), (sample.of(1..sample.chunks.len()), 0));
    let cut = sample.chunks[4].end;
    let trouble = rebuilt(&changed[..cut]).expect_err("nothing says what the messages are");
    assert!(matches!(trouble, Trouble::NotALog("the description of its channels is damaged")), "{trouble:?}");
}

#[test]
fn zeros_are_no_chunks() {
    let sample = Sample::new(16);
    let mut zeros = sample.bytes[..sample.chunks[3].start + 9].to_vec();
    zeros.resize(sample.bytes.len(), 0);
    let (recovery, messages, _) = rebuilt(&zeros).expect("recovered");
    assert_eq!((messages, recovery.chunks), (sample.of(0..3), 3));
    // Zeros in the middle cost one chunk.
    let mut hole = sample.bytes.clone();
    hole[sample.chunks[3].clone()].fill(0);
    let (recovery, messages, _) = rebuilt(&hole).expect("recovered");
    assert_eq!(messages, sample.of((0..sample.chunks.len()).filter(|&chunk| chunk != 3)));
    assert_eq!(recovery.lost.len(), 1);
}

#[test]
fn files_are_never_overwritten_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let sample = Sample::new(16);
    let cut = &sample.bytes[..sample.chunks[4].start + 40];
    fs::write(path("cut.mcap"), cut).expect("writable");
    fs::write(path("taken.mcap"), "precious").expect("writable");
    let error = recover(&path("cut.mcap"), &path("taken.mcap")).expect_err("taken");
    assert!(matches!(error, LogError::Exists { .. }), "{error:?}");
    let error = recover(&path("cut.mcap"), &path("cut.mcap")).expect_err("itself");
    assert!(matches!(error, LogError::Exists { .. }), "{error:?}");
    fs::write(path("short.mcap"), &cut[..100]).expect("writable");
    let error = recover(&path("short.mcap"), &path("new.mcap")).expect_err("nothing in it");
    assert!(matches!(error, LogError::NothingIn { .. }), "{error:?}");
    let error = recover(&path("taken.mcap"), &path("new.mcap")).expect_err("a text");
    assert!(matches!(error, LogError::NotALog { .. }), "{error:?}");
    let error = recover(&path("cut.mcap"), &path("no/new.mcap")).expect_err("no folder");
    assert!(matches!(error, LogError::Create { .. }), "{error:?}");

    let recovery = recover(&path("cut.mcap"), &path("new.mcap")).expect("recovered");
    assert_eq!(recovery.bytes, fs::metadata(path("new.mcap")).expect("there").len());
    assert_eq!(fs::read(path("cut.mcap")).expect("readable"), cut);
    assert_eq!(fs::read(path("taken.mcap")).expect("readable"), b"precious");
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("there").file_name().into_string().expect("UTF-8"))
        .collect();
    names.sort();
    assert_eq!(names, ["cut.mcap", "new.mcap", "short.mcap", "taken.mcap"]);
    // For our own reader the cut log and the new one have the same frames.
    let (frames, reader) = read(&path("new.mcap"));
    assert_eq!((&frames, reader.truncated()), (&read(&path("cut.mcap")).0, false));
    assert_eq!(reader.header(), Some(&header()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever happened to a file: no panic, no endless loop, and no message that was not in it.
    #[test]
    fn nothing_is_made_up(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
    ) {
        use std::sync::LazyLock;
        static SAMPLE: LazyLock<Sample> = LazyLock::new(|| Sample::new(24));
        let mut bytes = SAMPLE.bytes.clone();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(cut.index(bytes.len()) + 1);
        if let Ok((_, messages, _)) = rebuilt(&bytes) {
            let all = SAMPLE.of(0..SAMPLE.chunks.len());
            let mut all = all.iter();
            prop_assert!(messages.iter().all(|message| all.any(|other| other == message)));
        }
    }
}
