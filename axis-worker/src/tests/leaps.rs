//! Whoever does not look at every count and pulse gets there faster, and to the very same place: the whole state of the
//! card, chip and all, is compared.

use supersigma_config::RampConfig;
use supersigma_protocol::{Fault, Switch};

use super::*;
use crate::ramp::any::any_ramp;

/// What happens to a card.
#[derive(Debug, Clone)]
enum Act {
    Command(Operation),
    Fault(Fault),
    /// A line whose leading axis makes the first number of steps.
    Line(u16, u16, Direction),
    /// To the end of what is under way, from one piece of news to the next.
    Settle,
}

fn direction() -> impl Strategy<Value = Direction> {
    prop_oneof![Just(Direction::Forward), Just(Direction::TowardsOrigin)]
}

fn act() -> impl Strategy<Value = Act> {
    let steps = || prop_oneof![1..40_u16, 1..3_000_u16, 1..30_000_u16].prop_map(distance);
    let speed = || (0..=232_u8).prop_map(|index| SpeedIndex::new(index).expect("in the table"));
    let command = prop_oneof![
        6 => (direction(), steps()).prop_map(|(direction, distance)| Operation::Move { direction, distance }),
        2 => (direction(), steps(), speed()).prop_map(|(direction, distance, limit)| {
            Operation::MoveLimited { direction, distance, limit }
        }),
        1 => (direction(), steps(), speed()).prop_map(|(direction, distance, speed)| {
            Operation::Slew { direction, distance, speed }
        }),
        1 => Just(Operation::Originate),
        1 => Just(Operation::SeekReference),
        2 => Just(Operation::Halt),
        1 => Just(Operation::Brake),
        2 => Just(Operation::Clear),
    ];
    let fault = prop_oneof![
        Just(Fault::Force),
        Just(Fault::Limit(End::Upper)),
        (1..50_u32).prop_map(|steps| Fault::LostSteps(Steps(steps))),
        Just(Fault::Switch(Switch::StuckOpen)),
        Just(Fault::Switch(Switch::StuckClosed)),
        Just(Fault::Switch(Switch::Free)),
    ];
    let line = (1..20_000_u16, 1..20_000_u16, direction())
        .prop_map(|(one, other, direction)| Act::Line(one.max(other), one.min(other), direction));
    prop_oneof![8 => command.prop_map(Act::Command), 1 => fault.prop_map(Act::Fault), 2 => line, 3 => Just(Act::Settle)]
}

/// A card and what becomes of what it says.
struct Seat<S> {
    card: Card,
    sink: S,
    sequence: Sequence,
}

impl<S: Sink> Seat<S> {
    fn give(&mut self, body: Body) {
        let frame = Frame { sender: Sender::Ccu, sequence: self.sequence, tick: self.card.now(), body };
        self.sequence = self.sequence.next();
        self.card.hear(&frame, &mut self.sink);
    }

    fn command(&mut self, operation: Operation, at: Option<Tick>) {
        let bytes = Command::new(Address(1), operation).encode();
        self.give(Body::Command(Broadcast { bytes, at }));
    }

    fn act(&mut self, act: &Act) {
        match act {
            Act::Command(operation) => self.command(*operation, None),
            Act::Fault(fault) => {
                self.give(Body::Fault(self.card.as_axis().expect("a motor card").number(), *fault));
            }
            Act::Line(lead, own, direction) => {
                self.command(Operation::Lead { distance: distance(*lead), limit: None }, None);
                self.command(Operation::ArmLine { direction: *direction, distance: distance(*own) }, None);
                self.command(Operation::Go, Some(self.card.now() + Ticks(5_000)));
            }
            Act::Settle => {
                while let Some(next) = self.card.next_news() {
                    self.card.advance(next, &mut self.sink);
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn a_leap_ends_where_a_walk_does(
        acts in proptest::collection::vec((act(), 1..3_000_000_u64, 1..200_000_u64), 1..10),
        ramp in any_ramp(),
        paper in any::<bool>(),
        sampled in any::<bool>(),
    ) {
        let short_moves = if paper { ShortMoves::Paper } else { ShortMoves::Optimal };
        let config = Config { ramp: RampConfig { short_moves, ..ramp }, ..config(short_moves) };
        let card = || {
            let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
            if sampled { card } else { card.without_samples() }
        };
        let mut walks = Seat { card: card(), sink: Record::default(), sequence: Sequence(0) };
        let mut leaps = Seat { card: card(), sink: Vec::<Answer>::new(), sequence: Sequence(0) };
        let same = |walks: &Seat<Record>, leaps: &Seat<Vec<Answer>>| {
            prop_assert_eq!(&walks.sink.answers, &leaps.sink);
            prop_assert_eq!(format!("{:?}", walks.card), format!("{:?}", leaps.card));
            Ok(())
        };
        for (act, pause, look) in [(Act::Command(Operation::Originate), 1, 1), (Act::Settle, 1, 1)].iter().chain(&acts) {
            walks.act(act);
            leaps.act(act);
            same(&walks, &leaps)?;
            let end = walks.card.now() + Ticks(*pause);
            while walks.card.now() < end {
                let next = (walks.card.now() + Ticks(*look)).min(end);
                walks.card.advance(next, &mut walks.sink);
                leaps.card.advance(next, &mut leaps.sink);
                same(&walks, &leaps)?;
            }
        }
    }

    /// Nothing is said before the tick of the news.
    #[test]
    fn before_the_news_there_is_none(acts in proptest::collection::vec(act(), 1..6)) {
        let config = config(ShortMoves::Optimal);
        let card = Card::axis(&config, config.axes[0].address).expect("a good ramp").expect("it exists");
        let mut seat = Seat { card: card.without_samples(), sink: Vec::<Answer>::new(), sequence: Sequence(0) };
        for act in [Act::Command(Operation::Originate), Act::Settle].iter().chain(&acts) {
            seat.act(act);
            while let Some(next) = seat.card.next_news() {
                let said = seat.sink.len();
                if next > seat.card.now() + Ticks(1) {
                    seat.card.advance(Tick(next.0 - 1), &mut seat.sink);
                    prop_assert_eq!(seat.sink.len(), said, "said before {}", next);
                }
                seat.card.advance(next, &mut seat.sink);
            }
        }
    }
}
