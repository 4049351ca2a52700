//! What can be seen to be wrong with a program without running it: every call in its text, with the arguments that are
//! written out. Nothing is guessed: what depends on a value that is computed is left to the rehearsal, and what a `try`
//! may be waiting for is not complained about.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use miette::NamedSource;
use rhai::{AST, ASTNode, Dynamic, Expr, FnCallExpr, ParseErrorType, Position, Scope, Stmt};
use supersigma_config::choose;
use supersigma_protocol::{AxisNumber, Distance};

use crate::executive::Knowledge;

use super::arguments::{self as read, Lines};
use super::functions::SIGNATURES;
use super::trouble::Trouble;
use super::{Program, ScriptError, language, parameters};

/// Functions of the language that are no functions to its engine.
const KEYWORDS: [&str; 7] = ["print", "debug", "type_of", "call", "Fn", "is_def_var", "is_def_fn"];

/// What an argument of the robot's functions is.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Axis,
    Axes,
    Steps,
    Position,
    Speed,
    Ceiling,
    Parts,
    Targets,
    Legs,
    Output,
    Input,
    /// On or off, and what the signature calls it.
    Level(&'static str),
    /// A span, and what the signature calls it.
    Seconds(&'static str),
}

/// All that is wrong with the text of a program, in the order of the text; and the program, if it can be run.
#[must_use]
pub fn check(name: &str, text: &str, knowledge: &Knowledge) -> (Vec<ScriptError>, Option<Program>) {
    let source = NamedSource::new(name, Arc::from(text));
    let (mut problems, ast) = compile(text, &source);
    if let Some(ast) = &ast {
        let mut checker = Checker { knowledge, source: &source, ast, known: known(ast), problems: vec![] };
        ast.walk(&mut |path| {
            checker.node(path);
            true
        });
        problems.append(&mut checker.problems);
        problems.extend(parameters::declared(ast, &source).err());
    }
    sort(&mut problems);
    // A variable that does not exist is a problem of the text, though the rest of it could be read.
    let program = Program::compile(name, text).ok();
    (problems, program)
}

/// In the order of the text, each place once.
pub(super) fn sort(problems: &mut Vec<ScriptError>) {
    problems.sort_by_key(|problem| (problem.place().line(), problem.place().column()));
    problems.dedup_by(|one, other| one.to_string() == other.to_string());
}

/// Compiles a text, as often as it has variables that do not exist, so that each of them is told.
fn compile(text: &str, source: &NamedSource<Arc<str>>) -> (Vec<ScriptError>, Option<AST>) {
    let mut engine = language::engine();
    let (mut problems, mut scope) = (Vec::new(), Scope::new());
    loop {
        match engine.compile_with_scope(&scope, text) {
            Ok(ast) => return (problems, Some(ast)),
            Err(error) => {
                problems.push(ScriptError::syntax(&error, source));
                match error.err_type() {
                    ParseErrorType::VariableUndefined(name) if !scope.contains(name) => {
                        scope.push(name.clone(), ());
                    }
                    // Inside a function no scope helps.
                    ParseErrorType::VariableUndefined(_) if engine.strict_variables() => {
                        problems.pop();
                        engine.set_strict_variables(false);
                    }
                    _ => return (problems, None),
                }
            }
        }
    }
}

/// Every function that can be called, and with how many arguments.
fn known(ast: &AST) -> BTreeMap<String, BTreeSet<usize>> {
    let engine = language::engine();
    let mut known: BTreeMap<String, BTreeSet<usize>> = BTreeMap::new();
    let registered = engine.collect_fn_metadata(
        None,
        |function| Some((function.metadata.name.to_string(), function.metadata.num_params)),
        true,
    );
    let own = ast.iter_functions().map(|function| (function.name.to_owned(), function.params.len()));
    for (name, count) in registered.into_iter().chain(own) {
        known.entry(name).or_default().insert(count);
    }
    for (name, signature) in SIGNATURES {
        let calls = signature.split('`').filter(|call| call.starts_with(&format!("{name}(")));
        known.entry(name.into()).or_default().extend(calls.map(arguments_in));
    }
    known
}

/// How many arguments a call has that is written out, as `go_to(axis, position)`.
fn arguments_in(call: &str) -> usize {
    let inside = call.split_once('(').map_or("", |(_, rest)| rest.trim_end_matches(')'));
    let mut depth = 0_usize;
    let mut commas = 0;
    for letter in inside.chars() {
        match letter {
            '[' | '{' => depth += 1,
            ']' | '}' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => commas += 1,
            _ => {}
        }
    }
    if inside.is_empty() { 0 } else { commas + 1 }
}

struct Checker<'a> {
    knowledge: &'a Knowledge,
    source: &'a NamedSource<Arc<str>>,
    ast: &'a AST,
    known: BTreeMap<String, BTreeSet<usize>>,
    problems: Vec<ScriptError>,
}

