//! Garbage in: what must hold whatever bytes come, a body for each way in. The test `garbage` feeds them by chance.
//!
//! | body | what comes in | what must hold besides that nothing panics |
//! |---|---|---|
//! | [`commands`] | bytes into the decoders | what decodes encodes to the same bytes; a refusal names what is there |
//! | [`axis`] | frames, faults and time into a card | no pulse without an accepted start; every step is accounted for |
//! | [`executive`] | answers into the CCU | only what was asked for moves; it comes to an end |
//! | [`watching`] | frames into the log and the watchers | the log has every byte of them, in pictures nothing is endless |
//! | [`config`] | a configuration's text | what loads makes machines; faults lie in the text |
//! | [`script`] | a robot program's text | it ends, and its errors lie in the text |
//! | [`log`], [`changed_log`], [`forged_log`] | bytes into every reader of a log | what is recovered reads back whole |
//!
//! A body takes bytes and makes of them, in order, what it needs; it fails by panicking. How many bytes come, and which,
//! is the caller's business.
#![expect(clippy::missing_panics_doc, reason = "the bodies fail by panicking, all of them")]

mod axis;
mod commands;
mod config;
mod executive;
mod frames;
mod logs;
mod script;
mod watching;

pub use axis::axis;
pub use commands::commands;
pub use config::config;
pub use executive::executive;
pub use logs::{changed_log, forged_log, log};
pub use script::script;
pub use watching::watching;

use std::sync::{Arc, OnceLock};

use ccu::executive::Knowledge;
use supersigma_config::Config;

/// The built-in set, as the CCU knows it.
fn knowledge() -> Arc<Knowledge> {
    static BUILT_IN: OnceLock<Arc<Knowledge>> = OnceLock::new();
    let knowledge = || Knowledge::new(Config::default_set()).expect("good ramps");
    Arc::clone(BUILT_IN.get_or_init(knowledge))
}

/// What the bodies take from bytes when these have run out: zeros. So they need not handle that everywhere.
fn taken<T>(value: arbitrary::Result<T>) -> T {
    value.expect("bytes that have run out give zeros")
}
