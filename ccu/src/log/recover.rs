//! `ccu recover`: a complete log, with its index, out of one that was cut or damaged.
//!
//! Every message of every whole chunk is copied as it is, bytes, numbers and times, in the chunk in which it stood;
//! attachments and metadata too. Nothing is decoded anew and nothing is made up. What comes out is read back, through its
//! new index, and compared with what went in before anybody is told that it is good: the file has its name only then.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use mcap::records::{Channel, MessageHeader, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use mcap::{Attachment, McapError, WriteOptions};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use serde::{Serialize, Serializer};
use supersigma_protocol::{Frame, Sender, Tick};

use super::LogError;
use super::channels::MICROBUS;
use super::file::OWNER_ONLY;
use super::header::{LogHeader, METADATA_NAME, WallTime};
use super::index::{Index, Parts};
use super::limits::{ONE_READ, options, parse};
use super::salvage::{Chunk, Piece, Salvage};
use super::senders::Senders;

/// What was recovered.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Recovery {
    /// Whether nothing had been missing: the log was complete, and the new one is a copy.
    pub complete: bool,
    /// Chunks that were kept.
    pub chunks: u64,
    /// Messages of all channels.
    pub messages: u64,
    /// Messages of `/microbus` among them.
    pub frames: u64,
    /// Attachments that were kept.
    pub attachments: u32,
    /// Metadata records that were kept.
    pub metadata: u32,
    /// The tick of the last frame that was kept.
    pub last: Option<Tick>,
    /// Messages in whole chunks that had to be left out, because the description of their channel is lost.
    pub orphans: u64,
    /// What was damaged in the middle.
    pub lost: Vec<Lost>,
    /// The bytes at the end that are no whole record.
    #[serde(serialize_with = "place")]
    pub tail: Option<Range<u64>>,
    /// The length of the new log.
    pub bytes: u64,
}

/// A damaged part of a log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Lost {
    /// Its first byte, and the first one after it.
    #[serde(serialize_with = "range")]
    pub bytes: Range<u64>,
    /// The tick of the last frame before it.
    pub after: Option<Tick>,
    /// The tick of the first frame behind it.
    pub before: Option<Tick>,
    /// The frames that are missing there by their senders' numbers. A sender that began anew in there hides its own.
    pub frames: u64,
}

fn range<S: Serializer>(range: &Range<u64>, serializer: S) -> Result<S::Ok, S::Error> {
    [range.start, range.end].serialize(serializer)
}

#[expect(clippy::ref_option, reason = "serde calls it so")]
fn place<S: Serializer>(place: &Option<Range<u64>>, serializer: S) -> Result<S::Ok, S::Error> {
    place.as_ref().map(|range| [range.start, range.end]).serialize(serializer)
}

/// Recovers the log at `log` into a new file at `out`. The log is only read. `out` appears when it is complete and on disk,
/// and never in the place of another file.
///
/// # Errors
/// If `out` exists or cannot be written, if `log` cannot be read, is no log of this program or ends before its first
/// frame, or if what was written does not read back as it should. There is no `out` then.
pub fn recover(log: &Path, out: &Path) -> Result<Recovery, LogError> {
    let exists = || LogError::Exists { path: out.to_owned() };
    if out.symlink_metadata().is_ok() {
        return Err(exists());
    }
    let read = |source| LogError::Read { path: log.to_owned(), source };
    let create = |error| LogError::Create { path: out.to_owned(), error };
    let input = BufReader::with_capacity(1 << 18, File::open(log).map_err(read)?);
    let temporary = Temporary::beside(out).map_err(create)?;
    let mut file = OpenOptions::new()
        .read(true)
        .write(true)
        .create_new(true)
        .mode(OWNER_ONLY)
        .open(&temporary.0)
        .map_err(create)?;
    let mut recovery = rebuild(input, &mut file).map_err(|trouble| trouble.with(log, out))?;
    file.sync_all().map_err(create)?;
    recovery.bytes = file.metadata().map_err(create)?.len();
    match renameat_with(CWD, &temporary.0, CWD, out, RenameFlags::NOREPLACE) {
        Ok(()) => Ok(recovery),
        Err(rustix::io::Errno::EXIST) => Err(exists()),
        Err(error) => Err(create(error.into())),
    }
}

/// A file beside the one that is wanted; gone with this value, if it still has its own name.
struct Temporary(PathBuf);

impl Temporary {
    fn beside(out: &Path) -> io::Result<Self> {
        let name = out.file_name().ok_or_else(|| io::Error::from(io::ErrorKind::InvalidFilename))?;
        let name = format!(".{}.{}.part", name.to_string_lossy(), std::process::id());
        Ok(Self(out.with_file_name(name)))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // Renamed already, after a success.
        let _ = fs::remove_file(&self.0);
    }
}

