//! The test bench as people use it: programs, files that others can read, steps that are lost, wrong questions, Ctrl-C.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use supersigma_tests::{Cell, Ran, Signal, eventually};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");
const PROFILE: &str = "bench positioning --f-start 200 --f-max 2000 --ta 0.2 --tc 0.1";

fn report(ran: &Ran) -> Value {
    let [report] = &ran.json()[..] else { panic!("one report: {ran}") };
    report.clone()
}

/// The times of all messages in nanoseconds, and every hundredth message and the last.
fn read(path: &Path) -> (Vec<u64>, Vec<Value>) {
    let bytes = fs::read(path).expect("a file");
    let summary = mcap::Summary::read(&bytes).expect("MCAP").expect("a summary");
    let (mut times, mut samples, mut last) = (vec![], vec![], vec![]);
    for message in mcap::MessageStream::new(&bytes).expect("MCAP") {
        let message = message.expect("whole");
        assert_eq!(message.channel.topic, "/bench");
        if times.len().is_multiple_of(100) {
            samples.push(serde_json::from_slice(&message.data).expect("JSON"));
        }
        times.push(message.log_time);
        last = message.data.into_owned();
    }
    samples.push(serde_json::from_slice(&last).expect("JSON"));
    assert_eq!(summary.stats.expect("statistics").message_count, times.len() as u64);
    (times, samples)
}

#[test]
fn a_constant_frequency_turns_the_motor_by_its_steps() {
    let cell = Cell::new(EXE);
    let told = report(&cell.ccu("bench constant --frequency 20 --steps 16 --json").good());
    assert_eq!(
        (&told["pulses"], &told["commanded"], &told["measured"]),
        (&json!(16), &json!(16), &json!(16))
    );
    assert_eq!(
        (&told["lost"], &told["first_lost"], &told["train_s"]),
        (&json!(0), &Value::Null, &json!(0.8))
    );
    let number = |key: &str| told[key].as_i64().expect("a number");
    assert_eq!(number("l") - number("r"), number("position"));
    // It swings about every step, and comes to rest within a quarter of a half step of the last, 20 counts each.
    assert!(number("direction_changes") > 16, "{told}");
    assert!((number("position") - 320).abs() <= 5, "{told}");
    let end = told["total_s"].as_f64().expect("seconds");
    let samples = told["samples"].as_f64().expect("a number");
    assert!((samples - 1.0 - 20_000.0 * end).abs() < 1e-6, "{told}");

    let back = report(&cell.ccu("bench constant --frequency 20 --steps 16 --reverse --json").good());
    assert_eq!((&back["commanded"], &back["measured"], &back["lost"]), (&json!(-16), &json!(-16), &json!(0)));

    let text = cell.ccu("bench constant --frequency 20 --steps 16").good().stdout;
    assert!(
        text.contains("\nsteps measured       16\n") && text.contains("\nsteps lost           0\n"),
        "{text}"
    );
    cell.assert_nothing_left();
}

#[test]
fn a_profile_is_made_and_its_samples_are_a_table() {
    let cell = Cell::new(EXE);
    let ran = cell.ccu(&format!("{PROFILE} --tb 0.5 --sampling 44100 --out run.csv --json")).good();
    let told = report(&ran);
    assert_eq!([&told["ns_a"], &told["ns_b"], &told["ns_c"]], [220, 1_000, 113].map(Value::from).each_ref());
    assert_eq!([&told["pulses"], &told["measured"]], [&json!(1_333), &json!(1_333)]);
    let same = report(&cell.ccu(&format!("{PROFILE} --steps 1333 --json")).good());
    assert_eq!((&same["ns_b"], &same["train_s"]), (&told["ns_b"], &told["train_s"]));

    let table = fs::read_to_string(cell.path("run.csv")).expect("a table");
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows[0], "time_s,position,l,r,commanded,measured,frequency");
    assert_eq!(rows[1], "0.0000000,0,0,0,0,0.000,0.000");
    // 2 000 000 / 44 100 = 45.35 ticks, and 90.70.
    assert!(
        rows[2].starts_with("0.0000225,") && rows[3].starts_with("0.0000455,"),
        "{} {}",
        rows[2],
        rows[3]
    );
    assert_eq!(json!(rows.len() - 1), told["samples"]);
    let last: Vec<f64> =
        rows[rows.len() - 1].split(',').map(|field| field.parse().expect("a number")).collect();
    assert_eq!(json!(last[0]), told["total_s"]);
    assert_eq!((last[1], last[4], last[6]), (told["position"].as_f64().expect("counts"), 1_333.0, 200.0));
    let fastest = rows.iter().filter(|row| row.ends_with(",2000.000")).count();
    assert!(fastest > 22_000 && fastest < 23_000, "{fastest} of half a second's 22 050");
}

