//! The report, a page of the book.

use std::fmt::Write as _;

use supersigma_tests::machine;

use super::Args;
use super::life::Record;

pub(crate) fn markdown(args: &Args, record: &Record) -> String {
    let mut text = String::from("# A long run\n\n");
    let _ = writeln!(
        text,
        "One set under random programs, watched; made by `just soak`, that is `cargo run --release -p supersigma-tests --bin \
         soak -- --minutes {} --time-scale {} --seed {} --kill-every {}`.",
        args.minutes, args.time_scale, args.seed, args.kill_every
    );
    let _ = writeln!(
        text,
        "After each program the positions are those that it should have led to, and no axis is in alarm; in the end every \
         frame that was sent is in the log, every step in it is accounted for, and fresh machines say the same.\n"
    );
    let account = &record.account;
    let machine_s = record.verified["machine_s"].as_f64().unwrap_or_default();
    let rows = [
        ("machine", machine()),
        (
            "duration",
            format!(
                "{:.1} min, {:.2} h of machine time",
                record.took.as_secs_f64() / 60.0,
                machine_s / 3600.0
            ),
        ),
        ("programs", grouped(record.programs)),
        ("movements and searches", grouped(account.movements)),
        ("steps", grouped(account.steps)),
        ("frames", format!("{} sent, {} logged", grouped(record.sent), grouped(record.logged))),
        ("log", format!("{:.1} MB in {} files", megabytes(record.bytes), record.files)),
        (
            "`ccu replay --verify`",
            format!(
                "{}, {} answers in {:.1} s",
                record.verified["result"].as_str().unwrap_or("nothing"),
                grouped(record.verified["answers"].as_u64().unwrap_or_default()),
                record.verified["took_s"].as_f64().unwrap_or_default()
            ),
        ),
        ("workers killed on purpose", grouped(record.killed)),
        ("alarms that followed from that", grouped(record.provoked as u64)),
        ("alarms in the log", grouped(account.alarms.len() as u64)),
    ];
    text += "| | |\n|---|---|\n";
    for (what, value) in rows {
        let _ = writeln!(text, "| {what} | {value} |");
    }
    text += "\nMemory in MB. A process' own memory and its open files are looked at after every program; \"first\" is after the \
             warm-up, or when the process was started again.\n\n";
    text += "| process | processes | own, first | own, last | own, peak | with shared | files, first | last | processor s |\n";
    text += "|---|--:|--:|--:|--:|--:|--:|--:|--:|\n";
    for (part, watched) in record.watch.parts() {
        let (first, last) = (watched.first, watched.last);
        let _ = writeln!(
            text,
            "| {part} | {} | {:.1} | {:.1} | {:.1} | {:.1} | {} | {} | {:.1} |",
            watched.lives,
            megabytes(first.own),
            megabytes(last.own),
            megabytes(watched.peak),
            megabytes(last.resident),
            first.files,
            last.files,
            last.processor.as_secs_f64()
        );
    }
    text += "\nFindings: ";
    if record.findings.is_empty() {
        text += "none.\n";
    } else {
        text += "\n\n";
        for finding in &record.findings {
            let _ = writeln!(text, "- {finding}");
        }
    }
    text
}

#[expect(clippy::cast_precision_loss, reason = "for people")]
fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// A number with its thousands apart, as in `12 345`.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy);
    groups.collect::<Vec<_>>().join(" ")
}
