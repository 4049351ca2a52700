//! Recorded frames put on the bus again: each at its own distance from the first one, and not before the axes stand that
//! stood then. What the set does of its own accord is watched: an alarm that the record does not have ends it.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use supersigma_protocol::{
    Activity, Address, Alarm, Answer, AxisNumber, Broadcast, Command, Fault, Operation, Report, Tick,
};

use super::Executive;
use super::failure::Failure;
use super::link::{Heard, Link};
use super::request::Outcome;

/// From the request to the first frame.
const LEAD: Duration = Duration::from_millis(20);
/// Whoever waits for an axis to stand looks at least so often; its end is told unasked.
const LOOK: Duration = Duration::from_millis(20);

/// A frame of the record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Again {
    /// When it was sent.
    pub at: Tick,
    /// What was sent.
    pub what: Sent,
    /// Axes that stood then.
    pub stand: Vec<AxisNumber>,
}

/// What the CCU sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sent {
    /// A command; its start tick is shifted with the frame.
    Command(Broadcast),
    /// A fault on purpose.
    Fault(AxisNumber, Fault),
    /// Nothing: only the time has come, and the axes stand.
    Nothing,
}

/// Where the record's time lies in the set's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shift {
    /// A tick of the record.
    pub recorded: Tick,
    /// The same moment now.
    pub live: Tick,
}

impl Shift {
    /// A tick of the record in the set's time.
    #[must_use]
    pub fn live(self, recorded: Tick) -> Tick {
        let ahead = self.live + recorded.since(self.recorded);
        Tick(ahead.0.saturating_sub(self.recorded.since(recorded).0))
    }
}

impl<L: Link> Executive<L> {
    /// Puts the frames on the bus. If that ends early, everything that moves is stopped: halted, if whoever asked does not
    /// want it any more; braked, if something is wrong.
    pub(super) fn again(
        &mut self,
        frames: &[Again],
        shift: Option<Shift>,
        known: &[(AxisNumber, Alarm)],
    ) -> Result<Outcome, Failure> {
        let Some(first) = frames.first() else { return Ok(Outcome::Done) };
        let lead = self.link.ticks(LEAD);
        let begin = || Shift { recorded: first.at, live: self.link.now() + lead };
        let mut shift = shift.unwrap_or_else(begin);
        let result = frames.iter().try_for_each(|frame| self.one_again(frame, &mut shift, known));
        let stop = match &result {
            Ok(()) => return Ok(Outcome::Replayed { shift }),
            Err(Failure::Cancelled) => Operation::Halt,
            Err(_) => Operation::Brake,
        };
        self.link.send(Command::new(Address::EVERYONE, stop).into())?;
        result.map(|()| Outcome::Done)
    }

    fn one_again(
        &mut self,
        frame: &Again,
        shift: &mut Shift,
        known: &[(AxisNumber, Alarm)],
    ) -> Result<(), Failure> {
        let due = shift.live(frame.at);
        self.watch_until(due, known)?;
        let milliseconds = self.link.knowledge().config.executive.overdue_ms;
        let deadline = due + self.link.ticks(Duration::from_millis(milliseconds.into()));
        let mut waited = false;
        for axis in &frame.stand {
            while self.link.activity(*axis).is_some_and(|activity| activity != Activity::Standing) {
                if self.link.now() >= deadline {
                    return Err(Failure::NotAsRecorded { axis: *axis, milliseconds });
                }
                waited = true;
                let look = self.link.now() + self.link.ticks(LOOK);
                if let Some(heard) = self.listen(look.min(deadline))? {
                    surprise(heard, known)?;
                }
            }
        }
        if waited {
            // All that follows keeps its distance from this frame.
            *shift = Shift { recorded: frame.at, live: self.link.now() };
        }
        match &frame.what {
            Sent::Command(broadcast) => {
                let at = broadcast.at.map(|at| shift.live(at));
                self.link.send(Broadcast { bytes: broadcast.bytes.clone(), at }).map(|_| ())
            }
            Sent::Fault(axis, fault) => self.link.inject(*axis, *fault).map(|_| ()),
            Sent::Nothing => Ok(()),
        }
    }

    fn watch_until(&mut self, due: Tick, known: &[(AxisNumber, Alarm)]) -> Result<(), Failure> {
        while let Some(heard) = self.listen(due)? {
            surprise(heard, known)?;
        }
        Ok(())
    }
}

/// What is heard and ends a replay.
fn surprise(heard: Heard, known: &[(AxisNumber, Alarm)]) -> Result<(), Failure> {
    match heard {
        Heard::WorkerGone(card) => Err(Failure::WorkerGone { card }),
        Heard::Answer(Answer { card, report: Report::Axis(report), acted_at, .. }) => {
            match (AxisNumber::new(card.0), report.alarm) {
                (Some(axis), Some(alarm)) if !known.contains(&(axis, alarm)) => {
                    let (done, position) = (report.steps, report.position);
                    Err(Failure::Alarm { axis, alarm, done, position, at: Some(acted_at) })
                }
                _ => Ok(()),
            }
        }
        Heard::NoLog(trouble) => Err(Failure::NoLog((*trouble).clone())),
        Heard::FramesLost(card, lost) => Err(Failure::FramesLost { card, lost }),
        Heard::GoingDown => Err(Failure::GoingDown),
        Heard::Answer(_) | Heard::Resume => Ok(()),
    }
}
