//! Where a set lives on this machine: its name, its runtime folder, its lock, and where logs go when nobody says. Files
//! and folders only; what is put into them is others' business.
//!
//! Everything is its owner's alone: folders 0700, the control socket 0600. The lock says whether a set is alive: the
//! kernel drops it with the process that holds it, however that process ended.

use std::fmt;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use miette::Diagnostic;
use rustix::fs::{Access, FlockOperation, access, flock};
use rustix::process::getuid;

/// The name of a set: 1 to 32 letters, digits, `-` and `_`, beginning with a letter or digit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SetName(String);

/// A name that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} cannot be a set's name: 1 to 32 letters, digits, `-` and `_`, beginning with a letter or digit"
)]
pub struct NoSetName(String);

impl FromStr for SetName {
    type Err = NoSetName;
    fn from_str(name: &str) -> Result<Self, NoSetName> {
        let good = (1..=32).contains(&name.len())
            && name.starts_with(|first: char| first.is_ascii_alphanumeric())
            && name.chars().all(|char| char.is_ascii_alphanumeric() || matches!(char, '-' | '_'));
        if good { Ok(Self(name.to_owned())) } else { Err(NoSetName(name.to_owned())) }
    }
}

impl fmt::Display for SetName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

/// A set's place on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Home {
    name: SetName,
    base: PathBuf,
}

/// Where in a runtime folder it stands which process plays which card.
#[must_use]
pub fn members_in(folder: &Path) -> PathBuf {
    folder.join("members")
}

/// Why a set's place cannot be used.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum HomeError {
    /// Somebody holds the lock.
    #[error("a set named {0} is already up")]
    #[diagnostic(help("take it down with `ccu down --name {0}`, or choose another `--name`"))]
    AlreadyUp(SetName),
    /// A file or folder.
    #[error("cannot {what} {}: {source}", path.display())]
    #[diagnostic(help("{}", advice(path, source)))]
    Io {
        /// What was tried.
        what: &'static str,
        /// With what.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The runtime folder, or one above it, is another user's: a set obeys its owner alone.
    #[error(
        "no set of ours can be in {}: {} belongs to user {owner}, and we are user {}",
        base.display(), closed.display(), getuid().as_raw()
    )]
    #[diagnostic(help(
        "sets of user {owner} obey that user alone; for your own, set XDG_RUNTIME_DIR to a folder of your own, mode 0700"
    ))]
    AnotherUsers {
        /// Where the set would be.
        base: PathBuf,
        /// The folder that belongs to somebody else.
        closed: PathBuf,
        /// To whom.
        owner: u32,
    },
    /// Others may look into the runtime folder, or it is none.
    #[error("{} is not ours alone: its mode is {:04o}", path.display(), mode & 0o7777)]
    #[diagnostic(help(
        "close it with `chmod 700 {}`, or set XDG_RUNTIME_DIR to a folder of your own, mode 0700", path.display()
    ))]
    Open {
        /// The folder.
        path: PathBuf,
        /// What others may do with it.
        mode: u32,
    },
    /// Something else is where the runtime folder should be.
    #[error("{} is not a folder", .0.display())]
    #[diagnostic(help("remove it, or set XDG_RUNTIME_DIR to a folder of your own, mode 0700"))]
    NoFolder(PathBuf),
}

impl Home {
    /// The place of the set `name`: below `XDG_RUNTIME_DIR`, or below a folder of our own in the temporary folder.
    ///
    /// # Errors
    /// If the folder cannot be made, or is not ours alone.
    pub fn of(name: SetName) -> Result<Self, HomeError> {
        Ok(Self { name, base: base()? })
    }

