//! The profiles of ramps, in texts and in files.

use std::fs;
use std::path::Path;

use super::{AXIS, axis_and, breaks};
use crate::{Config, ConfigError, CountTable, Differences, Linear, Profile, RampConfig, ShortMoves, Sin2};

fn good(text: &str) -> Config {
    Config::from_toml(text, "set.toml").unwrap_or_else(|error| panic!("{error}"))
}

const LINEAR: &str = "[ramp]\nprofile = \"linear\"\nf_start = 700\nf_max = 6_000.0\nt_a = 0.3\n";

#[test]
fn a_linear_ramp_in_the_names_of_the_paper() {
    let set = good(&axis_and(LINEAR));
    let linear = Linear { f_start: 700.0, f_max: 6_000.0, t_a: 0.3 };
    // 0.3 s · 2 000 000 / 232 = 2 586.2; a third of it.
    assert_eq!(set.ramp, RampConfig { brake_interval_ticks: 862, ..linear.into() });
    assert_eq!(set.ramp.interval_ticks(), 2_586);
}

#[test]
fn a_table_stands_in_the_text_or_beside_it() {
    let table = CountTable { counts: vec![3_000, 2_900, 2_850], interval_ticks: 3_000 };
    let set = good(&axis_and(
        "ramp = { profile = \"table\", counts = [3000, 2900, 2850], interval_ticks = 3000 }\n",
    ));
    assert_eq!(set.axes[0].ramp, Some(table.clone().into()));
    // The interval is the paper's if nobody says otherwise.
    let set = good(&axis_and("ramp = { profile = \"table\", counts = [3000, 2900] }\n"));
    assert_eq!(set.axes[0].ramp.as_ref().map(RampConfig::interval_ticks), Some(2_580));

    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("tables")).expect("a folder");
    let text = "\u{feff}# as measured\r\n3000\r\n\n  2900 # the second\n2850";
    fs::write(folder.path().join("tables/x.txt"), text).expect("a file");
    let own = "ramp = { profile = \"table\", file = \"tables/x.txt\", interval_ticks = 3000 }\n";
    let path = folder.path().join("cell.toml");
    fs::write(&path, axis_and(own)).expect("a file");
    let set = Config::load(&path).expect("sound");
    assert_eq!(set.axes[0].ramp, Some(table.into()));
    // The effective configuration has the numbers, not the name: whoever gets it needs no file.
    assert!(!set.to_toml().contains("x.txt"));
    assert_eq!(good(&set.to_toml()), set);
    // And each has a place.
    let origins = Config::origins(Some(&path)).expect("sound");
    let of = |key: &str| {
        let one = origins.iter().find(|one| one.key.to_string() == key);
        let one = one.unwrap_or_else(|| panic!("no {key}"));
        (one.value.to_string(), one.source.to_string().replace(&folder.path().display().to_string(), ""))
    };
    assert_eq!(of("axis[0].ramp.counts[1]"), ("2900".into(), "/tables/x.txt:4:3".into()));
    assert_eq!(of("axis[0].ramp.profile"), ("\"table\"".into(), "/cell.toml:6:20".into()));
    assert_eq!(of("axis[0].ramp.brake_interval_ticks"), ("1000".into(), "default".into()));
}

#[test]
fn an_axis_has_from_the_set_what_goes_with_its_profile() {
    let set = "[ramp]\nphase = 0.21\nbrake_interval_ticks = 800\noffset = 12\nshort_moves = \"paper\"\ndifferences = \"wide\"\n";
    let own = "ramp = { profile = \"linear\", f_start = 200, f_max = 6_000, t_a = 0.1 }\n";
    let config = good(&axis_and(&format!("{own}{set}")));
    let expected = RampConfig {
        offset: 12,
        short_moves: ShortMoves::Paper,
        differences: Differences::Wide,
        ..Linear { f_start: 200.0, f_max: 6_000.0, t_a: 0.1 }.into()
    };
    // 0.1 s · 2 000 000 / 232 / 3 = 287.4; the 800 of the set are for another interval.
    assert_eq!(expected.brake_interval_ticks, 287);
    assert_eq!(config.axes[0].ramp, Some(expected));

    // Without a profile of its own, the set's counts.
    let config = good(&axis_and(&format!("ramp = {{ f_max = 7_000 }}\n{LINEAR}")));
    assert_eq!(config.axes[0].ramp, Some(Linear { f_start: 700.0, f_max: 7_000.0, t_a: 0.3 }.into()));
    // A table of its own replaces the set's.
    let config = good(&axis_and(
        "ramp.counts = [3000, 2900]\n[ramp]\nprofile = \"table\"\ncounts = [3000, 2990]\ninterval_ticks = 500\n",
    ));
    let table = CountTable { counts: vec![3_000, 2_900], interval_ticks: 500 };
    assert_eq!(config.axes[0].ramp.as_ref().map(|ramp| &ramp.profile), Some(&Profile::Table(table)));
    // Back to the default profile.
    let config = good(&axis_and(&format!("ramp = {{ profile = \"sin2\", phase = 0.21 }}\n{LINEAR}")));
    assert_eq!(config.axes[0].ramp, Some(Sin2 { phase: 0.21, ..Sin2::default() }.into()));
}

