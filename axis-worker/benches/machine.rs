//! How fast the machine is: seven axes, each with firmware, 8253 and rail, make movement after movement on one core.
//!
//!     cargo bench -p supersigma-axis-worker --bench machine
//!
//! The reference is the same machine with every count and every pulse visited, in the same run.

use std::time::Instant;

use axis_worker::{Card, Sink};
use supersigma_config::Config;
use supersigma_protocol::{
    Answer, Body, Command, Direction, Distance, Frame, Operation, Position, Sender, Sequence, Tick, Ticks,
};

/// Movements of each axis in one measurement.
const MOVES: u64 = 400;

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

fn main() {
    println!(
        "seven axes, {MOVES} movements each, one core; seconds of machine time per second, for the whole set\n"
    );
    println!(
        "{:>9} {:>12} {:>14} {:>14} {:>16} {:>12}",
        "steps", "× real time", "µs a movement", "pulses/s", "pulse by pulse", "ratio"
    );
    for steps in [200, 2_600, 5_184, 20_000, 60_000] {
        let fast = measure(steps, Answers::default);
        let slow = measure(steps, Pulses::default);
        let times = |run: &Run| run.machine_s / run.real_s;
        println!(
            "{steps:>9} {:>12.0} {:>14.2} {:>14.3e} {:>16.0} {:>12.1}",
            times(&fast),
            fast.real_s * 1e6 / count(fast.moves),
            count(fast.steps) / fast.real_s,
            times(&slow),
            times(&fast) / times(&slow),
        );
    }
}

#[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
fn count(number: u64) -> f64 {
    number as f64
}

fn measure<S: Sink>(steps: u16, sink: impl Fn() -> S) -> Run {
    let mut config = Config::default_set();
    config.log.sample_ms = 0;
    for axis in &mut config.axes {
        axis.rail.length = supersigma_protocol::Steps(200_000);
        axis.rail.upper_zone = supersigma_protocol::Steps(199_000);
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
