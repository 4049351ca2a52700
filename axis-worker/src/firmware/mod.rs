//! The 8748's program: it takes commands, runs the motor over the board, and knows what the axis is doing. A state
//! machine without clock and I/O: it is told when time has passed and when a detector has changed.
//!
//! ```text
//!                 Move MoveLimited Slew                 last pulse
//!      ┌────────────────────────────────►  Moving  ─────────────────┐
//!      │                              ▲   ▲                         │
//!      │                   start tick │   │ Halt Brake              ▼
//!   Standing ──► Armed ──► (Go) ──────┘   │            ┌───► Standing (+ alarm)
//!      │   Lead, ArmLine                  │            │
//!      └──────────────────────────► Searching ─────────┘
//!           Originate SeekReference      found, or not within its bound
//! ```
//!
//! In closed loop the shaft comes to rest (Settling, Zeroing) between the last pulse and Standing.
//!
//! An alarm is no state of its own: it accompanies the state, forbids new movements, and stays until `Clear`.

mod arming;
mod following;
mod movement;
mod search;
mod searching;
mod servo;

use supersigma_config::{AxisConfig, RampConfig, RampError, TravelConfig};
use supersigma_protocol::{
    Activity, Alarm, AxisReport, Deviation, Direction, End, Fault, Operation, Position, Refusal, SensePoint,
    SpeedIndex, StatusWord, Steps, Tick, Ticks,
};

use self::arming::{Armed, Lead};
use self::movement::Movement;
use self::search::{Bounds, Found, Goal, Search, Stage};
use self::servo::{Servo, Settling};
use crate::board::{Board, Sink};
use crate::ramp::{Plan, Schedule, Stop, Table};

/// The program and its few variables.
#[derive(Debug)]
pub struct Firmware {
    table: Table,
    travel: TravelConfig,
    bounds: Bounds,
    state: State,
    alarm: Option<Alarm>,
    /// Where the movement began, or where the axis stands.
    base: Option<Position>,
    /// Steps of the last movement.
    steps: Steps,
    /// Steps of the stages before this one, while the axis searches, and while a search that was stopped comes to a stand.
    before: Steps,
    /// What the last origination found.
    lost: Option<Deviation>,
    /// Closed loop, if the axis is in it.
    servo: Option<Servo>,
    lead: Option<Lead>,
    /// Commanded for a tick to come.
    halt_at: Option<Tick>,
    brake_at: Option<Tick>,
}

/// What the axis is doing; each state holds what only it needs.
#[derive(Debug)]
enum State {
    Standing,
    Armed(Armed),
    Moving(Movement),
    /// Closed loop: the pulses are out, the shaft comes to rest.
    Settling(Settling),
    /// Closed loop: the origin is found, and the encoder's zero will be where the shaft comes to rest.
    Zeroing(Search, Settling),
    Searching(Search, Movement),
}

impl Firmware {
    /// The program of an axis at switch-on: standing somewhere.
    ///
    /// # Errors
    /// If `ramp` does not give a table.
    pub fn new(axis: &AxisConfig, ramp: &RampConfig) -> Result<Self, RampError> {
        Ok(Self {
            table: Table::new(ramp)?,
            travel: axis.travel.clone(),
            bounds: Bounds::new(axis),
            state: State::Standing,
            alarm: None,
            base: None,
            steps: Steps(0),
            before: Steps(0),
            lost: None,
            servo: Servo::new(axis),
            lead: None,
            halt_at: None,
            brake_at: None,
        })
    }

