//! A set and the machine's shared memory: what it takes of it, and that it is not started where there is too little, none, or
//! where it may not write. The last need root, and a mount namespace of their own; without, they say that they are skipped.

use std::fs;
use std::os::unix::fs::MetadataExt;

use supersigma_tests::Cell;

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

fn is_refused(mount: &str, says: &[&str]) {
    let cell = Cell::new(EXE);
    let Some(ran) = cell.ccu_after_mount(mount, "up --log log.mcap") else { return };
    ran.fails(1, &["there is no room for the bus in /dev/shm", "df -h /dev/shm"]);
    ran.fails(1, says);
    cell.assert_nothing_left();
    assert!(!cell.path("log.mcap").exists(), "{ran}");
}

#[test]
fn a_set_does_not_start_with_too_little_shared_memory() {
    is_refused("mount -t tmpfs -o size=1m tmpfs /dev/shm", &["it has 1.0 MiB free, and ", "are needed"]);
}

#[test]
fn a_set_does_not_start_with_room_for_too_few_files() {
    is_refused(
        "mount -t tmpfs -o size=256m,nr_inodes=20 tmpfs /dev/shm",
        &["more files, and 256 are needed"],
    );
}

#[test]
fn a_set_does_not_start_without_shared_memory() {
    // What is mounted over /dev has no shm in it; Linux' own tools need nothing else of it.
    is_refused("mount -t tmpfs tmpfs /dev", &["there is no such folder on this machine"]);
}

#[test]
fn a_set_does_not_start_where_shared_memory_is_read_only() {
    is_refused("mount -t tmpfs -o ro tmpfs /dev/shm", &["it is mounted read-only"]);
}

#[test]
fn a_whole_set_has_all_of_its_room_and_fits_into_what_it_asks_for() {
    let cell = Cell::new(EXE);
    let _up = cell.up("20");
    let files: Vec<_> = cell
        .shared_memory()
        .into_iter()
        .map(|path| (fs::metadata(&path).expect("it is there"), path))
        .collect();
    for (file, path) in &files {
        // What is not there yet when it is touched kills whoever touches it.
        assert!(file.blocks() * 512 >= file.len(), "{} has holes", path.display());
    }
    let bytes: u64 = files.iter().map(|(file, _)| file.blocks() * 512).sum();
    println!("{} files, {bytes} bytes", files.len());
    assert!(files.len() <= 256 && bytes <= 56 << 20, "{} files, {bytes} bytes", files.len());
    assert_eq!(cell.down(), None);
}
