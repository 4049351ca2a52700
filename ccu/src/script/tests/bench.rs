//! A set in memory for these tests: real cards over virtual time, driven by the real executive.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axis_worker::Card;
use supersigma_config::Config;
use supersigma_protocol::{Answer, AxisNumber, Body, Broadcast, Fault, Frame, Sender, Sequence, Tick, Ticks};

use crate::executive::{Common, Executive, Failure, Heard, Knowledge, Link, Movement};
use crate::script::{Limits, Program, ScriptError, Settings, Watcher, lock};

/// Cards on one bus, all at the same tick.
pub(super) struct Bench {
    knowledge: Arc<Knowledge>,
    cards: Vec<Card>,
    now: Tick,
    sequence: Sequence,
    common: Arc<Common>,
    heard: VecDeque<Heard>,
    /// An emergency input that will close.
    pub(super) emergency: Option<(Tick, AxisNumber, Fault)>,
    /// A failure of the way to the set.
    pub(super) failure: Option<(Tick, Failure)>,
    /// Somebody who wants the program to end.
    pub(super) stop: Option<(Tick, Arc<AtomicBool>)>,
}

impl Bench {
    fn new(config: Config) -> Self {
        let knowledge = Knowledge::new(config).expect("good ramps");
        let config = &knowledge.config;
        let mut cards = vec![Card::digital(config)];
        for axis in &config.axes {
            cards.push(Card::axis(config, axis.address).expect("a good ramp").expect("it exists"));
        }
        let (now, sequence, heard) = (Tick(0), Sequence(0), VecDeque::new());
        let common = Arc::default();
        Self { knowledge, common, cards, now, sequence, heard, emergency: None, failure: None, stop: None }
    }

    /// The number of an axis.
    pub(super) fn axis(&self, name: &str) -> AxisNumber {
        self.knowledge.config.find_axis(name).expect("it exists").address
    }

    /// The position of the carriage itself, in steps from where the limit switch opens.
    fn carriage(&self, name: &str) -> i32 {
        let axis = self.knowledge.config.find_axis(name).expect("it exists");
        let card = self.cards.iter().find(|card| card.address() == axis.address.address()).expect("it plays");
        card.as_axis().expect("a motor card").mechanism().position().0
    }

    fn seconds(&self) -> f64 {
        self.now.since(Tick(0)).as_seconds()
    }

    /// The next tick at which anything happens.
    fn next(&self) -> Option<Tick> {
        let cards = self.cards.iter().filter_map(Card::next_event);
        let emergency = self.emergency.as_ref().map(|(tick, ..)| *tick);
        let failure = self.failure.as_ref().map(|(tick, _)| *tick);
        let stop = self.stop.as_ref().map(|(tick, _)| *tick);
        cards.chain(emergency).chain(failure).chain(stop).min()
    }

    fn put(&mut self, body: Body) -> Sequence {
        let sequence = self.sequence;
        self.sequence = sequence.next();
        let frame = Frame { sender: Sender::Ccu, sequence, tick: self.now, body };
        let mut answers: Vec<Answer> = Vec::new();
        for card in &mut self.cards {
            card.hear(&frame, &mut answers);
        }
        self.heard.extend(answers.into_iter().map(Heard::Answer));
        sequence
    }

    fn advance(&mut self, to: Tick) {
        let mut answers: Vec<Answer> = Vec::new();
        for card in &mut self.cards {
            card.advance(to, &mut answers);
        }
        self.now = to;
        self.heard.extend(answers.into_iter().map(Heard::Answer));
        if let Some((_, axis, fault)) = self.emergency.take_if(|(tick, ..)| *tick <= to) {
            self.put(Body::Fault(axis, fault));
        }
        if let Some((_, stop)) = self.stop.take_if(|(tick, _)| *tick <= to) {
            stop.store(true, Ordering::Relaxed);
        }
    }
}

impl Link for Bench {
    fn knowledge(&self) -> &Arc<Knowledge> {
        &self.knowledge
    }

    fn now(&self) -> Tick {
        self.now
    }

    fn ticks(&self, real: Duration) -> Ticks {
        Ticks::from_millis(u64::try_from(real.as_millis()).expect("a short time"))
    }