    /// Carries out `operation`, now; `at` is the tick that the frame names, and `alone` whether it is for this card only.
    ///
    /// # Errors
    /// Why it is not carried out; then nothing has changed.
    pub fn deliver(
        &mut self,
        operation: Operation,
        at: Option<Tick>,
        alone: bool,
        board: &mut Board,
        sink: &mut impl Sink,
    ) -> Result<(), Refusal> {
        match operation {
            Operation::Status => Ok(()),
            Operation::Move { direction, distance } => {
                self.ready_for(direction, distance, board)?;
                let plan = Plan::ramped(&self.table, distance, SpeedIndex::TOP);
                self.begin(Schedule::alone(plan, direction), board, sink);
                Ok(())
            }
            Operation::MoveLimited { direction, distance, limit } => {
                self.ready_for(direction, distance, board)?;
                let plan = Plan::ramped(&self.table, distance, limit);
                self.begin(Schedule::alone(plan, direction), board, sink);
                Ok(())
            }
            Operation::Slew { direction, distance, speed } => {
                self.ready_for(direction, distance, board)?;
                let plan = Plan::constant(&self.table, distance, speed);
                self.begin(Schedule::alone(plan, direction), board, sink);
                Ok(())
            }
            Operation::Originate => self.search(Goal::Origin, board, sink),
            Operation::SeekReference => self.search(Goal::Reference, board, sink),
            Operation::Halt => {
                self.stop_at(Stop::Halt, at, board, sink);
                Ok(())
            }
            Operation::Brake => {
                self.stop_at(Stop::Brake, at, board, sink);
                Ok(())
            }
            Operation::Lead { distance, limit } => {
                self.armable()?;
                self.lead = Some(Lead { distance, limit: limit.unwrap_or(SpeedIndex::TOP) });
                Ok(())
            }
            Operation::ArmLine { direction, distance } => self.arm(Some((direction, distance)), board),
            Operation::Rest => self.arm(None, board),
            Operation::Join { limit } => self.join(limit),
            Operation::Go => self.go(at, alone, board),
            Operation::Clear => match self.state {
                State::Standing => {
                    self.alarm = None;
                    Ok(())
                }
                _ => Err(Refusal::Moving),
            },
            // The decoder lets no digital operation pass for a motor card.
            Operation::ReadInputs | Operation::WriteOutputs { .. } => {
                Err(Refusal::UnknownOpCode { op_code: operation.code() })
            }
        }
    }

    /// When the program has something to do by itself.
    #[must_use]
    pub fn wake_at(&self) -> Option<Tick> {
        let own = match &self.state {
            State::Standing => None,
            State::Armed(armed) => armed.start,
            State::Moving(movement) | State::Searching(_, movement) => Some(movement.wake_at()),
            State::Settling(settling) | State::Zeroing(_, settling) => Some(settling.look_at()),
        };
        // Where a search was stopped, nothing is known that the shaft could be compared with.
        let followed = matches!(self.state, State::Moving(_)) && self.base.is_some();
        let follow = self.servo.as_ref().filter(|_| followed).map(Servo::look_at);
        [own, follow, self.halt_at, self.brake_at].into_iter().flatten().min()
    }

    /// The next tick at which the card may have something to say by itself; it may turn out that it has not.
    #[must_use]
    pub fn next_news(&self, board: &Board) -> Option<Tick> {
        match &self.state {
            State::Moving(movement) | State::Searching(_, movement) => {
                [Some(movement.next_news(board)), self.halt_at, self.brake_at].into_iter().flatten().min()
            }
            _ => self.wake_at(),
        }
    }

    /// Makes at once what it will write to the chip before anything else happens, up to and including `to`. Not with a
    /// rotor: what that makes of a pulse is seen only afterwards.
    pub(crate) fn leap(&mut self, to: Tick, board: &mut Board) {
        let after = to + Ticks(1);
        let (State::Moving(movement) | State::Searching(_, movement)) = &self.state else { return };
        if !movement.writes_before(after) {
            return;
        }
        let news = self.next_news(board).unwrap_or(to).min(after);
        if let State::Moving(movement) | State::Searching(_, movement) = &mut self.state {
            movement.leap(news, board);
        }
    }

