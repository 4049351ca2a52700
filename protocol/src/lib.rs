//! What travels on the MICROBUS, and how it travels.
//!
//! Two levels, as in every wire format worth keeping: *bytes* on one side ([`CommandBytes`], the postcard
//! encoding of a [`Frame`]) and *meaning* on the other ([`Command`], [`Answer`]), with one `decode`/`encode`
//! pair between them. Decoding is total: any byte string gives a value or a named [`Refusal`]; nothing in
//! this crate panics on what it reads. There is no motion in here, no clock and no configuration.

pub mod bus;
mod command;
mod frame;
mod refusal;
mod report;
mod units;
pub mod words;

pub use command::{Command, CommandBytes, Operation, TooManyBytes};
pub use frame::{
    About, Answer, Body, Broadcast, Fault, Frame, FrameError, MAX_FRAME_BYTES, Occasion, Sender, Switch,
};
pub use refusal::Refusal;
pub use report::{Activity, Alarm, AxisReport, End, Pace, Report, SensePoint, StatusWord};
pub use units::{
    Address, AxisNumber, CardKind, Count, Deviation, Direction, Distance, Position, Sequence, SpeedIndex,
    Steps, Tick, Ticks,
};
