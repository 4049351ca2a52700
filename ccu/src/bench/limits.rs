//! The characteristic of a motor for several loads at once: as many threads as the machine has cores, each takes the next
//! load that nobody has.

use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use axis_worker::motor::{Characteristic, characteristic};
use supersigma_config::{MotorConfig, MotorError};

/// The limits of a motor with one disc on its shaft, over the torque of a brake.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Of the disc, kg·m².
    pub inertia: f64,
    /// Torques rising.
    pub points: Vec<Characteristic>,
}

/// Brake torques from none up to nearly all that the motor can hold: `count` of them, closer together where they are
/// small, because there the limits change fastest.
#[must_use]
pub fn torques(motor: &MotorConfig, count: u32) -> Vec<f64> {
    let most = motor.holding_torque - motor.friction - motor.load_torque.abs();
    let part = |n: u32| f64::from(n) / f64::from(count.max(2) - 1);
    // Whole thousandths, so that a table of them is exact.
    (0..count).map(|n| (most * 0.9 * part(n).powf(1.5) * 1e3).round() / 1e3).collect()
}

/// The limits for every inertia and every torque; pull-out up to `top` half steps/s. `done` is called after each point, by
/// whichever thread.
///
/// # Errors
/// If the motor cannot be.
pub fn sweep(
    motor: &MotorConfig,
    inertias: &[f64],
    torques: &[f64],
    top: f64,
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Limits>, MotorError> {
    motor.check()?;
    let loads: Vec<_> =
        inertias.iter().flat_map(|&inertia| torques.iter().map(move |&torque| (inertia, torque))).collect();
    let next = AtomicUsize::new(0);
    let work = || {
        let mut found = Vec::new();
        let take = || {
            let at = next.fetch_add(1, Ordering::Relaxed);
            loads.get(at).map(|load| (at, *load))
        };
        while let Some((at, (inertia, torque))) = take() {
            found.push((at, characteristic(motor, inertia, [torque], top)));
            done();
        }
        found
    };
    let cores = thread::available_parallelism().map_or(1, NonZero::get).min(loads.len());
    let mut found: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let join = |thread: thread::ScopedJoinHandle<'_, _>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        threads.into_iter().flat_map(join).collect()
    });
    found.sort_by_key(|(at, _)| *at);
    let points = found.into_iter().map(|(_, points)| points).collect::<Result<Vec<_>, _>>()?.concat();
    let of_a_disc = points.chunks(torques.len().max(1)).map(<[Characteristic]>::to_vec);
    Ok(inertias.iter().copied().zip(of_a_disc).map(|(inertia, points)| Limits { inertia, points }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limits_are_those_of_the_drawing_whatever_thread_finds_them() {
        let motor = MotorConfig::bench();
        let counted = AtomicUsize::new(0);
        let done = || {
            counted.fetch_add(1, Ordering::Relaxed);
        };
        let limits = sweep(&motor, &[0.0], &[0.0, 0.5, 1.0, 2.0], 100_000.0, &done).expect("a motor");
        assert_eq!((limits.len(), counted.into_inner()), (1, 4));
        // The table in the module `motor`.
        let table = [
            (0.0, 1_400.0, 2_450.0, 35_000.0),
            (0.5, 1_650.0, 2_050.0, 14_800.0),
            (1.0, 1_600.0, 1_600.0, 8_100.0),
            (2.0, 640.0, 640.0, 2_600.0),
        ];
        for (point, (torque, start_stop, pull_in, pull_out)) in limits[0].points.iter().zip(table) {
            assert!((point.torque - torque).abs() < 1e-9);
            for (found, told) in
                [(point.start_stop, start_stop), (point.pull_in, pull_in), (point.pull_out, pull_out)]
            {
                let found = found.expect("a limit");
                assert!((found / told - 1.0).abs() < 0.03, "{found}, where the table has {told}");
            }
        }
    }

    #[test]
    fn discs_are_kept_apart_and_torques_rise() {
        let motor = MotorConfig::bench();
        let torques = torques(&motor, 3);
        // 0.9 · (2.5 − 0.03) and, half-way, 0.5^1.5 of it.
        assert_eq!(torques, [0.0, 0.786, 2.223]);
        let limits = sweep(&motor, &[0.0, 6e-4], &torques, 5_000.0, &|| {}).expect("a motor");
        let inertias: Vec<_> = limits.iter().map(|limits| limits.inertia).collect();
        assert_eq!(inertias, [0.0, 6e-4]);
        for limits in &limits {
            assert!(limits.points.windows(2).all(|pair| pair[0].torque < pair[1].torque));
            assert_eq!(limits.points.len(), 3);
        }
        assert!(limits[0].points[0].pull_in > limits[1].points[0].pull_in, "{limits:?}");
        assert!(sweep(&MotorConfig { rotor_inertia: 0.0, ..motor }, &[0.0], &[0.0], 1e4, &|| {}).is_err());
    }
}
