//! Golden traces from the data sheet's timing diagrams, the card's two step counters, and the model against the oracle.

use core::fmt::Write as _;
use core::num::NonZeroU64;

use proptest::prelude::*;
use supersigma_protocol::Count;

use super::oracle::Oracle;
use super::{CounterId, Edges, Mode, Pit8253};

use CounterId::{One, Two, Zero};

/// The counting element and the level of OUT after each of `pulses` CLK pulses: `3H 2H 1L`.
fn trace(pit: &mut Pit8253, pulses: u32) -> String {
    let mut text = String::new();
    for _ in 0..pulses {
        pit.clock(Zero, 1);
        let level = if pit.output(Zero) { 'H' } else { 'L' };
        let separator = if text.is_empty() { "" } else { " " };
        write!(text, "{separator}{}{level}", pit.latch_and_read(Zero)).unwrap();
    }
    text
}

/// Counter 0 in a mode, with one-byte counts and a first count, as the data sheet's diagrams have it.
fn with_lsb(mode: u8, count: u8) -> Pit8253 {
    let mut pit = Pit8253::new();
    pit.write_control(0x10 | mode << 1);
    pit.write(Zero, count);
    pit
}

fn nth(n: u64) -> NonZeroU64 {
    NonZeroU64::new(n).unwrap()
}

#[test]
fn mode_0_is_high_after_n_plus_1_pulses_and_counts_on() {
    let mut pit = with_lsb(0, 4);
    assert!(!pit.output(Zero));
    assert_eq!(trace(&mut pit, 7), "4L 3L 2L 1L 0H 255H 254H");
    // A new count pulls OUT low without a pulse.
    pit.write(Zero, 2);
    assert!(!pit.output(Zero));
    assert_eq!(trace(&mut pit, 3), "2L 1L 0H");
}

#[test]
fn mode_0_is_suspended_by_a_low_gate_but_still_loads() {
    let mut pit = with_lsb(0, 3);
    assert_eq!(trace(&mut pit, 2), "3L 2L");
    pit.set_gate(Zero, false);
    assert_eq!(trace(&mut pit, 2), "2L 2L");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 3), "1L 0H 255H");

    pit.set_gate(Zero, false);
    pit.write(Zero, 2);
    assert_eq!(trace(&mut pit, 2), "2L 2L");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 2), "1L 0H");
}

#[test]
fn mode_0_stops_at_the_first_of_two_bytes() {
    let mut pit = Pit8253::new();
    pit.program(Zero, Mode::InterruptOnTerminalCount, Count(2));
    assert_eq!(trace(&mut pit, 3), "2L 1L 0H");
    pit.write(Zero, 3);
    assert!(!pit.output(Zero));
    assert_eq!(trace(&mut pit, 2), "0L 0L");
    pit.write(Zero, 0);
    assert_eq!(trace(&mut pit, 4), "3L 2L 1L 0H");
}

#[test]
fn mode_1_is_low_for_n_pulses_from_the_pulse_after_the_trigger() {
    let mut pit = with_lsb(1, 3);
    pit.set_gate(Zero, false);
    assert_eq!(trace(&mut pit, 2), "0H 0H");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 5), "3L 2L 1L 0H 255H");
    // The trigger can come again, and the level of the gate does not matter.
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    pit.set_gate(Zero, false);
    assert_eq!(trace(&mut pit, 2), "3L 2L");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 4), "3L 2L 1L 0H");
}

#[test]
fn mode_1_takes_a_new_count_with_the_next_trigger_and_ignores_triggers_before_any() {
    let mut pit = Pit8253::new();
    pit.write_control(0x12);
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    pit.write(Zero, 2);
    assert_eq!(trace(&mut pit, 2), "0H 0H");
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 1), "2L");
    pit.write(Zero, 4);
    assert_eq!(trace(&mut pit, 3), "1L 0H 255H");
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 5), "4L 3L 2L 1L 0H");
}

#[test]
fn mode_2_is_low_on_every_nth_pulse() {
    let mut pit = with_lsb(2, 3);
    assert!(pit.output(Zero));
    assert_eq!(trace(&mut pit, 10), "3H 2H 1L 3H 2H 1L 3H 2H 1L 3H");
}

