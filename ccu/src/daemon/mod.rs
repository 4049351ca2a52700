//! The daemon: it makes a set out of processes, keeps it alive, and takes it down again. Who does what when somebody ends:
//!
//! | who ends unasked    | who notices                             | what happens                                         |
//! |---------------------|-----------------------------------------|------------------------------------------------------|
//! | a worker            | its watcher; silence on the bus         | all axes brake; its axis refuses to move             |
//! | the recorder        | its watcher                             | all axes brake; nothing moves without a log          |
//! | the CCU             | workers and recorder: lifeline's end    | axes brake, cards leave, the log is finished         |
//! | a client            | the control socket                      | what moves for it is halted                          |
//!
//! In order: start the recorder, then the cards, then listen to clients; stop in the opposite order, so that the log has
//! everybody's last frame. Motion and meaning are not in here: they are the executive's and the cards'.

mod exchange;
mod feed;
mod process;
pub mod recorder;
mod server;

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axis_worker::clock::{Clock, Monotonic, TimeScale};
use miette::Diagnostic;
use supersigma_config::{Config, RampError};
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{Bus, BusError};
use supersigma_protocol::{About, Activity, Address, AxisNumber, Command, Occasion, Operation, Report};
use tokio::sync::{Notify, watch};

use self::exchange::Exchange;
use self::process::Process;
use self::server::Desk;
use crate::control::{Description, DownReport};
use crate::executive::{AxisState, Heard, Knowledge};
use crate::home::{Home, HomeError, Occupied};
use crate::log::{LogSummary, WallTime};

/// How long processes may take to come to life.
const BIRTH: Duration = Duration::from_secs(20);
/// How long axes may take to stand once they have been told to halt, and then to brake.
const STANDING: Duration = Duration::from_secs(3);
/// How long a process may take to end.
const END: Duration = Duration::from_secs(5);

/// What a set is started with.
#[derive(Debug, Clone)]
pub struct Options {
    /// Where it lives.
    pub home: Home,
    /// What it is.
    pub config: Config,
    /// How fast its time runs.
    pub scale: TimeScale,
    /// Its log, which must not exist yet.
    pub log: PathBuf,
    /// The program that it is started for.
    pub script: Option<String>,
}

