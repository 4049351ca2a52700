//! Hand-made frames through the whole room: series, bars, pictures.

use resvg::tiny_skia::Pixmap;
use supersigma_config::Config;
use supersigma_protocol::{
    About, Activity, Alarm, Answer, AxisNumber, AxisReport, Body, Broadcast, Command, Direction, Distance,
    Fault, Frame, Occasion, Operation, Pace, Position, Refusal, Report, Sender, SensePoint, Sequence,
    StatusWord, Steps, Tick, Ticks,
};

use super::moves::{clipped, positions, speeds};
use super::*;

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

fn frame(sender: Sender, tick: u64, body: Body) -> Frame {
    Frame { sender, sequence: Sequence(0), tick: Tick(tick), body }
}

fn command(number: u8, sequence: u64, tick: u64, operation: Operation) -> Frame {
    let broadcast = Broadcast::from(Command::new(axis(number).address(), operation));
    Frame { sequence: Sequence(sequence), ..frame(Sender::Ccu, tick, Body::Command(broadcast)) }
}

/// What an axis says, with as much of its state as matters here.
#[derive(Clone, Copy)]
struct Says {
    activity: Activity,
    period: u64,
    direction: Direction,
    position: Option<i32>,
    steps: u32,
    alarm: Option<Alarm>,
}

const RESTS: Says = Says {
    activity: Activity::Standing,
    period: 0,
    direction: Direction::Forward,
    position: None,
    steps: 0,
    alarm: None,
};

const CHANGED: About = About::Unasked(Occasion::Changed);

impl Says {
    fn at(self, number: u8, tick: u64, about: About) -> Frame {
        let moves = self.period > 0;
        let report = AxisReport {
            sense: StatusWord::default().with(SensePoint::X4, !moves),
            steps: Steps(self.steps),
            position: self.position.map(Position),
            activity: self.activity,
            alarm: self.alarm,
            lost: None,
            pace: moves.then_some(Pace { period: Ticks(self.period), direction: self.direction }),
        };
        let card = axis(number).address();
        let answer = Answer { card, about, acted_at: Tick(tick), report: Report::Axis(report) };
        frame(Sender::Card(card), tick, Body::Answer(answer))
    }
}

/// Axis 1 makes 400 steps and is halted on its way back; axis 2 refuses and stands.
fn frames() -> Vec<Frame> {
    let done = |sequence| About::Command(Sequence(sequence), Ok(()));
    let distance = |steps| Distance::new(steps).expect("not zero");
    let up = Says { activity: Activity::Accelerating, period: 2_000, position: Some(0), ..RESTS };
    let back = Says { direction: Direction::TowardsOrigin, position: Some(400), ..up };
    let rests = Says { position: Some(400), steps: 400, ..RESTS };
    let refusal = Refusal::OutOfTravel { target: Position(-5), min: Position(0), max: Position(100) };
    let forward = Operation::Move { direction: Direction::Forward, distance: distance(400) };
    let towards = Operation::Move { direction: Direction::TowardsOrigin, distance: distance(300) };
    vec![
        RESTS.at(1, 0, About::Unasked(Occasion::Joined)),
        RESTS.at(2, 0, About::Unasked(Occasion::Joined)),
        command(1, 7, 2_000_000, forward),
        up.at(1, 2_000_000, done(7)),
        Says { period: 500, position: Some(100), steps: 100, ..up }.at(
            1,
            2_100_000,
            About::Unasked(Occasion::Sampled),
        ),
        rests.at(1, 2_400_000, CHANGED),
        rests.at(1, 3_000_000, About::Unasked(Occasion::Heartbeat)),
        rests.at(1, 3_500_000, About::Unasked(Occasion::Heartbeat)),
        command(2, 8, 3_600_000, towards),
        RESTS.at(2, 3_600_000, About::Command(Sequence(8), Err(refusal))),
        command(1, 9, 4_000_000, towards),
        back.at(1, 4_000_000, done(9)),
        frame(Sender::Ccu, 4_050_000, Body::Fault(axis(1), Fault::Force)),
        command(1, 10, 4_100_000, Operation::Halt),
        Says { activity: Activity::Decelerating, ..back }.at(1, 4_100_000, done(10)),
        Says { position: Some(350), steps: 50, ..RESTS }.at(1, 4_200_000, CHANGED),
        Says { position: Some(350), steps: 50, alarm: Some(Alarm::ExcessiveForce), ..RESTS }
            .at(1, 4_250_000, CHANGED),
    ]
}

