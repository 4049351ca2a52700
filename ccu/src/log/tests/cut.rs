//! Logs whose writer, disk or power ended early, and logs with changed bytes.

use proptest::prelude::*;

use super::*;
use crate::log::LogError;

/// A log's bytes, its frames, and where it stood after each flush: (length, frames in it).
struct Log {
    bytes: Vec<u8>,
    frames: Vec<Frame>,
    flushed: Vec<(usize, usize)>,
}

fn log() -> Log {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let length = || usize::try_from(fs::metadata(&path).expect("there").len()).expect("short");
    let mut frames = Vec::new();
    let mut flushed = vec![(length(), 0)];
    for turn in 0..150 {
        let tick = turn * 10 * MILLISECOND;
        let frame = answer(1, turn, tick, HEARTBEAT);
        writer.record(Lane::Answers, &frame.encode(), Tick(tick));
        writer.advance(Tick(tick)).expect("the disk has room");
        frames.push(frame);
        if length() > flushed[flushed.len() - 1].0 {
            flushed.push((length(), read(&path).0.len()));
        }
    }
    writer.finish().expect("the disk has room");
    Log { bytes: fs::read(&path).expect("readable"), frames, flushed }
}

fn decoded(logged: &[LoggedFrame]) -> Vec<&Frame> {
    logged.iter().map(|logged| logged.frame.as_ref().expect("a frame")).collect()
}

#[test]
fn a_cut_log_gives_every_complete_chunk() {
    let Log { bytes, frames, flushed } = log();
    assert!(flushed.len() > 15, "a chunk about every 75 ms: {flushed:?}");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cut.mcap");
    let near = |at: usize| [at.saturating_sub(1), at, at + 1];
    let cuts = (0..bytes.len())
        .step_by(61)
        .chain(0..24)
        .chain(flushed.iter().flat_map(|&(at, _)| near(at)))
        .chain(bytes.len() - 24..bytes.len())
        .filter(|&cut| cut < bytes.len());
    for cut in cuts {
        fs::write(&path, &bytes[..cut]).expect("writable");
        let (logged, reader) = read(&path);
        assert!(reader.truncated(), "cut at {cut}");
        let due = flushed.iter().rfind(|(at, _)| *at <= cut).map_or(0, |&(_, frames)| frames);
        assert!(logged.len() >= due, "cut at {cut}: {} of {due}", logged.len());
        assert!(decoded(&logged).into_iter().eq(&frames[..logged.len()]), "cut at {cut}");
        assert!(reader.header().is_some() || logged.is_empty(), "cut at {cut}");
    }
    fs::write(&path, &bytes).expect("writable");
    let (logged, reader) = read(&path);
    assert!(!reader.truncated());
    assert!(decoded(&logged).into_iter().eq(&frames));
}

#[test]
fn a_tail_of_zeros_is_a_cut() {
    let Log { bytes, flushed, .. } = log();
    let (end, due) = flushed[5];
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("zeros.mcap");
    let mut zeros = bytes[..end].to_vec();
    zeros.resize(end + 4_096, 0);
    fs::write(&path, zeros).expect("writable");
    let (logged, reader) = read(&path);
    assert_eq!((logged.len(), reader.truncated()), (due, true));
}

#[test]
fn a_changed_byte_is_damage_and_what_stands_before_is_read() {
    let Log { mut bytes, flushed, .. } = log();
    let ((start, before), (end, _)) = (flushed[5], flushed[6]);
    // A chunk is its code, length, first time, last time, uncompressed size (1 + 4 · 8 bytes), and then its checksum:
    // with that one changed, every frame in it still decodes, and none of them may be believed.
    bytes[start + 33] ^= 0x10;
    assert!(start + 33 < end);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("changed.mcap");
    fs::write(&path, bytes).expect("writable");
    let results: Vec<_> = LogReader::open(&path).expect("its beginning is whole").collect();
    assert_eq!(results.len(), before + 1, "an error ends the iteration");
    assert!(results[..before].iter().all(Result::is_ok));
    let error = results[before].as_ref().expect_err("damaged");
    assert!(matches!(error, LogError::Damaged { frames, .. } if *frames == before as u64), "{error:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Changed bytes anywhere: an error or fewer frames, never a panic or an endless loop.
    #[test]
    fn no_bytes_make_the_reader_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        use std::sync::LazyLock;
        static LOG: LazyLock<Log> = LazyLock::new(log);
        let mut bytes = LOG.bytes.clone();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("changed.mcap");
        fs::write(&path, bytes).expect("writable");
        if let Ok(reader) = LogReader::open(&path) {
            prop_assert!(reader.count() <= LOG.frames.len() + 1);
        }
    }
}
