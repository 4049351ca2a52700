//! The control socket's language, and its client. A line of JSON a message: the client sends [`ToDaemon`], the daemon
//! answers each with one [`FromDaemon`]. What a request means is the executive's business.

use std::io::{self, BufRead, BufReader, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use supersigma_protocol::Address;
use supersigma_protocol::bus::Lane;

use crate::executive::{AxisState, Failure, LogTrouble, Operate, Outcome, Request};
use crate::home::Home;

/// From a client to the daemon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToDaemon {
    /// Something for the executive.
    Do(Request),
    /// The same for a program: if it is halted, the program waits until it is resumed.
    DoOrWait(Request),
    /// What set are you?
    Describe,
    /// Tell of every frame from now on, and once a second of the set; nothing else is asked on this connection any more.
    Watch,
    /// Take the set down.
    Down,
}

/// From the daemon to a client.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FromDaemon {
    /// What came of a request.
    Done(Outcome),
    /// Why nothing came of it.
    Failed(Failure),
    /// The set.
    Description(Box<Description>),
    /// The set is down.
    Down(DownReport),
    /// What went by since the last time, for one who watches.
    Overheard(Overheard),
}

/// Frames for a watcher, in the order in which the daemon heard and said them.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Overheard {
    /// So many frames before these went by while the watcher did not read; the set has not lost them.
    pub dropped: u64,
    /// The frames.
    pub frames: Vec<OverheardFrame>,
}

/// A frame's bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OverheardFrame {
    /// From the CCU.
    Command(Hex),
    /// From a card.
    Answer(Hex),
}

/// Bytes; in JSON hexadecimal digits, two a byte.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Hex(pub Vec<u8>);

impl From<Hex> for String {
    fn from(hex: Hex) -> Self {
        const DIGITS: &[u8; 16] = b"0123456789abcdef";
        hex.0
            .iter()
            .flat_map(|byte| [byte >> 4, byte & 15])
            .map(|half| char::from(DIGITS[usize::from(half)]))
            .collect()
    }
}

impl TryFrom<String> for Hex {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let digit = |byte: &u8| char::from(*byte).to_digit(16).and_then(|digit| u8::try_from(digit).ok());
        let pairs = text.as_bytes().chunks(2).map(|pair| match pair {
            [high, low] => Some(digit(high)? << 4 | digit(low)?),
            _ => None,
        });
        pairs.collect::<Option<_>>().map(Self).ok_or_else(|| format!("{text:?} is not hexadecimal"))
    }
}

impl From<(Lane, Arc<[u8]>)> for OverheardFrame {
    fn from((lane, bytes): (Lane, Arc<[u8]>)) -> Self {
        let bytes = Hex(bytes.to_vec());
        match lane {
            Lane::Commands => Self::Command(bytes),
            Lane::Answers => Self::Answer(bytes),
        }
    }
}

impl OverheardFrame {
    /// Which way it went, and its bytes.
    #[must_use]
    pub fn bytes(&self) -> (Lane, &[u8]) {
        match self {
            Self::Command(bytes) => (Lane::Commands, &bytes.0),
            Self::Answer(bytes) => (Lane::Answers, &bytes.0),
        }
    }
}

/// A set, as its daemon sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Its name.
    pub name: String,
    /// The daemon's process.
    pub pid: u32,
    /// The effective configuration.
    pub config: String,
    /// How many times faster than real time.
    pub time_scale: f64,
    /// The log.
    pub log: PathBuf,
    /// Where a live view of it is served, if one is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foxglove: Option<String>,
    /// Seconds of real time since it is up.
    pub up_s: f64,
    /// What each axis' card said last.
    pub axes: Vec<AxisState>,
    /// Digital cards that somebody plays.
    pub digital: Vec<Address>,
    /// The digital inputs, as their card said last: bit n is line n.
    pub inputs: Option<u16>,
    /// The digital outputs, as their card said last; it says nothing before it is asked.
    pub outputs: Option<u16>,
    /// Frames on the bus so far.
    pub frames: u64,
    /// Frames that were lost.
    pub lost: u64,
    /// The recorder.
    pub recorder: RecorderView,
    /// The processes that the daemon has started.
    pub processes: Vec<ProcessView>,
}

/// One process of a set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessView {
    /// Its part: `recorder` or `worker`.
    pub role: ProcessRole,
    /// A worker's card.
    pub card: Option<Address>,
    /// Its number; null while it waits to be started again.
    pub pid: Option<u32>,
    /// Whether it does its part.
    pub state: ProcessState,
    /// Milliseconds of real time since it was started, or since it ended.
    pub since_ms: u64,
    /// How often it has been started again.
    pub restarts: u32,
}

/// What a process is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProcessRole {
    /// It writes the log.
    Recorder,
    /// It plays a card.
    Worker,
}

/// Whether a process does its part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProcessState {
    /// It does.
    Running,
    /// It lives, but nothing has been heard of it for too long.
    Silent,
    /// It has ended, and will be started again.
    Restarting,
    /// It has ended.
    Ended,
}

/// The recorder, as the daemon knows it. News comes every 250 ms.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecorderView {
    /// What it does.
    pub state: RecorderState,
    /// The file that is being written, or was last.
    pub log: PathBuf,
    /// All files of the log, in order.
    pub parts: Vec<PathBuf>,
    /// Frames in the log.
    pub frames: u64,
    /// Frames that are missing in it.
    pub lost: u64,
    /// The length of its files.
    pub bytes: u64,
    /// The greatest real time, in milliseconds, by which it lately was behind the bus.
    pub behind_ms: u64,
    /// Why nothing moves; null if nothing is wrong with the log.
    pub trouble: Option<LogTrouble>,
}

