//! How much a reader takes into memory, whatever a file claims of itself: lengths in a log are only numbers, and a file of
//! 200 bytes may say of a record that it is as long as all memory. Nothing is read in here.
//!
//! - A record grows in memory as its bytes come out of the file, [`ONE_READ`] at a time, not by what its head says.
//! - A chunk is unpacked in one piece, so what it claims to hold is bounded: by [`LONGEST_RECORD`], and by what so short a
//!   file can hold at all.
//! - Schemas and channels are kept to the end; all of them together are bounded by [`LONGEST_RECORD`] too.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_file_holds_little() {
        assert_eq!(longest_in(0), 0);
        assert_eq!(longest_in(200), 200 * (128 << 10) / 4);
        assert_eq!(longest_in(1 << 20), LONGEST_RECORD);
        assert_eq!(longest_in(u64::MAX), LONGEST_RECORD);
    }
}
