//! What stands in the file besides messages: the attachments and the metadata before them, the channels that carry
//! them. Numbers of channels are the file's own; nobody outside of the writer needs them.

use std::collections::BTreeMap;

use mcap::records::Metadata;
use mcap::{Attachment, McapError};
use supersigma_protocol::bus::Lane;

use super::file::LogFile;
use super::header::{AxisNames, CONFIG_NAME, LogHeader, METADATA_NAME, SCRIPT_NAME};
use super::part::PartPlace;
use super::schema::FRAME_TYPES;
use super::told::{ENCODING, SCHEMA_ENCODING, Topic};

/// The file that is being written.
pub(super) type McapFile = mcap::Writer<LogFile>;

/// The topic of the raw frames.
pub(super) const MICROBUS: &str = "/microbus";
/// The topic of the commands' twins.
pub(super) const COMMAND: &str = "/command";
/// The topic of the digital cards' twins.
pub(super) const DIGITAL: &str = "/digital/status";
/// The topic of the events.
pub(super) const EVENTS: &str = "/events";
/// The topic of all axes in one message.
pub(super) const JOINTS: &str = "/joint_states";
/// The key of a raw channel's metadata that says which of the two services it carries.
pub(super) const LANE: &str = "lane";

/// The metadata's key for the number of the file in its log, from 1.
const PART: &str = "part";
/// The metadata's key for the name of the file before it.
const PREVIOUS: &str = "previous";

/// How a lane is called in a channel's metadata.
pub(super) const fn lane_name(lane: Lane) -> &'static str {
    match lane {
        Lane::Commands => "commands",
        Lane::Answers => "answers",
    }
}

/// Attachments first, the metadata last: whoever finds the metadata has found everything.
pub(super) fn write_preamble(
    mcap: &mut McapFile,
    header: &LogHeader,
    place: &PartPlace,
) -> Result<(), McapError> {
    let epoch = header.timeline.epoch.0;
    let script = header.script.as_ref().map(|script| (SCRIPT_NAME, "text/plain", script));
    for (name, media_type, text) in
        [(CONFIG_NAME, "application/toml", &header.config)].into_iter().chain(script)
    {
        mcap.attach(&Attachment {
            log_time: epoch,
            create_time: epoch,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: text.as_bytes().into(),
        })?;
    }
    let mut metadata = header.to_metadata();
    metadata.insert(PART.to_owned(), place.number.to_string());
    metadata.extend(place.previous.clone().map(|previous| (PREVIOUS.to_owned(), previous)));
    mcap.write_metadata(&Metadata { name: METADATA_NAME.to_owned(), metadata })
}

/// The channels' numbers in the file.
pub(super) struct Channels {
    commands: u16,
    answers: u16,
    /// Schemas by name.
    schemas: BTreeMap<&'static str, u16>,
    topics: BTreeMap<Topic, u16>,
    /// Messages on each channel.
    written: BTreeMap<u16, u64>,
}

impl Channels {
    /// Writes the schemas, and the channels of a set.
    pub(super) fn add(mcap: &mut McapFile, header: &LogHeader) -> Result<Self, McapError> {
        let frames = mcap.add_schema("supersigma.Frame", "postcard-rust", FRAME_TYPES.as_bytes())?;
        let mut raw = |lane| {
            let metadata = BTreeMap::from([(LANE.to_owned(), lane_name(lane).to_owned())]);
            mcap.add_channel(frames, MICROBUS, "postcard", &metadata)
        };
        let mut channels = Self {
            commands: raw(Lane::Commands)?,
            answers: raw(Lane::Answers)?,
            schemas: BTreeMap::new(),
            topics: BTreeMap::new(),
            written: BTreeMap::new(),
        };
        for topic in Topic::of_set(&header.names) {
            channels.topic(topic, mcap, &header.names)?;
        }
        Ok(channels)
    }

    /// The raw frames of one service.
    pub(super) const fn microbus(&self, lane: Lane) -> u16 {
        match lane {
            Lane::Commands => self.commands,
            Lane::Answers => self.answers,
        }
    }

    /// Counts a message on a channel; returns how many there were before it.
    pub(super) fn count(&mut self, channel: u16) -> u64 {
        let written = self.written.entry(channel).or_default();
        *written += 1;
        *written - 1
    }

    /// The channel of a topic; an axis that the configuration does not have gets its channel when it first speaks.
    pub(super) fn topic(
        &mut self,
        topic: Topic,
        mcap: &mut McapFile,
        names: &AxisNames,
    ) -> Result<u16, McapError> {
        if let Some(channel) = self.topics.get(&topic) {
            return Ok(*channel);
        }
        let name = topic.schema_name();
        let schema = match self.schemas.get(name) {
            Some(schema) => *schema,
            None => mcap.add_schema(name, SCHEMA_ENCODING, topic.schema().as_bytes())?,
        };
        self.schemas.insert(name, schema);
        let channel = mcap.add_channel(schema, &topic.name(names), ENCODING, &BTreeMap::new())?;
        self.topics.insert(topic, channel);
        Ok(channel)
    }
}
