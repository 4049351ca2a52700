//! `ccu log info`: what a log holds. Of a complete log, the summary is read, and the chunks with events; of any other,
//! everything. It counts and lists; what a gap or an alarm leads to is decided elsewhere.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use mcap::records::Channel;
use serde::Serialize;

use super::LogError;
use super::channels::{COMMAND, DIGITAL, EVENTS, LANE, MICROBUS};
use super::events::Told;
use super::header::{LogHeader, WallTime};
use super::messages::Messages;

/// How a log ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LogState {
    /// With its footer.
    Complete,
    /// Without.
    Cut,
    /// With bytes that were changed, behind which nothing was read.
    Damaged,
}

/// What a log holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogInfo {
    /// The file.
    pub log: PathBuf,
    /// Its length in bytes.
    pub bytes: u64,
    /// How it ends.
    pub state: LogState,
    /// What is damaged.
    pub damage: Option<String>,
    /// The set's name.
    pub set: String,
    /// The version of the program that wrote it.
    pub version: Option<String>,
    /// Tick 0, in nanoseconds since 1970.
    pub epoch_ns: u64,
    /// How many times faster than real time.
    pub time_scale: f64,
    /// The first message, in seconds of machine time.
    pub first_s: Option<f64>,
    /// The last one.
    pub last_s: Option<f64>,
    /// The channels.
    pub channels: Vec<ChannelInfo>,
    /// The frames by kind.
    pub frames: FramesInfo,
    /// The gaps in the senders' numbers.
    pub gaps: Vec<GapInfo>,
    /// The alarms.
    pub alarms: Vec<AlarmInfo>,
    /// What else the log says about itself.
    pub more: BTreeMap<String, String>,
}

/// A channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ChannelInfo {
    /// Its topic.
    pub topic: String,
    /// The service it carries, for raw frames.
    pub lane: Option<String>,
    /// How its messages are encoded.
    pub encoding: String,
    /// What they are.
    pub schema: Option<String>,
    /// How many there are.
    pub messages: u64,
}

/// Frames by kind.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct FramesInfo {
    /// Everything that was on the bus.
    pub all: u64,
    /// Commands, and faults on purpose.
    pub commands: u64,
    /// Answers by card: an axis' name, or `digital`.
    pub answers: BTreeMap<String, u64>,
    /// Bytes that are no frame.
    pub undecodable: u64,
}

/// Frames that are missing from the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapInfo {
    /// When that was noticed, in seconds of machine time.
    pub time_s: f64,
    /// Whose they were.
    pub sender: String,
    /// How many at least.
    pub lost: u64,
}

/// An axis that was locked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlarmInfo {
    /// When that was told, in seconds of machine time.
    pub time_s: f64,
    /// The axis.
    pub axis: String,
    /// Why.
    pub alarm: String,
}

/// What the log at `path` holds.
///
/// # Errors
/// If the file cannot be read, is no log of this program, or ends before it says whose it is.
pub fn info(path: &Path) -> Result<LogInfo, LogError> {
    let bytes = fs::metadata(path).map_err(|source| LogError::Read { path: path.to_owned(), source })?.len();
    let mut messages = Messages::open(path, |channel| channel.topic == EVENTS)?;
    let Some(LogHeader { set, timeline, .. }) = messages.header().cloned() else {
        return Err(LogError::NothingIn { path: path.to_owned() });
    };
    messages.narrow(&(WallTime(0)..=WallTime(u64::MAX)))?;
    let seconds = |wall| timeline.tick(wall).since(supersigma_protocol::Tick(0)).as_seconds();
    let (mut gaps, mut alarms, mut undecodable) = (Vec::new(), Vec::new(), 0);
    let damage = loop {
        let (header, event) = match messages.next() {
            Ok(Some(message)) => message,
            Ok(None) => break None,
            Err(LogError::Damaged { frames, source, .. }) => {
                break Some(format!("after frame {frames}: {source}"));
            }
            Err(error) => return Err(error),
        };
        // The time that the frame itself has.
        let time_s = seconds(WallTime(header.publish_time));
        match Told::read(&event) {
            Some(Told::Gap { sender, lost }) => gaps.push(GapInfo { time_s, sender, lost }),
            Some(Told::Alarm { axis, alarm }) => alarms.push(AlarmInfo { time_s, axis, alarm }),
            Some(Told::Undecodable) => undecodable += 1,
            None => {}
        }
    };
    let state = match (&damage, messages.truncated()) {
        (Some(_), _) => LogState::Damaged,
        (None, true) => LogState::Cut,
        (None, false) => LogState::Complete,
    };
    let known = ["version", "set", "epoch_ns", "time_scale", "tick_ns"];
    let more = messages
        .entries()
        .iter()
        .filter(|(key, _)| !known.contains(&key.as_str()) && !key.starts_with("axis."));
    Ok(LogInfo {
        log: path.to_owned(),
        bytes,
        state,
        damage,
        set,
        version: messages.entries().get("version").cloned(),
        epoch_ns: timeline.epoch.0,
        time_scale: timeline.scale.get(),
        first_s: messages.times().map(|(first, _)| seconds(first)),
        last_s: messages.times().map(|(_, last)| seconds(last)),
        more: more.map(|(key, value)| (key.clone(), value.clone())).collect(),
        frames: frames(&messages, undecodable),
        channels: channels(&messages),
        gaps,
        alarms,
    })
}

fn channels(messages: &Messages) -> Vec<ChannelInfo> {
    let info = |channel: &Channel, count| ChannelInfo {
        topic: channel.topic.clone(),
        lane: channel.metadata.get(LANE).cloned(),
        encoding: channel.message_encoding.clone(),
        schema: messages.schema(channel.schema_id).map(str::to_owned),
        messages: count,
    };
    messages.channels().values().map(|listed| info(&listed.channel, listed.messages)).collect()
}

/// The frames by kind, from the numbers of their twins: every frame that decodes has one.
fn frames(messages: &Messages, undecodable: u64) -> FramesInfo {
    let mut frames = FramesInfo { undecodable, ..FramesInfo::default() };
    for listed in messages.channels().values().filter(|listed| listed.messages > 0) {
        let topic = listed.channel.topic.as_str();
        let axis = topic.strip_prefix("/axis/").and_then(|rest| rest.strip_suffix("/status"));
        match (topic, axis) {
            (MICROBUS, _) => frames.all += listed.messages,
            (COMMAND, _) => frames.commands += listed.messages,
            (DIGITAL, _) => *frames.answers.entry("digital".to_owned()).or_default() += listed.messages,
            (_, Some(axis)) => *frames.answers.entry(axis.to_owned()).or_default() += listed.messages,
            _ => {}
        }
    }
    frames
}
