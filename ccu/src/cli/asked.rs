//! A set that is up, as the commands see it: connected, described, its axes known by name.

use std::io::{self, BufWriter, Write};
use std::sync::Arc;

use miette::miette;
use supersigma_config::{Config, choose};
use supersigma_protocol::{Address, AxisNumber};

use super::exit::Exit;
use super::{SetArgs, show};
use crate::control::{Client, Description};
use crate::executive::{AxisState, Failure, Knowledge, Operate, Outcome, Request};
use crate::home::Home;

/// No such thing in this set; perhaps another one was meant.
pub(super) fn unknown<'a>(
    what: &'static str,
    name: &str,
    known: impl Iterator<Item = &'a str> + Clone,
) -> Exit {
    let plural = if what == "axis" { "axes".to_owned() } else { format!("{what}s") };
    let help = choose(name, known, &format!("its {plural} are"));
    Exit::wrong(miette!(help = help, "this set has no {what} {name:?}"))
}

/// A set that is up, and what it is.
pub(super) struct Asked {
    pub(super) client: Client,
    pub(super) description: Description,
    pub(super) config: Config,
    pub(super) knowledge: Arc<Knowledge>,
}

impl Asked {
    pub(super) fn connect(set: &SetArgs) -> Result<Self, Exit> {
        let home = Home::of(set.name.clone()).map_err(|error| Exit::with_code(3, error))?;
        let mut client = Client::connect(&home)?;
        let description = client.describe()?;
        let config = Config::from_toml(&description.config, "the set's configuration")
            .map_err(|error| Failure::Control { reason: error.to_string() })?;
        let knowledge =
            Knowledge::new(config.clone()).map_err(|error| Failure::Control { reason: error.to_string() })?;
        Ok(Self { client, description, config, knowledge })
    }

    pub(super) fn axis(&self, name: &str) -> Result<AxisNumber, Exit> {
        match self.config.find_axis(name) {
            Some(axis) => Ok(axis.address),
            None => Err(unknown("axis", name, self.config.axes.iter().map(|axis| axis.name.as_str()))),
        }
    }

    /// None named, or `all`: an empty list, which means all.
    pub(super) fn axes(&self, names: &[String]) -> Result<Vec<AxisNumber>, Exit> {
        if names.iter().any(|name| name == "all") {
            return Ok(vec![]);
        }
        names.iter().map(|name| self.axis(name)).collect()
    }

    /// Carries out a request; what comes of a failure is told with the names of this set.
    pub(super) fn operate(&mut self, request: Request) -> Result<Outcome, Exit> {
        self.client.operate(request).map_err(|failure| Exit::told(failure, &self.knowledge))
    }

    pub(super) fn axis_states(&mut self, request: Request) -> Result<Vec<AxisState>, Exit> {
        match self.operate(request)? {
            Outcome::Axes(states) => Ok(states),
            _ => Ok(vec![]),
        }
    }

    pub(super) fn word(&mut self, card: Address) -> Result<u16, Exit> {
        match self.operate(Request::Digital { card })? {
            Outcome::Digital(word) => Ok(word),
            other => Err(Failure::Control { reason: format!("{other:?} is no digital word") }.into()),
        }
    }

    /// Carries out something that moves axes, and prints a line a movement.
    pub(super) fn moved(&mut self, request: Request, json: bool) -> Result<(), Exit> {
        let outcome = self.operate(request)?;
        self.tell_outcome(&outcome, json)
    }

    /// Prints a line a movement.
    pub(super) fn tell_outcome(&self, outcome: &Outcome, json: bool) -> Result<(), Exit> {
        let knowledge = &self.knowledge;
        let mut out = BufWriter::new(io::stdout().lock());
        match outcome {
            Outcome::Moved(movements) => {
                if !json && movements.is_empty() {
                    writeln!(out, "nothing to move")?;
                } else if !json {
                    writeln!(out, "{}", show::movement_title())?;
                }
                for movement in movements {
                    if json {
                        show::print_json(&show::MovementView::new(movement, knowledge), &mut out)?;
                    } else {
                        writeln!(out, "{}", show::movement_line(movement, knowledge))?;
                    }
                }
            }
            _ if json => {}
            _ => writeln!(out, "started")?,
        }
        Ok(out.flush()?)
    }

    /// What the set is by now.
    pub(super) fn client_description(&mut self) -> Result<Description, Exit> {
        self.description = self.client.describe()?;
        Ok(self.description.clone())
    }
}
