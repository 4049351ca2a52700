//! Bytes into every reader of a log: any bytes, a good log with changes, and logs that are good MCAP but say odd things.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Cursor};
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};

use arbitrary::Unstructured;
use ccu::dry::{DrySet, NoPulses};
use ccu::executive::{Executive, Movement};
use ccu::log::{
    self as logs, AxisNames, Form, FramesAsked, LogHeader, LogReader, LogState, TwinReader, twin_of,
};
use ccu::plot::{Timing, Trace};
use ccu::replay::{Setting, Verifier};
use ccu::script::{Limits, Program, Watcher};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions};
use supersigma_config::{Config, DEFAULT_TOML};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{Body, Frame, Sequence, Tick};

use crate::{frames, knowledge, taken, watching};

/// So many changes of a good log at most.
const CHANGES: usize = 24;

/// What the good log is of.
const PROGRAM: &str = r#"origin("left_x"); go_to(1, 700); slew(1, -90, 1000); output(2, true); halt(1);"#;

/// Takes `bytes` for a log.
pub fn log(bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("garbage.mcap");
    fs::write(&path, bytes).expect("writable");
    read_all(&path);
}

/// A good log in which bytes were changed, cut, repeated or put in between.
pub fn changed_log(bytes: &[u8]) {
    let mut chance = Unstructured::new(bytes);
    let mut changed = good_log().bytes.clone();
    for _ in 0..CHANGES {
        if chance.is_empty() {
            break;
        }
        let at = taken(chance.int_in_range(0..=changed.len()));
        let length = taken(chance.int_in_range(0..=64_usize));
        let end = (at + length).min(changed.len());
        match taken(chance.int_in_range(0_u8..=9)) {
            0 => changed.truncate(at),
            1 => drop(changed.drain(at..end)),
            2 => {
                let part = changed[at..end].to_vec();
                let to = taken(chance.int_in_range(0..=changed.len()));
                changed.splice(to..to, part);
            }
            3 => {
                let part = taken(chance.bytes(length.min(chance.len()))).to_vec();
                changed.splice(at..at, part);
            }
            4 => changed[at..end].fill(0),
            // Lengths are of eight bytes, and one of them is enough for a great one.
            5 => {
                let value: u64 = taken(chance.arbitrary());
                let end = (at + 8).min(changed.len());
                changed[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            }
            _ => {
                if let Some(byte) = changed.get_mut(at) {
                    *byte = taken(chance.arbitrary());
                }
            }
        }
    }
    log(&changed);
}

/// A log that is whole as a file, of frames that no set has sent so.
pub fn forged_log(bytes: &[u8]) {
    let mut chance = Unstructured::new(bytes);
    let good = good_log();
    let kept = taken(chance.int_in_range(0..=good.frames.len()));
    let mut forged = good.frames[..kept].to_vec();
    while !chance.is_empty() && forged.len() < good.frames.len() + CHANGES {
        change(&mut forged, &mut chance);
    }
    log(&written(&forged, &mut chance));
}

/// A log and its frames.
struct Good {
    bytes: Vec<u8>,
    frames: Vec<(Lane, Vec<u8>)>,
}

/// The log of a short program on the built-in set.
fn good_log() -> &'static Good {
    struct Nobody;
    impl Watcher for Nobody {
        fn movement(&mut self, _: &Movement) {}
        fn print(&mut self, _: &str) {}
    }

    static GOOD: OnceLock<Good> = OnceLock::new();
    GOOD.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("good.mcap");
        let knowledge = knowledge();
        let header = watching::header(&knowledge.config);
        let set = DrySet::new(Arc::clone(&knowledge), NoPulses, Some((&path, header))).expect("a new file");
        let operator = Arc::new(Mutex::new(Executive::new(set)));
        let program = Program::compile("good.rhai", PROGRAM).expect("a program");
        let limits = Limits::default();
        program.run(Arc::clone(&operator), knowledge, Nobody, &limits).expect("nothing is in its way");
        let executive = Arc::into_inner(operator).expect("the program is over").into_inner();
        executive.expect("nobody has panicked").into_link().finish().expect("the disk has room");
        let frames = LogReader::open(&path).expect("a log").map(|logged| {
            let logged = logged.expect("undamaged");
            (logged.lane, logged.bytes)
        });
        Good { frames: frames.collect(), bytes: fs::read(&path).expect("readable") }
    })
}

fn change(forged: &mut Vec<(Lane, Vec<u8>)>, chance: &mut Unstructured<'_>) {
    let at = taken(chance.int_in_range(0..=forged.len()));
    let near = forged.get(at).and_then(|(_, bytes)| Frame::decode(bytes).ok());
    match (taken(chance.int_in_range(0_u8..=9)), near) {
        (0, Some(_)) => drop(forged.remove(at)),
        (1, Some(_)) => forged.insert(at, forged[at].clone()),
        (2, Some(frame)) => {
            let tick = frames::tick(chance, frame.tick);
            forged[at].1 = Frame { tick, ..frame }.encode();
        }
        (3, Some(frame)) => {
            let sequence = Sequence(taken(chance.arbitrary()));
            forged[at].1 = Frame { sequence, ..frame }.encode();
        }
        (4, Some(frame)) => {
            let Body::Answer(mut answer) = frame.body else { return };
            answer.acted_at = frames::tick(chance, answer.acted_at);
            forged[at].1 = Frame { body: Body::Answer(answer), ..frame }.encode();
        }
        (5, Some(_)) => {
            let bytes = &mut forged[at].1;
            let place = taken(chance.int_in_range(0..=bytes.len() - 1));
            bytes[place] = taken(chance.arbitrary());
        }
        (6, Some(frame)) => {
            // A command that fits in, up to the one before it.
            let next = frames::of_the_ccu(chance, frame.sequence, frame.tick);
            forged.insert(at, (Lane::Commands, next.encode()));
        }
        (_, near) => {
            let now = near.map_or(Tick(0), |frame| frame.tick);
            let lane = if taken(chance.arbitrary()) { Lane::Commands } else { Lane::Answers };
            forged.insert(at, (lane, frames::on_the_bus(chance, now)));
        }
    }
}

