//! The processor's side of \[F\]: control words in, sense word out. What words mean stands in the protocol; here their
//! meaning becomes a request to the set, and is shown.

use std::io::{self, Write};
use std::sync::Arc;

use axis_worker::ramp::Table;
use clap::Args;
use miette::miette;
use serde::Serialize;
use supersigma_protocol::words::{ControlWord, Meaning, MotionWord, SenseWord, SpeedLevel, WordAddress};
use supersigma_protocol::{AxisNumber, AxisReport, Direction};

use super::asked::Asked;
use super::exit::Exit;
use super::{SetArgs, show};
use crate::executive::{AxisState, Displacement, Request};

#[derive(Args)]
pub(super) struct WordArgs {
    #[command(flatten)]
    set: SetArgs,
    /// The axis, by number or name
    axis: String,
    /// How many steps, in hexadecimal; without words, R is only read
    #[arg(value_name = "U", requires = "control")]
    motion: Option<MotionWord>,
    /// Direction, halt, maximum speed and reference, in hexadecimal
    #[arg(value_name = "V")]
    control: Option<ControlWord>,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn word(args: &WordArgs) -> Result<(), Exit> {
    let given = match (args.motion, args.control) {
        (Some(motion), Some(control)) => Some(
            Meaning::of(motion, control)
                .map(|meaning| Given { motion, control, meaning })
                .map_err(|error| Exit::wrong(miette!("{error}")))?,
        ),
        _ => None,
    };
    let mut asked = Asked::connect(&args.set)?;
    let axis = asked.axis(&args.axis)?;
    let knowledge = Arc::clone(&asked.knowledge);
    let table = knowledge.table(axis)?;
    if let Some(given) = given.as_ref().filter(|_| !args.json) {
        given.show(axis, table, &mut io::stdout().lock())?;
    }
    let result = given.as_ref().map(|given| asked.operate(given.request(axis, table)));
    let failure = result.and_then(Result::err);
    // R tells the state of the axis, whatever has become of the motion.
    match asked.axis_states(Request::Status { axes: vec![axis] }) {
        Ok(states) => {
            let report = states.iter().find_map(|state: &AxisState| state.report);
            let view = View {
                axis: axis.get(),
                name: knowledge.name(axis),
                control: given.as_ref().map(|given| given.view(table)),
                sense: report.as_ref().map(SenseView::new),
            };
            view.show(axis, args.json, &mut io::stdout().lock())?;
        }
        Err(exit) if failure.is_none() => return Err(exit),
        Err(_) => {}
    }
    failure.map_or(Ok(()), Err)
}

/// U and V, and what they mean.
struct Given {
    motion: MotionWord,
    control: ControlWord,
    meaning: Meaning,
}

impl Given {
    /// What the set is asked to do.
    fn request(&self, axis: AxisNumber, table: &Table) -> Request {
        match self.meaning {
            Meaning::Halt => Request::Halt { axes: vec![axis] },
            Meaning::SeekReference => Request::SeekReference { axis },
            Meaning::Motion { direction, distance, level } => {
                let steps = i64::from(distance.get());
                Request::Move {
                    axis,
                    by: Displacement(if direction == Direction::Forward { steps } else { -steps }),
                    speed: (level != SpeedLevel::TOP).then(|| table.speed(level.limit())),
                    constant: false,
                    wait: true,
                }
            }
        }
    }

    fn show(&self, axis: AxisNumber, table: &Table, out: &mut dyn Write) -> io::Result<()> {
        let (u, v) = match self.meaning {
            Meaning::Halt => ("ignored".to_owned(), "halt".to_owned()),
            Meaning::SeekReference => ("ignored".into(), "seek the reference step".into()),
            Meaning::Motion { direction, distance, level } => {
                let sense = match direction {
                    Direction::Forward => "away from the origin",
                    Direction::TowardsOrigin => "towards the origin",
                };
                let (level, speed) = (level.get(), table.speed(level.limit()));
                (
                    format!("{} steps", distance.get()),
                    format!("{sense}, speed level {level}: at most {speed:.0} steps/s"),
                )
            }
        };
        let [motion, control] = [WordAddress::Motion(axis), WordAddress::Control(axis)].map(WordAddress::get);
        writeln!(out, "{motion:02X} <- U {}  {u}", self.motion)?;
        writeln!(out, "{control:02X} <- V {}  {v}", self.control)
    }