#[test]
fn mode_2_takes_a_new_count_at_the_end_of_the_period() {
    let mut pit = with_lsb(2, 4);
    assert_eq!(trace(&mut pit, 2), "4H 3H");
    pit.write(Zero, 5);
    assert_eq!(trace(&mut pit, 8), "2H 1L 5H 4H 3H 2H 1L 5H");
    // Half a count is none.
    pit.program(Zero, Mode::RateGenerator, Count(2));
    pit.write(Zero, 7);
    assert_eq!(trace(&mut pit, 4), "2H 1L 2H 1L");
    pit.write(Zero, 0);
    assert_eq!(trace(&mut pit, 7), "7H 6H 5H 4H 3H 2H 1L");
}

#[test]
fn mode_2_gate_raises_out_at_once_and_starts_the_period_anew() {
    let mut pit = with_lsb(2, 3);
    assert_eq!(trace(&mut pit, 3), "3H 2H 1L");
    pit.set_gate(Zero, false);
    assert!(pit.output(Zero));
    assert_eq!(trace(&mut pit, 2), "1H 1H");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 2), "3H 2H");
    // A trigger also brings a new count forward.
    pit.write(Zero, 4);
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 5), "4H 3H 2H 1L 4H");
}

#[test]
fn mode_3_halves_even_counts() {
    let mut pit = with_lsb(3, 4);
    assert_eq!(trace(&mut pit, 9), "4H 2H 4L 2L 4H 2H 4L 2L 4H");
}

#[test]
fn mode_3_counts_odd_counts_by_one_and_three_first() {
    let mut pit = with_lsb(3, 5);
    assert_eq!(trace(&mut pit, 11), "5H 4H 2H 5L 2L 5H 4H 2H 5L 2L 5H");
    let mut pit = with_lsb(3, 3);
    assert_eq!(trace(&mut pit, 7), "3H 2H 3L 3H 2H 3L 3H");
}

#[test]
fn mode_3_takes_a_new_count_at_the_end_of_the_half_period() {
    let mut pit = with_lsb(3, 4);
    assert_eq!(trace(&mut pit, 1), "4H");
    pit.write(Zero, 6);
    assert_eq!(trace(&mut pit, 7), "2H 6L 4L 2L 6H 4H 2H");
}

#[test]
fn mode_3_gate_raises_out_at_once_and_starts_the_period_anew() {
    let mut pit = with_lsb(3, 4);
    assert_eq!(trace(&mut pit, 3), "4H 2H 4L");
    pit.set_gate(Zero, false);
    assert!(pit.output(Zero));
    assert_eq!(trace(&mut pit, 2), "4H 4H");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 5), "4H 2H 4L 2L 4H");
}

#[test]
fn a_count_of_1_keeps_out_high_in_modes_2_and_3() {
    for mode in [2, 3] {
        let mut pit = with_lsb(mode, 1);
        assert_eq!(trace(&mut pit, 3), "1H 1H 1H");
        assert_eq!(pit.clock(Zero, 1 << 40), Edges::default());
        assert_eq!(pit.clocks_until_falling(Zero, nth(1)), None);
        // The period under way ends as it would have.
        let mut pit = with_lsb(mode, 2);
        pit.clock(Zero, 2);
        assert!(!pit.output(Zero));
        pit.write(Zero, 1);
        assert_eq!(pit.clock(Zero, 9), Edges { falling: 0, rising: 1 });
    }
}

#[test]
fn mode_4_strobes_n_plus_1_pulses_after_the_write() {
    let mut pit = with_lsb(4, 3);
    assert_eq!(trace(&mut pit, 6), "3H 2H 1H 0L 255H 254H");
    let mut pit = with_lsb(4, 3);
    pit.set_gate(Zero, false);
    assert_eq!(trace(&mut pit, 3), "3H 3H 3H");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 4), "2H 1H 0L 255H");
    let mut pit = with_lsb(4, 3);
    assert_eq!(trace(&mut pit, 3), "3H 2H 1H");
    pit.write(Zero, 2);
    assert_eq!(trace(&mut pit, 4), "2H 1H 0L 255H");
}

