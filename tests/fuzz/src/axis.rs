//! Frames, faults and time into a card. Two of them hear the same: one makes every pulse, the other goes by leaps; what
//! they say must be the same, byte for byte.

use std::sync::OnceLock;

use arbitrary::Unstructured;
use axis_worker::{Card, Sink};
use supersigma_config::{Config, Feedback, MotorConfig, ShortMoves};
use supersigma_protocol::{
    About, Activity, Answer, AxisReport, Body, Command, Fault, Frame, Occasion, Operation, Position, Report,
    Sender, Sequence, Steps, Switch, Tick, Ticks,
};

use crate::{frames, taken};

/// What happens one after the other.
const EVENTS: usize = 40;
/// How long nothing happens in between, at most: half a second.
const PAUSE: u64 = Tick::PER_SECOND / 2;
/// Who waits for an axis to stand waits for so many events of its own. A search that finds nothing makes 65 535 pulses in a
/// stage, and with a rotor each is looked at.
const OWN_EVENTS: usize = 400_000;

/// Puts what `bytes` make into a motor card.
pub fn axis(bytes: &[u8]) {
    let mut chance = Unstructured::new(bytes);
    let kind = taken(chance.int_in_range(0_u8..=15));
    let config = config(kind);
    let mut rig = Rig::new(&config);
    for _ in 0..EVENTS {
        if chance.is_empty() {
            break;
        }
        rig.happen(&mut chance);
    }
    rig.stand();
}

/// The set's first axis: mostly with an ideal motor, sometimes with a rotor, in open and in closed loop.
fn config(kind: u8) -> Config {
    static BUILT_IN: OnceLock<Config> = OnceLock::new();
    let mut config = BUILT_IN.get_or_init(Config::default_set).clone();
    if kind % 2 == 1 {
        config.ramp.short_moves = ShortMoves::Paper;
    }
    if kind >= 14 {
        config.axes[0].motor = Some(MotorConfig::bench());
    }
    if kind == 15 {
        config.axes[0].feedback = Feedback::Closed;
    }
    config
}

struct Rig {
    card: Card,
    leaping: Card,
    record: Record,
    said: Vec<Answer>,
    sequence: Sequence,
    length: u32,
}

/// What a card says, held against its pulses.
struct Record {
    answers: Vec<Answer>,
    /// What is being delivered.
    asked: Option<(Sequence, Operation)>,
    /// Something that moves an axis was accepted, and the axis has not come to a stand since.
    may_move: bool,
    /// Pulses since then.
    pulses: u32,
    /// Whether each pulse is a step, and nothing else is.
    counts: bool,
    /// Whether the position is where the carriage is: nothing was lost, no switch lied, no stop was run into.
    honest: bool,
    length: i32,
    e1: i32,
}

impl Sink for Record {
    const PULSES: bool = true;

    fn answer(&mut self, answer: Answer) {
        if let (About::Command(sequence, Ok(())), Some((asked, operation))) = (answer.about, self.asked)
            && sequence == asked
            && starts(operation)
        {
            self.may_move = true;
            self.pulses = 0;
        }
        if let Report::Axis(report) = answer.report {
            self.accounts_for(&report);
        }
        self.answers.push(answer);
    }

    fn pulse(&mut self, tick: Tick, position: Position) {
        assert!(self.may_move, "a pulse at {tick:?} that nobody has asked for, to {position:?}");
        self.pulses += 1;
        let e = position.0 + self.e1 + 1;
        assert!((0..=self.length).contains(&e), "{position:?} is beyond the rail");
        self.honest &= e > 0 && e < self.length;
    }
}

impl Record {
    fn accounts_for(&self, report: &AxisReport) {
        if self.counts {
            assert_eq!(report.steps, Steps(self.pulses), "{report:?}");
        }
    }
}

/// Whether an operation may be followed by pulses.
fn starts(operation: Operation) -> bool {
    matches!(
        operation,
        Operation::Move { .. }
            | Operation::MoveLimited { .. }
            | Operation::Slew { .. }
            | Operation::Originate
            | Operation::SeekReference
            | Operation::ArmLine { .. }
            | Operation::Rest
    )
}

