//! How much a reader takes into memory, whatever a file claims of itself: lengths in a log are only numbers, and a file of
//! 200 bytes may say of a record that it is as long as all memory. Nothing is read in here.
//!
//! - A record grows in memory as its bytes come out of the file, [`ONE_READ`] at a time, not by what its head says.
//! - A chunk is unpacked in one piece, so what it claims to hold is bounded: by [`LONGEST_RECORD`], and by what so short a
//!   file can hold at all.
//! - Schemas and channels are kept to the end; all of them together are bounded by [`LONGEST_RECORD`] too.
//! - A text in a record is no longer than what follows it there: see [`parse`].

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::LinearReaderOptions;

/// No record, and no chunk, of a log comes near this, the writer's chunks have one mebibyte; a longer one is damage.
pub(super) const LONGEST_RECORD: usize = 16 << 20;

/// No byte of Zstandard holds more: a block of 128 KiB takes four bytes at least (RFC 8878, 3.1.1.2).
const UNPACKED_FROM_A_BYTE: u64 = 32 << 10;

/// So much is read at once.
pub(super) const ONE_READ: usize = 64 << 10;

/// What a record, or the contents of a chunk, in a file of this length may have at most.
fn longest_in(file: u64) -> usize {
    let held = usize::try_from(file.saturating_mul(UNPACKED_FROM_A_BYTE)).unwrap_or(usize::MAX);
    held.min(LONGEST_RECORD)
}

/// For reading records from a file of this length, or from a record of this length out of one, without magic bytes before
/// them. Only chunks whose checksums hold are opened.
pub(super) fn options(length: u64) -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(longest_in(length))
}

/// A part of a record, in front of whatever else it has.
#[derive(Debug, Clone, Copy)]
enum Part {
    /// So many bytes.
    Bytes(usize),
    /// A length, and so many bytes.
    Text,
    /// A length, and so many bytes of pairs of texts.
    Texts,
}

/// The record in these bytes. The format's library makes room for a text before it looks whether there is one.
///
/// # Errors
/// If it is not as the format has it.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    use Part::{Bytes, Text, Texts};
    let parts: &[Part] = match opcode {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Bytes(2), Text, Text],
        op::CHANNEL => &[Bytes(2 + 2), Text, Text, Texts],
        op::CHUNK => &[Bytes(3 * 8 + 4), Text],
        // Its map has numbers, and is as long as it says, or no map.
        op::CHUNK_INDEX => &[Bytes(4 * 8), Text, Bytes(8), Text],
        // The library takes for granted that there is room for the data's length and a checksum.
        op::ATTACHMENT => &[Bytes(2 * 8), Text, Text, Bytes(8 + 4)],
        op::ATTACHMENT_INDEX => &[Bytes(5 * 8), Text, Text],
        op::METADATA => &[Text, Texts],
        op::METADATA_INDEX => &[Bytes(2 * 8), Text],
        _ => &[],
    };
    let rest = parts.iter().try_fold(body, |rest, part| part.skip(rest));
    rest.ok_or(McapError::UnexpectedEoc)?;
    mcap::parse_record(opcode, body)
}

impl Part {
    /// What follows it; `None` if there is less than it says.
    fn skip(self, rest: &[u8]) -> Option<&[u8]> {
        match self {
            Self::Bytes(count) => rest.get(count..),
            Self::Text => {
                let (length, rest) = rest.split_first_chunk()?;
                rest.get(usize::try_from(u32::from_le_bytes(*length)).ok()?..)
            }
            Self::Texts => {
                let (length, mut rest) = rest.split_first_chunk()?;
                let end = rest.len().checked_sub(usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
                while rest.len() > end {
                    rest = Self::Text.skip(rest)?;
                }
                Some(rest)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_no_longer_than_its_record() {
        let text = |claimed: u32, text: &[u8]| [&claimed.to_le_bytes(), text].concat();
        let name = text(4, b"name");
        let pairs = [name.clone(), text(1, b"v")].concat();
        let texts = |claimed: usize, pairs: &[u8]| text(u32::try_from(claimed).expect("short"), pairs);
        let metadata =
            |parts: &[Vec<u8>]| parse(op::METADATA, &parts.concat()).map(|record| format!("{record:?}"));
        let good = metadata(&[name.clone(), texts(pairs.len(), &pairs)]).expect("as the format has it");
        assert!(good.contains(r#"{"name": "v"}"#), "{good}");
        for lies in [
            vec![text(u32::MAX, b"name")],
            vec![name.clone(), texts(pairs.len() + 1, &pairs)],
            vec![name.clone(), texts(8, &text(1_734_964_082, b"name"))],
            vec![name.clone(), texts(9, &[name.clone(), text(2, b"v")].concat())],
        ] {
            assert!(matches!(metadata(&lies), Err(McapError::UnexpectedEoc)), "{lies:?}");
        }
        // Two times and two empty texts, and then neither a length nor a checksum.
        assert!(matches!(parse(op::ATTACHMENT, &[0; 2 * 8 + 2 * 4]), Err(McapError::UnexpectedEoc)));
    }

    #[test]
    fn a_short_file_holds_little() {
        assert_eq!(longest_in(0), 0);
        assert_eq!(longest_in(200), 200 * (128 << 10) / 4);
        assert_eq!(longest_in(1 << 20), LONGEST_RECORD);
        assert_eq!(longest_in(u64::MAX), LONGEST_RECORD);
    }
}
