//! One movement of one axis, on the machine that the workers run: every count written to counter 0, every pulse, and
//! what the card said on the way. Nothing is planned in here; what the machine does is written down.

use axis_worker::{Axis, AxisError, Sink};
use serde::Serialize;
use supersigma_config::{
    AxisConfig, Feedback, Linear, Profile as RampProfile, ProfileName, RampConfig, ShortMoves, Sin2,
};
use supersigma_protocol::{
    Activity, Answer, AxisReport, Command, Count, Direction, Distance, Operation, Position, Report,
    SpeedIndex, Steps, Tick, Ticks,
};

/// A count written to counter 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Load {
    /// When, from the start of the movement.
    pub tick: Ticks,
    /// What the chip divides by.
    pub count: u32,
}

/// How a movement is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Up the curve and back down it.
    Optimal,
    /// As in 1980.
    Paper,
    /// At one speed.
    Constant,
}

/// A movement as the machine made it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Profile {
    /// Pulses.
    pub steps: Steps,
    /// How it was made.
    pub method: Method,
    /// Along which profile.
    pub profile: ProfileName,
    /// From the start to the last pulse.
    pub duration_ticks: Ticks,
    /// Steps per second in the shortest period.
    pub peak_speed: f64,
    /// Pulses until the acceleration had ended.
    pub accel_steps: Steps,
    /// Pulses until the deceleration began; all of them if there was none.
    pub decel_at: Steps,
    /// Every count written to counter 0.
    pub loads: Vec<Load>,
    /// The tick of every pulse, from the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulses: Option<Vec<Ticks>>,
}

/// What is to be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// How far.
    pub distance: Distance,
    /// The ceiling, or the constant speed.
    pub speed: Option<SpeedIndex>,
    /// Without a ramp.
    pub constant: bool,
}

/// What a ramp is, for a line under a title: its profile and its numbers, speeds as `speed` writes them.
#[must_use]
pub fn describe(ramp: &RampConfig, speed: impl Fn(f64) -> String) -> String {
    let interval = Ticks(ramp.interval_ticks().into()).as_seconds() * 1e3;
    let every = format!("a table entry every {interval:.2} ms");
    match &ramp.profile {
        RampProfile::Sin2(Sin2 { amplitude, omega, phase, .. }) => {
            format!("V(t) = {} sin²({omega} t + {phase}) steps/s, {every}", speed(*amplitude))
        }
        RampProfile::Linear(Linear { f_start, f_max, t_a }) => {
            let (from, to) = (speed(*f_start), speed(*f_max));
            format!("linear from {from} to {to} steps/s in {t_a} s, {every}")
        }
        RampProfile::Table(table) => format!("a table of {} counts, {every}", table.counts.len()),
    }
}

/// Makes the movement `wanted` on an axis with this ramp, and writes down what happens.
///
/// # Errors
/// If the axis cannot be made of its configuration.
pub fn profile(axis: &AxisConfig, ramp: &RampConfig, wanted: Wanted) -> Result<Profile, AxisError> {
    let mut machine = Axis::new(&roomy(axis), ramp)?;
    let operation = operation(wanted);
    let to = axis.address.address();
    // The rail begins at the origin, so that finding it is one step.
    let mut nothing = Vec::new();
    let _ = machine.deliver(Command::new(to, Operation::Originate), None, &mut nothing);
    run_until_standing(&mut machine, &mut nothing);
    let start = machine.now();
    let mut record = Record { start, ..Record::default() };
    let _ = machine.deliver(Command::new(to, operation), None, &mut record);
    record.note(machine.report());
    run_until_standing(&mut machine, &mut record);
    Ok(record.into_profile(wanted, ramp))
}

/// The axis on a rail that is long enough for every movement.
fn roomy(axis: &AxisConfig) -> AxisConfig {
    // What the chip is told does not depend on what a motor makes of it.
    let mut axis = AxisConfig { motor: None, feedback: Feedback::Open, ..axis.clone() };
    let room = u32::from(Distance::MAX.get());
    let (one, two) = (Steps(1), Steps(2));
    (axis.rail.lower_zone, axis.rail.start, axis.rail.reference) = (one, one, two);
    (axis.rail.upper_zone, axis.rail.length) = (Steps(room + 10), Steps(room + 20));
    (axis.travel.min, axis.travel.max) = (Position(0), Position(0).moved(Direction::Forward, Steps(room)));
    axis
}

