//! How long it takes to find a second in a log of a gigabyte: `cargo bench -p supersigma-ccu --bench window`.
//!
//! The log is made here, by the writer itself, of what seven axes say who all move and report all the time; a part of it
//! is repeated until the file is as long as asked for (`-- 1000` is megabytes). It is in the system's cache then, so what
//! is measured is the program, not the disk.

use std::error::Error;
use std::fs;
use std::io::sink;
use std::time::{Duration, Instant};

use axis_worker::clock::TimeScale;
use ccu::log::{AxisNames, Form, FramesAsked, LogHeader, LogWriter, Timeline, WallTime, frames, info};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Address, Answer, AxisNumber, AxisReport, Body, Broadcast, CommandBytes, Frame, Occasion,
    Position, Report, Sender, Sequence, StatusWord, Steps, Tick,
};

const MILLISECOND: u64 = Tick::PER_SECOND / 1_000;

fn main() -> Result<(), Box<dyn Error>> {
    let megabytes = std::env::args().find_map(|argument| argument.parse::<u64>().ok()).unwrap_or(1_000);
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let path = folder.path().join("long.mcap");
    let names: AxisNames = AxisNumber::all().map(|axis| (axis, format!("axis_{}", axis.get()))).collect();
    let header = LogHeader {
        set: "bench".to_owned(),
        names,
        timeline: Timeline { epoch: WallTime(1_700_000_000_000_000_000), scale: TimeScale::REAL },
        config: String::new(),
        script: None,
    };
    let began = Instant::now();
    let mut writer = LogWriter::create(&path, header, Duration::from_millis(100))?;
    let mut turn = 0;
    while turn % 1_000 != 0 || fs::metadata(&path)?.len() < megabytes * 1_000_000 {
        for (lane, frame) in round(turn)? {
            writer.record(lane, &frame.encode(), frame.tick);
        }
        writer.advance(Tick(turn * 10 * MILLISECOND))?;
        turn += 1;
    }
    let summary = writer.finish()?;
    println!(
        "a log of {} frames, {} bytes, {} s, made in {:.1} s",
        summary.frames,
        summary.bytes,
        turn / 100,
        began.elapsed().as_secs_f64()
    );
    let middle = Tick(turn * 5 * MILLISECOND);
    for (what, from, to) in [
        ("a second in the middle", middle, Tick(middle.0 + Tick::PER_SECOND)),
        ("the first second", Tick(0), Tick(Tick::PER_SECOND)),
        ("the last second", Tick((turn - 100) * 10 * MILLISECOND), Tick(turn * 10 * MILLISECOND)),
    ] {
        let asked =
            FramesAsked { from: Some(from), to: Some(to), form: Form::Json, ..FramesAsked::default() };
        let began = Instant::now();
        let count = frames(&path, &asked, &mut sink())?;
        println!("{what}: {} of {} read, {:?}", count.printed, count.read, began.elapsed());
    }
    let began = Instant::now();
    let told = info(&path)?;
    println!("log info: {} frames, {:?}", told.frames.all, began.elapsed());
    Ok(())
}

/// What is on the bus in 10 ms: a command, and all axes' reports.
fn round(turn: u64) -> Result<Vec<(Lane, Frame)>, Box<dyn Error>> {
    let tick = Tick(turn * 10 * MILLISECOND);
    let bytes = CommandBytes::try_from(vec![1 + u8::try_from(turn % 7)?, 5])?;
    let body = Body::Command(Broadcast { bytes, at: None });
    let command = Frame { sender: Sender::Ccu, sequence: Sequence(turn), tick, body };
    let mut frames = vec![(Lane::Commands, command)];
    for axis in AxisNumber::all() {
        // Numbers that look like a movement's, so that compression has something to do.
        let steps = u32::try_from(((turn * 2_654_435_761) ^ (u64::from(axis.get()) << 20)) % 65_536)?;
        let report = AxisReport {
            sense: StatusWord::default(),
            steps: Steps(steps),
            position: Some(Position(i32::try_from(steps)?)),
            activity: Activity::Cruising,
            alarm: None,
            lost: None,
            pace: None,
        };
        let answer = Answer {
            card: axis.address(),
            about: About::Unasked(Occasion::Heartbeat),
            acted_at: tick,
            report: Report::Axis(report),
        };
        let sender = Sender::Card(Address(axis.get()));
        frames.push((
            Lane::Answers,
            Frame { sender, sequence: Sequence(turn), tick, body: Body::Answer(answer) },
        ));
    }
    Ok(frames)
}
