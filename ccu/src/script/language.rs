//! The language of robot programs: Rhai, less what a robot program must not have, and with bounds on everything that
//! could grow. No function of the robot is in here.

use rhai::packages::{
    ArithmeticPackage, BasicArrayPackage, BasicFnPackage, BasicIteratorPackage, BasicMapPackage,
    BasicMathPackage, BasicStringPackage, LogicPackage, MoreStringPackage, Package,
};
use rhai::{Dynamic, Engine, EvalAltResult, EvalContext, Expression, OptimizationLevel, Position};

/// Nested calls. Each takes its part of the thread's stack.
const CALLS: usize = 32;
/// Levels of an expression: of the program, and inside a function.
const EXPRESSION_DEPTHS: (usize, usize) = (64, 32);
/// Variables that exist at one level of calls.
const VARIABLES: usize = 128;
/// Functions of one program.
const FUNCTIONS: usize = 256;
/// Bytes of the strings in one value.
const STRING: usize = 16 * 1024;
/// Elements of the arrays in one value, nested ones counted in.
const ARRAY: usize = 1024;
/// Entries of the maps in one value, nested ones counted in.
const MAP: usize = 256;

/// Words that the language does without, and why.
///
/// With `curry` and with closures a value could hold others that no bound counts, or itself, and would never be freed;
/// through `this` a value can grow where its size is not looked at.
const WITHOUT: [(&str, &str); 5] = [
    ("eval", "write out what it is to do; a robot program is checked before anything moves"),
    ("import", "a robot program stands alone, in one file"),
    ("export", "a robot program stands alone, in one file"),
    ("curry", "write a function with all of its parameters"),
    ("this", "give a function its values as parameters, and assign what it returns"),
];

/// An engine for compiling, and, with the robot's functions, for running.
///
/// The clock and `sleep` of the host are left out, since time is machine time here: `wait` lets it pass. The bounds
/// hold for a program that wants to break them, too: the greatest values in all variables of all calls are some 500 MB.
pub(super) fn engine() -> Engine {
    let mut engine = Engine::new_raw();
    ArithmeticPackage::new().register_into_engine(&mut engine);
    LogicPackage::new().register_into_engine(&mut engine);
    BasicMathPackage::new().register_into_engine(&mut engine);
    BasicStringPackage::new().register_into_engine(&mut engine);
    MoreStringPackage::new().register_into_engine(&mut engine);
    BasicIteratorPackage::new().register_into_engine(&mut engine);
    BasicArrayPackage::new().register_into_engine(&mut engine);
    BasicMapPackage::new().register_into_engine(&mut engine);
    BasicFnPackage::new().register_into_engine(&mut engine);
    engine.register_fn("exit", || -> Result<(), Box<EvalAltResult>> {
        Err(EvalAltResult::Exit(Dynamic::UNIT, Position::NONE).into())
    });
    for (word, _) in WITHOUT {
        engine.disable_symbol(word);
    }
    look_at_sizes(&mut engine);
    // So that a text can be compiled where no robot is.
    let nobody = |_: &mut EvalContext, _: &Expression| -> Result<Dynamic, Box<EvalAltResult>> {
        Err("there is no robot here".into())
    };
    register_blocks(&mut engine, nobody, nobody);
    engine
        .set_allow_anonymous_fn(false)
        .set_strict_variables(true)
        .set_fail_on_invalid_map_property(true)
        .set_optimization_level(OptimizationLevel::None)
        .set_max_call_levels(CALLS)
        .set_max_expr_depths(EXPRESSION_DEPTHS.0, EXPRESSION_DEPTHS.1)
        .set_max_variables(VARIABLES)
        .set_max_functions(FUNCTIONS)
        .set_max_modules(0)
        .set_max_string_size(STRING)
        .set_max_array_size(ARRAY)
        .set_max_map_size(MAP);
    engine
}

/// The two blocks that a robot program has over those of the language.
pub(super) const BLOCKS: [&str; 2] = ["begin", "together"];

/// What a block does.
type Block = Result<Dynamic, Box<EvalAltResult>>;

/// Has `begin { … }` and `together { … }` do this.
pub(super) fn register_blocks(
    engine: &mut Engine,
    begin: impl Fn(&mut EvalContext, &Expression) -> Block + Send + Sync + 'static,
    together: impl Fn(&mut EvalContext, &Expression) -> Block + Send + Sync + 'static,
) {
    let [first, second] = BLOCKS;
    for result in [
        engine
            .register_custom_syntax([first, "$block$"], false, move |context, parts| {
                begin(context, &parts[0])
            })
            .map(drop),
        engine
            .register_custom_syntax([second, "$block$"], false, move |context, parts| {
                together(context, &parts[0])
            })
            .map(drop),
    ] {
        // The two words are plain, and the tests use them.
        debug_assert!(result.is_ok(), "{result:?}");
    }
}

/// Looks at the size of a variable whenever it is used.
///
/// Rhai itself looks at what is assigned, not at what it is assigned into: with `map[key] = value` alone a map would
/// grow for ever, and with `array[0] = array` nest deeper than it could be freed again.
#[expect(deprecated, reason = "it is not: Rhai marks so what may change its form with a version")]
fn look_at_sizes(engine: &mut Engine) {
    engine.on_var(|name, _, context| {
        if let Some(value) = context.scope().get(name) {
            context.engine().ensure_data_size_within_limits(value)?;
        }
        Ok(None)
    });
}

/// What to do instead of using a word that the language does without.
pub(super) fn instead_of(word: &str) -> Option<&'static str> {
    match word {
        "goto" => Some("an axis goes to a position with `go_to(axis, position)`"),
        "sleep" | "timestamp" => Some("time is machine time here; `wait(seconds)` lets it pass"),
        "|" => Some(
            "there are no closures; write a function, or a loop; what moves at once stands in `together { … }`",
        ),
        _ => WITHOUT.into_iter().find(|(without, _)| *without == word).map(|(_, advice)| advice),
    }
}

/// What a program had too much of, and what to do about it, if it was that.
pub(super) fn excess(error: &EvalAltResult) -> Option<(String, String)> {
    let (message, help) = match error {
        EvalAltResult::ErrorTooManyOperations(..) => (
            "the program has made all the operations that it may".to_owned(),
            "see that its loops end, or allow it more".to_owned(),
        ),
        EvalAltResult::ErrorStackOverflow(..) => (
            format!("more than {CALLS} calls are inside each other"),
            "see that a function that calls itself comes to an end".to_owned(),
        ),
        EvalAltResult::ErrorTooManyVariables(..) => (
            format!("more than {VARIABLES} variables exist at once"),
            "keep what belongs together in an array or a map".to_owned(),
        ),
        EvalAltResult::ErrorDataTooLarge(..) => (
            "too much is in one value".to_owned(),
            format!("a value holds at most {STRING} bytes of text, {ARRAY} elements and {MAP} entries"),
        ),
        _ => return None,
    };
    Some((message, help))
}
