//! Closed loop, from the firmware's side: does the shaft follow, has it arrived, and what makes good what it has lost.
//! What the encoder says, `servo` knows.

use supersigma_protocol::{Alarm, SpeedIndex};

use super::movement::Movement;
use super::servo::{Settling, Verdict};
use super::{Firmware, State};
use crate::board::{Board, Sink};
use crate::ramp::{Plan, Schedule};

impl Firmware {
    /// The last pulse of a movement has come. Open loop: it is over. Closed loop: the shaft has to get there.
    pub(super) fn pulses_out(&mut self, board: &mut Board) {
        if self.base.is_none() || self.servo.is_none() {
            return self.stand(board);
        }
        if let State::Moving(movement) = &self.state
            && let Some(base) = self.base
        {
            let target = movement.position(base, board);
            self.state = State::Settling(Settling::new(target, board.now()));
        }
    }

    /// Closed loop: looks whether the shaft follows.
    pub(super) fn follow(&mut self, board: &mut Board, sink: &mut impl Sink) {
        if let (Some(servo), State::Moving(movement), Some(base)) = (&mut self.servo, &self.state, self.base)
        {
            let commanded = movement.position(base, board);
            if let Some(error) = servo.error(commanded, board)
                && self.alarm.is_none()
            {
                self.emergency(Alarm::FollowingError(error), board, sink);
            }
        }
    }

    /// Closed loop: looks whether the shaft has come to rest, and makes good what it has lost.
    pub(super) fn settle(&mut self, board: &mut Board, sink: &mut impl Sink) {
        let (State::Settling(settling), Some(servo)) = (&mut self.state, &mut self.servo) else { return };
        match settling.look(servo, board) {
            Verdict::Wait => {}
            // After an emergency the axis stays where it is.
            Verdict::Correct(..) | Verdict::Off(_) if self.alarm.is_some() => self.stand(board),
            Verdict::There => self.stand(board),
            Verdict::Off(by) => {
                self.alarm.get_or_insert(Alarm::FollowingError(by));
                self.stand(board);
            }
            Verdict::Correct(direction, distance) => {
                let plan = Plan::constant(&self.table, distance, SpeedIndex::START);
                // The pulses now begin where the shaft is.
                self.base = servo.measured(board).map(|(_, position)| position);
                self.state = State::Moving(Movement::begin(Schedule::alone(plan, direction), board, sink));
            }
        }
    }
}
