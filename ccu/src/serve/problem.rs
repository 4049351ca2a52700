//! What a request is answered that does not go well: a status, and one JSON object with the keys that the command line
//! uses with `--json`.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use miette::Diagnostic;
use serde_json::json;
use supersigma_protocol::AxisNumber;

use crate::executive::{Failure, Knowledge};

/// Why there is no other answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Problem {
    status: StatusCode,
    code: String,
    axis: Option<AxisNumber>,
    name: Option<String>,
    message: String,
    help: Option<String>,
}

impl Problem {
    pub(super) fn new(status: StatusCode, code: &str, message: impl Into<String>) -> Self {
        Self { status, code: code.to_owned(), axis: None, name: None, message: message.into(), help: None }
    }

    pub(super) fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }

    /// An order that makes no sense.
    pub(super) fn wrong(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "wrongly_asked", message)
    }

    /// What the set said to an order.
    pub(super) fn of(failure: &Failure, knowledge: Option<&Knowledge>) -> Self {
        let status = match failure.exit_code() {
            2 => StatusCode::BAD_REQUEST,
            3 => StatusCode::SERVICE_UNAVAILABLE,
            _ => StatusCode::CONFLICT,
        };
        let axis = failure.axis();
        let name = axis.zip(knowledge).and_then(|(axis, known)| Some(known.config.axis(axis)?.name.clone()));
        let message = knowledge.map_or_else(|| failure.to_string(), |known| failure.told(known));
        let help = failure.help().map(|help| help.to_string());
        Self { status, code: failure.kind(), axis, name, message, help }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let Self { status, code, axis, name, message, help } = self;
        let body = json!({ "error": {
            "code": code, "axis": axis, "name": name, "message": message, "help": help,
        } });
        (status, Json(body)).into_response()
    }
}
