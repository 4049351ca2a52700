//! Watching a set: what every axis does, how busy the bus is, what went by on it last, drawn from its frames alone.
//!
//! ```text
//!   frames (live feed, or a log) ─► Picture ─► Snapshot ─► terminal, web page, JSON
//!   the set's description ────────►    │
//!                                      ├ axis     a motor card's last word and its histories
//!                                      ├ history  equal steps of time, for curves
//!                                      └ frames   the last frames, decoded when they are shown
//! ```
//!
//! The picture is pure: it knows no clock, no bus and no screen; time comes with what it is given. The live feed
//! ([`Feed`]) is the one room in here that talks to a daemon. Nothing in here commands anything.

mod axis;
mod feed;
mod frames;
mod history;
mod picture;
mod snapshot;
#[cfg(test)]
mod tests;

pub use feed::{Feed, News};
pub use frames::Filter;
pub use picture::Picture;
pub use snapshot::{
    AlarmView, AxisSnapshot, Detail, DigitalSnapshot, EventView, FrameLine, LaneCounts, LaneName, LineView,
    RailView, SetView, Snapshot,
};
