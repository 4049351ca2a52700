use super::ReplayArgs; use crate::cli::exit::Exit;
pub(super) fn show(_: &ReplayArgs) -> Result<(), Exit> { Ok(()) }
