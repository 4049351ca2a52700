//! The daemon: it makes a set out of processes, keeps it alive, and takes it down again. Who does what when somebody ends:
//!
//! | who ends unasked    | who notices                             | what happens                                         |
//! |---------------------|-----------------------------------------|------------------------------------------------------|
//! | a worker            | its watcher; silence on the bus         | all axes brake; its axis refuses to move             |
//! | the recorder        | its watcher                             | all axes brake; nothing moves without a log          |
//! | the live view       | its watcher                             | nothing but a warning: it is for looking             |
//! | the CCU             | the others: their lifelines' ends       | axes brake, cards leave, the log is finished         |
//! | a client            | the control socket                      | what moves for it is halted                          |
//!
//! In order: start the recorder, then the cards, then listen to clients; stop in the opposite order, so that the log has
//! everybody's last frame. Motion and meaning are not in here: they are the executive's and the cards'.

mod births;
mod exchange;
mod feed;
pub mod foxglove;
mod keeper;
mod lifeline;
pub mod listener;
mod members;
mod members_tap;
mod process;
pub mod recorder;
mod recording;
mod scribe;
mod server;
mod telling;

use std::fs;
use std::io;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axis_worker::clock::{Clock, Monotonic, TimeScale};
use miette::Diagnostic;
use supersigma_config::{Config, RampError};
use supersigma_protocol::bus::shared_memory::{Place, SharedBus};
use supersigma_protocol::bus::{Bus, BusError};
use supersigma_protocol::{Activity, Address, AxisNumber, Command, Operation, Report};
use tokio::sync::{Notify, watch};

use self::births::{Births, Leaving};
use self::exchange::Exchange;
pub use self::exchange::LiveLink;
use self::foxglove::ViewAddress;
use self::keeper::Keeper;
use self::members::Members;
use self::process::Process;
use self::recording::Recording;
use self::scribe::Scribe;
use self::server::Desk;
use crate::control::{Description, DownReport};
use crate::executive::{AxisState, Heard, Knowledge, LogTrouble};
use crate::home::{Home, HomeError, Occupied};
use crate::log::WallTime;

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
    /// Where a live view of it is served, if it is to be.
    pub foxglove: Option<ViewAddress>,
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
    #[diagnostic(help("{}", advice(.0)))]
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
    /// The log cannot be begun.
    #[error("{}", .0.reason)]
    #[diagnostic(help("{}", .0.advice))]
    NoLog(LogTrouble),
    /// The recorder did not come to life.
    #[error("the recorder did not come to life")]
    #[diagnostic(help("what it said stands above; the log was to be {}", log.display()))]
    NoRecorder {
        /// The log.
        log: PathBuf,
    },
    /// The live view did not come to life.
    #[error("the Foxglove server at {0} did not come to life")]
    #[diagnostic(help("what it said stands above; the set works without it too"))]
    NoView(ViewAddress),
    /// This program was built without it.
    #[error(transparent)]
    #[diagnostic(transparent)]
    NoFoxglove(#[from] foxglove::NotBuilt),
    /// A card did not come to life.
    #[error("the worker of {0} did not come to life")]
    #[diagnostic(help("what it said stands above"))]
    NoWorker(Address),
}

fn advice(error: &BusError) -> &'static str {
    match error {
        BusError::NoRoom { .. } => {
            "look with `df -h /dev/shm` and `df -i /dev/shm`; remove what is not needed there, or make it larger: \
             `mount -o remount,size=256M /dev/shm`, in a container `--shm-size=256m`"
        }
        _ => {
            "is there room in /dev/shm and in the runtime folder (`df -h`, `df -i`), and may we write there? \
             XDG_RUNTIME_DIR says where runtime folders are"
        }
    }
}

/// A live view that is being served.
struct View {
    process: Process,
    /// Where, as viewers want it.
    url: String,
}

/// A set that is up.
pub struct Daemon {
    occupied: Occupied,
    place: Place,
    bus: SharedBus,
    exchange: Arc<Exchange>,
    listening: JoinHandle<()>,
    recorder: Scribe,
    workers: Arc<Keeper>,
    view: Option<View>,
    /// Once set, processes end because they shall.
    leaving: Arc<Leaving>,
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
        let Options { home, config, scale, log, script, foxglove } = options;
        foxglove::check(foxglove)?;
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
        let (transmit, receive) = bus.ccu()?;
        let members = Members::new(home.members());
        let (exchange, listening) =
            Exchange::start(Arc::clone(&knowledge), clock, members.clone(), transmit, receive)?;
        let leaving = Arc::new(Leaving::default());
        let births = Births {
            home: home.clone(),
            clock,
            wall_epoch: WallTime::now(),
            exchange: Arc::clone(&exchange),
            members,
            leaving: Arc::clone(&leaving),
            script: script.is_some(),
        };
        let axes = knowledge.config.axes.iter().map(|axis| axis.address.address());
        let cards = axes.chain([Address::DIGITAL_INPUT]).collect();
        let processes = Scribe::start(&births, &log).and_then(|recorder| {
            let workers = Keeper::start(births.clone(), cards).and_then(|workers| {
                let listener = server::bind(&home.socket());
                listener.map(|listener| (Arc::clone(&workers), listener)).map_err(|source| {
                    workers.finish(END);
                    StartError::Io { what: "make the control socket", source }
                })
            });
            let all = workers.and_then(|(workers, listener)| {
                let view = foxglove.map(|address| births.view(address)).transpose();
                let view = view.inspect_err(|_| workers.finish(END))?;
                Ok((workers, listener, view.map(|(process, url)| View { process, url })))
            });
            match all {
                Ok((workers, listener, view)) => Ok((recorder, workers, listener, view)),
                Err(error) => {
                    recorder.finish(END);
                    Err(error)
                }
            }
        });
        let (recorder, workers, listener, view) = match processes {
            Ok(processes) => processes,
            Err(error) => {
                leaving.set();
                exchange.stop();
                let _ = listening.join();
                drop(bus);
                sweep(&place);
                return Err(error);
            }
        };
        let desk = Arc::new(Desk {
            describe: Box::new(describer(&births, &log, recorder.recording(), &workers, view.as_ref())),
            exchange: Arc::clone(&exchange),
            down: Notify::new(),
            report: watch::Sender::new(None),
        });
        let serving = tokio::spawn(server::serve(listener, Arc::clone(&desk)));
        let name = home.name();
        tracing::info!(%name, cards = workers.cards(), time_scale = scale.get(), "the set is up");
        Ok(Self {
            occupied,
            place,
            bus,
            exchange,
            listening,
            recorder,
            workers,
            view,
            leaving,
            desk,
            serving,
            log,
        })
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

