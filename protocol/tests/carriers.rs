//! What every carrier of the bus must do, each test run over both of them.

use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use supersigma_protocol::bus::in_process::InProcessBus;
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{
    BUFFER_FRAMES, Bus, BusError, Lane, Origin, Receive, Received, Tap, Transmit, Wake,
};
use supersigma_protocol::{Address, MAX_FRAME_BYTES};
use tempfile::TempDir;

/// Long enough for the slowest machine; only a failing test waits so long.
const GENEROUS: Duration = Duration::from_secs(60);
/// How long a line that must stay quiet is watched.
const QUIET: Duration = Duration::from_millis(20);

macro_rules! over_both_carriers {
    ($($test:ident),+ $(,)?) => {
        mod in_process {
            $(#[test] fn $test() { super::$test(&super::InProcessBus::new()); })+
        }
        mod shared_memory {
            $(#[test] fn $test() { super::with_shared_bus(super::$test); })+
        }
    };
}

over_both_carriers! {
    commands_reach_every_card_in_order,
    answers_of_one_card_keep_their_order,
    only_the_card_concerned_wakes,
    both_digital_cards_share_one_line,
    answer_ready_wakes_the_ccu_alone,
    a_waiting_card_is_woken_by_a_command,
    a_waiting_port_is_woken_by_another_thread,
    a_slow_reader_loses_frames_and_blocks_nobody,
    a_tap_hears_a_command_before_its_answer,
    a_dropped_reader_is_forgotten,
    a_port_hears_nothing_from_before_its_time,
    a_frame_of_any_permitted_length_passes_and_a_longer_one_is_refused,
    a_port_needs_the_address_of_one_card,
}

fn with_shared_bus(test: fn(&SharedBus)) {
    let root = TempDir::new().unwrap();
    let swept = Swept(Place::new(root.path()).unwrap());
    test(&SharedBus::create(&swept.0).unwrap());
}

/// Leaves nothing in the machine's shared memory, even when the test fails.
struct Swept(Place);

impl Drop for Swept {
    fn drop(&mut self) {
        SharedBus::sweep(&self.0).unwrap();
    }
}

fn commands_reach_every_card_in_order(bus: &impl Bus) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let mut cards: Vec<_> = (1..=8).map(|address| bus.card(Address(address)).unwrap().1).collect();
    for number in 0..1_000 {
        ccu.send(&frame(number), Wake::Nobody).unwrap();
    }
    for card in &mut cards {
        assert_eq!(numbers(card), (0..1_000).collect::<Vec<_>>());
    }
}

fn answers_of_one_card_keep_their_order(bus: &impl Bus<Transmit: 'static>) {
    let (_commands, mut ccu) = bus.ccu().unwrap();
    let sending: Vec<_> = (1_u32..=8)
        .map(|card| {
            let (mut answers, _commands) = bus.card(Address(card.try_into().unwrap())).unwrap();
            thread::spawn(move || {
                for number in 0..400 {
                    answers.send(&frame(card * 1_000 + number), Wake::Everyone).unwrap();
                }
                // A port that goes takes with it what nobody has read yet, so it stays until the CCU has.
                answers
            })
        })
        .collect();
    let _ports: Vec<_> = sending.into_iter().map(|thread| thread.join().unwrap()).collect();
    let heard = numbers(&mut ccu);
    assert_eq!(heard.len(), 8 * 400);
    for card in 1..=8 {
        let of_card = heard.iter().copied().filter(|number| number / 1_000 == card);
        assert!(of_card.eq(card * 1_000..card * 1_000 + 400), "card {card}");
    }
}

fn only_the_card_concerned_wakes(bus: &impl Bus) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let mut cards: Vec<_> = (1..=8).map(|address| (address, bus.card(Address(address)).unwrap().1)).collect();
    let mut wakes = |wake, expected: &[u8]| {
        ccu.send(&frame(0), wake).unwrap();
        for (address, card) in &mut cards {
            assert!(is_woken(card, expected.contains(address)), "card {address} by {wake:?}");
        }
    };
    wakes(Wake::Card(Address(3)), &[3]);
    wakes(Wake::Nobody, &[]);
    wakes(Wake::Everyone, &[1, 2, 3, 4, 5, 6, 7, 8]);
    wakes(Wake::Card(Address::EVERYONE), &[1, 2, 3, 4, 5, 6, 7]);
    wakes(Wake::Card(Address(200)), &[]);
}

fn both_digital_cards_share_one_line(bus: &impl Bus) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let (_answers_of_it, mut digital) = bus.card(Address::DIGITAL_INPUT).unwrap();
    ccu.send(&frame(0), Wake::Card(Address::DIGITAL_OUTPUT)).unwrap();
    assert!(is_woken(&mut digital, true));
    assert!(is_woken(&mut digital, false), "waiting lowers the line");
    ccu.send(&frame(1), Wake::Card(Address::DIGITAL_INPUT)).unwrap();
    assert!(is_woken(&mut digital, true));
}