#[test]
fn mode_5_strobes_n_plus_1_pulses_after_the_trigger() {
    let mut pit = with_lsb(5, 3);
    pit.set_gate(Zero, false);
    assert_eq!(trace(&mut pit, 2), "0H 0H");
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 5), "3H 2H 1H 0L 255H");
    pit.write(Zero, 5);
    assert_eq!(trace(&mut pit, 1), "254H");
    pit.set_gate(Zero, false);
    pit.set_gate(Zero, true);
    assert_eq!(trace(&mut pit, 7), "5H 4H 3H 2H 1H 0L 255H");
}

#[test]
fn a_count_of_zero_is_the_longest() {
    let mut pit = Pit8253::new();
    pit.program(Zero, Mode::RateGenerator, Count(0));
    assert_eq!(pit.clocks_until_falling(Zero, nth(1)), Some(65_536));
    assert_eq!(pit.clocks_until_falling(Zero, nth(3)), Some(3 * 65_536));
    pit.write_control(0x35);
    pit.load(Zero, Count(0));
    assert_eq!(pit.clocks_until_falling(Zero, nth(1)), Some(10_000));
    assert_eq!(pit.clock(Zero, 2), Edges::default());
    assert_eq!(pit.latch_and_read(Zero), 0x9999);
}

#[test]
fn bcd_counts_in_digits_and_wraps_at_9999() {
    let mut pit = Pit8253::new();
    pit.write_control(0x31);
    pit.load(Zero, Count(0x1000));
    pit.clock(Zero, 2);
    assert_eq!(pit.latch_and_read(Zero), 0x0999);
    assert_eq!(pit.clock(Zero, 999), Edges { falling: 0, rising: 1 });
    assert_eq!(pit.latch_and_read(Zero), 0x0000);
    pit.clock(Zero, 1);
    assert_eq!(pit.latch_and_read(Zero), 0x9999);
}

#[test]
fn a_latch_holds_until_it_is_read_out_or_a_control_word_comes() {
    let mut pit = Pit8253::new();
    pit.program(Zero, Mode::RateGenerator, Count(0x1234));
    pit.clock(Zero, 1);
    pit.write_control(0x00);
    pit.clock(Zero, 0x35);
    // The second latch command is ignored.
    pit.write_control(0x00);
    assert_eq!(pit.read(Zero), 0x34);
    pit.clock(Zero, 1);
    assert_eq!(pit.read(Zero), 0x12);
    // Without a latch the bytes are those of the moment.
    assert_eq!(pit.read(Zero), 0xFE);
    assert_eq!(pit.read(Zero), 0x11);

    pit.write_control(0x00);
    pit.write_control(0x34);
    pit.load(Zero, Count(7));
    pit.clock(Zero, 1);
    assert_eq!(pit.read(Zero), 7);
}

#[test]
fn a_control_word_forgets_a_half_written_count() {
    let mut pit = Pit8253::new();
    pit.write_control(0x34);
    pit.write(Zero, 9);
    pit.write_control(0x34);
    pit.write(Zero, 3);
    pit.write(Zero, 0);
    assert_eq!(trace(&mut pit, 4), "3H 2H 1L 3H");
}

#[test]
fn the_read_back_command_of_the_8254_does_nothing() {
    let mut pit = Pit8253::new();
    pit.program(Two, Mode::SquareWave, Count(9));
    pit.clock(Two, 4);
    let before = pit.clone();
    for word in 0xC0..=0xFF {
        pit.write_control(word);
    }
    assert_eq!(pit, before);
}

/// The chip's rule behind the two step counters of the card.
#[test]
fn counter_1_is_blind_to_the_first_step() {
    let mut pit = Pit8253::new();
    pit.program(Zero, Mode::RateGenerator, Count(10));
    pit.program(One, Mode::RateGenerator, Count(500));
    assert_eq!(pit.clock_card(101), 10);
    assert_eq!(pit.latch_and_read(One), 491);

    // The next movement: the counter is set up anew, and shows the last one until the first step has been made.
    pit.program(Zero, Mode::RateGenerator, Count(10));
    pit.program(One, Mode::RateGenerator, Count(2));
    assert_eq!(pit.clock_card(9), 0);
    assert_eq!(pit.latch_and_read(One), 491);
    assert_eq!(pit.clock_card(1), 1);
    assert_eq!(pit.latch_and_read(One), 2);
    assert_eq!(pit.clock_card(10), 1);
    assert_eq!(pit.latch_and_read(One), 1);

    // And it cannot be told to stop after one step: OUT1 never moves.
    pit.program(One, Mode::RateGenerator, Count(1));
    assert_eq!(pit.clock_card(1_000), 100);
    assert_eq!(pit.clocks_until_falling(One, nth(1)), None);
    assert!(pit.output(One));
}

