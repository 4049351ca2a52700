//! Generated runs: whatever is commanded, and whatever is done to the axes, fresh machines say the same again; and one
//! bit that is changed anywhere is found. The cards are driven here as a worker drives them, at odd ticks, with frames
//! that never come and a CCU that goes away; the dry set and its log are in `tests/e2e/replay.rs`.

use std::convert::Infallible;
use std::fs;
use std::path::Path;
use std::time::Duration;

use axis_worker::Card;
use axis_worker::clock::TimeScale;
use proptest::prelude::*;
use supersigma_config::{Config, Feedback, MotorConfig};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Address, Answer, AxisNumber, Body, Broadcast, Command, CommandBytes, Direction, Distance, End,
    Fault, Frame, Occasion, Operation, Sender, Sequence, SpeedIndex, Steps, Switch, Tick, Ticks,
};

use super::{DifferenceKind, ReplayError, Setting, Verification, Why, verify};
use crate::log::{AxisNames, LogHeader, LogWriter, LoggedFrame, Timeline, TwinReader, Twinned, WallTime};

impl From<Infallible> for ReplayError {
    fn from(never: Infallible) -> Self {
        match never {}
    }
}

/// Axis 1 as it is built in, axis 2 with a motor that loses steps, axis 3 in closed loop; and the digital cards.
fn config() -> Config {
    let mut config = Config::default_set();
    config.axes.truncate(3);
    config.axes[1].motor = Some(MotorConfig::bench());
    config.axes[2].motor = Some(MotorConfig::bench());
    config.axes[2].feedback = Feedback::Closed;
    config
}

/// What happens next to a set.
#[derive(Debug, Clone)]
enum Event {
    Command(Command),
    Raw(Vec<u8>),
    Fault(AxisNumber, Fault),
    /// Lead and own steps of two axes, then one start for all.
    Line {
        lead: Distance,
        own: [(Direction, Distance); 2],
        in_ticks: u64,
        halt_after: Option<u64>,
    },
    /// A frame of the CCU that one card never gets.
    Missed(u8),
    /// Cards say that they are alive.
    Heartbeat,
    /// One card's process is killed and another one joins.
    Anew(u8),
}

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

fn movement() -> impl Strategy<Value = (Direction, Distance)> {
    let direction = prop_oneof![Just(Direction::Forward), Just(Direction::TowardsOrigin)];
    let steps = prop_oneof![1..400_u16, 400..6_000_u16];
    (direction, steps.prop_map(|steps| Distance::new(steps).expect("not 0")))
}

fn operation() -> impl Strategy<Value = Operation> {
    let speed = (0..=232_u8).prop_map(|speed| SpeedIndex::new(speed).expect("in the table"));
    prop_oneof![
        4 => movement().prop_map(|(direction, distance)| Operation::Move { direction, distance }),
        2 => (movement(), speed.clone())
            .prop_map(|((direction, distance), limit)| Operation::MoveLimited { direction, distance, limit }),
        1 => (movement(), speed)
            .prop_map(|((direction, distance), speed)| Operation::Slew { direction, distance, speed }),
        2 => Just(Operation::Originate),
        1 => Just(Operation::SeekReference),
        1 => Just(Operation::Status),
        2 => Just(Operation::Halt),
        1 => Just(Operation::Brake),
        3 => Just(Operation::Clear),
    ]
}

fn event() -> impl Strategy<Value = Event> {
    let fault = prop_oneof![
        Just(Fault::Force),
        Just(Fault::Limit(End::Lower)),
        Just(Fault::Limit(End::Upper)),
        (0..300_u32).prop_map(|steps| Fault::LostSteps(Steps(steps))),
        Just(Fault::Switch(Switch::Free)),
        Just(Fault::Switch(Switch::StuckOpen)),
        Just(Fault::Switch(Switch::StuckClosed)),
    ];
    let line = (movement(), movement(), 0..400_000_u64, prop::option::of(1..2_000_000_u64));
    prop_oneof![
        8 => (0..=3_u8, operation()).prop_map(|(to, operation)| Event::Command(Command::new(Address(to), operation))),
        2 => any::<u16>().prop_map(|word| {
            Event::Command(Command::new(Address::DIGITAL_OUTPUT, Operation::WriteOutputs { word }))
        }),
        1 => Just(Event::Command(Command::new(Address::DIGITAL_INPUT, Operation::ReadInputs))),
        1 => prop::collection::vec(0..12_u8, 0..=8).prop_map(Event::Raw),
        3 => (1..=3_u8, fault).prop_map(|(number, fault)| Event::Fault(axis(number), fault)),
        2 => line.prop_map(|(one, other, in_ticks, halt_after)| Event::Line {
            lead: one.1.max(other.1), own: [one, other], in_ticks, halt_after,
        }),
        1 => (1..=3_u8).prop_map(Event::Missed),
        1 => Just(Event::Heartbeat),
        1 => prop_oneof![1..=3_u8, Just(8)].prop_map(Event::Anew),
    ]
}

