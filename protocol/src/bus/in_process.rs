//! The bus inside one process: the dry run's and the tests' carrier, with the shared-memory one's manners.
//! A full buffer loses the newest frames, a line stays raised until its port has waited, taps hear a command first.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use super::line::Line;
use super::{
    BUFFER_FRAMES, Bus, BusError, Lane, Origin, Receive, Received, Tap, Transmit, Wake, Waker, check_length,
};
use crate::units::Address;

/// A bus whose ports live in this process. Clones are the same bus.
#[derive(Debug, Clone, Default)]
pub struct InProcessBus {
    readers: Arc<Mutex<Vec<Reader>>>,
}

impl InProcessBus {
    /// A bus without ports.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn port(&self, hears: Lane, line: Line) -> (InProcessTransmit, InProcessReceive) {
        let mailbox = Arc::<Mailbox>::default();
        lock(&self.readers).push(Reader { hears, line: Some(line), mailbox: Arc::downgrade(&mailbox) });
        let speaks = match hears {
            Lane::Commands => Lane::Answers,
            Lane::Answers => Lane::Commands,
        };
        (InProcessTransmit { speaks, readers: Arc::clone(&self.readers) }, InProcessReceive { mailbox })
    }

    fn silent(&self, hears: Lane) -> Arc<Mailbox> {
        let mailbox = Arc::<Mailbox>::default();
        // In front of all ports, so that an answer never overtakes its command on the way to a tap.
        lock(&self.readers).insert(0, Reader { hears, line: None, mailbox: Arc::downgrade(&mailbox) });
        mailbox
    }
}

impl Bus for InProcessBus {
    type Transmit = InProcessTransmit;
    type Receive = InProcessReceive;
    type Tap = InProcessTap;

    fn ccu(&self) -> Result<(InProcessTransmit, InProcessReceive), BusError> {
        Ok(self.port(Lane::Answers, Line::AnswerReady))
    }

    fn card(&self, address: Address) -> Result<(InProcessTransmit, InProcessReceive), BusError> {
        Ok(self.port(Lane::Commands, Line::of_card(address)?))
    }

    fn tap(&self) -> Result<InProcessTap, BusError> {
        Ok(InProcessTap { commands: self.silent(Lane::Commands), answers: self.silent(Lane::Answers) })
    }
}

/// The sending half of a port.
#[derive(Debug)]
pub struct InProcessTransmit {
    speaks: Lane,
    readers: Arc<Mutex<Vec<Reader>>>,
}

impl Transmit for InProcessTransmit {
    fn send(&mut self, frame: &[u8], wake: Wake) -> Result<(), BusError> {
        check_length(frame)?;
        lock(&self.readers).retain(|reader| {
            let Some(mailbox) = reader.mailbox.upgrade() else {
                return false;
            };
            if reader.hears == self.speaks {
                mailbox.put(frame, reader.line.is_some_and(|line| line.is_raised_by(wake)));
            }
            true
        });
        Ok(())
    }
}

/// The receiving half of a port.
#[derive(Debug)]
pub struct InProcessReceive {
    mailbox: Arc<Mailbox>,
}

impl Receive for InProcessReceive {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        let bytes = lock(&self.mailbox.inside).frames.pop_front();
        Ok(bytes.map(|bytes| Received { origin: Origin::own(), bytes }))
    }

    fn wait(&mut self, limit: Duration) -> Result<(), BusError> {
        let (mut inside, _) = self
            .mailbox
            .line
            .wait_timeout_while(lock(&self.mailbox.inside), limit, |inside| !inside.raised)
            .unwrap_or_else(PoisonError::into_inner);
        inside.raised = false;
        Ok(())
    }

    fn waker(&self) -> Waker {
        let mailbox = Arc::downgrade(&self.mailbox);
        Waker::new(move || {
            if let Some(mailbox) = mailbox.upgrade() {
                mailbox.raise(&mut lock(&mailbox.inside));
            }
        })
    }
}

/// A silent reader of both lanes.
#[derive(Debug)]
pub struct InProcessTap {
    commands: Arc<Mailbox>,
    answers: Arc<Mailbox>,
}

impl Tap for InProcessTap {
    fn drain(&mut self, each: &mut dyn FnMut(Lane, Origin, &[u8])) -> Result<usize, BusError> {
        // Answers are taken first and handed over last: whatever they answer is among the commands taken after them.
        let answers = std::mem::take(&mut lock(&self.answers.inside).frames);
        let commands = std::mem::take(&mut lock(&self.commands.inside).frames);
        let own = Origin::own();
        for command in &commands {
            each(Lane::Commands, own, command);
        }
        for answer in &answers {
            each(Lane::Answers, own, answer);
        }
        Ok(commands.len() + answers.len())
    }
}

#[derive(Debug)]
struct Reader {
    hears: Lane,
    /// What wakes it; a tap has no line.
    line: Option<Line>,
    mailbox: Weak<Mailbox>,
}

#[derive(Debug, Default)]
struct Mailbox {
    inside: Mutex<Inside>,
    line: Condvar,
}

#[derive(Debug, Default)]
struct Inside {
    frames: VecDeque<Vec<u8>>,
    raised: bool,
}

impl Mailbox {
    fn put(&self, frame: &[u8], raise: bool) {
        let mut inside = lock(&self.inside);
        if inside.frames.len() < BUFFER_FRAMES {
            inside.frames.push_back(frame.to_vec());
        }
        if raise {
            self.raise(&mut inside);
        }
    }

    fn raise(&self, inside: &mut Inside) {
        inside.raised = true;
        self.line.notify_one();
    }
}

/// Nothing under these locks can be left half done, so a panic elsewhere does not spoil them.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
