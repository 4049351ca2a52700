//! Orders: what a browser may have done, each over the control socket. The set decides what comes of it; nothing is known
//! or believed in here about where axes are.

use std::sync::Arc;

use axum::Json;
use axum::Router;
use axum::body::to_bytes;
use axum::extract::{Request as HttpRequest, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::post;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use supersigma_config::{Config, choose};
use supersigma_protocol::AxisNumber;
use tokio::time::timeout;

use super::Site;
use super::problem::Problem;
use crate::control::Client;
use crate::executive::{Displacement, Failure, Knowledge, Operate, Outcome, Request};
use crate::home::Home;

/// The longest order that is read.
const LONGEST: usize = 4 * 1024;

type Answer = Result<Json<Value>, Problem>;

/// The routes of the orders.
pub(super) fn router() -> Router<Arc<Site>> {
    Router::new()
        .route("/api/halt", post(halt))
        .route("/api/brake", post(brake))
        .route("/api/clear", post(clear))
        .route("/api/resume", post(resume))
        .route("/api/origin", post(origin))
        .route("/api/move", post(movement))
        .route("/api/output", post(output))
}

/// Axes; none means all.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Axes {
    axes: Vec<Name>,
}

/// No words at all.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

/// A movement of one axis, by so many steps or to a position.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Movement {
    axis: Name,
    by: Option<i64>,
    to: Option<i32>,
    speed: Option<f64>,
}

/// A digital output.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Output {
    line: Name,
    on: bool,
}

/// Something that has a number and a name.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a number or a name")]
enum Name {
    Number(u8),
    Name(String),
}

async fn halt(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let Axes { axes } = words(&site, http).await?;
    ask(site.home.clone(), move |set| Ok(Request::Halt { axes: set.axes(&axes)? })).await
}

async fn brake(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let Axes { axes } = words(&site, http).await?;
    ask(site.home.clone(), move |set| Ok(Request::Brake { axes: set.axes(&axes)? })).await
}

async fn clear(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let Axes { axes } = words(&site, http).await?;
    ask(site.home.clone(), move |set| Ok(Request::Clear { axes: set.axes(&axes)? })).await
}

async fn resume(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let Nothing {} = words(&site, http).await?;
    ask_to_move(&site, |_| Ok(Request::Resume)).await
}

async fn origin(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let Axes { axes } = words(&site, http).await?;
    ask_to_move(&site, move |set| Ok(Request::Originate { axes: set.axes(&axes)? })).await
}

async fn movement(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let order: Movement = words(&site, http).await?;
    ask_to_move(&site, move |set| {
        let axis = set.axis(&order.axis)?;
        let by = match (order.by, order.to) {
            (Some(by), None) => by,
            (None, Some(to)) => i64::from(to) - set.position(axis)?,
            _ => return Err(Problem::wrong("a movement has either `by` or `to`")),
        };
        Ok(Request::Move { axis, by: Displacement(by), speed: order.speed, constant: false, wait: false })
    })
    .await
}

async fn output(State(site): State<Arc<Site>>, http: HttpRequest) -> Answer {
    let order: Output = words(&site, http).await?;
    ask(site.home.clone(), move |set| Ok(Request::Output { bit: set.output(&order.line)?, on: order.on }))
        .await
}

/// The words of an order. That they must be JSON makes a browser ask first before it sends another site's.
async fn words<T: DeserializeOwned>(site: &Site, http: HttpRequest) -> Result<T, Problem> {
    if !is_json(http.headers()) {
        let message = "an order is JSON: send it with `Content-Type: application/json`";
        return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "wrongly_asked", message));
    }
    let body = match timeout(site.limits.body, to_bytes(http.into_body(), LONGEST)).await {
        Ok(Ok(body)) => body,
        Ok(Err(error)) => {
            let message = format!("an order has at most {LONGEST} bytes: {error}");
            return Err(Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "wrongly_asked", message));
        }
        Err(_) => {
            let message = "the order did not arrive in time";
            return Err(Problem::new(StatusCode::REQUEST_TIMEOUT, "wrongly_asked", message));
        }
    };
    serde_json::from_slice(&body)
        .map_err(|error| Problem::wrong(format!("the order makes no sense: {error}")))
}

fn is_json(headers: &HeaderMap) -> bool {
    let kind = headers.get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    kind.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/json"))
}

