//! The messages of a log, one chunk in memory at a time: the whole file from its beginning, complete or cut at any
//! byte, or only chunks that the index names.
//!
//! A log whose writer was killed has no summary and may end inside a record. A chunk is only opened when all of it is
//! there and its checksum holds. The end of the readable part is the end of the messages, and [`Messages::truncated`]
//! says whether it is the log's end too. What the messages mean is decided in `reader` and `info`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use mcap::records::{Channel, MessageHeader, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use mcap::{MAGIC, McapError};

use super::LogError;
use super::channels::MICROBUS;
use super::header::{CONFIG_NAME, LogHeader, METADATA_NAME, SCRIPT_NAME, WallTime};
use super::index::{Index, Parts};
use super::limits::{LONGEST_RECORD, ONE_READ, options, parse};

/// A channel, and what is known of it so far.
#[derive(Debug, Clone)]
pub(super) struct Listed {
    pub(super) channel: Channel,
    /// How many messages of it have been read, or counted by the summary.
    pub(super) messages: u64,
    wanted: bool,
}

/// The messages of a file.
pub(super) struct Messages {
    path: PathBuf,
    input: Box<dyn Read + Send>,
    format: LinearReader,
    wanted: fn(&Channel) -> bool,
    header: Option<LogHeader>,
    entries: BTreeMap<String, String>,
    config: String,
    script: Option<String>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Listed>,
    /// How long the records of both are that are kept.
    described: usize,
    /// The log times of the first and the last message.
    times: Option<(WallTime, WallTime)>,
    indexed: bool,
    truncated: bool,
    ended: bool,
}

enum Step {
    /// Of a channel that is wanted.
    Message(MessageHeader, Vec<u8>),
    /// Of another one.
    Unwanted,
    Other,
    End,
}

impl Messages {
    /// Opens a log and reads what stands before its first message. Messages of channels that are not `wanted` are
    /// only counted.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a log of this program. A log that is cut short is not an error.
    pub(super) fn open(path: &Path, wanted: fn(&Channel) -> bool) -> Result<Self, LogError> {
        let read = |source| LogError::Read { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        let mut start = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut start).map_err(read)?;
        if !MAGIC.starts_with(&start) {
            return Err(LogError::NotALog {
                path: path.to_owned(),
                what: "it does not begin as MCAP files do",
            });
        }
        let short = start.len() < MAGIC.len();
        let mut messages = Self {
            path: path.to_owned(),
            input: Box::new(BufReader::new(file)),
            format: LinearReader::new_with_options(options(length)),
            wanted,
            header: None,
            entries: BTreeMap::new(),
            config: String::new(),
            script: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            described: 0,
            times: None,
            indexed: false,
            truncated: short,
            ended: short,
        };
        while messages.header.is_none() && !messages.truncated {
            match messages.step()? {
                Step::Other => {}
                Step::End if messages.truncated => {}
                Step::End | Step::Message(..) | Step::Unwanted => {
                    return Err(LogError::NotALog {
                        path: messages.path,
                        what: "it is MCAP, but has no metadata record `supersigma`",
                    });
                }
            }
        }
        Ok(messages)
    }

    /// Goes on with nothing but the chunks that hold wanted messages within `times`, if the log is complete. The
    /// summary's counts are then those of [`Messages::channels`]. Returns whether that could be done.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn narrow(&mut self, times: &RangeInclusive<WallTime>) -> Result<bool, LogError> {
        let read = |source| LogError::Read { path: self.path.clone(), source };
        let mut file = File::open(&self.path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        let Some(index) = Index::read(&mut file, self.wanted, times).map_err(read)? else {
            return Ok(false);
        };
        let counts = &index.statistics.channel_message_counts;
        self.channels = index
            .channels
            .into_iter()
            .map(|(id, channel)| {
                let messages = counts.get(&id).copied().unwrap_or(0);
                (id, Listed { wanted: (self.wanted)(&channel), channel, messages })
            })
            .collect();
        self.schemas = index.schemas.into_iter().map(|(id, (schema, _))| (id, schema.name)).collect();
        let bounds = [index.statistics.message_start_time, index.statistics.message_end_time].map(WallTime);
        self.times = (index.statistics.message_count > 0).then_some((bounds[0], bounds[1]));
        self.input = Box::new(BufReader::new(Parts::new(file, index.chunks)));
        // The end of the last chunk is the end.
        self.format = LinearReader::new_with_options(options(length).with_skip_end_magic(true));
        (self.indexed, self.truncated, self.ended) = (true, false, false);
        Ok(true)
    }

    /// What the log says about itself; `None` if it is cut before it says so, and then it holds no messages either.
    pub(super) const fn header(&self) -> Option<&LogHeader> {
        self.header.as_ref()
    }

