//! Whatever is on the bus, into those that only listen: the log, the pictures of a set, the live view.

use std::time::Duration;

use arbitrary::Unstructured;
use axis_worker::clock::TimeScale;
use ccu::log::{AxisNames, LiveView, LogHeader, LogReader, LogWriter, Timeline, WallTime};
use ccu::plot::{Shown, Subject, Timing, Trace, What, Window, moves};
use ccu::watch::{Detail, Picture};
use supersigma_config::{Config, DEFAULT_TOML};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{AxisNumber, Frame, Tick, Ticks};

use crate::{frames, taken};

/// So many frames at most.
const FRAMES: usize = 200;
/// A log's chunk is closed so often.
const FLUSH: Duration = Duration::from_millis(100);

/// Puts frames that `bytes` make before the watchers, and into a log that is read again.
pub fn watching(bytes: &[u8]) {
    let config = Config::default_set();
    let header = header(&config);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("bus.mcap");
    let mut writer = LogWriter::create(&path, header.clone(), FLUSH).expect("a new file");
    let (mut live, mut picture) = (LiveView::new(&header), Picture::new(config.clone()));
    let (mut trace, mut timing) = (Trace::default(), Timing::default());
    let mut chance = Unstructured::new(bytes);
    let (mut now, mut recorded) = (Tick(1_000), vec![]);
    while !chance.is_empty() && recorded.len() < FRAMES {
        now = Tick(now.0 + taken(chance.arbitrary::<u64>()) % Tick::PER_SECOND);
        let bytes = frames::on_the_bus(&mut chance, now);
        let frame = Frame::decode(&bytes);
        let lane = if taken(chance.arbitrary()) { Lane::Commands } else { Lane::Answers };
        writer.record(lane, &bytes, now);
        writer.advance(now).expect("the disk has room");
        live.record(&bytes, now);
        live.advance(now, &mut |_, message| is_json(message.data));
        picture.take(TimeScale::REAL.real(now.since(Tick(0))), lane, &bytes);
        if let Ok(frame) = &frame {
            trace.hear(frame);
            timing.hear(frame);
        }
        recorded.push(bytes);
    }
    let _ = serde_json::to_string(&picture.snapshot(&Detail::default())).expect("plain data");
    draws(trace, timing, &config, &header.names);
    let summary = writer.finish().expect("the disk has room");
    assert_eq!(summary.frames, recorded.len() as u64, "frames that the log counts");
    let mut logged: Vec<Vec<u8>> =
        LogReader::open(&path).expect("a log").map(|logged| logged.expect("undamaged").bytes).collect();
    // The log has them in the order of their ticks.
    logged.sort_unstable();
    recorded.sort_unstable();
    assert!(logged == recorded, "the log has other frames than the bus had");
}

/// What a log of the built-in set says of itself.
pub(crate) fn header(config: &Config) -> LogHeader {
    LogHeader {
        version: LogHeader::VERSION.to_owned(),
        set: "garbage".to_owned(),
        names: AxisNames::from(config),
        timeline: Timeline { epoch: WallTime(1_700_000_000_000_000_000), scale: TimeScale::REAL },
        config: DEFAULT_TOML.to_owned(),
        script: None,
    }
}

fn is_json(bytes: &[u8]) {
    serde_json::from_slice::<serde_json::Value>(bytes).expect("what viewers get is JSON");
}

/// Draws all that can be drawn of these frames.
pub(crate) fn draws(mut trace: Trace, mut timing: Timing, config: &Config, names: &AxisNames) {
    trace.sort();
    let Some(span) = trace.span else { return };
    timing.close(span.to);
    let _ = (timing.idle(), timing.totals(), timing.summaries(names));
    let window = trace.moving().unwrap_or(Window { from: span.from, to: span.to + Ticks(1) });
    let axes: Vec<AxisNumber> = AxisNumber::all().collect();
    let what = [What::Speed, What::Position, What::Sense, What::Plane, What::Timing];
    let subject = Subject { title: "garbage", subtitle: "by chance", names, config };
    let shown = Shown { subject, axes: &axes, what: &what, window, size: None };
    moves(&trace, &timing, &shown).expect("there is room for all of it");
}
