//! A command on a terminal: a pseudo-terminal, and what a person would see on its screen.

use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZeroU16;
use std::os::fd::OwnedFd;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use vt100::Parser;

use crate::eventually;

/// A command that runs on a terminal of its own.
pub struct Terminal {
    child: Child,
    keys: File,
    parser: Arc<Mutex<Parser>>,
}

impl Terminal {
    /// Starts `command` on a terminal of so many columns and rows.
    #[must_use]
    pub fn start(mut command: Command, columns: u16, rows: u16) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
        grantpt(&master).and_then(|()| unlockpt(&master)).expect("it may be used");
        let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&master, size).expect("it has a size");
        let name = ptsname(&master, Vec::new()).expect("it has a name");
        let open = || -> OwnedFd {
            let flags = OFlags::RDWR | OFlags::NOCTTY;
            rustix::fs::open(&name, flags, Mode::empty()).expect("its other side")
        };
        command.stdin(Stdio::from(open())).stdout(Stdio::from(open())).stderr(Stdio::from(open()));
        command.env("TERM", "xterm-256color").env_remove("NO_COLOR");
        let child = command.spawn().expect("it can be started");
        // The command holds the other side in its descriptors until it is dropped.
        drop(command);
        let parser = Arc::new(Mutex::new(Parser::new(side(rows), side(columns), 0)));
        let (mut screen, into) =
            (File::from(master.try_clone().expect("a second hold")), Arc::clone(&parser));
        thread::spawn(move || {
            let mut buffer = [0; 4096];
            // When nobody holds the other side any more, reading fails.
            while let Ok(length @ 1..) = screen.read(&mut buffer) {
                into.lock().unwrap_or_else(PoisonError::into_inner).process(&buffer[..length]);
            }
        });
        Self { child, keys: File::from(master), parser }
    }

    /// Presses keys.
    pub fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).expect("somebody sits at the other side");
    }

    /// The process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// What the screen shows now.
    #[must_use]
    pub fn screen(&self) -> String {
        self.parser().screen().contents()
    }

    /// Waits until the screen shows `text`.
    pub fn shows(&self, text: &str) {
        eventually(&format!("{text:?} on the screen"), || self.screen().contains(text).then_some(()));
    }

    /// Whether the screen is the one that programs put before the shell's, or hides the cursor.
    #[must_use]
    pub fn is_taken(&self) -> bool {
        let parser = self.parser();
        parser.screen().alternate_screen() || parser.screen().hide_cursor()
    }

    /// Waits until it has ended.
    pub fn end(&mut self) -> ExitStatus {
        eventually("the end of a command on a terminal", || {
            self.child.try_wait().expect("it can be waited for")
        })
    }

    fn parser(&self) -> MutexGuard<'_, Parser> {
        self.parser.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn side(length: u16) -> NonZeroU16 {
    NonZeroU16::new(length).expect("a screen has rows and columns")
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // Only a test that has failed leaves one behind.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