/// What the recorder does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecorderState {
    /// It records.
    Recording,
    /// It has ended, or cannot write.
    Stopped,
    /// There is no room for the log.
    DiskFull,
}

/// The last words about a set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DownReport {
    /// The log.
    pub log: PathBuf,
    /// Frames that were sent on the bus, by everybody, as their senders count them.
    pub sent: u64,
    /// Frames in the log; `None` if the recorder did not say.
    pub logged: Option<u64>,
    /// Frames that are missing in it.
    pub lost: Option<u64>,
    /// The log's size in bytes, all files together.
    pub bytes: Option<u64>,
    /// Its files, in order.
    pub parts: Vec<PathBuf>,
}

/// A client of a daemon.
#[derive(Debug)]
pub struct Client {
    name: String,
    waits: bool,
    stream: BufReader<UnixStream>,
}

impl Client {
    /// Connects to the set that lives at `home`.
    ///
    /// # Errors
    /// If nobody listens there.
    pub fn connect(home: &Home) -> Result<Self, Failure> {
        let name = home.name().to_string();
        match UnixStream::connect(home.socket()) {
            Ok(stream) => Ok(Self { name, waits: false, stream: BufReader::new(stream) }),
            Err(error)
                if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused) =>
            {
                Err(Failure::NoSet { name })
            }
            Err(error) => Err(Failure::Control { reason: error.to_string() }),
        }
    }

    /// The client of a program, which waits when its movements are halted, until they are resumed.
    #[must_use]
    pub fn of_a_program(self) -> Self {
        Self { waits: true, ..self }
    }

    /// What set it is.
    ///
    /// # Errors
    /// If the daemon is gone.
    pub fn describe(&mut self) -> Result<Description, Failure> {
        match self.ask(&ToDaemon::Describe)? {
            FromDaemon::Description(description) => Ok(*description),
            other => Err(unexpected(&other)),
        }
    }

    /// Takes the set down, and returns when it is.
    ///
    /// # Errors
    /// If the daemon is gone.
    pub fn down(&mut self) -> Result<DownReport, Failure> {
        match self.ask(&ToDaemon::Down)? {
            FromDaemon::Down(report) => Ok(report),
            other => Err(unexpected(&other)),
        }
    }

    /// From now on only what goes by, see [`Client::news`].
    ///
    /// # Errors
    /// If the daemon is gone.
    pub fn watch(&mut self) -> Result<(), Failure> {
        self.tell(&ToDaemon::Watch)
    }

    /// What the daemon tells next; waits for it.
    ///
    /// # Errors
    /// If the daemon is gone, as when its set has been taken down.
    pub fn news(&mut self) -> Result<FromDaemon, Failure> {
        let mut line = String::new();
        match self.stream.read_line(&mut line) {
            Ok(0) => Err(gone(&format!("the daemon of set {} has hung up", self.name))),
            Ok(_) => serde_json::from_str(&line).map_err(|error| gone(&error)),
            Err(error) => Err(gone(&error)),
        }
    }

    /// What ends the request under way from another thread: the daemon then halts what it moves.
    ///
    /// # Errors
    /// If the system cannot duplicate the connection.
    pub fn hang_up(&self) -> io::Result<impl Fn() + Send + Sync + 'static> {
        let stream = Arc::new(self.stream.get_ref().try_clone()?);
        Ok(move || {
            // Half only: the answer, that it was halted, still comes back.
            let _ = stream.shutdown(Shutdown::Write);
        })
    }

    fn ask(&mut self, message: &ToDaemon) -> Result<FromDaemon, Failure> {
        self.tell(message)?;
        self.news()
    }

    fn tell(&mut self, message: &ToDaemon) -> Result<(), Failure> {
        let mut line = serde_json::to_string(message).map_err(|error| gone(&error))?;
        line.push('\n');
        self.stream.get_mut().write_all(line.as_bytes()).map_err(|error| gone(&error))
    }
}

impl Operate for Client {
    fn operate(&mut self, request: Request) -> Result<Outcome, Failure> {
        let message = if self.waits { ToDaemon::DoOrWait(request) } else { ToDaemon::Do(request) };
        match self.ask(&message)? {
            FromDaemon::Done(outcome) => Ok(outcome),
            FromDaemon::Failed(failure) => Err(failure),
            other => Err(unexpected(&other)),
        }
    }
}

fn gone(error: &dyn std::fmt::Display) -> Failure {
    Failure::Control { reason: error.to_string() }
}

fn unexpected(message: &FromDaemon) -> Failure {
    Failure::Control { reason: format!("an answer to something else: {message:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_watcher_reads_frames_as_hexadecimal_digits() {
        let frames =
            vec![OverheardFrame::Command(Hex(vec![0x01, 0xA5])), OverheardFrame::Answer(Hex(vec![]))];
        let overheard = FromDaemon::Overheard(Overheard { dropped: 3, frames });
        let text = r#"{"overheard":{"dropped":3,"frames":[{"command":"01a5"},{"answer":""}]}}"#;
        assert_eq!(serde_json::to_string(&overheard).expect("plain data"), text);
        assert_eq!(serde_json::from_str::<FromDaemon>(text).expect("as written"), overheard);
        for wrong in ["1", "+1", "0x", "äö"] {
            assert!(Hex::try_from(wrong.to_owned()).is_err(), "{wrong}");
        }
    }
}