fn answer_ready_wakes_the_ccu_alone(bus: &impl Bus) {
    let (_commands, mut ccu) = bus.ccu().unwrap();
    let (mut three, mut hears_three) = bus.card(Address(3)).unwrap();
    let (_four, mut hears_four) = bus.card(Address(4)).unwrap();
    three.send(&frame(1), Wake::Everyone).unwrap();
    assert!(is_woken(&mut ccu, true));
    assert!(is_woken(&mut hears_three, false) && is_woken(&mut hears_four, false));
    three.send(&frame(2), Wake::Nobody).unwrap();
    assert!(is_woken(&mut ccu, false));
    assert_eq!(numbers(&mut ccu), [1, 2]);
}

fn a_waiting_card_is_woken_by_a_command(bus: &impl Bus<Receive: 'static>) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let (_answers_of_it, mut card) = bus.card(Address(5)).unwrap();
    let (about_to_wait, waiting) = mpsc::channel();
    let woken = thread::spawn(move || {
        about_to_wait.send(()).unwrap();
        next(&mut card)
    });
    waiting.recv_timeout(GENEROUS).unwrap();
    ccu.send(&frame(17), Wake::Card(Address(5))).unwrap();
    assert_eq!(woken.join().unwrap(), 17);
}

fn a_waiting_port_is_woken_by_another_thread(bus: &impl Bus<Receive: 'static>) {
    let (_commands, mut ccu) = bus.ccu().unwrap();
    let waker = ccu.waker();
    let woken = thread::spawn(move || {
        let begun = Instant::now();
        ccu.wait(GENEROUS).unwrap();
        begun.elapsed()
    });
    waker.wake();
    assert!(woken.join().unwrap() < GENEROUS / 2);
    waker.wake();
}

fn a_slow_reader_loses_frames_and_blocks_nobody(bus: &impl Bus) {
    let buffer = u32::try_from(BUFFER_FRAMES).unwrap();
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let (_answers_of_slow, mut slow) = bus.card(Address(1)).unwrap();
    let (_answers_of_quick, mut quick) = bus.card(Address(2)).unwrap();
    let mut tap = bus.tap().unwrap();
    let mut seen_by_quick = Vec::new();
    for number in 0..3 * buffer {
        ccu.send(&frame(number), Wake::Everyone).unwrap();
        if number % 1_000 == 0 {
            seen_by_quick.extend(numbers(&mut quick));
        }
    }
    seen_by_quick.extend(numbers(&mut quick));
    assert_eq!(seen_by_quick, (0..3 * buffer).collect::<Vec<_>>());
    assert_eq!(numbers(&mut slow), (0..buffer).collect::<Vec<_>>());
    assert_eq!(drained(&mut tap).len(), BUFFER_FRAMES);

    ccu.send(&frame(3 * buffer), Wake::Everyone).unwrap();
    assert_eq!(numbers(&mut slow), [3 * buffer], "a reader that has caught up hears again");
    assert_eq!(drained(&mut tap), [(Lane::Commands, 3 * buffer)]);
}

/// A card that answers as fast as it can, and a tap that looks at every moment: no answer may overtake its command.
fn a_tap_hears_a_command_before_its_answer(bus: &impl Bus<Transmit: 'static, Receive: 'static>) {
    // Fewer than the tap's buffer holds: none is lost even if the tap gets no turn at all.
    const ROUNDS: u32 = 4_000;
    let (mut ccu, mut answers) = bus.ccu().unwrap();
    let (mut card, mut commands) = bus.card(Address(1)).unwrap();
    let mut tap = bus.tap().unwrap();
    let answering = thread::spawn(move || {
        for _ in 0..ROUNDS {
            let number = polled(&mut commands);
            card.send(&frame(number), Wake::Nobody).unwrap();
        }
        card
    });
    let asking = thread::spawn(move || {
        for number in 0..ROUNDS {
            ccu.send(&frame(number), Wake::Nobody).unwrap();
            assert_eq!(polled(&mut answers), number);
        }
        ccu
    });
    let deadline = Instant::now() + GENEROUS;
    let mut seen = Vec::new();
    while seen.len() < 2 * ROUNDS as usize {
        assert!(Instant::now() < deadline, "{} frames seen", seen.len());
        seen.extend(drained(&mut tap));
        thread::yield_now();
    }
    let (mut commands, mut answers) = (0, 0);
    for (lane, number) in seen {
        match lane {
            Lane::Commands => {
                assert_eq!(number, commands);
                commands += 1;
            }
            Lane::Answers => {
                assert_eq!(number, answers);
                answers += 1;
                assert!(answers <= commands, "answer {number} overtook its command");
            }
        }
    }
    assert_eq!((commands, answers), (ROUNDS, ROUNDS));
    let _ports = (answering.join().unwrap(), asking.join().unwrap());
}

