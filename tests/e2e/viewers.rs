//! What others make of a set: its log in the hands of the format's own Python package, its events, its live view.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const GUIDE: &str = include_str!("../../docs/src/guide/viewers.md");

fn python(arguments: &[&str]) -> std::io::Result<Output> {
    Command::new("python3").args(arguments).output()
}

/// Whether Python with these packages is here; says if a test is skipped for that.
fn has_python(packages: &str) -> bool {
    let has = python(&["-c", &format!("import {packages}")]).is_ok_and(|output| output.status.success());
    if !has {
        println!("skipped: python3 with {packages} (pip install mcap jsonschema) is not here");
    }
    has
}

fn ran(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

/// The messages of `/events`, as (level, name, message).
fn events(log: &Path) -> Vec<(u64, String, String)> {
    let bytes = fs::read(log).expect("a log");
    let messages = mcap::MessageStream::new(&bytes).expect("MCAP").map(|message| message.expect("whole"));
    messages
        .filter(|message| message.channel.topic == "/events")
        .map(|message| {
            let event: Value = serde_json::from_slice(&message.data).expect("JSON");
            let text = |key: &str| event[key].as_str().expect("a text").to_owned();
            (event["level"].as_u64().expect("a number"), text("name"), text("message"))
        })
        .collect()
}

/// A log with moves, a line, outputs and a refusal.
fn eventful_log(cell: &Cell) -> std::path::PathBuf {
    let up = cell.up("20");
    cell.ccu("origin").done();
    cell.ccu("line left_x=4000 left_y=77").done();
    cell.ccu("output lamp on").done();
    cell.ccu("send 01 7F").fails(1, &["unknown"]);
    assert_eq!(cell.down(), None);
    up.log
}

#[test]
fn the_public_packages_read_the_log_and_its_schemas_hold() {
    if !has_python("mcap, jsonschema") {
        return;
    }
    let cell = Cell::new(EXE);
    let log = eventful_log(&cell);
    let frames = cell.frames(&log);
    let output = python(&["-c", include_str!("read_log.py"), log.to_str().expect("UTF-8")]);
    let read: Value = serde_json::from_str(&ran(&output.expect("it ran before"))).expect("JSON");
    let count =
        |topic: &str| read["topics"][topic].as_u64().unwrap_or_else(|| panic!("no {topic} in {read}"));
    let of = |what: &dyn Fn(&Value) -> bool| frames.iter().filter(|frame| what(frame)).count() as u64;
    // Every frame once as it travelled, and once for viewers.
    assert_eq!(count("/microbus"), frames.len() as u64);
    assert_eq!(count("/command"), of(&|frame| frame["kind"] == "command"));
    assert_eq!(count("/axis/left_x/status"), of(&|frame| frame["kind"] == "answer" && frame["axis"] == 1));
    for (topic, schema) in [
        ("/command", "supersigma.Command"),
        ("/axis/wrist/status", "supersigma.AxisStatus"),
        ("/digital/status", "supersigma.DigitalStatus"),
        ("/events", "foxglove.Log"),
        ("/joint_states", "foxglove.JointStates"),
    ] {
        assert_eq!(read["schemas"][topic], json!([schema, "jsonschema", "json"]), "{topic}");
    }
    // Origination and the line take seconds of machine time; a sample is due every 10 ms.
    assert!(read["grid"].as_u64().expect("a number") > 100, "{}", read["grid"]);
}

/// The snippet of the guide, as it stands there.
#[test]
fn the_guide_s_snippet_runs() {
    if !has_python("mcap") {
        return;
    }
    let snippet =
        GUIDE.split("```python\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a snippet");
    let cell = Cell::new(EXE);
    let log = eventful_log(&cell);
    let output = python(&["-c", snippet, log.to_str().expect("UTF-8")]).expect("it ran before");
    let said = ran(&output);
    let speed = said.lines().find_map(|line| line.strip_prefix("left_x: ")?.strip_suffix(" steps/s at most"));
    assert!(speed.is_some_and(|speed| speed.parse::<u32>().is_ok_and(|speed| speed > 1_000)), "{said}");
    assert!(said.lines().any(|line| line.ends_with("line left_x=4000 left_y=77: done")), "{said}");
}

#[test]
fn what_the_daemon_says_is_in_the_log() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    cell.ccu("origin left_x").done();
    cell.ccu("move left_x 100").done();
    cell.ccu("move left_x -5000").fails(1, &["outside the travel"]);
    cell.worker(7).signal(Signal::KILL);
    cell.until("left_x", "is locked", |axis| !axis["alarm"].is_null());
    let said = cell.down().expect("a worker has ended");
    assert!(said.contains("a worker has ended"), "{said}");
    let events = events(&up.log);
    let find = |level: u64, name: &str, text: &str| {
        let found =
            events.iter().position(|(l, n, message)| *l == level && n == name && message.contains(text));
        found.unwrap_or_else(|| panic!("no {text:?} of {name} at {level} in {events:#?}"))
    };
    let order = [
        find(2, "ccu::daemon", "the set is up name=cell cards=8"),
        find(2, "ccu::daemon::server", "origin left_x: begun"),
        find(2, "ccu::daemon::server", "move left_x 100: begun"),
        find(2, "ccu::daemon::server", "move left_x 100: done"),
        find(2, "ccu::daemon::server", "move left_x -5000: axis 1 refused"),
        find(4, "ccu::daemon::keeper", "a worker has ended; all axes brake card="),
        find(4, "left_x", "left_x is locked: braked on command"),
        find(2, "ccu::daemon", "the set goes down"),
    ];
    assert!(order.is_sorted(), "{order:?} in {events:#?}");
}

