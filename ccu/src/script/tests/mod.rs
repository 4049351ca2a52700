//! Programs on real machines: what they move, what they say when they are wrong, and that they end.

mod bench;
mod errors;
mod examples;
mod functions;