    fn view(&self, table: &Table) -> ControlView {
        ControlView {
            u: self.motion.to_string(),
            v: self.control.to_string(),
            meaning: match self.meaning {
                Meaning::Halt => MeaningView::Halt,
                Meaning::SeekReference => MeaningView::SeekReference,
                Meaning::Motion { direction, distance, level } => MeaningView::Motion {
                    direction,
                    steps: distance.get(),
                    level: level.get(),
                    steps_per_second: table.speed(level.limit()),
                },
            },
        }
    }
}

/// What went out and what came back, for programs.
#[derive(Serialize)]
struct View<'a> {
    axis: u8,
    name: &'a str,
    #[serde(flatten)]
    control: Option<ControlView>,
    /// Nothing if nobody plays the card.
    #[serde(flatten)]
    sense: Option<SenseView>,
}

#[derive(Serialize)]
struct ControlView {
    u: String,
    v: String,
    meaning: MeaningView,
}

#[derive(Serialize)]
#[serde(tag = "operation", rename_all = "snake_case")]
enum MeaningView {
    Halt,
    SeekReference,
    Motion { direction: Direction, steps: u16, level: u8, steps_per_second: f64 },
}

#[derive(Serialize)]
struct SenseView {
    r: String,
    /// X1..X5 as digits, X1 first.
    sense: String,
}

impl SenseView {
    fn new(report: &AxisReport) -> Self {
        Self { r: SenseWord::from(report.sense).to_string(), sense: report.sense.to_string() }
    }
}

impl View<'_> {
    fn show(&self, axis: AxisNumber, json: bool, out: &mut dyn Write) -> io::Result<()> {
        if json {
            return show::print_json(self, out);
        }
        let address = WordAddress::Motion(axis).get();
        match &self.sense {
            Some(SenseView { r, sense }) => writeln!(out, "{address:02X} -> R {r}  X1..X5 = {sense}"),
            None => writeln!(out, "{address:02X} -> R none, the worker of {axis} is gone"),
        }
    }
}

#[cfg(test)]
mod tests {
    use supersigma_config::RampConfig;

    use super::*;

    fn request(u: u16, v: u16) -> Request {
        let (motion, control) = (MotionWord(u), ControlWord::try_from(v).expect("no unused bit is set"));
        let meaning = Meaning::of(motion, control).expect("it means something");
        let axis = AxisNumber::new(3).expect("axis 3");
        let table = Table::new(&RampConfig::default()).expect("the default ramp is good");
        Given { motion, control, meaning }.request(axis, &table)
    }

    #[test]
    fn words_become_requests() {
        let axis = AxisNumber::new(3).expect("axis 3");
        let motion =
            |by, speed| Request::Move { axis, by: Displacement(by), speed, constant: false, wait: true };
        assert_eq!(request(0x0190, 0x0E00), motion(400, None));
        assert_eq!(request(0xFFFF, 0x8E00), motion(-65_535, None));
        assert_eq!(request(0x0190, 0x8000), motion(-400, Some(2e6 / 3_077.0)));
        assert_eq!(request(0x0190, 0x1E00), Request::Halt { axes: vec![axis] });
        assert_eq!(request(0x0190, 0x0F00), Request::SeekReference { axis });
    }

    #[test]
    fn the_speed_of_each_level_is_asked_for_so_that_its_own_ceiling_is_found() {
        let table = Table::new(&RampConfig::default()).expect("the default ramp is good");
        for level in SpeedLevel::all() {
            let found = table.index_at_most(table.speed(level.limit()));
            assert_eq!(table.period(found), table.period(level.limit()), "level {}", level.get());
        }
    }
}