#[test]
fn a_million_samples_go_to_a_file_and_come_back() {
    let cell = Cell::new(EXE);
    let ran =
        cell.ccu("bench constant --frequency 20 --steps 333 --sampling 60000 --out run.mcap --json").good();
    let told = report(&ran);
    let (times, samples) = read(&cell.path("run.mcap"));
    assert_eq!(json!(times.len()), told["samples"]);
    assert!(times.len() > 1_000_000);
    // 60 kHz are 33⅓ ticks of 500 ns.
    assert!(times.windows(2).all(|pair| matches!(pair[1] - pair[0], 16_500 | 17_000)));
    for (number, sample) in (0_u32..).zip(&samples[..samples.len() - 1]) {
        let (time, exact) = (sample["time_s"].as_f64().expect("seconds"), f64::from(number) / 600.0);
        assert!((time - exact).abs() <= 0.25e-6 + 1e-9, "{sample}");
        assert_eq!(sample["commanded"].as_f64(), Some((time * 20.0 + 1e-9).floor()), "{sample}");
    }
    let last = samples.last().expect("a sample");
    assert_eq!((&last["position"], &last["l"], &last["r"]), (&told["position"], &told["l"], &told["r"]));
}

#[test]
fn the_public_packages_read_the_samples_and_their_schema_holds() {
    let cell = Cell::new(EXE);
    let python = |arguments: &[&str]| Command::new("python3").args(arguments).output();
    if !python(&["-c", "import mcap, jsonschema"]).is_ok_and(|output| output.status.success()) {
        println!("skipped: python3 with mcap, jsonschema (pip install mcap jsonschema) is not here");
        return;
    }
    let line = format!("{PROFILE} --tb 0.1 --load-inertia 0.00012 --out run.mcap --json");
    let told = report(&cell.ccu(&line).good());
    let file = cell.path("run.mcap");
    let output =
        python(&["-c", include_str!("read_bench.py"), file.to_str().expect("UTF-8")]).expect("it ran");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(read["samples"], told["samples"]);
    assert_eq!(read["channel"], json!(["/bench", "supersigma.BenchSample", "jsonschema", "json"]));
    assert_eq!(read["about"]["program"], "positioning");
    assert_eq!((&read["about"]["ns_a"], &read["about"]["sampling_hertz"]), (&json!("220"), &json!("20000")));
    assert_eq!((&read["outcome"]["measured"], &read["outcome"]["lost"]), (&json!("533"), &json!("0")));
    assert_eq!(read["load_inertia"], json!(0.000_12));
    assert_eq!((&read["last"]["position"], &read["last"]["commanded"]), (&told["position"], &json!(533)));
}

#[test]
fn a_profile_that_is_too_steep_loses_steps_and_says_where() {
    let cell = Cell::new(EXE);
    let steep = "bench positioning --f-start 200 --f-max 8000 --ta 0.02 --tb 0.1 --tc 0.02";
    let ran = cell.ccu(&format!("{steep} --json"));
    assert_eq!(ran.code(), Some(1), "{ran}");
    let told: Value = serde_json::from_str(&ran.stdout).expect("a report");
    let (lost, commanded) =
        (told["lost"].as_i64().expect("steps"), told["commanded"].as_i64().expect("steps"));
    assert!(
        lost > 0 && lost % 8 == 0 && commanded - lost == told["measured"].as_i64().expect("steps"),
        "{told}"
    );
    let first = &told["first_lost"];
    // Some way up the ramp, which has 78 pulses.
    let pulse = first["pulse"].as_u64().expect("a pulse");
    assert!((2..=78).contains(&pulse), "{told}");
    let [time, frequency] = ["time_s", "frequency"].map(|key| first[key].as_f64().expect("a number"));
    assert!(time < 0.03 && frequency > 200.0 && frequency <= 8_000.0, "{told}");
    let says = format!("{lost} of {commanded} steps were lost: the first at pulse {pulse}, at {time:.6} s");
    assert!(ran.complaint().contains(&says), "{ran}");
    cell.ccu(steep).fails(1, &["steps were lost", "accelerate and decelerate for longer"]);

    // The same frequency, reached slowly.
    let gentle = "bench positioning --f-start 200 --f-max 8000 --ta 0.3 --tb 0.1 --tc 0.3 --json";
    assert_eq!(report(&cell.ccu(gentle).good())["lost"], json!(0));
}

