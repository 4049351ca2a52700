//! The quantities that cross module borders, each a type of its own. Nothing here knows what they are used for.

use std::fmt;
use std::num::NonZeroU16;
use std::ops::{Add, AddAssign, Neg, Sub};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A point in time: ticks of 0.5 µs (the 8253's 2 MHz clock) since the set's epoch.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Tick(pub u64);

/// A span of time in ticks of 0.5 µs.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Ticks(pub u64);

impl Tick {
    /// Ticks in one second.
    pub const PER_SECOND: u64 = 2_000_000;

    /// The span since an earlier point; zero if `earlier` is in fact later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Ticks {
        Ticks(self.0.saturating_sub(earlier.0))
    }
}

impl Ticks {
    /// The span of `milliseconds` of machine time.
    #[must_use]
    pub const fn from_millis(milliseconds: u64) -> Self {
        Self(milliseconds.saturating_mul(Tick::PER_SECOND / 1_000))
    }

    /// The span in seconds, for people; never for the pulse path.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "2^53 ticks are 142 years")]
    pub fn as_seconds(self) -> f64 {
        self.0 as f64 / Tick::PER_SECOND as f64
    }
}

/// Time has an end, 292 000 years after the epoch, and nothing comes after it: a frame may name any tick, and whoever
/// counts on from it must not fail.
impl Add<Ticks> for Tick {
    type Output = Self;
    fn add(self, span: Ticks) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

impl AddAssign<Ticks> for Tick {
    fn add_assign(&mut self, span: Ticks) {
        *self = *self + span;
    }
}

impl Sub<Ticks> for Tick {
    type Output = Self;
    fn sub(self, span: Ticks) -> Self {
        Self(self.0 - span.0)
    }
}

impl Add for Ticks {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {}", self.0)
    }
}

/// A number of steps that were, or will be, made. One step is one pulse: a half step of the motor.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Steps(pub u32);

impl Add for Steps {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for Steps {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl fmt::Display for Steps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The steps that one command asks for: 1 ..= 65 535, the two bytes of \[C\] Table 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Distance(NonZeroU16);

impl Distance {
    /// The longest movement of one command.
    pub const MAX: Self = Self(NonZeroU16::MAX);

    /// `None` for zero steps, which is no movement.
    #[must_use]
    pub const fn new(steps: u16) -> Option<Self> {
        match NonZeroU16::new(steps) {
            Some(steps) => Some(Self(steps)),
            None => None,
        }
    }

    /// The two bytes' value.
    #[must_use]
    pub const fn get(self) -> u16 {
        self.0.get()
    }

    /// The same as a count of steps.
    #[must_use]
    pub fn steps(self) -> Steps {
        Steps(u32::from(self.get()))
    }
}

/// A place on an axis, in steps from its origin (the point where the limit switch opens); positive is away from it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Position(pub i32);

impl Position {
    /// The place `steps` further in `direction`. Saturates at the ends of `i32`, far outside any rail.
    #[must_use]
    pub fn moved(self, direction: Direction, steps: Steps) -> Self {
        let steps = i32::try_from(steps.0).unwrap_or(i32::MAX);
        Self(match direction {
            Direction::Forward => self.0.saturating_add(steps),
            Direction::TowardsOrigin => self.0.saturating_sub(steps),
        })
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// By how many steps an axis stands further from the origin than it was believed to; negative if nearer.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Deviation(pub i32);

impl Position {
    /// How much further from the origin than `believed` this is.
    #[must_use]
    pub fn deviation_from(self, believed: Self) -> Deviation {
        Deviation(self.0.saturating_sub(believed.0))
    }
}

/// The sense of a movement, bit 7 of the op-code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Away from the origin: bit 7 is 0, positions grow.
    Forward,
    /// Towards the origin: bit 7 is 1, positions fall.
    TowardsOrigin,
}

impl Neg for Direction {
    type Output = Self;
    fn neg(self) -> Self {
        match self {
            Self::Forward => Self::TowardsOrigin,
            Self::TowardsOrigin => Self::Forward,
        }
    }
}

/// A 16-bit count as written to an 8253 counter. Zero stands for 65 536, as on the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Count(pub u16);

impl Count {
    /// The longest period that 16 bits count, in ticks.
    pub const LONGEST: u64 = 65_536;

    /// What the chip divides by: 1 ..= 65 536.
    #[must_use]
    pub const fn divisor(self) -> u32 {
        if self.0 == 0 { 65_536 } else { self.0 as u32 }
    }

