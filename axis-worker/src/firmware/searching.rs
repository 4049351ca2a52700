//! How a search goes on: from stage to stage, to the origin or the reference step. What each stage is, `search` knows.

use supersigma_protocol::{Direction, Position, Refusal, Steps};

use super::movement::Movement;
use super::search::{Goal, MARGIN, Search, Stage};
use super::servo::Settling;
use super::{Firmware, State};
use crate::board::{Board, Sink};
use crate::ramp::Schedule;

impl Firmware {
    pub(super) fn search(
        &mut self,
        goal: Goal,
        board: &mut Board,
        sink: &mut impl Sink,
    ) -> Result<(), Refusal> {
        self.standing()?;
        let believed = self.base.take();
        self.steps = Steps(0);
        if let Some(servo) = &mut self.servo {
            servo.forget();
        }
        self.begin_stage(Search::new(goal, board.detectors(), believed), board, sink);
        Ok(())
    }

    pub(super) fn begin_stage(&mut self, search: Search, board: &mut Board, sink: &mut impl Sink) {
        (self.lead, self.before) = (None, self.steps);
        if let Some((direction, plan)) = self.bounds.plan(search.stage, search.of_stage, &self.table) {
            self.state =
                State::Searching(search, Movement::begin(Schedule::alone(plan, direction), board, sink));
        } else {
            self.alarm = Some(search.failure());
            self.base = None;
        }
    }

    /// The axis stands at its origin, and knows it.
    pub(super) fn at_origin(&mut self, search: Search, board: &mut Board, sink: &mut impl Sink) {
        self.state = State::Standing;
        self.base = Some(Position(0));
        self.lost = search.believed.map(|believed| Position(0).deviation_from(believed));
        if search.goal == Goal::Reference {
            self.begin_stage(Search { stage: Stage::LockIn, ..search }, board, sink);
        }
    }

    /// The last pulse of one stage of a search has come.
    pub(super) fn stage_over(
        &mut self,
        search: Search,
        direction: Direction,
        board: &mut Board,
        sink: &mut impl Sink,
    ) {
        let detectors = board.detectors();
        self.stand(board);
        let made = self.steps - self.before;
        let believed = search.believed.map(|believed| believed.moved(direction, made));
        let next = |stage| Search { stage, believed, of_stage: Steps(0), ..search };
        match search.stage {
            Stage::Overshoot if detectors.lower => {
                // The switch closed somewhere in this movement: `of_stage` was the count then.
                let beyond = made - search.of_stage;
                self.begin_stage(next(Stage::BackOff(beyond + MARGIN)), board, sink);
            }
            Stage::BackOff(_) if !detectors.lower => self.begin_stage(next(Stage::Return), board, sink),
            // It has backed off and still stands on the switch: the slow way finds the point all the same.
            Stage::BackOff(_) => self.begin_stage(next(Stage::Release), board, sink),
            Stage::Return if detectors.lower => self.begin_stage(next(Stage::Release), board, sink),
            Stage::Release if !detectors.lower => {
                let found = next(Stage::Release);
                if self.servo.is_some() {
                    self.state = State::Zeroing(found, Settling::new(Position(0), board.now()));
                } else {
                    self.at_origin(found, board, sink);
                }
            }
            Stage::LockIn if detectors.reference => {
                // Open loop while searching, closed when locking in.
                if let (Some(_), Some(target)) = (&self.servo, self.base) {
                    self.state = State::Settling(Settling::new(target, board.now()));
                }
            }
            unfinished => {
                let of_stage = search.of_stage + made;
                self.begin_stage(Search { of_stage, ..next(unfinished) }, board, sink);
            }
        }
    }
}
