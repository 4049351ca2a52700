//! What a function of the robot throws: a value that a script can catch and look at, and that keeps what it was made
//! of, so that nothing is lost when nobody catches it.

use rhai::{Array, Dynamic, Engine, EvalAltResult, Position};
use supersigma_protocol::Tick;

use crate::executive::{Failure, Knowledge};

/// Why a function did not do what it was called for.
#[derive(Debug, Clone, thiserror::Error)]
pub(super) enum Trouble {
    /// The robot, or the way to it.
    #[error("{message}")]
    Robot {
        failure: Failure,
        /// In words, with the names of the set's axes.
        message: Box<str>,
        /// The axis that it concerns, as people call it.
        axis: Option<Box<str>>,
        /// When.
        tick: Option<Tick>,
        /// If it is several failures: each of them.
        each: Box<[Trouble]>,
    },
    /// An input that did not come.
    #[error("input {input} did not become {level} within {seconds} s")]
    Timeout { input: String, level: bool, seconds: f64, tick: Option<Tick> },
    /// An argument that means nothing.
    #[error("{message}")]
    Wrong { message: String, help: Option<String> },
    /// Somebody wants the program to end.
    #[error("interrupted")]
    Interrupted,
}

impl Trouble {
    /// A failure, with the name of its axis; of several the first one's.
    pub(super) fn robot(failure: Failure, knowledge: &Knowledge, tick: Option<Tick>) -> Self {
        let each: Box<[Self]> = match &failure {
            Failure::Several { failures } => {
                failures.iter().map(|one| Self::robot(one.clone(), knowledge, tick)).collect()
            }
            _ => Box::default(),
        };
        let axis = match each.first() {
            Some(Self::Robot { axis, .. }) => axis.clone(),
            _ => failure
                .axis()
                .and_then(|axis| knowledge.config.axis(axis))
                .map(|axis| axis.name.as_str().into()),
        };
        let message = failure.told(knowledge).into();
        Self::Robot { axis, tick: failure.at().or(tick), failure, message, each }
    }

    /// An argument of the wrong type or out of range.
    pub(super) fn wrong(message: impl Into<String>) -> Self {
        Self::Wrong { message: message.into(), help: None }
    }

    /// What it is called in scripts; a failure as it is called in JSON.
    pub(super) fn kind(&self) -> String {
        match self {
            Self::Robot { each, .. } if !each.is_empty() => each[0].kind(),
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

    fn tick(&self) -> Dynamic {
        match self {
            Self::Robot { tick: Some(tick), .. } | Self::Timeout { tick: Some(tick), .. } => {
                i64::try_from(tick.0).map_or(Dynamic::UNIT, Dynamic::from)
            }
            _ => Dynamic::UNIT,
        }
    }

    /// Each of several; of a single one itself.
    fn each(&self) -> Array {
        match self {
            Self::Robot { each, .. } if !each.is_empty() => each.iter().cloned().map(Dynamic::from).collect(),
            _ => vec![Dynamic::from(self.clone())],
        }
    }

    fn axis(&self) -> Dynamic {
        match self {
            Self::Robot { axis: Some(axis), .. } => axis.as_ref().into(),
            _ => Dynamic::UNIT,
        }
    }
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

/// Makes `kind`, `axis`, `tick`, `each` and `message` of what is caught readable.
pub(super) fn register(engine: &mut Engine) {
    engine
        .register_type_with_name::<Trouble>("RobotError")
        .register_get("kind", |trouble: &mut Trouble| trouble.kind())
        .register_get("axis", |trouble: &mut Trouble| trouble.axis())
        .register_get("tick", |trouble: &mut Trouble| trouble.tick())
        .register_get("each", |trouble: &mut Trouble| trouble.each())
        .register_get("message", |trouble: &mut Trouble| trouble.to_string())
        .register_fn("to_string", |trouble: &mut Trouble| trouble.to_string())
        .register_fn("to_debug", |trouble: &mut Trouble| format!("{}: {trouble}", trouble.kind()));
}