fn a_dropped_reader_is_forgotten(bus: &impl Bus) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    for _ in 0..50 {
        let (_answers_of_it, mut card) = bus.card(Address(1)).unwrap();
        let mut tap = bus.tap().unwrap();
        ccu.send(&frame(1), Wake::Card(Address(1))).unwrap();
        assert_eq!(numbers(&mut card), [1]);
        assert_eq!(drained(&mut tap), [(Lane::Commands, 1)]);
    }
    ccu.send(&frame(2), Wake::Everyone).unwrap();
}

fn a_port_hears_nothing_from_before_its_time(bus: &impl Bus) {
    let (mut ccu, mut answers) = bus.ccu().unwrap();
    let (mut card, mut commands) = bus.card(Address(7)).unwrap();
    ccu.send(&frame(1), Wake::Everyone).unwrap();
    card.send(&frame(2), Wake::Everyone).unwrap();
    let mut tap = bus.tap().unwrap();
    let (_answers_of_late, mut late) = bus.card(Address(6)).unwrap();
    assert!(numbers(&mut late).is_empty() && drained(&mut tap).is_empty());
    assert_eq!((numbers(&mut commands), numbers(&mut answers)), (vec![1], vec![2]));
}

fn a_frame_of_any_permitted_length_passes_and_a_longer_one_is_refused(bus: &impl Bus) {
    let (mut ccu, _answers) = bus.ccu().unwrap();
    let (_answers_of_it, mut card) = bus.card(Address(1)).unwrap();
    for length in 0..=MAX_FRAME_BYTES {
        let bytes: Vec<u8> = (0..=u8::MAX).cycle().skip(length).take(length).collect();
        ccu.send(&bytes, Wake::Nobody).unwrap();
        assert_eq!(card.receive().unwrap(), Some(Received { origin: Origin::own(), bytes }));
    }
    let error = ccu.send(&[0; MAX_FRAME_BYTES + 1], Wake::Everyone).unwrap_err();
    assert!(matches!(error, BusError::TooLong { bytes: 129 }));
    assert_eq!(error.to_string(), "129 bytes are too many for a frame (at most 128)");
    assert_eq!(card.receive().unwrap(), None);
}

fn a_port_needs_the_address_of_one_card(bus: &impl Bus) {
    for (address, name) in [(0, "everyone"), (10, "address 10"), (255, "address 255")] {
        let error = bus.card(Address(address)).err().expect("no such card").to_string();
        assert_eq!(error, format!("cannot make a card's port: {name} is not one card; cards are 1 to 9"));
    }
    assert!(bus.card(Address(9)).is_ok());
}

fn frame(number: u32) -> [u8; 4] {
    number.to_le_bytes()
}

fn number(frame: &[u8]) -> u32 {
    u32::from_le_bytes(frame.try_into().expect("a frame of these tests has four bytes"))
}

/// Everything that is here now.
fn numbers(port: &mut impl Receive) -> Vec<u32> {
    std::iter::from_fn(|| port.receive().unwrap()).map(|frame| number(&frame.bytes)).collect()
}

/// The next frame, slept for if need be.
fn next(port: &mut impl Receive) -> u32 {
    let deadline = Instant::now() + GENEROUS;
    loop {
        if let Some(frame) = port.receive().unwrap() {
            return number(&frame.bytes);
        }
        assert!(Instant::now() < deadline, "nothing came");
        port.wait(GENEROUS).unwrap();
    }
}

/// The next frame, without the wake-up that would give the others time.
fn polled(port: &mut impl Receive) -> u32 {
    let deadline = Instant::now() + GENEROUS;
    loop {
        if let Some(frame) = port.receive().unwrap() {
            return number(&frame.bytes);
        }
        assert!(Instant::now() < deadline, "nothing came");
        thread::yield_now();
    }
}

fn drained(tap: &mut impl Tap) -> Vec<(Lane, u32)> {
    let mut seen = Vec::new();
    let count = tap.drain(&mut |lane, origin, frame| {
        assert_eq!(origin, Origin::own());
        seen.push((lane, number(frame)));
    });
    let count = count.unwrap();
    assert_eq!(count, seen.len());
    seen
}

/// Whether waiting ends at once (`expected`), or only when its time is over. Lowers the line.
fn is_woken(port: &mut impl Receive, expected: bool) -> bool {
    let limit = if expected { GENEROUS } else { QUIET };
    let begun = Instant::now();
    port.wait(limit).unwrap();
    let ended_early = begun.elapsed() < limit;
    ended_early == expected
}
