//! The processor's view of one axis in \[F\]: two control words U and V go to the motion controller, one sense word R comes
//! back, each of 16 bits and each at an address of its own.
//!
//! Only a view: there is no other command in here than those of [`Operation`], and nothing else that moves. The papers'
//! column vectors are read from the top, so component 1 is the most significant bit of its word.
//!
//! ```text
//!            most significant                                              least significant
//!   U   A'    u1   u2   u3   u4   u5   u6   u7   u8   u9   u10  u11  u12  u13  u14  u15  u16
//!            └────────────────────────────── |motion| in steps ────────────────────────────┘
//!
//!   V   A''   v1   v2   v3   v4   v5   v6   v7   v8   v9   v10  v11  v12  v13  v14  v15  v16
//!             │    0    0    │   └─────┬────┘  │   └──────────────── 0 ────────────────────┘
//!             │              │         │       └ seek the reference step
//!             │              │         └ maximum speed, 000 slowest … 111 fastest, v5 first
//!             │              └ halt
//!             └ sign of the motion: 1 is towards the origin
//!
//!   R   A' or A''
//!             X1   X2   X3   X4   X5   0    0    0    0    0    0    0    0    0    0    0
//! ```
//!
//! Control points have an order, since a processor sets them all at once: a halt wins over everything, seeking the
//! reference over the motion; what loses is ignored. Nothing in here panics.

use std::fmt;
use std::str::FromStr;

use crate::command::Operation;
use crate::report::{SensePoint, StatusWord};
use crate::units::{AxisNumber, Direction, Distance, SpeedIndex};

/// Bit `number`, 1 to 16, of a word whose first bit is the most significant one.
const fn bit(number: u8) -> u16 {
    1 << (16 - number)
}

const SIGN: u16 = bit(1);
const HALT: u16 = bit(4);
const SPEED: u16 = bit(5) | bit(6) | bit(7);
/// v7, the least significant bit of the speed.
const SPEED_SHIFT: u32 = bit(7).trailing_zeros();
const SEEK: u16 = bit(8);
const UNUSED: u16 = !(SIGN | HALT | SPEED | SEEK);

/// Why words ask for nothing that a card could do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
pub enum WordError {
    /// Bits of V that mean nothing are set.
    #[error("V = {word:04X} has {} set; v2, v3 and v9 to v16 are unused and must be 0", Bits(*bits))]
    UnusedBits {
        /// The whole word.
        word: u16,
        /// Those of its bits.
        bits: u16,
    },
    /// U is 0, and V neither halts nor seeks the reference.
    #[error("U = 0000 is no motion, and V asks for nothing else (1000 halts, 0100 seeks the reference step)")]
    NoMotion,
    /// No word of any axis has this address.
    #[error("no word has address {address:02X}; axis n has U at 2n and V at 2n + 1, n is 1 to 7")]
    NoSuchAddress {
        /// B, as the processor gave it.
        address: u8,
    },
    /// Not a word at all.
    #[error("this is no word of 16 bits; 0000 to FFFF are, in hexadecimal")]
    NoWord,
}

/// Names bits of V: `v2, v16`.
struct Bits(u16);

