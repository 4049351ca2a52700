//! A real browser: headless Chromium, driven over its protocol for developers' tools. Only what the tests need.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

use crate::{LIMIT, eventually};

/// Programs that are one, in the order in which they are tried.
const PROGRAMS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome-stable", "google-chrome"];

/// A browser with one page open.
#[derive(Debug)]
pub struct Browser {
    child: Child,
    socket: WebSocket<TcpStream>,
    session: Option<String>,
    messages: u64,
    errors: Vec<String>,
    requests: Vec<String>,
    // Removed when the browser has ended.
    _profile: TempDir,
}

impl Browser {
    /// Starts one with an empty page; `None`, and a word on standard error, if there is none on this machine.
    #[must_use]
    pub fn start() -> Option<Self> {
        let Some(program) = find() else {
            eprintln!(
                "skipped: none of {PROGRAMS:?} is on the PATH; Debian has it as `apt-get install chromium`"
            );
            return None;
        };
        let profile = tempfile::Builder::new().prefix("ss-browser").tempdir_in("/tmp").expect("a folder");
        let mut command = Command::new(&program);
        command.args(["--headless=new", "--remote-debugging-port=0", "--no-first-run", "--disable-gpu"]);
        command.args(["--disable-background-networking", "--disable-component-update", "--disable-sync"]);
        command.args(["--disable-dev-shm-usage", "--hide-scrollbars", "--force-color-profile=srgb"]);
        if rustix::process::geteuid().is_root() {
            // Chromium's own sandbox does not work as root, which is what containers run as.
            command.arg("--no-sandbox");
        }
        let mut folder = std::ffi::OsString::from("--user-data-dir=");
        folder.push(profile.path());
        command.arg(folder).arg("about:blank").env("HOME", profile.path());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        let mut said = BufReader::new(child.stderr.take().expect("piped"));
        let address = loop {
            let mut line = String::new();
            let length = said.read_line(&mut line).expect("a pipe can be read");
            assert!(length > 0, "{} has ended without a word of its DevTools", program.display());
            if let Some(address) = line.trim().strip_prefix("DevTools listening on ") {
                break address.to_owned();
            }
        };
        // It goes on talking, and must not stop because nobody listens.
        thread::spawn(move || std::io::copy(&mut said, &mut std::io::sink()));
        let place = address.trim_start_matches("ws://").split('/').next().expect("host and port");
        let stream = TcpStream::connect(place).expect("DevTools listen");
        stream.set_read_timeout(Some(LIMIT)).expect("a limit");
        let (socket, _) = tungstenite::client(address.as_str(), stream).expect("DevTools speak WebSocket");
        let mut browser = Self {
            child,
            socket,
            session: None,
            messages: 0,
            errors: vec![],
            requests: vec![],
            _profile: profile,
        };
        let page = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let attached =
            browser.call("Target.attachToTarget", &json!({ "targetId": page["targetId"], "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), &json!({}));
        }
        Some(browser)
    }

    /// Makes the page so large, and dark or light.
    pub fn looks(&mut self, width: u32, height: u32, dark: bool) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", &size);
        let scheme = json!({ "name": "prefers-color-scheme", "value": if dark { "dark" } else { "light" } });
        self.call("Emulation.setEmulatedMedia", &json!({ "features": [scheme] }));
    }

    /// Opens an address.
    pub fn open(&mut self, url: &str) {
        let opened = self.call("Page.navigate", &json!({ "url": url }));
        assert_eq!(opened.get("errorText"), None, "{url}");
    }

    /// What an expression is in the page.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        self.look(expression).unwrap_or_else(|thrown| panic!("{expression}: {thrown}"))
    }

    /// Waits until an expression is true in the page; one that throws is not true yet.
    pub fn until(&mut self, what: &str, expression: &str) {
        let deadline = Instant::now() + LIMIT;
        while self.look(expression) != Ok(json!(true)) {
            if Instant::now() > deadline {
                let text = self.look("document.body.innerText");
                panic!(
                    "{what} has not come about within {LIMIT:?}: {expression}; errors {:?}; the page: {text:?}",
                    self.errors
                );
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// What the page has complained of so far.
    pub fn errors(&mut self) -> Vec<String> {
        self.evaluate("0");
        self.errors.clone()
    }

    /// The addresses that the page has asked for so far.
    pub fn requests(&mut self) -> Vec<String> {
        self.evaluate("0");
        self.requests.clone()
    }

    /// Writes what is seen as PNG.
    pub fn picture(&mut self, path: &Path) {
        let picture = self.call("Page.captureScreenshot", &json!({ "format": "png" }));
        let data = picture["data"].as_str().expect("base64");
        fs::write(path, BASE64.decode(data.as_bytes()).expect("base64")).expect("a file can be written");
    }

    fn look(&mut self, expression: &str) -> Result<Value, Value> {
        let asked = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut result = self.call("Runtime.evaluate", &asked);
        match result.get("exceptionDetails") {
            Some(thrown) => Err(thrown.clone()),
            None => Ok(result["result"]["value"].take()),
        }
    }

    fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.messages += 1;
        let id = self.messages;
        let mut message = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).expect("the browser lives");
        loop {
            let message =
                self.socket.read().unwrap_or_else(|error| panic!("{method} is not answered: {error}"));
            let Ok(text) = message.to_text() else { continue };
            let Ok(mut message) = serde_json::from_str::<Value>(text) else { continue };
            if message["id"] == json!(id) {
                assert_eq!(message.get("error"), None, "{method}");
                return message["result"].take();
            }
            self.event(&message);
        }
    }

    fn event(&mut self, message: &Value) {
        let told = &message["params"];
        match message["method"].as_str().unwrap_or_default() {
            "Runtime.exceptionThrown" => self.errors.push(told["exceptionDetails"].to_string()),
            "Runtime.consoleAPICalled"
                if ["error", "warning"].contains(&told["type"].as_str().unwrap_or("")) =>
            {
                self.errors.push(told["args"].to_string());
            }
            "Log.entryAdded" if told["entry"]["level"] == "error" => {
                self.errors.push(told["entry"].to_string());
            }
            "Network.requestWillBeSent" => {
                self.requests.extend(told["request"]["url"].as_str().map(str::to_owned));
            }
            _ => {}
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let close = json!({ "id": 0, "method": "Browser.close", "params": {} });
        let asked = self.socket.send(Message::text(close.to_string())).is_ok();
        if asked && !thread::panicking() {
            // It has processes of its own, which must be gone before its folder is removed.
            eventually("the browser's end", || self.child.try_wait().ok().flatten());
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn find() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let in_folders = |program| std::env::split_paths(&folders).map(move |folder| folder.join(program));
    PROGRAMS.iter().flat_map(in_folders).find(|path| path.is_file())
}
