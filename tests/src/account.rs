//! The account of a log: every step that an axis reports is held against what it was commanded, and every position against
//! the steps. Read with the public crate for MCAP and decoded frame by frame; nothing of `ccu` takes part in it.
//!
//! A movement begins where the axis stood; after `s` steps of it the axis is `s` steps along its legs, in every single
//! report. While an axis searches, its position is unknown, and its steps only grow; from where it has been found on,
//! steps and position grow alike. Where frames are missing, an axis is believed again when it stands.

use std::collections::BTreeMap;
use std::fs;
use std::iter;
use std::path::{Path, PathBuf};

use mcap::MessageStream;
use mcap::read::Options;
use supersigma_protocol::{
    About, Activity, Alarm, Answer, AxisNumber, AxisReport, Body, Broadcast, CardKind, Command, Direction,
    Frame, Occasion, Operation, Report, Sender, Sequence,
};

/// The raw frames' topic.
const MICROBUS: &str = "/microbus";
/// Further errors follow from the first ones.
const FAULTS: usize = 20;

/// What a log comes to.
#[derive(Debug, Default)]
pub struct Account {
    /// Frames read.
    pub frames: u64,
    /// Frames that are missing by the senders' numbers.
    pub missing: u64,
    /// Movements and searches that cards have consented to.
    pub movements: u64,
    /// Steps of all axes, by their last word on each movement.
    pub steps: u64,
    /// Alarms that were raised.
    pub alarms: Vec<(AxisNumber, Alarm)>,
    /// What does not add up.
    pub faults: Vec<String>,
    axes: BTreeMap<AxisNumber, Axis>,
    expected: BTreeMap<Sender, Sequence>,
    commands: BTreeMap<Sequence, Command>,
}

/// The files of the log that begins in `log`, in their order.
#[must_use]
pub fn log_files(log: &Path) -> Vec<PathBuf> {
    let further = (2..).map(|part| log.with_extension(format!("{part}.mcap")));
    iter::once(log.to_owned()).chain(further).take_while(|file| file.exists()).collect()
}

/// One axis, as the log tells it.
#[derive(Debug, Default)]
struct Axis {
    motion: Motion,
    /// Steps of the movement so far.
    steps: u32,
    activity: Option<Activity>,
    alarm: Option<Alarm>,
}

#[derive(Debug, Default)]
enum Motion {
    /// Where it is, nobody knows.
    #[default]
    Unknown,
    /// Something is missing in the log.
    Unsure,
    /// From `base` along these legs, or standing there.
    Along { base: i64, legs: Vec<(Direction, u32)> },
    /// A search; with steps and position as they were told together last.
    Search(Option<(u32, i64)>),
}

impl Account {
    /// Of a log in these files, in their order. A file that is cut is read as far as it goes.
    #[must_use]
    pub fn of<P: AsRef<Path>>(files: impl IntoIterator<Item = P>) -> Self {
        let mut account = Self::default();
        for file in files {
            account.read(file.as_ref());
        }
        for axis in account.axes.values() {
            account.steps += u64::from(axis.steps);
        }
        account
    }

    /// Where each axis that has spoken is in the end.
    #[must_use]
    pub fn positions(&self) -> BTreeMap<AxisNumber, Option<i64>> {
        self.axes.iter().map(|(number, axis)| (*number, axis.position())).collect()
    }

    fn read(&mut self, file: &Path) {
        let bytes = fs::read(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let messages = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into());
        for message in messages.unwrap_or_else(|error| panic!("{}: {error}", file.display())) {
            let Ok(message) = message else {
                // The end of what is whole; what follows in another file follows after a gap.
                self.axes.values_mut().for_each(Axis::doubt);
                return;
            };
            if message.channel.topic == MICROBUS {
                match Frame::decode(&message.data) {
                    Ok(frame) => self.take(&frame),
                    Err(error) => self.fault(format!("a frame that does not decode: {error}")),
                }
            }
        }
    }

    fn take(&mut self, frame: &Frame) {
        self.frames += 1;
        self.count(frame);
        match &frame.body {
            Body::Command(Broadcast { bytes, .. }) => {
                if let Ok(command) = Command::decode(bytes.as_slice()) {
                    self.commands.insert(frame.sequence, command);
                    // Answers come soon or never.
                    if self.commands.len() > 4_096 {
                        self.commands.pop_first();
                    }
                }
            }
            Body::Answer(answer) => self.answer(frame, answer),
            Body::Fault(..) => {}
        }
    }

    /// Looks for gaps in the sender's numbers.
    fn count(&mut self, frame: &Frame) {
        let born = frame.sequence == Sequence(0);
        let expected = self.expected.insert(frame.sender, frame.sequence.next()).unwrap_or(Sequence(0));
        if born || expected == frame.sequence {
            return;
        }
        self.missing += frame.sequence.0.saturating_sub(expected.0);
        for (number, axis) in &mut self.axes {
            if frame.sender == Sender::Ccu || frame.sender == Sender::Card(number.address()) {
                axis.doubt();
            }
        }
    }

