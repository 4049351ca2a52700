//! What the log costs: frames a second written and read, and bytes on disk. The reference is the format library driven
//! directly with the very same messages, chunks compressed at the same level: no order, no decoding, no twins made, and
//! nothing on the disk before the end. Both are measured in turns.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

use axis_worker::clock::TimeScale;
use ccu::log::{AxisNames, COMPRESSION_LEVEL, LogHeader, LogReader, LogWriter, Timeline, WallTime};
use mcap::records::MessageHeader;
use mcap::{MessageStream, WriteOptions};
use rustix::time::{ClockId, clock_gettime};
use supersigma_config::Config;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Answer, AxisNumber, AxisReport, Body, Command, Direction, Distance, Frame, Occasion,
    Operation, Pace, Position, Report, Sender, SensePoint, Sequence, StatusWord, Steps, Tick, Ticks,
};

use crate::figure::Figure;

const ROOM: &str = "recorder";
const DIRECTLY: &str = "mcap directly, the same messages";
const FRAMES: u32 = 200_000;
/// Each figure is the best of so many rounds: what the machine does besides only makes it slower.
const ROUNDS: usize = 5;
/// Seven axes at time scale 20: a frame every 50 µs of real time.
const TICKS_PER_FRAME: u64 = 100;
const FLUSH: Duration = Duration::from_millis(100);

type Outcome<T> = Result<T, Box<dyn Error>>;

/// What the direct writer is given: a message as it stands in our log.
struct Raw {
    channel: u16,
    sequence: u32,
    log_time: u64,
    publish_time: u64,
    data: Vec<u8>,
}

/// The best of some rounds.
struct Best {
    real: Duration,
    /// Of all threads.
    processor: Duration,
    bytes: u64,
}

pub(crate) fn measure() -> Outcome<Vec<Figure>> {
    let folder = tempfile::tempdir()?;
    let frames = traffic();
    let [ours, direct] = ["ours.mcap", "direct.mcap"].map(|name| folder.path().join(name));
    write_ours(&ours, &frames)?;
    let (raw, topics) = messages(&ours)?;
    assert_eq!(
        raw.iter().filter(|raw| topics[usize::from(raw.channel)] == "/microbus").count(),
        frames.len()
    );

    let [mut written, mut given, mut read, mut streamed] = [(); 4].map(|()| Best::none());
    for _ in 0..ROUNDS {
        written.round(|| write_ours(&ours, &frames))?;
        given.round(|| write_directly(&direct, &topics, &raw))?;
        read.round(|| read_ours(&ours))?;
        streamed.round(|| read_directly(&ours))?;
    }
    let frames_a_second = |best: &Best| f64::from(FRAMES) / best.real.as_secs_f64();
    let processor_a_frame = |best: &Best| best.processor.as_secs_f64() * 1e6 / f64::from(FRAMES);
    Ok(vec![
        Figure::new(ROOM, "frames written, each with its twin", frames_a_second(&written), "frames/s")
            .at_least(300_000.0),
        Figure::new(ROOM, "the same beside its reference", frames_a_second(&written), "frames/s")
            .against(DIRECTLY, frames_a_second(&given))
            .ratio_at_least(0.8),
        Figure::new(ROOM, "processor time of all threads, a frame", processor_a_frame(&written), "µs")
            .against(DIRECTLY, processor_a_frame(&given)),
        Figure::new(ROOM, "on disk, a frame", bytes_a_frame(&written), "bytes")
            .against(DIRECTLY, bytes_a_frame(&given))
            .ratio_at_most(1.1),
        Figure::new(ROOM, "frames read and decoded", frames_a_second(&read), "frames/s")
            .against("mcap directly, all messages", frames_a_second(&streamed)),
    ])
}

#[expect(clippy::cast_precision_loss, reason = "figures for people")]
fn bytes_a_frame(best: &Best) -> f64 {
    best.bytes as f64 / f64::from(FRAMES)
}

impl Best {
    const fn none() -> Self {
        Self { real: Duration::MAX, processor: Duration::MAX, bytes: 0 }
    }

    fn round(&mut self, work: impl FnOnce() -> Outcome<u64>) -> Outcome<()> {
        let (began, processor) = (Instant::now(), processor_time()?);
        self.bytes = work()?;
        self.real = self.real.min(began.elapsed());
        self.processor = self.processor.min(processor_time()?.saturating_sub(processor));
        Ok(())
    }
}

fn processor_time() -> Outcome<Duration> {
    Ok(clock_gettime(ClockId::ProcessCPUTime).try_into()?)
}

