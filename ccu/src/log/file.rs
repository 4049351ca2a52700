//! The file below the format: what is written stays in memory until it is flushed, and is then in the file whole or not
//! at all. Two things follow from that, whatever the disk does:
//!
//! ```text
//!   ├──── whole records ────┤ reserve │           a flush that succeeds moves the border
//!   ├──── whole records ────┤ half a …            one that fails is taken back, and the file is closed
//! ```
//!
//! The reserve is room that the file system has already set aside for this file, enough for the last frames and the
//! summary. When it cannot be had any more the disk is full, and nothing has been lost yet. Knows nothing of frames.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use mcap::MAGIC;
use mcap::records::op;
use rustix::fs::{FallocateFlags, fallocate};

/// Room for everything that may still be in memory when the disk is full, for the second after that on the fastest bus
/// (20 000 frames of 60 bytes), and for the summary.
const RESERVE: u64 = 2 << 20;
/// What a flush adds to the summary, generously: a chunk's index.
const SUMMARY_OF_A_FLUSH: u64 = 512;

/// A file that holds nothing but whole flushes.
#[derive(Debug)]
pub(crate) struct LogFile {
    file: File,
    pending: Vec<u8>,
    reserve: Reserve,
    flushes: u64,
    /// After a failure nothing is written any more.
    closed: bool,
    ledger: Arc<Ledger>,
}

/// What is known of a file by those who have given it away.
#[derive(Debug, Default)]
pub(super) struct Ledger {
    bytes: AtomicU64,
    full: AtomicBool,
}

impl Ledger {
    /// The length of the file, all of it whole.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Whether the disk has no more room than the reserve.
    pub(super) fn is_full(&self) -> bool {
        self.full.load(Ordering::Relaxed)
    }
}

/// Room that the file system has set aside behind the end of the file.
#[derive(Debug, Clone, Copy)]
enum Reserve {
    UpTo(u64),
    /// The file system does not do that.
    Never,
}

impl LogFile {
    /// Makes a file that did not exist.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        let ledger = Arc::default();
        Ok(Self { file, pending: Vec::new(), reserve: Reserve::UpTo(0), flushes: 0, closed: false, ledger })
    }

    pub(super) fn ledger(&self) -> Arc<Ledger> {
        Arc::clone(&self.ledger)
    }

    /// Flushes, and gives back what is left of the reserve.
    pub(crate) fn finish(mut self) -> io::Result<File> {
        self.reserve = Reserve::Never;
        self.flush()?;
        self.file.set_len(self.ledger.bytes())?;
        self.file.try_clone()
    }

    /// Takes back what was written of a flush that failed, and ends the file by the book, if 50 bytes still fit.
    fn close(&mut self) {
        self.closed = true;
        self.pending = Vec::new();
        let whole = self.ledger.bytes();
        let ended = self
            .file
            .set_len(whole)
            .and_then(|()| self.file.write_all_at(&end_without_summary(), whole))
            .inspect(|()| {
                self.ledger.bytes.store(whole + end_without_summary().len() as u64, Ordering::Relaxed);
            });
        if let Err(error) = ended.and_then(|()| self.file.sync_all()) {
            tracing::debug!(%error, "the log has no end record");
            // Then it is a log that was cut, and is read as such.
            let _ = self.file.set_len(self.ledger.bytes());
        }
    }

    fn extend_reserve(&mut self) {
        let Reserve::UpTo(reserved) = self.reserve else { return };
        let whole = self.ledger.bytes();
        let wanted = RESERVE + self.flushes * SUMMARY_OF_A_FLUSH;
        // Not at every flush: only when a quarter of it is used up.
        if reserved.saturating_sub(whole) >= wanted / 4 * 3 {
            return;
        }
        match fallocate(&self.file, FallocateFlags::KEEP_SIZE, whole, wanted).map_err(io::Error::from) {
            Ok(()) => self.reserve = Reserve::UpTo(whole + wanted),
            Err(error) if is_full(&error) => self.ledger.full.store(true, Ordering::Relaxed),
            Err(error) => {
                tracing::debug!(%error, "no room can be reserved for the end of the log");
                self.reserve = Reserve::Never;
            }
        }
    }
}

