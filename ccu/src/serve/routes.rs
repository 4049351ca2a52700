//! What can be read: the page and its parts, snapshots, the configuration, the stream of events, and whether the server
//! is well.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Path, Query, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{Method, StatusCode, Uri};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use futures_util::stream;
use serde::Deserialize;
use serde_json::json;
use supersigma_protocol::AxisNumber;

use super::board::Frames;
use super::problem::Problem;
use super::{Site, assets, guard, orders};
use crate::watch::{Detail, Filter};

/// After this much silence a browser is told that the server is still there.
const STILL_THERE: Duration = Duration::from_secs(10);

/// Everything that the server answers.
pub(super) fn router(site: Arc<Site>) -> Router {
    let mut api = Router::new()
        .route("/api/snapshot", get(snapshot))
        .route("/api/config", get(config))
        .route("/api/events", get(events));
    if site.control {
        api = api.merge(orders::router());
    }
    let api = api.route_layer(middleware::from_fn_with_state(Arc::clone(&site), guard::token));
    Router::new()
        .route("/", get(async || asset("index.html")))
        .route("/assets/{name}", get(async |Path(name): Path<String>| asset(&name)))
        .route("/healthz", get(health))
        .merge(api)
        .fallback(nothing)
        .method_not_allowed_fallback(not_so)
        .layer(middleware::from_fn_with_state(Arc::clone(&site), guard::same_site))
        .with_state(site)
}

fn asset(name: &str) -> Result<Response, Problem> {
    let asset = assets::find(name).ok_or_else(|| not_found(&format!("assets/{name}")))?;
    let headers = [(CONTENT_TYPE, asset.kind), (CACHE_CONTROL, "no-cache")];
    Ok((headers, asset.text).into_response())
}

fn not_found(path: &str) -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "not_found", format!("there is no {path:?} here"))
}

async fn nothing(uri: Uri) -> Problem {
    not_found(uri.path())
}

async fn not_so(method: Method, uri: Uri) -> Problem {
    let message = format!("{} does not take {method}", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "wrongly_asked", message)
}

/// Well: the server answers. Whether the set is up is told, and is not the server's health.
async fn health(State(site): State<Arc<Site>>) -> Response {
    let up = site.live.look().set.is_ok();
    Json(json!({ "ok": true, "set": site.home.name().to_string(), "up": up })).into_response()
}

/// How much of everything.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Wanted {
    frames: usize,
    events: usize,
    history: usize,
    axis: Option<u8>,
    text: String,
    samples: bool,
}

impl Default for Wanted {
    fn default() -> Self {
        let Detail { frames, events, history, filter: Filter { text, all, .. } } = Detail::default();
        Self { frames, events, history, axis: None, text, samples: all }
    }
}

async fn snapshot(
    State(site): State<Arc<Site>>,
    wanted: Result<Query<Wanted>, axum::extract::rejection::QueryRejection>,
) -> Result<Response, Problem> {
    let Query(wanted) = wanted.map_err(|error| Problem::wrong(error.body_text()))?;
    let axis = match wanted.axis {
        None => None,
        Some(number) => Some(
            AxisNumber::new(number)
                .ok_or_else(|| Problem::wrong(format!("{number} is no axis; 1 to 7 are")))?,
        ),
    };
    let detail = Detail {
        frames: wanted.frames,
        filter: Filter { axis, text: wanted.text, all: wanted.samples },
        events: wanted.events,
        history: wanted.history,
    };
    let mut seen = site.live.look();
    match seen.picture(&detail) {
        Some(picture) => Ok(Json(picture).into_response()),
        None => Err(not_up(seen.set.as_ref().err())),
    }
}

async fn config(State(site): State<Arc<Site>>) -> Result<Response, Problem> {
    match &site.live.look().set {
        Ok(watched) => Ok(Json(watched.picture.config()).into_response()),
        Err(reason) => Err(not_up(Some(reason))),
    }
}

fn not_up(reason: Option<&String>) -> Problem {
    let reason = reason.map_or("the set is not up", String::as_str);
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "no_set", reason).help("start it with `ccu up`")
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Stream {
    samples: bool,
}

async fn events(
    State(site): State<Arc<Site>>,
    wanted: Result<Query<Stream>, axum::extract::rejection::QueryRejection>,
) -> Result<Response, Problem> {
    let Query(wanted) = wanted.map_err(|error| Problem::wrong(error.body_text()))?;
    let Ok(permit) = Arc::clone(&site.viewers).try_acquire_owned() else {
        let message = format!("{} are watching already, which is all that may", site.limits.viewers);
        let problem = Problem::new(StatusCode::SERVICE_UNAVAILABLE, "too_many", message);
        return Ok(([(RETRY_AFTER, "5")], problem).into_response());
    };
    let reader = site.board.reader(if wanted.samples { Frames::All } else { Frames::Telling });
    let ended = site.ended.clone();
    let body = stream::unfold((reader, ended, permit), async |(mut reader, mut ended, permit)| {
        let text = tokio::select! {
            _ = ended.wait_for(|ended| *ended) => None,
            text = reader.next() => text,
            () = tokio::time::sleep(STILL_THERE) => Some(":\n\n".to_owned()),
        }?;
        Some((Ok::<_, Infallible>(text), (reader, ended, permit)))
    });
    let headers = [(CONTENT_TYPE, "text/event-stream"), (CACHE_CONTROL, "no-store")];
    Ok((headers, Body::from_stream(body)).into_response())
}
