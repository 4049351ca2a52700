//! `ccu serve` over its web interface, on real sets: what it tells, whom it refuses, how it bears slow readers, and how it
//! outlives a set.

use std::net::SocketAddr;

use serde_json::{Value, json};
use supersigma_tests::http::{Events, ask};
use supersigma_tests::{Cell, Running, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const TOKEN: &str = "a-token-of-25-characters.";

fn serve(cell: &Cell, options: &str) -> (Running, SocketAddr) {
    let mut server = cell.start(&format!("serve --listen 0 {options}"));
    let line = server.line_with("http://");
    let place = line.split("http://").nth(1).and_then(|rest| rest.split('/').next());
    (server, place.and_then(|place| place.parse().ok()).unwrap_or_else(|| panic!("no address in {line:?}")))
}

fn end(server: Running, signal: Signal) {
    server.signal(signal);
    server.end().done();
}

fn wrist(picture: &Value) -> &Value {
    &picture["axes"][6]
}

#[test]
fn pictures_and_frames_follow_a_movement() {
    let cell = Cell::new(EXE);
    let _ = cell.up("20");
    let (server, place) = serve(&cell, "");
    let mut events = Events::open(place, "/api/events", &[]);
    let set = events.until("set", |_| true);
    assert_eq!(set, json!({ "up": true, "life": 1, "reason": null, "control": false }));
    events
        .until("picture", |picture| picture["set"]["name"] == "cell" && wrist(picture)["position"].is_null());
    cell.ccu("origin wrist").done();
    cell.ccu("move wrist 5000 --speed 1000 --no-wait").done();
    let frames = events.until("frames", |frames| frames["frames"].to_string().contains("+5000"));
    assert_eq!(frames["missed"], 0);
    events.until("picture", |picture| wrist(picture)["activity"] == "cruising");
    events.until("picture", |picture| wrist(picture)["position"] == 5000);
    let snapshot = ask(place, "GET /api/snapshot?frames=3&axis=7&text=5000&history=50", &[], "").json();
    assert_eq!((&wrist(&snapshot)["sense"], &wrist(&snapshot)["position"]), (&json!("00010"), &json!(5000)));
    assert!(snapshot["frames"].to_string().contains("+5000"), "{}", snapshot["frames"]);
    let speeds = wrist(&snapshot)["speed_history"].as_array().expect("a history");
    assert!(speeds.iter().any(|speed| speed.as_f64() > Some(900.0)), "{speeds:?}");
    cell.ccu("inject wrist force").done();
    let alarms = events.until("events", |events| events["events"].to_string().contains("locked"));
    assert!(alarms.to_string().contains("wrist is locked: excessive force"), "{alarms}");
    end(server, Signal::TERM);
    // The stream ends with the server.
    events.for_each(drop);
    assert!(cell.down().is_some_and(|said| said.contains("excessive")));
}

#[test]
fn orders_need_the_token_and_the_option() {
    let cell = Cell::new(EXE);
    let _ = cell.up("20");
    let file = cell.file("token", &format!("{TOKEN}\n"));
    let (server, place) = serve(&cell, &format!("--control --token-file {}", file.display()));
    let bearer = format!("Bearer {TOKEN}");
    let known = ("Authorization", bearer.as_str());
    for (request, body) in [("POST /api/origin", "{}"), ("POST /api/halt", "{}"), ("GET /api/snapshot", "")] {
        assert_eq!(ask(place, request, &[], body).status, 401, "{request}");
        let wrong = ("Authorization", "Bearer a-token-of-25-characters,");
        assert_eq!(ask(place, request, &[wrong], body).status, 401, "{request}");
    }
    assert_eq!(cell.axis("wrist")["position"], Value::Null);

    let order = |what: &str, body: &str| ask(place, &format!("POST /api/{what}"), &[known], body);
    let origin = order("origin", r#"{"axes":["wrist"]}"#);
    assert_eq!((origin.status, &origin.json()["movements"][0]["position"]), (200, &json!(0)));
    assert_eq!(order("move", r#"{"axis":7,"to":700}"#).json(), json!({ "done": true, "movements": [] }));
    cell.until("wrist", "is there", |axis| axis["position"] == 700 && axis["activity"] == "standing");
    assert_eq!(order("move", r#"{"axis":"wrist","by":-300}"#).status, 200);
    cell.until("wrist", "is back", |axis| axis["position"] == 400 && axis["activity"] == "standing");
    let too_far = order("move", r#"{"axis":7,"by":-401}"#);
    assert_eq!((too_far.status, &too_far.json()["error"]["code"]), (409, &json!("refused")));
    let unknown = order("move", r#"{"axis":1,"to":100}"#).json();
    assert_eq!(unknown["error"]["code"], "unknown_position");
    for wrong in [
        r#"{"axis":7}"#,
        r#"{"axis":7,"by":1,"to":1}"#,
        r#"{"axis":8,"by":1}"#,
        r#"{"axis":7,"buy":1}"#,
        "move!",
    ] {
        assert_eq!(order("move", wrong).status, 400, "{wrong}");
    }
    assert_eq!(order("brake", "{}").status, 200);
    assert_eq!(cell.axis("left_x")["alarm"]["cause"], "braked");
    assert_eq!(order("clear", r#"{"axes":[1,"left_y"]}"#).status, 200);
    assert_eq!(cell.axis("left_x")["alarm"], Value::Null);
    assert_eq!(cell.axis("left_z")["alarm"]["cause"], "braked");
    assert_eq!(order("output", r#"{"line":"lamp","on":true}"#).status, 200);
    assert!(cell.ccu("output lamp").good().stdout.contains("on"));
    assert_eq!(order("resume", "{}").json()["error"]["code"], "nothing_to_resume");

    let (looking, there) = serve(&cell, "");
    assert_eq!(ask(there, "POST /api/halt", &[], "{}").status, 404);
    end(looking, Signal::INT);
    end(server, Signal::INT);
    assert_eq!(cell.down(), None);
}

#[test]
fn other_names_and_other_sites_are_refused() {
    let cell = Cell::new(EXE);
    let (server, place) = serve(&cell, &format!("--control --token {TOKEN} --allow-host robot.example"));
    for path in ["GET /", "GET /api/snapshot", "POST /api/halt"] {
        assert_eq!(ask(place, path, &[("Host", "evil.example")], "").status, 421, "{path}");
        assert_eq!(ask(place, path, &[("Origin", "http://evil.example")], "").status, 403, "{path}");
    }
    let page = ask(place, "GET /", &[("Host", "robot.example")], "");
    assert_eq!(page.status, 200);
    let policy = page.header("content-security-policy").expect("a policy");
    assert!(policy.starts_with("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    assert_eq!(page.header("x-content-type-options"), Some("nosniff"));
    end(server, Signal::INT);
}

#[test]
fn a_slow_reader_misses_frames_and_harms_nobody() {
    let cell = Cell::new(EXE);
    let _ = cell.up("20");
    let (server, place) = serve(&cell, "");
    let mut slow = Events::open(place, "/api/events?samples=true", &[]);
    let mut quick = Events::open(place, "/api/events?samples=true", &[]);
    cell.ccu("origin").done();
    // More than the board keeps and the system holds for one who does not read.
    let mut seen = 0;
    let mut forth = true;
    while seen < 15_000 {
        let (by, target) = if forth { (60_000, 60_000) } else { (-60_000, 0) };
        cell.ccu(&format!("line left_x={by} right_x={by} --no-wait")).done();
        forth = !forth;
        let there = |axis: &Value| axis["position"] == target && axis["activity"] == "standing";
        loop {
            let (name, data) = quick.next().expect("the stream goes on");
            match name.as_str() {
                "frames" => {
                    assert_eq!(data["missed"], 0, "the quick one misses nothing");
                    seen += data["frames"].as_array().map_or(0, Vec::len);
                }
                "picture" if there(&data["axes"][0]) && there(&data["axes"][3]) => break,
                _ => {}
            }
        }
    }
    let missed = slow.until("frames", |frames| frames["missed"] != 0);
    assert!(missed["missed"].as_u64() > Some(0));
    // It then sees what is now, not all that was.
    cell.ccu("inject wrist force").done();
    slow.until("picture", |picture| wrist(picture)["alarm"]["cause"] == "excessive_force");
    end(server, Signal::INT);
    assert!(cell.down().is_some_and(|said| said.contains("excessive")));
}

#[test]
fn the_server_outlives_the_set_and_waits_for_the_next() {
    let cell = Cell::new(EXE);
    let (server, place) = serve(&cell, "");
    let mut events = Events::open(place, "/api/events", &[]);
    let down = events.until("set", |set| set["up"] == false && set["reason"].to_string().contains("no set"));
    assert_eq!(down["life"], 0);
    assert_eq!(ask(place, "GET /api/snapshot", &[], "").status, 503);
    assert_eq!(ask(place, "GET /healthz", &[], "").json(), json!({ "ok": true, "set": "cell", "up": false }));
    let _ = cell.up("20");
    events.until("set", |set| set["up"] == true && set["life"] == 1);
    events.until("picture", |picture| picture["life"] == 1 && wrist(picture)["alive"] == true);
    let config = ask(place, "GET /api/config", &[], "").json();
    assert_eq!(config["axis"][6]["name"], "wrist");
    cell.ccu("down").done();
    events.until("set", |set| set["up"] == false);
    end(server, Signal::TERM);
    assert_eq!(cell.processes(), []);
}

#[test]
fn what_is_wrongly_asked_of_it() {
    let cell = Cell::new(EXE);
    let (server, place) = serve(&cell, "");
    cell.ccu(&format!("serve --listen {place}")).fails(1, &["cannot listen on", "--listen"]);
    let short = cell.file("short", "guess me\n");
    cell.ccu(&format!("serve --listen 0 --token-file {}", short.display())).fails(2, &["is no token", "16"]);
    cell.ccu("serve --listen localhost:80").fails(2, &["0.0.0.0:8748"]);
    cell.ccu("serve --token short").fails(2, &["16 to 256"]);
    end(server, Signal::INT);
}
