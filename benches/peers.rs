//! The other processes of a measurement: this very program, started again with the name of its part. A part ends with its
//! lifeline, however whoever started it has ended. What is measured is not known here.

use std::error::Error;
use std::ffi::OsStr;
use std::io::{self, BufRead, BufReader, Read};
use std::process::{self, Child, Command, ExitCode, Stdio};
use std::thread;

use crate::ping;

/// Somebody who keeps a processor busy.
const BUSY: &str = "play-busy";
/// The other end of a pair of iceoryx2 services.
pub(crate) const SHARED_MEMORY: &str = "play-shared-memory";
/// The other end of a pair of sockets.
pub(crate) const SOCKET: &str = "play-socket";
/// What a part says as soon as it can be spoken to.
const READY: &str = "ready";

/// Plays the part that the command line names, if it names one. A set's daemon starts its own executable for its cards and
/// its recorder; in a benchmark that is this program, so it has those parts too.
pub(crate) fn play() -> Option<Result<ExitCode, Box<dyn Error>>> {
    let mut arguments = std::env::args_os().skip(1);
    let part = arguments.next()?;
    let place = arguments.next().unwrap_or_default();
    let played = match part.to_str()? {
        // A room to be measured has the same name as a part, but no arguments of its own.
        "axis-worker" | "recorder" if place == "--runtime" => return Some(Ok(ccu::cli::main())),
        BUSY => {
            end_with_lifeline();
            ready();
            loop {
                std::hint::spin_loop();
            }
        }
        SHARED_MEMORY => {
            end_with_lifeline();
            ping::SharedMemory::echo(place.as_ref(), ready)
        }
        SOCKET => {
            end_with_lifeline();
            ping::Sockets::echo(place.as_ref(), ready)
        }
        _ => return None,
    };
    Some(played.map(|()| ExitCode::SUCCESS))
}

fn ready() {
    println!("{READY}");
}

fn end_with_lifeline() {
    thread::spawn(|| {
        let _ = io::stdin().read_to_end(&mut Vec::new());
        process::exit(0);
    });
}

/// A process that plays a part until it is dropped.
pub(crate) struct Peer(Child);

impl Peer {
    /// Starts one, and returns when it is ready.
    pub(crate) fn start(part: &str, place: &OsStr) -> Result<Self, Box<dyn Error>> {
        let mut command = Command::new(std::env::current_exe()?);
        let mut child =
            command.arg(part).arg(place).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map(Self)?;
        let mut line = String::new();
        if let Some(output) = child.0.stdout.take() {
            BufReader::new(output).read_line(&mut line)?;
        }
        if line.trim_end() == READY { Ok(child) } else { Err(format!("{part} did not come to life").into()) }
    }

    /// As many as there are processors, each of which keeps one busy.
    pub(crate) fn everywhere() -> Result<Vec<Self>, Box<dyn Error>> {
        let processors = thread::available_parallelism()?.get();
        (0..processors).map(|_| Self::start(BUSY, OsStr::new(""))).collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}
