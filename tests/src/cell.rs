//! A cell: the whole world of one set, and what can be asked of it there.

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use rustix::process::Signal;
use serde_json::Value;
use supersigma_protocol::AxisNumber;
use supersigma_protocol::bus::shared_memory::Place;
use tempfile::TempDir;

use crate::config::patient;
use crate::eventually;
use crate::process::{Process, Running};
use crate::ran::Ran;

/// One set's world. When it is dropped, whatever is left of the set is killed and removed.
#[derive(Debug)]
pub struct Cell {
    exe: PathBuf,
    dir: Arc<TempDir>,
    name: String,
    /// Whose commands they are, if not the test's own user's.
    user: Option<u32>,
}

/// A set that has been brought up.
#[derive(Debug)]
pub struct Up {
    /// The daemon's process.
    pub pid: u32,
    /// Its log.
    pub log: PathBuf,
}

impl Cell {
    /// An empty cell for the `ccu` at `exe`.
    #[must_use]
    pub fn new(exe: &str) -> Self {
        // Not below TMPDIR, which may be long: the bus has its sockets in the runtime folder, and their paths are short.
        let dir = tempfile::Builder::new().prefix("ss").tempdir_in("/tmp").expect("a folder in /tmp");
        let cell = Self { exe: exe.into(), dir: Arc::new(dir), name: "cell".into(), user: None };
        fs::create_dir(cell.path("run")).expect("a runtime folder");
        fs::write(cell.config(), patient()).expect("a configuration");
        cell
    }

    /// A second set in the same world.
    #[must_use]
    pub fn neighbour(&self, name: &str) -> Self {
        Self { exe: self.exe.clone(), dir: Arc::clone(&self.dir), name: name.into(), user: self.user }
    }

    /// The same set, asked by another copy of the program.
    #[must_use]
    pub fn with_program(&self, exe: &Path) -> Self {
        Self { exe: exe.into(), dir: Arc::clone(&self.dir), name: self.name.clone(), user: self.user }
    }

    /// The same world as another user's, whose commands are given by a copy of the program that everybody may start. Only
    /// root can give things away.
    #[must_use]
    pub fn given_to(&self, user: u32) -> Self {
        let exe = self.path("program");
        fs::copy(&self.exe, &exe).expect("room for the program");
        for path in [self.path(""), self.path("run"), self.config()] {
            chown(path, Some(user), Some(user)).expect("root may");
        }
        for path in [self.path(""), exe.clone()] {
            fs::set_permissions(path, Permissions::from_mode(0o755)).expect("root may");
        }
        Self { exe, dir: Arc::clone(&self.dir), name: self.name.clone(), user: Some(user) }
    }

    /// The same set, asked by another user.
    #[must_use]
    pub fn of_user(&self, user: u32) -> Self {
        Self { exe: self.exe.clone(), dir: Arc::clone(&self.dir), name: self.name.clone(), user: Some(user) }
    }