/// Why a set cannot be started.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum StartError {
    /// Its place.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Home(#[from] HomeError),
    /// A ramp.
    #[error(transparent)]
    Ramp(#[from] RampError),
    /// The bus.
    #[error(transparent)]
    #[diagnostic(help("is there room in /dev/shm, and may we write there?"))]
    Bus(#[from] BusError),
    /// The log is there already.
    #[error("the log {} exists already", .0.display())]
    #[diagnostic(help("a log is never overwritten: choose another name, or move the file away"))]
    LogExists(PathBuf),
    /// A file of the set.
    #[error("cannot {what}: {source}")]
    Io {
        /// What was tried.
        what: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The recorder did not come to life.
    #[error("the recorder did not come to life")]
    #[diagnostic(help("what it said stands above; the log was to be {}", log.display()))]
    NoRecorder {
        /// The log.
        log: PathBuf,
    },
    /// A card did not come to life.
    #[error("the worker of {0} did not come to life")]
    #[diagnostic(help("what it said stands above"))]
    NoWorker(Address),
}

/// A set that is up.
pub struct Daemon {
    occupied: Occupied,
    place: Place,
    bus: SharedBus,
    exchange: Arc<Exchange>,
    listening: JoinHandle<()>,
    recorder: Process,
    workers: Vec<Process>,
    /// Once set, processes end because they shall.
    leaving: Arc<AtomicBool>,
    desk: Arc<Desk>,
    serving: tokio::task::JoinHandle<()>,
    log: PathBuf,
}

impl Daemon {
    /// Starts a set. To be called within a tokio runtime; returns when all cards have joined.
    ///
    /// # Errors
    /// If something is in the way; then nothing of the set is left.
    pub fn start(options: Options) -> Result<Self, StartError> {
        let Options { home, config, scale, log, script } = options;
        let occupied = home.occupy()?;
        let place = Place::new(home.folder())?;
        let log =
            std::path::absolute(&log).map_err(|source| StartError::Io { what: "place the log", source })?;
        if log.exists() {
            return Err(StartError::LogExists(log));
        }
        let knowledge = Knowledge::new(config)?;
        write(&home.config(), &knowledge.config.to_toml())?;
        if let Some(script) = &script {
            write(&home.script(), script)?;
        }
        let bus = SharedBus::create(&place)?;
        let clock = Clock::new(Monotonic::now(), scale);
        let wall_epoch = WallTime::now();
        let (transmit, receive) = bus.ccu()?;
        let (exchange, listening) = Exchange::start(Arc::clone(&knowledge), clock, transmit, receive)?;
        let leaving = Arc::new(AtomicBool::new(false));
        let births = Births { home: &home, clock, exchange: &exchange, leaving: &leaving };
        let processes = births.recorder(wall_epoch, &log, script.is_some()).and_then(|recorder| {
            let workers = births.workers(&knowledge)?;
            let listener = server::bind(&home.socket())
                .map_err(|source| StartError::Io { what: "make the control socket", source })?;
            Ok((recorder, workers, listener))
        });
        let (recorder, workers, listener) = match processes {
            Ok(processes) => processes,
            Err(error) => {
                leaving.store(true, Ordering::Release);
                exchange.stop();
                let _ = listening.join();
                drop(bus);
                sweep(&place);
                return Err(error);
            }
        };
        let desk = Arc::new(Desk {
            describe: Box::new(describer(&home, &exchange, scale, &log)),
            exchange: Arc::clone(&exchange),
            down: Notify::new(),
            report: watch::Sender::new(None),
        });
        let serving = tokio::spawn(server::serve(listener, Arc::clone(&desk)));
        Ok(Self { occupied, place, bus, exchange, listening, recorder, workers, leaving, desk, serving, log })
    }

    /// Where it lives.
    #[must_use]
    pub fn home(&self) -> &Home {
        self.occupied.home()
    }

    /// The log.
    #[must_use]
    pub fn log(&self) -> &Path {
        &self.log
    }

    /// Its cards' processes: how many.
    #[must_use]
    pub fn workers(&self) -> usize {
        self.workers.len()
    }

    /// What resolves when a client wants the set down.
    pub fn wanted_down(&self) -> impl Future<Output = ()> + Send + use<> {
        let desk = Arc::clone(&self.desk);
        async move { desk.down.notified().await }
    }

    /// From now on nobody begins anything; whoever waits is told.
    pub fn closer(&self) -> impl Fn() + Send + Sync + use<> {
        let exchange = Arc::clone(&self.exchange);
        move || exchange.going_down()
    }

    /// Takes the set down: axes stand, cards leave, the log is finished, and nothing is left on the machine.
    pub async fn stop(mut self) -> DownReport {
        self.exchange.going_down();
        self.bring_to_a_stand();
        self.leaving.store(true, Ordering::Release);
        for worker in &mut self.workers {
            worker.ask_to_leave();
        }
        let heard = self.exchange.subscribe();
        let everybody_left = || self.exchange.cards().values().all(|life| !life.alive);
        wait_for(&heard, END, everybody_left);
        self.recorder.let_go();
        let summary = self.recorder.line(END).and_then(|line| serde_json::from_str::<LogSummary>(&line).ok());
        self.recorder.finish(END);
        for worker in &mut self.workers {
            worker.let_go();
        }
        for worker in &mut self.workers {
            worker.finish(END);
        }
        self.exchange.stop();
        let _ = self.listening.join();
        let counts = self.exchange.counts();
        let report = DownReport {
            log: self.log,
            sent: counts.commands + counts.answers + counts.lost,
            logged: summary.as_ref().map(|summary| summary.frames),
            bytes: summary.map(|summary| summary.bytes),
        };
        self.serving.abort();
        drop(self.bus);
        sweep(&self.place);
        drop(self.occupied);
        self.desk.report.send_replace(Some(report.clone()));
        // Clients that wait for the end are told before this process may end.
        let _ = tokio::time::timeout(Duration::from_secs(1), self.desk.report.closed()).await;
        report
    }

    fn bring_to_a_stand(&self) {
        let heard = self.exchange.subscribe();
        let stand = || {
            self.exchange.cards().values().all(|life| match life.report {
                Report::Axis(report) => !life.alive || report.activity == Activity::Standing,
                Report::Digital(_) => true,
            })
        };
        if stand() {
            return;
        }
        if let Err(error) = self.exchange.send(Command::new(Address::EVERYONE, Operation::Halt).into()) {
            tracing::error!(%error, "the halt command could not be sent");
        }
        if !wait_for(&heard, STANDING, stand) {
            tracing::warn!("not all axes have halted; they brake");
            self.exchange.brake_all();
            wait_for(&heard, STANDING, stand);
        }
    }
}

/// Waits until `holds`, looking whenever something is heard; says whether it does.
fn wait_for(heard: &std::sync::mpsc::Receiver<Heard>, limit: Duration, holds: impl Fn() -> bool) -> bool {
    let deadline = Instant::now() + limit;
    while !holds() {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || heard.recv_timeout(left).is_err() {
            return holds();
        }
    }
    true
}

/// What is needed to bring processes to life.
struct Births<'a> {
    home: &'a Home,
    clock: Clock,
    exchange: &'a Arc<Exchange>,
    leaving: &'a Arc<AtomicBool>,
}

impl Births<'_> {
    fn common(&self, command: &str) -> Vec<OsString> {
        let mut arguments: Vec<OsString> = vec![command.into()];
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        option("--runtime", self.home.folder().into());
        option("--config", self.home.config().into());
        option("--epoch", self.clock.epoch().as_nanos().to_string().into());
        option("--time-scale", self.clock.scale().to_string().into());
        arguments
    }

    fn recorder(&self, wall_epoch: WallTime, log: &Path, script: bool) -> Result<Process, StartError> {
        let mut arguments = self.common("recorder");
        let mut option = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        option("--set", self.home.name().to_string().into());
        option("--wall-epoch", wall_epoch.0.to_string().into());
        option("--log", log.into());
        if script {
            option("--script", self.home.script().into());
        }
        let (exchange, leaving) = (Arc::clone(self.exchange), Arc::clone(self.leaving));
        let recorder = Process::start(arguments, move |status| {
            if !leaving.load(Ordering::Acquire) {
                tracing::error!(%status, "the recorder has ended; all axes brake");
                exchange.no_log();
            }
        });
        let recorder = recorder.map_err(|source| StartError::Io { what: "start the recorder", source })?;
        match recorder.line(BIRTH) {
            Some(line) if line == recorder::READY => Ok(recorder),
            _ => Err(StartError::NoRecorder { log: log.to_owned() }),
        }
    }

    /// Starts all cards at once, and waits until all have joined.
    fn workers(&self, knowledge: &Knowledge) -> Result<Vec<Process>, StartError> {
        let heard = self.exchange.subscribe();
        let axes = knowledge.config.axes.iter().map(|axis| axis.address.address());
        let mut missing: Vec<Address> = axes.chain([Address::DIGITAL_INPUT]).collect();
        let mut workers = Vec::with_capacity(missing.len());
        for card in &missing {
            workers.push(self.worker(*card)?);
        }
        let deadline = Instant::now() + BIRTH;
        while let Some(first) = missing.first().copied() {
            match heard.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Heard::Answer(answer)) if answer.about == About::Unasked(Occasion::Joined) => {
                    missing.retain(|card| *card != answer.card);
                }
                Ok(Heard::WorkerGone(card)) => return Err(StartError::NoWorker(card)),
                Ok(_) => {}
                Err(_) => return Err(StartError::NoWorker(first)),
            }
        }
        Ok(workers)
    }

    fn worker(&self, card: Address) -> Result<Process, StartError> {
        let mut arguments = self.common("axis-worker");
        arguments.extend(["--card".into(), card.0.to_string().into()]);
        let (exchange, leaving) = (Arc::clone(self.exchange), Arc::clone(self.leaving));
        let worker = Process::start(arguments, move |status| {
            if !leaving.load(Ordering::Acquire) {
                tracing::error!(%card, %status, "a worker has ended; all axes brake");
                exchange.worker_gone(card);
            }
        });
        worker.map_err(|source| StartError::Io { what: "start a worker", source })
    }
}

