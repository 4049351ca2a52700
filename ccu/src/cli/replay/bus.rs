use super::ReplayArgs; use crate::cli::exit::Exit;
pub(super) fn bus(_: &ReplayArgs) -> Result<(), Exit> { Ok(()) }
