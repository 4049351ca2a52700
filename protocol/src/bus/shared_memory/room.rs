//! Room in the machine's shared memory. A page of it that cannot be had when it is first touched kills whoever touches it, so
//! a set looks for room before it starts, and takes all that its files may ever need at once, where that is an error that
//! can be told. Which files are whose, and what is in them, is not known here.

use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, FallocateFlags, access, fallocate, statvfs};
use rustix::io::Errno;
use rustix::process::geteuid;

use super::super::BusError;

/// In which the system counts what a file has, whatever its pages are.
const BLOCK_BYTES: u64 = 512;

/// What may be taken up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Room {
    pub(super) bytes: u64,
    pub(super) files: u64,
}

/// All processes of a set together; `a_whole_set_fits_into_what_it_asks_for` compares.
pub(super) const OF_A_SET: Room = Room { bytes: 56 << 20, files: 256 };
/// One process more: another card, a recorder that takes another's place.
pub(super) const OF_A_PROCESS: Room = Room { bytes: 8 << 20, files: 48 };

/// Looks whether there is so much room in `folder`, and whether we may use it.
///
/// # Errors
/// If not; the message says what is missing, how much there is, and how much it should be.
pub(super) fn look_for(room: Room, folder: &Path) -> Result<(), BusError> {
    let no_room = |reason: String| BusError::NoRoom { folder: folder.to_owned(), reason };
    access(folder, Access::EXISTS | Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK)
        .map_err(|error| no_room(unusable(error)))?;
    let there = statvfs(folder).map_err(|error| no_room(unusable(error)))?;
    let free = there.f_bavail.saturating_mul(there.f_frsize);
    if free < room.bytes {
        return Err(no_room(format!("it has {} free, and {} are needed", mib(free), mib(room.bytes))));
    }
    // A file system that does not count files says that there are none at all.
    if there.f_files > 0 && there.f_favail < room.files {
        let files = room.files;
        return Err(no_room(format!(
            "it has room for {} more files, and {files} are needed",
            there.f_favail
        )));
    }
    Ok(())
}

/// Takes what these files may ever need. A file that is gone meanwhile needs nothing, nor does one that another user has
/// put among them; and one that has all of its pages is not gone through again: every process of a set comes by the files
/// of all.
///
/// # Errors
/// If there is not so much.
pub(super) fn take(files: impl IntoIterator<Item = PathBuf>, folder: &Path) -> Result<(), BusError> {
    for path in files {
        let taken = fs::metadata(&path).and_then(|file| {
            if file.blocks() * BLOCK_BYTES >= file.len() || file.uid() != geteuid().as_raw() {
                return Ok(());
            }
            let length = file.len();
            // Only to write: whoever makes a file lets nobody read it, not even its owner, before it is ready.
            let file = OpenOptions::new().write(true).open(&path)?;
            fallocate(&file, FallocateFlags::KEEP_SIZE, 0, length).map_err(io::Error::from)
        });
        match taken {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            // Then it is no memory that is shared, but a disk.
            Err(error) if error.raw_os_error() == Some(Errno::OPNOTSUPP.raw_os_error()) => {}
            Err(error) => {
                let reason = format!("{} cannot be kept free: {error}", path.display());
                return Err(BusError::NoRoom { folder: folder.to_owned(), reason });
            }
        }
    }
    Ok(())
}

fn unusable(error: Errno) -> String {
    match error {
        Errno::NOENT | Errno::NOTDIR => "there is no such folder on this machine".to_owned(),
        Errno::ROFS => "it is mounted read-only".to_owned(),
        Errno::ACCESS | Errno::PERM => "this user may not write there".to_owned(),
        error => io::Error::from(error).to_string(),
    }
}

/// Bytes for people, rounded down.
fn mib(bytes: u64) -> String {
    let tenths = bytes / (1 << 20) * 10 + bytes % (1 << 20) * 10 / (1 << 20);
    format!("{}.{} MiB", tenths / 10, tenths % 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let reason = |room, folder: &Path| match look_for(room, folder).unwrap_err() {
            BusError::NoRoom { reason, .. } => reason,
            other => panic!("{other}"),
        };
        look_for(Room { bytes: 1, files: 1 }, folder.path()).unwrap();
        let bytes = reason(Room { bytes: u64::MAX, files: 1 }, folder.path());
        assert!(bytes.starts_with("it has ") && bytes.contains(" MiB free, and 1759218604441"), "{bytes}");
        let none = reason(OF_A_SET, &folder.path().join("none"));
        assert_eq!(none, "there is no such folder on this machine");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").unwrap();
        assert_eq!(reason(OF_A_SET, &file.join("below")), "there is no such folder on this machine");
    }

    #[test]
    fn a_file_takes_what_it_may_need() {
        let folder = tempfile::tempdir_in("/dev/shm").unwrap();
        let path = folder.path().join("sparse");
        std::fs::File::create(&path).unwrap().set_len(1 << 20).unwrap();
        let blocks = || std::fs::metadata(&path).unwrap().blocks();
        assert_eq!(blocks(), 0);
        take([path.clone(), folder.path().join("gone")], folder.path()).unwrap();
        assert_eq!(blocks() * 512, 1 << 20);
    }

    #[test]
    fn bytes_are_for_people() {
        assert_eq!(
            [0, 1 << 20, 3 << 19, (64 << 20) - 1].map(mib),
            ["0.0 MiB", "1.0 MiB", "1.5 MiB", "63.9 MiB"]
        );
    }
}
