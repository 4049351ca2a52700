//! The live feed: a connection to a daemon that tells what goes by. Who has none, or has lost it, connects again; the
//! picture is then a new one, because a new set may be another.

use std::time::Instant;

use supersigma_config::Config;
use supersigma_protocol::Address;

use super::Picture;
use crate::control::{Client, FromDaemon};
use crate::executive::{Failure, Operate, Request};
use crate::home::Home;

/// A set that is being watched.
#[derive(Debug)]
pub struct Feed {
    client: Client,
    since: Instant,
}

/// What the daemon told: for [`Picture`].
#[derive(Debug)]
pub struct News(FromDaemon);

impl Feed {
    /// Begins to watch the set that lives at `home`, and gives a picture of it to begin with. Nobody knows how the
    /// digital outputs stand until their card is asked; if nobody has, this does, once.
    ///
    /// # Errors
    /// If no such set is up.
    pub fn open(home: &Home) -> Result<(Self, Picture), Failure> {
        let mut client = Client::connect(home)?;
        let mut set = client.describe()?;
        if set.outputs.is_none()
            && set.digital.contains(&Address::DIGITAL_OUTPUT)
            && client.operate(Request::Digital { card: Address::DIGITAL_OUTPUT }).is_ok()
        {
            set = client.describe()?;
        }
        let config = Config::from_toml(&set.config, "the set's configuration")
            .map_err(|error| Failure::Control { reason: error.to_string() })?;
        client.watch()?;
        let feed = Self { client, since: Instant::now() };
        let mut picture = Picture::new(config);
        picture.describe(feed.since.elapsed(), &set);
        Ok((feed, picture))
    }

    /// When the watching began: the zero of the picture's times.
    #[must_use]
    pub fn since(&self) -> Instant {
        self.since
    }

    /// What comes next; waits for it, about a second at most while the daemon lives.
    ///
    /// # Errors
    /// If the set has been taken down, or its daemon is gone.
    pub fn news(&mut self) -> Result<News, Failure> {
        self.client.news().map(News)
    }
}

impl News {
    /// Puts it into the picture of a watching that began at `since`.
    pub fn put_into(&self, picture: &mut Picture, since: Instant) {
        let at = since.elapsed();
        match &self.0 {
            FromDaemon::Description(set) => picture.describe(at, set),
            FromDaemon::Overheard(overheard) => {
                picture.miss(overheard.dropped);
                for frame in &overheard.frames {
                    let (lane, bytes) = frame.bytes();
                    picture.take(at, lane, bytes);
                }
            }
            FromDaemon::Done(_) | FromDaemon::Failed(_) | FromDaemon::Down(_) => {}
        }
    }
}
