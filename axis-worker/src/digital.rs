//! The two digital cards of \[C\] Fig 3: sixteen outputs, sixteen inputs, and the wires between them. Pure, like an axis.
//!
//! The inputs of the model follow outputs after a delay, as the contact of a closed gripper follows its valve.

use supersigma_config::DigitalConfig;
use supersigma_protocol::{
    About, Address, Answer, Command, Occasion, Operation, Refusal, Report, Tick, Ticks,
};

use crate::board::Sink;

/// Both cards, at the tick that they have reached.
#[derive(Debug, Clone)]
pub struct Digital {
    now: Tick,
    outputs: u16,
    inputs: u16,
    wires: Vec<Wire>,
}

/// An input that follows an output.
#[derive(Debug, Clone)]
struct Wire {
    output: u16,
    input: u16,
    delay: Ticks,
    /// The level that is on its way to the input, and when it gets there.
    change: Option<(Tick, bool)>,
}

impl Digital {
    /// The cards at switch-on, tick 0: all outputs off, inputs as configured.
    #[must_use]
    pub fn new(config: &DigitalConfig) -> Self {
        let mask = |bit: u8| 1_u16.checked_shl(bit.into()).unwrap_or(0);
        let inputs = config.inputs.iter().filter(|input| input.initial);
        let wires = config.inputs.iter().filter_map(|input| {
            let followed = input.follows.as_ref()?;
            let output = config.outputs.iter().find(|output| output.name == *followed)?;
            Some(Wire {
                output: mask(output.bit),
                input: mask(input.bit),
                delay: Ticks::from_millis(input.delay_ms.into()),
                change: None,
            })
        });
        Self {
            now: Tick(0),
            outputs: 0,
            inputs: inputs.fold(0, |word, input| word | mask(input.bit)),
            wires: wires.collect(),
        }
    }

    /// The time that they have reached.
    #[must_use]
    pub fn now(&self) -> Tick {
        self.now
    }

    /// The next tick at which an input changes.
    #[must_use]
    pub fn next_event(&self) -> Option<Tick> {
        self.wires.iter().filter_map(|wire| wire.change).map(|(tick, _)| tick).min()
    }

    /// Lets time pass up to and including `to`.
    pub fn advance(&mut self, to: Tick, sink: &mut impl Sink) {
        while let Some(tick) = self.next_event().filter(|tick| *tick <= to) {
            self.now = self.now.max(tick);
            let before = self.inputs;
            for wire in &mut self.wires {
                if let Some((_, level)) = wire.change.take_if(|(due, _)| *due <= tick) {
                    self.inputs = if level { self.inputs | wire.input } else { self.inputs & !wire.input };
                }
            }
            if self.inputs != before {
                sink.answer(Answer {
                    card: Address::DIGITAL_INPUT,
                    about: About::Unasked(Occasion::Changed),
                    acted_at: self.now,
                    report: self.report(Address::DIGITAL_INPUT),
                });
            }
        }
        self.now = self.now.max(to);
    }

    /// Carries out a command, now.
    ///
    /// # Errors
    /// If it is for a motor card.
    pub fn deliver(&mut self, command: Command) -> Result<(), Refusal> {
        match command.operation {
            Operation::Status | Operation::ReadInputs => Ok(()),
            Operation::WriteOutputs { word } => {
                let changed = self.outputs ^ word;
                self.outputs = word;
                for wire in self.wires.iter_mut().filter(|wire| wire.output & changed != 0) {
                    wire.change = Some((self.now + wire.delay, word & wire.output != 0));
                }
                Ok(())
            }
            other => Err(Refusal::WrongCard { address: command.to.0, op_code: other.code() }),
        }
    }

    /// What the card at `address` reports: its sixteen lines.
    #[must_use]
    pub fn report(&self, address: Address) -> Report {
        Report::Digital(if address == Address::DIGITAL_OUTPUT { self.outputs } else { self.inputs })
    }
}