/// Events with the ticks between them, and whether the CCU goes away in the end.
fn script() -> impl Strategy<Value = (Vec<(u64, Event)>, bool)> {
    let pause = prop_oneof![0..2_000_u64, 2_000..1_000_000_u64];
    let origin = Event::Command(Command::new(Address::EVERYONE, Operation::Originate));
    let start = prop_oneof![Just(vec![]), Just(vec![(10, origin), (14_000_000, Event::Heartbeat)])];
    (start, prop::collection::vec((pause, event()), 1..16), any::<bool>())
        .prop_map(|(start, events, orphaned)| (start.into_iter().chain(events).collect(), orphaned))
}

/// Cards as workers drive them, and everything that is on their bus.
struct Bench {
    config: Config,
    now: Tick,
    sequence: Sequence,
    seats: Vec<(Card, Sequence)>,
    /// The number of the next frame of the CCU that a card does not get.
    deaf: Option<(u8, Sequence)>,
    frames: Vec<Frame>,
}

impl Bench {
    fn new() -> Self {
        let config = config();
        let mut bench =
            Self { config, now: Tick(0), sequence: Sequence(0), seats: vec![], deaf: None, frames: vec![] };
        for card in [1, 2, 3, 8] {
            let seat = bench.join(card);
            bench.seats.push(seat);
        }
        bench
    }

    fn join(&mut self, card: u8) -> (Card, Sequence) {
        let card = match AxisNumber::new(card) {
            Some(number) => Card::axis(&self.config, number).expect("a good axis").expect("it is there"),
            None => Card::digital(&self.config),
        };
        let mut seat = (card, Sequence(0));
        let mut said = Vec::new();
        // A worker is there a little after the set's tick 0.
        seat.0.advance(self.now + Ticks(77), &mut said);
        said.push(seat.0.speak(Occasion::Joined));
        self.put(&mut seat, said);
        seat
    }

    fn put(&mut self, (card, sequence): &mut (Card, Sequence), said: Vec<Answer>) {
        for answer in said {
            // A frame leaves a little after the card has acted.
            let tick = card.now() + Ticks(3);
            let sender = Sender::Card(card.address());
            self.frames.push(Frame { sender, sequence: *sequence, tick, body: Body::Answer(answer) });
            *sequence = sequence.next();
        }
    }

    /// Every card does `what` at its own moment: a worker wakes when the system lets it.
    fn each(&mut self, mut what: impl FnMut(&mut Card, &mut Vec<Answer>)) {
        let mut seats = std::mem::take(&mut self.seats);
        for (late, seat) in seats.iter_mut().enumerate() {
            let mut said = Vec::new();
            seat.0.advance(seat.0.now().max(self.now + Ticks(100 * late as u64 + 13)), &mut said);
            what(&mut seat.0, &mut said);
            self.put(seat, said);
        }
        self.seats = seats;
    }

    fn send(&mut self, body: Body) {
        let frame = Frame { sender: Sender::Ccu, sequence: self.sequence, tick: self.now, body };
        self.sequence = self.sequence.next();
        self.frames.push(frame.clone());
        let deaf = self.deaf.filter(|(_, sequence)| *sequence == frame.sequence).map(|(card, _)| card);
        self.each(|card, said| {
            if Some(card.address().0) != deaf {
                card.hear(&frame, said);
            }
        });
    }

    fn command(&mut self, command: Command, at: Option<Tick>) {
        self.send(Body::Command(Broadcast { at, ..command.into() }));
    }

