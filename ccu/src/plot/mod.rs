//! Pictures of what a set did, of how its ramps are made, and of what the test bench recorded.
//!
//! ```text
//!   frames ─┬► trace    what every axis said, as series over time ─► moves, sense, plane ─┐
//!           └► timing   movements, waits, digital lines, totals  ─► gantt                ─┼► sheet ─► SVG ─► png
//!   ramp table, movements of one axis                            ─► profile              ─┤
//!   a recording of the test bench, and its filters               ─► bench                ─┤
//!   what the bench found of a motor                              ─► limits, tune         ─┘
//! ```
//!
//! `trace` and `timing` are pure: frames in, values out. The drawing rooms know no file and no bus, and draw the same
//! bytes from the same values. A PNG is the rendered SVG, with a font that is compiled in, so both look the same.

pub mod bench;
mod gantt;
pub mod limits;
mod moves;
mod plane;
mod png;
pub mod profile;
mod sense;
mod sheet;
mod timing;
mod trace;
pub mod tune;

use std::path::{Path, PathBuf};
use std::{fs, io};

use clap::ValueEnum;
use supersigma_config::Config;

pub use gantt::gantt;
pub use moves::{Shown, moves};
pub use timing::{AxisTiming, Bar, Ending, Kind, Lane, Summary, Timing};
pub use trace::{AxisTrace, Sample, Trace, Window};

use crate::log::AxisNames;

/// What is shown of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ValueEnum)]
pub enum What {
    /// Steps per second over time
    Speed,
    /// Steps from the origin over time, with travel limits and limit zones
    Position,
    /// X1 to X5 as lanes, with alarms and faults
    Sense,
    /// Speed over position, with limit zones and the reference step
    Plane,
    /// Movements as bars, a lane an axis, with the digital lines
    Timing,
}

/// Width and height in pixels of the picture at its natural size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

impl Size {
    /// Neither side may be longer.
    const LONGEST: u32 = 10_000;
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |text: &str| text.parse().ok().filter(|side| (1..=Self::LONGEST).contains(side));
        let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
        let (width, height) = sides.ok_or_else(|| {
            format!("a size is width x height in pixels, as 1200x800; up to {} each", Self::LONGEST)
        })?;
        Ok(Self { width, height })
    }
}

/// The set that a picture is of.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// What stands over the picture.
    pub title: &'a str,
    /// What stands below that: when it was, and where it comes from.
    pub subtitle: &'a str,
    /// What the axes are called.
    pub names: &'a AxisNames,
    /// Rails, travel limits and digital lines.
    pub config: &'a Config,
}

/// A finished picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    svg: String,
    size: Size,
}

impl Picture {
    /// As an SVG document. Its text is in the reader's sans-serif font.
    #[must_use]
    pub fn svg(&self) -> &str {
        &self.svg
    }

    /// Its natural size.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Writes it to a file, in place of whatever was there.
    ///
    /// # Errors
    /// If the file's name ends in neither `.svg` nor `.png`, or it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), PlotError> {
        let bytes = match Format::of(path)? {
            Format::Svg => self.svg.clone().into_bytes(),
            Format::Png => png::render(self)?,
        };
        fs::write(path, bytes).map_err(|source| PlotError::Write { path: path.to_owned(), source })
    }
}

/// The kinds of picture files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Lines and text.
    Svg,
    /// Pixels, two for each one of the picture's size in both directions.
    Png,
}

impl Format {
    /// By the end of the file's name.
    ///
    /// # Errors
    /// If it is neither `.svg` nor `.png`.
    pub fn of(path: &Path) -> Result<Self, PlotError> {
        match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
            Some(extension) if extension == "svg" => Ok(Self::Svg),
            Some(extension) if extension == "png" => Ok(Self::Png),
            _ => Err(PlotError::Extension { path: path.to_owned() }),
        }
    }
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// Neither SVG nor PNG.
    #[error("{} is no name of a picture; it must end in .svg or .png", .path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// A full disk, for example.
    #[error("cannot write the picture {}: {source}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It would not be legible.
    #[error("{asked} is too small for this picture; it needs at least {needed}")]
    TooSmall {
        /// What was asked for.
        asked: Size,
        /// What is needed.
        needed: Size,
    },
    /// The drawing library refused.
    #[error("cannot draw: {0}")]
    Draw(String),
}

#[cfg(test)]
mod tests;
