//! Whether the motor of an axis can follow its ramp: the ramp's own pulses are played to its rotor, up to the top speed and
//! down again, and down the steep ramp, in both directions if a load tells them apart. What is said is where it slips; the
//! torques beside it are closed forms that tell people why. For advice only: no pulse depends on it.

use std::f64::consts::TAU;
use std::fmt;

use supersigma_config::{MotorConfig, RampConfig};
use supersigma_protocol::{Direction, Distance, SpeedIndex, Tick, Ticks};

use crate::AxisError;
use crate::motor::{PATIENCE, Rotor};
use crate::ramp::{Curve, Phase, Plan, Stop, Table};

/// How long the top speed is held: any swing of the acceleration shows, or has faded.
const CRUISE: Ticks = Ticks(Tick::PER_SECOND / 4);

/// What a motor makes of a ramp.
#[derive(Debug, Clone, PartialEq)]
pub struct Strain {
    /// Where the acceleration leaves the least of the motor's torque.
    pub tightest: Demand,
    /// Where it falls out of step, if it does.
    pub stall: Option<Stall>,
}

/// What a ramp asks of a motor at one speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demand {
    /// The entry of the ramp table.
    pub entry: SpeedIndex,
    /// Its speed, steps per second.
    pub speed: f64,
    /// The torque for inertia, friction and load, newton metres.
    pub needed: f64,
    /// The torque that the motor has at this speed when it does not swing, newton metres.
    pub available: f64,
}

/// Where a motor falls out of step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stall {
    /// The first pulse, from 1, after which the rotor has slipped by a cycle.
    pub pulse: u32,
    /// When, from the start of the movement.
    pub at: Ticks,
    /// Where to.
    pub direction: Direction,
    /// In which part of the movement.
    pub phase: Phase,
    /// What that pulse asks.
    pub demand: Demand,
}

impl fmt::Display for Demand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entry, speed, needed, available } = self;
        write!(f, "{needed:.2} N·m of {available:.2} at entry {} ({speed:.1} steps/s)", entry.get())
    }
}

impl fmt::Display for Stall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pulse, at, direction, phase, demand } = self;
        let phase = match phase {
            Phase::Accelerating => "accelerating",
            Phase::Cruising => "at the top speed",
            Phase::Decelerating | Phase::Creeping => "decelerating",
            Phase::Braking => "braking",
        };
        let direction = match direction {
            Direction::Forward => "",
            Direction::TowardsOrigin => " towards the origin",
        };
        let seconds = at.as_seconds();
        write!(
            f,
            "the motor falls out of step at pulse {pulse}, after {seconds:.3} s, {phase}{direction}: "
        )?;
        write!(f, "the ramp needs {demand}")?;
        if demand.needed < demand.available {
            f.write_str(", but the rotor swings")?;
        }
        Ok(())
    }
}

/// Plays the ramp to the motor.
///
/// # Errors
/// If the ramp does not give a table, or the motor cannot be.
pub fn strain(motor: &MotorConfig, ramp: &RampConfig) -> Result<Strain, AxisError> {
    let table = Table::new(ramp)?;
    let bench = Bench { motor, table: &table, curve: Curve::new(ramp), ramp };
    let directions: &[Direction] = if motor.load_torque == 0.0 {
        &[Direction::Forward]
    } else {
        &[Direction::Forward, Direction::TowardsOrigin]
    };
    let entries = (0..=table.last().get()).filter_map(SpeedIndex::new);
    let demands = entries.flat_map(|entry| directions.iter().map(move |direction| (entry, *direction)));
    let share = |demand: &Demand| demand.needed / demand.available;
    let tightest = demands
        .map(|(entry, direction)| bench.demand(entry, Phase::Accelerating, direction))
        .reduce(|worst, next| if share(&next) > share(&worst) { next } else { worst })
        .unwrap_or_else(|| bench.demand(SpeedIndex::START, Phase::Accelerating, Direction::Forward));
    let up_and_down = bench.up_and_down();
    let mut braked = up_and_down.clone();
    let top_until = up_and_down.duration() / 2;
    braked.stop(&table, top_until, Stop::Brake);
    for plan in [&up_and_down, &braked] {
        for direction in directions {
            if let Some(stall) = bench.play(plan, *direction)? {
                return Ok(Strain { tightest, stall: Some(stall) });
            }
        }
    }
    Ok(Strain { tightest, stall: None })
}