impl Rig {
    fn new(config: &Config) -> Self {
        let axis = &config.axes[0];
        let card = || Card::axis(config, axis.address).expect("a good axis").expect("it exists");
        let rail = |steps: Steps| i32::try_from(steps.0).expect("a rail is short");
        let record = Record {
            answers: vec![],
            asked: None,
            may_move: false,
            pulses: 0,
            counts: axis.feedback == Feedback::Open,
            honest: axis.motor.is_none(),
            length: rail(axis.rail.length),
            e1: rail(axis.rail.lower_zone),
        };
        let (card, leaping) = (card(), card());
        let length = axis.rail.length.0;
        Self { card, leaping, record, said: vec![], sequence: Sequence(0), length }
    }

    fn happen(&mut self, chance: &mut Unstructured<'_>) {
        let now = self.card.now();
        match taken(chance.int_in_range(0_u8..=15)) {
            0 => {
                if let Some(frame) = frames::any(chance) {
                    self.hear(&frame);
                }
            }
            1..=7 => {
                let frame = frames::of_the_ccu(chance, self.sequence, now);
                self.hear(&frame);
            }
            8 => {
                let axis = self.card.as_axis().expect("a motor card").number();
                let body = Body::Fault(axis, frames::fault(chance));
                let sequence = self.sequence;
                self.hear(&Frame { sender: Sender::Ccu, sequence, tick: now, body });
            }
            9 => {
                self.card.orphan(&mut self.record);
                self.leaping.orphan(&mut self.said);
            }
            10 => {
                let answers = [self.card.speak(Occasion::Heartbeat), self.leaping.speak(Occasion::Heartbeat)];
                self.record.answer(answers[0]);
                self.said.push(answers[1]);
            }
            11 => self.stand(),
            _ => self.wait(Ticks(taken(chance.int_in_range(0..=PAUSE)))),
        }
        self.agree();
    }

    fn hear(&mut self, frame: &Frame) {
        let before = self.state();
        match &frame.body {
            Body::Command(broadcast) => {
                let command = Command::decode(broadcast.bytes.as_slice()).ok();
                self.record.asked = command.map(|command| (frame.sequence, command.operation));
            }
            Body::Fault(
                _,
                Fault::LostSteps(Steps(1..)) | Fault::Switch(Switch::StuckOpen | Switch::StuckClosed),
            ) => {
                self.record.honest = false;
            }
            _ => {}
        }
        let expected = frame.sequence == self.sequence;
        if frame.sender == Sender::Ccu {
            self.sequence = frame.sequence.next();
        }
        self.card.hear(frame, &mut self.record);
        self.leaping.hear(frame, &mut self.said);
        let refused = self.record.answers.iter().any(
            |answer| matches!(answer.about, About::Command(sequence, Err(_)) if sequence == frame.sequence),
        );
        if refused && expected {
            assert_eq!(self.state(), before, "{frame:?} was refused and changed something");
        }
        self.record.asked = None;
    }

    /// What a refusal leaves as it is.
    fn state(&mut self) -> (AxisReport, Option<Tick>) {
        let Report::Axis(report) = self.card.speak(Occasion::Heartbeat).report else {
            unreachable!("a motor card")
        };
        // Both say the same at the same time.
        let _ = self.leaping.speak(Occasion::Heartbeat);
        (report, self.card.next_event())
    }

    fn wait(&mut self, ticks: Ticks) {
        let to = self.card.now() + ticks;
        self.card.advance(to, &mut self.record);
        self.leaping.advance(to, &mut self.said);
    }

    /// Waits until nothing is due any more, but for a start that lies far ahead.
    fn stand(&mut self) {
        let far = self.card.now() + Ticks(1 << 33);
        for _ in 0..OWN_EVENTS {
            let Some(next) = self.card.next_event().filter(|next| *next < far) else { break };
            self.wait(next.since(self.card.now()));
        }
        self.agree();
        let (report, next) = self.state();
        let waits = report.activity == Activity::Armed && next.is_none_or(|next| next >= far);
        assert!(report.activity == Activity::Standing || waits, "it does not come to a stand: {report:?}");
        if self.record.honest
            && let Some(position) = report.position
        {
            let carriage = self.card.as_axis().expect("a motor card").mechanism();
            assert_eq!(position, carriage.position(), "{report:?}");
        }
        self.record.may_move = report.activity == Activity::Armed;
    }

    /// What both have said is the same, and so is where they are.
    fn agree(&mut self) {
        assert_eq!(self.record.answers, self.said);
        self.record.answers.clear();
        self.said.clear();
        let carriages = [&self.card, &self.leaping]
            .map(|card| card.as_axis().expect("a motor card").mechanism().carriage());
        assert_eq!(carriages[0], carriages[1]);
        assert!(carriages[0] <= self.length);
    }
}