impl Write for LogFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.closed {
            self.pending.extend_from_slice(bytes);
        }
        // What is written after a failure comes from the format's own tidying up, and goes nowhere.
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.closed || self.pending.is_empty() {
            return Ok(());
        }
        let whole = self.ledger.bytes();
        if let Err(error) = self.file.write_all_at(&self.pending, whole) {
            self.close();
            return Err(error);
        }
        self.ledger.bytes.store(whole + self.pending.len() as u64, Ordering::Relaxed);
        self.pending.clear();
        self.flushes += 1;
        self.extend_reserve();
        Ok(())
    }
}

/// A log that is given up in the middle is finished by the format as it is dropped; that must reach the file.
impl Drop for LogFile {
    fn drop(&mut self) {
        self.reserve = Reserve::Never;
        if let Err(error) = self.flush().and_then(|()| self.file.set_len(self.ledger.bytes())) {
            tracing::debug!(%error, "the end of a log could not be written");
        }
    }
}

/// The format only asks where it is: it never goes back.
impl Seek for LogFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let here = self.ledger.bytes() + self.pending.len() as u64;
        match to {
            SeekFrom::Current(0) | SeekFrom::End(0) => Ok(here),
            SeekFrom::Start(place) if place == here => Ok(here),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}

/// Whether an error says that there is no more room: on the disk, in the quota, or for one file.
pub(super) fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge
    )
}

/// The records that end a file whose summary could not be written: Data End without a checksum, Footer without a summary.
fn end_without_summary() -> Vec<u8> {
    let mut end = Vec::with_capacity(50);
    for (opcode, length) in [(op::DATA_END, 4_u8), (op::FOOTER, 20)] {
        end.push(opcode);
        end.extend_from_slice(&u64::from(length).to_le_bytes());
        end.resize(end.len() + usize::from(length), 0);
    }
    end.extend_from_slice(MAGIC);
    end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_flushed_is_in_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        let mut file = LogFile::create(&path).expect("new");
        let ledger = file.ledger();
        file.write_all(b"whole").expect("memory");
        assert_eq!((std::fs::read(&path).expect("there"), ledger.bytes()), (Vec::new(), 0));
        assert_eq!(file.stream_position().expect("known"), 5);
        file.flush().expect("room");
        file.write_all(b" half").expect("memory");
        assert_eq!((std::fs::read(&path).expect("there"), ledger.bytes()), (b"whole".to_vec(), 5));
        assert_eq!(file.stream_position().expect("known"), 10);
        drop(file);
        assert_eq!(std::fs::read(&path).expect("there"), b"whole half");
    }

    #[test]
    fn the_reserve_is_given_back() {
        use std::os::unix::fs::MetadataExt;

        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        let mut file = LogFile::create(&path).expect("new");
        file.write_all(&[7; 1000]).expect("memory");
        file.flush().expect("room");
        let Reserve::UpTo(reserved) = file.reserve else {
            println!("skipped: this file system reserves nothing");
            return;
        };
        let blocks = || std::fs::metadata(&path).expect("there").blocks() * 512;
        assert_eq!(reserved, 1000 + RESERVE + SUMMARY_OF_A_FLUSH);
        assert!(blocks() >= RESERVE, "{}", blocks());
        assert_eq!(std::fs::metadata(&path).expect("there").len(), 1000);
        file.finish().expect("room");
        assert!(blocks() < RESERVE, "{}", blocks());
    }

    #[test]
    fn the_end_is_one_that_the_format_knows() {
        let mut file = MAGIC.to_vec();
        file.extend(end_without_summary());
        let records: Vec<_> = mcap::read::LinearReader::new(&file)
            .expect("MCAP")
            .map(|record| record.expect("whole").opcode())
            .collect();
        assert_eq!(records, [op::DATA_END, op::FOOTER]);
    }
}
