//! `ccu frames`, `ccu log` and `ccu recover`: what a log holds, and how a damaged one is made whole. What is read and
//! written is decided in `crate::log`; this room words it.

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use clap::{Args, Subcommand};
use miette::{IntoDiagnostic, miette};
use supersigma_protocol::Tick;

use super::exit::Exit;
use super::show;
use crate::log::{self, Form, FramesAsked, LogError, LogInfo, LogState, Lost, Recovery};

#[derive(Args)]
pub(super) struct FramesArgs {
    /// The log
    log: PathBuf,
    /// Only frames of this axis, and to it or to everyone
    #[arg(long)]
    axis: Option<String>,
    /// Only frames from this second of machine time on (the first column)
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    from: Option<Tick>,
    /// Only frames before this second of machine time
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    to: Option<Tick>,
    /// Only commands with this operation, as in `move` or `fault`, and the answers to them
    #[arg(long, value_name = "NAME", value_parser = log::operation)]
    op: Option<&'static str>,
    /// One JSON object a frame
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// A table: comma-separated values with a title line
    #[arg(long)]
    csv: bool,
}

#[derive(Subcommand)]
pub(super) enum LogCommand {
    /// What a log holds: its set, its span, its channels, gaps and alarms
    #[command(after_help = "Examples:\n  ccu log info run.mcap\n  ccu log info run.mcap --json")]
    Info(InfoArgs),
}

