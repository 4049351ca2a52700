//! What a function of the robot throws: a value that a script can catch and look at, and that keeps what it was made
//! of, so that nothing is lost when nobody catches it.

use rhai::{Dynamic, Engine, EvalAltResult, Position};

use crate::executive::{Failure, Knowledge};

/// Why a function did not do what it was called for.
#[derive(Debug, Clone, thiserror::Error)]
pub(super) enum Trouble {
    /// The robot, or the way to it.
    #[error("{failure}")]
    Robot {
        failure: Failure,
        /// The axis that it concerns, as people call it.
        axis: Option<String>,
    },
    /// An input that did not come.
    #[error("input {input} did not become {level} within {seconds} s")]
    Timeout { input: String, level: bool, seconds: f64 },
    /// An argument that means nothing.
    #[error("{message}")]
    Wrong { message: String, help: Option<String> },
    /// Somebody wants the program to end.
    #[error("interrupted")]
    Interrupted,
}

impl Trouble {
    /// A failure, with the name of its axis.
    pub(super) fn robot(failure: Failure, knowledge: &Knowledge) -> Self {
        let axis = axis_of(&failure).and_then(|number| knowledge.config.find_axis(&number));
        Self::Robot { axis: axis.map(|axis| axis.name.clone()), failure }
    }

    /// An argument of the wrong type or out of range.
    pub(super) fn wrong(message: impl Into<String>) -> Self {
        Self::Wrong { message: message.into(), help: None }
    }

    /// What it is called in scripts; a failure as it is called in JSON.
    pub(super) fn kind(&self) -> String {
        match self {
            Self::Robot { failure, .. } => failure.kind(),
            Self::Timeout { .. } => "timeout".into(),
            Self::Wrong { .. } => "wrong_argument".into(),
            Self::Interrupted => "interrupted".into(),
        }
    }

    /// Whether a script may catch it. It cannot go on without a set, nor against the will of whoever ended it.
    fn can_be_caught(&self) -> bool {
        match self {
            Self::Robot { failure, .. } => *failure != Failure::Cancelled && failure.exit_code() != 3,
            Self::Timeout { .. } | Self::Wrong { .. } => true,
            Self::Interrupted => false,
        }
    }

    fn axis(&self) -> Dynamic {
        match self {
            Self::Robot { axis: Some(axis), .. } => axis.into(),
            _ => Dynamic::UNIT,
        }
    }
}

/// The number of the axis that a failure names, in digits.
fn axis_of(failure: &Failure) -> Option<String> {
    let failure = serde_json::to_value(failure).ok()?;
    let (_, fields) = failure.as_object()?.iter().next()?;
    Some(fields.get("axis")?.to_string())
}

impl From<Trouble> for Box<EvalAltResult> {
    fn from(trouble: Trouble) -> Self {
        let caught = trouble.can_be_caught();
        let thrown = Dynamic::from(trouble);
        Box::new(if caught {
            EvalAltResult::ErrorRuntime(thrown, Position::NONE)
        } else {
            EvalAltResult::ErrorTerminated(thrown, Position::NONE)
        })
    }
}

/// Makes `kind`, `axis` and `message` of what is caught readable.
pub(super) fn register(engine: &mut Engine) {
    engine
        .register_type_with_name::<Trouble>("RobotError")
        .register_get("kind", |trouble: &mut Trouble| trouble.kind())
        .register_get("axis", |trouble: &mut Trouble| trouble.axis())
        .register_get("message", |trouble: &mut Trouble| trouble.to_string())
        .register_fn("to_string", |trouble: &mut Trouble| trouble.to_string())
        .register_fn("to_debug", |trouble: &mut Trouble| format!("{}: {trouble}", trouble.kind()));
}