    /// The names of all sets of ours that have a lock on this machine, in order. Whether they live, their daemons tell.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn names() -> Result<Vec<SetName>, HomeError> {
        let base = base()?;
        let entries = fs::read_dir(&base).map_err(io_error("read", &base))?;
        let name = |entry: io::Result<fs::DirEntry>| {
            entry.ok()?.file_name().to_str()?.strip_suffix(".lock")?.parse().ok()
        };
        let mut names: Vec<SetName> = entries.filter_map(name).collect();
        names.sort();
        Ok(names)
    }

    /// The set's name.
    #[must_use]
    pub fn name(&self) -> &SetName {
        &self.name
    }

    /// The runtime folder; everything in it goes when the set does.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        self.base.join(&self.name.0)
    }

    /// The daemon's control socket.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.folder().join("control.sock")
    }

    /// The effective configuration, as the set's processes read it.
    #[must_use]
    pub fn config(&self) -> PathBuf {
        self.folder().join("config.toml")
    }

    /// The program that the set was started for, if there is one.
    #[must_use]
    pub fn script(&self) -> PathBuf {
        self.folder().join("script.rhai")
    }

    /// Which process plays which card.
    #[must_use]
    pub fn members(&self) -> PathBuf {
        members_in(&self.folder())
    }

    /// What a detached daemon has to say.
    #[must_use]
    pub fn messages(&self) -> PathBuf {
        self.base.join(format!("{}.messages", self.name))
    }

    /// Takes the set's lock and makes an empty runtime folder. Whatever a dead set has left in it is removed.
    ///
    /// # Errors
    /// If the set is alive, or files cannot be made.
    pub fn occupy(&self) -> Result<Occupied, HomeError> {
        let lock = self.lock()?;
        let folder = self.folder();
        match fs::remove_dir_all(&folder) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(io_error("remove", &folder)(error));
            }
            _ => {}
        }
        private_folder(&folder)?;
        Ok(Occupied { home: self.clone(), _lock: lock })
    }

    /// The lock file is removed with its set, so what was locked may be a file that nobody finds any more: look again.
    fn lock(&self) -> Result<File, HomeError> {
        let path = self.lock_path();
        loop {
            let file = OpenOptions::new()
                .create(true)
                .truncate(false)
                .write(true)
                .mode(0o600)
                .open(&path)
                .map_err(io_error("open", &path))?;
            match flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => {}
                Err(rustix::io::Errno::WOULDBLOCK) => return Err(HomeError::AlreadyUp(self.name.clone())),
                Err(errno) => return Err(io_error("lock", &path)(errno.into())),
            }
            let ours = file.metadata().map_err(io_error("look at", &path))?;
            if fs::metadata(&path).is_ok_and(|named| named.ino() == ours.ino()) {
                return Ok(file);
            }
        }
    }

    fn lock_path(&self) -> PathBuf {
        self.base.join(format!("{}.lock", self.name))
    }
}

/// A set's place while the set lives. Dropping it removes the runtime folder and gives the lock back.
#[derive(Debug)]
pub struct Occupied {
    home: Home,
    _lock: File,
}

impl Occupied {
    /// The place.
    #[must_use]
    pub fn home(&self) -> &Home {
        &self.home
    }
}

impl Drop for Occupied {
    fn drop(&mut self) {
        for (what, result) in [
            ("the runtime folder", fs::remove_dir_all(self.home.folder())),
            ("the lock", fs::remove_file(self.home.lock_path())),
        ] {
            if let Err(error) = result {
                tracing::warn!(%error, "{what} could not be removed");
            }
        }
    }
}

/// Where a log goes that nobody has named: `$XDG_STATE_HOME/supersigma`, `~/.local/state/supersigma`, or the current folder.
///
/// # Errors
/// If the folder cannot be made.
pub fn default_log(name: &SetName, now: jiff::Timestamp) -> Result<PathBuf, HomeError> {
    let file = format!("{name}-{}.mcap", now.strftime("%Y%m%dT%H%M%S.%3fZ"));
    Ok(state_folder()?.map_or_else(|| file.clone().into(), |folder| folder.join(&file)))
}

