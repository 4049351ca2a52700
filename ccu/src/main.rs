//! The `ccu` command.

fn main() -> std::process::ExitCode {
    ccu::cli::main()
}
