//! `ccu replay --bus`: the recorded commands and faults on a live bus again. The set must be what the recorded one was when
//! its log began: of the same configuration, and just switched on.

use std::collections::BTreeMap;
use std::io::{self, Write};

use axis_worker::clock::TimeScale;
use miette::{IntoDiagnostic, miette};
use serde::Serialize;
use supersigma_config::Config;
use supersigma_protocol::{
    About, Activity, Address, Alarm, AxisNumber, AxisReport, Body, Command, Occasion, Report, Sender, Tick,
};

use super::{Nothing, ReplayArgs, Speed, config_of, log_error};
use crate::cli::asked::Asked;
use crate::cli::exit::Exit;
use crate::cli::{set, show};
use crate::control::Client;
use crate::daemon::{Daemon, Options};
use crate::executive::{Again, AxisState, Failure, Operate, Outcome, Request, Sent};
use crate::home::Home;
use crate::log::{LogHeader, LogReader};

/// So many frames go to the daemon at once; a line of its socket is bounded.
const AT_ONCE: usize = 64;

/// What is needed of a log.
struct Record {
    header: LogHeader,
    config: Config,
    frames: Vec<Again>,
    /// What each axis said last.
    last: BTreeMap<AxisNumber, AxisReport>,
    /// Alarms that it had.
    known: Vec<(AxisNumber, Alarm)>,
    truncated: bool,
}

impl Record {
    fn read(args: &ReplayArgs) -> Result<Self, Exit> {
        let mut reader = LogReader::open(&args.log).map_err(log_error)?;
        let header = reader.header().cloned().ok_or_else(|| Exit::with_code(2, Nothing(args.log.clone())))?;
        let config = config_of(&args.log, &header)?;
        let mut record =
            Self { header, config, frames: vec![], last: BTreeMap::new(), known: vec![], truncated: false };
        let mut end = Tick(0);
        for logged in reader.by_ref() {
            let Ok(frame) = logged.map_err(log_error)?.frame else { continue };
            match frame.body {
                Body::Command(broadcast) if frame.sender == Sender::Ccu => {
                    let decoded = Command::decode(broadcast.bytes.as_slice()).ok();
                    let to =
                        decoded.filter(|command| command.operation.sets_going()).map(|command| command.to);
                    let stand =
                        record.standing(|axis| to == Some(Address::EVERYONE) || to == Some(axis.address()));
                    record.frames.push(Again { at: frame.tick, what: Sent::Command(broadcast), stand });
                }
                Body::Fault(axis, fault) => {
                    let what = Sent::Fault(axis, fault);
                    record.frames.push(Again { at: frame.tick, what, stand: vec![] });
                }
                Body::Answer(answer) => {
                    let (Report::Axis(report), Some(axis)) = (answer.report, AxisNumber::new(answer.card.0))
                    else {
                        continue;
                    };
                    // That somebody is alive, or goes, is no part of what happened.
                    if !matches!(answer.about, About::Unasked(Occasion::Heartbeat | Occasion::Leaving)) {
                        end = end.max(answer.acted_at);
                    }
                    record.last.insert(axis, report);
                    if let Some(alarm) = report.alarm.filter(|alarm| !record.known.contains(&(axis, *alarm)))
                    {
                        record.known.push((axis, alarm));
                    }
                }
                Body::Command(_) => {}
            }
        }
        record.truncated = reader.truncated();
        if record.frames.is_empty() {
            return Err(Exit::wrong(miette!("nothing was commanded in the log {}", args.log.display())));
        }
        let at = record.frames.last().map_or(end, |last| end.max(last.at));
        let stand = record.standing(|_| true);
        record.frames.push(Again { at, what: Sent::Nothing, stand });
        Ok(record)
    }

    fn standing(&self, concerned: impl Fn(AxisNumber) -> bool) -> Vec<AxisNumber> {
        let stands = |report: &AxisReport| report.activity == Activity::Standing;
        let axes = self.last.iter().filter(|(axis, report)| concerned(**axis) && stands(report));
        axes.map(|(axis, _)| *axis).collect()
    }
}

pub(super) fn bus(args: &ReplayArgs) -> Result<(), Exit> {
    let record = Record::read(args)?;
    let home = Home::of(args.set.name.clone())?;
    if record.truncated {
        eprintln!("the log ends in the middle of a record; what stands before that is put on the bus");
    }
    match Client::connect(&home) {
        Ok(_) => on_a_set_that_is_up(args, &record),
        Err(Failure::NoSet { .. }) => on_a_set_of_its_own(args, &home, &record),
        Err(failure) => Err(failure.into()),
    }
}