    /// Where a live view of it is served.
    #[must_use]
    pub fn foxglove(&self) -> Option<&str> {
        self.view.as_ref().map(|view| view.url.as_str())
    }

    /// Its cards' processes: how many.
    #[must_use]
    pub fn workers(&self) -> usize {
        self.workers.cards()
    }

    /// What resolves when a client wants the set down.
    pub fn wanted_down(&self) -> impl Future<Output = ()> + Send + use<> {
        let desk = Arc::clone(&self.desk);
        async move { desk.down.notified().await }
    }

    /// A link for an executive in this process. It hears everything from now on, until `cancelled` is set.
    #[must_use]
    pub fn link(&self, cancelled: Arc<AtomicBool>) -> LiveLink {
        self.exchange.link(cancelled)
    }

    /// From now on nobody begins anything; whoever waits is told.
    pub fn closer(&self) -> impl Fn() + Send + Sync + use<> {
        let exchange = Arc::clone(&self.exchange);
        move || exchange.going_down()
    }

    /// Takes the set down: axes stand, cards leave, the log is finished, and nothing is left on the machine.
    pub async fn stop(mut self) -> DownReport {
        tracing::info!("the set goes down");
        self.exchange.going_down();
        self.bring_to_a_stand();
        self.leaving.set();
        self.workers.ask_to_leave();
        let heard = self.exchange.subscribe();
        let everybody_left = || self.exchange.cards().values().all(|life| !life.alive);
        wait_for(&heard, END, everybody_left);
        let summary = self.recorder.finish(END);
        if let Some(view) = &mut self.view {
            view.process.finish(END);
        }
        self.workers.finish(END);
        self.exchange.stop();
        let _ = self.listening.join();
        let counts = self.exchange.counts();
        let report = DownReport {
            log: self.log,
            sent: counts.commands + counts.answers + counts.lost,
            logged: summary.as_ref().map(|summary| summary.frames),
            lost: summary.as_ref().map(|summary| summary.lost),
            bytes: summary.as_ref().map(|summary| summary.bytes),
            parts: summary.map_or_else(|| self.recorder.recording().view().parts, |summary| summary.parts),
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

fn describer(
    births: &Births,
    log: &Path,
    recording: &Recording,
    workers: &Arc<Keeper>,
    view: Option<&View>,
) -> impl Fn() -> Description + Send + Sync + use<> {
    let (name, scale) = (births.home.name().to_string(), births.clock.scale());
    let (exchange, log) = (Arc::clone(&births.exchange), log.to_owned());
    let (recording, workers) = (recording.clone(), Arc::clone(workers));
    let since = Instant::now();
    let foxglove = view.map(|view| view.url.clone());
    move || {
        let cards = exchange.cards();
        let axis = |axis: AxisNumber| match cards.get(&axis.address()) {
            Some(life) if life.alive => match life.report {
                Report::Axis(report) => Some(report),
                Report::Digital(_) => None,
            },
            _ => None,
        };
        let alive = |card: &Address| cards.get(card).is_some_and(|life| life.alive);
        let config = &exchange.knowledge().config;
        let restarts = config.supervision.restart;
        let sittings = workers.sittings().into_iter();
        let processes = sittings.map(|sitting| sitting.view(alive(&sitting.card), restarts));
        let counts = exchange.counts();
        Description {
            name: name.clone(),
            pid: std::process::id(),
            config: config.to_toml(),
            time_scale: scale.get(),
            log: log.clone(),
            foxglove: foxglove.clone(),
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
            recorder: recording.view(),
            processes: std::iter::once(recording.process()).chain(processes).collect(),
        }
    }
}

fn write(path: &Path, text: &str) -> Result<(), StartError> {
    let file = fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(path);
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|source| HomeError::Io { what: "write", path: path.to_owned(), source }.into())
}

fn sweep(place: &Place) {
    if let Err(error) = SharedBus::sweep(place) {
        tracing::warn!(%error, "something of the bus is left on the machine");
    }
}
