//! The wake-up lines, and which of them a sent frame raises: the rule that both carriers follow.

use super::{BusError, Wake};
use crate::units::{Address, AxisNumber, CardKind};

/// One line; each wakes one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Line {
    /// ANSWER READY, to the CCU.
    AnswerReady,
    /// DATA READY of a motor card.
    Axis(AxisNumber),
    /// DATA READY of the process that plays both digital cards.
    Digital,
}

impl Line {
    /// DATA READY of every card.
    pub(super) fn cards() -> impl Iterator<Item = Self> {
        AxisNumber::all().map(Self::Axis).chain([Self::Digital])
    }

    /// All nine.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        [Self::AnswerReady].into_iter().chain(Self::cards())
    }

    /// DATA READY of the card with this address.
    ///
    /// # Errors
    /// If there is no one card with this address.
    pub(super) fn of_card(address: Address) -> Result<Self, BusError> {
        Self::listening_at(address).ok_or_else(|| {
            BusError::open("make a card's port", format!("{address} is not one card; cards are 1 to 9"))
        })
    }

    fn listening_at(address: Address) -> Option<Self> {
        match address.kind() {
            CardKind::Axis(axis) => Some(Self::Axis(axis)),
            CardKind::DigitalInput | CardKind::DigitalOutput => Some(Self::Digital),
            CardKind::Everyone | CardKind::Unknown(_) => None,
        }
    }

    /// Whether a frame sent with `wake`, by somebody who holds this line, raises it.
    pub(super) fn is_raised_by(self, wake: Wake) -> bool {
        match (self, wake) {
            (_, Wake::Nobody) => false,
            (Self::AnswerReady, _) | (_, Wake::Everyone) | (Self::Axis(_), Wake::Card(Address::EVERYONE)) => {
                true
            }
            (line, Wake::Card(address)) => Self::listening_at(address) == Some(line),
        }
    }

    /// 0 ..= 8, for arrays and names.
    pub(super) const fn index(self) -> usize {
        match self {
            Self::AnswerReady => 0,
            Self::Axis(axis) => 1 + axis.index(),
            Self::Digital => 1 + AxisNumber::COUNT,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raised(wake: Wake) -> Vec<usize> {
        Line::cards().filter(|line| line.is_raised_by(wake)).map(Line::index).collect()
    }

    #[test]
    fn a_command_raises_the_lines_of_those_it_concerns() {
        assert!(raised(Wake::Nobody).is_empty());
        assert_eq!(raised(Wake::Everyone), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(raised(Wake::Card(Address(0))), [1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(raised(Wake::Card(Address(3))), [3]);
        assert_eq!(raised(Wake::Card(Address(8))), [8]);
        assert_eq!(raised(Wake::Card(Address(9))), [8]);
        assert!(raised(Wake::Card(Address(10))).is_empty());
    }

    #[test]
    fn an_answer_raises_answer_ready_unless_it_can_wait() {
        assert!(Line::AnswerReady.is_raised_by(Wake::Everyone));
        assert!(Line::AnswerReady.is_raised_by(Wake::Card(Address(3))));
        assert!(!Line::AnswerReady.is_raised_by(Wake::Nobody));
    }

    #[test]
    fn lines_are_numbered_without_gaps() {
        assert!(Line::all().map(Line::index).eq(0..9));
    }
}