    fn common(&self) -> Arc<Common> {
        Arc::clone(&self.common)
    }

    fn tell_resume(&self) {}

    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        Ok(self.put(Body::Command(broadcast)))
    }

    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure> {
        Ok(self.put(Body::Fault(axis, fault)))
    }

    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        while self.heard.is_empty() && self.now < until {
            let next = self.next().unwrap_or(until).clamp(self.now, until);
            self.advance(next);
            if let Some((_, failure)) = self.failure.take_if(|(tick, _)| *tick <= next) {
                return Err(failure);
            }
        }
        Ok(self.heard.pop_front())
    }
}

/// What a run has brought forth.
#[derive(Debug, Default)]
pub(super) struct Seen {
    pub(super) movements: Vec<Movement>,
    pub(super) printed: Vec<String>,
}

/// A set, and what is seen of it while programs run on it.
pub(super) struct Rig {
    pub(super) executive: Arc<Mutex<Executive<Bench>>>,
    pub(super) knowledge: Arc<Knowledge>,
    pub(super) seen: Arc<Mutex<Seen>>,
    pub(super) limits: Limits,
    /// What has to be printed so that the program is stopped, as by a hand on the keyboard.
    pub(super) stop_at: Option<&'static str>,
}

struct Observer {
    seen: Arc<Mutex<Seen>>,
    limits: Limits,
    stop_at: Option<&'static str>,
}

impl Watcher for Observer {
    fn movement(&mut self, movement: &Movement) {
        lock(&self.seen).movements.push(*movement);
    }

    fn print(&mut self, text: &str) {
        lock(&self.seen).printed.push(text.into());
        if self.stop_at == Some(text) {
            self.limits.stop.store(true, Ordering::Relaxed);
        }
    }
}

impl Rig {
    pub(super) fn new() -> Self {
        let bench = Bench::new(Config::default_set());
        let knowledge = Arc::clone(&bench.knowledge);
        // Every test ends, even of a program that should have ended by itself.
        let limits = Limits { operations: Some(1_000_000), ..Limits::default() };
        Self {
            executive: Arc::new(Mutex::new(Executive::new(bench))),
            knowledge,
            seen: Arc::default(),
            limits,
            stop_at: None,
        }
    }

    /// A set whose axes have been originated.
    pub(super) fn ready() -> Self {
        let rig = Self::new();
        rig.run("origin()").expect("a set can be originated");
        *lock(&rig.seen) = Seen::default();
        rig
    }

    pub(super) fn run(&self, source: &str) -> Result<(), ScriptError> {
        self.run_with(source, Settings::new())
    }

    pub(super) fn run_with(&self, source: &str, settings: Settings) -> Result<(), ScriptError> {
        let program = Program::compile("test.rhai", source)?.with(settings)?;
        let (seen, limits) = (Arc::clone(&self.seen), self.limits.clone());
        let observer = Observer { seen, limits, stop_at: self.stop_at };
        program.run(Arc::clone(&self.executive), Arc::clone(&self.knowledge), observer, &self.limits)
    }

    /// What a program prints that runs to its end.
    pub(super) fn prints(&self, source: &str) -> Vec<String> {
        if let Err(error) = self.run(source) {
            panic!("{:?}", miette::Report::new(error));
        }
        self.printed()
    }

    /// What has been printed since the last look.
    pub(super) fn printed(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.seen).printed)
    }

    pub(super) fn fails(&self, source: &str) -> ScriptError {
        self.run(source).expect_err("it must not run to its end")
    }

    pub(super) fn movements(&self) -> Vec<Movement> {
        std::mem::take(&mut lock(&self.seen).movements)
    }

    pub(super) fn carriage(&self, name: &str) -> i32 {
        lock(&self.executive).link().carriage(name)
    }

    pub(super) fn seconds(&self) -> f64 {
        lock(&self.executive).link().seconds()
    }

    /// Has something happen `milliseconds` from now.
    pub(super) fn later(&self, milliseconds: u64, plan: impl FnOnce(&mut Bench, Tick)) {
        let mut executive = lock(&self.executive);
        let bench = executive.link_mut();
        let tick = bench.now + Ticks::from_millis(milliseconds);
        plan(bench, tick);
    }
}