    /// A path in the cell's folder, which is also the working directory and the home of its commands.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Writes a file in the cell's folder.
    #[must_use]
    pub fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).expect("a file can be written");
        path
    }

    /// The configuration with which [`up`](Self::up) starts sets: [`patient`], if nobody has written another.
    #[must_use]
    pub fn config(&self) -> PathBuf {
        self.path("cell.toml")
    }

    /// The set's runtime folder.
    #[must_use]
    pub fn runtime(&self) -> PathBuf {
        self.path("run/supersigma").join(&self.name)
    }

    /// A command in this cell.
    #[must_use]
    pub fn command(&self, arguments: &[&str]) -> Command {
        self.here(Command::new(&self.exe), arguments)
    }

    fn here(&self, mut command: Command, arguments: &[&str]) -> Command {
        command
            .args(arguments)
            .current_dir(self.dir.path())
            .env_remove("RUST_LOG")
            .env_remove("RUST_BACKTRACE");
        command.env("HOME", self.dir.path()).env("XDG_STATE_HOME", self.path("state"));
        command.env("XDG_RUNTIME_DIR", self.path("run")).env("CCU_NAME", &self.name);
        if let Some(user) = self.user {
            command.uid(user).gid(user);
        }
        command
    }

    /// Runs a command to its end.
    #[must_use = "it may have failed"]
    pub fn run(&self, arguments: &[&str]) -> Ran {
        Running::start(self.command(arguments)).end()
    }

    /// Runs a command line whose words have no spaces in them.
    #[must_use = "it may have failed"]
    pub fn ccu(&self, line: &str) -> Ran {
        self.run(&words(line))
    }

    /// Runs a command line where `mount` has been done before, in a mount namespace that ends with it. `None`, and a word
    /// why, if this cannot be had here.
    #[must_use = "it may have failed"]
    pub fn ccu_after_mount(&self, mount: &str, line: &str) -> Option<Ran> {
        let mut disk = Command::new("unshare");
        disk.args(["-m", "mount", "-t", "tmpfs", "tmpfs"]).arg(self.dir.path());
        if !disk.output().is_ok_and(|output| output.status.success()) {
            eprintln!("skipped: mounting a disk needs root, unshare and mount");
            return None;
        }
        Some(self.ccu_after(&["unshare", "-m", "sh"], mount, line))
    }

    /// Runs a command line after `before`, in the shell that `shell` starts.
    #[must_use = "it may have failed"]
    pub fn ccu_after(&self, shell: &[&str], before: &str, line: &str) -> Ran {
        let mut command = Command::new(shell[0]);
        command.args(&shell[1..]).args(["-c", &format!("{before} && exec \"$0\" \"$@\"")]).arg(&self.exe);
        Running::start(self.here(command, &words(line))).end()
    }

    /// Starts a command line whose words have no spaces in them.
    #[must_use]
    pub fn start(&self, line: &str) -> Running {
        Running::start(self.command(&words(line)))
    }

    /// Brings the set up, in the background.
    #[must_use]
    pub fn up(&self, time_scale: &str) -> Up {
        let log = self.path(&format!("{}.mcap", self.name));
        let config = self.config();
        let options =
            format!("--time-scale {time_scale} --config {} --log {}", config.display(), log.display());
        let ran = self.ccu(&format!("up --detach {options}")).good();
        let pid = ran.stdout.split("process ").nth(1).and_then(|rest| rest.split(';').next()?.parse().ok());
        Up { pid: pid.unwrap_or_else(|| panic!("no process number in {ran}")), log }
    }

    /// Takes the set down, which leaves nothing but a complete log. Gives what the set had to say, if that was anything.
    #[must_use]
    pub fn down(&self) -> Option<String> {
        let ran = self.ccu("down").good();
        let (sent, logged) = counts(&ran.stdout).unwrap_or_else(|| panic!("no counts in {ran}"));
        assert_eq!(sent, logged, "{ran}");
        self.assert_nothing_left();
        fs::read_to_string(self.runtime().with_extension("messages")).ok()
    }

    /// What the axes are doing, one object an axis.
    #[must_use]
    pub fn status(&self) -> Vec<Value> {
        let lines = self.ccu("status --json").good().json();
        lines.into_iter().filter(|line| line.get("axis").is_some()).collect()
    }

    /// Where each axis says that it is.
    #[must_use]
    pub fn positions(&self) -> BTreeMap<AxisNumber, Option<i64>> {
        let number = |axis: &Value| AxisNumber::new(u8::try_from(axis["axis"].as_u64()?).ok()?);
        let place = |axis: &Value| (number(axis).expect("an axis"), axis["position"].as_i64());
        self.status().iter().map(place).collect()
    }

    /// What one axis is doing.
    #[must_use]
    pub fn axis(&self, axis: &str) -> Value {
        self.run(&["status", "--json", axis]).good().json().remove(0)
    }

    /// Waits until an axis is seen so, and gives what was seen.
    pub fn until(&self, axis: &str, what: &str, seen: impl Fn(&Value) -> bool) -> Value {
        eventually(&format!("{axis} {what}"), || Some(self.axis(axis)).filter(&seen))
    }

    /// What `ccu ps` tells of the process of the axis, or of the part, with this name.
    #[must_use]
    pub fn process_row(&self, name: &str) -> Value {
        let rows = self.run(&["ps", "--json"]).good().json();
        let found = rows.into_iter().find(|row| row["name"] == name || row["role"] == name);
        found.unwrap_or_else(|| panic!("no {name}"))
    }

    /// Waits until that process was started again so often, and runs: who asks sooner may ask one that has just ended.
    #[expect(clippy::must_use_candidate, reason = "most only wait")]
    pub fn until_back(&self, name: &str, restarts: u32) -> Value {
        eventually(&format!("{name} is back"), || {
            Some(self.process_row(name))
                .filter(|row| row["restarts"] == restarts && row["state"] == "running")
        })
    }

    /// The frames of a complete log.
    #[must_use]
    pub fn frames(&self, log: &Path) -> Vec<Value> {
        self.ccu(&format!("frames --json {}", log.display())).good().json()
    }

    /// The process that plays the card, or the pair of cards, with this address.
    #[must_use]
    pub fn worker(&self, card: u8) -> Process {
        self.process(&["--card", &card.to_string()])
    }

    /// The recorder's process.
    #[must_use]
    pub fn recorder(&self) -> Process {
        self.process(&["recorder"])
    }

    fn process(&self, arguments: &[&str]) -> Process {
        let found = self.processes().into_iter().find(|process| process.has(arguments));
        found.unwrap_or_else(|| panic!("no process with {arguments:?} in {:?}", self.processes()))
    }

    /// All processes of the set, and commands that are under way.
    #[must_use]
    pub fn processes(&self) -> Vec<Process> {
        let runtime = self.path("run");
        Process::all_with(&[
            format!("XDG_RUNTIME_DIR={}", runtime.display()),
            format!("CCU_NAME={}", self.name),
        ])
    }

    /// Waits until no process of the set is left.
    pub fn until_all_have_ended(&self) {
        eventually("the end of all processes", || self.processes().is_empty().then_some(()));
    }

    /// No file of the set is left on the machine, but for its logs and a detached set's messages; and its processes end.
    pub fn assert_nothing_left(&self) {
        let files = self.files();
        assert!(files.is_empty(), "left behind: {files:?}");
        self.until_all_have_ended();
    }

    /// Whether a log has been made where logs go that nobody has named.
    #[must_use]
    pub fn has_default_log(&self) -> bool {
        fs::read_dir(self.path("state/supersigma")).is_ok_and(|mut entries| entries.next().is_some())
    }

    /// The set's files in the machine's shared memory.
    #[must_use]
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        let place = Place::new(self.runtime()).expect("short enough");
        let files = fs::read_dir("/dev/shm").expect("Linux has /dev/shm").filter_map(Result::ok);
        let of_the_set = files.filter(|file| file.file_name().to_string_lossy().starts_with(place.prefix()));
        of_the_set.map(|file| file.path()).collect()
    }

    fn files(&self) -> Vec<PathBuf> {
        let lock = self.runtime().with_extension("lock");
        let mut files = self.shared_memory();
        files.extend([self.runtime(), lock].into_iter().filter(|path| path.exists()));
        files
    }
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// The frames that were sent and those that were logged, as `ccu down` and `ccu run` tell them.
#[must_use]
pub fn counts(text: &str) -> Option<(u64, u64)> {
    let line = text.lines().find_map(|line| line.strip_prefix("frames: "))?;
    let (sent, logged) = line.strip_suffix(" logged")?.split_once(" sent, ")?;
    Some((sent.parse().ok()?, logged.parse().ok()?))
}

impl Drop for Cell {
    fn drop(&mut self) {
        // After a good test there is nothing to do.
        for process in self.processes() {
            let pid = i32::try_from(process.pid).ok().and_then(rustix::process::Pid::from_raw);
            let _ = pid.map(|pid| rustix::process::kill_process(pid, Signal::KILL));
        }
        for file in self.shared_memory() {
            let _ = fs::remove_file(file);
        }
    }
}