/// Where things go that outlive a set: `$XDG_STATE_HOME/supersigma`, or `~/.local/state/supersigma`; `None` if the user has
/// no home.
///
/// # Errors
/// If the folder cannot be made.
pub fn state_folder() -> Result<Option<PathBuf>, HomeError> {
    let absolute = |var: &str| std::env::var_os(var).map(PathBuf::from).filter(|dir| dir.is_absolute());
    let state = absolute("XDG_STATE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".local/state")));
    let Some(folder) = state.map(|state| state.join("supersigma")) else { return Ok(None) };
    private_folder(&folder)?;
    Ok(Some(folder))
}

/// Where all sets of ours live.
fn base() -> Result<PathBuf, HomeError> {
    let base = match std::env::var_os("XDG_RUNTIME_DIR").filter(|dir| Path::new(dir).is_absolute()) {
        Some(dir) => PathBuf::from(dir).join("supersigma"),
        None => std::env::temp_dir().join(format!("supersigma-{}", getuid().as_raw())),
    };
    private_folder(&base).map_err(|error| another_users(&base).unwrap_or(error))?;
    let found = fs::symlink_metadata(&base).map_err(io_error("look at", &base))?;
    if found.uid() != getuid().as_raw() {
        return Err(HomeError::AnotherUsers { closed: base.clone(), base, owner: found.uid() });
    }
    if !found.is_dir() {
        return Err(HomeError::NoFolder(base));
    }
    if found.mode() & 0o077 != 0 {
        return Err(HomeError::Open { path: base, mode: found.mode() });
    }
    Ok(base)
}

/// Whether `base` cannot be reached or made because of a folder that belongs to somebody else: the nearest that can be
/// looked at.
fn another_users(base: &Path) -> Option<HomeError> {
    let seen = |dir: &Path| Some((dir.to_owned(), fs::metadata(dir).ok()?.uid()));
    let (closed, owner) = base.ancestors().find_map(seen)?;
    let foreign = owner != getuid().as_raw() && access(&closed, Access::WRITE_OK | Access::EXEC_OK).is_err();
    foreign.then(|| HomeError::AnotherUsers { base: base.to_owned(), closed, owner })
}

/// What to do about a file or folder with which something is wrong.
fn advice(path: &Path, error: &io::Error) -> String {
    let elsewhere =
        "XDG_RUNTIME_DIR says where runtime folders are, XDG_STATE_HOME where logs are that nobody has named";
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            let at = path.parent().unwrap_or(path).display();
            format!("make room there: `df -h {at}` and `df -i {at}` tell how much there is; {elsewhere}")
        }
        io::ErrorKind::ReadOnlyFilesystem => format!("choose a folder that can be written to; {elsewhere}"),
        _ => format!("this user must be able to write there; {elsewhere}"),
    }
}

fn private_folder(path: &Path) -> Result<(), HomeError> {
    DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(io_error("make", path))
}

fn io_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> HomeError {
    let path = path.to_owned();
    move |source| HomeError::Io { what, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn home(base: &tempfile::TempDir) -> Home {
        Home { name: "test".parse().expect("a good name"), base: base.path().to_owned() }
    }

    #[test]
    fn names_are_short_and_plain() {
        for good in ["supersigma", "a", "cell-2", "7_b"] {
            assert_eq!(good.parse::<SetName>().expect(good).to_string(), good);
        }
        for bad in ["", "-a", "_a", "a b", "../x", "ä", &"x".repeat(33)] {
            let error = bad.parse::<SetName>().expect_err(bad).to_string();
            assert!(error.contains("1 to 32 letters"), "{error}");
        }
    }

    #[test]
    fn a_place_is_taken_once_and_left_clean() {
        let base = tempfile::tempdir().expect("a folder");
        let home = home(&base);
        let occupied = home.occupy().expect("free");
        assert_eq!(fs::metadata(home.folder()).expect("made").mode() & 0o777, 0o700);
        assert!(matches!(home.occupy(), Err(HomeError::AlreadyUp(_))));
        drop(occupied);
        assert_eq!(fs::read_dir(base.path()).expect("a folder").count(), 0);
        home.occupy().expect("free again");
    }

    #[test]
    fn what_a_dead_set_left_is_removed() {
        let base = tempfile::tempdir().expect("a folder");
        let home = home(&base);
        fs::create_dir(home.folder()).expect("made");
        fs::write(home.folder().join("control.sock"), "stale").expect("written");
        fs::write(home.lock_path(), "").expect("written");
        let occupied = home.occupy().expect("nobody holds the lock");
        assert_eq!(fs::read_dir(home.folder()).expect("a folder").count(), 0);
        drop(occupied);
    }
}
