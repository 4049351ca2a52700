//! A tap that hands over what the set's own processes say, and nothing else. A process that is not known yet may have been
//! started just now: its first frames wait until the daemon has entered it, or until it is clear that it will not.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use supersigma_protocol::bus::{BusError, Lane, Origin, Tap};

use super::members::Roll;

/// By then the daemon has entered whom it has started, on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(5);
/// A card that joins says only few words in that time.
const WAITING_FRAMES: usize = 256;
/// So many unknown processes are waited for.
const WAITING_PROCESSES: usize = 32;

/// The tap.
#[derive(Debug)]
pub(super) struct MembersTap<T> {
    tap: T,
    ccu: Origin,
    /// Where the daemon keeps the roll.
    path: PathBuf,
    roll: Roll,
    unknown: BTreeMap<Origin, Unknown>,
}

#[derive(Debug)]
struct Unknown {
    since: Instant,
    /// Of its answers, those that wait.
    frames: Vec<Vec<u8>>,
}

impl<T> MembersTap<T> {
    /// A tap that believes `ccu`, and whoever is on the roll at `path`.
    pub(super) fn new(tap: T, ccu: Origin, path: PathBuf) -> Self {
        Self { tap, ccu, roll: Roll::read(&path), path, unknown: BTreeMap::new() }
    }

    /// Reads the roll anew, and hands over what those have said who are on it now.
    fn look_again(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> usize {
        self.roll = Roll::read(&self.path);
        let mut heard = 0;
        self.unknown.retain(|&origin, unknown| {
            let known = self.roll.card_of(origin).is_some();
            if known {
                heard += unknown.frames.len();
                unknown.frames.iter().for_each(|bytes| each(Lane::Answers, origin, bytes));
            } else if unknown.since.elapsed() >= PATIENCE {
                unknown.frames = Vec::new();
            }
            !known
        });
        heard
    }
}

impl<T: Tap> Tap for MembersTap<T> {
    fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError> {
        let Self { tap, ccu, roll, unknown, .. } = self;
        let (mut heard, mut more) = (0, false);
        tap.drain(&mut |lane, origin, bytes| {
            let known = match lane {
                Lane::Commands => origin == *ccu,
                Lane::Answers => roll.card_of(origin).is_some(),
            };
            if known {
                heard += 1;
                each(lane, origin, bytes);
            } else if lane == Lane::Answers {
                more = true;
                wait(unknown, origin, bytes);
            }
        })?;
        // What waits may be a member's even if it says no more.
        if more || unknown.values().any(|unknown| !unknown.frames.is_empty()) {
            heard += self.look_again(each);
        }
        Ok(heard)
    }
}

fn wait(unknown: &mut BTreeMap<Origin, Unknown>, origin: Origin, bytes: &[u8]) {
    if unknown.len() >= WAITING_PROCESSES && !unknown.contains_key(&origin) {
        unknown.retain(|_, one| one.since.elapsed() < PATIENCE);
        if unknown.len() >= WAITING_PROCESSES {
            return;
        }
    }
    let one = unknown.entry(origin).or_insert_with(|| Unknown { since: Instant::now(), frames: Vec::new() });
    if one.since.elapsed() < PATIENCE && one.frames.len() < WAITING_FRAMES {
        one.frames.push(bytes.to_vec());
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use supersigma_protocol::Address;

    use super::super::members::Members;
    use super::*;

    const CCU: Origin = Origin(10);

    /// A bus on which others have spoken.
    struct Said(VecDeque<(Lane, Origin, u8)>);

    impl Tap for Said {
        fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError> {
            let said = self.0.drain(..).map(|(lane, origin, byte)| each(lane, origin, &[byte]));
            Ok(said.count())
        }
    }

    fn heard(tap: &mut MembersTap<Said>, said: &[(Lane, u32, u8)]) -> Vec<u8> {
        tap.tap.0.extend(said.iter().map(|&(lane, origin, byte)| (lane, Origin(origin), byte)));
        let mut heard = Vec::new();
        let count = tap.drain(&mut |_, _, bytes| heard.extend_from_slice(bytes)).expect("it only listens");
        assert_eq!(count, heard.len());
        heard
    }

    #[test]
    fn strangers_are_not_heard_and_newcomers_are_waited_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("members");
        let members = Members::new(path.clone());
        let enter = |process| members.admit(Address(1), || Ok(process), |one| *one).expect("entered");
        enter(21);
        let mut tap = MembersTap::new(Said(VecDeque::new()), CCU, path);
        let (commands, answers) = (Lane::Commands, Lane::Answers);
        assert_eq!(heard(&mut tap, &[(commands, 10, 1), (answers, 21, 2)]), [1, 2]);
        // A stranger commands, a stranger answers, the CCU answers, a card commands.
        let wrong = [(commands, 99, 3), (answers, 99, 4), (answers, 10, 5), (commands, 21, 6)];
        assert!(heard(&mut tap, &wrong).is_empty());
        // A card that has just been started, between two words of a stranger.
        assert!(heard(&mut tap, &[(answers, 99, 7), (answers, 22, 8), (answers, 99, 9)]).is_empty());
        assert_eq!(heard(&mut tap, &[(answers, 21, 10), (answers, 22, 11)]), [10]);
        enter(22);
        assert_eq!(heard(&mut tap, &[]), [8, 11]);
        assert_eq!(heard(&mut tap, &[(answers, 22, 12), (answers, 99, 13)]), [12]);
    }

    #[test]
    fn a_flood_of_strangers_takes_no_memory() {
        let mut tap = MembersTap::new(Said(VecDeque::new()), CCU, "/nonexistent".into());
        for process in 100..200 {
            assert!(heard(&mut tap, &[(Lane::Answers, process, 0); 2 * WAITING_FRAMES]).is_empty());
        }
        assert!(tap.unknown.len() <= WAITING_PROCESSES);
        assert!(tap.unknown.values().all(|unknown| unknown.frames.len() <= WAITING_FRAMES));
    }
}
