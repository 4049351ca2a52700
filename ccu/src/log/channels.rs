//! What stands in the file besides messages: the attachments and the metadata before them, the channels that carry
//! them. Numbers of channels are the file's own; nobody outside of the writer needs them.

use std::collections::BTreeMap;

use mcap::records::Metadata;
use mcap::{Attachment, McapError};
use supersigma_protocol::AxisNumber;
use supersigma_protocol::bus::Lane;

use super::file::LogFile;
use super::header::{CONFIG_NAME, LogHeader, METADATA_NAME, SCRIPT_NAME};
use super::part::PartPlace;
use super::schema::{FRAME_TYPES, log_schema, view_schema};
use super::view::{AnswerView, AxisView, CommandView, DigitalView};

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
    command: u16,
    axes: [Option<u16>; AxisNumber::COUNT],
    axis_schema: u16,
    digital: u16,
    events: u16,
    /// Messages on each channel.
    written: BTreeMap<u16, u64>,
}

impl Channels {
    /// Writes the schemas, and the channels of a set.
    pub(super) fn add(mcap: &mut McapFile, header: &LogHeader) -> Result<Self, McapError> {
        let nothing = BTreeMap::new();
        let frames = mcap.add_schema("supersigma.Frame", "postcard-rust", FRAME_TYPES.as_bytes())?;
        let mut raw = |lane| {
            let metadata = BTreeMap::from([(LANE.to_owned(), lane_name(lane).to_owned())]);
            mcap.add_channel(frames, MICROBUS, "postcard", &metadata)
        };
        let (commands, answers) = (raw(Lane::Commands)?, raw(Lane::Answers)?);
        let mut schema = |name, schema: serde_json::Value| {
            mcap.add_schema(name, "jsonschema", schema.to_string().as_bytes())
        };
        let command_schema = schema("supersigma.Command", view_schema::<CommandView>())?;
        let axis_schema = schema("supersigma.AxisStatus", view_schema::<AnswerView<AxisView>>())?;
        let digital_schema = schema("supersigma.DigitalStatus", view_schema::<AnswerView<DigitalView>>())?;
        let event_schema = schema("foxglove.Log", log_schema())?;
        let mut channels = Self {
            commands,
            answers,
            command: mcap.add_channel(command_schema, COMMAND, "json", &nothing)?,
            axes: [None; AxisNumber::COUNT],
            axis_schema,
            digital: mcap.add_channel(digital_schema, DIGITAL, "json", &nothing)?,
            events: mcap.add_channel(event_schema, EVENTS, "json", &nothing)?,
            written: BTreeMap::new(),
        };
        for (axis, _) in header.names.iter() {
            channels.axis(axis, mcap, header)?;
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

    /// The twins of the commands.
    pub(super) const fn command(&self) -> u16 {
        self.command
    }

    /// The twins of the digital cards' answers.
    pub(super) const fn digital(&self) -> u16 {
        self.digital
    }

    /// The events.
    pub(super) const fn events(&self) -> u16 {
        self.events
    }

    /// Counts a message on a channel; returns how many there were before it.
    pub(super) fn count(&mut self, channel: u16) -> u64 {
        let written = self.written.entry(channel).or_default();
        *written += 1;
        *written - 1
    }

    /// The twins of an axis' answers; an axis that the configuration does not have gets its channel when it first speaks.
    pub(super) fn axis(
        &mut self,
        axis: AxisNumber,
        mcap: &mut McapFile,
        header: &LogHeader,
    ) -> Result<u16, McapError> {
        let slot = &mut self.axes[axis.index()];
        if let Some(channel) = *slot {
            return Ok(channel);
        }
        let topic = format!("/axis/{}/status", header.names.of(axis));
        let channel = mcap.add_channel(self.axis_schema, &topic, "json", &BTreeMap::new())?;
        *slot = Some(channel);
        Ok(channel)
    }
}
