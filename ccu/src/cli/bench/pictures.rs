//! Pictures of a run: what is wanted of them, and the files that they go to.

use std::path::{Path, PathBuf};

use axis_worker::bench::{Clocks, Train};
use clap::{ArgGroup, Args};
use miette::miette;

use crate::bench::filter::{Cutoff, Taps};
use crate::bench::{Recording, Report, Run};
use crate::cli::exit::Exit;
use crate::cli::plot;
use crate::plot::Format;
use crate::plot::bench::{BenchPlotError, Filters, Graph, Plotted};

/// A picture holds the whole run in memory, up to 60 000 samples a second: 100 s are some 500 megabytes.
const LONGEST: Clocks = Clocks(100_000_000);

/// The pictures that filters are for.
const OF_SPEED: &str = "pictures of speed";

/// Pictures of the run; each is .svg or .png, and replaces a file that is there already.
#[derive(Args)]
#[command(next_help_heading = "Pictures", group = ArgGroup::new(OF_SPEED).multiple(true))]
pub(super) struct PictureArgs {
    /// The shaft's angle over time, with the commanded one, .svg or .png
    #[arg(long, value_name = "FILE", value_parser = picture_file)]
    plot_position: Option<PathBuf>,
    /// Its speed over time, as it is and filtered
    #[arg(long, value_name = "FILE", group = OF_SPEED, value_parser = picture_file)]
    plot_speed: Option<PathBuf>,
    /// The prescribed speed, the real one, and the lag
    #[arg(long, value_name = "FILE", group = OF_SPEED, value_parser = picture_file)]
    plot_profile: Option<PathBuf>,
    /// Where the low pass takes half of the power, 1 to 1000 [default: 400 for the speed, 50 for the profile]
    #[arg(long, value_name = "HZ", requires = OF_SPEED, value_parser = cutoff)]
    cutoff: Option<Cutoff>,
    /// The length of the derivative filter, odd, 11 to 301 [default: a millisecond of samples]
    #[arg(long, value_name = "N", requires = OF_SPEED, value_parser = taps)]
    taps: Option<Taps>,
}

impl PictureArgs {
    /// What a recording is made in, if there is to be one.
    ///
    /// # Errors
    /// If the train is too long for a picture.
    pub(super) fn recording(&self, train: &Train) -> Result<Option<Recording>, Exit> {
        if self.wanted().next().is_none() {
            return Ok(None);
        }
        let (duration, longest) = (train.duration(), LONGEST.ticks().as_seconds());
        if duration > LONGEST {
            return Err(Exit::wrong(miette!(
                help = "make the train shorter, or leave the pictures out: --out has no such limit",
                "the train takes {:.1} s: a picture can have {longest:.0} s at most",
                duration.ticks().as_seconds()
            )));
        }
        Ok(Some(Recording::default()))
    }

    /// Draws all that is wanted.
    ///
    /// # Errors
    /// If a picture cannot be drawn or written.
    pub(super) fn save(&self, run: &Run<'_>, report: &Report, recording: &Recording) -> Result<(), Exit> {
        let plotted = Plotted::new(run, report, recording);
        let filters = Filters { cutoff: self.cutoff, taps: self.taps };
        for (graph, path) in self.wanted() {
            let picture = plotted.picture(graph, filters).map_err(|error| match error {
                BenchPlotError::Plot(error) => plot::exit(&error),
                error @ (BenchPlotError::Sampling(_) | BenchPlotError::Filter(_)) => {
                    Exit::wrong(miette!("{error}"))
                }
            })?;
            picture.save(path).map_err(|error| plot::exit(&error))?;
        }
        Ok(())
    }

    fn wanted(&self) -> impl Iterator<Item = (Graph, &Path)> {
        let all = [
            (Graph::Position, &self.plot_position),
            (Graph::Speed, &self.plot_speed),
            (Graph::Profile, &self.plot_profile),
        ];
        all.into_iter().filter_map(|(graph, path)| Some((graph, path.as_deref()?)))
    }
}

fn picture_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    Format::of(&path).map_err(|error| error.to_string())?;
    Ok(path)
}

fn cutoff(text: &str) -> Result<Cutoff, String> {
    let hertz = text.parse().map_err(|_| "a cutoff is a number of hertz".to_owned())?;
    Cutoff::new(hertz).map_err(|error| error.to_string())
}

fn taps(text: &str) -> Result<Taps, String> {
    let taps = text.parse().map_err(|_| "the taps are a whole number".to_owned())?;
    Taps::new(taps).map_err(|error| error.to_string())
}
