//! One file of a log: a complete MCAP with header, channels and summary. Messages go in, in the order of the log; which
//! ones, and when a part ends, the writer decides.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};
use supersigma_protocol::Tick;

use super::LogError;
use super::channels::{Channels, McapFile, write_preamble};
use super::file::{Ledger, LogFile};
use super::header::{LogHeader, METADATA_NAME, WallTime};
use super::told::Topic;

/// Where a file stands in its log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PartPlace {
    /// From 1.
    pub(super) number: u32,
    /// The name of the file before it.
    pub(super) previous: Option<String>,
}

/// A file that is being written.
pub(super) struct Part {
    path: PathBuf,
    mcap: McapFile,
    channels: Channels,
    ledger: Arc<Ledger>,
    /// When it was begun.
    pub(super) began: Tick,
}

impl Part {
    /// Begins a file. Header, attachments and channels are on disk when this returns; if they cannot be, no file is left.
    ///
    /// # Errors
    /// If the file exists, or cannot be made or written.
    pub(super) fn create(
        path: &Path,
        header: &LogHeader,
        place: &PartPlace,
        began: Tick,
    ) -> Result<Self, LogError> {
        let file = LogFile::create(path).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => LogError::Exists { path: path.to_owned() },
            _ => LogError::Create { path: path.to_owned(), error },
        })?;
        let ledger = file.ledger();
        let preamble = move || -> Result<_, McapError> {
            let mut mcap = WriteOptions::new()
                .profile(METADATA_NAME)
                // One thread is plenty for a bus.
                .compression_threads(0)
                .disable_seeking(true)
                .create(file)?;
            write_preamble(&mut mcap, header, place)?;
            let channels = Channels::add(&mut mcap, header)?;
            mcap.flush()?;
            Ok((mcap, channels))
        };
        let ready = preamble().map_err(|error| failed(path, error)).and_then(|ready| {
            if ledger.is_full() { Err(LogError::Full { path: path.to_owned() }) } else { Ok(ready) }
        });
        let (mcap, channels) = ready.inspect_err(|_| {
            // It was made just now, and holds nothing.
            let _ = fs::remove_file(path);
        })?;
        Ok(Self { path: path.to_owned(), mcap, channels, ledger, began })
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// What is in the file, all of it whole.
    pub(super) fn bytes(&self) -> u64 {
        self.ledger.bytes()
    }

    /// Whether the disk has no more room than what is set aside for the end of this file.
    pub(super) fn is_full(&self) -> bool {
        self.ledger.is_full()
    }

    /// The channels.
    pub(super) const fn channels(&self) -> &Channels {
        &self.channels
    }

    /// The channel of a topic.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn topic(&mut self, topic: Topic, header: &LogHeader) -> Result<u16, LogError> {
        self.channels.topic(topic, &mut self.mcap, header).map_err(|error| failed(&self.path, error))
    }

    /// Writes one message. `number` is its place on the channel; without one, messages are counted.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn put(
        &mut self,
        channel: u16,
        number: Option<u64>,
        log_time: WallTime,
        publish_time: WallTime,
        data: &[u8],
    ) -> Result<(), LogError> {
        let counted = self.channels.count(channel);
        let header = MessageHeader {
            channel_id: channel,
            // The format has 32 bits for it; they wrap.
            sequence: (number.unwrap_or(counted) & u64::from(u32::MAX)).try_into().unwrap_or_default(),
            log_time: log_time.0,
            publish_time: publish_time.0,
        };
        self.mcap.write_to_known_channel(&header, data).map_err(|error| failed(&self.path, error))
    }

    /// Closes the chunk and hands it to the system. If that fails, the file ends with the chunk before.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn flush(&mut self) -> Result<(), LogError> {
        self.mcap.flush().map_err(|error| failed(&self.path, error))
    }

    /// Writes the summary and the footer. The file's length, and the file, which the disk need not have yet.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn finish(mut self) -> Result<(u64, File), LogError> {
        let path = self.path;
        self.mcap.flush().and_then(|()| self.mcap.finish()).map_err(|error| failed(&path, error))?;
        match self.mcap.into_inner().finish() {
            Ok(file) => Ok((self.ledger.bytes(), file)),
            Err(error) => Err(failed(&path, error.into())),
        }
    }
}

fn failed(path: &Path, error: McapError) -> LogError {
    LogError::Write { path: path.to_owned(), error }
}