    /// Does what is due at the board's tick.
    pub fn wake(&mut self, board: &mut Board, sink: &mut impl Sink) {
        let due = |at: &mut Tick| *at <= board.now();
        let (halt, brake) = (self.halt_at.take_if(due), self.brake_at.take_if(due));
        if brake.is_some() {
            self.stop_now(Stop::Brake, board, sink);
        } else if halt.is_some() {
            self.stop_now(Stop::Halt, board, sink);
        }
        match &mut self.state {
            State::Standing => {}
            State::Armed(armed) => {
                if armed.start.is_some_and(|start| start <= board.now()) {
                    let schedule = armed.schedule(&self.table);
                    self.begin(schedule, board, sink);
                }
            }
            State::Moving(movement) => {
                if movement.wake(board, sink) {
                    self.pulses_out(board);
                } else {
                    self.follow(board, sink);
                }
            }
            State::Settling(_) => self.settle(board, sink),
            State::Zeroing(search, settling) => {
                if settling.is_over(board) {
                    let search = *search;
                    if let Some(servo) = &mut self.servo {
                        servo.set_zero(board);
                    }
                    self.at_origin(search, board, sink);
                }
            }
            State::Searching(search, movement) => {
                let direction = movement.direction(board);
                if movement.wake(board, sink) {
                    let search = *search;
                    self.stage_over(search, direction, board, sink);
                }
            }
        }
    }

    /// Takes note that a detector has changed at the board's tick.
    pub fn sense(&mut self, board: &mut Board, sink: &mut impl Sink) {
        let detectors = board.detectors();
        match &mut self.state {
            State::Moving(movement) => {
                let ahead = ahead(movement.direction(board));
                if detectors.zone() == Some(ahead) && self.alarm.is_none() {
                    self.alarm = Some(Alarm::EndOfRail(ahead));
                    movement.stop(&self.table, Stop::Brake, board, sink);
                }
            }
            State::Searching(search, movement) => match search.judge(detectors) {
                Found::Nothing => {}
                Found::Switch => {
                    search.stage = Stage::Overshoot;
                    search.of_stage = movement.steps(board);
                    movement.stop(&self.table, Stop::Halt, board, sink);
                }
                Found::Goal => movement.cut(board),
            },
            State::Standing | State::Armed(_) | State::Settling(_) | State::Zeroing(..) => {}
        }
    }

    /// Makes a fault on purpose.
    pub fn fail(&mut self, fault: Fault, board: &mut Board, sink: &mut impl Sink) {
        let now = board.now();
        match fault {
            Fault::Force => self.emergency(Alarm::ExcessiveForce, board, sink),
            Fault::Limit(end) => self.emergency(Alarm::EndOfRail(end), board, sink),
            Fault::LostSteps(steps) => board.mechanism_mut().lose(steps),
            Fault::Switch(switch) => {
                board.mechanism_mut().set_switch(switch, now);
                self.sense(board, sink);
            }
        }
    }

    /// Brakes because of something that is no command, and holds the axis.
    pub fn emergency(&mut self, alarm: Alarm, board: &mut Board, sink: &mut impl Sink) {
        self.alarm.get_or_insert(alarm);
        self.stop_now(Stop::Brake, board, sink);
    }

    /// The state that the card reports.
    #[must_use]
    pub fn report(&self, board: &mut Board) -> AxisReport {
        let (steps, position, pace) = match &self.state {
            State::Standing | State::Armed(_) | State::Settling(_) | State::Zeroing(..) => {
                (self.steps, self.base, None)
            }
            State::Moving(movement) | State::Searching(_, movement) => {
                let position = self.base.map(|base| movement.position(base, board));
                (self.before + movement.steps(board), position, movement.pace(board))
            }
        };
        let (steps, position) = match (&self.servo, &self.state) {
            (Some(servo), State::Moving(_) | State::Settling(_)) => servo
                .measured(board)
                .map_or((steps, position), |(steps, position)| (self.before + steps, Some(position))),
            (Some(servo), State::Standing) => {
                (steps, servo.measured(board).map_or(position, |(_, position)| Some(position)))
            }
            _ => (steps, position),
        };
        AxisReport {
            sense: self.sense_word(board),
            steps,
            position,
            activity: self.activity(),
            alarm: self.alarm,
            lost: self.lost,
            pace,
        }
    }

