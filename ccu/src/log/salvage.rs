//! What is whole in a damaged file: attachments, metadata and chunks, each with its place, and the places of what is not.
//!
//! ```text
//!   header │ attachment │ metadata │ chunk index… │ chunk index… │ ~~chunk~~ │ chunk │ chu
//!          └ every record judged by itself: length, form, checksum │   lost    │       └ tail
//! ```
//!
//! A record that is not good is left out. If one that is good follows where it says that it ends, the reading goes on
//! there; otherwise the file is searched for the next good chunk. Nothing of a chunk is believed that is not covered by
//! its checksum. This room reads; it decides nothing about what is done with the pieces.

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

use mcap::records::{AttachmentHeader, Header, Metadata, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};
use mcap::{MAGIC, McapError};

use super::index::{RECORD_HEAD, number};
use super::limits::{LONGEST_RECORD, options, parse};

/// What stands at a fixed distance behind the beginning of a chunk of ours: how it is compressed.
const CHUNK_MARK: (&[u8], u64) = (b"\x04\0\0\0zstd", (RECORD_HEAD + 8 + 8 + 8 + 4) as u64);
/// The same for the metadata record.
const METADATA_MARK: (&[u8], u64) = (b"\x0A\0\0\0supersigma", RECORD_HEAD as u64);
/// How much is searched at once.
const BLOCK: usize = 1 << 16;

/// Something whole, or the place of something that is not.
#[derive(Debug)]
pub(super) enum Piece {
    Header(Header),
    Attachment(AttachmentHeader, Vec<u8>),
    Metadata(Metadata),
    Chunk(Chunk),
    /// These bytes are damaged; something whole follows.
    Lost(Range<u64>),
    /// Nothing whole follows: the log is cut, or the rest of it is damaged.
    Tail(Range<u64>),
    /// The end of the messages, as their writer set it.
    End,
}

/// The records of a chunk whose checksum holds.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    bytes: Vec<u8>,
    records: Vec<(u8, Range<usize>)>,
}

impl Chunk {
    /// The records one by one.
    pub(super) fn records(&self) -> impl Iterator<Item = Result<Record<'_>, McapError>> {
        self.records.iter().map(|(opcode, place)| parse(*opcode, &self.bytes[place.clone()]))
    }
}

/// A file that is being gone through.
#[derive(Debug)]
pub(super) struct Salvage<F> {
    file: F,
    at: u64,
    end: u64,
    ended: bool,
}

/// How a record is.
enum Verdict {
    Good(Piece, u64),
    /// Good, and of no use: it is made anew.
    Useless(u64),
    /// Not good. It would end here, if its length is right.
    Bad(Option<u64>),
}