fn heard() -> (Trace, Timing) {
    let (mut trace, mut timing) = (Trace::default(), Timing::default());
    for frame in frames() {
        trace.hear(&frame);
        timing.hear(&frame);
    }
    trace.sort();
    timing.close(Tick(6_000_000));
    (trace, timing)
}

const ALL: Window = Window { from: Tick(0), to: Tick(5_000_000) };

#[test]
fn a_trace_holds_what_was_said() {
    let (trace, _) = heard();
    assert_eq!(trace.axes.iter().map(|trace| trace.axis).collect::<Vec<_>>(), [axis(1), axis(2)]);
    assert_eq!(trace.span, Some(Window { from: Tick(0), to: Tick(4_250_000) }));
    assert_eq!(trace.faults, [(Tick(4_050_000), axis(1), Fault::Force)]);
    // From the first pulse's command to the stop, and a fiftieth of that on both sides, within what was heard.
    assert_eq!(trace.moving(), Some(Window { from: Tick(1_956_000), to: Tick(4_244_000) }));
    let rests: Vec<_> = trace.axes[0].rests().map(|rest| (rest.tick.0, rest.position)).collect();
    assert_eq!(rests, [(2_400_000, Some(Position(400))), (4_200_000, Some(Position(350)))]);
    assert!(trace.axes[0].moved(ALL) && !trace.axes[1].moved(ALL));
    assert!(!trace.axes[0].moved(Window { from: Tick(2_500_000), to: Tick(3_900_000) }));
}

#[test]
fn speed_jumps_at_rest_and_is_straight_between_samples() {
    let (trace, _) = heard();
    let speeds = speeds(&trace.axes[0], ALL);
    let expected = [
        (0.0, 0.0),
        (1.0, 0.0),
        (1.0, 1_000.0),
        (1.05, 4_000.0),
        (1.2, 4_000.0),
        (1.2, 0.0),
        (1.75, 0.0),
        (1.75, 0.0),
        (2.0, 0.0),
        (2.0, -1_000.0),
        (2.05, -1_000.0),
        (2.1, -1_000.0),
        (2.1, 0.0),
        (2.125, 0.0),
        (2.125, 0.0),
        (2.5, 0.0),
    ];
    assert_eq!(speeds, expected);
    let positions = positions(&trace.axes[0], ALL);
    let [run] = positions.as_slice() else { panic!("known from the first movement on: {positions:?}") };
    assert_eq!((run[0], run[run.len() - 1]), ((1.0, 0.0), (2.5, 350.0)));
}

#[test]
fn a_line_is_cut_where_it_crosses_the_window() {
    let line = [(0.0, 0.0), (4.0, 8.0)];
    assert_eq!(clipped(&line, &(1.0..3.0)), [(1.0, 2.0), (3.0, 6.0)]);
    assert_eq!(clipped(&line, &(0.0..4.0)), line);
    assert_eq!(clipped(&line, &(5.0..6.0)), []);
}

#[test]
fn bars_are_movements_and_totals_are_their_sums() {
    let (_, timing) = heard();
    let bar = |begin, end, steps, direction, ending| Bar {
        kind: Kind::Move,
        begin: Tick(begin),
        end: Tick(end),
        steps: Steps(steps),
        direction: Some(direction),
        ending,
    };
    let bars = [
        bar(2_000_000, 2_400_000, 400, Direction::Forward, Ending::Complete),
        bar(4_000_000, 4_200_000, 50, Direction::TowardsOrigin, Ending::Halted),
    ];
    assert_eq!(timing.axes[0].bars, bars);
    assert_eq!(timing.axes[1].bars, []);
    let idle: Vec<_> = timing.idle().iter().map(|gap| (gap.from.0, gap.to.0)).collect();
    assert_eq!(idle, [(0, 2_000_000), (2_400_000, 4_000_000), (4_200_000, 6_000_000)]);
    let config = Config::default_set();
    let summaries = timing.summaries(&AxisNames::from(&config));
    let first = Summary {
        axis: 1,
        name: "left_x".into(),
        movements: 2,
        steps: 450,
        peak_speed: 4_000.0,
        moving_seconds: 0.3,
        longest_wait_seconds: 1.0,
        out_of_travel: 0,
    };
    assert_eq!(summaries[0], first);
    assert_eq!((summaries[1].out_of_travel, summaries[1].longest_wait_seconds), (1, 3.0));
    assert_eq!(timing.totals(), "2 movements, 450 steps, 3.000 s of machine time");
}