/// A bus on which seven axes move: every tenth frame a command, the others the axes' answers in turn.
fn traffic() -> Vec<(Lane, Tick, Vec<u8>)> {
    let mut sequences = [0_u64; AxisNumber::COUNT + 1];
    let mut next = |sender: usize| {
        sequences[sender] += 1;
        Sequence(sequences[sender] - 1)
    };
    let frames = (0..u64::from(FRAMES)).map(|number| {
        let tick = Tick(number * TICKS_PER_FRAME);
        let turn = usize::try_from(number).unwrap_or(0);
        let axis = AxisNumber::all().nth(turn % AxisNumber::COUNT).expect("1 to 7");
        if number % 10 == 0 {
            let distance =
                Distance::new(u16::try_from(1 + number % 60_000).unwrap_or(1)).unwrap_or(Distance::MAX);
            let operation = Operation::Move { direction: Direction::Forward, distance };
            let body = Body::Command(Command::new(axis.address(), operation).into());
            return (Lane::Commands, Frame { sender: Sender::Ccu, sequence: next(0), tick, body });
        }
        let position = i32::try_from(number * 37 % 60_000).unwrap_or(0);
        let body = Body::Answer(Answer {
            card: axis.address(),
            about: About::Unasked(if number % 3 == 0 { Occasion::Changed } else { Occasion::Sampled }),
            acted_at: Tick(tick.0.saturating_sub(3)),
            report: Report::Axis(AxisReport {
                sense: StatusWord::default().with(SensePoint::X4, number % 5 == 0),
                steps: Steps(position.unsigned_abs()),
                position: Some(Position(position)),
                activity: if number % 5 == 0 { Activity::Standing } else { Activity::Cruising },
                alarm: None,
                lost: None,
                pace: (number % 5 != 0)
                    .then_some(Pace { period: Ticks(132 + number % 2_900), direction: Direction::Forward }),
            }),
        });
        let sequence = next(1 + axis.index());
        (Lane::Answers, Frame { sender: Sender::Card(axis.address()), sequence, tick, body })
    });
    frames.map(|(lane, frame)| (lane, frame.tick, frame.encode())).collect()
}

/// As the recorder does it: a look every 10 ms.
fn write_ours(path: &Path, frames: &[(Lane, Tick, Vec<u8>)]) -> Outcome<u64> {
    let _ = fs::remove_file(path);
    let config = Config::default_set();
    let header = LogHeader {
        version: LogHeader::VERSION.to_owned(),
        set: "bench".into(),
        names: AxisNames::from(&config),
        timeline: Timeline { epoch: WallTime::now(), scale: TimeScale::REAL },
        config: config.to_toml(),
        script: None,
    };
    let mut writer = LogWriter::create(path, header, FLUSH)?;
    let look = writer.timeline().scale.ticks(writer.poll()).0;
    let mut looked = 0;
    for (lane, tick, bytes) in frames {
        writer.record(*lane, bytes, *tick);
        if tick.0 >= looked + look {
            looked = tick.0;
            writer.advance(*tick)?;
        }
    }
    let summary = writer.finish()?;
    assert_eq!((summary.frames, summary.lost), (u64::from(FRAMES), 0), "a gap");
    Ok(summary.bytes)
}

/// Every message of a log as it stands there, and the channels' topics by number.
fn messages(path: &Path) -> Outcome<(Vec<Raw>, Vec<String>)> {
    let bytes = fs::read(path)?;
    let mut topics = vec![String::new(); 64];
    let mut messages = Vec::new();
    for message in MessageStream::new(&bytes)? {
        let message = message?;
        topics[usize::from(message.channel.id)].clone_from(&message.channel.topic);
        messages.push(Raw {
            channel: message.channel.id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
            data: message.data.into_owned(),
        });
    }
    Ok((messages, topics))
}

/// The format library with the log's options, which are its own but for these three.
fn write_directly(path: &Path, topics: &[String], messages: &[Raw]) -> Outcome<u64> {
    let options =
        WriteOptions::new().compression_threads(0).compression_level(COMPRESSION_LEVEL).disable_seeking(true);
    let mut mcap = options.create(BufWriter::new(File::create(path)?))?;
    let nothing = BTreeMap::new();
    let schema = mcap.add_schema("any", "jsonschema", b"{}")?;
    let channels: Vec<u16> = topics
        .iter()
        .enumerate()
        .map(|(number, topic)| mcap.add_channel(schema, &format!("{number}{topic}"), "any", &nothing))
        .collect::<Result<_, _>>()?;
    for Raw { channel, sequence, log_time, publish_time, data } in messages {
        let channel_id = channels[usize::from(*channel)];
        let header = MessageHeader {
            channel_id,
            sequence: *sequence,
            log_time: *log_time,
            publish_time: *publish_time,
        };
        mcap.write_to_known_channel(&header, data)?;
    }
    mcap.finish()?;
    let file = mcap.into_inner().into_inner()?;
    file.sync_all()?;
    Ok(file.metadata()?.len())
}

fn read_ours(path: &Path) -> Outcome<u64> {
    let mut frames = 0;
    for frame in LogReader::open(path)? {
        frames += u32::from(frame?.frame.is_ok());
    }
    assert_eq!(frames, FRAMES);
    Ok(fs::metadata(path)?.len())
}

fn read_directly(path: &Path) -> Outcome<u64> {
    let bytes = fs::read(path)?;
    let count = MessageStream::new(&bytes)?.flatten().count();
    assert!(count >= usize::try_from(FRAMES)?);
    Ok(bytes.len() as u64)
}