struct Bench<'a> {
    motor: &'a MotorConfig,
    table: &'a Table,
    curve: Curve,
    ramp: &'a RampConfig,
}

impl Bench<'_> {
    /// Up the whole ramp, some time at the top, and down; of a ramp longer than any movement as much as fits.
    fn up_and_down(&self) -> Plan {
        let cruise = CRUISE.0 / u64::from(self.table.period(SpeedIndex::TOP));
        let pulses = 2 * u64::from(self.table.normal().pulses().0) + cruise;
        let distance = u16::try_from(pulses).ok().and_then(Distance::new).unwrap_or(Distance::MAX);
        Plan::fastest(self.table, distance, SpeedIndex::TOP)
    }

    fn play(&self, plan: &Plan, direction: Direction) -> Result<Option<Stall>, AxisError> {
        let mut rotor = Rotor::standing(self.motor)?;
        let slipped = rotor.follow(plan.periods(), direction).or_else(|| {
            rotor.settle(PATIENCE);
            (rotor.slips() > 0).then_some(plan.total().0)
        });
        Ok(slipped.and_then(|pulse| self.stall(plan, pulse, direction)))
    }

    /// What there is to say of a slip at a pulse of the plan.
    fn stall(&self, plan: &Plan, pulse: u32, direction: Direction) -> Option<Stall> {
        let phase = plan.run(plan.run_of(pulse))?.phase;
        let period = plan.period(pulse);
        let entries = (0..=SpeedIndex::TOP.get()).filter_map(SpeedIndex::new);
        let entry = entries.take_while(|entry| self.table.period(*entry) >= period).last();
        let demand = self.demand(entry.unwrap_or(SpeedIndex::START), phase, direction);
        Some(Stall { pulse, at: Ticks(plan.tick_of(pulse)), direction, phase, demand })
    }

    /// ```text
    /// needed     |J dω/dt + D₀ ω + F ± load|       ω = speed · 2π / half steps per turn
    /// available  T / √(1 + (speed / corner)²)      the field's share of the holding torque
    /// ```
    fn demand(&self, entry: SpeedIndex, phase: Phase, direction: Direction) -> Demand {
        let motor = self.motor;
        let speed = self.table.speed(entry);
        let seconds = self.table.interval().as_seconds() * f64::from(entry.get());
        let slope = self.curve.acceleration(seconds.min(self.curve.end()));
        let steeper = f64::from(self.ramp.interval_ticks()) / f64::from(self.ramp.brake_interval_ticks);
        let acceleration = match phase {
            Phase::Accelerating => slope,
            Phase::Cruising | Phase::Creeping => 0.0,
            Phase::Decelerating => -slope,
            Phase::Braking => -slope * steeper,
        };
        let load = match direction {
            Direction::Forward => motor.load_torque,
            Direction::TowardsOrigin => -motor.load_torque,
        };
        let radians = TAU / f64::from(motor.half_steps_per_turn);
        let friction = motor.viscous_friction * speed * radians + motor.friction;
        Demand {
            entry,
            speed,
            needed: (motor.inertia() * acceleration * radians + friction + load).abs(),
            available: motor.holding_torque / (speed / motor.corner_speed).hypot(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supersigma_config::{Linear, Sin2};

    use super::*;

    fn bench() -> MotorConfig {
        MotorConfig::bench()
    }

    fn linear(f_start: f64, f_max: f64, t_a: f64) -> RampConfig {
        RampConfig {
            differences: supersigma_config::Differences::Wide,
            ..Linear { f_start, f_max, t_a }.into()
        }
    }

    #[test]
    fn the_bench_motor_follows_the_ramp_of_the_paper() {
        let strain = strain(&bench(), &RampConfig::default()).expect("they can be");
        assert_eq!(strain.stall, None);
        let Demand { entry, needed, available, .. } = strain.tightest;
        assert!(needed < available, "{strain:?}");
        // a = A ω sin 2(ωt + φ) is largest half-way, 34 083 steps/s² at 7 500 steps/s; the torque falls with the speed, so the
        // tightest place lies above that.
        assert!(entry.get() > 90, "{strain:?}");
    }

    #[test]
    fn torques_by_hand() {
        // 200 to 4 000 steps/s in 0.232 s, 2 000 ticks an entry: 16 379.3 steps/s², · 2π/400 = 257.29 rad/s².
        // J = 1.2e-4: 0.030 87 N·m; friction 0.03; at entry 232 2 000 000 / 500 = 4 000 steps/s, 62.83 rad/s · 4e-4 = 0.025 13.
        let motor = MotorConfig { load_torque: 0.5, ..bench() };
        let ramp = linear(200.0, 4_000.0, 0.232);
        let strain = strain(&motor, &ramp).expect("they can be");
        let Demand { entry, speed, needed, available } = strain.tightest;
        assert_eq!((entry, speed), (SpeedIndex::TOP, 4_000.0));
        assert!((needed - (0.030_87 + 0.03 + 0.025_13 + 0.5)).abs() < 1e-4, "{needed}");
        // At the corner speed 2.5 / √2.
        assert!((available - 1.767_77).abs() < 1e-4, "{available}");
        assert_eq!(strain.stall, None);
    }

    #[test]
    fn where_the_torque_does_not_suffice_it_slips_on_the_way_up() {
        // Thirty times the inertia: 34 083 steps/s² · 2π/400 · 3.72e-3 = 1.99 N·m half-way, where 1.18 are left.
        let heavy = MotorConfig { load_inertia: 30.0 * bench().rotor_inertia, ..bench() };
        let strain = strain(&heavy, &RampConfig::default()).expect("they can be");
        assert!(strain.tightest.needed > 1.9 && strain.tightest.available < 1.3, "{:?}", strain.tightest);
        let stall = strain.stall.expect("it slips");
        assert_eq!((stall.phase, stall.direction), (Phase::Accelerating, Direction::Forward));
        let said = stall.to_string();
        assert!(said.contains("accelerating: the ramp needs ") && said.contains(" at entry "), "{said}");
    }

    #[test]
    fn a_start_beyond_the_pull_in_slips_though_the_torque_would_do() {
        // The bench motor starts up to 2 450 steps/s.
        let stall = strain(&bench(), &linear(4_000.0, 5_000.0, 1.0)).expect("they can be").stall;
        let stall = stall.expect("it does not start");
        assert!(stall.pulse < 100 && stall.demand.needed < stall.demand.available, "{stall:?}");
        assert!(stall.to_string().ends_with("but the rotor swings"), "{stall}");
    }

    #[test]
    fn a_brake_may_be_too_steep_for_what_the_ramp_is_not() {
        let ramp = RampConfig { brake_interval_ticks: 60, ..Sin2::default().into() };
        let stall = strain(&bench(), &ramp).expect("they can be").stall.expect("it slips");
        assert_eq!(stall.phase, Phase::Braking);
        // A weight that helps on the way up, towards the origin, is in the way when braking.
        let weight = MotorConfig { load_torque: 0.9, ..bench() };
        let stall = strain(&weight, &ramp).expect("they can be").stall.expect("it slips");
        assert!(matches!(stall.phase, Phase::Braking | Phase::Accelerating), "{stall:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// If the torque is short everywhere from some speed on, no motor can follow; the first slip is on the way up.
        #[test]
        fn what_needs_more_than_there_is_slips(f_max in 6_000.0..12_000.0_f64, times in 1.3..3.0_f64) {
            let ramp = linear(300.0, f_max, 0.5);
            let at_the_top = strain(&bench(), &ramp).expect("they can be").tightest;
            // As much inertia as makes it need `times` the torque that there is at the top.
            let own = (f_max - 300.0) / 0.5 * TAU / 400.0;
            let inertia = times * at_the_top.available / own;
            let heavy = MotorConfig { load_inertia: inertia, ..bench() };
            let strain = strain(&heavy, &ramp).expect("they can be");
            prop_assert!(strain.tightest.needed > strain.tightest.available);
            let stall = strain.stall.expect("it slips");
            prop_assert!(stall.phase == Phase::Accelerating || stall.phase == Phase::Cruising, "{stall:?}");
        }
    }
}
