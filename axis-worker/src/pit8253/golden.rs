//! Golden traces, worked out by hand as in the data sheet's timing diagrams, and the card's two step counters.

use core::fmt::Write as _;
use core::num::NonZeroU64;

use supersigma_protocol::Count;

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
fn a_strobe_of_mode_4_ends_under_a_low_gate_too() {
    let mut pit = with_lsb(4, 2);
    assert_eq!(trace(&mut pit, 3), "2H 1H 0L");
    pit.set_gate(Zero, false);
    assert!(!pit.output(Zero));
    assert_eq!(trace(&mut pit, 2), "0H 0H");
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