#[test]
fn the_motor_is_the_one_that_was_named() {
    let cell = Cell::new(EXE);
    let config = cell.ccu("config show").good().stdout;
    let name = "name = \"left_x\"\n";
    assert!(config.contains(name));
    let fine = config.replace(name, &format!("{name}motor = {{ encoder_lines = 100000 }}\n"));
    let _ = cell.file("fine.toml", &fine);
    let slow =
        "bench constant --frequency 20 --steps 8 --config fine.toml --axis left_x --load-torque 0.5 --json";
    let told = report(&cell.ccu(slow).good());
    assert_eq!((&told["motor"], &told["counts_per_turn"]), (&json!("the motor of left_x"), &json!(400_000)));
    assert_eq!(told["illegal_transitions"], json!(0));
    // A thousand counts to a half step: at 2 000 pulses/s they come faster than the discriminator's clock.
    let fast =
        "bench positioning --f-start 100 --f-max 2000 --ta 0.5 --tb 0.1 --tc 0.5 --config fine.toml --axis 1";
    cell.ccu(fast).fails(1, &["the encoder's edges came faster than the discriminator's clock"]);

    cell.ccu("bench constant --frequency 20 --steps 8 --axis left_x")
        .fails(2, &["left_x has no motor that can lose steps", "leave --axis out for the bench motor"]);
    cell.ccu("bench constant --frequency 20 --steps 8 --axis 9")
        .fails(2, &["there is no axis \"9\"; there are left_x, "]);
}

#[test]
fn what_cannot_be_is_refused_with_what_can() {
    let cell = Cell::new(EXE);
    let _ = cell.file("there.mcap", "precious");
    for (line, says) in [
        ("constant --frequency 15 --steps 9", "the nearest possible is 15.259 pulses/s"),
        ("constant --frequency 500001 --steps 9", "the nearest possible is 500000 pulses/s"),
        ("constant --frequency fast --steps 9", "not a plain decimal number"),
        ("constant --frequency 20 --steps 0", "0 is not in 1.."),
        ("constant --frequency 20 --steps 9 --sampling 19999", "the nearest possible is 20000 Hz"),
        ("constant --frequency 20 --steps 9 --sampling 60001", "the nearest possible is 60000 Hz"),
        ("constant --frequency 20 --steps 9 --out run.txt", "must end in .mcap or .csv"),
        ("constant --frequency 20 --steps 9 --out there.mcap", "there.mcap exists already"),
        ("constant --frequency 20 --steps 9 --out no/run.csv", "cannot create no/run.csv: "),
        ("constant --frequency 20 --steps 9 --load-torque 2.5", "not less than the holding torque"),
        ("constant --frequency 20 --steps 9 --load-torque=-1", "a load is a number of 0 or more"),
        ("constant --frequency 20 --steps 9 --config cell.toml", "--axis"),
        (
            "positioning --f-start 300 --f-max 200 --ta 1 --tb 1 --tc 1",
            "choose a start of 200 pulses/s or less",
        ),
        ("positioning --f-start 200 --f-max 300 --ta 101 --tb 1 --tc 1", "t_a of 101 s is too long"),
        ("positioning --f-start 200 --f-max 300 --ta 1 --tc 1", "--tb <S>"),
        ("positioning --f-start 200 --f-max 2000 --ta 0.2 --tc 0.2 --steps 442", "the ramps alone have 443"),
        ("positioning --f-start 200 --f-max 2000 --ta 0 --tb 0 --tc 0", "at least one pulse"),
    ] {
        let ran = cell.ccu(&format!("bench {line}"));
        ran.fails(2, &[says]);
        assert_eq!(ran.stdout, "", "{ran}");
    }
    assert_eq!(fs::read_to_string(cell.path("there.mcap")).expect("still there"), "precious");
}

/// Ctrl-C in the middle: the file is ended as if the run had been that short.
#[test]
fn a_run_that_is_interrupted_leaves_a_whole_file() {
    let cell = Cell::new(EXE);
    let running = cell.start("bench constant --frequency 20 --steps 1000000 --out run.mcap --json");
    let file = cell.path("run.mcap");
    eventually("samples are in the file", || {
        fs::metadata(&file).is_ok_and(|file| file.len() > 100_000).then_some(())
    });
    running.signal(Signal::INT);
    let ran = running.end();
    ran.fails(1, &["the run was ended after", "report and file go so far"]);
    let told: Value = serde_json::from_str(&ran.stdout).expect("a report");
    assert_eq!(told["interrupted"], json!(true));
    let (times, _) = read(&file);
    assert_eq!(json!(times.len()), told["samples"]);
}
