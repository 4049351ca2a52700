//! The control socket: who connects, may ask. One task a client, one executive a client; requests of one client are
//! carried out in turn, those of different clients side by side. A client that hangs up while something moves for it
//! has that halted.

use std::io;
use std::mem;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::unix::OwnedWriteHalf;
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::{Notify, mpsc, watch};
use tokio::task;
use tokio::time::MissedTickBehavior;

use super::exchange::{Exchange, LiveLink};
use super::telling::telling;
use crate::control::{Description, DownReport, FromDaemon, Overheard, ToDaemon};
use crate::executive::{Executive, Failure, Link, Operate, Outcome, Request};

/// Of a longer line only so much is read; the rest then makes no sense and is answered so.
const LONGEST_LINE: u64 = 64 * 1024;

/// How often a watcher is told what does not stand in frames, and an executive that nobody asks takes note of what it hears.
const FACTS: Duration = Duration::from_secs(1);
/// How long frames are gathered for a watcher before they go to it together, and how many at most.
const GATHERING: Duration = Duration::from_millis(20);
const AT_ONCE: usize = 1_024;

/// What the clients' tasks share.
pub(super) struct Desk {
    /// The bus.
    pub(super) exchange: Arc<Exchange>,
    /// Tells about the set.
    pub(super) describe: Box<dyn Fn() -> Description + Send + Sync>,
    /// Raised when a client wants the set down.
    pub(super) down: Notify,
    /// The last words, once they are known.
    pub(super) report: watch::Sender<Option<DownReport>>,
}

/// Makes the control socket, for its owner alone.
///
/// # Errors
/// If the socket cannot be made.
pub(super) fn bind(path: &Path) -> io::Result<UnixListener> {
    let listener = UnixListener::bind(path)?;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
    Ok(listener)
}

/// Serves clients for as long as the listener lives.
pub(super) async fn serve(listener: UnixListener, desk: Arc<Desk>) {
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                let desk = Arc::clone(&desk);
                task::spawn(async move {
                    if let Err(error) = attend(stream, desk).await {
                        tracing::debug!(%error, "a client is gone");
                    }
                });
            }
            Err(error) => {
                tracing::warn!(%error, "a client could not be let in");
                tokio::time::sleep(std::time::Duration::from_millis(50)).await;
            }
        }
    }
}

async fn attend(stream: UnixStream, desk: Arc<Desk>) -> io::Result<()> {
    let (read, mut write) = stream.into_split();
    let cancelled = Arc::new(AtomicBool::new(false));
    let mut executive = Executive::new(desk.exchange.link(Arc::clone(&cancelled)));
    let hung_up = Arc::clone(&cancelled);
    // Lines are read while a request is being carried out, so that the end of the connection is seen at once.
    let (lines, mut next) = mpsc::channel(1);
    let reading = task::spawn(async move {
        let mut read = BufReader::new(read);
        let mut line = Vec::new();
        loop {
            line.clear();
            let length = (&mut read).take(LONGEST_LINE).read_until(b'\n', &mut line).await.unwrap_or(0);
            if length == 0 || lines.send(line.clone()).await.is_err() {
                break;
            }
        }
        cancelled.store(true, Ordering::Release);
    });
    let mut idle = tokio::time::interval(FACTS);
    idle.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let line = tokio::select! {
            biased;
            line = next.recv() => match line {
                Some(line) => line,
                None => break,
            },
            // An executive keeps what it hears until it is asked, and people may think for hours.
            _ = idle.tick() => {
                if executive.catch_up() == Err(Failure::Cancelled) {
                    // This is about the request that may just have come.
                    hung_up.store(true, Ordering::Release);
                }
                continue;
            }
        };
        let answer = match serde_json::from_slice(&line) {
            Ok(ToDaemon::Do(request)) => {
                let (back, answer) =
                    task::spawn_blocking(move || carry_out(executive, request, Executive::operate)).await?;
                executive = back;
                answer
            }
            Ok(ToDaemon::DoOrWait(request)) => {
                let how = Executive::operate_or_wait;
                let (back, answer) = task::spawn_blocking(move || carry_out(executive, request, how)).await?;
                executive = back;
                answer
            }
            Ok(ToDaemon::Describe) => {
                // One who only looks never asks the executive, which would keep all that it hears. What goes wrong with
                // movements is told to whoever waits for them.
                let _ = executive.catch_up();
                FromDaemon::Description(Box::new((desk.describe)()))
            }
            Ok(ToDaemon::Watch) => {
                // What an executive hears, it keeps until it is asked; this one never will be.
                drop(executive);
                let result = show(&desk, &mut write, &mut next).await;
                reading.abort();
                return result;
            }
            Ok(ToDaemon::Down) => take_down(&desk).await,
            Err(error) => FromDaemon::Failed(Failure::Control { reason: error.to_string() }),
        };
        if let Err(error) = send(&mut write, &answer).await {
            tracing::debug!(%error, "a client does not hear its answer");
            break;
        }
    }
    reading.abort();
    // Whoever began something and is gone does not wait for it any more.
    executive.abandon();
    Ok(())
}

