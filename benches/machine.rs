//! How fast the machine is: seven axes, each with firmware, 8253 and rail, make movement after movement on one core.
//! The reference is the same machine with every count and every pulse visited.

use std::time::Instant;

use axis_worker::{Card, Sink};
use supersigma_config::Config;
use supersigma_protocol::{
    Answer, Body, Command, Direction, Distance, Frame, Operation, Position, Sender, Sequence, Steps, Tick,
    Ticks,
};

use crate::figure::Figure;

const ROOM: &str = "machine";
/// Movements of each axis in one measurement.
const MOVES: u64 = 400;
/// The movement of the goal.
const USUAL: u16 = 2_600;
/// A movement that cruises for most of its way, and one that cruises three times as long.
const CRUISES: [u16; 2] = [20_000, 60_000];
/// Each figure is the best of so many: what the machine does besides only makes it slower.
const ROUNDS: usize = 20;
/// The same where every pulse is visited, which takes that much longer.
const VISITED_ROUNDS: usize = 3;

/// Takes what a card says and nothing else.
#[derive(Default)]
struct Answers(u64);

impl Sink for Answers {
    fn answer(&mut self, _: Answer) {
        self.0 += 1;
    }
}

/// Sees every pulse.
#[derive(Default)]
struct Pulses(u64);

impl Sink for Pulses {
    const PULSES: bool = true;
    fn answer(&mut self, _: Answer) {}
    fn pulse(&mut self, _: Tick, _: Position) {
        self.0 += 1;
    }
}

/// What a measurement gave.
struct Run {
    machine_s: f64,
    real_s: f64,
    moves: u64,
    steps: u64,
}

pub(crate) fn measure() -> Vec<Figure> {
    let usual = best(ROUNDS, USUAL, Answers::default);
    let visited = best(VISITED_ROUNDS, USUAL, Pulses::default);
    let [short, long] = CRUISES.map(|steps| best(ROUNDS, steps, Answers::default));
    vec![
        Figure::new(
            ROOM,
            format!("seven axes, moves of {USUAL} steps, one core"),
            usual.times(),
            "× real time",
        )
        .against("every pulse visited", visited.times())
        .at_least(20_000.0),
        Figure::new(ROOM, "pulses made", usual.pulses_per_second(), "pulses/s")
            .against("every pulse visited", visited.pulses_per_second()),
        Figure::new(ROOM, format!("a move of {USUAL} steps"), usual.micros_a_move(), "µs"),
        Figure::new(ROOM, format!("a move of {} steps", CRUISES[1]), long.micros_a_move(), "µs")
            .against("a third of its cruise", short.micros_a_move()),
    ]
}

impl Run {
    fn times(&self) -> f64 {
        self.machine_s / self.real_s
    }

    fn pulses_per_second(&self) -> f64 {
        count(self.steps) / self.real_s
    }

    fn micros_a_move(&self) -> f64 {
        self.real_s * 1e6 / count(self.moves)
    }
}

fn best<S: Sink>(rounds: usize, steps: u16, sink: impl Fn() -> S) -> Run {
    let runs = (0..rounds).map(|_| run(steps, &sink));
    runs.min_by(|one, other| one.real_s.total_cmp(&other.real_s)).expect("a round")
}

#[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
fn count(number: u64) -> f64 {
    number as f64
}

fn run<S: Sink>(steps: u16, sink: impl Fn() -> S) -> Run {
    let mut config = Config::default_set();
    config.log.sample_ms = 0;
    for axis in &mut config.axes {
        axis.rail.length = Steps(200_000);
        axis.rail.upper_zone = Steps(199_000);
        axis.travel.max = Position(190_000);
    }
    let mut cards: Vec<(Card, S)> = config
        .axes
        .iter()
        .map(|axis| {
            let card = Card::axis(&config, axis.address).expect("a good ramp").expect("it exists");
            (card, sink())
        })
        .collect();
    let mut sequence = Sequence(0);
    for (card, sink) in &mut cards {
        give(card, Operation::Originate, &mut sequence, sink);
    }
    let begun: Vec<Tick> = cards.iter().map(|(card, _)| card.now()).collect();
    let distance = Distance::new(steps).expect("not zero");
    let clock = Instant::now();
    for number in 0..MOVES {
        let direction = if number % 2 == 0 { Direction::Forward } else { Direction::TowardsOrigin };
        for (card, sink) in &mut cards {
            give(card, Operation::Move { direction, distance }, &mut sequence, sink);
        }
    }
    let real_s = clock.elapsed().as_secs_f64();
    let spent: Ticks =
        cards.iter().zip(&begun).map(|((card, _), begun)| card.now().since(*begun)).max().expect("seven");
    let moves = MOVES * 7;
    Run { machine_s: spent.as_seconds(), real_s, moves, steps: moves * u64::from(steps) }
}

/// Gives a command and runs the card until it stands.
fn give<S: Sink>(card: &mut Card, operation: Operation, sequence: &mut Sequence, sink: &mut S) {
    let frame = Frame {
        sender: Sender::Ccu,
        sequence: *sequence,
        tick: card.now(),
        body: Body::Command(Command::new(card.address(), operation).into()),
    };
    *sequence = sequence.next();
    card.take(&frame, sink);
    while let Some(next) = card.next_news() {
        card.advance(next, sink);
    }
}
