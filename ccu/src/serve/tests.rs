//! The routes without a network, and the limits of connections with one.

use std::net::Ipv4Addr;
use std::time::Instant;

use axum::body::Body;
use axum::http::{Request, Response};
use http_body_util::BodyExt;
use serde_json::Value;
use supersigma_config::Config;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tower::ServiceExt;

use super::live::Watched;
use super::*;
use crate::watch::Picture;

const TOKEN: &str = "sixteen-letters-or-more";

/// A site whose set was not looked for, in a folder that nobody uses.
fn site(change: impl FnOnce(&mut Options)) -> (Arc<Site>, watch::Sender<bool>) {
    let home = Home::of("serve-unit-test".parse().expect("a name")).expect("a place");
    let listen = (Ipv4Addr::LOCALHOST, 0).into();
    let mut options =
        Options { home, listen, token: None, control: false, hosts: vec![], limits: Limits::default() };
    change(&mut options);
    let (end, ended) = watch::channel(false);
    (Arc::new(Site::new(options, ended)), end)
}

fn up(site: &Site) {
    let picture = Picture::new(Config::default_set());
    site.live.look().up(Watched { picture, since: Instant::now() });
}

async fn ask(site: &Arc<Site>, request: &str, headers: &[(&str, &str)], body: &str) -> Response<Body> {
    let (method, uri) = request.split_once(' ').expect("a method and a path");
    let mut request = Request::builder().method(method).uri(uri).header("host", "localhost");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let request = request.body(Body::from(body.to_owned())).expect("a request");
    routes::router(Arc::clone(site)).oneshot(request).await.expect("there is always an answer")
}

/// Its status, and a header.
fn told<'a>(response: &'a Response<Body>, header: &str) -> (u16, &'a str) {
    (response.status().as_u16(), response.headers()[header].to_str().expect("text"))
}

async fn text(response: Response<Body>) -> String {
    let bytes = response.into_body().collect().await.expect("a body").to_bytes();
    String::from_utf8(bytes.to_vec()).expect("text")
}

#[tokio::test]
async fn the_page_asks_for_nothing_that_is_not_here() {
    let (site, _end) = site(|_| {});
    for asset in assets::ALL {
        let response = ask(&site, &format!("GET /assets/{}", asset.name), &[], "").await;
        assert_eq!(told(&response, "content-type"), (200, asset.kind));
        assert_eq!(text(response).await, asset.text);
        // Addresses of other places; the name of SVG's language is not one.
        let rest = asset.text.replace("http://www.w3.org/2000/svg", "");
        assert!(
            !rest.contains("http:") && !rest.contains("https:") && !rest.contains("url("),
            "{}",
            asset.name
        );
        let mentioned = rest.split(['"', '\'']).filter_map(|word| {
            word.strip_prefix("assets/").or_else(|| word.strip_prefix("./")).filter(|name| name.contains('.'))
        });
        for name in mentioned {
            assert!(assets::find(name).is_some(), "{} wants {name}", asset.name);
        }
    }
    let page = ask(&site, "GET /", &[], "").await;
    assert_eq!(page.headers()["cache-control"], "no-cache");
    assert_eq!(ask(&site, "GET /assets/..%2fmod.rs", &[], "").await.status(), 404);
}

#[tokio::test]
async fn a_snapshot_has_what_is_wanted_and_is_not_kept() {
    let (site, _end) = site(|_| {});
    let down = ask(&site, "GET /api/snapshot", &[], "").await;
    assert_eq!(told(&down, "cache-control"), (503, "no-store"));
    up(&site);
    let answer = text(ask(&site, "GET /api/snapshot?history=1", &[], "").await).await;
    let answer: Value = serde_json::from_str(&answer).expect("JSON");
    assert_eq!((&answer["life"], &answer["axes"][6]["name"]), (&1.into(), &"wrist".into()));
    assert_eq!(answer["axes"][0]["speed_history"].as_array().map(Vec::len), Some(1));
    for wrong in ["history=-1", "axis=8", "axis=0", "colour=red"] {
        let answer = ask(&site, &format!("GET /api/snapshot?{wrong}"), &[], "").await;
        assert_eq!(answer.status(), 400, "{wrong}");
    }
    assert_eq!(ask(&site, "DELETE /api/snapshot", &[], "").await.status(), 405);
    assert_eq!(ask(&site, "GET /api/nothing", &[], "").await.status(), 404);
}