#[test]
fn counter_2_tells_one_step_from_two() {
    let mut pit = Pit8253::new();
    pit.program(Zero, Mode::RateGenerator, Count(3_077));
    pit.program(Two, Mode::OneShot, Count(1));
    pit.set_gate(Two, false);
    pit.set_gate(Two, true);
    assert_eq!(pit.clock_card(3_076), 0);
    assert!(pit.output(Two));
    assert_eq!(pit.clock_card(1), 1);
    assert!(!pit.output(Two));
    assert_eq!(pit.clock_card(3_076), 0);
    assert!(!pit.output(Two));
    assert_eq!(pit.clock_card(1), 1);
    assert!(pit.output(Two));
    // It stays so, however far the motor runs.
    assert_eq!(pit.clock_card(3_077 * 200_000), 200_000);
    assert!(pit.output(Two));
}

#[derive(Debug, Clone)]
enum Access {
    Control(u8),
    Write(CounterId, u8),
    Load(CounterId, u16),
    Read(CounterId),
    LatchAndRead(CounterId),
    Gate(CounterId, bool),
    Clock(CounterId, u64),
    ClockCard(u64),
}

fn counter() -> impl Strategy<Value = CounterId> {
    prop::sample::select(CounterId::ALL.to_vec())
}

fn count() -> impl Strategy<Value = u16> {
    prop_oneof![6 => 0_u16..12, 2 => any::<u16>(), 1 => 0x0FF0_u16..0x1010]
}

fn pulses() -> impl Strategy<Value = u64> {
    prop_oneof![8 => 0_u64..12, 4 => 0_u64..300, 1 => 0_u64..70_000]
}

fn access() -> impl Strategy<Value = Access> {
    prop_oneof![
        3 => any::<u8>().prop_map(Access::Control),
        3 => (counter(), prop_oneof![0_u8..6, any::<u8>()]).prop_map(|(id, byte)| Access::Write(id, byte)),
        4 => (counter(), count()).prop_map(|(id, count)| Access::Load(id, count)),
        2 => counter().prop_map(Access::Read),
        1 => counter().prop_map(Access::LatchAndRead),
        4 => (counter(), any::<bool>()).prop_map(|(id, high)| Access::Gate(id, high)),
        8 => (counter(), pulses()).prop_map(|(id, pulses)| Access::Clock(id, pulses)),
        2 => pulses().prop_map(Access::ClockCard),
    ]
}

/// Does the same to both and compares what it gives back.
fn apply(pit: &mut Pit8253, oracle: &mut Oracle, access: &Access) -> Result<(), TestCaseError> {
    match *access {
        Access::Control(word) => {
            pit.write_control(word);
            oracle.write_control(word);
        }
        Access::Write(id, byte) => {
            pit.write(id, byte);
            oracle.counter(id).write(byte);
        }
        Access::Load(id, count) => {
            pit.load(id, Count(count));
            for byte in count.to_le_bytes() {
                oracle.counter(id).write(byte);
            }
        }
        Access::Read(id) => {
            prop_assert_eq!(pit.read(id), oracle.counter(id).read());
        }
        Access::LatchAndRead(id) => {
            prop_assert_eq!(pit.latch_and_read(id), oracle.counter(id).latch_and_read());
        }
        Access::Gate(id, high) => {
            pit.set_gate(id, high);
            oracle.counter(id).set_gate(high);
        }
        Access::Clock(id, pulses) => {
            let mut expected = Edges::default();
            for _ in 0..pulses {
                let before = oracle.counter(id).out;
                oracle.counter(id).pulse();
                let after = oracle.counter(id).out;
                expected.falling += u64::from(before && !after);
                expected.rising += u64::from(!before && after);
            }
            prop_assert_eq!(pit.clock(id, pulses), expected);
        }
        Access::ClockCard(ticks) => {
            prop_assert_eq!(pit.clock_card(ticks), oracle.clock_card(ticks));
        }
    }
    for id in CounterId::ALL {
        prop_assert_eq!(pit.output(id), oracle.counter(id).out, "OUT of {:?}", id);
        let (mut shown, mut expected) = (pit.clone(), oracle.counter(id).clone());
        for _ in 0..2 {
            prop_assert_eq!(shown.read(id), expected.read(), "what {:?} shows", id);
        }
    }
    Ok(())
}