impl Checker<'_> {
    fn node(&mut self, path: &[ASTNode]) {
        let (call, position, is_method) = match path.last() {
            Some(ASTNode::Expr(Expr::FnCall(call, at)) | ASTNode::Stmt(Stmt::FnCall(call, at))) => {
                (call, *at, false)
            }
            Some(ASTNode::Expr(Expr::MethodCall(call, at))) => (call, *at, true),
            _ => return,
        };
        let is_name = call.name.starts_with(|first: char| first.is_alphabetic() || first == '_');
        if call.op_token.is_some() || !is_name || KEYWORDS.contains(&call.name.as_str()) {
            return;
        }
        if self.exists(call, position, is_method) && !is_method {
            let is_tried = path.iter().any(|node| matches!(node, ASTNode::Stmt(Stmt::TryCatch(..))));
            self.arguments(call, position, is_tried);
        }
    }

    fn exists(&mut self, call: &FnCallExpr, position: Position, is_method: bool) -> bool {
        let name = call.name.as_str();
        let count = call.args.len() + usize::from(is_method);
        let Some(counts) = self.known.get(name) else {
            let help = language::instead_of(name).map_or_else(
                || {
                    let own = self.ast.iter_functions().map(|function| function.name);
                    let functions: Vec<&str> = SIGNATURES.iter().map(|(name, _)| *name).chain(own).collect();
                    choose(name, functions.into_iter(), "the functions of the robot and of this program are")
                },
                str::to_owned,
            );
            self.report(format!("there is no function `{name}`"), Some(help), position);
            return false;
        };
        let own = self.ast.iter_functions().find(|function| function.name == name);
        // A function of the script may be called as a method too, on what would be `this`.
        if counts.contains(&count) || (is_method && own.is_some()) {
            return true;
        }
        // What a method is called on is not among its arguments.
        let of_calls = |count: usize| count.saturating_sub(usize::from(is_method));
        let count = of_calls(count);
        let arguments = if count == 1 { "argument" } else { "arguments" };
        let robots = SIGNATURES.iter().find(|(function, _)| *function == name);
        let help = match (robots, own) {
            (Some((_, calls)), _) => format!("call it as {calls}"),
            (None, Some(own)) => format!("it is defined as `{name}({})`", own.params.join(", ")),
            (None, None) => {
                let counts: Vec<String> = counts.iter().map(|count| of_calls(*count).to_string()).collect();
                format!("it takes {}", counts.join(" or "))
            }
        };
        self.report(format!("`{name}` cannot be called with {count} {arguments}"), Some(help), position);
        false
    }

    fn arguments(&mut self, call: &FnCallExpr, position: Position, is_tried: bool) {
        if self.ast.iter_functions().any(|function| function.name == call.name) {
            return;
        }
        let kinds = kinds(&call.name, call.args.len());
        let mut axis = None;
        for (kind, expression) in kinds.iter().zip(&call.args) {
            let Some(value) = literal(expression) else { continue };
            let at = if expression.position().is_none() { position } else { expression.position() };
            if let Err(trouble) = self.argument(*kind, &value, &mut axis, is_tried) {
                let help = match &trouble {
                    Trouble::Wrong { help, .. } => help.clone(),
                    Trouble::Robot { failure, .. } => {
                        miette::Diagnostic::help(failure).map(|help| help.to_string())
                    }
                    Trouble::Timeout { .. } | Trouble::Interrupted => None,
                };
                self.report(trouble.to_string(), help, at);
            }
        }
    }

    fn argument(
        &self,
        kind: Kind,
        value: &Dynamic,
        axis: &mut Option<AxisNumber>,
        is_tried: bool,
    ) -> Result<(), Trouble> {
        let knowledge = self.knowledge;
        match kind {
            Kind::Axis => *axis = Some(read::axis(knowledge, value)?),
            Kind::Axes => drop(read::axes(knowledge, value)?),
            Kind::Output => drop(read::line(knowledge, Lines::Outputs, value)?),
            Kind::Input => drop(read::line(knowledge, Lines::Inputs, value)?),
            Kind::Level(what) => drop(read::level(what, value)?),
            Kind::Seconds(what) => drop(read::seconds(what, value)?),
            Kind::Steps => {
                let steps = read::whole("steps", value)?;
                if !is_tried {
                    self.steps(steps)?;
                }
            }
            Kind::Position => {
                let target = read::whole("position", value)?;
                if let Some(axis) = axis.filter(|_| !is_tried) {
                    self.target(axis, target)?;
                }
            }
            Kind::Speed => {
                let speed = read::speed(value)?;
                if let Some(axis) = axis.filter(|_| !is_tried) {
                    self.speed(axis, speed)?;
                }
            }
            Kind::Ceiling => {
                if let (Some(speed), false) = (read::ceiling(value)?, is_tried) {
                    let all = knowledge.config.axes.iter().map(|axis| axis.address);
                    for axis in axis.map_or_else(|| all.collect(), |axis| vec![axis]) {
                        self.speed(axis, speed)?;
                    }
                }
            }
            Kind::Parts => {
                let parts = read::parts(knowledge, value)?;
                if !is_tried {
                    self.parts(&parts)?;
                }
            }
            Kind::Legs => {
                let legs = read::legs(knowledge, value)?;
                if !is_tried {
                    legs.iter().try_for_each(|leg| self.parts(leg))?;
                }
            }
            Kind::Targets => {
                let legs = match value.as_array_ref() {
                    Ok(_) => read::legs(knowledge, value)?,
                    Err(_) => vec![read::parts(knowledge, value)?],
                };
                for (axis, target) in legs.into_iter().flatten().filter(|_| !is_tried) {
                    self.target(axis, target)?;
                }
            }
        }
        Ok(())
    }

    fn steps(&self, steps: i64) -> Result<(), Trouble> {
        if steps == 0 {
            return Err(Trouble::wrong("a movement of 0 steps moves nothing"));
        }
        if steps.unsigned_abs() > u64::from(Distance::MAX.get()) {
            return Err(Trouble::robot(crate::executive::Failure::TooFar { steps }, self.knowledge, None));
        }
        Ok(())
    }

    fn parts(&self, parts: &[(AxisNumber, i64)]) -> Result<(), Trouble> {
        if !parts.is_empty() && parts.iter().all(|(_, by)| *by == 0) {
            return self.steps(0);
        }
        parts.iter().filter(|(_, by)| *by != 0).try_for_each(|(_, by)| self.steps(*by))
    }

    fn target(&self, axis: AxisNumber, target: i64) -> Result<(), Trouble> {
        read::within_travel(self.knowledge, axis, target)
            .map_err(|failure| Trouble::robot(failure, self.knowledge, None))
    }

    fn speed(&self, axis: AxisNumber, speed: f64) -> Result<(), Trouble> {
        let index = self.knowledge.speed(axis, speed);
        index.map(drop).map_err(|failure| Trouble::robot(failure, self.knowledge, None))
    }

    fn report(&mut self, message: String, help: Option<String>, position: Position) {
        self.problems.push(ScriptError::script(message, help, position, self.source));
    }
}

