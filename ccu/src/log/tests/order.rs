//! The order of the file, against random senders, delays and clocks.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;

/// A frame and when it reached the recorder.
#[derive(Debug, Clone)]
struct Arrival {
    at: u64,
    frame: Frame,
}

/// One frame of a plan: its sender (0 is the CCU), the time since the sender's last frame, the time on the way, and
/// by how much the sender's clock is behind; in steps of 5 ms, so that many frames meet at one tick.
type Planned = (u8, u64, u64, u64);

const STEP: u64 = 5 * MILLISECOND;

/// A plan's frames as they arrive, each sender's in its order. An answer names the latest command that arrived
/// before it, if that command's tick is not later (`sane`) or in any case.
fn arrivals(plan: &[Planned], sane: bool) -> Vec<Arrival> {
    let mut senders: BTreeMap<u8, (u64, u64, u64)> = BTreeMap::new();
    let mut sent: Vec<(u64, u8, u64, u64)> = plan
        .iter()
        .map(|&(sender, step, delay, behind)| {
            let (sent, arrived, sequence) = senders.get(&sender).copied().unwrap_or_default();
            let sent = sent + step * STEP;
            let arrived = arrived.max(sent + delay * STEP);
            senders.insert(sender, (sent, arrived, sequence + 1));
            (arrived, sender, sent.saturating_sub(behind * STEP), sequence)
        })
        .collect();
    sent.sort_by_key(|&(arrived, ..)| arrived);
    let mut last_command: Option<(u64, u64)> = None;
    sent.into_iter()
        .map(|(at, sender, tick, sequence)| {
            let frame = if sender == 0 {
                last_command = Some((sequence, tick));
                command(sequence, tick, &[0, 5])
            } else {
                let about = last_command
                    .filter(|&(_, commanded)| !sane || commanded <= tick)
                    .map_or(HEARTBEAT, |(command, _)| About::Command(Sequence(command), Ok(())));
                answer(sender, sequence, tick, about)
            };
            Arrival { at, frame }
        })
        .collect()
}

fn log(arrivals: &[Arrival]) -> (LogSummary, Vec<Frame>, Vec<WallTime>, Vec<Message>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    for Arrival { at, frame } in arrivals {
        assert_eq!(writer.record(lane(frame), &frame.encode(), Tick(*at)), None);
        writer.advance(Tick(*at)).expect("the disk has room");
    }
    let summary = writer.finish().expect("the disk has room");
    let (frames, times) =
        read(&path).0.into_iter().map(|logged| (logged.frame.expect("a frame"), logged.log_time)).unzip();
    // The moments of `/joint_states` are the axes' own.
    let mut messages = messages(&path);
    messages.retain(|message| message.topic != "/joint_states");
    (summary, frames, times, messages)
}

fn plan(longest_delay: u64, slowest_clock: u64) -> impl Strategy<Value = Vec<Planned>> {
    prop::collection::vec((0..8u8, 0..6u64, 0..=longest_delay, 0..=slowest_clock), 1..120)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Within the hold-back the file is in the order of the ticks, by arrival within a tick, and says each tick's time.
    #[test]
    fn delays_within_the_hold_back_leave_no_trace(plan in plan(4, 0)) {
        let arrivals = arrivals(&plan, true);
        let (_, frames, times, messages) = log(&arrivals);
        let mut expected: Vec<Frame> = arrivals.iter().map(|arrival| arrival.frame.clone()).collect();
        expected.sort_by_key(|frame| frame.tick);
        prop_assert_eq!(&frames, &expected);
        for (frame, time) in frames.iter().zip(&times) {
            prop_assert_eq!(time.0, EPOCH.0 + frame.tick.0 * 500);
        }
        prop_assert!(messages.iter().all(|message| message.log_time == message.publish_time));
    }

    /// Whatever the delays and clocks: no frame is lost or doubled, times never fall, senders keep their order, and
    /// an answer stands after its command.
    #[test]
    fn stragglers_are_kept_and_in_order(plan in plan(40, 10)) {
        let arrivals = arrivals(&plan, false);
        let (summary, frames, times, messages) = log(&arrivals);
        prop_assert_eq!(summary.frames, arrivals.len() as u64);
        prop_assert_eq!(frames.len(), arrivals.len());
        prop_assert!(times.is_sorted());
        prop_assert!(messages.is_sorted_by_key(|message| message.log_time));
        prop_assert_eq!(messages.len(), 2 * arrivals.len());

        let mut next: BTreeMap<Sender, u64> = BTreeMap::new();
        for frame in &frames {
            let next = next.entry(frame.sender).or_default();
            prop_assert_eq!(frame.sequence, Sequence(*next), "sender {}", frame.sender);
            *next += 1;
        }
        let mut commanded = None;
        for frame in &frames {
            match &frame.body {
                Body::Command(_) | Body::Fault(..) => commanded = Some(frame.sequence),
                Body::Answer(Answer { about: About::Command(sequence, _), .. }) => {
                    prop_assert!(commanded.is_some_and(|last| *sequence <= last), "{:?}", frame);
                }
                Body::Answer(_) => {}
            }
        }
    }
}

#[test]
fn a_frame_from_the_future_holds_nothing_up() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    writer.record(Lane::Answers, &answer(1, 0, u64::MAX, HEARTBEAT).encode(), Tick(0));
    writer.record(
        Lane::Answers,
        &answer(2, 0, 100 * MILLISECOND, HEARTBEAT).encode(),
        Tick(100 * MILLISECOND),
    );
    writer.advance(Tick(100 * MILLISECOND)).expect("the disk has room");
    let (logged, _) = read(&path);
    assert_eq!(logged.len(), 1, "the second is still held back");
    assert_eq!(logged[0].log_time, WallTime(EPOCH.0 + 20_000_000), "as late as clocks may disagree");
    writer.finish().expect("the disk has room");
    assert_eq!(read(&path).0.len(), 2);
}

#[test]
fn a_straggler_gets_the_last_written_time_and_keeps_its_own() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut writer = writer(&path);
    let late = 50 * MILLISECOND;
    writer.record(Lane::Answers, &answer(1, 0, 10, HEARTBEAT).encode(), Tick(10));
    writer.advance(Tick(late)).expect("the disk has room");
    writer.record(Lane::Answers, &answer(2, 0, 4, HEARTBEAT).encode(), Tick(late));
    writer.finish().expect("the disk has room");
    let messages = messages(&path);
    let raw = on(&messages, "/microbus");
    assert_eq!((raw[1].log_time, raw[1].publish_time), (EPOCH.0 + 5_000, EPOCH.0 + 2_000));
    assert_eq!(raw[0].log_time, raw[1].log_time);
}