    /// The count that divides by `divisor`; `None` outside 1 ..= 65 536.
    #[must_use]
    pub fn dividing_by(divisor: u32) -> Option<Self> {
        match divisor {
            65_536 => Some(Self(0)),
            1..=65_535 => u16::try_from(divisor).ok().map(Self),
            _ => None,
        }
    }
}

/// An index into the ramp table: 0 (650 steps/s) ..= 232 (15 000 steps/s) with the default ramp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "u8", into = "u8")]
pub struct SpeedIndex(u8);

impl SpeedIndex {
    /// The slowest speed, with which every movement starts and ends.
    pub const START: Self = Self(0);
    /// The last entry of the ramp table.
    pub const TOP: Self = Self(232);

    /// `None` above 232.
    #[must_use]
    pub const fn new(index: u8) -> Option<Self> {
        if index <= Self::TOP.0 { Some(Self(index)) } else { None }
    }

    /// The byte on the bus.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl TryFrom<u8> for SpeedIndex {
    type Error = String;
    fn try_from(index: u8) -> Result<Self, String> {
        Self::new(index).ok_or_else(|| format!("speed index {index} is above {}", Self::TOP.0))
    }
}

impl From<SpeedIndex> for u8 {
    fn from(index: SpeedIndex) -> Self {
        index.0
    }
}

/// The first byte of a command: whom it is for. Any byte is an address; [`Address::kind`] says whose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Address(pub u8);

/// Whom an [`Address`] names (\[C\] Fig 3: seven motor cards, digital inputs, digital outputs).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CardKind {
    /// 0: every axis card.
    Everyone,
    /// 1 ..= 7: a motor card.
    Axis(AxisNumber),
    /// 8: the digital input card.
    DigitalInput,
    /// 9: the digital output card.
    DigitalOutput,
    /// 10 ..= 255: nobody.
    Unknown(u8),
}

impl Address {
    /// Every axis card listens.
    pub const EVERYONE: Self = Self(0);
    /// The digital input card.
    pub const DIGITAL_INPUT: Self = Self(8);
    /// The digital output card.
    pub const DIGITAL_OUTPUT: Self = Self(9);

    /// Whose address this is.
    #[must_use]
    pub const fn kind(self) -> CardKind {
        match self.0 {
            0 => CardKind::Everyone,
            1..=7 => CardKind::Axis(AxisNumber(self.0)),
            8 => CardKind::DigitalInput,
            9 => CardKind::DigitalOutput,
            other => CardKind::Unknown(other),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind() {
            CardKind::Everyone => f.write_str("everyone"),
            CardKind::Axis(axis) => axis.fmt(f),
            CardKind::DigitalInput => f.write_str("card 8 (digital inputs)"),
            CardKind::DigitalOutput => f.write_str("card 9 (digital outputs)"),
            CardKind::Unknown(byte) => write!(f, "address {byte}"),
        }
    }
}

/// The number of a motor card: 1 ..= 7.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "u8", into = "u8")]
pub struct AxisNumber(u8);

impl AxisNumber {
    /// How many motor cards a set can have.
    pub const COUNT: usize = 7;

    /// `None` outside 1 ..= 7.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if 1 <= number && number <= 7 { Some(Self(number)) } else { None }
    }

    /// All seven, in order.
    pub fn all() -> impl Iterator<Item = Self> {
        (1..=7).map(Self)
    }

    /// 1 ..= 7.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }

    /// 0 ..= 6, for arrays of seven.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize - 1
    }

    /// The card's address on the bus.
    #[must_use]
    pub const fn address(self) -> Address {
        Address(self.0)
    }
}

impl TryFrom<u8> for AxisNumber {
    type Error = String;
    fn try_from(number: u8) -> Result<Self, String> {
        Self::new(number).ok_or_else(|| format!("axis {number} does not exist, axes are 1 to 7"))
    }
}

impl From<AxisNumber> for u8 {
    fn from(axis: AxisNumber) -> Self {
        axis.0
    }
}

impl fmt::Display for AxisNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "axis {}", self.0)
    }
}

/// The place of a frame in what one sender sent: 0, 1, 2 … A sender that starts anew starts at 0 again, so a
/// receiver takes 0 as a new life and any other jump as a loss.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Sequence(pub u64);

impl Sequence {
    /// The one after this; the last one, which no sender reaches by counting, has none but itself.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.saturating_add(1))
    }
}
