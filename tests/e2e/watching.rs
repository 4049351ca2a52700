//! Watching a set: the dashboard on a terminal, the table that is drawn again and again, watchers that do not read.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;

use serde_json::Value;
use supersigma_tests::{Cell, Process, Signal, Terminal, eventually};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

fn dashboard(cell: &Cell) -> Terminal {
    Terminal::start(cell.command(&["monitor"]), 100, 30)
}

fn process(terminal: &Terminal) -> Process {
    Process { pid: terminal.pid(), arguments: vec![] }
}

#[test]
fn the_dashboard_shows_a_movement_and_gives_the_terminal_back() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let mut terminal = dashboard(&cell);
    terminal.shows("recording");
    assert!(terminal.is_taken());
    terminal.shows("left_gripper");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 1234").done();
    terminal.shows("1234");
    // The frames' pane has the command and its answer.
    terminal.shows("Move +1234");
    terminal.press("?");
    terminal.shows("resume what was halted");
    terminal.press("q");
    assert_eq!(terminal.end().code(), Some(0));
    eventually("the shell's screen", || (!terminal.is_taken()).then_some(()));
    assert_eq!(cell.down(), None);
}

#[test]
fn keys_halt_brake_and_clear() {
    let cell = Cell::new(EXE);
    let _up = cell.up("1");
    cell.ccu("origin wrist").done();
    let mut terminal = dashboard(&cell);
    terminal.shows("recording");
    let moving = cell.start("move wrist 6000 --speed 1000");
    terminal.shows("cruising");
    terminal.press("h");
    let ran = moving.end();
    ran.fails(1, &["axis 7 (wrist) was stopped", "`ccu resume`"]);
    terminal.shows("halt all axes: done");
    terminal.press("7b");
    terminal.shows("braked on command");
    terminal.press("c");
    terminal.shows("clear wrist: done");
    cell.until("wrist", "cleared", |axis| axis["alarm"].is_null());
    let position = cell.axis("wrist")["position"].as_i64().expect("originated");
    assert!((1..6000).contains(&position), "{position}");
    terminal.press("\u{3}");
    assert_eq!(terminal.end().code(), Some(0));
    assert_eq!(cell.down(), None);
}

#[test]
fn a_signal_gives_the_terminal_back() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    for arguments in [&["monitor"][..], &["status", "--watch"]] {
        let mut terminal = Terminal::start(cell.command(arguments), 100, 30);
        terminal.shows("frames/s");
        assert!(terminal.is_taken());
        process(&terminal).signal(Signal::TERM);
        assert_eq!(terminal.end().code(), Some(0));
        eventually("the shell's screen", || (!terminal.is_taken()).then_some(()));
    }
    assert_eq!(cell.down(), None);
}

#[test]
fn the_dashboard_waits_for_a_set_that_has_gone() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    let mut terminal = dashboard(&cell);
    terminal.shows("recording");
    // The dashboard is a process of this cell, and stays.
    let _ = cell.ccu("down").good();
    terminal.shows("DOWN; waiting");
    std::fs::remove_file(&up.log).expect("a log is there");
    let _up = cell.up("20");
    eventually("the set on the screen again", || (!terminal.screen().contains("DOWN")).then_some(()));
    cell.ccu("origin wrist").done();
    terminal.shows("Originate");
    let _ = cell.ccu("down").good();
    terminal.shows("DOWN; waiting");
    terminal.press("q");
    assert_eq!(terminal.end().code(), Some(3));
    cell.assert_nothing_left();
}

#[test]
fn without_a_terminal_or_a_set_it_says_so() {
    let cell = Cell::new(EXE);
    cell.ccu("monitor --once").fails(3, &["no set named \"cell\" is up"]);
    let _up = cell.up("20");
    cell.ccu("monitor").fails(2, &["the dashboard needs a terminal", "`ccu status`"]);
    cell.ccu("monitor --once --size 5").fails(2, &["120x40"]);
    let ran = cell.ccu("monitor --once --size 100x30").good();
    assert_eq!(ran.stdout.lines().count(), 30);
    assert!(ran.stdout.contains("frames/s") && ran.stdout.contains("right_z"), "{ran}");
    assert_eq!(cell.down(), None);
}