fn on_a_set_that_is_up(args: &ReplayArgs, record: &Record) -> Result<(), Exit> {
    let name = &args.set.name;
    if args.speed.is_some() || args.new_log.is_some() {
        return Err(Exit::wrong(miette!(
            help = format!("leave these options out, or take the set down first: `ccu down --name {name}`"),
            "set {name} is up already; --speed and --log are for a set that is started"
        )));
    }
    let mut asked = Asked::connect(&args.set)?;
    let scale = TimeScale::new(asked.description.time_scale);
    if scale.is_none_or(|scale| scale.get() > record.header.timeline.scale.get()) {
        return Err(too_fast(asked.description.time_scale, record));
    }
    same_machines(&asked.config, &record.config)?;
    just_switched_on(&mut asked)?;
    let runtime = set::runtime()?;
    let hang_up = asked.client.hang_up()?;
    let asked_to_end = {
        let _guard = runtime.enter();
        set::asked_to_end()?
    };
    runtime.spawn(async move {
        asked_to_end.await;
        hang_up();
    });
    let states = again(&mut asked.client, record)?;
    tell(args.json, record, &states)
}

fn on_a_set_of_its_own(args: &ReplayArgs, home: &Home, record: &Record) -> Result<(), Exit> {
    let recorded = record.header.timeline.scale;
    let scale = match args.speed {
        None => recorded,
        Some(Speed::Times(scale)) if scale.get() <= recorded.get() => scale,
        Some(Speed::Times(scale)) => return Err(too_fast(scale.get(), record)),
        Some(Speed::Max) => {
            return Err(Exit::wrong(miette!("a live set cannot go as fast as it can be shown")));
        }
    };
    let log = set::log_path(args.new_log.as_ref(), &args.set.name)?;
    let options = Options {
        home: home.clone(),
        config: record.config.clone(),
        scale,
        log,
        script: None,
        foxglove: None,
    };
    set::runtime()?.block_on(async {
        let asked_to_end = set::asked_to_end()?;
        let daemon = Daemon::start(options)?;
        let mut client = Client::connect(home)?;
        let hang_up = client.hang_up()?;
        let (wanted_down, closer) = (daemon.wanted_down(), daemon.closer());
        tokio::spawn(async move {
            tokio::select! {
                () = asked_to_end => hang_up(),
                () = wanted_down => closer(),
            }
        });
        let (frames, known) = (record.frames.clone(), record.known.clone());
        let running = tokio::task::spawn_blocking(move || put(&mut client, &frames, &known));
        let result = running.await.into_diagnostic().map_err(Exit::could_not)?;
        let report = daemon.stop().await;
        set::down_line(&report, &mut io::stderr())?;
        tell(args.json, record, &result?)
    })
}

fn too_fast(scale: f64, record: &Record) -> Exit {
    let recorded = record.header.timeline.scale;
    Exit::wrong(miette!(
        help = "what was timed for the recorded set, as the start of a line, would come too late",
        "time scale {scale} is faster than that of the recorded set ({recorded})"
    ))
}

/// Everything that a card is made of.
fn same_machines(live: &Config, recorded: &Config) -> Result<(), Exit> {
    let numbers = |config: &Config| config.axes.iter().map(|axis| axis.address).collect::<Vec<_>>();
    let different = if numbers(live) == numbers(recorded) {
        let pairs = live.axes.iter().zip(&recorded.axes);
        let mut differing =
            pairs.filter(|(ours, theirs)| ours != theirs || live.ramp_of(ours) != recorded.ramp_of(theirs));
        differing.next().map(|(ours, _)| format!("its axis {} is configured otherwise", ours.address.get()))
    } else {
        Some("it has other axes".to_owned())
    };
    let digital = (live.digital != recorded.digital).then(|| "its digital lines are others".to_owned());
    match different.or(digital) {
        None => Ok(()),
        Some(why) => Err(Exit::wrong(miette!(
            help = "take it down, and a set with the log's configuration is started; or name another one with --name",
            "the set is not the one that was recorded: {why}"
        ))),
    }
}

