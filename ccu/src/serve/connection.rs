//! Connections: how many, how slow they may be, and how they end. What is asked on them is `routes`' business.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_io_timeout::TimeoutStream;

use super::Limits;

/// How much a browser may leave unread in the system, and in the server, before it counts as slow. It is then told newer
/// things, not all the old ones.
const UNREAD: u32 = 128 * 1024;
const UNREAD_HERE: usize = 64 * 1024;

/// How many connections may wait to be let in.
const BACKLOG: u32 = 64;

/// Listens there.
pub(super) fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // A server that is started again need not wait for the last one's connections.
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(UNREAD)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Serves until `asked_to_end`, then calls `ending`, lets nobody in any more, and gives answers time to be read.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    limits: &Limits,
    asked_to_end: impl Future<Output = ()>,
    ending: impl FnOnce(),
) {
    let slots = Arc::new(Semaphore::new(limits.connections));
    let graceful = GracefulShutdown::new();
    let mut asked_to_end = std::pin::pin!(asked_to_end);
    loop {
        let accepted = async {
            let slot = Arc::clone(&slots).acquire_owned().await.map_err(io::Error::other)?;
            Ok::<_, io::Error>((slot, listener.accept().await?))
        };
        tokio::select! {
            () = &mut asked_to_end => break,
            accepted = accepted => match accepted {
                Ok((slot, (stream, peer))) => {
                    let _ = stream.set_nodelay(true);
                    let mut stream = Box::pin(TimeoutStream::new(stream));
                    stream.as_mut().set_write_timeout_pinned(Some(limits.stalled));
                    let connection = http1::Builder::new()
                        .timer(TokioTimer::new())
                        .header_read_timeout(limits.head)
                        .max_buf_size(UNREAD_HERE)
                        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router.clone()));
                    let connection = graceful.watch(connection);
                    tokio::spawn(async move {
                        if let Err(error) = connection.await {
                            tracing::debug!(%peer, %error, "a browser is gone");
                        }
                        drop(slot);
                    });
                }
                Err(error) => {
                    tracing::warn!(%error, "a browser could not be let in");
                    sleep(Duration::from_millis(50)).await;
                }
            },
        }
    }
    drop(listener);
    ending();
    if timeout(limits.farewell, graceful.shutdown()).await.is_err() {
        tracing::debug!("some browsers did not read their answers in time");
    }
}