    fn happen(&mut self, pause: u64, event: &Event) {
        // A bus has time between two frames.
        self.now += Ticks(pause + 1_000);
        match event {
            Event::Command(command) => self.command(*command, None),
            Event::Raw(bytes) => {
                let bytes = CommandBytes::try_from(bytes.clone()).expect("short enough");
                self.send(Body::Command(Broadcast { bytes, at: None }));
            }
            Event::Fault(axis, fault) => self.send(Body::Fault(*axis, *fault)),
            Event::Line { lead, own, in_ticks, halt_after } => {
                for (number, (direction, distance)) in (1..).zip(*own) {
                    let lead = Operation::Lead { distance: *lead, limit: None };
                    for operation in [lead, Operation::ArmLine { direction, distance }] {
                        self.now += Ticks(1_000);
                        self.command(Command::new(Address(number), operation), None);
                    }
                }
                let at = self.now + Ticks(*in_ticks);
                self.now += Ticks(1_000);
                self.command(Command::new(Address::EVERYONE, Operation::Go), Some(at));
                if let Some(after) = halt_after {
                    self.now += Ticks(1_000);
                    self.command(Command::new(Address::EVERYONE, Operation::Halt), Some(at + Ticks(*after)));
                }
            }
            Event::Missed(card) => {
                self.deaf = Some((*card, self.sequence));
                self.command(Command::new(Address::EVERYONE, Operation::Status), None);
            }
            Event::Heartbeat => self.each(|card, said| said.push(card.speak(Occasion::Heartbeat))),
            Event::Anew(card) => {
                // The new process comes after everything that the old one has said.
                self.now += Ticks(1_000);
                let anew = self.join(*card);
                let seat = self.seats.iter_mut().find(|(seat, _)| seat.address() == Address(*card));
                *seat.expect("all cards have a seat") = anew;
            }
        }
    }

    fn end(mut self, orphaned: bool) -> Vec<Frame> {
        self.now += Ticks(1_000);
        if orphaned {
            self.each(|card, said| {
                if card.next_event().is_some() {
                    card.orphan(said);
                }
            });
        }
        self.now += Ticks(6_000_000);
        self.each(|card, said| said.push(card.speak(Occasion::Leaving)));
        // As a log has them: by tick, and an answer after its command.
        self.frames.sort_by_key(|frame| frame.tick);
        self.frames
    }
}

fn run((events, orphaned): &(Vec<(u64, Event)>, bool)) -> Vec<Frame> {
    let mut bench = Bench::new();
    for (pause, event) in events {
        bench.happen(*pause, event);
    }
    bench.end(*orphaned)
}

fn twinned(frames: impl IntoIterator<Item = Vec<u8>>) -> impl Iterator<Item = Result<Twinned, Infallible>> {
    (1..).zip(frames).map(|(number, bytes)| {
        let frame = Frame::decode(&bytes);
        let logged = LoggedFrame { log_time: WallTime(0), lane: Lane::Answers, bytes, frame };
        Ok(Twinned { number, logged, twin: None })
    })
}

fn verified(frames: impl IntoIterator<Item = Vec<u8>>) -> Verification {
    let config = config();
    let names = AxisNames::from(&config);
    verify(&Setting { config: &config, names: &names, twins: false }, twinned(frames)).expect("good axes")
}

/// The frame with what a machine cannot know from another one: the ticks, and why its process lets it speak.
fn as_asked(mut frame: Frame, other: &Frame) -> Frame {
    let own =
        |about| matches!(about, About::Unasked(Occasion::Joined | Occasion::Heartbeat | Occasion::Leaving));
    frame.tick = other.tick;
    if let (Body::Answer(answer), Body::Answer(other)) = (&mut frame.body, &other.body) {
        answer.acted_at = other.acted_at;
        if own(answer.about) && own(other.about) {
            answer.about = other.about;
        }
    }
    frame
}

fn answers(frames: &[Frame]) -> Vec<usize> {
    let is_answer = |frame: &Frame| matches!(frame.body, Body::Answer(_));
    (0..frames.len()).filter(|at| is_answer(&frames[*at])).collect()
}

