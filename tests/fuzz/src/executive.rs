//! Answers, and what else is heard of cards, into the executive, while it carries out requests.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use arbitrary::Unstructured;
use axis_worker::clock::TimeScale;
use ccu::executive::{
    Again, Begun, Common, Displacement, Executive, Failure, Heard, Knowledge, Leg, Link, LogTrouble, Operate,
    Request, Sent, Until,
};
use supersigma_protocol::{
    About, Activity, Address, Answer, AxisNumber, Broadcast, Command, Fault, Operation, Sequence, Tick, Ticks,
};

use crate::{frames, knowledge, taken};

/// So many requests one after the other.
const REQUESTS: usize = 8;

/// Makes requests of an executive to which `bytes` answer.
pub fn executive(bytes: &[u8]) {
    let asked = Rc::new(RefCell::new(Asked::default()));
    let mut link = Garbled {
        chance: Unstructured::new(bytes),
        knowledge: knowledge(),
        common: Arc::default(),
        now: Tick(0),
        sequence: Sequence(0),
        asked: Rc::clone(&asked),
        down: false,
    };
    let count = taken(link.chance.int_in_range(1..=REQUESTS));
    let requests: Vec<Request> = (0..count).map(|_| link.request()).collect();
    let mut executive = Executive::new(link);
    for request in requests {
        asked.borrow_mut().note(&request, &knowledge());
        // How it ends is the answers' business; that it ends, the executive's.
        let _ = executive.operate(request);
    }
    executive.abandon();
}

/// What somebody has asked for so far.
#[derive(Default)]
struct Asked {
    /// The axes that shall move.
    moving: BTreeSet<AxisNumber>,
    /// Raw bytes, or a record to be played: that may be anything.
    anything: bool,
    outputs: bool,
}

impl Asked {
    fn note(&mut self, request: &Request, knowledge: &Knowledge) {
        match request {
            Request::Originate { axes } => self.moving.extend(knowledge.axes(axes).unwrap_or_default()),
            Request::SeekReference { axis } | Request::Move { axis, .. } => drop(self.moving.insert(*axis)),
            Request::Line { parts, .. } => self.moving.extend(parts.iter().map(|(axis, _)| *axis)),
            Request::Path { legs, .. } => {
                self.moving.extend(legs.iter().flat_map(|leg| &leg.parts).map(|(axis, _)| *axis));
            }
            Request::Begin { request } => self.note(request, knowledge),
            Request::Send { .. } | Request::Replay { .. } => self.anything = true,
            Request::Output { .. } => self.outputs = true,
            _ => {}
        }
    }

    fn allows(&self, Command { to, operation }: Command) -> bool {
        self.anything
            || !operation.sets_going()
            || match (operation, AxisNumber::new(to.0)) {
                (Operation::WriteOutputs { .. }, _) => self.outputs,
                (_, Some(axis)) => self.moving.contains(&axis),
                (_, None) => !self.moving.is_empty(),
            }
    }
}

/// A bus on which anything may be said.
struct Garbled<'a> {
    chance: Unstructured<'a>,
    knowledge: Arc<Knowledge>,
    common: Arc<Common>,
    now: Tick,
    sequence: Sequence,
    asked: Rc<RefCell<Asked>>,
    /// Whether it has been said that the set goes down.
    down: bool,
}