#[cfg(not(feature = "foxglove"))]
#[test]
fn a_live_view_that_is_not_built_is_refused() {
    let cell = Cell::new(EXE);
    cell.ccu("up --foxglove 0").fails(2, &["this build has no Foxglove server", "--features foxglove"]);
    cell.assert_nothing_left();
}

#[cfg(feature = "foxglove")]
mod live {
    use std::net::{TcpListener, TcpStream};

    use supersigma_tests::{LIMIT, eventually};
    use tungstenite::client::IntoClientRequest;
    use tungstenite::{Message, WebSocket};

    use super::*;

    /// A viewer, as Foxglove is one.
    struct Viewer(WebSocket<TcpStream>);

    impl Viewer {
        fn connect(url: &str) -> Self {
            let address = url.strip_prefix("ws://").expect("a WebSocket's URL");
            let stream = TcpStream::connect(address).expect("somebody listens");
            stream.set_read_timeout(Some(LIMIT)).expect("a limit");
            let mut request = url.into_client_request().expect("a URL");
            let protocol = "foxglove.sdk.v1".parse().expect("a word");
            request.headers_mut().insert("sec-websocket-protocol", protocol);
            let (socket, response) = tungstenite::client(request, stream).expect("a WebSocket");
            assert_eq!(response.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
            Self(socket)
        }

        /// The next message in text with this operation.
        fn text(&mut self, operation: &str) -> Value {
            loop {
                if let Message::Text(text) = self.0.read().expect("a message") {
                    let value: Value = serde_json::from_str(&text).expect("JSON");
                    if value["op"] == operation {
                        return value;
                    }
                }
            }
        }

        fn subscribe(&mut self, number: u32, channel: &Value) {
            let subscriptions = json!([{ "id": number, "channelId": channel["id"] }]);
            let text = json!({ "op": "subscribe", "subscriptions": subscriptions }).to_string();
            self.0.send(Message::text(text)).expect("sent");
        }

        /// The next message of any subscription: its number, its time, what it says.
        fn data(&mut self) -> (u32, u64, Value) {
            loop {
                if let Message::Binary(bytes) = self.0.read().expect("a message")
                    && bytes[0] == 1
                {
                    let number = u32::from_le_bytes(bytes[1..5].try_into().expect("4 bytes"));
                    let time = u64::from_le_bytes(bytes[5..13].try_into().expect("8 bytes"));
                    return (number, time, serde_json::from_slice(&bytes[13..]).expect("JSON"));
                }
            }
        }
    }

    fn url_in(text: &str) -> String {
        let url = text.lines().find_map(|line| line.strip_prefix("Foxglove: open the connection "));
        url.unwrap_or_else(|| panic!("no URL in {text}")).to_owned()
    }

