//! What is said of programs that are wrong, of robots that do not, and that no program takes the machine.

use miette::{GraphicalReportHandler, GraphicalTheme};
use supersigma_config::Config;
use supersigma_protocol::{Alarm, AxisNumber, End, Refusal, Tick};

use super::bench::{Bench, Rig};
use crate::executive::Failure;
use crate::script::ScriptError;

fn drawn(error: &ScriptError) -> String {
    let mut text = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor()).with_width(100);
    handler.render_report(&mut text, error).expect("a string takes it");
    text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
}

fn is_drawn(error: &ScriptError, expected: &str) {
    let expected = expected.trim_start_matches('\n').trim_end();
    let drawn = drawn(error);
    assert_eq!(drawn.trim_end(), expected, "\n{drawn}");
}

#[test]
fn an_unknown_function_is_drawn_with_its_line_and_the_nearest_name() {
    let error = Rig::new().fails("let x = 5;\ngoto(\"left_x\", x);\n");
    assert!(matches!(error, ScriptError::Script { .. }), "{error:?}");
    is_drawn(&error, "");
}