#[derive(Args)]
pub(super) struct InfoArgs {
    /// The log
    log: PathBuf,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub(super) struct RecoverArgs {
    /// The log; it is only read
    log: PathBuf,
    /// The new log; must not exist yet
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn frames(args: &FramesArgs) -> Result<(), Exit> {
    if let (Some(from), Some(to)) = (args.from, args.to)
        && from >= to
    {
        return Err(Exit::wrong(miette!(
            help = "--from is the first moment that is shown, --to the first one that is not",
            "nothing lies between --from {} and --to {}",
            since(from),
            since(to)
        )));
    }
    let asked = FramesAsked {
        axis: args.axis.as_deref(),
        from: args.from,
        to: args.to,
        operation: args.op,
        form: match (args.json, args.csv) {
            (true, _) => Form::Json,
            (_, true) => Form::Csv,
            _ => Form::People,
        },
    };
    let mut out = BufWriter::new(io::stdout().lock());
    let counts = log::frames(&args.log, &asked, &mut out).map_err(|error| match error {
        LogError::Damaged { .. } => Exit::wrong(miette!(help = recover_help(&args.log), "{error}")),
        other => Exit::wrong(miette!("{other}")),
    })?;
    if counts.truncated {
        let shown = match counts.printed {
            all if all == counts.read => "are shown".to_owned(),
            some => format!("were read, and {some} of them are shown"),
        };
        let help = recover_help(&args.log);
        let read = counts.read;
        let told =
            format!("the log ends in the middle of a record; the {read} frames before that {shown}\n{help}");
        // If nobody reads it, there is nobody else to tell.
        let _ = writeln!(io::stderr(), "{told}");
    }
    Ok(())
}

pub(super) fn log(command: &LogCommand) -> Result<(), Exit> {
    let LogCommand::Info(args) = command;
    let info = log::info(&args.log).into_diagnostic().map_err(Exit::wrong)?;
    let mut out = BufWriter::new(io::stdout().lock());
    if args.json {
        show::print_json(&info, &mut out)?;
    } else {
        tell(&info, &mut out)?;
    }
    Ok(out.flush()?)
}

pub(super) fn recover(args: &RecoverArgs) -> Result<(), Exit> {
    let recovery = log::recover(&args.log, &args.output).map_err(|error| {
        let report = miette!("{error}");
        match error {
            LogError::Exists { .. } | LogError::Read { .. } => Exit::wrong(report),
            _ => Exit::could_not(report),
        }
    })?;
    let mut out = BufWriter::new(io::stdout().lock());
    if args.json {
        show::print_json(&recovery, &mut out)?;
    } else {
        tell_recovery(&recovery, args, &mut out)?;
    }
    Ok(out.flush()?)
}

fn tell_recovery(recovery: &Recovery, args: &RecoverArgs, out: &mut dyn Write) -> io::Result<()> {
    let Recovery {
        complete, chunks, messages, frames, attachments, orphans, lost, tail, bytes, last, ..
    } = recovery;
    let log = args.log.display();
    if *complete {
        writeln!(out, "{log} is complete; nothing was to be done")?;
    }
    for Lost { bytes, after, before, frames } in lost {
        let at = |tick: &Option<Tick>, none: &str| {
            tick.map_or_else(|| none.to_owned(), |tick| format!("{} s", since(tick)))
        };
        writeln!(
            out,
            "lost:      bytes {} to {}, between {} and {}; {frames} frames are missing there",
            bytes.start,
            bytes.end,
            at(after, "the beginning"),
            at(before, "the end")
        )?;
    }
    if let Some(tail) = tail {
        let last = last
            .map_or_else(|| "before the first frame".to_owned(), |last| format!("after {} s", since(last)));
        writeln!(out, "cut:       {last}; the last {} bytes are no whole record", tail.end - tail.start)?;
    }
    if *orphans > 0 {
        writeln!(out, "left out:  {orphans} messages, because the description of their channel is lost")?;
    }
    let size = show::size(*bytes);
    writeln!(
        out,
        "recovered: {frames} frames ({messages} messages in {chunks} chunks), {attachments} attachments"
    )?;
    writeln!(out, "written:   {}, {size}, read back and compared", args.output.display())
}

fn tell(info: &LogInfo, out: &mut dyn Write) -> io::Result<()> {
    let start = i128::from(info.epoch_ns);
    let start =
        jiff::Timestamp::from_nanosecond(start).map_or_else(|_| "?".to_owned(), |time| time.to_string());
    let version =
        info.version.as_deref().map(|version| format!(", written by version {version}")).unwrap_or_default();
    writeln!(out, "log:      {}, {}", info.log.display(), show::size(info.bytes))?;
    writeln!(out, "set:      {}{version}", info.set)?;
    writeln!(out, "tick 0:   {start}, {} times real time", info.time_scale)?;
    let state = match (info.state, &info.damage) {
        (LogState::Complete, _) => "complete".to_owned(),
        (LogState::Cut, _) => "cut before its end".to_owned(),
        (LogState::Damaged, damage) => format!("damaged {}", damage.as_deref().unwrap_or_default()),
    };
    writeln!(out, "state:    {state}")?;
    if info.state != LogState::Complete {
        writeln!(out, "          {}", recover_help(&info.log))?;
    }
    if let (Some(first), Some(last)) = (info.first_s, info.last_s) {
        writeln!(out, "span:     {first:.7} to {last:.7} s, {:.3} s of machine time", last - first)?;
    }
    for (key, value) in &info.more {
        writeln!(out, "{:<9} {value}", format!("{key}:"))?;
    }
    let frames = &info.frames;
    let answers: u64 = frames.answers.values().sum();
    let gap: u64 = info.gaps.iter().map(|gap| gap.lost).sum();
    writeln!(
        out,
        "frames:   {}: {} commands, {answers} answers, {} undecodable; {gap} missing in {} gaps",
        frames.all,
        frames.commands,
        frames.undecodable,
        info.gaps.len()
    )?;
    for (card, answers) in &frames.answers {
        writeln!(out, "          {answers:>9}  answers of {card}")?;
    }
    writeln!(out, "\n{:>9}  {:<28} {:<9} schema", "messages", "topic", "encoding")?;
    for channel in &info.channels {
        let lane = channel.lane.as_ref().map(|lane| format!(" ({lane})")).unwrap_or_default();
        writeln!(
            out,
            "{:>9}  {:<28} {:<9} {}",
            channel.messages,
            format!("{}{lane}", channel.topic),
            channel.encoding,
            channel.schema.as_deref().unwrap_or("-")
        )?;
    }
    if !info.gaps.is_empty() {
        writeln!(out, "\n{:>15}  {:<15} frames missing", "seconds", "gap of")?;
    }
    for gap in &info.gaps {
        writeln!(out, "{:>15.7}  {:<15} {}", gap.time_s, gap.sender, gap.lost)?;
    }
    if !info.alarms.is_empty() {
        writeln!(out, "\n{:>15}  {:<15} alarm", "seconds", "axis")?;
    }
    for alarm in &info.alarms {
        writeln!(out, "{:>15.7}  {:<15} {}", alarm.time_s, alarm.axis, alarm.alarm)?;
    }
    Ok(())
}

fn recover_help(log: &std::path::Path) -> String {
    format!("`ccu recover {} -o FILE` makes a complete log of what is whole", log.display())
}

/// Seconds as the first column of `ccu frames` has them, exactly.
fn since(tick: Tick) -> String {
    format!("{}.{:07}", tick.0 / Tick::PER_SECOND, tick.0 % Tick::PER_SECOND * 5)
}

/// Seconds of machine time, to the nearest tick.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "checked: positive and finite, and the cast saturates"
)]
fn seconds(text: &str) -> Result<Tick, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds >= 0.0 => {
            Ok(Tick((seconds * Tick::PER_SECOND as f64).round() as u64))
        }
        _ => Err("it is a number of seconds since the set's tick 0, as in 12.5".to_owned()),
    }
}