/// What can go wrong with two files of which only the caller knows the names.
#[derive(Debug)]
pub(super) enum Trouble {
    Read(io::Error),
    Write(McapError),
    NotALog(&'static str),
    NothingIn,
    NotAsWritten(&'static str),
}

impl Trouble {
    fn with(self, log: &Path, out: &Path) -> LogError {
        match self {
            Self::Read(source) => LogError::Read { path: log.to_owned(), source },
            Self::Write(error) => LogError::Write { path: out.to_owned(), error },
            Self::NotALog(what) => LogError::NotALog { path: log.to_owned(), what },
            Self::NothingIn => LogError::NothingIn { path: log.to_owned() },
            Self::NotAsWritten(what) => LogError::NotAsWritten { path: out.to_owned(), what },
        }
    }
}

impl From<McapError> for Trouble {
    fn from(error: McapError) -> Self {
        Self::Write(error)
    }
}

/// Recovers `log` into `out`, and reads `out` back. The length is left 0.
pub(super) fn rebuild(
    mut log: impl Read + Seek,
    out: &mut (impl Read + Write + Seek),
) -> Result<Recovery, Trouble> {
    // What a complete log says of itself, if it does; of the chunks, none is needed.
    let index =
        Index::read(&mut log, |_| false, &(WallTime(0)..=WallTime(u64::MAX))).map_err(Trouble::Read)?;
    let Some(mut salvage) = Salvage::new(log).map_err(Trouble::Read)? else {
        return Err(Trouble::NotALog("it does not begin as MCAP files do"));
    };
    let first = salvage.next().map_err(Trouble::Read)?;
    let options = WriteOptions::new().compression_threads(0).chunk_size(None).disable_seeking(true);
    let options = match &first {
        Some(Piece::Header(header)) => options.profile(&header.profile).library(&header.library),
        _ => options.profile(METADATA_NAME),
    };
    let mcap = options.create(BufWriter::new(&mut *out))?;
    let mut copy = Copy {
        mcap,
        index: index.clone(),
        channels: BTreeSet::new(),
        microbus: BTreeSet::new(),
        senders: Senders::default(),
        heard: BTreeSet::new(),
        ours: false,
        tally: Tally::default(),
        recovery: Recovery::default(),
    };
    let mut ended = false;
    let mut next = first;
    while let Some(piece) = next {
        ended |= matches!(piece, Piece::End);
        copy.take(piece)?;
        next = salvage.next().map_err(Trouble::Read)?;
    }
    let (mut recovery, tally) = copy.finish()?;
    let counted = index.is_some_and(|index| index.statistics.message_count == recovery.messages);
    recovery.complete = ended && counted && recovery.lost.is_empty() && recovery.orphans == 0;
    compare(out, &recovery, &tally)?;
    Ok(recovery)
}

/// What went into the copy.
#[derive(Debug, Default)]
struct Tally {
    /// Of all messages: channel, number, times and bytes, in their order.
    checksum: crc32fast::Hasher,
    channels: BTreeMap<u16, u64>,
}

impl Tally {
    fn add(&mut self, header: &MessageHeader, data: &[u8]) {
        *self.channels.entry(header.channel_id).or_default() += 1;
        self.checksum.update(&header.channel_id.to_le_bytes());
        self.checksum.update(&header.sequence.to_le_bytes());
        self.checksum.update(&header.log_time.to_le_bytes());
        self.checksum.update(&header.publish_time.to_le_bytes());
        self.checksum.update(&(data.len() as u64).to_le_bytes());
        self.checksum.update(data);
    }
}

/// A copy that is being written.
struct Copy<W: Write + Seek> {
    mcap: mcap::Writer<W>,
    index: Option<Index>,
    channels: BTreeSet<u16>,
    /// Those among the channels that carry frames.
    microbus: BTreeSet<u16>,
    senders: Senders,
    /// Who has spoken since the last damaged part.
    heard: BTreeSet<Sender>,
    /// Whether our metadata record has come.
    ours: bool,
    tally: Tally,
    recovery: Recovery,
}

impl<W: Write + Seek> Copy<W> {
    fn take(&mut self, piece: Piece) -> Result<(), Trouble> {
        match piece {
            Piece::Header(_) | Piece::End => {}
            Piece::Attachment(header, data) => {
                self.mcap.attach(&Attachment {
                    log_time: header.log_time,
                    create_time: header.create_time,
                    name: header.name,
                    media_type: header.media_type,
                    data: data.into(),
                })?;
                self.recovery.attachments += 1;
            }
            Piece::Metadata(metadata) => {
                self.ours |=
                    metadata.name == METADATA_NAME && LogHeader::from_metadata(&metadata.metadata).is_some();
                self.mcap.write_metadata(&metadata)?;
                self.recovery.metadata += 1;
            }
            Piece::Chunk(chunk) => self.chunk(&chunk)?,
            Piece::Lost(bytes) => {
                self.heard.clear();
                self.recovery.lost.push(Lost { bytes, after: self.recovery.last, before: None, frames: 0 });
            }
            Piece::Tail(bytes) => self.recovery.tail = Some(bytes).filter(|bytes| !bytes.is_empty()),
        }
        Ok(())
    }

    fn chunk(&mut self, chunk: &Chunk) -> Result<(), Trouble> {
        for record in chunk.records() {
            match record? {
                Record::Schema { header, data } => {
                    self.mcap.add_schema_with_id(header.id, &header.name, &header.encoding, &data)?;
                }
                Record::Channel(channel) => self.channel(&channel)?,
                Record::Message { header, data } => self.message(&header, &data)?,
                // Chunks of ours hold nothing else.
                _ => {}
            }
        }
        self.mcap.flush()?;
        self.recovery.chunks += 1;
        Ok(())
    }

    fn channel(&mut self, channel: &Channel) -> Result<(), Trouble> {
        let Channel { id, schema_id, topic, message_encoding, metadata } = channel;
        self.mcap.add_channel_with_id(*id, *schema_id, topic, message_encoding, metadata)?;
        self.channels.insert(*id);
        if topic == MICROBUS {
            self.microbus.insert(*id);
        }
        Ok(())
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), Trouble> {
        if !self.channels.contains(&header.channel_id) && !self.find(header.channel_id)? {
            self.recovery.orphans += 1;
            return Ok(());
        }
        self.mcap.write_to_known_channel(header, data)?;
        self.tally.add(header, data);
        self.recovery.messages += 1;
        if !self.microbus.contains(&header.channel_id) {
            return Ok(());
        }
        self.recovery.frames += 1;
        if let Ok(frame) = Frame::decode(data) {
            let (gap, _) = self.senders.note(&frame, frame.tick);
            // The first frame of a sender since then shows what of its own went with the damaged part.
            if let Some(lost) = self.recovery.lost.last_mut() {
                lost.before.get_or_insert(frame.tick);
                if self.heard.insert(frame.sender) {
                    lost.frames += gap.map_or(0, |gap| gap.lost());
                }
            }
            self.recovery.last = Some(frame.tick);
        }
        Ok(())
    }

    /// The description of a channel whose own record is lost, from the summary.
    fn find(&mut self, id: u16) -> Result<bool, Trouble> {
        let Some((channel, schema)) = self.index.as_ref().and_then(|index| {
            let channel = index.channels.get(&id)?;
            Some((channel.clone(), index.schemas.get(&channel.schema_id).cloned()))
        }) else {
            return Ok(false);
        };
        if let Some((header, data)) = schema {
            self.mcap.add_schema_with_id(header.id, &header.name, &header.encoding, &data)?;
        }
        self.channel(&channel)?;
        Ok(true)
    }

    fn finish(mut self) -> Result<(Recovery, Tally), Trouble> {
        if !self.ours {
            let nothing = self.recovery.messages == 0 && self.recovery.lost.is_empty();
            return Err(if nothing {
                Trouble::NothingIn
            } else {
                Trouble::NotALog("its metadata record `supersigma` is missing or damaged")
            });
        }
        if self.recovery.messages == 0 && self.recovery.orphans > 0 {
            return Err(Trouble::NotALog("the description of its channels is damaged"));
        }
        self.mcap.finish()?;
        self.mcap.into_inner().flush().map_err(|error| Trouble::Write(error.into()))?;
        Ok((self.recovery, self.tally))
    }
}

/// Reads the copy back, by its index, and compares.
fn compare(out: &mut (impl Read + Seek), recovery: &Recovery, tally: &Tally) -> Result<(), Trouble> {
    let not = |what| Err(Trouble::NotAsWritten(what));
    let unreadable = |_| Trouble::NotAsWritten("it cannot be read back");
    let everything = WallTime(0)..=WallTime(u64::MAX);
    let Some(index) = Index::read(out, |_| true, &everything).map_err(unreadable)? else {
        return not("its summary does not read back");
    };
    let counted = &index.statistics;
    if counted.channel_message_counts != tally.channels
        || counted.message_count != recovery.messages
        || (counted.attachment_count, counted.metadata_count) != (recovery.attachments, recovery.metadata)
    {
        return not("its statistics are others");
    }
    let length = out.seek(SeekFrom::End(0)).map_err(unreadable)?;
    let mut reader = LinearReader::new_with_options(options(length).with_skip_end_magic(true));
    let mut parts = BufReader::new(Parts::new(out, index.chunks));
    let mut read = Tally::default();
    while let Some(event) = reader.next_event() {
        match event.map_err(|_| Trouble::NotAsWritten("a chunk does not read back"))? {
            LinearReadEvent::ReadRequest(bytes) => {
                let bytes = parts.read(reader.insert(bytes.min(ONE_READ))).map_err(unreadable)?;
                reader.notify_read(bytes);
            }
            LinearReadEvent::Record { opcode, data } => {
                if let Ok(Record::Message { header, data }) = parse(opcode, data) {
                    read.add(&header, &data);
                }
            }
        }
    }
    if read.channels != tally.channels || read.checksum.finalize() != tally.checksum.clone().finalize() {
        return not("its messages are others");
    }
    Ok(())
}