    fn answer(&mut self, frame: &Frame, answer: &Answer) {
        let (CardKind::Axis(number), Report::Axis(report)) = (answer.card.kind(), answer.report) else {
            return;
        };
        let axis = self.axes.entry(number).or_insert_with(|| {
            let mut axis = Axis::default();
            // What it said before is not in the log.
            if frame.sequence != Sequence(0) {
                axis.doubt();
            }
            axis
        });
        match answer.about {
            About::Unasked(Occasion::Joined) => *axis = Axis::default(),
            About::Command(sequence, Ok(())) => {
                if let Some(operation) = self.commands.get(&sequence).map(|command| command.operation) {
                    self.steps += u64::from(axis.obey(operation, &report));
                    self.movements += u64::from(operation.sets_going() && operation != Operation::Go);
                }
            }
            About::Command(_, Err(_)) | About::Unasked(_) => {}
        }
        if let Some(alarm) = report.alarm.filter(|alarm| axis.alarm.is_none_or(|before| before != *alarm)) {
            self.alarms.push((number, alarm));
        }
        if let Err(fault) = axis.hold(&report) {
            self.fault(format!(
                "axis {number}, frame {} at tick {}: {fault}: {report:?}",
                frame.sequence.0, frame.tick.0
            ));
        }
    }

    fn fault(&mut self, fault: String) {
        if self.faults.len() < FAULTS {
            self.faults.push(fault);
        }
    }
}

impl Axis {
    fn doubt(&mut self) {
        self.motion = Motion::Unsure;
    }

    fn position(&self) -> Option<i64> {
        match &self.motion {
            Motion::Along { base, legs } => along(*base, legs, self.steps),
            Motion::Search(Some((_, position))) => Some(*position),
            Motion::Search(None) | Motion::Unknown | Motion::Unsure => None,
        }
    }

    /// It has consented to this. Gives the steps of the movement before, if another one begins.
    fn obey(&mut self, operation: Operation, report: &AxisReport) -> u32 {
        let legs = match operation {
            Operation::Move { direction, distance }
            | Operation::MoveLimited { direction, distance, .. }
            | Operation::Slew { direction, distance, .. }
            | Operation::ArmLine { direction, distance } => vec![(direction, distance.steps().0)],
            Operation::Rest => vec![],
            Operation::Originate | Operation::SeekReference => {
                self.motion = Motion::Search(None);
                return std::mem::take(&mut self.steps);
            }
            _ => return 0,
        };
        if let (Motion::Along { legs: armed, .. }, Some(Activity::Armed)) = (&mut self.motion, self.activity)
        {
            armed.extend(legs);
            return 0;
        }
        let told = report.position.map(|position| i64::from(position.0));
        let here = if matches!(self.motion, Motion::Unsure) { told } else { self.position() };
        // Nobody may move from where nobody knows: then the next report does not hold.
        self.motion = here.map_or(Motion::Unknown, |base| Motion::Along { base, legs });
        std::mem::take(&mut self.steps)
    }

    /// Holds a report against what is known.
    fn hold(&mut self, report: &AxisReport) -> Result<(), &'static str> {
        let (steps, position) = (report.steps.0, report.position.map(|position| i64::from(position.0)));
        let stands = report.activity == Activity::Standing;
        let before = std::mem::replace(&mut self.steps, steps);
        (self.activity, self.alarm) = (Some(report.activity), report.alarm);
        let found = |position: Option<i64>| {
            position.map_or(Motion::Unknown, |base| Motion::Along { base, legs: vec![] })
        };
        match &mut self.motion {
            Motion::Unsure => {
                if stands {
                    self.motion = found(position);
                }
            }
            Motion::Unknown if position.is_some() => return Err("a position out of nothing"),
            Motion::Unknown => {}
            Motion::Along { base, legs } => {
                let due = along(*base, legs, steps);
                if legs.is_empty() && steps != before {
                    return Err("steps without a movement");
                }
                if steps < before {
                    return Err("steps have been forgotten");
                }
                if due.is_none() {
                    return Err("more steps than were commanded");
                }
                if position != due {
                    return Err("the position is not where the steps lead");
                }
            }
            Motion::Search(last) => {
                if steps < before {
                    return Err("steps of the search have been forgotten");
                }
                if let (Some((steps_then, position_then)), Some(position)) = (*last, position)
                    && position - position_then != i64::from(steps) - i64::from(steps_then)
                {
                    return Err("steps and position of the search do not grow alike");
                }
                *last = position.map(|position| (steps, position));
                if stands {
                    self.motion = found(position);
                }
            }
        }
        Ok(())
    }
}

/// The place after so many steps; `None` if the legs are not so long.
fn along(base: i64, legs: &[(Direction, u32)], steps: u32) -> Option<i64> {
    let (mut place, mut left) = (base, steps);
    for (direction, length) in legs {
        let part = left.min(*length);
        place += if *direction == Direction::Forward { i64::from(part) } else { -i64::from(part) };
        left -= part;
    }
    // Who stands tells the steps of the movement before.
    (left == 0 || legs.is_empty()).then_some(place)
}
