//! A set as a service: what `ccu up` tells the service manager that has started it, over the socket named in
//! `NOTIFY_SOCKET`, as in `sd_notify(3)`. Without such a socket nothing is told. The set itself knows nothing of it.

use std::time::Duration;

use sd_notify::NotifyState;

use crate::control::{Client, DownReport};
use crate::daemon::Daemon;
use crate::home::Home;

/// All cards have joined.
pub(super) fn ready(daemon: &Daemon) {
    let status = format!("{} cards are up; log {}", daemon.workers(), daemon.log().display());
    tell(&[NotifyState::Ready, NotifyState::Status(&status)]);
}

/// The set goes down.
pub(super) fn stopping() {
    tell(&[NotifyState::Stopping, NotifyState::Status("axes are brought to a stand, the log is finished")]);
}

/// It is down.
pub(super) fn stopped(report: &DownReport) {
    let logged = report.logged.map_or_else(|| "unknown".to_owned(), |logged| logged.to_string());
    let status = format!("down: {} frames sent, {logged} logged", report.sent);
    tell(&[NotifyState::Status(&status)]);
}

/// As long as it is polled, and if the service manager wants it: says in time, twice as often as it must, that the set is
/// well. It is well if a client is answered; so a daemon that hangs is seen from outside.
pub(super) async fn watchdog(home: Home) {
    let Some(limit) = sd_notify::watchdog_enabled().filter(|limit| !limit.is_zero()) else {
        return std::future::pending().await;
    };
    let mut times = tokio::time::interval(limit / 2);
    times.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        times.tick().await;
        let home = home.clone();
        let asked = tokio::task::spawn_blocking(move || Client::connect(&home)?.describe());
        match tokio::time::timeout(limit.max(Duration::from_secs(1)), asked).await {
            Ok(Ok(Ok(set))) => {
                let status = format!(
                    "up {:.0} s, {} frames, {} lost{}",
                    set.up_s,
                    set.frames,
                    set.lost,
                    if set.recorder.trouble.is_none() { "" } else { ", NO LOG ANY MORE" }
                );
                tell(&[NotifyState::Watchdog, NotifyState::Status(&status)]);
            }
            Ok(Ok(Err(failure))) => tracing::warn!(%failure, "the watchdog is not told that the set is well"),
            Ok(Err(error)) => tracing::warn!(%error, "the watchdog is not told that the set is well"),
            Err(_) => tracing::warn!("the set does not answer; the watchdog is not told that it is well"),
        }
    }
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(%error, "the service manager cannot be told");
    }
}
