//! The log's tests: what they share.

mod cut;
mod events;
mod file;
mod filter;
mod info;
mod joints;
mod order;
mod recorder;
mod recover;
mod rotation;
mod schema;
mod view;

use std::fs;
use std::path::Path;
use std::time::Duration;

use axis_worker::clock::TimeScale;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Address, Alarm, Answer, AxisNumber, AxisReport, Body, Broadcast, CommandBytes, Frame,
    Occasion, Position, Refusal, Report, Sender, SensePoint, Sequence, StatusWord, Steps, Tick,
};

use super::{AxisNames, LogHeader, LogReader, LogSummary, LogWriter, LoggedFrame, Timeline, WallTime};

const EPOCH: WallTime = WallTime(1_700_000_000_000_000_000);
const MILLISECOND: u64 = 2_000;
const FLUSH: Duration = Duration::from_millis(100);

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

fn names() -> AxisNames {
    [(axis(1), "left_x".to_owned()), (axis(2), "left_y".to_owned())].into_iter().collect()
}

fn header() -> LogHeader {
    LogHeader {
        version: LogHeader::VERSION.to_owned(),
        set: "test".to_owned(),
        names: names(),
        timeline: Timeline { epoch: EPOCH, scale: TimeScale::REAL },
        config: "[log]\nflush_ms = 100\n".to_owned(),
        script: Some("move(1, 2600);".to_owned()),
    }
}

fn command(sequence: u64, tick: u64, bytes: &[u8]) -> Frame {
    Frame {
        sender: Sender::Ccu,
        sequence: Sequence(sequence),
        tick: Tick(tick),
        body: Body::Command(Broadcast {
            bytes: CommandBytes::try_from(bytes.to_vec()).expect("short enough"),
            at: None,
        }),
    }
}

fn answer(card: u8, sequence: u64, tick: u64, about: About) -> Frame {
    alarmed(card, sequence, tick, about, None)
}

fn alarmed(card: u8, sequence: u64, tick: u64, about: About, alarm: Option<Alarm>) -> Frame {
    Frame {
        sender: Sender::Card(Address(card)),
        sequence: Sequence(sequence),
        tick: Tick(tick),
        body: Body::Answer(Answer {
            card: Address(card),
            about,
            acted_at: Tick(tick.saturating_sub(3)),
            report: Report::Axis(AxisReport {
                sense: StatusWord::default().with(SensePoint::X4, true),
                steps: Steps(2_600),
                position: Some(Position(-17)),
                activity: Activity::Standing,
                alarm,
                lost: None,
                pace: None,
            }),
        }),
    }
}

const HEARTBEAT: About = About::Unasked(Occasion::Heartbeat);
const LEAVING: About = About::Unasked(Occasion::Leaving);
const REFUSED: About = About::Command(Sequence(0), Err(Refusal::NotOriginated));

fn lane(frame: &Frame) -> Lane {
    match frame.body {
        Body::Command(_) | Body::Fault(..) => Lane::Commands,
        Body::Answer(_) => Lane::Answers,
    }
}

fn writer(path: &Path) -> LogWriter {
    LogWriter::create(path, header(), FLUSH).expect("a new file in a folder of our own")
}

/// A log of these frames, each recorded at its own tick.
fn write(path: &Path, frames: &[Frame]) -> LogSummary {
    let mut writer = writer(path);
    for frame in frames {
        writer.record(lane(frame), &frame.encode(), frame.tick);
        writer.advance(frame.tick).expect("the disk has room");
    }
    writer.finish().expect("the disk has room")
}

fn read(path: &Path) -> (Vec<LoggedFrame>, LogReader) {
    let mut reader = LogReader::open(path).expect("a log");
    let frames = reader.by_ref().collect::<Result<_, _>>().expect("undamaged");
    (frames, reader)
}

/// A message as another reader of the format sees it.
struct Message {
    topic: String,
    log_time: u64,
    publish_time: u64,
    data: Vec<u8>,
}

impl Message {
    fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.data).expect("JSON")
    }
}

/// All messages of a complete file, in file order, through the format library's own stream.
fn messages(path: &Path) -> Vec<Message> {
    let bytes = fs::read(path).expect("readable");
    let stream = mcap::MessageStream::new(&bytes).expect("MCAP");
    stream
        .map(|message| {
            let message = message.expect("whole");
            Message {
                topic: message.channel.topic.clone(),
                log_time: message.log_time,
                publish_time: message.publish_time,
                data: message.data.into_owned(),
            }
        })
        .collect()
}

fn on<'a>(messages: &'a [Message], topic: &str) -> Vec<&'a Message> {
    messages.iter().filter(|message| message.topic == topic).collect()
}