/// Writes the frames into a log, and reads it again.
fn through_a_log(path: &Path, frames: &[Frame]) -> Vec<Twinned> {
    let config = config();
    let header = LogHeader {
        version: LogHeader::VERSION.to_owned(),
        set: "test".to_owned(),
        names: AxisNames::from(&config),
        timeline: Timeline { epoch: WallTime(1_700_000_000_000_000_000), scale: TimeScale::REAL },
        config: config.to_toml(),
        script: None,
    };
    let mut writer = LogWriter::create(path, header, Duration::from_millis(100)).expect("a new file");
    for frame in frames {
        let lane = if frame.sender == Sender::Ccu { Lane::Commands } else { Lane::Answers };
        let gap = writer.record(lane, &frame.encode(), frame.tick);
        assert_eq!(gap, None);
        writer.advance(frame.tick).expect("the disk has room");
    }
    writer.finish().expect("the disk has room");
    TwinReader::open(path).expect("a log").map(|one| one.expect("whole")).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// 150 runs: all is identical; and one bit of one answer is found by the machines alone, but for what
    /// was asked of them: when a frame was sent, when a machine that stands was asked, and why, it cannot know.
    #[test]
    fn machines_say_the_same_again(script in script(), at: prop::sample::Index, bit: prop::sample::Index) {
        let frames = run(&script);
        let bytes: Vec<Vec<u8>> = frames.iter().map(Frame::encode).collect();
        let found = verified(bytes.clone());
        prop_assert!(found.is_identical(), "{found:?}");
        let all = answers(&frames);
        prop_assert_eq!(found.answers, all.len() as u64);

        let at = all[at.index(all.len())];
        let mut changed = bytes;
        let bit = bit.index(changed[at].len() * 8);
        changed[at][bit / 8] ^= 1 << (bit % 8);
        let another_question = Frame::decode(&changed[at]).is_ok_and(|frame| as_asked(frame, &frames[at]) == frames[at]);
        let found = verified(changed);
        if !another_question {
            let undecodable = found.undecodable > 0;
            prop_assert!(!found.is_identical() || undecodable, "bit {bit} of frame {} {:?}", at + 1, frames[at]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// 60 runs through a log: with the twins beside them, one bit anywhere is found where it is, whatever it means.
    #[test]
    fn one_bit_of_a_log_is_found_where_it_is(script in script(), at: prop::sample::Index, bit: prop::sample::Index) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("run.mcap");
        let mut logged = through_a_log(&path, &run(&script));
        let config = config();
        let names = AxisNames::from(&config);
        let setting = Setting { config: &config, names: &names, twins: true };
        let again = |frames: &[Twinned]| {
            verify(&setting, frames.iter().cloned().map(Ok::<_, Infallible>)).expect("good axes")
        };
        let found = again(&logged);
        prop_assert!(found.is_identical(), "{found:?}");

        let at = at.index(logged.len());
        let one = &mut logged[at];
        let bit = bit.index(one.logged.bytes.len() * 8);
        one.logged.bytes[bit / 8] ^= 1 << (bit % 8);
        one.logged.frame = Frame::decode(&one.logged.bytes);
        let found = again(&logged);
        let found = found.difference.map(|difference| difference.number);
        prop_assert_eq!(found, Some(at as u64 + 1), "bit {} of {:?}", bit, logged[at]);
        fs::remove_file(path).expect("it is there");
    }
}

/// A move of axis 1, seen by everybody, with heartbeats after it.
fn a_move() -> Vec<Frame> {
    let mut bench = Bench::new();
    let origin = Command::new(Address(1), Operation::Originate);
    bench.happen(0, &Event::Command(origin));
    for _ in 0..5 {
        bench.happen(4_000_000, &Event::Heartbeat);
    }
    bench.happen(0, &Event::Fault(axis(1), Fault::Force));
    bench.end(false)
}

fn bytes(frames: &[Frame]) -> Vec<Vec<u8>> {
    frames.iter().map(Frame::encode).collect()
}

fn of_card(frames: &[Frame], card: u8) -> Vec<usize> {
    (0..frames.len()).filter(|at| frames[*at].sender == Sender::Card(Address(card))).collect()
}

#[test]
fn frames_that_the_recorder_has_lost_end_one_cards_verification() {
    let mut frames = a_move();
    let all = answers(&frames).len() as u64;
    let of_one = of_card(&frames, 1);
    frames.remove(of_one[5]);
    let found = verified(bytes(&frames));
    assert_eq!(found.difference, None);
    let [one] = &found.unverifiable[..] else { panic!("{found:?}") };
    assert_eq!((one.card, one.number), (Address(1), of_one[6] as u64));
    assert_eq!(one.why, Why::Gap { expected: Sequence(5), got: Sequence(6) });
    assert_eq!(
        found.answers,
        all - of_one.len() as u64 + 5,
        "what stands before the gap, and the other cards"
    );
}

#[test]
fn a_command_that_is_not_in_the_log_is_no_difference() {
    let mut frames = a_move();
    let command = frames.iter().position(|frame| frame.sender == Sender::Ccu).expect("one was sent");
    frames.remove(command);
    let found = verified(bytes(&frames));
    assert_eq!(found.difference, None);
    let [one] = &found.unverifiable[..] else { panic!("{found:?}") };
    assert_eq!((one.card, &one.why), (Address(1), &Why::NoCommand(Sequence(0))));
}

#[test]
fn a_log_without_its_beginning_cannot_be_verified() {
    let frames = a_move();
    let found = verified(bytes(&frames[4..]));
    assert_eq!((found.difference, found.answers), (None, 0));
    assert_eq!(found.unverifiable.len(), 4, "each card once: {:?}", found.unverifiable);
}

#[test]
fn a_cut_log_is_verified_as_far_as_it_goes() {
    let frames = bytes(&a_move());
    for cut in 0..frames.len() {
        let found = verified(frames[..cut].to_vec());
        assert!(found.is_identical(), "cut at {cut}: {found:?}");
        let heard = frames[..cut]
            .iter()
            .filter(|one| !matches!(Frame::decode(one), Ok(Frame { sender: Sender::Ccu, .. })));
        assert_eq!(found.answers, heard.count() as u64, "cut at {cut}");
    }
}

#[test]
fn what_the_machine_would_not_have_said_is_shown_beside_what_it_says() {
    let mut frames = a_move();
    let at = of_card(&frames, 1)[7];
    let Body::Answer(answer) = &mut frames[at].body else { panic!("an answer") };
    let supersigma_protocol::Report::Axis(report) = &mut answer.report else { panic!("an axis") };
    report.steps = report.steps + Steps(1);
    let wrong = report.steps;
    let found = verified(bytes(&frames));
    let difference = found.difference.expect("it is found");
    assert_eq!((difference.number, difference.tick), (at as u64 + 1, frames[at].tick));
    let DifferenceKind::Answer(said) = difference.kind else { panic!("{:?}", difference.kind) };
    let Body::Answer(Answer { report: supersigma_protocol::Report::Axis(said), .. }) = said.body else {
        panic!("{said:?}")
    };
    assert_eq!(said.steps + Steps(1), wrong);
}

#[test]
fn an_answer_that_is_left_out_and_hidden_is_a_difference() {
    // The numbers are made whole again, as somebody would who wants to hide it.
    let mut frames = a_move();
    let changed = of_card(&frames, 1).into_iter().find(|at| {
        matches!(&frames[*at].body, Body::Answer(answer) if answer.about == About::Unasked(Occasion::Changed))
    });
    frames.remove(changed.expect("it has moved"));
    for (number, at) in (0..).zip(of_card(&frames, 1)) {
        frames[at].sequence = Sequence(number);
    }
    assert!(verified(bytes(&frames)).difference.is_some());
}

/// Copies a log, with one bit changed in its frame `number`; the copy's checksums are right.
fn rewrite(from: &Path, to: &Path, number: u64, bit: usize) {
    let bytes = fs::read(from).expect("the log");
    let mut out =
        mcap::Writer::new(std::io::BufWriter::new(fs::File::create(to).expect("a file"))).expect("MCAP");
    let (mut topics, mut frames) = (std::collections::BTreeMap::new(), 0);
    for record in mcap::read::ChunkFlattener::new(&bytes).expect("MCAP") {
        match record.expect("whole") {
            mcap::records::Record::Schema { header, data } => {
                let id = out.add_schema(&header.name, &header.encoding, &data).expect("room");
                assert_eq!(id, header.id);
            }
            mcap::records::Record::Channel(channel) => {
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                let id =
                    out.add_channel(channel.schema_id, topic, encoding, &channel.metadata).expect("room");
                assert_eq!(id, channel.id);
                topics.insert(channel.id, channel.topic);
            }
            mcap::records::Record::Message { header, data } => {
                let mut data = data.into_owned();
                if topics[&header.channel_id] == "/microbus" {
                    frames += 1;
                    if frames == number {
                        let bit = bit % (data.len() * 8);
                        data[bit / 8] ^= 1 << (bit % 8);
                    }
                }
                out.write_to_known_channel(&header, &data).expect("room");
            }
            mcap::records::Record::Attachment { header, data, .. } => {
                let mcap::records::AttachmentHeader { log_time, create_time, name, media_type } = header;
                out.attach(&mcap::Attachment { log_time, create_time, name, media_type, data })
                    .expect("room");
            }
            mcap::records::Record::Metadata(metadata) => {
                out.write_metadata(&metadata).expect("room");
            }
            _ => {}
        }
    }
    out.finish().expect("room");
}

#[test]
fn a_log_written_anew_with_one_bit_changed_is_found_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let (whole, changed) = (folder.path().join("run.mcap"), folder.path().join("changed.mcap"));
    let logged = through_a_log(&whole, &a_move());
    let config = config();
    let names = AxisNames::from(&config);
    let setting = Setting { config: &config, names: &names, twins: true };
    for (bit, one) in (0..).step_by(37).zip(&logged) {
        rewrite(&whole, &changed, one.number, bit);
        let found = verify(&setting, TwinReader::open(&changed).expect("a log")).expect("good axes");
        let difference = found.difference.unwrap_or_else(|| panic!("bit {bit} of {one:?}"));
        assert_eq!(difference.number, one.number);
    }
}
