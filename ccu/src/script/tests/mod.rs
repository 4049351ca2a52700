//! Programs on real machines: what they move, what they say when they are wrong, and that they end.

mod begun;
mod bench;
mod book;
mod check;
mod errors;
mod examples;
mod functions;