#[test]
fn keys_of_another_profile_are_told_whose_they_are() {
    breaks(
        &axis_and("[ramp]\nf_max = 6_000\n"),
        "set.toml:7:1: ramp.f_max: `f_max` belongs to the profile `linear`, and this ramp is `sin2`",
        "or write `profile = \"linear\"`",
    );
    breaks(
        &axis_and(&format!("{LINEAR}interval_ticks = 2_580\n")),
        "set.toml:11:1: ramp.interval_ticks: `interval_ticks` belongs to the profile `sin2` or `table`, and this ramp is `linear`",
        "its interval is t_a / 232",
    );
    // The profile may be the set's.
    breaks(
        &axis_and(&format!("ramp = {{ amplitude = 6_000 }}\n{LINEAR}")),
        "set.toml:6:10: axis[0].ramp.amplitude: `amplitude` belongs to the profile `sin2`, and this ramp is `linear`",
        "a linear ramp has `f_start`, `f_max`, `t_a`",
    );
    breaks(
        &axis_and("ramp = { profile = \"table\", counts = [9, 8], t_a = 1 }\n"),
        "set.toml:6:46: axis[0].ramp.t_a: `t_a` belongs to the profile `linear`, and this ramp is `table`",
        "a table ramp has `file`, `counts`, `interval_ticks`",
    );
    breaks(
        &axis_and("[ramp]\nprofile = \"liner\"\n"),
        "set.toml:7:11: ramp.profile: \"liner\" is not one of the words for this",
        "did you mean `linear`?",
    );
    breaks(
        &axis_and("[ramp]\nprofile = 3\n"),
        "set.toml:7:11: ramp.profile: 3 stands where a word in quotes is needed",
        "Speed over time",
    );
    breaks(
        &axis_and("[ramp]\nf_stat = 3\n"),
        "set.toml:7:1: ramp.f_stat: there is no key `f_stat` here",
        "did you mean `f_start`?",
    );
}

#[test]
fn a_profile_without_its_numbers_is_none() {
    breaks(
        &axis_and("[ramp]\nprofile = \"linear\"\nf_start = 200\nt_a = 0.3\n"),
        "set.toml:6:1: ramp.f_max: the key `f_max` is missing",
        "the constant frequency",
    );
    breaks(
        &axis_and("[ramp]\nprofile = \"table\"\n"),
        "set.toml:6:1: ramp.file: the key `file` is missing",
        "name a `file`",
    );
    breaks(
        &axis_and("[ramp]\nprofile = \"table\"\nfile = \"x.txt\"\ncounts = [3, 2]\n"),
        "set.toml:8:8: ramp.file: `file` and `counts` both give the table",
        "remove one",
    );
    breaks(
        &axis_and("[ramp]\nprofile = \"table\"\nfile = \"x.txt\"\n"),
        "set.toml:8:8: ramp.file: this text comes from no file, beside which the table could be looked for",
        "write the numbers themselves",
    );
}

