//! A browser's half of HTTP, as plain as it can be: what is sent is what is written here.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};

use serde_json::Value;

use crate::LIMIT;

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// Its status.
    pub status: u16,
    /// Its headers, names in small letters.
    pub headers: Vec<(String, String)>,
    /// Its body.
    pub body: String,
}

impl Answer {
    /// A header.
    #[must_use]
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(header, _)| header == name).map(|(_, value)| value.as_str())
    }

    /// The body as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error} in {self:?}"))
    }
}

/// Asks once. Headers replace those that would be sent without them.
#[must_use]
pub fn ask(server: SocketAddr, request: &str, headers: &[(&str, &str)], body: &str) -> Answer {
    let mut reader = send(server, request, headers, body, true);
    let (status, headers) = head(&mut reader);
    let mut body = String::new();
    reader.read_to_string(&mut body).expect("an answer is read");
    Answer { status, headers, body }
}

/// An open stream of server-sent events.
#[derive(Debug)]
pub struct Events(BufReader<TcpStream>);

impl Events {
    /// Opens it; nothing is read but the head of the answer.
    #[must_use]
    pub fn open(server: SocketAddr, path: &str, headers: &[(&str, &str)]) -> Self {
        let mut reader = send(server, &format!("GET {path}"), headers, "", false);
        let (status, headers) = head(&mut reader);
        assert_eq!(status, 200, "{headers:?}");
        Self(reader)
    }

    /// Reads until an event with this name is one that is waited for, and gives its data.
    pub fn until(&mut self, name: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let deadline = std::time::Instant::now() + LIMIT;
        loop {
            let (event, data) = self.next().unwrap_or_else(|| panic!("the stream has ended before {name:?}"));
            if event == name && wanted(&data) {
                return data;
            }
            assert!(std::time::Instant::now() < deadline, "no such {name:?}; the last event: {data}");
        }
    }
}

/// By name and data.
impl Iterator for Events {
    type Item = (String, Value);
    fn next(&mut self) -> Option<(String, Value)> {
        let mut name = None;
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).expect("the stream is read") == 0 {
                return None;
            }
            let line = line.trim_end();
            if let Some(event) = line.strip_prefix("event: ") {
                name = Some(event.to_owned());
            } else if let (Some(data), Some(name)) = (line.strip_prefix("data: "), name.take()) {
                return Some((name, serde_json::from_str(data).expect("JSON")));
            }
        }
    }
}

fn send(
    server: SocketAddr,
    request: &str,
    headers: &[(&str, &str)],
    body: &str,
    once: bool,
) -> BufReader<TcpStream> {
    let mut stream = TcpStream::connect(server).expect("a server listens");
    stream.set_read_timeout(Some(LIMIT)).expect("a limit");
    let host = server.to_string();
    let length = body.len().to_string();
    let mut all = vec![("Host", host.as_str()), ("Content-Length", length.as_str())];
    if !body.is_empty() {
        all.push(("Content-Type", "application/json"));
    }
    if once {
        all.push(("Connection", "close"));
    }
    all.retain(|(name, _)| headers.iter().all(|(other, _)| !other.eq_ignore_ascii_case(name)));
    all.extend(headers);
    // A stream of HTTP/1.0 has no chunks: what is sent is what is read.
    let version = if once { "1.1" } else { "1.0" };
    let mut text = format!("{request} HTTP/{version}\r\n");
    for (name, value) in all {
        let _ = write!(text, "{name}: {value}\r\n");
    }
    stream.write_all(format!("{text}\r\n{body}").as_bytes()).expect("a request is sent");
    BufReader::new(stream)
}

fn head(reader: &mut BufReader<TcpStream>) -> (u16, Vec<(String, String)>) {
    let mut line = || {
        let mut line = String::new();
        reader.read_line(&mut line).expect("an answer comes");
        line.trim_end().to_owned()
    };
    let first = line();
    let status = first.split(' ').nth(1).and_then(|status| status.parse().ok());
    let mut headers = vec![];
    loop {
        let line = line();
        let Some((name, value)) = line.split_once(": ") else { break };
        headers.push((name.to_ascii_lowercase(), value.to_owned()));
    }
    (status.unwrap_or_else(|| panic!("{first:?} is no answer")), headers)
}
