//! Where a set's bus lives on this machine: names, folders, and the removal of what dead processes left there.
//! Knows iceoryx2's file names, opens none of its services.

use std::ffi::OsStr;
use std::fs::{self, DirBuilder, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, SemanticString};
use rustix::process::geteuid;

use super::super::BusError;
use super::room::{self, Room};

/// Where POSIX shared memory shows as files.
const SHARED_MEMORY: &str = "/dev/shm";
/// Below the root: the one folder that belongs to iceoryx2, so that sweeping touches nobody else's files.
const FOLDER: &str = "bus";
/// A Unix socket's path has 108 bytes, one of them the closing zero.
const SOCKET_PATH_BYTES: usize = 107;
/// What iceoryx2 appends to folder and prefix for a listener's socket: a separator, a number, the suffix.
const SOCKET_NAME_BYTES: usize = 1 + 36 + SOCKET_SUFFIX.len();
const SOCKET_SUFFIX: &str = ".ev";
/// What of a mode concerns other users than the owner.
const OTHERS: u32 = 0o077;

/// Where one set's bus lives. Each set has its own, so several live side by side and do not hear each other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    root: PathBuf,
    prefix: String,
}

impl Place {
    /// The place of the set whose runtime folder is `root`, an absolute path. Everybody in the set names the folder
    /// by the same path; its hash is the prefix of the set's files in the machine's shared memory.
    ///
    /// # Errors
    /// If `root` is relative, or so long that a socket in it could not be named.
    pub fn new(root: impl Into<PathBuf>) -> Result<Self, BusError> {
        const WHAT: &str = "place the bus";
        let root = root.into();
        if !root.is_absolute() {
            return Err(BusError::open(WHAT, format!("{} is not an absolute path", root.display())));
        }
        let prefix = prefix_of(&root);
        let place = Self { root, prefix };
        let length = place.folder().as_os_str().len() + place.prefix.len() + SOCKET_NAME_BYTES;
        if let Some(excess) = length.checked_sub(SOCKET_PATH_BYTES).filter(|&excess| excess > 0) {
            return Err(BusError::open(
                WHAT,
                format!(
                    "{} is {excess} bytes too long for the sockets in it; choose a shorter name",
                    place.root.display()
                ),
            ));
        }
        Ok(place)
    }

    /// The set's runtime folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// What the names of all of the set's files in shared memory begin with. It ends in a character that occurs
    /// nowhere else in it, so no set's prefix is the beginning of another's.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Whether somebody has created a bus here, dead or alive.
    ///
    /// # Errors
    /// If this user may not look.
    pub(super) fn is_inhabited(&self) -> Result<bool, BusError> {
        let folder = self.folder();
        match fs::metadata(&folder) {
            Ok(found) => Ok(found.is_dir()),
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {
                Err(BusError::open("join the bus", format!("it is another user's: {}", at(&folder, &error))))
            }
            Err(_) => Ok(false),
        }
    }

