# The project's commands. `just` (https://just.systems) only shortens them: each is one line that can be typed without it.

# List the recipes
default:
    @just --list

# Build everything, optimised; the command is then target/release/ccu
build:
    cargo build --release --workspace

# Run every test of every crate
test:
    cargo test --workspace

# Rounds by chance for minutes: random programs, and processes that are killed or stand still at random moments
long:
    cargo test -p supersigma-ccu --test rounds -- --ignored

# Fuzz one way in for a while (names: `cargo fuzz list`); needs cargo-fuzz and a nightly toolchain
fuzz target seconds="60":
    cargo +nightly fuzz run {{target}} -- -max_total_time={{seconds}} -rss_limit_mb=2048 -malloc_limit_mb=512 -timeout=60 -max_len=16384 -print_final_stats=1 -seed_inputs=config/supersigma.toml,examples/assembly.rhai,examples/lines.rhai,examples/together.rhai,examples/recover.rhai

# Fuzz every way in, one after the other, a minute each
fuzz-all:
    for target in $(cargo fuzz list); do just fuzz $target || exit 1; done

# Half an hour of random programs on one set, watched; writes the book's page about it
soak:
    cargo run --release -p supersigma-tests --bin soak -- --minutes 30 --time-scale 20 --seed 1 --report docs/src/architecture/soak.md

# Check the format and the lints; a warning is an error
lint:
    cargo fmt --check && cargo clippy --workspace --all-targets -- -D warnings

# Hold the licences, sources and known faults of all dependencies against deny.toml; needs cargo-deny (`cargo install cargo-deny`)
deny:
    cargo deny check

# Run what decides whether the tree is good; needs bash, and uses Python with pip if it is there
ci:
    .ci/run

# Start a set, run the small assembly on it, take the set down
demo:
    cargo run --release -- run examples/assembly.rhai

# Measure what is promised of speed, and record it in docs/performance.md and docs/performance.csv
bench:
    cargo bench -p supersigma-ccu --bench performance -- --record docs

# Build the book from docs/ into docs/book; needs mdBook (`cargo install mdbook`)
docs:
    mdbook build docs

# Draw the book's pictures of the web page; needs Chromium
web-pictures:
    cargo test -p supersigma-ccu --test browser -- --ignored pictures

# Draw the book's pictures anew; a test says when they are stale
pictures:
    cargo run --release -p supersigma-ccu --example pictures -- --out docs/src/generated
    docs/pictures
    docs/session

# Write the manual pages of all commands to target/man
man:
    cargo run --release -- man target/man
