//! The functions that a script has over those of the language: their names, and how each is called. What they do is in
//! `robot`; their arguments are taken as they come, so that `arguments` can say what is wrong with them.

use std::sync::{Arc, Mutex};

use rhai::{Array, Dynamic, Engine, EvalAltResult, EvalContext, Expression, ImmutableString};

use super::begun::Handle;
use super::robot::Robot;
use super::trouble::{self, Trouble};
use super::{language, lock};

/// Every function, and the ways to call it.
pub(super) const SIGNATURES: [(&str, &str); 24] = [
    ("origin", "`origin()`, `origin(axis)` or `origin([axis, axis])`"),
    ("reference", "`reference(axis)`"),
    ("go_to", "`go_to(axis, position)` or `go_to(axis, position, speed)`"),
    ("move_by", "`move_by(axis, steps)` or `move_by(axis, steps, speed)`"),
    ("slew", "`slew(axis, steps, speed)`"),
    ("line", "`line(#{ axis: steps, axis: steps })` or `line(#{ axis: steps, axis: steps }, speed)`"),
    (
        "line_to",
        "`line_to(#{ axis: position, axis: position })` or `line_to(#{ axis: position, axis: position }, speed)`",
    ),
    ("path", "`path([#{ axis: steps }, #{ axis: steps }])` or `path([#{ axis: steps }], speed)`"),
    (
        "path_to",
        "`path_to([#{ axis: position }, #{ axis: position }])` or `path_to([#{ axis: position }], speed)`",
    ),
    ("wait", "`wait(seconds)` or `wait(handle)`"),
    ("wait_all", "`wait_all([handle, handle])`"),
    ("wait_any", "`wait_any([handle, handle])`"),
    ("is_done", "`is_done(handle)`"),
    ("now", "`now()`"),
    ("param", "`param(name)` or `param(name, default)`"),
    ("speed", "`speed(steps_per_second)` or `speed(axis, steps_per_second)`"),
    ("output", "`output(output, on)`"),
    ("input", "`input(input)`"),
    ("wait_for", "`wait_for(input, level, timeout_in_seconds)`"),
    ("position", "`position(axis)`"),
    ("status", "`status(axis)`"),
    ("halt", "`halt()`, `halt(axis)` or `halt([axis, axis])`"),
    ("brake", "`brake()`, `brake(axis)` or `brake([axis, axis])`"),
    ("clear", "`clear()`, `clear(axis)` or `clear([axis, axis])`"),
];

/// Gives the engine all of them.
pub(super) fn register(engine: &mut Engine, robot: &Arc<Mutex<Robot>>) {
    trouble::register(engine);
    register_handles(engine, robot);
    let mut library = Library { engine, robot: Arc::clone(robot) };
    library.none("origin", Robot::originate_all);
    library.one("origin", Robot::originate);
    library.one("reference", Robot::seek_reference);
    library.two("go_to", |robot, axis, position| robot.go_to(axis, position, None));
    library.three("go_to", |robot, axis, position, speed| robot.go_to(axis, position, Some(speed)));
    library.two("move_by", |robot, axis, steps| robot.move_by(axis, steps, None));
    library.three("move_by", |robot, axis, steps, speed| robot.move_by(axis, steps, Some(speed)));
    library.three("slew", Robot::slew);
    library.one("line", |robot, parts| robot.line(parts, None));
    library.two("line", |robot, parts, speed| robot.line(parts, Some(speed)));
    library.one("line_to", |robot, targets| robot.line_to(targets, None));
    library.two("line_to", |robot, targets, speed| robot.line_to(targets, Some(speed)));
    library.one("path", |robot, legs| robot.path(legs, None));
    library.two("path", |robot, legs, speed| robot.path(legs, Some(speed)));
    library.one("path_to", |robot, legs| robot.path_to(legs, None));
    library.two("path_to", |robot, legs, speed| robot.path_to(legs, Some(speed)));
    library.one("wait", Robot::wait);
    library.one("wait_all", Robot::wait_all);
    library.one("wait_any", Robot::wait_any);
    library.one("is_done", Robot::is_done);
    library.none("now", Robot::now);
    library.one("param", |robot, name| robot.parameter(name, None));
    library.two("param", |robot, name, default| robot.parameter(name, Some(default)));
    library.one("speed", Robot::set_speed);
    library.two("speed", Robot::set_speed_of);
    library.two("output", Robot::set_output);
    library.one("input", Robot::input);
    library.three("wait_for", Robot::wait_for);
    library.one("position", Robot::position);
    library.one("status", Robot::status);
    library.none("halt", |robot| robot.halt(None));
    library.one("halt", |robot, axes| robot.halt(Some(axes)));
    library.none("brake", |robot| robot.brake(None));
    library.one("brake", |robot, axes| robot.brake(Some(axes)));
    library.none("clear", |robot| robot.clear(None));
    library.one("clear", |robot, axes| robot.clear(Some(axes)));
    // The language empties strings and arrays with a function of this name, and prefers it for being more particular.
    let clear =
        |robot: &Arc<Mutex<Robot>>, axes: Dynamic| -> Called { Ok(lock(robot).clear(Some(&axes))?.into()) };
    let robot = Arc::clone(&library.robot);
    library.engine.register_fn("clear", move |axis: ImmutableString| clear(&robot, axis.into()));
    let robot = Arc::clone(&library.robot);
    library.engine.register_fn("clear", move |axes: Array| clear(&robot, axes.into()));
}

