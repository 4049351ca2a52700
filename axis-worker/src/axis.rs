//! One axis: firmware, 8253 and mechanism as one deterministic machine. Commands come in at a tick, answers and pulses go
//! out at a tick. It reads no clock, waits for nobody and knows no bus.

use supersigma_config::{AxisConfig, MotorError, RampConfig, RampError};
use supersigma_protocol::{
    About, Activity, Alarm, Answer, AxisNumber, AxisReport, Command, Fault, Occasion, Refusal, Report,
    StatusWord, Tick,
};

use crate::board::{Board, Sink};
use crate::firmware::Firmware;
use crate::mechanism::Mechanism;
use crate::ramp::Table;

/// A motor card with its motor and rail, at the tick that it has reached.
#[derive(Debug)]
pub struct Axis {
    number: AxisNumber,
    firmware: Firmware,
    board: Board,
    told: Told,
}

/// Why an axis cannot be made of its configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AxisError {
    /// Its ramp does not give a table.
    #[error(transparent)]
    Ramp(#[from] RampError),
    /// Its motor cannot be.
    #[error(transparent)]
    Motor(#[from] MotorError),
}

/// What the CCU was told last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Told {
    sense: StatusWord,
    activity: Activity,
    alarm: Option<Alarm>,
}

impl Told {
    fn now(firmware: &Firmware, board: &Board) -> Self {
        Self { sense: firmware.sense_word(board), activity: firmware.activity(), alarm: firmware.alarm() }
    }
}

impl Axis {
    /// The axis at switch-on, tick 0.
    ///
    /// # Errors
    /// If the ramp does not give a table, or the motor cannot be.
    pub fn new(axis: &AxisConfig, ramp: &RampConfig) -> Result<Self, AxisError> {
        let firmware = Firmware::new(axis, ramp)?;
        let board = Board::new(Mechanism::new(axis)?);
        let told = Told::now(&firmware, &board);
        Ok(Self { number: axis.address, firmware, board, told })
    }

    /// Its card's number.
    #[must_use]
    pub fn number(&self) -> AxisNumber {
        self.number
    }

    /// The time that it has reached.
    #[must_use]
    pub fn now(&self) -> Tick {
        self.board.now()
    }

    /// Its ramp.
    #[must_use]
    pub fn table(&self) -> &Table {
        self.firmware.table()
    }

    /// What really stands on the rail, whatever the firmware believes.
    #[must_use]
    pub fn mechanism(&self) -> &Mechanism {
        self.board.mechanism()
    }

    /// The next tick at which anything happens by itself; `None` while the axis stands.
    #[must_use]
    pub fn next_event(&self) -> Option<Tick> {
        let change = self.board.next_change();
        self.firmware.wake_at().into_iter().chain(change).min()
    }

    /// The next tick at which it may have something to say by itself: all that happens before goes unnoticed.
    #[must_use]
    pub fn next_news(&self) -> Option<Tick> {
        if self.mechanism().has_rotor() {
            return self.next_event();
        }
        self.firmware.next_news(&self.board)
    }

    /// Lets time pass up to and including `to`.
    pub fn advance<S: Sink>(&mut self, to: Tick, sink: &mut S) {
        loop {
            if !S::PULSES && self.board.now() < to && !self.mechanism().has_rotor() {
                self.firmware.leap(to, &mut self.board);
            }
            let wake = self.firmware.wake_at().filter(|wake| *wake <= to);
            if self.board.run(wake.unwrap_or(to), sink) {
                self.firmware.sense(&mut self.board, sink);
            }
            let due = self.firmware.wake_at().is_some_and(|wake| wake <= self.board.now());
            if due {
                self.firmware.wake(&mut self.board, sink);
            }
            self.tell_changes(sink);
            if !due && self.board.now() >= to {
                return;
            }
        }
    }

    /// Makes a fault on purpose, now.
    pub fn fail(&mut self, fault: Fault, sink: &mut impl Sink) {
        self.firmware.fail(fault, &mut self.board, sink);
        self.tell_changes(sink);
    }

    /// Carries out a command, now; the answer is the caller's to send. `at` is the tick that the frame names.
    ///
    /// # Errors
    /// Why it was refused; then nothing has changed.
    pub fn deliver(
        &mut self,
        command: Command,
        at: Option<Tick>,
        sink: &mut impl Sink,
    ) -> Result<(), Refusal> {
        let alone = command.to == self.number.address();
        self.firmware.deliver(command.operation, at, alone, &mut self.board, sink)
    }

    /// Brakes because of something that is no command, and holds the axis until it is cleared.
    pub fn emergency(&mut self, alarm: Alarm, sink: &mut impl Sink) {
        self.firmware.emergency(alarm, &mut self.board, sink);
        self.tell_changes(sink);
    }

    /// The state now, to be sent: what it says need not be told again.
    pub fn report(&mut self) -> AxisReport {
        self.told = Told::now(&self.firmware, &self.board);
        self.firmware.report(&mut self.board)
    }

    /// What it is doing.
    #[must_use]
    pub fn activity(&self) -> Activity {
        self.firmware.activity()
    }

    /// Whether it is on its way: not standing, not waiting for a start.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        !matches!(self.firmware.activity(), Activity::Standing | Activity::Armed)
    }

    fn tell_changes(&mut self, sink: &mut impl Sink) {
        let news = Told::now(&self.firmware, &self.board);
        if news != self.told {
            self.told = news;
            sink.answer(Answer {
                card: self.number.address(),
                about: About::Unasked(Occasion::Changed),
                acted_at: self.board.now(),
                report: Report::Axis(self.firmware.report(&mut self.board)),
            });
        }
    }
}