impl Garbled<'_> {
    fn request(&mut self) -> Request {
        let axes = self.axes();
        let one = self.axis();
        let chance = &mut self.chance;
        let wait = taken(chance.arbitrary());
        let speed = taken(chance.arbitrary::<bool>()).then(|| taken(chance.arbitrary::<f64>()));
        match taken(chance.int_in_range(0_u8..=20)) {
            0 => Request::Originate { axes },
            1 => Request::SeekReference { axis: one },
            2 | 3 => Request::Move { axis: one, by: self.steps(), speed, constant: wait, wait },
            4 | 5 => Request::Line { parts: self.parts(), speed, wait },
            6 => {
                let legs = (0..3).map(|_| Leg { parts: self.parts(), speed }).collect();
                Request::Path { legs, wait }
            }
            7 => Request::Halt { axes },
            8 => Request::Brake { axes },
            9 => Request::Clear { axes },
            10 => Request::Status { axes },
            11 => Request::Output { bit: taken(chance.arbitrary()), on: wait },
            12 => Request::Digital { card: Address(taken(chance.int_in_range(8..=9))) },
            13 => Request::Inject { axis: one, fault: frames::fault(chance) },
            14 => Request::Wait { ticks: Ticks(taken(chance.arbitrary())) },
            15 => Request::Send { bytes: frames::command_bytes(chance) },
            16 => Request::Await { begun: vec![Begun(0), Begun(1)], until: Until::Any },
            17 => Request::Resume,
            18 => {
                let frames = (0..3).map(|_| self.again()).collect();
                Request::Replay { frames, shift: None, known: vec![] }
            }
            _ => {
                let by = self.steps();
                Request::Begin {
                    request: Box::new(Request::Move { axis: one, by, speed, constant: false, wait }),
                }
            }
        }
    }

    fn again(&mut self) -> Again {
        let at = frames::tick(&mut self.chance, self.now);
        let start = Some(frames::tick(&mut self.chance, self.now));
        let bytes = frames::command_bytes(&mut self.chance);
        Again { at, what: Sent::Command(Broadcast { bytes, at: start }), stand: self.axes() }
    }

    fn axis(&mut self) -> AxisNumber {
        AxisNumber::new(taken(self.chance.int_in_range(1_u8..=7))).expect("1 to 7")
    }

    fn axes(&mut self) -> Vec<AxisNumber> {
        let count = taken(self.chance.int_in_range(0_u8..=3));
        (0..count).map(|_| self.axis()).collect()
    }

    fn steps(&mut self) -> Displacement {
        if taken(self.chance.ratio(1_u8, 8)) {
            return Displacement(taken(self.chance.arbitrary()));
        }
        Displacement(taken(self.chance.arbitrary::<i16>()).into())
    }

    fn parts(&mut self) -> Vec<(AxisNumber, Displacement)> {
        self.axes().into_iter().map(|axis| (axis, self.steps())).collect()
    }

    /// Something that a card may say; often about what was asked last.
    fn answer(&mut self) -> Option<Answer> {
        let mut answer = frames::answer(&mut self.chance)?;
        if taken(self.chance.ratio(3_u8, 4)) {
            answer.card = Address(answer.card.0 % 10);
            answer.acted_at = self.now;
        }
        if taken(self.chance.ratio(3_u8, 4)) {
            let last = Sequence(self.sequence.0.saturating_sub(1));
            let result = match answer.about {
                About::Command(_, result) => result,
                About::Unasked(_) => Ok(()),
            };
            answer.about = About::Command(last, result);
        }
        Some(answer)
    }

    fn number(&mut self) -> Sequence {
        let sequence = self.sequence;
        self.sequence = sequence.next();
        sequence
    }
}

impl Link for Garbled<'_> {
    fn knowledge(&self) -> &Arc<Knowledge> {
        &self.knowledge
    }

    fn now(&self) -> Tick {
        self.now
    }

    fn ticks(&self, real: Duration) -> Ticks {
        TimeScale::REAL.ticks(real)
    }

    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        let asked = self.asked.borrow();
        match Command::decode(broadcast.bytes.as_slice()) {
            Ok(command) => assert!(asked.allows(command), "nobody has asked for {command:?}"),
            Err(refusal) => assert!(asked.anything, "{refusal}: {broadcast:?}"),
        }
        drop(asked);
        if taken(self.chance.ratio(1_u8, 32)) {
            return Err(Failure::WorkerGone { card: Address(taken(self.chance.arbitrary())) });
        }
        Ok(self.number())
    }

    fn inject(&mut self, _: AxisNumber, _: Fault) -> Result<Sequence, Failure> {
        Ok(self.number())
    }

    /// Ends with the bytes: what is heard then, once, is that the set goes down.
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        if self.chance.is_empty() {
            let told = std::mem::replace(&mut self.down, true);
            return if told { Err(Failure::GoingDown) } else { Ok(Some(Heard::GoingDown)) };
        }
        let card = Address(taken(self.chance.int_in_range(0_u8..=10)));
        match taken(self.chance.int_in_range(0_u8..=31)) {
            0 => return Ok(Some(Heard::WorkerGone(card))),
            1 => return Ok(Some(Heard::FramesLost(card, taken(self.chance.arbitrary())))),
            2 => return Ok(Some(Heard::Resume)),
            3 => {
                let trouble = LogTrouble { reason: "the disk is full".into(), advice: "make room".into() };
                return Ok(Some(Heard::NoLog(Arc::new(trouble))));
            }
            4 => return Err(Failure::Cancelled),
            5..=9 => {}
            _ => {
                let pause: u16 = taken(self.chance.arbitrary());
                self.now = (self.now + Ticks(pause.into())).min(until.max(self.now));
                if let Some(answer) = self.answer() {
                    return Ok(Some(Heard::Answer(answer)));
                }
            }
        }
        self.now = self.now.max(until);
        Ok(None)
    }

    fn activity(&self, axis: AxisNumber) -> Option<Activity> {
        (self.now.0 % 3 == u64::from(axis.get() % 3)).then_some(Activity::Cruising)
    }

    fn common(&self) -> Arc<Common> {
        Arc::clone(&self.common)
    }

    fn tell_resume(&self) {}
}
