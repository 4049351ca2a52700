//! The picture: frames in, state out. It keeps what was last said, counts what went by, and words what somebody should
//! look at; who draws it, and where the frames come from, it does not know.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use supersigma_config::Config;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Address, AxisNumber, Body, CardKind, Frame, Occasion, Report, Sender, Sequence, Tick,
};

use super::axis::AxisPicture;
use super::frames::{Frames, Passage};
use super::history::{Rate, slot};
use super::snapshot::{Detail, DigitalSnapshot, EventView, LaneCounts, LineView, SetView, Snapshot};
use crate::control::Description;
use crate::log::{AxisNames, Event, EventWatch, Level, sender_name};

/// How many events are kept.
const EVENTS: usize = 200;

/// A set, as its frames show it. All times are real time since the watching began; in a replay, the log's.
#[derive(Debug)]
pub struct Picture {
    config: Config,
    names: AxisNames,
    set: Option<SetView>,
    tick: Tick,
    lanes: [Counted; 2],
    expected: BTreeMap<Sender, Sequence>,
    lost: u64,
    dropped: u64,
    axes: BTreeMap<AxisNumber, AxisPicture>,
    words: BTreeMap<Address, u16>,
    frames: Frames,
    watch: EventWatch,
    events: VecDeque<EventView>,
    event_count: u64,
}

#[derive(Debug, Default)]
struct Counted {
    total: u64,
    rate: Rate,
}

impl Counted {
    fn view(&self) -> LaneCounts {
        LaneCounts { total: self.total, per_second: self.rate.per_second() }
    }
}

