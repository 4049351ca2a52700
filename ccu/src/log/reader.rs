//! The log's reader: the frames of a file, complete or cut at any byte, one chunk in memory at a time.
//!
//! A log whose writer was killed has no summary and may end inside a record. So the file is read from its beginning
//! and never through its index; a chunk is only opened when all of it is there and its checksum holds. The end of
//! the readable part is the end of the iteration, and [`LogReader::truncated`] says whether it is the log's end too.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{Frame, FrameError};

use super::LogError;
use super::channels::{EVENTS, LANE, MICROBUS, lane_name};
use super::header::{CONFIG_NAME, LogHeader, METADATA_NAME, SCRIPT_NAME, WallTime};

/// No record, and no chunk, of a log comes near this; a longer one is damage.
const LONGEST_RECORD: usize = 256 << 20;
/// What was on the bus once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoggedFrame {
    /// Its place in the log.
    pub log_time: WallTime,
    /// The service that carried it.
    pub lane: Lane,
    /// The bytes as they travelled.
    pub bytes: Vec<u8>,
    /// The frame in them.
    pub frame: Result<Frame, FrameError>,
}

/// A log that is being read. Iterates over the frames of `/microbus`.
pub struct LogReader {
    path: PathBuf,
    input: BufReader<File>,
    format: LinearReader,
    header: Option<LogHeader>,
    config: String,
    script: Option<String>,
    lanes: HashMap<u16, Lane>,
    /// The channels of the twins, for whoever wants them.
    twins: HashSet<u16>,
    with_twins: bool,
    frames: u64,
    truncated: bool,
    ended: bool,
}

/// What one record meant.
pub(super) enum Step {
    Frame(LoggedFrame),
    /// The JSON twin of a frame, if twins are wanted.
    Twin(Vec<u8>),
    /// A message of another channel, or of another program.
    Message,
    Other,
    End,
}

impl LogReader {
    /// Opens a log and reads what stands before its first frame.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a log of this program. A log that is cut short is not an error.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let read = |source| LogError::Read { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(read)?;
        let mut start = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut start).map_err(read)?;
        if !MAGIC.starts_with(&start) {
            return Err(LogError::NotALog {
                path: path.to_owned(),
                what: "it does not begin as MCAP files do",
            });
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST_RECORD);
        let short = start.len() < MAGIC.len();
        let mut reader = Self {
            path: path.to_owned(),
            input: BufReader::new(file),
            format: LinearReader::new_with_options(options),
            header: None,
            config: String::new(),
            script: None,
            lanes: HashMap::new(),
            twins: HashSet::new(),
            with_twins: false,
            frames: 0,
            truncated: short,
            ended: short,
        };
        while reader.header.is_none() && !reader.truncated {
            match reader.step()? {
                Step::Other => {}
                Step::End if reader.truncated => {}
                Step::End | Step::Frame(_) | Step::Twin(_) | Step::Message => {
                    return Err(LogError::NotALog {
                        path: reader.path,
                        what: "it is MCAP, but has no metadata record `supersigma`",
                    });
                }
            }
        }
        Ok(reader)
    }

    /// What the log says about itself; `None` if it is cut before it says so, and then it holds no frames either.
    #[must_use]
    pub const fn header(&self) -> Option<&LogHeader> {
        self.header.as_ref()
    }

    /// Whether the log ends before its footer. Known when the iteration has ended.
    #[must_use]
    pub const fn truncated(&self) -> bool {
        self.truncated
    }

    /// The same reader, whose steps tell the twins too.
    pub(super) fn with_twins(self) -> Self {
        Self { with_twins: true, ..self }
    }

    pub(super) fn step(&mut self) -> Result<Step, LogError> {
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
                    match self.input.read(self.format.insert(bytes)) {
                        Ok(read) => self.format.notify_read(read),
                        Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                        Err(source) => {
                            return Err(LogError::Read { path: self.path.clone(), source });
                        }
                    }
                    continue;
                }
                // A power cut can leave zeros where the last writes should be; no record has the code 0.
                Some(Ok(LinearReadEvent::Record { opcode: 0, .. }) | Err(McapError::UnexpectedEof)) => {
                    self.truncated = true;
                    return Ok(Step::End);
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
                Some(Err(source)) => {
                    return Err(LogError::Damaged { path: self.path.clone(), frames: self.frames, source });
                }
            };
            if opcode == mcap::records::op::ATTACHMENT && !attachment_is_whole(data) {
                let source = McapError::UnexpectedEoc;
                return Err(LogError::Damaged { path: self.path.clone(), frames: self.frames, source });
            }
            let record = mcap::parse_record(opcode, data).map_err(|source| LogError::Damaged {
                path: self.path.clone(),
                frames: self.frames,
                source,
            })?;
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
                Record::Metadata(metadata) if metadata.name == METADATA_NAME => {
                    self.header = LogHeader::from_metadata(&metadata.metadata).map(|header| LogHeader {
                        config: std::mem::take(&mut self.config),
                        script: self.script.take(),
                        ..header
                    });
                    Step::Other
                }
                Record::Channel(channel) => {
                    if channel.topic == MICROBUS {
                        let lane = [Lane::Commands, Lane::Answers].into_iter().find(|&lane| {
                            channel.metadata.get(LANE).map(String::as_str) == Some(lane_name(lane))
                        });
                        self.lanes.extend(lane.map(|lane| (channel.id, lane)));
                    } else if channel.topic != EVENTS {
                        self.twins.insert(channel.id);
                    }
                    Step::Other
                }
                Record::Message { header, data } => match self.lanes.get(&header.channel_id) {
                    Some(&lane) => {
                        self.frames += 1;
                        Step::Frame(LoggedFrame {
                            log_time: WallTime(header.log_time),
                            lane,
                            frame: Frame::decode(&data),
                            bytes: data.into_owned(),
                        })
                    }
                    None if self.with_twins && self.twins.contains(&header.channel_id) => {
                        Step::Twin(data.into_owned())
                    }
                    None => Step::Message,
                },
                _ => Step::Other,
            });
        }
    }
}

impl Iterator for LogReader {
    type Item = Result<LoggedFrame, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.step() {
                Ok(Step::Frame(frame)) => return Some(Ok(frame)),
                Ok(Step::Twin(_) | Step::Message | Step::Other) => {}
                Ok(Step::End) => return None,
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// Whether an attachment record has room for its fixed parts (two times, two strings' lengths, the data's length, a
/// checksum) and its two strings. The format's parser takes that for granted.
fn attachment_is_whole(record: &[u8]) -> bool {
    let length = |at: usize| {
        let bytes = record.get(at..at.checked_add(4)?)?;
        usize::try_from(u32::from_le_bytes(bytes.try_into().ok()?)).ok()
    };
    let needed = || {
        let name = length(16)?;
        let media_type = length(name.checked_add(20)?)?;
        name.checked_add(media_type)?.checked_add(8 + 8 + 4 + 4 + 8 + 4)
    };
    needed().is_some_and(|needed| record.len() >= needed)
}