/// A log of these frames with the twins that belong to them, as a writer might have made it.
fn written(forged: &[(Lane, Vec<u8>)], chance: &mut Unstructured<'_>) -> Vec<u8> {
    let names = AxisNames::from(&Config::default_set());
    let mut mcap = WriteOptions::new()
        .compression_threads(0)
        .disable_seeking(true)
        .create(Cursor::new(Vec::new()))
        .expect("memory");
    mcap.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: "config.toml".to_owned(),
        media_type: "application/toml".to_owned(),
        data: DEFAULT_TOML.as_bytes().into(),
    })
    .expect("memory");
    let epoch: u64 = taken(chance.arbitrary());
    let scale = taken(chance.choose(&["1", "0.01", "1000", "20"]));
    let entries = [
        ("version", LogHeader::VERSION.to_owned()),
        ("set", "forged".to_owned()),
        ("epoch_ns", epoch.to_string()),
        ("time_scale", (*scale).to_owned()),
    ];
    let mut metadata: BTreeMap<String, String> =
        entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    metadata.extend(names.iter().map(|(axis, name)| (format!("axis.{}", axis.get()), name.to_owned())));
    mcap.write_metadata(&Metadata { name: "supersigma".to_owned(), metadata }).expect("memory");
    let mut twin = Vec::new();
    for (number, (lane, bytes)) in forged.iter().enumerate() {
        let name = if *lane == Lane::Commands { "commands" } else { "answers" };
        let lane = BTreeMap::from([("lane".to_owned(), name.to_owned())]);
        let channel = mcap.add_channel(0, "/microbus", "postcard", &lane).expect("few channels");
        let frame = Frame::decode(bytes);
        let time = match &frame {
            Ok(frame) if number % 16 != 15 => epoch.saturating_add(frame.tick.0.saturating_mul(500)),
            _ => taken(chance.arbitrary()),
        };
        let header = MessageHeader {
            channel_id: channel,
            sequence: u32::try_from(number).expect("few frames"),
            log_time: time,
            publish_time: time,
        };
        mcap.write_to_known_channel(&header, bytes).expect("memory");
        if let Ok(frame) = &frame
            && let Some(topic) = twin_of(frame, bytes, &names, &mut twin)
        {
            let channel = mcap.add_channel(0, &topic.name(&names), "json", &BTreeMap::new());
            let header = MessageHeader { channel_id: channel.expect("few channels"), ..header };
            mcap.write_to_known_channel(&header, &twin).expect("memory");
        }
        if number % 32 == 31 {
            mcap.flush().expect("memory");
        }
    }
    mcap.finish().expect("memory");
    mcap.into_inner().into_inner()
}

/// Has every reader read the file: none may panic, and what they make of it must be whole.
fn read_all(path: &Path) {
    let _ = logs::info(path);
    let everything = FramesAsked::default();
    let some = FramesAsked {
        axis: Some("1"),
        from: Some(Tick(1_000)),
        to: Some(Tick(4_000_000)),
        operation: Some("Move"),
        form: Form::People,
    };
    for asked in [
        everything,
        FramesAsked { form: Form::Json, ..everything },
        FramesAsked { form: Form::Csv, ..everything },
        some,
    ] {
        let _ = logs::frames(path, &asked, &mut io::sink());
    }
    draw(path);
    verify(path);
    recover(path);
}

fn draw(path: &Path) {
    let Ok(mut reader) = LogReader::open(path) else { return };
    let (mut trace, mut timing) = (Trace::default(), Timing::default());
    for frame in reader.by_ref().map_while(Result::ok).filter_map(|logged| logged.frame.ok()) {
        trace.hear(&frame);
        timing.hear(&frame);
    }
    let Some(header) = reader.header() else { return };
    if let Ok(config) = Config::from_toml(&header.config, "config.toml") {
        watching::draws(trace, timing, &config, &header.names);
    }
}

fn verify(path: &Path) {
    let Ok(mut reader) = TwinReader::open(path) else { return };
    let Some(header) = reader.header().cloned() else { return };
    let Ok(config) = Config::from_toml(&header.config, "config.toml") else { return };
    let mut verifier = Verifier::new(Setting { config: &config, names: &header.names, twins: true });
    for twinned in reader.by_ref().map_while(Result::ok) {
        if !verifier.take(twinned).expect("machines can be made of a configuration that loads") {
            break;
        }
    }
    let found = verifier.finish();
    for one in &found.unverifiable {
        assert!(!one.why.to_string().is_empty());
    }
    let _ = (found.machine_time(), reader.next_file());
}

fn recover(path: &Path) {
    let out = path.with_extension("recovered.mcap");
    let Ok(recovery) = logs::recover(path, &out) else {
        assert!(!out.exists(), "nothing was recovered, and there is a file");
        return;
    };
    let mut reader = LogReader::open(&out).expect("what was recovered is a log");
    let read = reader.by_ref().map(|logged| drop(logged.expect("undamaged"))).count();
    assert_eq!(read as u64, recovery.frames, "frames in the log that was recovered: {recovery:?}");
    assert!(!reader.truncated());
    let info = logs::info(&out).expect("what was recovered is a log");
    assert_eq!((info.state, info.frames.all), (LogState::Complete, recovery.frames));
}