impl Picture {
    /// A set that nothing is known of but how it is configured.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let names = AxisNames::from(&config);
        let axes = config.axes.iter().map(|axis| (axis.address, AxisPicture::new(axis.clone()))).collect();
        Self {
            names: names.clone(),
            set: None,
            tick: Tick(0),
            lanes: Default::default(),
            expected: BTreeMap::new(),
            lost: 0,
            dropped: 0,
            axes,
            words: BTreeMap::new(),
            frames: Frames::new(names),
            watch: EventWatch::default(),
            events: VecDeque::new(),
            event_count: 0,
            config,
        }
    }

    /// The set's configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Takes what the set says of itself. What its cards have said on the bus is newer and stays.
    pub fn describe(&mut self, at: Duration, set: &Description) {
        self.advance(at);
        let before = self.set.as_ref().and_then(|set| set.recorder.trouble.as_ref());
        if let Some(trouble) = set.recorder.trouble.as_ref().filter(|trouble| before != Some(*trouble)) {
            let message = format!("{}; nothing moves without a log", trouble.reason);
            self.event(Event::new(Level::Error, "recorder".to_owned(), message));
        }
        self.set = Some(set.into());
        for state in &set.axes {
            let Some(axis) = self.axes.get_mut(&state.axis) else { continue };
            axis.describe(at, state.report);
        }
        for (card, word) in [(Address::DIGITAL_INPUT, set.inputs), (Address::DIGITAL_OUTPUT, set.outputs)] {
            if let Some(word) = word {
                self.words.entry(card).or_insert(word);
            }
        }
    }

    /// Takes one frame's bytes, as they were on the bus.
    pub fn take(&mut self, at: Duration, lane: Lane, bytes: &[u8]) {
        self.advance(at);
        let counted = &mut self.lanes[lane as usize];
        counted.total += 1;
        counted.rate.count();
        let frame = Frame::decode(bytes);
        self.frames.keep(lane, bytes, frame.as_ref());
        match &frame {
            Ok(frame) => self.see(at, frame),
            Err(error) => self.event(Event::undecodable(bytes, error)),
        }
    }

    /// Takes note that this watcher has missed `frames` frames, which the set has not lost.
    pub fn miss(&mut self, frames: u64) {
        if frames > 0 {
            self.dropped += frames;
            // Whose they were, nobody knows.
            self.expected.clear();
        }
    }

    /// Lets time pass: rates fall, histories go on, silent axes are gone.
    pub fn advance(&mut self, at: Duration) {
        for counted in &mut self.lanes {
            counted.rate.advance(slot(at));
        }
        let silent = Duration::from_millis(self.config.supervision.silent_ms.into());
        for axis in self.axes.values_mut() {
            axis.advance(at, silent);
        }
    }

    /// The picture now, in so much detail.
    #[must_use]
    pub fn snapshot(&self, detail: &Detail) -> Snapshot {
        let digital = &self.config.digital;
        let inputs = digital.inputs.iter().map(|line| (line.bit, line.name.as_str()));
        let outputs = digital.outputs.iter().map(|line| (line.bit, line.name.as_str()));
        Snapshot {
            set: self.set.clone(),
            tick: self.tick,
            time_s: self.tick.since(Tick(0)).as_seconds(),
            commands: self.lanes[Lane::Commands as usize].view(),
            answers: self.lanes[Lane::Answers as usize].view(),
            lost: self.lost,
            dropped: self.dropped,
            axes: self.axes.values().map(|axis| axis.snapshot(detail.history)).collect(),
            inputs: self.digital(Address::DIGITAL_INPUT, inputs),
            outputs: self.digital(Address::DIGITAL_OUTPUT, outputs),
            frames: self.frames.last(&detail.filter, detail.frames),
            frames_title: self.frames.title(),
            events: self
                .events
                .iter()
                .skip(self.events.len().saturating_sub(detail.events))
                .cloned()
                .collect(),
        }
    }

    /// The frames since a place, for one who wants each of them once; place 0 is before the first one. With `all`, also
    /// samples and heartbeats, which have places of their own.
    #[must_use]
    pub fn frames_from(&self, place: u64, all: bool) -> Passage {
        self.frames.passage(place, all)
    }

    /// The events that are kept and came after the one with this number; 0 is before the first one.
    pub fn events_after(&self, number: u64) -> impl Iterator<Item = &EventView> {
        self.events.iter().filter(move |event| event.number > number)
    }

    fn digital<'a>(&self, card: Address, lines: impl Iterator<Item = (u8, &'a str)>) -> DigitalSnapshot {
        let word = self.words.get(&card).copied();
        let line = |(bit, name): (u8, &str)| LineView {
            bit,
            name: name.to_owned(),
            on: word.map(|word| word >> bit & 1 == 1),
        };
        DigitalSnapshot { word, lines: lines.map(line).collect() }
    }

    fn see(&mut self, at: Duration, frame: &Frame) {
        self.tick = self.tick.max(frame.tick);
        self.look_for_gap(frame);
        if let Body::Answer(answer) = &frame.body {
            match (answer.card.kind(), answer.report) {
                (CardKind::Axis(number), Report::Axis(report)) => {
                    if let Some(axis) = self.axes.get_mut(&number) {
                        axis.hear(at, report);
                        if answer.about == About::Unasked(Occasion::Leaving) {
                            axis.gone();
                        }
                    }
                }
                (_, Report::Digital(word)) => {
                    self.words.insert(answer.card, word);
                }
                (_, Report::Axis(_)) => {}
            }
        }
        for event in self.watch.events(frame, &self.names) {
            self.event(event);
        }
    }

    fn look_for_gap(&mut self, frame: &Frame) {
        let due = self.expected.insert(frame.sender, frame.sequence.next());
        // Number 0 begins a new life.
        let Some(due) = due.filter(|_| frame.sequence != Sequence(0)) else { return };
        let lost = frame.sequence.0.saturating_sub(due.0);
        if lost > 0 {
            self.lost = self.lost.saturating_add(lost);
            let message = format!("{lost} frames lost: number {} was due, {} came", due.0, frame.sequence.0);
            let name = sender_name(frame.sender, &self.names).into_owned();
            self.event(Event::new(Level::Error, name, message));
        }
    }

    fn event(&mut self, event: Event) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.event_count += 1;
        self.events.push_back(EventView {
            number: self.event_count,
            time_s: self.tick.since(Tick(0)).as_seconds(),
            error: event.level == Level::Error,
            name: event.name,
            message: event.message,
        });
    }
}
