//! Whoever waits, and whoever else listens: everybody hears everything, once, and nobody keeps the bus.

use std::sync::atomic::AtomicU64;

use axis_worker::Card;
use axis_worker::clock::{Monotonic, TimeScale};
use supersigma_config::Config;
use supersigma_protocol::AxisNumber;
use supersigma_protocol::bus::in_process::InProcessBus;
use supersigma_protocol::bus::{Bus, Origin};

use super::*;
use crate::executive::{Failure, Link};

const PATIENCE: Duration = Duration::from_secs(60);
const QUESTIONS: u64 = 200;

/// An exchange with one card, which a thread plays.
struct Set {
    exchange: Arc<Exchange>,
    listening: Option<JoinHandle<()>>,
    card: Option<JoinHandle<()>>,
    over: Arc<AtomicBool>,
    _folder: tempfile::TempDir,
}

impl Set {
    fn up() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let knowledge = Knowledge::new(Config::default_set()).expect("good ramps");
        let clock = Clock::new(Monotonic::now(), TimeScale::REAL);
        let members = Members::new(folder.path().join("members"));
        members.admit(Address(1), || Ok(()), |()| Origin::own().0).expect("a folder that can be written");
        let bus = InProcessBus::new();
        let (transmit, receive) = bus.ccu().expect("a port");
        let over = Arc::new(AtomicBool::new(false));
        let card = play(&bus, &knowledge.config, clock, Arc::clone(&over));
        let (exchange, listening) =
            Exchange::start(knowledge, clock, members, transmit, receive).expect("a thread");
        Self { exchange, listening: Some(listening), card: Some(card), over, _folder: folder }
    }

    fn link(&self) -> LiveLink {
        self.exchange.link(Arc::default())
    }
}

impl Drop for Set {
    fn drop(&mut self) {
        self.exchange.stop();
        self.over.store(true, Ordering::Release);
        for thread in [self.listening.take(), self.card.take()].into_iter().flatten() {
            let _ = thread.join();
        }
    }
}

/// A card's process in small.
fn play(bus: &InProcessBus, config: &Config, clock: Clock, over: Arc<AtomicBool>) -> JoinHandle<()> {
    let number = AxisNumber::all().next().expect("seven");
    let (mut transmit, mut receive) = bus.card(number.address()).expect("a port");
    let mut card = Card::axis(config, number).expect("a good ramp").expect("it exists");
    let (mut sequence, mut said) = (Sequence(0), Vec::<Answer>::new());
    thread::spawn(move || {
        while !over.load(Ordering::Acquire) {
            receive.wait(LOOK).expect("a bus");
            while let Some(received) = receive.receive().expect("a bus") {
                card.advance(clock.now().max(card.now()), &mut said);
                card.hear(&Frame::decode(&received.bytes).expect("a frame"), &mut said);
                for answer in said.drain(..) {
                    let sender = Sender::Card(number.address());
                    let frame = Frame { sender, sequence, tick: clock.now(), body: Body::Answer(answer) };
                    sequence = sequence.next();
                    transmit.send(&frame.encode(), Wake::Everyone).expect("a bus");
                }
            }
        }
    })
}

/// Asks, and waits for the answer; how many others' it has heard meanwhile.
fn ask(link: &mut LiveLink) -> u64 {
    let question = link.send(Command::new(Address(1), Operation::Status).into()).expect("a bus");
    let until = link.now() + link.ticks(PATIENCE);
    let mut others = 0;
    loop {
        match link.hear(until) {
            Ok(Some(Heard::Answer(answer))) if matches!(answer.about, About::Command(of, _) if of == question) =>
            {
                return others;
            }
            Ok(Some(Heard::Answer(_))) => others += 1,
            heard => panic!("{heard:?}"),
        }
    }
}

#[test]
fn whoever_listens_passes_on_what_it_hears() {
    let set = Set::up();
    let heard = set.exchange.subscribe();
    let mut link = set.link();
    for _ in 0..QUESTIONS {
        ask(&mut link);
    }
    assert_eq!(heard.try_iter().filter(|heard| matches!(heard, Heard::Answer(_))).count() as u64, QUESTIONS);
    // When nobody asks any more, the exchange's own thread listens again.
    drop(link);
    set.exchange.send(Command::new(Address(1), Operation::Status).into()).expect("a bus");
    assert!(matches!(heard.recv_timeout(PATIENCE), Ok(Heard::Answer(_))));
}

#[test]
fn all_who_wait_at_once_hear_their_answers_and_everybody_elses() {
    const ASKERS: u64 = 3;
    let set = Set::up();
    let links: Vec<LiveLink> = (0..ASKERS).map(|_| set.link()).collect();
    let others = AtomicU64::new(0);
    thread::scope(|scope| {
        for mut link in links {
            let others = &others;
            scope.spawn(move || {
                let mut heard: u64 = (0..QUESTIONS).map(|_| ask(&mut link)).sum();
                let until = link.now() + link.ticks(PATIENCE);
                while heard < (ASKERS - 1) * QUESTIONS {
                    assert!(matches!(link.hear(until), Ok(Some(Heard::Answer(_)))));
                    heard += 1;
                }
                others.fetch_add(heard, Ordering::Relaxed);
            });
        }
    });
    assert_eq!(others.into_inner(), ASKERS * (ASKERS - 1) * QUESTIONS);
    let counts = set.exchange.counts();
    assert_eq!((counts.commands, counts.answers, counts.lost), (ASKERS * QUESTIONS, ASKERS * QUESTIONS, 0));
}

#[test]
fn whoever_listens_is_told_what_does_not_come_from_the_bus() {
    let set = Set::up();
    let mut link = set.link();
    ask(&mut link);
    let exchange = Arc::clone(&set.exchange);
    thread::scope(|scope| {
        let waiting = scope.spawn(move || {
            let until = link.now() + link.ticks(PATIENCE);
            (link.hear(until), link)
        });
        exchange.link(Arc::default()).tell_resume();
        let (heard, mut link) = waiting.join().expect("no panic");
        assert!(matches!(heard, Ok(Some(Heard::Resume))), "{heard:?}");
        let waiting = scope.spawn(move || {
            let until = link.now() + link.ticks(PATIENCE);
            assert!(matches!(link.hear(until), Ok(Some(Heard::GoingDown))));
            link.hear(until)
        });
        exchange.going_down();
        assert!(matches!(waiting.join().expect("no panic"), Err(Failure::GoingDown)));
    });
}

#[test]
fn an_exchange_that_stops_lets_go_of_the_bus_whoever_listens() {
    let mut set = Set::up();
    let mut link = set.link();
    ask(&mut link);
    let waiting = thread::spawn(move || {
        let until = link.now() + link.ticks(PATIENCE);
        link.hear(until)
    });
    set.exchange.stop();
    set.listening.take().expect("it runs").join().expect("no panic");
    assert!(set.exchange.ear.lock().unwrap_or_else(PoisonError::into_inner).is_none());
    set.exchange.going_down();
    assert!(matches!(
        waiting.join().expect("no panic"),
        Ok(Some(Heard::GoingDown)) | Err(Failure::GoingDown)
    ));
    // Others may still hold the exchange; they cannot speak any more.
    assert!(set.exchange.send(Command::new(Address(1), Operation::Status).into()).is_err());
}
