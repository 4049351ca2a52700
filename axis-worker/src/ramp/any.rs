//! Ramps of every profile, for tests.

use proptest::prelude::*;
use supersigma_config::{CountTable, Differences, Linear, Profile, RampConfig, Sin2};

/// The built-in ramp, and usable ones of every profile, from the slowest to the fastest that a card can play.
pub(crate) fn any_ramp() -> impl Strategy<Value = RampConfig> {
    let sin2 = (5_000.0..60_000.0_f64, 1_000..4_000_u32, 0.15..0.3_f64).prop_map(
        |(amplitude, interval_ticks, phase)| {
            // The top of the curve at the last entry.
            let seconds = 232.0 * f64::from(interval_ticks) / 2e6;
            let omega = (std::f64::consts::FRAC_PI_2 - phase) / seconds;
            Profile::Sin2(Sin2 { amplitude, omega, phase, interval_ticks })
        },
    );
    let linear = (40.0..1_500.0_f64, 0.0..70_000.0_f64, 0.02..2.0_f64)
        .prop_map(|(f_start, more, t_a)| Profile::Linear(Linear { f_start, f_max: f_start + more, t_a }));
    let table = (2_000..60_000_u16, prop::collection::vec(0..=20_u16, 2..=233), 300..20_000_u32).prop_map(
        |(first, hundredths, interval_ticks)| {
            let counts = hundredths.iter().scan(first, |n, hundredths| {
                let fall = u32::from(*n) * u32::from(*hundredths) / 100;
                *n = n.saturating_sub(u16::try_from(fall).unwrap_or(0)).max(25);
                Some(*n)
            });
            Profile::Table(CountTable { counts: counts.collect(), interval_ticks })
        },
    );
    let any = prop_oneof![sin2, linear, table]
        .prop_map(|profile| RampConfig { differences: Differences::Wide, ..profile.into() });
    prop_oneof![1 => Just(RampConfig::default()), 4 => any]
}
