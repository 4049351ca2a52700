//! Strangers on the bus: a process of the same user that is no part of the set joins its services and says what it likes.
//! It is named, nobody believes it, and nothing is held up. The stranger is this test's own process.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use serde_json::Value;
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{Bus, Tap, Transmit, Wake};
use supersigma_protocol::{About, Address, Body, Frame, Occasion, Position, Report, Sender, Sequence};
use supersigma_tests::{Cell, eventually, patient};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
/// Where a stranger says that an axis stands: beyond every rail, so that no axis is sampled there on its way.
const LIE: i32 = 123_456;

/// A set without axis 7, so that one place to speak is nobody's.
fn with_a_free_place() -> Cell {
    let cell = Cell::new(EXE);
    let text = patient();
    let (axes, rest) = text.split_once("[[axis]]\naddress = 7").expect("axis 7");
    let (_, rest) = rest.split_once("# --- The digital cards").expect("the digital cards");
    fs::write(cell.config(), format!("{axes}#{rest}")).expect("a configuration");
    cell
}

fn join(cell: &Cell) -> SharedBus {
    SharedBus::join(&Place::new(cell.runtime()).expect("short enough")).expect("the user may")
}

/// This process, as it must be named.
fn own_name() -> String {
    let command = fs::read_to_string("/proc/self/comm").expect("Linux has /proc");
    format!("process {} ({})", std::process::id(), command.trim_end())
}

/// What a card said last, changed: it says that it stands somewhere else, and that it is well.
fn lie(bus: &SharedBus, card: Address) -> Frame {
    let mut tap = bus.tap().expect("room for a tap");
    eventually("a frame of the card", || {
        let mut last = None;
        let mut note = |_, _, bytes: &[u8]| {
            let frame = Frame::decode(bytes).expect("a frame");
            if frame.sender == Sender::Card(card) {
                last = Some(frame);
            }
        };
        tap.drain(&mut note).expect("the bus");
        let mut frame = last?;
        let Body::Answer(answer) = &mut frame.body else { return None };
        let Report::Axis(report) = &mut answer.report else { return None };
        answer.about = About::Unasked(Occasion::Changed);
        report.position = Some(Position(LIE));
        // A gap, if anybody counted it.
        frame.sequence = Sequence(frame.sequence.0 + 1_000);
        Some(frame)
    })
}

/// The messages of `/events` in a log.
fn events(log: &Path) -> Vec<String> {
    let bytes = fs::read(log).expect("a log");
    let messages =
        mcap::MessageStream::new(&bytes).expect("an MCAP file").map(|message| message.expect("whole"));
    let events = messages.filter(|message| message.channel.topic == "/events");
    let text = |data: &[u8]| serde_json::from_slice::<Value>(data).expect("JSON")["message"].take();
    events.map(|message| text(&message.data).as_str().expect("a text").to_owned()).collect()
}

#[test]
fn a_stranger_that_floods_and_lies_is_named_and_changes_nothing() {
    let cell = with_a_free_place();
    let up = cell.up("2");
    cell.ccu("origin left_x left_z").done();
    let bus = join(&cell);
    let (mut stranger, _hears) = bus.card(Address(7)).expect("a place is free");
    let lie = lie(&bus, Address(3)).encode();
    let (over, sent) = (AtomicBool::new(false), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            let garbage = [0xA5; supersigma_protocol::MAX_FRAME_BYTES];
            let mut length = 0;
            while !over.load(Ordering::Acquire) {
                stranger.send(&garbage[..length % garbage.len()], Wake::Everyone).expect("it may");
                stranger.send(&lie, Wake::Everyone).expect("it may");
                length += 1;
                sent.store(true, Ordering::Release);
            }
        });
        eventually("the first words of the stranger", || sent.load(Ordering::Acquire).then_some(()));
        cell.ccu("move left_x 15000").done();
        cell.ccu("line left_x=3000 left_z=2000").done();
        assert_eq!(cell.axis("left_z")["position"], 2_000);
        cell.ccu("move left_z -700").done();
        over.store(true, Ordering::Release);
    });
    assert_eq!(cell.axis("left_x")["position"], 18_000);
    assert_eq!(cell.axis("left_z")["position"], 1_300);
    assert_eq!(cell.axis("left_z")["alarm"], Value::Null);
    let stranger_is_told = || {
        let messages = fs::read_to_string(cell.runtime().with_extension("messages")).unwrap_or_default();
        messages.contains(&own_name()).then_some(())
    };
    eventually("the stranger's name", stranger_is_told);
    drop((stranger, bus));

    // `down` compares what was sent with what was logged.
    let said = cell.down().expect("it is worth a word");
    let about_it: Vec<&str> = said.lines().filter(|line| line.contains(&own_name())).collect();
    // It is told of again every ten seconds, with thousands of frames between.
    assert!((1..20).contains(&about_it.len()), "{said}");
    assert!(about_it[0].contains("is no part of the set"), "{said}");
    assert!(!said.contains("frames were lost") && !said.contains("missing"), "{said}");
    assert!(events(&up.log).iter().any(|event| event.contains(&own_name())));
    let info = cell.ccu(&format!("log info --json {}", up.log.display())).good().json().remove(0);
    assert_eq!(info["frames"]["undecodable"], 0, "{info}");
    assert_eq!(info["gaps"].as_array().map(Vec::len), Some(0), "{info}");
    let frames = cell.frames(&up.log);
    assert!(frames.iter().all(|frame| frame["position"] != LIE));
}

#[test]
fn in_a_whole_set_nobody_else_can_speak() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    cell.ccu("origin wrist").done();
    let bus = join(&cell);
    let error = bus.ccu().expect_err("there is one CCU").to_string();
    assert!(error.ends_with(&format!("every place is taken, by process {}", up.pid)), "{error}");
    let error = bus.card(Address(7)).expect_err("each card is played once").to_string();
    let player = format!("process {}", cell.worker(7).pid);
    assert!(error.contains("every place is taken, by ") && error.contains(&player), "{error}");
    // Whoever only listens is no trouble, even if it never reads.
    let _tap = bus.tap().expect("room for a tap");
    cell.ccu("move wrist 100").done();
    // A card that is killed finds its place again.
    cell.worker(7).signal(supersigma_tests::Signal::KILL);
    cell.until("wrist", "is back", |axis| axis["activity"] == "standing" && axis["position"].is_null());
    cell.ccu("clear").done();
    cell.ccu("origin wrist").done();
    cell.ccu("move wrist 200").done();
    assert_eq!(cell.axis("wrist")["position"], 200);
    assert!(cell.down().is_some(), "a worker has ended");
}