    fn up(cell: &Cell) -> (String, std::path::PathBuf) {
        let log = cell.path("cell.mcap");
        let config = cell.config();
        let options = format!("--time-scale 20 --config {} --log {}", config.display(), log.display());
        let ran = cell.ccu(&format!("up --detach --foxglove 0 {options}")).good();
        (url_in(&ran.stdout), log)
    }

    #[test]
    fn a_viewer_sees_what_the_log_holds() {
        let cell = Cell::new(EXE);
        let (url, log) = up(&cell);
        assert!(url.starts_with("ws://127.0.0.1:"), "{url}");
        let mut viewer = Viewer::connect(&url);
        let info = viewer.text("serverInfo");
        assert_eq!((&info["name"], &info["capabilities"]), (&json!("SUPERSIGMA cell"), &json!([])));
        let advertised = viewer.text("advertise");
        let channels = advertised["channels"].as_array().expect("a list");
        let channel = |topic: &str| {
            let found = channels.iter().find(|channel| channel["topic"] == topic);
            found.unwrap_or_else(|| panic!("no {topic} in {advertised}"))
        };
        assert_eq!(channels.len(), 4 + 7);
        let joints = channel("/joint_states");
        assert_eq!(
            (&joints["encoding"], &joints["schemaName"]),
            (&json!("json"), &json!("foxglove.JointStates"))
        );
        assert_eq!(channel("/axis/wrist/status")["schemaEncoding"], "jsonschema");
        for (number, topic) in (1..).zip(["/joint_states", "/command", "/events", "/axis/left_x/status"]) {
            viewer.subscribe(number, channel(topic));
        }
        // Once something comes of the last subscription, all are in force.
        while viewer.data().0 < 4 {}
        cell.ccu("origin left_x").done();
        let (mut seen, mut last) = ([const { Vec::new() }; 4], 0);
        while !seen[2].iter().any(|event: &Value| event["message"] == "origin left_x: done") {
            let (number, time, value) = viewer.data();
            assert!(time >= last, "times fall");
            last = time;
            seen[usize::try_from(number).expect("small") - 1].push(value);
        }
        let [joints, commands, _, statuses] = seen;
        assert_eq!(joints.last().expect("it has moved")["joints"][0]["name"], "left_x");
        assert!(joints.len() > 20, "{}", joints.len());
        assert!(commands.iter().any(|command| command["operation"] == "Originate"), "{commands:?}");
        assert!(statuses.iter().any(|status| status["activity"] == "originating"), "{statuses:?}");
        drop(viewer);
        assert_eq!(cell.down(), None);

        // Word for word.
        let bytes = fs::read(&log).expect("a log");
        let logged: Vec<Value> = mcap::MessageStream::new(&bytes)
            .expect("MCAP")
            .map(|message| message.expect("whole"))
            .filter(|message| message.channel.topic == "/axis/left_x/status")
            .map(|message| serde_json::from_slice(&message.data).expect("JSON"))
            .collect();
        assert!(statuses.iter().all(|status| logged.contains(status)));
    }

    #[test]
    fn without_its_view_a_set_goes_on() {
        let cell = Cell::new(EXE);
        let (url, _) = up(&cell);
        let view = cell.processes().into_iter().find(|process| process.has(&["foxglove-server"]));
        let mut viewer = Viewer::connect(&url);
        viewer.text("serverInfo");
        view.expect("a process of its own").signal(Signal::KILL);
        eventually("the end of the connection", || viewer.0.read().is_err().then_some(()));
        cell.ccu("origin left_x").done();
        let said = cell.down().expect("the view has ended");
        assert!(said.contains("the Foxglove server has ended; the set goes on"), "{said}");
    }

    #[test]
    fn a_port_that_is_taken_is_named() {
        let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = taken.local_addr().expect("bound").port();
        let cell = Cell::new(EXE);
        let message = format!("cannot listen at 127.0.0.1:{port}");
        cell.ccu(&format!("up --foxglove {port}")).fails(1, &[&message, "did not come to life"]);
        cell.assert_nothing_left();
        cell.ccu("up --foxglove 1.2.3").fails(2, &["`1.2.3` is no port"]);
    }
}
