//! What the log costs: frames a second written and read, and bytes on disk, against the format library driven directly
//! with the very same messages, in the same run. A plain program that prints a table:
//!
//! ```text
//! cargo bench -p supersigma-ccu --bench log
//! cargo bench -p supersigma-ccu --bench log -- --markdown > docs/src/generated/log.md
//! ```

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use axis_worker::clock::TimeScale;
use ccu::log::{AxisNames, LogHeader, LogReader, LogWriter, Timeline, WallTime};
use mcap::records::MessageHeader;
use mcap::{MessageStream, WriteOptions};
use supersigma_config::Config;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Answer, AxisNumber, AxisReport, Body, Command, Direction, Distance, Frame, Occasion,
    Operation, Pace, Position, Report, Sender, SensePoint, Sequence, StatusWord, Steps, Tick, Ticks,
};

const FRAMES: u64 = 200_000;
/// Each figure is the best of so many rounds: what the machine does besides only makes it slower.
const ROUNDS: usize = 3;
/// Seven axes at time scale 20: a frame every 50 µs of real time.
const TICKS_PER_FRAME: u64 = 100;
const FLUSH: Duration = Duration::from_millis(100);

/// What the direct writer is given: a message as it stands in our log.
struct Raw {
    channel: u16,
    sequence: u32,
    log_time: u64,
    publish_time: u64,
    data: Vec<u8>,
}

/// One way of writing a log, or of reading one.
struct Figure {
    what: &'static str,
    best: Duration,
    bytes: u64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let markdown = std::env::args().any(|argument| argument == "--markdown");
    let folder = tempfile::tempdir()?;
    let frames = traffic();
    let ours = folder.path().join("ours.mcap");

    let log = measure("this log: raw frames and JSON twins", || write_ours(&ours, &frames))?;
    let (twinned, topics) = messages(&ours)?;
    let raw: Vec<&Raw> =
        twinned.iter().filter(|raw| topics[usize::from(raw.channel)] == "/microbus").collect();
    assert_eq!(raw.len() as u64, FRAMES);
    let all: Vec<&Raw> = twinned.iter().collect();
    let direct = folder.path().join("direct.mcap");
    let direct_raw = measure("mcap directly: raw frames alone", || write_directly(&direct, &topics, &raw))?;
    let direct_all = measure("mcap directly: the same messages", || write_directly(&direct, &topics, &all))?;

    let read_log = measure("this log: frames, decoded", || read_ours(&ours))?;
    let read_direct = measure("mcap directly: all messages", || read_directly(&ours))?;

    let mut out = io::stdout().lock();
    if markdown {
        writeln!(out, "<!-- Made by the benchmark `log` of the crate ccu; do not edit. -->\n")?;
    }
    table(&mut out, "written", &[&direct_raw, &direct_all, &log], &direct_all)?;
    table(&mut out, "read", &[&read_direct, &read_log], &read_direct)?;
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "figures for people")]
fn table(out: &mut impl Write, done: &str, figures: &[&Figure], base: &Figure) -> io::Result<()> {
    let rate = |figure: &Figure| FRAMES as f64 / figure.best.as_secs_f64();
    writeln!(out, "| {done} | frames/s | of mcap directly | bytes a frame |")?;
    writeln!(out, "|---|---:|---:|---:|")?;
    for figure in figures {
        let share = 100.0 * rate(figure) / rate(base);
        let bytes = figure.bytes as f64 / FRAMES as f64;
        writeln!(out, "| {} | {:.0} | {share:.0} % | {bytes:.1} |", figure.what, rate(figure))?;
    }
    writeln!(out)
}

fn measure(
    what: &'static str,
    mut work: impl FnMut() -> Result<u64, Box<dyn Error>>,
) -> Result<Figure, Box<dyn Error>> {
    let mut figure = Figure { what, best: Duration::MAX, bytes: 0 };
    for _ in 0..ROUNDS {
        let began = Instant::now();
        figure.bytes = work()?;
        figure.best = figure.best.min(began.elapsed());
    }
    Ok(figure)
}

/// A bus on which seven axes move: every tenth frame a command, the others the axes' answers in turn.
fn traffic() -> Vec<(Lane, Tick, Vec<u8>)> {
    let mut sequences = [0_u64; AxisNumber::COUNT + 1];
    let mut next = |sender: usize| {
        sequences[sender] += 1;
        Sequence(sequences[sender] - 1)
    };
    let frames = (0..FRAMES).map(|number| {
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
fn write_ours(path: &Path, frames: &[(Lane, Tick, Vec<u8>)]) -> Result<u64, Box<dyn Error>> {
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
    assert_eq!((summary.frames, summary.lost), (FRAMES, 0));
    Ok(summary.bytes)
}

/// Every message of a log as it stands there, and the channels' topics by number.
fn messages(path: &Path) -> Result<(Vec<Raw>, Vec<String>), Box<dyn Error>> {
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

/// The format library with the options of the log, and nothing else: no order, no decoding, no flush in between.
fn write_directly(path: &Path, topics: &[String], messages: &[&Raw]) -> Result<u64, Box<dyn Error>> {
    let options = WriteOptions::new().compression_threads(0).disable_seeking(true);
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

fn read_ours(path: &Path) -> Result<u64, Box<dyn Error>> {
    let mut frames = 0;
    for frame in LogReader::open(path)? {
        frames += u64::from(frame?.frame.is_ok());
    }
    assert_eq!(frames, FRAMES);
    Ok(fs::metadata(path)?.len())
}

fn read_directly(path: &Path) -> Result<u64, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let count = MessageStream::new(&bytes)?.flatten().count();
    assert!(count as u64 >= FRAMES);
    Ok(bytes.len() as u64)
}
