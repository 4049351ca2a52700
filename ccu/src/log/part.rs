//! One file of a log: a complete MCAP with header, channels and summary. Messages go in, in the order of the log; which
//! ones, and when a part ends, the writer decides.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};

use super::LogError;
use super::batch::{Label, Place};
use super::channels::{Channels, McapFile, write_preamble};
use super::file::{Ledger, LogFile};
use super::header::{AxisNames, LogHeader, METADATA_NAME};

/// Of zstd, for a log's chunks: as small as at the library's own level, at half the cost, because what repeats is near.
pub const COMPRESSION_LEVEL: u32 = 1;

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
    names: AxisNames,
    ledger: Arc<Ledger>,
}

impl Part {
    /// Begins a file. Header, attachments and channels are on disk when this returns; if they cannot be, no file is left.
    ///
    /// # Errors
    /// If the file exists, or cannot be made or written.
    pub(super) fn create(path: &Path, header: &LogHeader, place: &PartPlace) -> Result<Self, LogError> {
        let file = LogFile::create(path)?;
        let ledger = file.ledger();
        let preamble = move || -> Result<_, McapError> {
            let mut mcap = WriteOptions::new()
                .profile(METADATA_NAME)
                // The press is this file's thread.
                .compression_threads(0)
                .compression_level(COMPRESSION_LEVEL)
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
        Ok(Self { path: path.to_owned(), mcap, channels, names: header.names.clone(), ledger })
    }

    /// What is known of the file while it is written.
    pub(super) fn ledger(&self) -> Arc<Ledger> {
        Arc::clone(&self.ledger)
    }

    /// Writes one message.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn put(&mut self, label: &Label, data: &[u8]) -> Result<(), LogError> {
        let Self { path, mcap, channels, names, .. } = self;
        let channel = match label.place {
            Place::Microbus(lane) => channels.microbus(lane),
            Place::Topic(topic) => channels.topic(topic, mcap, names).map_err(|error| failed(path, error))?,
        };
        let counted = channels.count(channel);
        let number = label.number.map_or(counted, |number| number.0);
        let header = MessageHeader {
            channel_id: channel,
            // The format has 32 bits for it; they wrap.
            sequence: (number & u64::from(u32::MAX)).try_into().unwrap_or_default(),
            log_time: label.log_time.0,
            publish_time: label.publish_time.0,
        };
        mcap.write_to_known_channel(&header, data).map_err(|error| failed(path, error))
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
