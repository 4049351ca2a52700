//! The `ccu` command.

fn main() {}
