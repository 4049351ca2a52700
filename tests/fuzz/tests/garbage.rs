//! Every way in, fed by chance for a moment; see the crate for what must hold.

use proptest::prelude::*;

fn bytes(most: usize) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..most)
}

/// The built-in set's text with lines taken out, doubled, and cut, and values put in the place of others.
fn changed_config() -> impl Strategy<Value = String> {
    let value = prop_oneof![
        Just("-1".to_owned()),
        Just("nan".to_owned()),
        Just("1e308".to_owned()),
        Just("\"a\"".to_owned()),
        Just("[]".to_owned()),
        Just("{ a = 1 }".to_owned()),
        any::<i64>().prop_map(|number| number.to_string()),
        any::<u16>().prop_map(|number| number.to_string()),
        any::<f64>().prop_map(|number| number.to_string()),
    ];
    let change = (any::<prop::sample::Index>(), 0_u8..5, value);
    prop::collection::vec(change, 0..5).prop_map(|changes| {
        let mut lines: Vec<String> = supersigma_config::DEFAULT_TOML.lines().map(str::to_owned).collect();
        for (at, kind, value) in changes {
            let at = at.index(lines.len());
            match (kind, lines[at].clone().split_once(" = ")) {
                (0, _) => drop(lines.remove(at)),
                (1, _) => lines.insert(at, lines[at].clone()),
                (2, _) => {
                    let middle = lines[at].chars().count() / 2;
                    lines[at] = lines[at].chars().take(middle).collect();
                }
                (_, Some((key, _))) => lines[at] = format!("{key} = {value}"),
                (_, None) => lines[at] += &value,
            }
            if lines.is_empty() {
                break;
            }
        }
        lines.join("\n")
    })
}

/// Text of the signs and words of a configuration.
fn toml_like() -> impl Strategy<Value = String> {
    let word = prop_oneof![
        Just("[[axis]]\n"),
        Just("[ramp]\n"),
        Just("address = 1\n"),
        Just("name = \"a\"\n"),
        Just("rail = { length = 1, "),
        Just("}\n"),
        Just("profile = \"linear\"\n"),
        Just("[axis.motor]\n"),
        Just("[log]\nflush_ms = 1\n"),
        Just("= "),
        Just("\"\"\""),
        Just("\u{1F916}"),
        Just("\0"),
        Just("-9223372036854775808"),
        Just("\n"),
        Just("."),
    ];
    prop::collection::vec(word, 0..24).prop_map(|words| words.concat())
}

/// Statements of the language around the robot's functions, with arguments that fit, and others.
fn robot_like() -> impl Strategy<Value = String> {
    let argument = prop_oneof![
        Just("1".to_owned()),
        Just("\"left_x\"".to_owned()),
        Just("#{ left_x: 100, \"2\": -13 }".to_owned()),
        Just("[#{ left_x: 10 }, #{ left_y: 9 }]".to_owned()),
        Just("[1, 2]".to_owned()),
        Just("n".to_owned()),
        Just("()".to_owned()),
        Just("true".to_owned()),
        any::<i64>().prop_map(|number| number.to_string()),
        any::<i16>().prop_map(|number| number.to_string()),
        (-1e9..1e9_f64).prop_map(|number| format!("{number:?}")),
    ];
    let name = prop::sample::select(vec![
        "origin",
        "reference",
        "go_to",
        "move_by",
        "slew",
        "line",
        "line_to",
        "path",
        "path_to",
        "wait",
        "wait_all",
        "wait_any",
        "is_done",
        "now",
        "param",
        "speed",
        "output",
        "input",
        "wait_for",
        "position",
        "status",
        "halt",
        "brake",
        "clear",
        "print",
        "exit",
        "nothing",
    ]);
    let call = (name, prop::collection::vec(argument, 0..4))
        .prop_map(|(name, arguments)| format!("{name}({});", arguments.join(", ")));
    let block = prop::sample::select(vec![
        "{}",
        "loop {{}}",
        "while n < 3 {{ n += 1; {} }}",
        "together {{ {} }}",
        "let h = begin {{ {} }}; wait(h);",
        "try {{ {} }} catch (e) {{ print(e); }}",
        "fn f(a) {{ {} }} f(1);",
        "if n == 0 {{ {} }}",
        "begin {{ {} }}",
        "for i in 0..9 {{ {} }}",
        "f(n);",
        "{} }",
        "/* {}",
        "throw {}",
    ]);
    let statement = (block, prop::collection::vec(call, 0..3)).prop_map(|(block, calls)| {
        block.replace("{{", "{").replace("}}", "}").replacen("{}", &calls.join(" "), 1)
    });
    (any::<bool>(), prop::collection::vec(statement, 0..6)).prop_map(|(originated, statements)| {
        let first = if originated { "origin();\n" } else { "" };
        format!("let n = 0;\n{first}{}", statements.join("\n"))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn commands(bytes in bytes(12)) {
        supersigma_fuzz::commands(&bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn axis(bytes in bytes(600)) {
        supersigma_fuzz::axis(&bytes);
    }

    #[test]
    fn executive(bytes in bytes(1_500)) {
        supersigma_fuzz::executive(&bytes);
    }

    #[test]
    fn watching(bytes in bytes(600)) {
        supersigma_fuzz::watching(&bytes);
    }

    #[test]
    fn config(text in prop_oneof![changed_config(), toml_like(), "\\PC{0,60}"]) {
        supersigma_fuzz::config(&text);
    }

    #[test]
    fn script(text in prop_oneof![4 => robot_like(), 1 => "\\PC{0,60}"]) {
        supersigma_fuzz::script(&text);
    }

    #[test]
    fn log(bytes in bytes(400)) {
        let log = [mcap::MAGIC, &bytes].concat();
        supersigma_fuzz::log(&log);
    }

    #[test]
    fn changed_log(bytes in bytes(120)) {
        supersigma_fuzz::changed_log(&bytes);
    }

    #[test]
    fn forged_log(bytes in bytes(300)) {
        supersigma_fuzz::forged_log(&bytes);
    }
}

/// Found by libFuzzer: a halt that waits for axes which never stand, on a set that goes down.
#[test]
fn a_halt_ends_with_the_set() {
    let bytes = [
        0x60, 0x07, 0x00, 0x61, 0x74, 0x40, 0x24, 0x60, 0x07, 0x01, 0x05, 0xfb, 0x01, 0x00, 0x00, 0x00, 0x9c,
        0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x40,
        0x61,
    ];
    supersigma_fuzz::executive(&bytes);
}