    /// All entries of the metadata record.
    pub(super) const fn entries(&self) -> &BTreeMap<String, String> {
        &self.entries
    }

    /// The channels by their numbers in the file.
    pub(super) const fn channels(&self) -> &BTreeMap<u16, Listed> {
        &self.channels
    }

    /// The name of a schema.
    pub(super) fn schema(&self, id: u16) -> Option<&str> {
        self.schemas.get(&id).map(String::as_str)
    }

    /// The log times of the first and the last message.
    pub(super) const fn times(&self) -> Option<(WallTime, WallTime)> {
        self.times
    }

    /// Whether the log ends before its footer. Known when the messages have ended.
    pub(super) const fn truncated(&self) -> bool {
        self.truncated
    }

    /// The next message of a wanted channel.
    ///
    /// # Errors
    /// If the log cannot be read or is damaged; there are no messages after that.
    pub(super) fn next(&mut self) -> Result<Option<(MessageHeader, Vec<u8>)>, LogError> {
        loop {
            match self.step()? {
                Step::Message(header, data) => return Ok(Some((header, data))),
                Step::Unwanted | Step::Other => {}
                Step::End => return Ok(None),
            }
        }
    }

    fn step(&mut self) -> Result<Step, LogError> {
        if self.ended {
            return Ok(Step::End);
        }
        let step = self.next_record();
        if matches!(step, Ok(Step::End) | Err(_)) {
            self.ended = true;
        }
        step
    }

    fn next_record(&mut self) -> Result<Step, LogError> {
        loop {
            let (opcode, data) = match self.format.next_event() {
                None => return Ok(Step::End),
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => {
                    match self.input.read(self.format.insert(bytes.min(ONE_READ))) {
                        Ok(read) => self.format.notify_read(read),
                        Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                        Err(source) => {
                            return Err(LogError::Read { path: self.path.clone(), source });
                        }
                    }
                    continue;
                }
                // A power cut can leave zeros where the last writes should be; no record has the code 0.
                Some(Ok(LinearReadEvent::Record { opcode: 0, .. }) | Err(McapError::UnexpectedEof))
                    if !self.indexed =>
                {
                    self.truncated = true;
                    return Ok(Step::End);
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
                Some(Err(source)) => return Err(damaged(&self.path, &self.channels, source)),
            };
            let length = data.len();
            let record = parse(opcode, data).map_err(|source| damaged(&self.path, &self.channels, source))?;
            let is_new = match &record {
                Record::Schema { header, .. } => !self.schemas.contains_key(&header.id),
                Record::Channel(channel) => !self.channels.contains_key(&channel.id),
                _ => false,
            };
            self.described += if is_new { length } else { 0 };
            if self.described > LONGEST_RECORD {
                let source = McapError::RecordTooLarge { opcode, len: self.described as u64 };
                return Err(damaged(&self.path, &self.channels, source));
            }
            return Ok(match record {
                Record::Attachment { header, data, .. } => {
                    let text = String::from_utf8_lossy(&data).into_owned();
                    match header.name.as_str() {
                        CONFIG_NAME => self.config = text,
                        SCRIPT_NAME => self.script = Some(text),
                        _ => {}
                    }
                    Step::Other
                }
                Record::Metadata(metadata) if metadata.name == METADATA_NAME && self.header.is_none() => {
                    self.header = LogHeader::from_metadata(&metadata.metadata).map(|header| LogHeader {
                        config: std::mem::take(&mut self.config),
                        script: self.script.take(),
                        ..header
                    });
                    self.entries = metadata.metadata;
                    Step::Other
                }
                Record::Schema { header, .. } => {
                    self.schemas.entry(header.id).or_insert(header.name);
                    Step::Other
                }
                Record::Channel(channel) => {
                    let wanted = (self.wanted)(&channel);
                    self.channels.entry(channel.id).or_insert(Listed { channel, messages: 0, wanted });
                    Step::Other
                }
                Record::Message { header, data } => {
                    let listed = self.channels.get_mut(&header.channel_id);
                    if !self.indexed {
                        let time = WallTime(header.log_time);
                        let (first, last) = self.times.unwrap_or((time, time));
                        self.times = Some((first.min(time), last.max(time)));
                    }
                    match listed {
                        None => Step::Unwanted,
                        Some(listed) => {
                            listed.messages += u64::from(!self.indexed);
                            if listed.wanted {
                                Step::Message(header, data.into_owned())
                            } else {
                                Step::Unwanted
                            }
                        }
                    }
                }
                _ => Step::Other,
            });
        }
    }
}

fn damaged(path: &Path, channels: &BTreeMap<u16, Listed>, source: McapError) -> LogError {
    let frames = channels.values().filter(|listed| listed.channel.topic == MICROBUS);
    LogError::Damaged { path: path.to_owned(), frames: frames.map(|listed| listed.messages).sum(), source }
}