/// Shows a client everything that goes by, until it hangs up or the set is down. One that does not read holds up nobody
/// but this task: what it misses meanwhile is counted.
async fn show(
    desk: &Desk,
    write: &mut OwnedWriteHalf,
    hung_up: &mut mpsc::Receiver<Vec<u8>>,
) -> io::Result<()> {
    let Some(mut feed) = desk.exchange.overhear() else { return Ok(()) };
    let mut facts = tokio::time::interval(FACTS);
    facts.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut news = Overheard::default();
    loop {
        tokio::select! {
            line = hung_up.recv() => if line.is_none() { return Ok(()) },
            _ = facts.tick() => {
                send(write, &FromDaemon::Description(Box::new((desk.describe)()))).await?;
            }
            heard = feed.recv() => {
                match heard {
                    Ok(frame) => news.frames.push(frame.into()),
                    Err(RecvError::Lagged(missed)) => news.dropped += missed,
                    Err(RecvError::Closed) => return Ok(()),
                }
                // Together with what comes soon: a watcher that draws for people need not wake for every frame.
                tokio::time::sleep(GATHERING).await;
                while news.frames.len() < AT_ONCE {
                    match feed.try_recv() {
                        Ok(frame) => news.frames.push(frame.into()),
                        Err(TryRecvError::Lagged(missed)) if news.frames.is_empty() => news.dropped += missed,
                        // What was missed, was missed after these.
                        Err(TryRecvError::Lagged(missed)) => {
                            let whole = mem::take(&mut news);
                            news.dropped = missed;
                            send(write, &FromDaemon::Overheard(whole)).await?;
                        }
                        Err(TryRecvError::Empty | TryRecvError::Closed) => break,
                    }
                }
                send(write, &FromDaemon::Overheard(mem::take(&mut news))).await?;
            }
        }
    }
}

fn carry_out(
    mut executive: Executive<LiveLink>,
    request: Request,
    how: impl FnOnce(&mut Executive<LiveLink>, Request) -> Result<Outcome, Failure>,
) -> (Executive<LiveLink>, FromDaemon) {
    let caught_up = executive.catch_up();
    let watched = !request.is_unwatched() && !matches!(request, Request::Begin { .. });
    let what = telling(&request, executive.link().knowledge());
    if let Some(what) = &what {
        tracing::info!("{what}: begun");
    }
    let result = caught_up.and_then(|()| how(&mut executive, request));
    match (&what, &result) {
        (Some(what), Ok(_)) if watched => tracing::info!("{what}: done"),
        (Some(what), Err(failure)) => tracing::info!("{what}: {failure}"),
        _ => {}
    }
    let answer = match result {
        Ok(outcome) => FromDaemon::Done(outcome),
        Err(failure) => FromDaemon::Failed(failure),
    };
    (executive, answer)
}

async fn take_down(desk: &Desk) -> FromDaemon {
    let mut report = desk.report.subscribe();
    desk.down.notify_one();
    match report.wait_for(Option::is_some).await {
        Ok(report) => report.clone().map_or(FromDaemon::Done(Outcome::Done), FromDaemon::Down),
        Err(_) => FromDaemon::Done(Outcome::Done),
    }
}

async fn send(write: &mut OwnedWriteHalf, answer: &FromDaemon) -> io::Result<()> {
    let mut line = serde_json::to_vec(answer)?;
    line.push(b'\n');
    write.write_all(&line).await
}
