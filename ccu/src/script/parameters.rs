//! Parameters of a program: what it declares with `param`, and what somebody sets them to. A value is read as the type that
//! the default has.

use std::collections::BTreeMap;

use miette::NamedSource;
use rhai::{AST, ASTNode, Dynamic, Expr, Position, Stmt};
use std::sync::Arc;
use supersigma_config::choose;

use super::arguments::describe;
use super::error::ScriptError;
use super::trouble::Trouble;

/// What parameters are set to, by their names.
pub type Settings = BTreeMap<String, String>;

/// The names of the parameters that a program declares, each once, in the order of its text.
///
/// # Errors
/// If a name is not written out: then nobody can know it before the program runs.
pub(super) fn declared(ast: &AST, source: &NamedSource<Arc<str>>) -> Result<Vec<String>, ScriptError> {
    let mut names: Vec<String> = Vec::new();
    let mut computed: Option<Position> = None;
    ast.walk(&mut |path| {
        let (call, position) = match path.last() {
            Some(
                ASTNode::Expr(Expr::FnCall(call, position)) | ASTNode::Stmt(Stmt::FnCall(call, position)),
            ) => (call, *position),
            _ => return true,
        };
        if call.name == "param" && (1..=2).contains(&call.args.len()) {
            match call.args.first() {
                Some(Expr::StringConstant(name, _)) if !names.iter().any(|known| known == name.as_str()) => {
                    names.push(name.to_string());
                }
                Some(Expr::StringConstant(..)) => {}
                _ => computed = Some(position),
            }
        }
        true
    });
    match computed {
        Some(position) => Err(ScriptError::script(
            "the name of a parameter must be written out, as text".into(),
            Some("write it as param(\"laps\", 3)".into()),
            position,
            source,
        )),
        None => Ok(names),
    }
}

/// A parameter that the program does not have.
pub(super) fn unknown(name: &str, declared: &[String], source: &NamedSource<Arc<str>>) -> ScriptError {
    let help = if declared.is_empty() {
        format!("it declares none; `param({name:?}, 3)` in its text would be one, with 3 as the default")
    } else {
        choose(name, declared.iter().map(String::as_str), "its parameters are")
    };
    let message = format!("the program has no parameter {name:?}");
    ScriptError::script(message, Some(help), Position::NONE, source)
}

/// The value of a parameter: what it is set to, or the default.
pub(super) fn value(
    settings: &Settings,
    name: &Dynamic,
    default: Option<&Dynamic>,
) -> Result<Dynamic, Trouble> {
    let Ok(name) = name.as_immutable_string_ref() else {
        return Err(Trouble::wrong(format!("a parameter's name is text, not {}", describe(name))));
    };
    let Some(text) = settings.get(name.as_str()) else {
        return default.cloned().ok_or_else(|| Trouble::Wrong {
            message: format!("the parameter {:?} is not set", name.as_str()),
            help: Some(format!("set it with `--set {}=VALUE`; it has no default", name.as_str())),
        });
    };
    let Some(default) = default else { return Ok(guess(text)) };
    let (read, what) = if default.is_int() {
        (text.parse::<i64>().ok().map(Dynamic::from), "a whole number")
    } else if default.is_float() {
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        (number.map(Dynamic::from), "a number")
    } else if default.is_bool() {
        (text.parse::<bool>().ok().map(Dynamic::from), "true or false")
    } else if default.is_string() {
        (Some(text.into()), "text")
    } else {
        let found = describe(default);
        return Err(Trouble::wrong(format!(
            "a parameter's default is a number, true, false or text, not {found}"
        )));
    };
    read.ok_or_else(|| Trouble::Wrong {
        message: format!("the parameter {:?} must be {what}, not {text:?}", name.as_str()),
        help: Some(format!("its default is {default}")),
    })
}

/// Without a default nobody knows the type, but the text shows it.
fn guess(text: &str) -> Dynamic {
    if let Ok(whole) = text.parse::<i64>() {
        whole.into()
    } else if let Some(number) = text.parse::<f64>().ok().filter(|number| number.is_finite()) {
        number.into()
    } else if let Ok(flag) = text.parse::<bool>() {
        flag.into()
    } else {
        text.into()
    }
}
