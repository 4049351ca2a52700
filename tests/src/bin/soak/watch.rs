//! What the set's processes take, looked at again and again. What grows after the warm-up is found.

use std::collections::BTreeMap;

use supersigma_tests::{Cell, Vitals};

/// A process may take so many bytes more of its own than after the warm-up: buffers find their size.
const MORE_MEMORY: u64 = 8 * 1024 * 1024;
/// And have so many files more open: a client may just be leaving.
const MORE_FILES: usize = 4;

/// The processes of a set.
#[derive(Debug, Default)]
pub(crate) struct Watch(BTreeMap<String, Watched>);

/// One part of the set; another process may have taken its place.
#[derive(Debug)]
pub(crate) struct Watched {
    pid: u32,
    /// After the warm-up, or at its start if that was later.
    pub(crate) first: Vitals,
    pub(crate) last: Vitals,
    /// The most memory of its own.
    pub(crate) peak: u64,
    /// Processes so far.
    pub(crate) lives: u32,
}

impl Watch {
    /// Looks at all processes. While it is `warm`, what they take is what they may take.
    pub(crate) fn look(&mut self, cell: &Cell, warm: bool) -> Vec<String> {
        let mut findings = Vec::new();
        for process in cell.processes() {
            let (Some(part), Some(vitals)) = (process.part(), process.vitals()) else { continue };
            let watched = self.0.entry(part.clone()).or_insert(Watched {
                pid: process.pid,
                first: vitals,
                last: vitals,
                peak: 0,
                lives: 1,
            });
            if watched.pid != process.pid {
                (watched.pid, watched.first, watched.peak) = (process.pid, vitals, 0);
                watched.lives += 1;
            }
            if !warm {
                watched.first = vitals;
            }
            let before = std::mem::replace(&mut watched.last, vitals);
            watched.peak = watched.peak.max(vitals.own);
            let grown = |vitals: Vitals| vitals.own > watched.first.own + MORE_MEMORY;
            if grown(vitals) && !grown(before) {
                findings
                    .push(format!("{part} takes more and more memory: {:?}, then {vitals:?}", watched.first));
            }
            let opened = |vitals: Vitals| vitals.files > watched.first.files + MORE_FILES;
            if opened(vitals) && !opened(before) {
                findings
                    .push(format!("{part} opens more and more files: {:?}, then {vitals:?}", watched.first));
            }
        }
        findings
    }

    /// The processes by what they are in the set.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (&str, &Watched)> {
        self.0.iter().map(|(part, watched)| (part.as_str(), watched))
    }
}
