//! What a dry run took: the totals of its axes as a table or as JSON, and the picture of its movements.

use std::io::{self, Write};
use std::path::Path;

use supersigma_config::Config;

use super::exit::Exit;
use super::{plot, show};
use crate::log::AxisNames;
use crate::plot::{Format, Subject, Timing, gantt};

/// Whether `path` can be the name of a picture: better said before the program runs.
pub(super) fn check_name(path: &Path) -> Result<(), Exit> {
    Format::of(path).map(drop).map_err(|error| plot::exit(&error))
}

/// Prints the totals of every axis that moved or refused to, and what was refused.
pub(super) fn tell(timing: &Timing, config: &Config, json: bool) -> Result<(), Exit> {
    let summaries = timing.summaries(&AxisNames::from(config));
    let mut out = io::stdout().lock();
    if json {
        let refused: Vec<_> = timing
            .out_of_travel
            .iter()
            .map(|(tick, axis, refusal)| {
                serde_json::json!({
                    "axis": axis.get(),
                    "name": config.axis(*axis).map_or("", |axis| axis.name.as_str()),
                    "seconds": tick.since(supersigma_protocol::Tick(0)).as_seconds(),
                    "message": refusal.to_string(),
                })
            })
            .collect();
        let timing = serde_json::json!({ "axes": summaries, "out_of_travel": refused });
        return Ok(show::print_json(&serde_json::json!({ "timing": timing }), &mut out)?);
    }
    let busy: Vec<_> = summaries.iter().filter(|axis| axis.movements + axis.out_of_travel > 0).collect();
    if busy.is_empty() {
        return Ok(());
    }
    writeln!(
        out,
        "\n{:<12} {:>9} {:>9} {:>12} {:>9} {:>14}",
        "axis", "movements", "steps", "peak steps/s", "moving s", "longest wait s"
    )?;
    for axis in busy {
        writeln!(
            out,
            "{:<12} {:>9} {:>9} {:>12.1} {:>9.3} {:>14.3}",
            axis.name,
            axis.movements,
            axis.steps,
            axis.peak_speed,
            axis.moving_seconds,
            axis.longest_wait_seconds
        )?;
    }
    for (tick, axis, refusal) in &timing.out_of_travel {
        let name = config.axis(*axis).map_or("?", |axis| axis.name.as_str());
        let at = tick.since(supersigma_protocol::Tick(0)).as_seconds();
        writeln!(out, "{name} refused at {at:.3} s: {refusal}")?;
    }
    Ok(())
}

/// Draws the movements and the digital lines into a file.
pub(super) fn draw(timing: &Timing, config: &Config, program: &str, path: &Path) -> Result<(), Exit> {
    let names = AxisNames::from(config);
    let title = format!("Dry run of {}", program.rsplit('/').next().unwrap_or(program));
    let subject = Subject { title: &title, subtitle: &timing.totals(), names: &names, config };
    gantt(timing, &subject).and_then(|picture| picture.save(path)).map_err(|error| plot::exit(&error))
}