/// Compares the prediction of the first falls of OUT with what the oracle does within `limit` pulses.
fn check_prediction(pit: &Pit8253, oracle: &mut Oracle, limit: u64) -> Result<(), TestCaseError> {
    for id in CounterId::ALL {
        let counter = &mut oracle.counter(id).clone();
        let mut falls = Vec::new();
        for pulse in 1..=limit {
            let before = counter.out;
            counter.pulse();
            if before && !counter.out {
                falls.push(pulse);
            }
        }
        for n in 1..=falls.len() + 2 {
            let predicted = pit.clocks_until_falling(id, nth(n as u64)).filter(|pulse| *pulse <= limit);
            prop_assert_eq!(predicted, falls.get(n - 1).copied(), "fall {} of {:?}", n, id);
        }
    }
    Ok(())
}

fn accesses() -> impl Strategy<Value = Vec<Access>> {
    prop::collection::vec(access(), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_500))]

    #[test]
    fn the_model_does_what_the_oracle_does(accesses in accesses()) {
        let (mut pit, mut oracle) = (Pit8253::new(), Oracle::new());
        for access in &accesses {
            apply(&mut pit, &mut oracle, access)?;
            check_prediction(&pit, &mut oracle, 40)?;
        }
    }

    /// No batch is too large: its parts give the same state and the same edges, and the prediction agrees with them.
    #[test]
    fn batches_add_up(accesses in accesses(), id in counter(), first in 0_u64..1 << 40, second in any::<u64>()) {
        let (mut pit, mut oracle) = (Pit8253::new(), Oracle::new());
        for access in &accesses {
            apply(&mut pit, &mut oracle, access)?;
        }
        let second = second.saturating_sub(first);
        let (mut whole, mut parts) = (pit.clone(), pit.clone());
        let edges = whole.clock(id, first + second);
        let (early, late) = (parts.clock(id, first), parts.clock(id, second));
        prop_assert_eq!(edges.falling, early.falling + late.falling);
        prop_assert_eq!(edges.rising, early.rising + late.rising);
        prop_assert_eq!(&whole, &parts);

        if let Some(last) = NonZeroU64::new(edges.falling) {
            let pulse = pit.clocks_until_falling(id, last);
            prop_assert!(pulse.is_some_and(|pulse| pulse <= first + second));
            let mut just_before = pit.clone();
            prop_assert_eq!(just_before.clock(id, pulse.unwrap_or(0) - 1).falling, last.get() - 1);
            prop_assert_eq!(just_before.clock(id, 1).falling, 1);
        }
        let next = edges.falling.checked_add(1).and_then(NonZeroU64::new);
        let pulse = next.and_then(|next| pit.clocks_until_falling(id, next));
        prop_assert!(pulse.is_none_or(|pulse| pulse > first + second));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn long_periods_are_predicted_as_the_oracle_runs_them(
        word in 0x30_u8..0x40, first in any::<u16>(), second in any::<u16>(), pulses in 0_u64..150_000, trigger in any::<bool>(),
    ) {
        let (mut pit, mut oracle) = (Pit8253::new(), Oracle::new());
        let mut accesses = vec![Access::Control(word), Access::Load(Zero, first)];
        if trigger {
            accesses.extend([Access::Gate(Zero, false), Access::Gate(Zero, true)]);
        }
        accesses.extend([Access::Clock(Zero, pulses), Access::Load(Zero, second)]);
        for access in &accesses {
            apply(&mut pit, &mut oracle, access)?;
        }
        check_prediction(&pit, &mut oracle, 300_000)?;
        apply(&mut pit, &mut oracle, &Access::Clock(Zero, 200_000))?;
    }
}
