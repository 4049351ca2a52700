//! What a command costs until its answer is there, as the CCU's own exchange makes it, with all cards and the recorder up;
//! beside it the bare round trip between two processes, through iceoryx2 and through sockets. All take turns, so that a
//! busy moment of the machine hits them alike.

use std::error::Error;
use std::time::{Duration, Instant};

use ccu::daemon::LiveLink;
use ccu::executive::{Heard, Link};
use supersigma_config::Config;
use supersigma_protocol::{About, AxisNumber, Command, Operation, Tick};

use crate::figure::Figure;
use crate::live::LiveSet;
use crate::peers::Peer;
use crate::ping::{SharedMemory, Sockets};
use crate::span::{TOLD, Times};

const ROOM: &str = "bus";
const BARE: &str = "iceoryx2 alone";
const SOCKET: &str = "datagram sockets";
const ROUNDS: usize = 40;
/// Round trips of each kind in one round.
const TRIPS: usize = 250;
/// At the beginning of each round, to have everybody awake; not measured.
const FIRST: usize = 10;

type Failed = Box<dyn Error>;

/// All that is measured, in the same order in every round.
struct Sides {
    bare: Times,
    socket: Times,
    /// One card again and again.
    one: Times,
    /// One card after the other.
    turns: Times,
}

pub(crate) fn measure() -> Result<Vec<Figure>, Failed> {
    let folder = tempfile::Builder::new().prefix("ssb").tempdir_in("/tmp")?;
    let set = LiveSet::up(folder.path(), "bus", Config::default_set())?;
    let mut figures = Vec::new();
    let mut link = set.link();
    for (busy, machine) in [(false, "idle"), (true, "busy")] {
        let hogs = if busy { Peer::everywhere()? } else { Vec::new() };
        let place = folder.path().join(machine);
        std::fs::create_dir(&place)?;
        let sides = sides(&place, &mut link)?;
        SharedMemory::sweep(&place)?;
        drop(hogs);
        figures.extend(told(machine, sides));
    }
    drop(link);
    let report = set.down();
    if report.lost != Some(0) {
        return Err(format!("the log lacks frames: {report:?}").into());
    }
    Ok(figures)
}

fn sides(place: &std::path::Path, link: &mut LiveLink) -> Result<Sides, Failed> {
    let (mut bare, _far) = SharedMemory::pair(place)?;
    let (mut socket, _other) = Sockets::pair(place)?;
    let axes: Vec<AxisNumber> = AxisNumber::all().collect();
    let mut sides = Sides {
        bare: Times::default(),
        socket: Times::default(),
        one: Times::default(),
        turns: Times::default(),
    };
    for _ in 0..ROUNDS {
        trips(&mut sides.bare, |_| bare.trip())?;
        trips(&mut sides.socket, |_| socket.trip())?;
        // What was said while the others were measured.
        while link.hear(Tick(0))?.is_some() {}
        trips(&mut sides.one, |_| ask(link, axes[0]))?;
        trips(&mut sides.turns, |number| ask(link, axes[number % axes.len()]))?;
    }
    Ok(sides)
}

fn trips(times: &mut Times, mut trip: impl FnMut(usize) -> Result<Duration, Failed>) -> Result<(), Failed> {
    for number in 0..FIRST + TRIPS {
        let time = trip(number)?;
        if number >= FIRST {
            times.add(time);
        }
    }
    Ok(())
}

/// From the question how it is with an axis to its card's answer.
fn ask(link: &mut LiveLink, axis: AxisNumber) -> Result<Duration, Failed> {
    let patience = link.ticks(Duration::from_secs(5));
    let began = Instant::now();
    let question = link.send(Command::new(axis.address(), Operation::Status).into())?;
    let until = link.now() + patience;
    loop {
        match link.hear(until)? {
            Some(Heard::Answer(answer)) if matches!(answer.about, About::Command(of, _) if of == question) => {
                return Ok(began.elapsed());
            }
            Some(_) => {}
            None => return Err(format!("axis {axis} does not answer").into()),
        }
    }
}

fn told(machine: &str, mut sides: Sides) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (name, share) in TOLD {
        let (bare, socket) = (sides.bare.share(share), sides.socket.share(share));
        let figure = |what: &str, value| Figure::new(ROOM, format!("{what}, {machine}, {name}"), value, "µs");
        figures.push(figure(BARE, bare));
        figures.push(figure(SOCKET, socket));
        for (what, times) in [
            ("command to answer, one card", &mut sides.one),
            ("command to answer, cards in turn", &mut sides.turns),
        ] {
            let to_bare = figure(what, times.share(share)).against(BARE, bare);
            figures.push(match name {
                "p50" => to_bare.ratio_at_most(1.3),
                "p99" => to_bare.ratio_at_most(2.0),
                _ => to_bare,
            });
            if name == "p50" {
                figures.push(figure(what, times.share(share)).against(SOCKET, socket).ratio_at_most(1.0));
            }
        }
    }
    figures
}
