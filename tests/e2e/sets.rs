//! Sets on a machine: several side by side, and what they leave in the file system.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use serde_json::{Value, json};
use supersigma_tests::{Cell, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

#[test]
fn two_sets_do_not_hear_each_other() {
    let one = Cell::new(EXE);
    let two = one.neighbour("two");
    let (first, second) = (one.up("20"), two.up("20"));
    assert_ne!(first.pid, second.pid);
    one.ccu("origin left_x").done();
    two.ccu("origin wrist").done();
    one.ccu("move left_x 111").done();
    two.ccu("move wrist 222").done();
    assert_eq!(one.axis("wrist")["position"], Value::Null);
    assert_eq!(two.axis("left_x")["position"], Value::Null);
    // A name on the command line goes before the one in the environment.
    assert_eq!(one.ccu("status --name two wrist --json").good().json()[0]["position"], 222);

    assert_eq!(one.down(), None);
    two.ccu("move wrist 1").done();
    assert_eq!(two.axis("wrist")["position"], 223);
    one.ccu("status").fails(3, &["no set named \"cell\" is up"]);
    assert_eq!(two.down(), None);

    let moves = |cell: &Cell, log: &Path| -> Vec<(Value, Value)> {
        let frames = cell.frames(log);
        let moves = frames.iter().filter(|frame| frame["operation"] == "Move");
        moves.map(|frame| (frame["name"].clone(), frame["steps"].clone())).collect()
    };
    assert_eq!(moves(&one, &first.log), [(json!("left_x"), json!(111))]);
    assert_eq!(moves(&two, &second.log), [(json!("wrist"), json!(222)), (json!("wrist"), json!(1))]);
}

#[test]
fn a_name_is_taken_once() {
    let cell = Cell::new(EXE);
    let up = cell.up("20");
    let log = cell.path("second.mcap");
    for how in ["", "--detach"] {
        cell.ccu(&format!("up {how} --log {}", log.display()))
            .fails(1, &["a set named cell is already up", "`ccu down --name cell`"]);
    }
    assert!(!log.exists());
    // The first one has not noticed anything.
    cell.ccu("origin wrist").done();
    assert_eq!(cell.down(), None);
    assert!(cell.frames(&up.log).iter().any(|frame| frame["operation"] == "Originate"));
}

#[test]
fn everything_of_a_set_is_its_owners_alone() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let mode = |path: &Path| fs::metadata(path).expect("it is there").permissions().mode() & 0o777;
    assert_eq!(mode(&cell.path("run/supersigma")), 0o700);
    assert_eq!(mode(&cell.runtime()), 0o700);
    assert_eq!(mode(&cell.runtime().join("control.sock")), 0o600);
    assert_eq!(mode(&cell.runtime().with_extension("messages")), 0o600);
    let shared = cell.shared_memory();
    assert!(!shared.is_empty(), "a set has shared memory");
    for file in &shared {
        assert_eq!(mode(file), 0o600, "{}", file.display());
    }
    assert_eq!(cell.down(), None);
    assert_eq!(fs::read_dir(cell.path("run/supersigma")).expect("it stays").count(), 0);
}

#[test]
fn a_runtime_folder_that_others_can_enter_is_not_used() {
    let cell = Cell::new(EXE);
    let folder = cell.path("run/supersigma");
    fs::create_dir(&folder).expect("a folder");
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).expect("a mode");
    cell.ccu("up").fails(1, &["is not ours alone", "XDG_RUNTIME_DIR"]);
    cell.ccu("status").fails(3, &["is not ours alone"]);
    cell.assert_nothing_left();
    assert!(!cell.has_default_log());
}

#[test]
fn a_client_is_no_part_of_the_set() {
    // A client that stops in the middle holds nobody up.
    let cell = Cell::new(EXE);
    let _up = cell.up("5");
    cell.ccu("origin left_x left_y").done();
    let waiting = cell.start("move left_x 20000");
    cell.until("left_x", "moves", |axis| axis["activity"] != "standing");
    waiting.signal(Signal::STOP);
    cell.ccu("move left_y 500").done();
    cell.until("left_x", "has arrived", |axis| axis["position"] == 20_000);
    waiting.signal(Signal::CONT);
    waiting.end().done();
    assert_eq!(cell.down(), None);
}
