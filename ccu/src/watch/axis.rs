//! One axis in the picture: what its card said last, and how speed and position went before.

use std::time::Duration;

use supersigma_config::AxisConfig;
use supersigma_protocol::{AxisReport, Pace, Position};

use super::history::{History, slot};
use super::snapshot::{AlarmView, AxisSnapshot, RailView};

/// An axis.
#[derive(Debug, Clone)]
pub(super) struct AxisPicture {
    config: AxisConfig,
    report: Option<AxisReport>,
    alive: bool,
    /// When it was last heard.
    heard: Duration,
    speed: History<f64>,
    position: History<Option<Position>>,
}

impl AxisPicture {
    pub(super) fn new(config: AxisConfig) -> Self {
        let (speed, position) = (History::new(0.0), History::new(None));
        Self { config, report: None, alive: false, heard: Duration::ZERO, speed, position }
    }

    pub(super) fn advance(&mut self, at: Duration, silent: Duration) {
        self.speed.advance(slot(at));
        self.position.advance(slot(at));
        if at.saturating_sub(self.heard) > silent {
            self.gone();
        }
    }

    /// Its card has said this.
    pub(super) fn hear(&mut self, at: Duration, report: AxisReport) {
        (self.report, self.alive, self.heard) = (Some(report), true, at);
        let speed = report.pace.map_or(0.0, Pace::steps_per_second);
        self.speed.put(speed, |before, now| now.abs() >= before.abs());
        self.position.put(report.position, |_, _| true);
    }

    /// Nobody plays its card any more.
    pub(super) fn gone(&mut self) {
        self.alive = false;
        self.speed.put(0.0, |_, _| false);
    }

    /// What the set knows of it, before it has been heard, or of its end.
    pub(super) fn describe(&mut self, at: Duration, report: Option<AxisReport>) {
        match report {
            Some(report) if !self.alive => self.hear(at, report),
            Some(_) => {}
            None => self.gone(),
        }
    }

    pub(super) fn snapshot(&self, history: usize) -> AxisSnapshot {
        let report = self.report.as_ref();
        AxisSnapshot {
            axis: self.config.address,
            name: self.config.name.clone(),
            alive: self.alive,
            activity: report.map(|report| report.activity),
            sense: report.map(|report| report.sense.to_string()),
            steps: report.map(|report| report.steps),
            position: report.and_then(|report| report.position),
            speed: if self.alive {
                report.and_then(|report| report.pace).map_or(0.0, Pace::steps_per_second)
            } else {
                0.0
            },
            lost: report.and_then(|report| report.lost),
            alarm: report.and_then(|report| report.alarm).map(AlarmView::from),
            rail: RailView::from(&self.config),
            speed_history: self.speed.last(history).collect(),
            position_history: self.position.last(history).collect(),
        }
    }
}
