//! `soak`: one set for a long time under random programs, watched. Nothing may grow, get lost or be wrong: what is found goes
//! into the report, and into the exit code. It starts a real `ccu`, which it has cargo build first.
//!
//! ```text
//! cargo run --release -p supersigma-tests --bin soak -- --minutes 30 --report docs/src/architecture/soak.md
//! ```

mod life;
mod report;
mod watch;

use std::env;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

use clap::Parser;
use serde_json::Value;

/// Runs a set for a long time under random programs, and watches it
#[derive(Debug, Parser)]
struct Args {
    /// For how long, in minutes of real time
    #[arg(long, default_value_t = 30.0)]
    minutes: f64,
    /// How many times faster than real time
    #[arg(long, default_value_t = 20)]
    time_scale: u32,
    /// What the programs follow from
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A worker is killed after so many programs each time; 0 for never
    #[arg(long, default_value_t = 25, value_name = "PROGRAMS")]
    kill_every: u64,
    /// Where the report goes; without it, to the standard output
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// The `ccu` to start, instead of the one that cargo builds now
    #[arg(long, value_name = "FILE")]
    ccu: Option<PathBuf>,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let ccu = args.ccu.clone().unwrap_or_else(build);
    let record = life::live(&args, &ccu);
    let text = report::markdown(&args, &record);
    match &args.report {
        Some(path) => fs::write(path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display())),
        None => print!("{text}"),
    }
    for finding in &record.findings {
        eprintln!("found: {finding}");
    }
    if record.findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Has cargo build `ccu`, and gives its path.
fn build() -> PathBuf {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .args(["build", "--release", "-p", "supersigma-ccu", "--bin", "ccu"])
        .arg("--message-format=json-render-diagnostics")
        .stderr(Stdio::inherit())
        .output()
        .expect("cargo can be started");
    assert!(built.status.success(), "cargo cannot build ccu");
    let lines = String::from_utf8_lossy(&built.stdout).into_owned();
    let artifacts = lines.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let executable = artifacts
        .filter(|artifact| artifact["target"]["name"] == "ccu")
        .find_map(|artifact| Some(PathBuf::from(artifact["executable"].as_str()?)));
    executable.expect("cargo says where it is")
}