    /// Makes the folders, for this user only.
    pub(super) fn settle(&self) -> Result<(), BusError> {
        let folder = self.folder();
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&folder)
            .map_err(|error| BusError::open("make the bus's folder", at(&folder, &error)))
    }

    /// iceoryx2 makes the counter of its nodes writable by every user of the machine. A copy that was never open takes its
    /// place, for all who join later: who has opened the first one meanwhile holds a file that nobody looks into any more.
    pub(super) fn seal(&self) -> Result<(), BusError> {
        const WHAT: &str = "close the bus to other users";
        let files = self.shared_files().map_err(|error| BusError::open(WHAT, at(SHARED_MEMORY, &error)))?;
        for file in files {
            self.close(&file).map_err(|error| BusError::open(WHAT, at(&file, &error)))?;
        }
        Ok(())
    }

    fn close(&self, file: &Path) -> io::Result<()> {
        if fs::metadata(file)?.mode() & OTHERS == 0 {
            return Ok(());
        }
        let copy = Path::new(SHARED_MEMORY).join(format!("{}copy", self.prefix));
        let mut closed = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&copy)?;
        closed.write_all(&fs::read(file)?)?;
        fs::rename(copy, file)
    }

    /// iceoryx2 lets the user's group read some of its folders. Nobody comes to them, since the one above is closed; but
    /// nobody should have to know that.
    pub(super) fn close_folders(&self) -> Result<(), BusError> {
        let mut folders = vec![self.folder()];
        while let Some(folder) = folders.pop() {
            let closed = close_folder(&folder).map(|below| folders.extend(below));
            unless_gone(closed)
                .map_err(|error| BusError::open("close the bus's folders", at(&folder, &error)))?;
        }
        Ok(())
    }

    /// Looks whether the machine's shared memory has so much room.
    pub(super) fn look_for(room: Room) -> Result<(), BusError> {
        room::look_for(room, Path::new(SHARED_MEMORY))
    }

    /// Takes the room that the files of this place's bus may ever need.
    pub(super) fn take_room(&self) -> Result<(), BusError> {
        const WHAT: &str = "find the bus's files";
        let files = self.shared_files().map_err(|error| BusError::open(WHAT, at(SHARED_MEMORY, &error)))?;
        room::take(files, Path::new(SHARED_MEMORY))
    }

    /// Removes every file of this place's bus, whoever left it there.
    pub(super) fn sweep(&self) -> Result<(), BusError> {
        const WHAT: &str = "remove what an earlier life of this set left behind";
        let folder = self.folder();
        unless_gone(fs::remove_dir_all(&folder))
            .map_err(|error| BusError::open(WHAT, at(&folder, &error)))?;
        let files = self.shared_files().map_err(|error| BusError::open(WHAT, at(SHARED_MEMORY, &error)))?;
        // One that cannot be removed keeps no other.
        let mut trouble = Ok(());
        for file in files {
            if let Err(error) = unless_gone(fs::remove_file(&file)) {
                trouble = Err(BusError::open(WHAT, format!("{}{}", at(&file, &error), whose(&file))));
            }
        }
        trouble
    }

    /// iceoryx2's configuration for this place: set here in full, no file is looked for.
    pub(super) fn config(&self) -> Result<Config, BusError> {
        let malformed =
            |error| BusError::open("place the bus", format!("{}: {error:?}", self.root.display()));
        let folder = iceoryx2::prelude::Path::new(self.folder().as_os_str().as_bytes()).map_err(malformed)?;
        let mut config = Config::default();
        config.global.set_root_path(&folder);
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(malformed)?;
        // A set's processes leave together, and one that is half gone would be taken for a dead one. The dead are
        // cleared away by whoever joins, and all at once when the set ends.
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.event_connection_suffix =
            FileName::new(SOCKET_SUFFIX.as_bytes()).map_err(malformed)?;
        Ok(config)
    }

    fn folder(&self) -> PathBuf {
        self.root.join(FOLDER)
    }

    fn shared_files(&self) -> io::Result<Vec<PathBuf>> {
        let entries = match fs::read_dir(SHARED_MEMORY) {
            Ok(entries) => entries,
            // A system whose shared memory has no files has no left-over files either.
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let mut files = Vec::new();
        for entry in entries {
            let entry = entry?;
            if entry.file_name().as_bytes().starts_with(self.prefix.as_bytes()) {
                files.push(entry.path());
            }
        }
        Ok(files)
    }
}

/// `ss_`, 48 bits of the path's FNV-1a hash, and a dot. Not the standard library's hash, which another compiler's
/// worker might compute differently.
fn prefix_of(root: &Path) -> String {
    let hash = root.as_os_str().as_bytes().iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("ss_{:012x}.", hash >> 16)
}

/// Closes a folder to others, and gives those in it.
fn close_folder(folder: &Path) -> io::Result<Vec<PathBuf>> {
    if fs::metadata(folder)?.mode() & OTHERS != 0 {
        fs::set_permissions(folder, Permissions::from_mode(0o700))?;
    }
    let mut below = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            below.push(entry.path());
        }
    }
    Ok(below)
}

/// To whom a file belongs that is not ours, and what then can be done.
fn whose(file: &Path) -> String {
    match fs::symlink_metadata(file).map(|found| found.uid()) {
        Ok(owner) if owner != geteuid().as_raw() => {
            format!("; it belongs to user {owner}: have it removed, or give the set another name")
        }
        _ => String::new(),
    }
}

fn at(path: impl AsRef<OsStr>, error: &io::Error) -> String {
    format!("{}: {error}", path.as_ref().display())
}

fn unless_gone(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prefix_is_the_hash_of_the_path() {
        // The published 64-bit FNV-1a values of "a" and "foobar": af63dc4c8601ec8c, 85944171f73967e8.
        assert_eq!(prefix_of(Path::new("a")), "ss_af63dc4c8601.");
        assert_eq!(prefix_of(Path::new("foobar")), "ss_85944171f739.");
        assert_ne!(Place::new("/run/a").unwrap().prefix(), Place::new("/run/b").unwrap().prefix());
    }

    #[test]
    fn a_root_whose_sockets_could_not_be_named_is_refused_with_the_excess() {
        // 107 bytes − "/bus" (4) − prefix (16) − "/" (1) − number (36) − ".ev" (3) leave 47.
        assert!(Place::new(format!("/{}", "r".repeat(46))).is_ok());
        let error = Place::new(format!("/{}", "r".repeat(49))).unwrap_err().to_string();
        assert!(
            error.ends_with("is 3 bytes too long for the sockets in it; choose a shorter name"),
            "{error}"
        );
    }

    #[test]
    fn a_relative_root_is_refused() {
        let error = Place::new("run/set").unwrap_err().to_string();
        assert_eq!(error, "cannot place the bus: run/set is not an absolute path");
    }
}