/// Gives the engine the blocks whose movements are begun, and what they return.
fn register_handles(engine: &mut Engine, robot: &Arc<Mutex<Robot>>) {
    let looked_at = Arc::clone(robot);
    let done = move |handle: &mut Handle| -> Called {
        Ok(lock(&looked_at).is_done(&Dynamic::from(handle.clone()))?.into())
    };
    engine
        .register_type_with_name::<Handle>("Handle")
        .register_get("done", done)
        .register_fn("to_string", |_: &mut Handle| "a handle".to_owned())
        .register_fn("to_debug", |_: &mut Handle| "a handle".to_owned());
    let (begins, joins) = (Arc::clone(robot), Arc::clone(robot));
    language::register_blocks(
        engine,
        move |context, block| block_of(&begins, context, block).map(Dynamic::from),
        move |context, block| {
            let handle = block_of(&joins, context, block)?;
            Ok(lock(&joins).together(&handle)?)
        },
    );
}

/// Carries out a block, and gives what it has begun.
fn block_of(
    robot: &Arc<Mutex<Robot>>,
    context: &mut EvalContext,
    block: &Expression,
) -> Result<Handle, Box<EvalAltResult>> {
    lock(robot).open_block();
    let result = context.eval_expression_tree(block);
    let mut robot = lock(robot);
    match result {
        Ok(_) => Ok(robot.close_block(block.position())),
        Err(error) => {
            robot.call_off_block();
            Err(error)
        }
    }
}

/// An engine, and the robot that its functions work on.
struct Library<'a> {
    engine: &'a mut Engine,
    robot: Arc<Mutex<Robot>>,
}

type Called = Result<Dynamic, Box<EvalAltResult>>;

impl Library<'_> {
    fn none<T: Into<Dynamic> + 'static>(&mut self, name: &str, act: fn(&mut Robot) -> Result<T, Trouble>) {
        let robot = Arc::clone(&self.robot);
        let call = move || -> Called { Ok(act(&mut lock(&robot))?.into()) };
        self.engine.register_fn(name, call);
    }

    fn one<T: Into<Dynamic> + 'static>(
        &mut self,
        name: &str,
        act: fn(&mut Robot, &Dynamic) -> Result<T, Trouble>,
    ) {
        let robot = Arc::clone(&self.robot);
        let call = move |first: Dynamic| -> Called { Ok(act(&mut lock(&robot), &first)?.into()) };
        self.engine.register_fn(name, call);
    }

    fn two<T: Into<Dynamic> + 'static>(
        &mut self,
        name: &str,
        act: fn(&mut Robot, &Dynamic, &Dynamic) -> Result<T, Trouble>,
    ) {
        let robot = Arc::clone(&self.robot);
        let call = move |first: Dynamic, second: Dynamic| -> Called {
            Ok(act(&mut lock(&robot), &first, &second)?.into())
        };
        self.engine.register_fn(name, call);
    }

    fn three<T: Into<Dynamic> + 'static>(
        &mut self,
        name: &str,
        act: fn(&mut Robot, &Dynamic, &Dynamic, &Dynamic) -> Result<T, Trouble>,
    ) {
        let robot = Arc::clone(&self.robot);
        let call = move |first: Dynamic, second: Dynamic, third: Dynamic| -> Called {
            Ok(act(&mut lock(&robot), &first, &second, &third)?.into())
        };
        self.engine.register_fn(name, call);
    }
}
