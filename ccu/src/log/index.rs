//! The summary of a complete log: what it holds, and where its chunks stand, without reading any of them.
//!
//! It is only believed when its checksum holds; a file that ends otherwise is read from its beginning instead. Of the
//! chunk index, which grows with the log, only what was asked for is kept in memory.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::{Range, RangeInclusive};

use mcap::MAGIC;
use mcap::records::{Channel, Record, SchemaHeader, Statistics, op};

use super::header::WallTime;
use super::limits::{LONGEST_RECORD, parse};

/// A record's code and length.
pub(super) const RECORD_HEAD: usize = 1 + 8;
/// The footer as a record: two places and a checksum.
const FOOTER: usize = RECORD_HEAD + 8 + 8 + 4;

/// What a summary says.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Index {
    pub(super) schemas: BTreeMap<u16, (SchemaHeader, Vec<u8>)>,
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) statistics: Statistics,
    /// Where the chunks stand that were asked for, in the order of the file.
    pub(super) chunks: Vec<Range<u64>>,
    /// How many chunks there are altogether.
    pub(super) chunk_count: u64,
}

impl Index {
    /// The summary at the end of a file, and its chunks that hold messages of a `wanted` channel within `times`; `None`
    /// if there is no summary that can be believed.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn read(
        file: &mut (impl Read + Seek),
        wanted: impl Fn(&Channel) -> bool,
        times: &RangeInclusive<WallTime>,
    ) -> io::Result<Option<Self>> {
        let end = file.seek(SeekFrom::End(0))?;
        let Some(footer_at) = end.checked_sub((FOOTER + MAGIC.len()) as u64) else {
            return Ok(None);
        };
        let mut tail = [0; FOOTER + MAGIC.len()];
        file.seek(SeekFrom::Start(footer_at))?;
        file.read_exact(&mut tail)?;
        let start = number(&tail, RECORD_HEAD).unwrap_or(0);
        let is_footer = tail[0] == op::FOOTER && tail.ends_with(MAGIC);
        // Without a summary its place is 0; without a checksum that is.
        if !is_footer || start == 0 || start > footer_at {
            return Ok(None);
        }
        file.seek(SeekFrom::Start(start))?;
        let mut summary = BufReader::with_capacity(1 << 20, file).take(footer_at - start);
        let mut index = Self::default();
        let mut checksum = crc32fast::Hasher::new();
        let mut record = Vec::new();
        while summary.limit() > 0 {
            record.resize(RECORD_HEAD, 0);
            let length = match summary.read_exact(&mut record) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
                other => other.map(|()| number(&record, 1).unwrap_or(u64::MAX))?,
            };
            if length > summary.limit().min(LONGEST_RECORD as u64) {
                return Ok(None);
            }
            let length = usize::try_from(length).unwrap_or(LONGEST_RECORD);
            record.resize(RECORD_HEAD + length, 0);
            summary.read_exact(&mut record[RECORD_HEAD..])?;
            checksum.update(&record);
            if index.take(record[0], &record[RECORD_HEAD..], &wanted, times, start).is_none() {
                return Ok(None);
            }
        }
        let saved = &tail[FOOTER - 4..FOOTER];
        checksum.update(&tail[..FOOTER - 4]);
        Ok((checksum.finalize().to_le_bytes() == saved).then_some(index))
    }

    /// Takes note of one record; `None` if it is none.
    fn take(
        &mut self,
        opcode: u8,
        body: &[u8],
        wanted: &impl Fn(&Channel) -> bool,
        times: &RangeInclusive<WallTime>,
        end: u64,
    ) -> Option<()> {
        // There are hundreds of thousands of these in a long log, and only four of their values are of interest.
        if opcode == op::CHUNK_INDEX {
            let [first, last, at, length] = [0, 8, 16, 24].map(|place| number(body, place));
            let (first, last) = (WallTime(first?), WallTime(last?));
            let place = at?..at?.checked_add(length?).filter(|&stop| stop <= end)?;
            let offsets = usize::try_from(u32::from_le_bytes(body.get(32..36)?.try_into().ok()?)).ok()?;
            let offsets = body.get(36..36_usize.checked_add(offsets)?)?;
            let held = offsets.chunks_exact(2 + 8).any(|entry| {
                let channel = self.channels.get(&u16::from_le_bytes([entry[0], entry[1]]));
                // The format does not say that channels come first.
                channel.is_none_or(wanted)
            });
            if held && first <= *times.end() && last >= *times.start() {
                self.chunks.push(place);
            }
            self.chunk_count += 1;
            return Some(());
        }
        match parse(opcode, body).ok()? {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header, data.into_owned()));
            }
            Record::Channel(channel) => {
                self.channels.insert(channel.id, channel);
            }
            Record::Statistics(statistics) => self.statistics = statistics,
            _ => {}
        }
        Some(())
    }
}

/// Parts of a file, one after the other.
#[derive(Debug)]
pub(super) struct Parts<F> {
    file: F,
    coming: std::vec::IntoIter<Range<u64>>,
    left: u64,
}

impl<F: Read + Seek> Parts<F> {
    pub(super) fn new(file: F, parts: Vec<Range<u64>>) -> Self {
        Self { file, coming: parts.into_iter(), left: 0 }
    }
}

impl<F: Read + Seek> Read for Parts<F> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.left == 0 {
            let Some(part) = self.coming.next() else { return Ok(0) };
            self.file.seek(SeekFrom::Start(part.start))?;
            self.left = part.end - part.start;
        }
        let read = (&mut self.file).take(self.left).read(into)?;
        self.left -= read as u64;
        Ok(read)
    }
}

/// A number of eight bytes, as the format writes them.
pub(super) fn number(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?))
}