#[test]
fn linear_ramps_are_usable() {
    let linear = |more: &str| axis_and(&format!("{LINEAR}{more}"));
    // 200 steps/s: N = 9 999; (6 000 − 200) / 232 = 25 more: 2 000 000 / 225 − 0.5, N = 8 888.
    breaks(
        &linear("").replace("f_start = 700", "f_start = 200"),
        "set.toml:6:1: ramp: this ramp cannot be used: N falls by 1111 at entry 1, more than the 255 that one byte of the \
         table holds; `differences = \"wide\"` would allow it",
        "`differences = \"wide\"`",
    );
    good(&linear("differences = \"wide\"\n").replace("f_start = 700", "f_start = 200"));
    breaks(
        &linear("brake_interval_ticks = 2_587\n"),
        "set.toml:11:24: ramp.brake_interval_ticks: this ramp cannot be used: `brake_interval_ticks` is 2587, longer than \
         the interval of the ramp, t_a / 232, 2586: braking would be slower than halting",
        "or leave it out",
    );
    breaks(
        &linear("").replace("t_a = 0.3", "t_a = 0.0001"),
        "set.toml:10:7: ramp.t_a: this ramp cannot be used: `t_a` is 0.0001 s, and 116 µs are the least: one tick from \
         each of 233 entries to the next",
        "the seconds from `f_start` to `f_max`",
    );
    breaks(
        &linear("").replace("f_max = 6_000.0", "f_max = 600"),
        "set.toml:9:9: ramp.f_max: this ramp cannot be used: `f_max` is 600 steps/s, less than `f_start`, 700",
        "exchange the two",
    );
    breaks(
        &axis_and("ramp = { profile = \"table\", counts = [3000, 2900, 2950] }\n"),
        "set.toml:6:51: axis[0].ramp.counts[2]: this ramp cannot be used: entry 2 is slower than the one before it \
         (N rises from 2900 to 2950): the speeds of a ramp must never fall",
        "never rise",
    );
}

/// What is said to a configuration whose ramp is the table in `x.txt`.
fn said(folder: &Path, table: &str) -> (String, String) {
    fs::write(folder.join("x.txt"), table).expect("a file");
    let path = folder.join("cell.toml");
    fs::write(&path, format!("ramp = {{ profile = \"table\", file = \"x.txt\" }}\n{AXIS}")).expect("a file");
    let error = Config::load(&path).expect_err("it is not good");
    let mut drawn = String::new();
    miette::GraphicalReportHandler::new().render_report(&mut drawn, &error).expect("drawing into a string");
    (error.to_string().replace(&format!("{}/", folder.display()), ""), drawn)
}

#[test]
fn faults_in_a_file_are_told_with_its_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let long = "3000\n".repeat(234);
    for (table, expected) in [
        (
            "3000\n# slower\n2900 # so far\n2950\n",
            "x.txt:4:1: ramp.counts[2]: this ramp cannot be used: entry 2 is slower",
        ),
        (
            "3000\n2700\n",
            "x.txt:2:1: ramp.counts[1]: this ramp cannot be used: N falls by 300 at entry 1, more than",
        ),
        ("3000\n\n  12x\n", "x.txt:3:3: ramp.counts[1]: \"12x\" is not a whole number from 0 to 65 535"),
        ("3000 2900\n", "x.txt:1:1: ramp.counts[0]: \"3000 2900\" is not a whole number"),
        ("70000\n", "x.txt:1:1: ramp.counts[0]: \"70000\" is not a whole number"),
        ("65535\n65300\n", "x.txt:1:1: ramp.counts[0]: this ramp cannot be used: entry 0 is 30.5 steps/s"),
        (
            "# nothing\n",
            "x.txt:1:10: ramp.counts: this ramp cannot be used: the table has 0 entries, a ramp has 2 to 233",
        ),
        (
            &long,
            "x.txt:234:1: ramp.counts: this ramp cannot be used: the table has 234 entries, a ramp has 2 to 233",
        ),
    ] {
        let (message, drawn) = said(folder.path(), table);
        assert!(message.starts_with(expected), "{message}");
        assert!(drawn.contains("x.txt:"), "{drawn}");
    }
    fs::remove_file(folder.path().join("x.txt")).expect("it was there");
    let error = Config::load(folder.path().join("cell.toml")).expect_err("the table is gone");
    let ConfigError::One(fault) = &error else { panic!("{error}") };
    assert_eq!((fault.line(), fault.key().to_string().as_str()), (1, "ramp.file"));
    assert!(error.to_string().contains("x.txt cannot be read: "), "{error}");
}