#[tokio::test]
async fn orders_are_json_short_and_known() {
    let token = |options: &mut Options| {
        (options.control, options.token) = (true, TOKEN.parse().ok());
    };
    let (site, _end) = site(token);
    let known = ("authorization", "bearer sixteen-letters-or-more");
    let json = ("content-type", "application/json; charset=utf-8");
    let status = async |headers: &[(&str, &str)], body: &str| {
        ask(&site, "POST /api/halt", headers, body).await.status().as_u16()
    };
    assert_eq!(status(&[json], "{}").await, 401);
    assert_eq!(status(&[known], "{}").await, 415);
    assert_eq!(status(&[known, ("content-type", "text/plain")], "{}").await, 415);
    assert_eq!(status(&[known, json], &format!("{{\"axes\":[{}]}}", "1,".repeat(4000))).await, 413);
    assert_eq!(status(&[known, json], "{\"axis\":1}").await, 400);
    // Nobody is there who could halt.
    assert_eq!(status(&[known, json], "{}").await, 503);
    assert_eq!(ask(&site, "GET /api/halt", &[known], "").await.status(), 405);
    let secret = ask(&site, "GET /api/snapshot?token=sixteen-letters-or-more", &[], "").await;
    assert_eq!(told(&secret, "www-authenticate"), (401, "Bearer"));
}

#[tokio::test]
async fn only_so_many_may_watch_and_so_many_movements_wait() {
    let (site, end) = site(|options| {
        options.limits = Limits { viewers: 1, movements: 0, ..Limits::default() };
        options.control = true;
    });
    let mut first = ask(&site, "GET /api/events", &[], "").await.into_body();
    let second = ask(&site, "GET /api/events", &[], "").await;
    assert_eq!(told(&second, "retry-after"), (503, "5"));
    site.board.write(&mut site.live.look());
    let chunk = first.frame().await.expect("a chunk").expect("no error").into_data().expect("data");
    assert!(chunk.starts_with(b"event: set\n"), "{chunk:?}");
    let json = [("content-type", "application/json")];
    assert_eq!(ask(&site, "POST /api/origin", &json, "{}").await.status(), 429);
    assert_eq!(ask(&site, "POST /api/halt", &json, "{}").await.status(), 503, "halting is never too many");
    end.send_replace(true);
    assert!(first.frame().await.is_none(), "the stream ends with the server");
    drop(first);
    assert_eq!(site.viewers.available_permits(), 1);
}

#[tokio::test]
async fn who_does_not_ask_in_time_is_sent_away() {
    let home = Home::of("serve-unit-test".parse().expect("a name")).expect("a place");
    let short = std::time::Duration::from_millis(100);
    let limits = Limits { connections: 1, head: short, body: short, ..Limits::default() };
    let listen = (Ipv4Addr::LOCALHOST, 0).into();
    let server = Server::bind(Options {
        home,
        listen,
        token: TOKEN.parse().ok(),
        control: true,
        hosts: vec![],
        limits,
    })
    .expect("a free port");
    let place = server.address().expect("an address");
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    let running = tokio::spawn(server.run(async move { drop(ended.await) }));

    let mut silent = TcpStream::connect(place).await.expect("it listens");
    let mut next = TcpStream::connect(place).await.expect("it waits its turn");
    let order = format!(
        "POST /api/halt HTTP/1.1\r\nHost: {place}\r\nAuthorization: Bearer {TOKEN}\r\n\
         Content-Type: application/json\r\nContent-Length: 9\r\n\r\n{{"
    );
    next.write_all(order.as_bytes()).await.expect("sent");
    let mut said = String::new();
    silent.read_to_string(&mut said).await.expect("the end");
    assert!(said.is_empty() || said.starts_with("HTTP/1.1 408"), "{said}");
    next.read_to_string(&mut said).await.expect("the end");
    assert!(said.contains("HTTP/1.1 408"), "{said}");
    end.send(()).expect("it runs");
    running.await.expect("it ends");
}
