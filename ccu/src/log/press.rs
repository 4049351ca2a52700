//! The thread that makes one file of a log out of batches of messages, while the writer makes the next ones: half of the
//! work is the format's, most of it compression.
//!
//! ```text
//!   writer ── full batches, orders to flush ──► press: part ──► file
//!          ◄────────── empty batches ──────────
//! ```
//!
//! There are [`BATCHES`] of them and no more, so nobody gets further ahead. A flush is waited for: when it returns, the file
//! has everything. An error ends the thread, and is handed out at the next opportunity.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::{self, JoinHandle};

use supersigma_protocol::Tick;

use super::LogError;
use super::batch::Batch;
use super::file::Ledger;
use super::header::LogHeader;
use super::part::{Part, PartPlace};

/// Batches under way: about a quarter of a mebibyte.
const BATCHES: usize = 8;

/// What the thread is asked to do, in this order.
struct Order {
    batch: Batch,
    flush: bool,
}

/// What the file came to: its length, and the file, which the disk need not have yet.
type Finished = Result<(u64, File), LogError>;

/// A file that is being written.
pub(super) struct Press {
    path: PathBuf,
    ledger: Arc<Ledger>,
    /// When it was begun.
    pub(super) began: Tick,
    /// What is handed over next.
    batch: Batch,
    /// Both are there as long as nothing has gone wrong.
    running: Option<(Sender<Order>, JoinHandle<Finished>)>,
    empty: Receiver<Batch>,
    flushed: Receiver<()>,
}

impl Press {
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
        let part = Part::create(path, header, place)?;
        let ledger = part.ledger();
        let (orders, ordered) = mpsc::channel();
        let (emptied, empty) = mpsc::channel();
        let (flush, flushed) = mpsc::channel();
        // One is the writer's.
        (1..BATCHES).for_each(|_| drop(emptied.send(Batch::default())));
        let thread = thread::Builder::new()
            .name("press".into())
            .spawn(move || print(part, &ordered, &emptied, &flush))
            .map_err(|error| LogError::Create { path: path.to_owned(), error })?;
        let running = Some((orders, thread));
        let batch = Batch::default();
        Ok(Self { path: path.to_owned(), ledger, began, batch, running, empty, flushed })
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

    /// Where messages are put.
    pub(super) const fn batch(&mut self) -> &mut Batch {
        &mut self.batch
    }

    /// Hands the batch over if it is full.
    ///
    /// # Errors
    /// If the file could not be written.
    pub(super) fn pass_on(&mut self) -> Result<(), LogError> {
        if self.batch.is_full() { self.hand_over(false) } else { Ok(()) }
    }

    /// Closes the chunk and hands it to the system. If that fails, the file ends with the chunk before.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn flush(&mut self) -> Result<(), LogError> {
        self.hand_over(true)?;
        self.flushed.recv().or_else(|_| self.failed())
    }

    /// Writes the summary and the footer.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn finish(mut self) -> Finished {
        self.hand_over(false)?;
        self.end()
    }

    fn hand_over(&mut self, flush: bool) -> Result<(), LogError> {
        let Ok(empty) = self.empty.recv() else { return self.failed() };
        let batch = std::mem::replace(&mut self.batch, empty);
        match &self.running {
            Some((orders, _)) if orders.send(Order { batch, flush }).is_ok() => Ok(()),
            _ => self.failed(),
        }
    }

    /// The thread has ended before its time.
    fn failed(&mut self) -> Result<(), LogError> {
        self.end().map(drop)
    }

    fn end(&mut self) -> Finished {
        let failed = |what: &str| LogError::Write {
            path: self.path.clone(),
            error: io::Error::other(what.to_owned()).into(),
        };
        let Some((orders, thread)) = self.running.take() else {
            return Err(failed("it was closed after an error"));
        };
        drop(orders);
        thread.join().unwrap_or_else(|_| Err(failed("the thread that writes it has failed")))
    }
}

/// A log that is given up in the middle is finished all the same.
impl Drop for Press {
    fn drop(&mut self) {
        if self.running.is_some()
            && let Err(error) = self.hand_over(false).and_then(|()| self.end().map(drop))
        {
            tracing::debug!(%error, "the end of a log could not be written");
        }
    }
}

fn print(
    mut part: Part,
    orders: &Receiver<Order>,
    emptied: &Sender<Batch>,
    flushed: &Sender<()>,
) -> Finished {
    for Order { mut batch, flush } in orders {
        for (label, data) in batch.messages() {
            part.put(label, data)?;
        }
        batch.clear();
        if flush {
            part.flush()?;
        }
        // Who has gone does not wait.
        let _ = emptied.send(batch);
        if flush {
            let _ = flushed.send(());
        }
    }
    part.finish()
}
