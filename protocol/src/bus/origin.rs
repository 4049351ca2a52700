//! Which process a frame comes from. The carrier tells it, not the frame: nobody can claim it with bytes.

use std::fmt;

/// The process that has sent a frame, by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Origin(pub u32);

impl Origin {
    /// A process whose number the carrier could not tell. No process has this number.
    pub const UNKNOWN: Self = Self(0);

    /// This process.
    #[must_use]
    pub fn own() -> Self {
        Self(std::process::id())
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {}", self.0)
    }
}
