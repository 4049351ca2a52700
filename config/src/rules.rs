//! The rules between values, and those of single values that their types do not say. It gives keys, not places: where
//! they stand in the text is not known here.

use std::collections::HashMap;
use std::hash::Hash;

use crate::problem::Problem;
use crate::{AxisConfig, Config, Feedback, KeyPath, MotorConfig, Profile, RampConfig, RampError, SPEEDS};

/// Positions are then far from the ends of their type.
const LONGEST_RAIL: u32 = 1_000_000;
/// As many as the system's call takes.
const HIGHEST_CPU: u16 = 1_023;

/// A broken rule.
#[derive(Debug)]
pub(crate) struct Finding {
    pub(crate) key: KeyPath,
    /// The other value of a rule between two.
    pub(crate) other: Option<KeyPath>,
    pub(crate) problem: Problem,
}

/// Every rule that `config` breaks.
pub(crate) fn check(config: &Config) -> Vec<Finding> {
    let mut findings = Findings(Vec::new());
    findings.milliseconds(config);
    findings.rotation(config);
    findings.processes(config);
    let set_ramp = config.ramp.counts();
    let root = KeyPath::default();
    if let Err(error) = &set_ramp {
        findings.ramp(&root.key("ramp"), &config.ramp, error.clone());
    }
    findings.axes(config);
    for (index, axis) in config.axes.iter().enumerate() {
        let key = root.key("axis").index(index);
        findings.rail(&key, axis);
        let counts = match &axis.ramp {
            None => set_ramp.clone(),
            Some(own) => own.counts().inspect_err(|error| {
                // What it has from the set's ramp was told there.
                if set_ramp.as_ref().err() != Some(error) {
                    findings.ramp(&key.key("ramp"), own, error.clone());
                }
            }),
        };
        if let Ok(counts) = counts {
            findings.origination(&key, axis, &counts, config.ramp_of(axis));
        }
        if axis.feedback == Feedback::Closed && axis.motor.is_none() {
            let reason =
                "closed loop needs an encoder, which comes with a motor; add `motor = {}`".to_owned();
            findings.add(key.key("loop"), Problem::Refused { reason });
        }
        if !(axis.following.s1 > 0.0 && axis.following.s1.is_finite()) {
            let reason = "S1 is a speed above 0 steps per second".to_owned();
            findings.add(key.key("following").key("s1"), Problem::Refused { reason });
        }
        if let Some(Err(error)) = axis.motor.as_ref().map(MotorConfig::check) {
            let problem = Problem::Refused { reason: error.to_string() };
            findings.add(key.key("motor").key(error.parameter()), problem);
        }
    }
    findings.digital(config);
    findings.0
}

/// `[a-z][a-z0-9_]*`, and not the word that means every axis.
fn is_name(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
        && name != "all"
}

struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, key: KeyPath, problem: Problem) {
        self.0.push(Finding { key, other: None, problem });
    }

    fn between(&mut self, key: KeyPath, other: KeyPath, problem: Problem) {
        self.0.push(Finding { key, other: Some(other), problem });
    }

    fn milliseconds(&mut self, config: &Config) {
        for (table, key, value) in [
            ("line", "lead_ms", config.line.lead_ms),
            ("executive", "answer_ms", config.executive.answer_ms),
            ("executive", "overdue_ms", config.executive.overdue_ms),
            ("supervision", "heartbeat_ms", config.supervision.heartbeat_ms),
            ("log", "flush_ms", config.log.flush_ms),
        ] {
            if value == 0 {
                self.add(KeyPath::default().key(table).key(key), Problem::Zero);
            }
        }
        let (heartbeat_ms, silent_ms) = (config.supervision.heartbeat_ms, config.supervision.silent_ms);
        if u64::from(silent_ms) <= 2 * u64::from(heartbeat_ms) {
            let table = KeyPath::default().key("supervision");
            let problem = Problem::SilenceTooShort { silent_ms, heartbeat_ms };
            self.between(table.key("silent_ms"), table.key("heartbeat_ms"), problem);
        }
    }

    fn rotation(&mut self, config: &Config) {
        for (key, value, least, unit) in [
            ("rotate_mb", config.log.rotate_mb, 0.1, "megabytes"),
            ("rotate_min", config.log.rotate_min, 0.01, "minutes"),
        ] {
            if value.is_some_and(|value| !(value >= least && value.is_finite())) {
                let reason = format!(
                    "a part of the log has at least {least} {unit}; leave the key out to have one file"
                );
                self.add(KeyPath::default().key("log").key(key), Problem::Refused { reason });
            }
        }
    }

    fn processes(&mut self, config: &Config) {
        let refused = |reason: &str| Problem::Refused { reason: reason.to_owned() };
        let (real_time, table) = (&config.real_time, KeyPath::default().key("real_time"));
        if !(1..=99).contains(&real_time.priority) {
            self.add(table.key("priority"), refused("a priority is 1 to 99, the highest"));
        }
        let cpus =
            || real_time.cpus.iter().enumerate().map(|(index, cpu)| (table.key("cpus").index(index), *cpu));
        for (key, cpu) in cpus().filter(|(_, cpu)| *cpu > HIGHEST_CPU) {
            let reason =
                format!("there is no processor {cpu}; they are numbered from 0, to {HIGHEST_CPU} at most");
            self.add(key, refused(&reason));
        }
        self.unique(cpus().map(|(key, cpu)| (key, cpu, "")), |cpu, _| {
            refused(&format!("processor {cpu} is named twice"))
        });
    }

    fn ramp(&mut self, table: &KeyPath, ramp: &RampConfig, error: RampError) {
        let key = match (error.parameter(), error.entry(), &ramp.profile) {
            (Some(parameter), ..) => table.key(parameter),
            (None, Some(entry), Profile::Table(_)) => table.key("counts").index(entry.into()),
            _ => table.clone(),
        };
        match error {
            RampError::BrakeSlower { derived, .. } => {
                let of = if derived { "t_a" } else { "interval_ticks" };
                self.between(key, table.key(of), error.into());
            }
            RampError::Falls { .. } => self.between(key, table.key("f_start"), error.into()),
            _ => self.add(key, error.into()),
        }
    }

    fn axes(&mut self, config: &Config) {
        let key = KeyPath::default().key("axis");
        match config.axes.len() {
            0 => self.add(key.clone(), Problem::NoAxis),
            1..=7 => {}
            count => self.add(key.index(7), Problem::TooManyAxes { count }),
        }
        let axes = || config.axes.iter().enumerate().map(|(index, axis)| (key.index(index), axis));
        self.unique(
            axes().map(|(key, axis)| (key.key("address"), axis.address, &axis.name)),
            |address, owner| Problem::AddressTaken { address: address.get(), owner },
        );
        self.names(axes().map(|(key, axis)| (key.key("name"), axis.name.as_str())));
    }

    fn rail(&mut self, key: &KeyPath, axis: &AxisConfig) {
        let (rail, table) = (&axis.rail, key.key("rail"));
        let [length, lower, upper, reference, start] =
            [rail.length, rail.lower_zone, rail.upper_zone, rail.reference, rail.start].map(|steps| steps.0);
        let told_before = self.0.len();
        if lower == 0 {
            self.add(table.key("lower_zone"), Problem::Zero);
        }
        for (name, value, below, bound) in [
            ("reference", reference, "lower_zone", lower),
            ("upper_zone", upper, "reference", reference),
            ("length", length, "upper_zone", upper),
        ] {
            if value <= bound {
                self.between(table.key(name), table.key(below), Problem::NotAbove { value, below, bound });
            }
        }
        if length > LONGEST_RAIL {
            self.add(table.key("length"), Problem::RailTooLong { length });
        }
        if start > length {
            self.between(table.key("start"), table.key("length"), Problem::StartBeyondRail { start, length });
        }
        let rail_is_sound = self.0.len() == told_before;

        let (min, max, travel) = (axis.travel.min.0, axis.travel.max.0, key.key("travel"));
        // Position p is the rail's step e1 + 1 + p, so the last one below the upper zone, e2, is e2 − e1 − 2.
        let last = i64::from(upper) - i64::from(lower) - 2;
        if min < 0 {
            self.add(travel.key("min"), Problem::TravelBelowOrigin { min });
        }
        if max < min {
            self.between(travel.key("max"), travel.key("min"), Problem::TravelReversed { min, max });
        } else if rail_is_sound && i64::from(max) > last {
            self.between(travel.key("max"), table.key("upper_zone"), Problem::TravelAboveRail { max, last });
        }
    }

    /// The switch closes when the carriage, under way to the lower stop, enters the lower zone; there it must come to
    /// rest before the stop, if need be by an emergency stop.
    fn origination(&mut self, key: &KeyPath, axis: &AxisConfig, counts: &[u16; SPEEDS], ramp: &RampConfig) {
        let (speed, lower_zone) = (axis.origination.speed.get(), axis.rail.lower_zone.0);
        let millionths: u64 = counts[..usize::from(speed)]
            .iter()
            .map(|n| u64::from(ramp.brake_interval_ticks) * 1_000_000 / (u64::from(*n) + 1))
            .sum();
        let needed = millionths / 1_000_000;
        if lower_zone > 0 && needed >= u64::from(lower_zone) {
            self.between(
                key.key("origination").key("speed"),
                key.key("rail").key("lower_zone"),
                Problem::OriginationTooFast { speed, needed, lower_zone },
            );
        }
    }

    fn digital(&mut self, config: &Config) {
        let (digital, root) = (&config.digital, KeyPath::default().key("digital"));
        let outputs: Vec<_> = digital.outputs.iter().map(|line| (line.bit, line.name.as_str())).collect();
        let inputs: Vec<_> = digital.inputs.iter().map(|line| (line.bit, line.name.as_str())).collect();
        for (card, lines) in [("output", outputs), ("input", inputs)] {
            let lines = || lines.iter().enumerate().map(|(index, line)| (root.key(card).index(index), line));
            for (key, &(bit, _)) in lines().filter(|(_, (bit, _))| *bit > 15) {
                self.add(key.key("bit"), Problem::NoSuchBit { bit });
            }
            self.unique(lines().map(|(key, (bit, name))| (key.key("bit"), *bit, *name)), |bit, owner| {
                Problem::BitTaken { bit, owner }
            });
            self.names(lines().map(|(key, (_, name))| (key.key("name"), *name)));
        }
        for (index, input) in digital.inputs.iter().enumerate() {
            let key = root.key("input").index(index);
            match &input.follows {
                Some(name) if digital.outputs.iter().all(|output| output.name != *name) => {
                    let outputs = digital.outputs.iter().map(|output| output.name.clone()).collect();
                    self.add(key.key("follows"), Problem::NoSuchOutput { name: name.clone(), outputs });
                }
                None if input.delay_ms > 0 => {
                    self.add(key.key("delay_ms"), Problem::DelayWithoutCause { delay_ms: input.delay_ms });
                }
                _ => {}
            }
        }
    }

    fn names<'a>(&mut self, names: impl Iterator<Item = (KeyPath, &'a str)> + Clone) {
        for (key, name) in names.clone().filter(|(_, name)| !is_name(name)) {
            self.add(key, Problem::BadName { name: name.to_owned() });
        }
        self.unique(names.map(|(key, name)| (key, name, name)), |name, _| Problem::NameTaken {
            name: name.to_owned(),
        });
    }

    /// Each value may be there once; `problem` gets the name of whoever had it first.
    fn unique<T: Hash + Eq + Copy, N: AsRef<str>>(
        &mut self,
        values: impl Iterator<Item = (KeyPath, T, N)>,
        problem: impl Fn(T, String) -> Problem,
    ) {
        let mut seen: HashMap<T, (KeyPath, N)> = HashMap::new();
        for (key, value, name) in values {
            match seen.get(&value) {
                Some((first, owner)) => {
                    self.between(key, first.clone(), problem(value, owner.as_ref().to_owned()));
                }
                None => drop(seen.insert(value, (key, name))),
            }
        }
    }
}