    /// X1..X5. Open loop: X4 says that no pulse train is being made, and X5 is never claimed, for nothing measures speed.
    /// Closed loop: a movement is over when the target has been reached, and X5 says that the shaft is slower than S1.
    #[must_use]
    pub fn sense_word(&self, board: &Board) -> StatusWord {
        let detectors = board.detectors();
        StatusWord::default()
            .with(SensePoint::X1, detectors.lower)
            .with(SensePoint::X2, detectors.upper)
            .with(SensePoint::X3, detectors.reference)
            .with(SensePoint::X4, matches!(self.state, State::Standing | State::Armed(_)))
            .with(SensePoint::X5, self.servo.is_some() && detectors.slow)
    }

    /// What the axis is doing.
    #[must_use]
    pub fn activity(&self) -> Activity {
        match &self.state {
            State::Standing => Activity::Standing,
            State::Armed(_) => Activity::Armed,
            State::Settling(_) => Activity::Settling,
            State::Moving(movement) => movement.phase().map_or(Activity::Standing, Activity::from),
            State::Searching(search, _) | State::Zeroing(search, _) => search.activity(),
        }
    }

    /// What holds the axis.
    #[must_use]
    pub fn alarm(&self) -> Option<Alarm> {
        self.alarm
    }

    /// The axis' ramp.
    #[must_use]
    pub fn table(&self) -> &Table {
        &self.table
    }

    fn begin(&mut self, schedule: Schedule, board: &mut Board, sink: &mut impl Sink) {
        (self.lead, self.before) = (None, Steps(0));
        if let Some(servo) = &mut self.servo {
            servo.begin(self.base, board);
        }
        self.state = State::Moving(Movement::begin(schedule, board, sink));
    }

    /// The last pulse of a movement has come.
    fn stand(&mut self, board: &mut Board) {
        let report = self.report(board);
        (self.steps, self.base) = (report.steps, report.position);
        self.halt_at = None;
        self.state = State::Standing;
    }

    fn stop_at(&mut self, stop: Stop, at: Option<Tick>, board: &mut Board, sink: &mut impl Sink) {
        let pending = match stop {
            Stop::Halt => &mut self.halt_at,
            Stop::Brake => &mut self.brake_at,
        };
        match at {
            Some(at) if at > board.now() && !matches!(self.state, State::Standing) => {
                *pending = Some(pending.map_or(at, |sooner| sooner.min(at)));
            }
            _ => self.stop_now(stop, board, sink),
        }
    }

    fn stop_now(&mut self, stop: Stop, board: &mut Board, sink: &mut impl Sink) {
        self.lead = None;
        if stop == Stop::Brake {
            self.alarm.get_or_insert(Alarm::Braked);
        }
        self.state = match std::mem::replace(&mut self.state, State::Standing) {
            // A search that is stopped is over: it never goes on by itself, and the position stays unknown.
            State::Standing | State::Armed(_) | State::Zeroing(..) => State::Standing,
            // The pulses are out already; the shaft comes to rest in any case.
            State::Settling(settling) => State::Settling(settling),
            State::Moving(mut movement) | State::Searching(_, mut movement) => {
                movement.stop(&self.table, stop, board, sink);
                State::Moving(movement)
            }
        };
    }
}

/// The end of the rail towards which a movement goes.
fn ahead(direction: Direction) -> End {
    match direction {
        Direction::Forward => End::Upper,
        Direction::TowardsOrigin => End::Lower,
    }
}
