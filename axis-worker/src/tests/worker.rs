//! A worker that fails while its axis moves, and one that is commanded by somebody who is not the CCU.

use supersigma_protocol::bus::in_process::{InProcessBus, InProcessReceive, InProcessTransmit};
use supersigma_protocol::{
    Activity, AxisNumber, AxisReport, Broadcast, Command, Direction, Distance, Operation, Position, Steps,
};

use super::*;

/// A bus that is broken.
struct Broken;

impl Transmit for Broken {
    fn send(&mut self, _: &[u8], _: Wake) -> Result<(), BusError> {
        Err(broken())
    }
}

fn broken() -> BusError {
    BusError::Broken { what: "send", reason: "it is broken".into() }
}

/// A worker whose axis has been at its top speed for a while, in real time.
fn at_speed<T: Transmit>(transmit: T) -> Worker<T, impl Receive> {
    let config = Config::default_set();
    let number = AxisNumber::new(1).expect("an axis");
    let mut card = Card::axis(&config, number).expect("a good axis").expect("it exists");
    let mut said = Vec::new();
    let distance = Distance::new(60_000).expect("not 0");
    for (sequence, operation, ticks) in [
        (0, Operation::Originate, 20_000_000),
        (1, Operation::Move { direction: Direction::Forward, distance }, 900_000),
    ] {
        let broadcast = Broadcast::from(Command::new(number.address(), operation));
        let body = Body::Command(broadcast);
        let frame = Frame { sender: Sender::Ccu, sequence: Sequence(sequence), tick: card.now(), body };
        card.hear(&frame, &mut said);
        card.advance(card.now() + Ticks(ticks), &mut said);
    }
    let speaks = card.speak(Occasion::Heartbeat).report;
    assert!(matches!(speaks, Report::Axis(AxisReport { activity: Activity::Cruising, .. })), "{speaks:?}");
    let (_, receive) = InProcessBus::new().card(card.address()).expect("a port");
    let now = Monotonic::now().as_nanos();
    let clock = Clock::new(Monotonic::from_nanos(now - card.now().0 * 500), TimeScale::REAL);
    let (heartbeat, sequence) = (Ticks(100_000), Sequence(0));
    Worker {
        card,
        clock,
        transmit,
        receive,
        ccu: Origin::own(),
        strangers: Strangers::default(),
        heartbeat,
        sequence,
        said: Vec::new(),
        alarm: None,
    }
}

fn has_braked<T: Transmit, R: Receive>(worker: &mut Worker<T, R>) {
    let Report::Axis(AxisReport { activity, alarm, position, steps, .. }) =
        worker.card.speak(Occasion::Heartbeat).report
    else {
        panic!("an axis")
    };
    assert_eq!((activity, alarm), (Activity::Standing, Some(Alarm::CcuLost)));
    // Every pulse of the brake is counted.
    assert!(Steps(3_000) < steps && steps < Steps(60_000), "{steps:?}");
    assert_eq!(position.map(|Position(position)| position), i32::try_from(steps.0).ok());
}

#[test]
fn a_worker_that_panics_brakes_first() {
    let (transmit, _) = InProcessBus::new().card(Address(1)).expect("a port");
    let mut worker = at_speed(transmit);
    let work = AssertUnwindSafe(|| worker.guard(|_| panic!("on purpose")));
    let cause = panic::catch_unwind(work).expect_err("it goes on after the brake");
    assert_eq!(cause.downcast_ref(), Some(&"on purpose"));
    has_braked(&mut worker);
}

#[test]
fn a_worker_whose_bus_fails_brakes_first() {
    let mut worker = at_speed(Broken);
    let error = worker.guard(|_| Err(broken().into())).expect_err("it ends with what went wrong");
    assert_eq!(error.to_string(), broken().to_string());
    has_braked(&mut worker);
}

#[test]
fn a_worker_obeys_its_ccu_alone() {
    let bus = InProcessBus::new();
    let (mut commands, _answers) = bus.ccu().expect("a port");
    let (transmit, receive) = bus.card(Address(1)).expect("a port");
    let worker = at_speed(transmit);
    let activity = |worker: &mut Worker<InProcessTransmit, InProcessReceive>| match worker
        .card
        .speak(Occasion::Heartbeat)
        .report
    {
        Report::Axis(report) => report.activity,
        Report::Digital(_) => panic!("an axis"),
    };
    let mut worker = Worker {
        receive,
        ccu: Origin(Origin::own().0 + 1),
        card: worker.card,
        clock: worker.clock,
        transmit: worker.transmit,
        strangers: Strangers::default(),
        heartbeat: worker.heartbeat,
        sequence: worker.sequence,
        said: Vec::new(),
        alarm: None,
    };
    let mut brake = |number| {
        let body = Body::Command(Command::new(Address(1), Operation::Brake).into());
        let frame = Frame { sender: Sender::Ccu, sequence: Sequence(number), tick: Tick(0), body };
        commands.send(&frame.encode(), Wake::Everyone).expect("it may");
    };
    // More than are heard at once, so that there is more to hear.
    (2..2 + AT_ONCE as u64).for_each(&mut brake);
    assert!(worker.catch_up().expect("the bus works"));
    assert!(!worker.catch_up().expect("the bus works"));
    assert_eq!(activity(&mut worker), Activity::Cruising);
    // The same words of the CCU's.
    worker.ccu = Origin::own();
    brake(2);
    // It begins to slow down with its next pulse.
    while activity(&mut worker) == Activity::Cruising {
        worker.catch_up().expect("the bus works");
    }
    assert_eq!(activity(&mut worker), Activity::Braking);
}
