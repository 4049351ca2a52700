//! The dashboard on screens of all sizes, from frames that are written by hand, and its keys.

use std::path::Path;
use std::time::Duration;

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::Rect;
use supersigma_config::Config;
use supersigma_protocol::bus::Lane;
use supersigma_protocol::{
    About, Activity, Address, Alarm, Answer, AxisNumber, AxisReport, Body, Command, Direction, Distance,
    Frame, Occasion, Operation, Pace, Position, Report, Sender, SensePoint, Sequence, StatusWord, Steps,
    Tick, Ticks,
};

use super::draw::Scene;
use super::live::Link;
use super::view::{Mode, View, Wish};
use super::{draw_as_text, size};
use crate::control::{Description, ProcessRole, ProcessState, ProcessView, RecorderState, RecorderView};
use crate::executive::{LogTrouble, Request};
use crate::watch::Picture;

const LOG: &str = "/home/ada/.local/state/supersigma/cell-2-20261124T213625.011Z.mcap";

fn recorder(trouble: Option<LogTrouble>) -> RecorderView {
    RecorderView {
        state: if trouble.is_some() { RecorderState::Stopped } else { RecorderState::Recording },
        log: LOG.into(),
        parts: vec![LOG.into()],
        frames: 12_345,
        lost: 0,
        bytes: 1_234_567,
        behind_ms: 12,
        trouble,
    }
}

fn description(config: &Config) -> Description {
    Description {
        name: "cell-2".into(),
        pid: 4711,
        config: config.to_toml(),
        time_scale: 20.0,
        log: LOG.into(),
        foxglove: None,
        up_s: 3_725.4,
        axes: vec![],
        digital: vec![Address::DIGITAL_INPUT, Address::DIGITAL_OUTPUT],
        inputs: Some(0b1_1000),
        outputs: None,
        frames: 12_345,
        lost: 0,
        recorder: recorder(None),
        processes: vec![],
    }
}

/// One that accelerates, one that is locked, one that has not been originated, four whose cards are not heard.
fn cell() -> (Picture, View) {
    let config = Config::default_set();
    let mut picture = Picture::new(config.clone());
    picture.describe(Duration::ZERO, &description(&config));
    let still = AxisReport {
        sense: StatusWord::default().with(SensePoint::X4, true),
        steps: Steps(0),
        position: None,
        activity: Activity::Standing,
        alarm: None,
        lost: None,
        pace: None,
    };
    let moves = |step: u32| AxisReport {
        sense: StatusWord::default(),
        steps: Steps(100 * step),
        position: Some(Position(3_000).moved(Direction::TowardsOrigin, Steps(100 * step))),
        activity: Activity::Accelerating,
        pace: Some(Pace { period: Ticks(4_000 / u64::from(step)), direction: Direction::TowardsOrigin }),
        ..still
    };
    let locked = AxisReport {
        sense: StatusWord::default().with(SensePoint::X2, true),
        position: Some(Position(6_900)),
        alarm: Some(Alarm::ExcessiveForce),
        ..still
    };
    let mut says = |at: u64, card: u8, sequence: u64, about: About, report: AxisReport| {
        let (card, tick) = (Address(card), Tick(at * 2_000));
        let body = Body::Answer(Answer { card, about, acted_at: tick, report: Report::Axis(report) });
        let frame = Frame { sender: Sender::Card(card), sequence: Sequence(sequence), tick, body };
        picture.take(Duration::from_millis(at), Lane::Answers, &frame.encode());
    };
    let beat = About::Unasked(Occasion::Heartbeat);
    says(10, 3, 0, beat, still);
    says(20, 2, 0, About::Unasked(Occasion::Changed), locked);
    for step in 1..=20 {
        says(100 * u64::from(step), 1, step.into(), About::Unasked(Occasion::Sampled), moves(step));
        says(100 * u64::from(step), 2, step.into(), beat, locked);
        says(100 * u64::from(step), 3, step.into(), beat, still);
    }
    for (sequence, operation) in [
        Operation::Move {
            direction: Direction::TowardsOrigin,
            distance: Distance::new(2_800).expect("not 0"),
        },
        Operation::Halt,
    ]
    .into_iter()
    .enumerate()
    {
        let body = Body::Command(Command::new(Address(1), operation).into());
        let number = u64::try_from(sequence).expect("small");
        let frame = Frame { sender: Sender::Ccu, sequence: Sequence(number), tick: Tick(4_000_000), body };
        picture.take(Duration::from_secs(2), Lane::Commands, &frame.encode());
    }
    let view = View::new(config.axes.iter().map(|axis| (axis.address, axis.name.clone())).collect());
    (picture, view)
}

fn drawn(picture: &Picture, view: &View, link: Link, columns: u16, rows: u16) -> String {
    let area = Rect::new(0, 0, columns, rows);
    let snapshot = picture.snapshot(&view.detail(area));
    draw_as_text(&Scene { snapshot: &snapshot, link: &link, view }, area)
}

/// Compares with the file in `golden`; `UPDATE_GOLDEN=1` writes it, to be looked at before it is kept.
fn assert_golden(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli/monitor/golden").join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, text).expect("it can be written");
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(golden == text, "{name} is\n{golden}\nand this is drawn:\n{text}");
}

fn press(view: &mut View, code: KeyCode) -> Option<Wish> {
    view.press(KeyEvent::new(code, KeyModifiers::NONE))
}

#[test]
fn a_screen_of_80_by_24() {
    let (picture, view) = cell();
    assert_golden("80x24.txt", &drawn(&picture, &view, Link::Up, 80, 24));
}