/// A log begins with a set just switched on, so what it commands makes sense to such a set only.
fn just_switched_on(asked: &mut Asked) -> Result<(), Exit> {
    let used = |state: &AxisState| match state.report {
        None => Some("has no worker any more"),
        Some(report) if report.activity != Activity::Standing => Some("is on its way"),
        Some(report) if report.alarm.is_some() => Some("is in alarm"),
        Some(report) if report.position.is_some() || report.steps.0 > 0 => Some("has moved already"),
        Some(_) => None,
    };
    let states = asked.axis_states(Request::Status { axes: vec![] })?;
    let axis = states.iter().find_map(|state| Some((state.axis, used(state)?)));
    let why = match axis {
        Some((axis, why)) => format!("{axis} {why}"),
        None if asked.word(Address::DIGITAL_OUTPUT)? != 0 => "digital outputs are on".to_owned(),
        None => return Ok(()),
    };
    let name = &asked.description.name;
    Err(Exit::could_not(miette!(
        help = format!("`ccu down --name {name}`, and a set is started for the replay"),
        "the log begins with a set just switched on, and this one is not: {why}"
    )))
}

fn again(client: &mut Client, record: &Record) -> Result<Vec<AxisState>, Failure> {
    put(client, &record.frames, &record.known)
}

/// Puts everything on the bus, and asks where the axes are then.
fn put(
    client: &mut Client,
    frames: &[Again],
    known: &[(AxisNumber, Alarm)],
) -> Result<Vec<AxisState>, Failure> {
    let mut shift = None;
    for frames in frames.chunks(AT_ONCE) {
        let request = Request::Replay { frames: frames.to_vec(), shift, known: known.to_vec() };
        if let Outcome::Replayed { shift: reached } = client.operate(request)? {
            shift = Some(reached);
        }
    }
    match client.operate(Request::Status { axes: vec![] })? {
        Outcome::Axes(states) => Ok(states),
        other => Err(Failure::Control { reason: format!("{other:?} is not the axes' state") }),
    }
}

/// An axis in the record and now, for programs.
#[derive(Debug, Serialize)]
struct EndView<'a> {
    axis: u8,
    name: &'a str,
    same: bool,
    recorded: Option<PlaceView>,
    now: Option<PlaceView>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct PlaceView {
    position: Option<i32>,
    steps: u32,
    alarm: Option<Alarm>,
}

impl From<&AxisReport> for PlaceView {
    fn from(report: &AxisReport) -> Self {
        Self {
            position: report.position.map(|position| position.0),
            steps: report.steps.0,
            alarm: report.alarm,
        }
    }
}

impl std::fmt::Display for PlaceView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.position {
            Some(position) => write!(f, "at {position}")?,
            None => f.write_str("somewhere")?,
        }
        write!(f, ", {} steps", self.steps)?;
        self.alarm.map_or(Ok(()), |alarm| write!(f, ", alarm: {alarm}"))
    }
}

fn tell(json: bool, record: &Record, states: &[AxisState]) -> Result<(), Exit> {
    let ends: Vec<_> = states
        .iter()
        .map(|state| {
            let recorded = record.last.get(&state.axis).map(PlaceView::from);
            let now = state.report.as_ref().map(PlaceView::from);
            let name = record.config.axis(state.axis).map_or("?", |axis| &axis.name);
            EndView { axis: state.axis.get(), name, same: recorded == now, recorded, now }
        })
        .collect();
    let sent = record.frames.len() - 1;
    let same = ends.iter().all(|end| end.same);
    let mut out = io::stdout().lock();
    if json {
        show::print_json(&serde_json::json!({ "frames": sent, "same": same, "axes": ends }), &mut out)?;
    } else {
        let verdict =
            if same { "all axes end as in the record" } else { "not all axes end as in the record" };
        writeln!(out, "{sent} frames put on the bus again; {verdict}")?;
        let place =
            |place: &Option<PlaceView>| place.as_ref().map_or("gone".to_owned(), PlaceView::to_string);
        for end in &ends {
            let mark = if end.same { "=" } else { "≠" };
            writeln!(
                out,
                "{:>4} {:<12} {mark} {}{}",
                end.axis,
                end.name,
                place(&end.now),
                if end.same { String::new() } else { format!("   recorded {}", place(&end.recorded)) }
            )?;
        }
    }
    if same { Ok(()) } else { Err(Exit::silent(1)) }
}
