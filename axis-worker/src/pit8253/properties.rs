//! The model against the oracle, driven with the same random accesses; and against itself, with batches that no
//! oracle could count.

use core::num::NonZeroU64;

use proptest::prelude::*;
use supersigma_protocol::Count;

use super::CounterId::Zero;
use super::oracle::Oracle;
use super::{CounterId, Edges, Pit8253};

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
    /// As many pulses as make OUT fall, and so end on the events of the modes; none if that is far.
    ClockToFall(CounterId),
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
        3 => counter().prop_map(Access::ClockToFall),
    ]
}

fn clock_both(
    pit: &mut Pit8253,
    oracle: &mut Oracle,
    id: CounterId,
    pulses: u64,
) -> Result<(), TestCaseError> {
    let counter = oracle.counter(id);
    let mut expected = Edges::default();
    for _ in 0..pulses {
        let before = counter.out;
        counter.pulse();
        expected.falling += u64::from(before && !counter.out);
        expected.rising += u64::from(!before && counter.out);
    }
    prop_assert_eq!(pit.clock(id, pulses), expected);
    Ok(())
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
        Access::Clock(id, pulses) => clock_both(pit, oracle, id, pulses)?,
        Access::ClockToFall(id) => {
            let pulses = pit.clocks_until_falling(id, NonZeroU64::MIN).filter(|pulses| *pulses < 5_000);
            clock_both(pit, oracle, id, pulses.unwrap_or(0))?;
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
            let predicted = pit
                .clocks_until_falling(id, NonZeroU64::MIN.saturating_add(n as u64 - 1))
                .filter(|pulse| *pulse <= limit);
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
        word in 0x30_u8..0x40,
        first in any::<u16>(),
        second in any::<u16>(),
        pulses in 0_u64..150_000,
        trigger in any::<bool>(),
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