#[test]
fn a_screen_of_120_by_40_with_one_axis_selected() {
    let (picture, mut view) = cell();
    press(&mut view, KeyCode::Down);
    press(&mut view, KeyCode::Char('f'));
    press(&mut view, KeyCode::Char('a'));
    assert_golden("120x40.txt", &drawn(&picture, &view, Link::Up, 120, 40));
}

#[test]
fn the_help_and_a_set_that_is_down() {
    let (picture, mut view) = cell();
    press(&mut view, KeyCode::Char('?'));
    assert_golden("help.txt", &drawn(&picture, &view, Link::Down, 80, 24));
}

#[test]
fn no_size_is_too_small() {
    let (picture, mut view) = cell();
    for mode in [Mode::Commands, Mode::Help] {
        view.mode = mode;
        for columns in (1..40).chain([79, 200, 400]) {
            for rows in (1..26).chain([60]) {
                let link = Link::Silent(Duration::from_secs(3));
                let text = drawn(&picture, &view, link, columns, rows);
                assert_eq!(text.lines().count(), usize::from(rows));
            }
        }
    }
    // What matters most is there as long as there is any room.
    let text = drawn(&picture, &view_of(&picture), Link::Up, 40, 12);
    assert!(text.contains("left_x") && text.contains("frames/s") && text.contains("h halt"), "{text}");
}

fn view_of(picture: &Picture) -> View {
    View::new(picture.config().axes.iter().map(|axis| (axis.address, axis.name.clone())).collect())
}

#[test]
fn lost_frames_restarts_and_an_ended_recorder_stand_in_the_head() {
    let (mut picture, view) = cell();
    let trouble = LogTrouble { reason: "the recorder was killed".into(), advice: "take the set down".into() };
    let again = ProcessView {
        role: ProcessRole::Worker,
        card: Some(Address(3)),
        pid: Some(4712),
        state: ProcessState::Running,
        since_ms: 50,
        restarts: 2,
    };
    let (recorder, processes) = (recorder(Some(trouble)), vec![again]);
    let set = Description { lost: 7, recorder, processes, ..description(picture.config()) };
    picture.describe(Duration::from_secs(2), &set);
    let text = drawn(&picture, &view, Link::Up, 80, 24);
    for said in
        ["7 lost", "2 restarts", "NO LOG ANY MORE", "recorder: the recorder was killed; nothing moves"]
    {
        assert!(text.contains(said), "{said:?} is not in\n{text}");
    }
}

#[test]
fn halt_and_brake_are_asked_for_at_once_for_all_or_for_the_selected_axis() {
    let (_, mut view) = cell();
    let asked = |wish: Option<Wish>| match wish {
        Some(Wish::Ask(request, _)) => request,
        other => panic!("{other:?} asks nothing"),
    };
    let second = AxisNumber::new(2).expect("an axis");
    assert_eq!(asked(press(&mut view, KeyCode::Char('h'))), Request::Halt { axes: vec![] });
    assert_eq!(press(&mut view, KeyCode::Char('2')), None);
    assert_eq!(asked(press(&mut view, KeyCode::Char('h'))), Request::Halt { axes: vec![second] });
    assert_eq!(asked(press(&mut view, KeyCode::Char('b'))), Request::Brake { axes: vec![second] });
    assert_eq!(asked(press(&mut view, KeyCode::Char('c'))), Request::Clear { axes: vec![second] });
    for (key, request) in [
        (' ', Request::Halt { axes: vec![] }),
        ('B', Request::Brake { axes: vec![] }),
        ('C', Request::Clear { axes: vec![] }),
        ('r', Request::Resume),
    ] {
        assert_eq!(asked(press(&mut view, KeyCode::Char(key))), request);
    }
    press(&mut view, KeyCode::Esc);
    assert_eq!(asked(press(&mut view, KeyCode::Char('b'))), Request::Brake { axes: vec![] });
}

#[test]
fn arrows_stop_at_the_ends() {
    let (_, mut view) = cell();
    press(&mut view, KeyCode::Up);
    assert_eq!(view.whom(), "wrist");
    press(&mut view, KeyCode::Down);
    assert_eq!(view.whom(), "wrist");
    (0..20).for_each(|_| drop(press(&mut view, KeyCode::Up)));
    assert_eq!(view.whom(), "left_x");
}

#[test]
fn what_is_typed_into_the_filter_commands_nothing() {
    let (_, mut view) = cell();
    press(&mut view, KeyCode::Char('/'));
    for char in "qhb x".chars() {
        assert_eq!(press(&mut view, KeyCode::Char(char)), None);
    }
    press(&mut view, KeyCode::Backspace);
    press(&mut view, KeyCode::Enter);
    assert_eq!(view.filter().text, "qhb ");
    assert_eq!(press(&mut view, KeyCode::Char('q')), Some(Wish::Quit));
    press(&mut view, KeyCode::Char('/'));
    press(&mut view, KeyCode::Esc);
    assert_eq!(view.filter().text, "");
    press(&mut view, KeyCode::Char('/'));
    let interrupt = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
    assert_eq!(view.press(interrupt), Some(Wish::Quit));
}

#[test]
fn a_size_is_two_numbers() {
    assert_eq!(size("120x40").map(|size| (size.width, size.height)), Ok((120, 40)));
    for wrong in ["", "120", "0x10", "80x", "80x24x3", "1001x1", "-1x5"] {
        assert!(size(wrong).is_err(), "{wrong}");
    }
}