fn operation(wanted: Wanted) -> Operation {
    let Wanted { distance, speed, constant } = wanted;
    let direction = Direction::Forward;
    match (constant, speed) {
        (true, speed) => Operation::Slew { direction, distance, speed: speed.unwrap_or(SpeedIndex::START) },
        (false, Some(limit)) => Operation::MoveLimited { direction, distance, limit },
        (false, None) => Operation::Move { direction, distance },
    }
}

fn run_until_standing(machine: &mut Axis, sink: &mut impl Sink) {
    while let Some(next) = machine.next_event() {
        machine.advance(next, sink);
    }
}

#[derive(Default)]
struct Record {
    start: Tick,
    loads: Vec<Load>,
    pulses: Vec<Ticks>,
    accelerated: Option<Steps>,
    decelerates: Option<Steps>,
}

impl Sink for Record {
    const PULSES: bool = true;

    fn answer(&mut self, answer: Answer) {
        if let Report::Axis(report) = answer.report {
            self.note(report);
        }
    }

    fn load(&mut self, tick: Tick, count: Count) {
        self.loads.push(Load { tick: tick.since(self.start), count: count.divisor() });
    }

    fn pulse(&mut self, tick: Tick, _: Position) {
        self.pulses.push(tick.since(self.start));
    }
}

impl Record {
    fn note(&mut self, report: AxisReport) {
        if report.activity != Activity::Accelerating {
            self.accelerated.get_or_insert(report.steps);
        }
        if matches!(report.activity, Activity::Decelerating | Activity::Creeping) {
            self.decelerates.get_or_insert(report.steps);
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "periods and the clock's frequency are small")]
    fn into_profile(self, wanted: Wanted, ramp: &RampConfig) -> Profile {
        let steps = wanted.distance.steps();
        let starts = std::iter::once(Ticks(0)).chain(self.pulses.iter().copied());
        let shortest = starts.zip(&self.pulses).map(|(begin, end)| end.0 - begin.0).min().unwrap_or(u64::MAX);
        Profile {
            steps,
            method: match (wanted.constant, ramp.short_moves) {
                (true, _) => Method::Constant,
                (_, ShortMoves::Optimal) => Method::Optimal,
                (_, ShortMoves::Paper) => Method::Paper,
            },
            profile: ramp.profile.name(),
            duration_ticks: self.pulses.last().copied().unwrap_or_default(),
            peak_speed: Tick::PER_SECOND as f64 / shortest as f64,
            accel_steps: self.accelerated.unwrap_or(steps),
            decel_at: self.decelerates.unwrap_or(steps),
            loads: self.loads,
            pulses: Some(self.pulses),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supersigma_config::Config;

    use super::*;

    fn made(steps: u16, method: ShortMoves) -> Profile {
        let config = Config::default_set();
        let ramp = RampConfig { short_moves: method, ..config.ramp.clone() };
        let distance = Distance::new(steps).expect("not zero");
        profile(&config.axes[0], &ramp, Wanted { distance, speed: None, constant: false })
            .expect("a good ramp")
    }

    #[test]
    fn a_long_movement_of_the_paper() {
        let profile = made(10_000, ShortMoves::Paper);
        assert_eq!((profile.steps, profile.method), (Steps(10_000), Method::Paper));
        assert_eq!(profile.accel_steps, Steps(2_587));
        assert_eq!(profile.decel_at, Steps(10_000 - 2_587 - 10));
        assert_eq!(profile.loads.len(), 465);
        assert!((profile.peak_speed - 15_037.6).abs() < 0.1, "{}", profile.peak_speed);
    }

    #[test]
    fn movements_of_one_speed_have_no_acceleration() {
        let profile = made(199, ShortMoves::Paper);
        assert_eq!((profile.accel_steps, profile.decel_at), (Steps(0), Steps(199)));
        assert_eq!(profile.loads, [Load { tick: Ticks(0), count: 3_077 }]);
        assert_eq!(profile.duration_ticks, Ticks(199 * 3_077));
        let profile = made(1, ShortMoves::Optimal);
        assert_eq!((profile.accel_steps, profile.decel_at), (Steps(0), Steps(1)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// A plain rate generator, fed with the loads, makes just these pulses.
        #[test]
        fn loads_make_the_pulses(steps in 1_u16..=20_000, paper: bool) {
            let profile = made(steps, if paper { ShortMoves::Paper } else { ShortMoves::Optimal });
            let (mut now, mut pulses) = (0, vec![]);
            while pulses.len() < usize::from(steps) {
                let load = profile.loads.iter().rfind(|load| load.tick.0 <= now).expect("the first is at 0");
                now += u64::from(load.count);
                pulses.push(Ticks(now));
            }
            prop_assert_eq!(Some(pulses), profile.pulses);
        }
    }
}