fn describer(
    home: &Home,
    exchange: &Arc<Exchange>,
    scale: TimeScale,
    log: &Path,
) -> impl Fn() -> Description + Send + Sync + use<> {
    let (name, log, exchange) = (home.name().to_string(), log.to_owned(), Arc::clone(exchange));
    let since = Instant::now();
    move || {
        let cards = exchange.cards();
        let axis = |axis: AxisNumber| match cards.get(&axis.address()) {
            Some(life) if life.alive => match life.report {
                Report::Axis(report) => Some(report),
                Report::Digital(_) => None,
            },
            _ => None,
        };
        let config = &exchange.knowledge().config;
        let counts = exchange.counts();
        Description {
            name: name.clone(),
            pid: std::process::id(),
            config: config.to_toml(),
            time_scale: scale.get(),
            log: log.clone(),
            log_bytes: fs::metadata(&log).ok().map(|file| file.len()),
            up_s: since.elapsed().as_secs_f64(),
            axes: config
                .axes
                .iter()
                .map(|one| AxisState { axis: one.address, report: axis(one.address) })
                .collect(),
            digital: cards
                .get(&Address::DIGITAL_INPUT)
                .filter(|life| life.alive)
                .map_or_else(Vec::new, |_| vec![Address::DIGITAL_INPUT, Address::DIGITAL_OUTPUT]),
            inputs: exchange.word(Address::DIGITAL_INPUT),
            outputs: exchange.word(Address::DIGITAL_OUTPUT),
            frames: counts.commands + counts.answers,
            lost: counts.lost,
            recording: !exchange.is_without_log(),
        }
    }
}

fn write(path: &Path, text: &str) -> Result<(), StartError> {
    fs::write(path, text).map_err(|source| StartError::Io { what: "write into the runtime folder", source })
}

fn sweep(place: &Place) {
    if let Err(error) = SharedBus::sweep(place) {
        tracing::warn!(%error, "something of the bus is left on the machine");
    }
}
