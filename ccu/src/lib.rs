//! The central control unit of a SUPERSIGMA set: the daemon that broadcasts on the MICROBUS, and the command line.

pub mod executive;
pub mod script;