/// Carries out an order that moves something, if not too many are under way.
async fn ask_to_move(
    site: &Site,
    order: impl FnOnce(&mut Set) -> Result<Request, Problem> + Send + 'static,
) -> Answer {
    let Ok(permit) = Arc::clone(&site.movements).try_acquire_owned() else {
        let message = "too many orders are being carried out";
        return Err(Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many", message));
    };
    ask(site.home.clone(), move |set| {
        // The order counts until it is carried out, even if nobody waits for the answer any more.
        set.permit = Some(permit);
        order(set)
    })
    .await
}

async fn ask(
    home: Home,
    order: impl FnOnce(&mut Set) -> Result<Request, Problem> + Send + 'static,
) -> Answer {
    let carried_out = tokio::task::spawn_blocking(move || {
        let mut set = Set::connect(&home)?;
        let request = order(&mut set)?;
        set.operate(request)
    });
    let outcome = carried_out
        .await
        .map_err(|error| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", error.to_string()))??;
    let movements = match outcome {
        Outcome::Moved(movements) => json!(movements),
        _ => json!([]),
    };
    Ok(Json(json!({ "done": true, "movements": movements })))
}

/// The set that an order is for.
struct Set {
    client: Client,
    knowledge: Arc<Knowledge>,
    permit: Option<tokio::sync::OwnedSemaphorePermit>,
}

impl Set {
    fn connect(home: &Home) -> Result<Self, Problem> {
        let connect = || {
            let mut client = Client::connect(home)?;
            let told = |error: &dyn std::fmt::Display| Failure::Control { reason: error.to_string() };
            let config = Config::from_toml(&client.describe()?.config, "the set's configuration")
                .map_err(|error| told(&error))?;
            let knowledge = Knowledge::new(config).map_err(|error| told(&error))?;
            Ok(Self { client, knowledge, permit: None })
        };
        connect().map_err(|failure| Problem::of(&failure, None))
    }

    fn operate(&mut self, request: Request) -> Result<Outcome, Problem> {
        self.client.operate(request).map_err(|failure| Problem::of(&failure, Some(&self.knowledge)))
    }

    fn axes(&self, names: &[Name]) -> Result<Vec<AxisNumber>, Problem> {
        names.iter().map(|name| self.axis(name)).collect()
    }

    fn axis(&self, name: &Name) -> Result<AxisNumber, Problem> {
        let config = &self.knowledge.config;
        let found = match name {
            Name::Number(number) => config.find_axis(&number.to_string()),
            Name::Name(name) => config.find_axis(name),
        };
        let names = config.axes.iter().map(|axis| axis.name.as_str());
        found.map(|axis| axis.address).ok_or_else(|| unknown("axis", "its axes are", name, names))
    }

    fn output(&self, name: &Name) -> Result<u8, Problem> {
        let lines = &self.knowledge.config.digital.outputs;
        let found = match name {
            Name::Number(bit) => (*bit < 16).then_some(*bit),
            Name::Name(name) => lines.iter().find(|line| line.name == *name).map(|line| line.bit),
        };
        let names = lines.iter().map(|line| line.name.as_str());
        found.ok_or_else(|| unknown("output", "its outputs are", name, names))
    }

    /// Where an axis stands, as its card says now.
    fn position(&mut self, axis: AxisNumber) -> Result<i64, Problem> {
        let Outcome::Axes(states) = self.operate(Request::Status { axes: vec![axis] })? else {
            return Err(Problem::new(
                StatusCode::BAD_GATEWAY,
                "control",
                "the set has answered something else",
            ));
        };
        let state = states.first().and_then(|state| state.report);
        state.and_then(|report| report.position).map(|position| i64::from(position.0)).ok_or_else(|| {
            let whom = self.knowledge.number_and_name(axis);
            let message = format!("{whom} does not know where it is, so it cannot go to a position");
            Problem::new(StatusCode::CONFLICT, "unknown_position", message).help("find its origin first")
        })
    }
}

fn unknown<'a>(
    what: &str,
    known: &str,
    name: &Name,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Problem {
    let name = match name {
        Name::Number(number) => number.to_string(),
        Name::Name(name) => name.clone(),
    };
    Problem::wrong(format!("this set has no {what} {name:?}")).help(choose(&name, names, known))
}
