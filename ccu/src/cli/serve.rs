//! `ccu serve`.

use std::fs;
use std::io::{self, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::Args;
use miette::miette;

use super::exit::{self, Exit};
use super::{SetArgs, set};
use crate::home::Home;
use crate::serve::{Limits, NoToken, Options, Server, Token};

/// The chip on the axis cards, an easy number to remember.
const PORT: &str = "8748";

#[derive(Args)]
pub(super) struct ServeArgs {
    #[command(flatten)]
    set: SetArgs,
    /// Where to listen; without an address only for this machine; port 0 is any that is free
    #[arg(long, value_name = "[ADDR:]PORT", default_value = PORT, value_parser = listen)]
    listen: SocketAddr,
    /// Take orders too: halt, brake, clear, resume, origin, move, outputs; needs a token, makes one if none is given
    #[arg(long)]
    control: bool,
    /// The token that everything but the empty page asks for, in the first line of a file
    #[arg(long, value_name = "FILE", conflicts_with = "token")]
    token_file: Option<PathBuf>,
    /// The token itself; others on this machine can see it in the list of processes
    #[arg(long, value_name = "TOKEN")]
    token: Option<Token>,
    /// A name under which browsers may ask, besides localhost and addresses; may be given several times
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
}

fn listen(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    text.parse().map_err(|_| {
        "a port, or an address and a port, is needed, as in 8748, 0.0.0.0:8748 or [::1]:8748".to_owned()
    })
}

pub(super) fn serve(args: &ServeArgs) -> Result<(), Exit> {
    let home = Home::of(args.set.name.clone())?;
    let token = token(args)?;
    let has_token = token.is_some();
    // One that was given is known to those who may know it, and does not belong into a journal.
    let made = token.as_ref().filter(|_| args.token.is_none() && args.token_file.is_none());
    let made = made.map(|token| token.reveal().to_owned());
    let options = Options {
        home,
        listen: args.listen,
        token,
        control: args.control,
        hosts: args.allow_host.clone(),
        limits: Limits::default(),
    };
    let runtime = set::runtime()?;
    let served = runtime.block_on(async {
        let asked_to_end = set::asked_to_end()?;
        let server = Server::bind(options).map_err(|error| {
            let help = "choose another place with `--listen [ADDR:]PORT`; port 0 is any that is free";
            Exit::could_not(miette!(help = help, "cannot listen on {}: {error}", args.listen))
        })?;
        let address = server.address()?;
        warn(args, address.ip(), has_token);
        // A server goes on if nobody reads what it says.
        let _ = say(args, address, made.as_deref());
        server.run(asked_to_end).await;
        Ok(())
    });
    // An order that is still waited for ends with its connection: the set halts what moves for it.
    runtime.shutdown_background();
    served
}

fn token(args: &ServeArgs) -> Result<Option<Token>, Exit> {
    let Some(path) = &args.token_file else {
        return match &args.token {
            Some(token) => Ok(Some(token.clone())),
            None if args.control => Ok(Some(Token::random()?)),
            None => Ok(None),
        };
    };
    let text = fs::read_to_string(path)
        .map_err(|error| Exit::wrong(miette!("cannot read {}: {error}", path.display())))?;
    let line = text.lines().next().unwrap_or_default();
    let token = line.parse().map_err(|error: NoToken| {
        let help = "one that is good: `head -c 16 /dev/urandom | od -An -tx1 | tr -d ' \\n'`";
        Exit::wrong(miette!(help = help, "the first line of {} is no token: {error}", path.display()))
    })?;
    Ok(Some(token))
}

fn warn(args: &ServeArgs, address: IpAddr, has_token: bool) {
    if address.is_loopback() {
        return;
    }
    if has_token {
        exit::say(&format!(
            "warning: {address} can be reached from other machines, and what goes over the network is not encrypted"
        ));
    } else {
        exit::say(&format!(
            "warning: whoever reaches {address} can watch set {}; `--token-file FILE` asks for a token",
            args.set.name
        ));
    }
}

fn say(args: &ServeArgs, address: SocketAddr, made: Option<&str>) -> io::Result<()> {
    // `0.0.0.0` is no place to go to.
    let place = match address.ip() {
        ip if ip.is_unspecified() && address.is_ipv4() => format!("localhost:{}", address.port()),
        ip if ip.is_unspecified() => format!("[::1]:{}", address.port()),
        _ => address.to_string(),
    };
    let secret = made.map(|token| format!("#token={token}")).unwrap_or_default();
    let mut out = io::stdout().lock();
    writeln!(out, "set {} is at http://{place}/{secret}", args.set.name)?;
    let orders =
        if args.control { "orders are taken from those who have the token" } else { "for looking only" };
    writeln!(out, "{orders}; Ctrl-C ends the server, not the set")?;
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_for_this_machine() {
        assert_eq!(listen("0").expect("good").to_string(), "127.0.0.1:0");
        assert_eq!(listen(PORT).expect("good").to_string(), "127.0.0.1:8748");
        assert_eq!(listen("0.0.0.0:80").expect("good").to_string(), "0.0.0.0:80");
        assert_eq!(listen("[::1]:80").expect("good").to_string(), "[::1]:80");
        for wrong in ["", "65536", "localhost:80", "::1", "80:80"] {
            assert!(listen(wrong).is_err(), "{wrong}");
        }
    }
}