impl fmt::Display for Bits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let set = (1..=16).filter(|number| self.0 & bit(*number) != 0);
        for (i, number) in set.enumerate() {
            write!(f, "{}v{number}", if i == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

/// U: how far, in steps, without a sign. Any word is one; 0 is no motion. Reads and prints as four hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct MotionWord(pub u16);

/// V: which way, how fast at most, and the two control points that are not motions. Reads and prints as four hexadecimal
/// digits. Its unused bits are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct ControlWord(u16);

impl ControlWord {
    /// v4 alone.
    pub const HALT: Self = Self(HALT);
    /// v8 alone.
    pub const SEEK_REFERENCE: Self = Self(SEEK);

    /// A motion that way, at that speed at most.
    #[must_use]
    pub const fn motion(direction: Direction, level: SpeedLevel) -> Self {
        let sign = match direction {
            Direction::Forward => 0,
            Direction::TowardsOrigin => SIGN,
        };
        Self(sign | (level.0 as u16) << SPEED_SHIFT)
    }

    /// The sixteen bits, v1 first.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// v1.
    #[must_use]
    pub const fn direction(self) -> Direction {
        if self.0 & SIGN == 0 { Direction::Forward } else { Direction::TowardsOrigin }
    }

    /// v4.
    #[must_use]
    pub const fn halts(self) -> bool {
        self.0 & HALT != 0
    }

    /// v5, v6, v7.
    #[must_use]
    pub const fn level(self) -> SpeedLevel {
        SpeedLevel(((self.0 & SPEED) >> SPEED_SHIFT) as u8)
    }

    /// v8.
    #[must_use]
    pub const fn seeks_reference(self) -> bool {
        self.0 & SEEK != 0
    }
}

impl TryFrom<u16> for ControlWord {
    type Error = WordError;
    fn try_from(word: u16) -> Result<Self, WordError> {
        match word & UNUSED {
            0 => Ok(Self(word)),
            bits => Err(WordError::UnusedBits { word, bits }),
        }
    }
}

/// One of the eight maximum speeds of V, 0 to 7: the entries of the ramp table nearest to equal distances from the slowest
/// speed to the fastest.
///
/// ```text
///   level   0    1    2    3    4    5    6    7
///   entry   0   33   66   99  133  166  199  232
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SpeedLevel(u8);

impl SpeedLevel {
    /// 000: the whole movement at start speed.
    pub const START: Self = Self(0);
    /// 111: no ceiling but the ramp's own top.
    pub const TOP: Self = Self(7);

    /// `None` above 7.
    #[must_use]
    pub const fn new(level: u8) -> Option<Self> {
        if level <= Self::TOP.0 { Some(Self(level)) } else { None }
    }

    /// All eight, slowest first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..=Self::TOP.0).map(Self)
    }

    /// 0 to 7.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The ceiling that the level stands for.
    #[must_use]
    pub fn limit(self) -> SpeedIndex {
        let (level, levels) = (u16::from(self.0), u16::from(Self::TOP.0));
        let nearest = (level * u16::from(SpeedIndex::TOP.get()) + levels / 2) / levels;
        u8::try_from(nearest).ok().and_then(SpeedIndex::new).unwrap_or(SpeedIndex::TOP)
    }

    /// The level with this ceiling; `None` for entries between levels.
    #[must_use]
    pub fn with_limit(limit: SpeedIndex) -> Option<Self> {
        Self::all().find(|level| level.limit() == limit)
    }
}

/// R: X1..X5 as the processor reads them, X1 first. Prints as four hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SenseWord(u16);

impl SenseWord {
    /// The sixteen bits.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }
}

impl From<StatusWord> for SenseWord {
    fn from(status: StatusWord) -> Self {
        let points = (1..).zip(SensePoint::ALL);
        Self(points.filter(|(_, point)| status.has(*point)).fold(0, |word, (number, _)| word | bit(number)))
    }
}

/// B: which word of which axis the processor addresses. Both addresses connect the sense word.
///
/// ```text
///   axis        1   2   3   4   5   6   7
///   A'  (U)    02  04  06  08  0A  0C  0E      2 · axis
///   A'' (V)    03  05  07  09  0B  0D  0F      2 · axis + 1
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WordAddress {
    /// A': what is written goes to U.
    Motion(AxisNumber),
    /// A'': what is written goes to V.
    Control(AxisNumber),
}

impl WordAddress {
    /// The number on the address channel, 2 to 15.
    #[must_use]
    pub const fn get(self) -> u8 {
        match self {
            Self::Motion(axis) => 2 * axis.get(),
            Self::Control(axis) => 2 * axis.get() + 1,
        }
    }
}

impl TryFrom<u8> for WordAddress {
    type Error = WordError;
    fn try_from(address: u8) -> Result<Self, WordError> {
        let axis = AxisNumber::new(address / 2).ok_or(WordError::NoSuchAddress { address })?;
        Ok(if address.is_multiple_of(2) { Self::Motion(axis) } else { Self::Control(axis) })
    }
}

/// What U and V ask for together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Meaning {
    /// Stop with the normal ramp.
    Halt,
    /// Find the reference step.
    SeekReference,
    /// A movement with a ramp.
    Motion {
        /// Where to.
        direction: Direction,
        /// How far.
        distance: Distance,
        /// How fast at most.
        level: SpeedLevel,
    },
}

impl Meaning {
    /// What these words ask for.
    ///
    /// # Errors
    /// [`WordError::NoMotion`] if they ask for nothing.
    pub fn of(motion: MotionWord, control: ControlWord) -> Result<Self, WordError> {
        if control.halts() {
            return Ok(Self::Halt);
        }
        if control.seeks_reference() {
            return Ok(Self::SeekReference);
        }
        let distance = Distance::new(motion.0).ok_or(WordError::NoMotion)?;
        Ok(Self::Motion { direction: control.direction(), distance, level: control.level() })
    }

    /// The words that ask for it, with 0 wherever they would be ignored.
    #[must_use]
    pub const fn words(self) -> (MotionWord, ControlWord) {
        match self {
            Self::Halt => (MotionWord(0), ControlWord::HALT),
            Self::SeekReference => (MotionWord(0), ControlWord::SEEK_REFERENCE),
            Self::Motion { direction, distance, level } => {
                (MotionWord(distance.get()), ControlWord::motion(direction, level))
            }
        }
    }

    /// The operation that carries it out.
    #[must_use]
    pub fn operation(self) -> Operation {
        match self {
            Self::Halt => Operation::Halt,
            Self::SeekReference => Operation::SeekReference,
            Self::Motion { direction, distance, level: SpeedLevel::TOP } => {
                Operation::Move { direction, distance }
            }
            Self::Motion { direction, distance, level } => {
                Operation::MoveLimited { direction, distance, limit: level.limit() }
            }
        }
    }

    /// The meaning that `operation` carries out; `None` if words cannot say it. A ceiling at the top of the ramp is none.
    #[must_use]
    pub fn of_operation(operation: Operation) -> Option<Self> {
        match operation {
            Operation::Halt => Some(Self::Halt),
            Operation::SeekReference => Some(Self::SeekReference),
            Operation::Move { direction, distance } => {
                Some(Self::Motion { direction, distance, level: SpeedLevel::TOP })
            }
            Operation::MoveLimited { direction, distance, limit } => {
                let level = SpeedLevel::with_limit(limit)?;
                Some(Self::Motion { direction, distance, level })
            }
            _ => None,
        }
    }
}

/// Up to four hexadecimal digits, with or without `0x`.
fn parse(text: &str) -> Result<u16, WordError> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    if digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        u16::from_str_radix(digits, 16).map_err(|_| WordError::NoWord)
    } else {
        Err(WordError::NoWord)
    }
}

impl FromStr for MotionWord {
    type Err = WordError;
    fn from_str(text: &str) -> Result<Self, WordError> {
        parse(text).map(Self)
    }
}

impl FromStr for ControlWord {
    type Err = WordError;
    fn from_str(text: &str) -> Result<Self, WordError> {
        parse(text)?.try_into()
    }
}

impl fmt::Display for MotionWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}", self.0)
    }
}

impl fmt::Display for ControlWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}", self.0)
    }
}

impl fmt::Display for SenseWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}", self.0)
    }
}

#[cfg(test)]
mod tests;