#[test]
fn lines_of_a_card_are_on_from_tick_to_tick() {
    let lane = Lane { words: vec![(Tick(0), 0), (Tick(10), 0b10), (Tick(20), 0b11), (Tick(30), 0b01)] };
    let on = |bit| lane.on(bit, Tick(50)).iter().map(|span| (span.from.0, span.to.0)).collect::<Vec<_>>();
    assert_eq!((on(0), on(1), on(2)), (vec![(20, 50)], vec![(10, 30)], vec![]));
}

fn drawn(what: &[What], size: Option<Size>) -> Result<Picture, PlotError> {
    let (trace, timing) = heard();
    let config = Config::default_set();
    let names = AxisNames::from(&config);
    let subject = Subject { title: "a < set", subtitle: "by hand", names: &names, config: &config };
    moves(&trace, &timing, &Shown { subject, axes: &[axis(1), axis(2)], what, window: ALL, size })
}

#[test]
fn a_picture_says_what_its_axes_are() {
    let picture =
        drawn(&[What::Plane, What::Sense, What::Speed, What::Position, What::Timing], None).expect("drawn");
    for text in [
        "<title>a &lt; set</title>",
        "a &lt; set",
        "by hand",
        "left_x",
        "left_y",
        "steps/s",
        "steps from the origin",
        "machine time since the set was switched on, s",
        "position e, steps from the origin",
        "X1",
        "X5",
        "fault: excessive force",
        "State plane of left_x",
        "+400",
    ] {
        assert!(picture.svg().contains(text), "{text} is missing");
    }
    assert!(!picture.svg().contains("NaN"));
    let again =
        drawn(&[What::Plane, What::Sense, What::Speed, What::Position, What::Timing], None).expect("drawn");
    assert_eq!(picture, again);
}

#[test]
fn a_png_has_twice_the_size_and_is_not_blank() {
    let size = Size { width: 800, height: 700 };
    let picture = drawn(&[What::Speed, What::Sense], Some(size)).expect("drawn");
    let pixels = Pixmap::decode_png(&png::render(&picture).expect("rendered")).expect("a PNG");
    assert_eq!((pixels.width(), pixels.height()), (1_600, 1_400));
    let count = |r, g, b| {
        pixels.pixels().iter().filter(|pixel| (pixel.red(), pixel.green(), pixel.blue()) == (r, g, b)).count()
    };
    // White paper, and the curves and lanes of axis 1 in its own colour.
    assert!(count(255, 255, 255) > 1_000_000);
    assert!(count(0, 114, 178) > 10_000, "{}", count(0, 114, 178));
    // Text: nothing else is quite as dark as ink.
    assert!(count(40, 40, 40) > 300, "{}", count(40, 40, 40));
}

#[test]
fn a_size_without_room_is_refused_with_one_that_has_it() {
    let asked = Size { width: 400, height: 200 };
    let Err(PlotError::TooSmall { needed, .. }) = drawn(&[What::Speed, What::Sense], Some(asked)) else {
        panic!("400x200 is no picture");
    };
    assert_eq!(drawn(&[What::Speed, What::Sense], Some(needed)).expect("has room").size(), needed);
}

#[test]
fn names_and_sizes_are_checked() {
    assert_eq!(Format::of(Path::new("a/b.SVG")).expect("a picture"), Format::Svg);
    assert_eq!(Format::of(Path::new("b.png")).expect("a picture"), Format::Png);
    for wrong in ["b", "b.jpg", ".svg"] {
        assert!(matches!(Format::of(Path::new(wrong)), Err(PlotError::Extension { .. })), "{wrong}");
    }
    assert_eq!("1200x800".parse(), Ok(Size { width: 1_200, height: 800 }));
    for wrong in ["1200", "x", "0x5", "5x10001", "-1x5", "5x5x5"] {
        assert!(wrong.parse::<Size>().is_err(), "{wrong}");
    }
}