impl<F: Read + Seek> Salvage<F> {
    /// Begins behind the magic bytes; `None` if the file does not begin as MCAP files do.
    pub(super) fn new(mut file: F) -> io::Result<Option<Self>> {
        let end = file.seek(SeekFrom::End(0))?;
        let mut start = Vec::new();
        file.seek(SeekFrom::Start(0))?;
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut start)?;
        let at = start.len() as u64;
        Ok(MAGIC.starts_with(&start).then_some(Self { file, at, end, ended: false }))
    }

    /// The next piece; `None` after the end or the tail.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn next(&mut self) -> io::Result<Option<Piece>> {
        while !self.ended {
            let at = self.at;
            match self.judge(at)? {
                Verdict::Good(piece, next) => {
                    self.ended = matches!(piece, Piece::End);
                    self.at = next;
                    return Ok(Some(piece));
                }
                Verdict::Useless(next) => self.at = next,
                Verdict::Bad(next) => {
                    let follows = match next {
                        Some(next) if !matches!(self.judge(next)?, Verdict::Bad(_)) => Some(next),
                        _ => self.search(at + 1)?,
                    };
                    self.at = follows.unwrap_or(self.end);
                    self.ended = follows.is_none();
                    return Ok(match follows {
                        Some(next) => Some(Piece::Lost(at..next)),
                        None => Some(Piece::Tail(at..self.end)),
                    });
                }
            }
        }
        Ok(None)
    }

    /// Judges what stands at `at`.
    fn judge(&mut self, at: u64) -> io::Result<Verdict> {
        let mut head = [0; RECORD_HEAD];
        if at.checked_add(RECORD_HEAD as u64).is_none_or(|behind| behind > self.end) {
            return Ok(Verdict::Bad(None));
        }
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(&mut head)?;
        let body = at + RECORD_HEAD as u64;
        let next = number(&head, 1).and_then(|length| body.checked_add(length));
        let Some(next) = next.filter(|&next| next <= self.end && next - body <= LONGEST_RECORD as u64) else {
            return Ok(Verdict::Bad(None));
        };
        let length = usize::try_from(next - body).unwrap_or(LONGEST_RECORD);
        match head[0] {
            op::HEADER | op::ATTACHMENT | op::METADATA | op::CHUNK => {}
            op::DATA_END if length == 4 => return Ok(Verdict::Good(Piece::End, next)),
            op::MESSAGE_INDEX => {
                // Entries of a time and a place, 8 bytes each, and before them a channel and their length.
                let mut start = [0; 2 + 4];
                if length < start.len() {
                    return Ok(Verdict::Bad(None));
                }
                self.file.read_exact(&mut start)?;
                let entries = u32::from_le_bytes([start[2], start[3], start[4], start[5]]);
                let fits = u64::from(entries) + start.len() as u64 == next - body && entries % 16 == 0;
                return Ok(if fits { Verdict::Useless(next) } else { Verdict::Bad(None) });
            }
            _ => return Ok(Verdict::Bad(None)),
        }
        let mut record = head.to_vec();
        record.resize(RECORD_HEAD + length, 0);
        self.file.read_exact(&mut record[RECORD_HEAD..])?;
        Ok(piece(&record).map_or(Verdict::Bad(Some(next)), |piece| Verdict::Good(piece, next)))
    }

    /// The place of the first good chunk, or of our metadata record, from `from` on.
    fn search(&mut self, mut from: u64) -> io::Result<Option<u64>> {
        let marks = [CHUNK_MARK, METADATA_MARK];
        let longest = marks.iter().map(|(mark, _)| mark.len()).max().unwrap_or(0);
        let mut block = Vec::with_capacity(BLOCK);
        let earliest = from;
        while from < self.end {
            block.clear();
            self.file.seek(SeekFrom::Start(from))?;
            self.file.by_ref().take(BLOCK as u64).read_to_end(&mut block)?;
            for offset in 0..block.len() {
                for (mark, distance) in marks {
                    let place =
                        (from + offset as u64).checked_sub(distance).filter(|&place| place >= earliest);
                    if block[offset..].starts_with(mark)
                        && let Some(place) = place
                        && matches!(self.judge(place)?, Verdict::Good(..))
                    {
                        return Ok(Some(place));
                    }
                }
            }
            if block.len() < BLOCK {
                break;
            }
            // A mark may lie across the border.
            from += (BLOCK - longest) as u64;
        }
        Ok(None)
    }
}

/// What is in a whole record; `None` if it is not good.
fn piece(record: &[u8]) -> Option<Piece> {
    let (opcode, body) = (record[0], &record[RECORD_HEAD..]);
    match parse(opcode, body).ok()? {
        Record::Header(header) => Some(Piece::Header(header)),
        // The parser has compared the checksum.
        Record::Attachment { header, data, .. } => Some(Piece::Attachment(header, data.into_owned())),
        Record::Metadata(metadata) => Some(Piece::Metadata(metadata)),
        Record::Chunk { header, data } => {
            let head = 8 + 8 + 8 + 4 + 4 + header.compression.len() + 8;
            // No checksum is no proof, and a page of zeros would look like an empty chunk.
            let proved = header.uncompressed_crc != 0 && head + data.len() == body.len();
            proved.then(|| unpack(record)).flatten().map(Piece::Chunk)
        }
        _ => None,
    }
}

/// The records of a chunk; `None` if its checksum does not hold, or if they are none.
fn unpack(record: &[u8]) -> Option<Chunk> {
    let options = options(record.len() as u64).with_skip_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut chunk = Chunk::default();
    let mut rest = record;
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            LinearReadEvent::ReadRequest(bytes) => {
                let (now, later) = rest.split_at(bytes.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, data } => {
                parse(opcode, data).ok()?;
                let start = chunk.bytes.len();
                chunk.bytes.extend_from_slice(data);
                chunk.records.push((opcode, start..chunk.bytes.len()));
            }
        }
    }
    Some(chunk)
}