/// What the arguments of a function are, in order.
fn kinds(function: &str, count: usize) -> &'static [Kind] {
    match (function, count) {
        ("origin" | "halt" | "brake" | "clear", 1) => &[Kind::Axes],
        ("reference" | "position" | "status", 1) => &[Kind::Axis],
        ("go_to", _) => &[Kind::Axis, Kind::Position, Kind::Speed],
        ("move_by" | "slew", _) => &[Kind::Axis, Kind::Steps, Kind::Speed],
        ("line", _) => &[Kind::Parts, Kind::Speed],
        ("path", _) => &[Kind::Legs, Kind::Speed],
        ("line_to" | "path_to", _) => &[Kind::Targets, Kind::Speed],
        ("speed", 1) => &[Kind::Ceiling],
        ("speed", 2) => &[Kind::Axis, Kind::Ceiling],
        ("wait", 1) => &[Kind::Seconds("seconds")],
        ("output", 2) => &[Kind::Output, Kind::Level("on")],
        ("input", 1) => &[Kind::Input],
        ("wait_for", 3) => &[Kind::Input, Kind::Level("level"), Kind::Seconds("timeout")],
        _ => &[],
    }
}

/// The value of an expression that is written out, with a sign or in brackets too.
fn literal(expression: &Expr) -> Option<Dynamic> {
    match expression {
        Expr::FnCall(call, _) if call.args.len() == 1 && call.name == "-" => {
            let value = literal(&call.args[0])?;
            let whole = value.as_int().ok().and_then(i64::checked_neg).map(Dynamic::from);
            whole.or_else(|| value.as_float().ok().map(|number| (-number).into()))
        }
        Expr::Array(items, _) => {
            items.iter().map(literal).collect::<Option<rhai::Array>>().map(Dynamic::from)
        }
        Expr::Map(entries, _) => {
            let entries = entries.0.iter();
            let map = entries.map(|(name, value)| Some((name.name.as_str().into(), literal(value)?)));
            map.collect::<Option<rhai::Map>>().map(Dynamic::from)
        }
        other => other.get_literal_value(None),
    }
}
