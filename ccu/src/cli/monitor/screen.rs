//! The terminal: taken, drawn on, and given back, also after a panic. Signals are the caller's business.

use std::io;

use ratatui::DefaultTerminal;
use ratatui::layout::Size;

use super::draw::{self, Scene};

/// The terminal while it is ours. Dropping it gives it back; a panic does so before it speaks.
pub(super) struct Screen(DefaultTerminal);

impl Screen {
    pub(super) fn take() -> io::Result<Self> {
        ratatui::try_init().map(Self)
    }

    pub(super) fn size(&self) -> io::Result<Size> {
        self.0.size()
    }

    pub(super) fn draw(&mut self, scene: &Scene<'_>) -> io::Result<()> {
        self.0.draw(|frame| draw::draw(frame, scene)).map(|_| ())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Nobody is left to tell if the terminal is gone.
        let _ = ratatui::try_restore();
    }
}
