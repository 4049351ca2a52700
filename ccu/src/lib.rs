//! The central control unit of a SUPERSIGMA set: the daemon that broadcasts on the MICROBUS, and the command line.

pub mod bench;
pub mod cli;
pub mod control;
pub mod daemon;
pub mod dry;
pub mod executive;
pub mod home;
pub mod log;
pub mod notices;
pub mod plot;
pub mod profile;
pub mod program;
pub mod replay;
pub mod script;
pub mod serve;
pub mod watch;
