//! This very program, to be started again as another process of the set. By its path it could be another one by now, or
//! none: people build and install while a set is up.

use std::env;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// What the system shows as the name of a process that has been started so.
const NAME: &std::ffi::CStr = c"ccu";

/// A command that starts the program that this process runs, whatever stands at its path now.
#[must_use]
pub fn again() -> Command {
    // The system resolves it in the child, which still has this process' program then.
    let mut command = Command::new("/proc/self/exe");
    command.arg0(env::args_os().next().unwrap_or_else(|| "ccu".into()));
    command
}

/// Has this process bear the program's name; it would be called `exe` after the path by which it was started.
pub fn take_name() {
    if let Err(error) = rustix::thread::set_name(NAME) {
        tracing::debug!(%error, "the process keeps the name that it has");
    }
}
