//! A set in a browser: a small web server that shows what goes on in it and, if that is wanted, takes orders.
//!
//! ```text
//!   daemon ── live feed ─► live ─► board ─► routes ─► connection ─► browsers
//!     ▲                                        │ guard: Host, Origin, token
//!     └──────────── control socket ◄── orders ◄┘
//! ```
//!
//! The server is a client of the set like any other: it reads the feed that misses frames rather than hold up anybody, and
//! what it is ordered goes over the control socket. Each browser reads from the board at its own pace. Everything that
//! a browser loads is in the binary; nothing is asked of any other machine. The interface is described in the book,
//! "The web interface"; it is a contract.

mod assets;
mod board;
mod connection;
mod guard;
mod live;
mod orders;
mod problem;
mod routes;
#[cfg(test)]
mod tests;
mod token;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};

use self::board::Board;
use self::live::Live;
pub use self::token::{NoToken, Token};
use crate::home::Home;

/// What is served, where and to whom.
#[derive(Debug)]
pub struct Options {
    /// The set; it need not be up.
    pub home: Home,
    /// Where to listen; port 0 is any that is free.
    pub listen: SocketAddr,
    /// What everything below `/api` asks for, if there is one.
    pub token: Option<Token>,
    /// Whether orders are taken. Without a token nobody may give any.
    pub control: bool,
    /// Names under which browsers may ask for the server, besides `localhost` and addresses.
    pub hosts: Vec<String>,
    /// What is too much.
    pub limits: Limits,
}

/// What is too much, and how long is too long.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once; more wait.
    pub connections: usize,
    /// Streams of events at once; more are refused.
    pub viewers: usize,
    /// Orders at once that move something; more are refused. Those that stop are never counted.
    pub movements: usize,
    /// For the head of a request, and between two requests on a connection.
    pub head: Duration,
    /// For the body of an order.
    pub body: Duration,
    /// During which a browser must have read something of what it is sent.
    pub stalled: Duration,
    /// For answers under way when the server ends.
    pub farewell: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 128,
            viewers: 32,
            movements: 8,
            head: Duration::from_secs(15),
            body: Duration::from_secs(10),
            stalled: Duration::from_secs(30),
            farewell: Duration::from_secs(3),
        }
    }
}

/// A server that listens.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    site: Arc<Site>,
    end: watch::Sender<bool>,
}

/// What the requests share.
#[derive(Debug)]
struct Site {
    home: Home,
    live: Arc<Live>,
    board: Arc<Board>,
    token: Option<Token>,
    control: bool,
    hosts: Vec<String>,
    limits: Limits,
    viewers: Arc<Semaphore>,
    movements: Arc<Semaphore>,
    ended: watch::Receiver<bool>,
}

impl Server {
    /// Listens, and begins to follow the set. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// If the address cannot be listened on.
    pub fn bind(options: Options) -> io::Result<Self> {
        let listener = connection::listen(options.listen)?;
        let (end, ended) = watch::channel(false);
        let site = Arc::new(Site::new(options, ended));
        live::follow(site.home.clone(), &site.live)?;
        Ok(Self { listener, site, end })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// If the system does not say.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves until `asked_to_end` resolves; answers under way have [`Limits::farewell`] to be read.
    pub async fn run(self, asked_to_end: impl Future<Output = ()>) {
        let Self { listener, site, end } = self;
        let turning = tokio::spawn(board::turn(Arc::clone(&site.board), Arc::clone(&site.live)));
        connection::serve(listener, routes::router(Arc::clone(&site)), &site.limits, asked_to_end, || {
            end.send_replace(true);
        })
        .await;
        turning.abort();
    }
}

impl Site {
    fn new(options: Options, ended: watch::Receiver<bool>) -> Self {
        let Options { home, token, control, hosts, limits, listen: _ } = options;
        Self {
            live: Arc::new(Live::new()),
            board: Arc::new(Board::new(control)),
            viewers: Arc::new(Semaphore::new(limits.viewers)),
            movements: Arc::new(Semaphore::new(limits.movements)),
            home,
            token,
            control,
            hosts,
            limits,
            ended,
        }
    }
}
