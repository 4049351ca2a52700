//! Which process plays which card. The daemon enters a process before anybody can ask about it, and writes the same into a
//! file of the runtime folder, for those that only listen. What is done about others is not decided here.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};
use supersigma_protocol::Address;
use supersigma_protocol::bus::Origin;

/// A card's process and the one before it: what that has said may still be on the bus.
const KEPT: usize = 2;

/// The processes of all cards, by the card's address, the latest last.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Roll(BTreeMap<u8, Vec<u32>>);

impl Roll {
    /// What the daemon has written; nobody, if there is nothing to read.
    pub(super) fn read(path: &Path) -> Self {
        fs::read(path).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    /// The card that a process plays.
    pub(super) fn card_of(&self, origin: Origin) -> Option<Address> {
        let plays = |(_, processes): &(&u8, &Vec<u32>)| processes.contains(&origin.0);
        self.0.iter().find(plays).map(|(card, _)| Address(*card))
    }

    fn enter(&mut self, card: Address, process: u32) {
        // A number that the system gives again is the new process'.
        self.0.values_mut().for_each(|processes| processes.retain(|one| *one != process));
        let processes = self.0.entry(card.0).or_default();
        processes.push(process);
        let old = processes.len().saturating_sub(KEPT);
        processes.drain(..old);
    }

    /// Whoever reads it meanwhile reads the old one or the new one.
    fn write(&self, path: &Path) -> io::Result<()> {
        let new = path.with_extension("new");
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&new)?;
        file.write_all(&serde_json::to_vec(self)?)?;
        fs::rename(new, path)
    }
}

/// The daemon's roll; shared.
#[derive(Debug, Clone)]
pub(super) struct Members {
    path: PathBuf,
    roll: Arc<Mutex<Roll>>,
}

impl Members {
    /// Nobody yet.
    pub(super) fn new(path: PathBuf) -> Self {
        Self { path, roll: Arc::default() }
    }

    /// Starts a process for `card`, of which `number` tells the number, and enters it. Who asks meanwhile, waits: even the
    /// first frame of the process finds it entered.
    ///
    /// # Errors
    /// If it cannot be started or entered.
    pub(super) fn admit<P>(
        &self,
        card: Address,
        start: impl FnOnce() -> io::Result<P>,
        number: impl FnOnce(&P) -> u32,
    ) -> io::Result<P> {
        let mut roll = self.roll();
        let process = start()?;
        roll.enter(card, number(&process));
        roll.write(&self.path)?;
        Ok(process)
    }

    /// The card that a process plays.
    pub(super) fn card_of(&self, origin: Origin) -> Option<Address> {
        self.roll().card_of(origin)
    }

    fn roll(&self) -> MutexGuard<'_, Roll> {
        // What is in there is whole after every statement.
        self.roll.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_plays_its_card_until_two_others_have_come() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("members");
        let members = Members::new(path.clone());
        let enter =
            |card, process| members.admit(Address(card), || Ok(process), |one| *one).expect("entered");
        let card_of = |process| members.card_of(Origin(process)).map(|card| card.0);
        assert_eq!(Roll::read(&path), Roll::default());
        enter(3, 100);
        enter(8, 101);
        assert_eq!([100, 101, 102].map(card_of), [Some(3), Some(8), None]);
        enter(3, 102);
        assert_eq!([100, 101, 102].map(card_of), [Some(3), Some(8), Some(3)]);
        enter(3, 103);
        assert_eq!([100, 102, 103].map(card_of), [None, Some(3), Some(3)]);
        // The system gives numbers again.
        enter(1, 102);
        assert_eq!([102, 103].map(card_of), [Some(1), Some(3)]);
        assert_eq!(Roll::read(&path), *members.roll());
    }
}