#[test]
fn a_table_that_is_watched_through_a_pipe_comes_again_after_an_empty_line() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    cell.ccu("origin wrist").done();
    let mut watching = cell.start("status --watch");
    watching.says(" frames/s, ");
    watching.signal(Signal::TERM);
    let ran = watching.end().good();
    assert!(!ran.stdout.contains('\u{1b}'), "{ran}");
    let titles: Vec<usize> = ran
        .stdout
        .lines()
        .enumerate()
        .filter(|(_, line)| line.contains("X1..X5"))
        .map(|(at, _)| at)
        .collect();
    // Title, seven axes, empty line, two lines of the set, empty line.
    assert_eq!(titles[..2], [0, 12], "{ran}");
    for line in ran.stdout.lines().filter(|line| !line.starts_with("log ")) {
        assert!(line.chars().count() <= 80, "{line:?}");
    }
    let wrist = cell.axis("wrist");
    assert_eq!((&wrist["speed"], &wrist["position"]), (&Value::from(0.0), &Value::from(0)));
    assert_eq!(cell.down(), None);
}

/// A client of the control socket that asks to watch.
fn watcher(cell: &Cell) -> BufReader<UnixStream> {
    let mut stream = UnixStream::connect(cell.runtime().join("control.sock")).expect("the set is up");
    stream.write_all(b"\"watch\"\n").expect("it listens");
    BufReader::new(stream)
}

fn next(watcher: &mut impl BufRead) -> Value {
    let mut line = String::new();
    watcher.read_line(&mut line).expect("it speaks");
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error} in {line:?}"))
}

#[test]
fn a_watcher_that_does_not_read_misses_frames_and_holds_up_nobody() {
    let cell = Cell::new(EXE);
    let _up = cell.up("50");
    let mut lazy = watcher(&cell);
    assert!(next(&mut lazy)["description"].is_object());
    let mut stopped = dashboard(&cell);
    stopped.shows("recording");
    process(&stopped).signal(Signal::STOP);
    let gone = watcher(&cell);
    drop(gone);
    let frames = || {
        let text = cell.ccu("status").good().stdout;
        let line =
            text.lines().find(|line| line.contains(" frames, ")).map(str::to_owned).expect("the set's line");
        assert!(line.ends_with(" 0 lost"), "{line}");
        let words: Vec<&str> = line.split(' ').collect();
        let at = words.iter().position(|word| *word == "frames,").expect("frames");
        words[at - 1].parse::<u64>().expect("a number")
    };
    cell.ccu("origin").done();
    // The socket's buffer takes some thousand frames, the ring four thousand.
    while frames() < 15_000 {
        cell.ccu("line left_x=6000 left_y=5000 right_x=6000 right_y=5000 wrist=5000").done();
        cell.ccu("line left_x=-6000 left_y=-5000 right_x=-6000 right_y=-5000 wrist=-5000").done();
    }
    // First what the socket had room for; somewhere behind it the gap.
    while next(&mut lazy)["overheard"]["dropped"].as_u64().is_none_or(|dropped| dropped == 0) {}
    process(&stopped).signal(Signal::CONT);
    stopped.shows("not seen here");
    stopped.press("q");
    assert_eq!(stopped.end().code(), Some(0));
    drop(lazy);
    // Everything is in the log all the same.
    assert_eq!(cell.down(), None);
}

#[test]
fn a_program_on_a_terminal_shows_how_far_it_is() {
    let cell = Cell::new(EXE);
    let program = cell
        .file("p.rhai", "origin(\"wrist\"); for i in 0..4 { move_by(\"wrist\", 500); print(`lap ${i}`); }");
    let arguments = ["run", "--time-scale", "1", "--config", "cell.toml", "--log", "p.mcap"];
    let mut command = cell.command(&arguments);
    command.arg(&program);
    let mut terminal = Terminal::start(command, 100, 30);
    terminal.shows("/5 movements, ");
    terminal.shows("left");
    assert_eq!(terminal.end().code(), Some(0));
    terminal.shows("5 movements, 2");
    let screen = terminal.screen();
    assert!(!screen.contains("/5 movements"), "{screen}");
    for lap in 0..4 {
        assert!(screen.lines().any(|line| line.trim_end() == format!("lap {lap}")), "{screen}");
    }
    cell.assert_nothing_left();
}
