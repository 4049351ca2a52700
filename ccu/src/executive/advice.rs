//! What to do next: one answer for each failure, refusal and alarm. The book's chapter on alarms and refusals is made of
//! these texts, and a test holds it to them.

use supersigma_protocol::{Alarm, Position, Refusal};

use super::failure::Failure;
use super::halted::can_go_on_after;

/// What becomes of the position when an alarm has stopped an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// It is known as before: the pulses of the brake are counted too. Only a search that was stopped leaves none.
    Kept,
    /// The search has found nothing to count from.
    Lost,
    /// The card's process ends.
    Gone,
}

/// What becomes of the position under this alarm.
#[must_use]
pub fn place(alarm: &Alarm) -> Place {
    match alarm {
        Alarm::Braked
        | Alarm::EndOfRail(_)
        | Alarm::ExcessiveForce
        | Alarm::FramesLost(_)
        | Alarm::FollowingError(_) => Place::Kept,
        Alarm::SwitchNeverClosed(_) | Alarm::SwitchNeverOpened(_) | Alarm::ReferenceNotFound(_) => {
            Place::Lost
        }
        Alarm::CcuLost => Place::Gone,
    }
}

/// What to do about an alarm, before anything about the position.
#[must_use]
pub fn alarm(alarm: &Alarm) -> &'static str {
    match alarm {
        Alarm::Braked => "find out why it was braked, then `ccu clear`",
        Alarm::EndOfRail(_) => "see what drove it there, then `ccu clear`, and move it away from that end",
        Alarm::ExcessiveForce => "take away what the axis pushes against, then `ccu clear`",
        Alarm::SwitchNeverClosed(_) | Alarm::SwitchNeverOpened(_) => {
            "look at the limit switch and its cable, and whether the carriage moves; then `ccu clear`"
        }
        Alarm::ReferenceNotFound(_) => {
            "look at the reference detector, and at `rail.reference` in the configuration; then `ccu clear`"
        }
        Alarm::CcuLost => "take the set up again: `ccu up`",
        Alarm::FramesLost(_) => "the machine may be too busy; then `ccu clear`",
        Alarm::FollowingError(_) => "look for what holds the axis, then `ccu clear`",
    }
}

/// What to do about a refusal. Nothing has changed on the card that refused.
#[must_use]
pub fn refusal(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::TooShort { .. } | Refusal::WrongLength { .. } => {
            "see how many bytes the command has in the protocol reference, or use the commands of `ccu`"
        }
        Refusal::UnknownAddress { .. } => "address 0 to 9",
        Refusal::UnknownOpCode { .. } => "see the table of op-codes in the protocol reference",
        Refusal::DirectionNotAllowed { .. } => "clear bit 7 of the second byte",
        Refusal::WrongCard { .. } => {
            "send it to a card that can do this: motors are 1 to 7, inputs 8, outputs 9"
        }
        Refusal::ZeroSteps => "ask for 1 step or more, or leave the movement out",
        Refusal::SpeedOutOfRange { .. } => "`ccu profile` prints the entries of the ramp table",
        Refusal::Moving => "wait until it stands (X4), or halt it first: `ccu halt`",
        Refusal::NotOriginated => "originate the axis first: `ccu origin`",
        Refusal::InAlarm => "look at the axis, then acknowledge the alarm: `ccu clear`",
        Refusal::OutOfTravel { .. } => "the permitted travel is in the configuration: `ccu config show`",
        Refusal::NoLead => "send Lead with the steps of the leading axis first, or use `ccu line`",
        Refusal::LongerThanLead { .. } => {
            "make the axis with the most steps the leading one, or use `ccu line`"
        }
        Refusal::NotArmed => "send Lead and ArmLine first, or use `ccu line`",
        Refusal::Late { .. } => "raise `line.lead_ms` in the configuration",
        Refusal::NoStartTick => "use `ccu line`, which names the start tick",
        Refusal::AtEnd { .. } => "move away from that end",
        Refusal::PathFull => "make the path in parts, or halt the axis to begin anew: `ccu halt`",
        Refusal::PathTooLong { .. } => "make the path in parts",
    }
}

/// What to do about a failure.
#[must_use]
pub fn failure(failure: &Failure) -> String {
    match failure {
        Failure::Refused { refusal: reason, .. } | Failure::DigitalRefused { refusal: reason, .. } => {
            refusal(reason).into()
        }
        Failure::Alarm { alarm: cause, position, .. } => {
            let rest = match position {
                Some(_) if can_go_on_after(*cause) => ", and `ccu resume` makes the remaining steps",
                _ => "",
            };
            format!("{}; {}{rest}", alarm(cause), whereabouts(*position))
        }
        Failure::Stopped { position: Some(_), .. } => "`ccu resume` makes the remaining steps".into(),
        Failure::Stopped { position: None, .. } => "originate it, its position is lost".into(),
        Failure::NoAnswer { .. } => {
            "see `ccu status`; if the card's process hangs, take the set down and up again".into()
        }
        Failure::Overdue { .. } => {
            "the machine may be too busy; raise `executive.overdue_ms`, or lower the time scale".into()
        }
        Failure::GaveUp { .. } => "look at the axis; nothing moves it until it is cleared (`ccu clear`) and \
                                   originated (`ccu origin`)"
            .into(),
        Failure::NotAsRecorded { .. } => {
            "the set does not do what the recorded one did; compare the two logs with `ccu frames`".into()
        }
        Failure::NotConfirmed { .. } => "raise `line.lead_ms`".into(),
        Failure::WorkerGone { .. } => {
            "`ccu ps` shows when it is back; then its axis has to be originated".into()
        }
        Failure::NoLog(trouble) => trouble.advice.clone(),
        Failure::FramesLost { .. } => {
            "see with `ccu status` what the axes do, and ask again; the machine may be too busy".into()
        }
        Failure::Cancelled => {
            "`ccu status` shows where the axes stand; `ccu resume` makes the remaining steps".into()
        }
        Failure::GoingDown => "wait until it is down, then start it again: `ccu up`".into(),
        Failure::NoSuchAxis { .. } => "`ccu status` lists the axes of the set".into(),
        Failure::TooFar { .. } => "make it in parts".into(),
        Failure::EmptyLine => "give at least one axis steps other than 0".into(),
        Failure::DifferentRamps { .. } => "give them the same ramp in the configuration".into(),
        Failure::Several { .. } => "look at each of these axes: `ccu status`".into(),
        Failure::NotAMovement => "begin a movement or a search".into(),
        Failure::NoSuchMovement { .. } => "wait for a movement once, on the connection that began it".into(),
        Failure::NothingToResume => "`ccu status` shows where the axes stand; move them from there".into(),
        Failure::MovedMeanwhile { .. } => "`ccu status` shows where it stands; move it from there".into(),
        Failure::SpeedOutOfRange { slowest, fastest, .. } => {
            format!("give a speed from {slowest:.1} to {fastest:.1}; `ccu profile` prints them all")
        }
        Failure::BusGone { .. } => "take the set down and up again; is there room in /dev/shm?".into(),
        Failure::Pulses { .. } => "look at the free space where the pulses go".into(),
        Failure::NoSet { name } => format!("start one with `ccu up --name {name}`"),
        Failure::Control { .. } => "take the set down with the version that started it".into(),
    }
}

fn whereabouts(position: Option<Position>) -> &'static str {
    if position.is_some() {
        "its position is kept"
    } else {
        "originate it (`ccu origin`), its position is lost"
    }
}

#[cfg(test)]
#[path = "advice_tests.rs"]
mod tests;
