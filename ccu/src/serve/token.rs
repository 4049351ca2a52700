//! The secret that lets somebody look and give orders. It is compared in constant time and is never printed by accident.

use std::fmt;
use std::io;
use std::str::FromStr;

use rustix::rand::{GetRandomFlags, getrandom};
use subtle::ConstantTimeEq;

/// A token: 16 to 256 characters of those that go through a header and an address unchanged.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// A text that cannot be a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a token has 16 to 256 letters, digits, `-`, `.`, `_` and `~`; a shorter one could be guessed")]
pub struct NoToken;

impl Token {
    /// One that nobody can guess: 128 bits of the system's randomness.
    ///
    /// # Errors
    /// If the system has none.
    pub fn random() -> io::Result<Self> {
        let mut bytes = [0_u8; 16];
        // Up to 256 bytes come whole.
        getrandom(&mut bytes, GetRandomFlags::empty())?;
        Ok(Self(bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]).map(digit).collect()))
    }

    /// The secret itself, for whoever may know it.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Whether somebody knows it. How long this takes tells nothing but the length.
    pub(super) fn is(&self, claimed: &[u8]) -> bool {
        self.0.as_bytes().ct_eq(claimed).into()
    }
}

fn digit(half: u8) -> char {
    char::from_digit(half.into(), 16).unwrap_or('0')
}

impl FromStr for Token {
    type Err = NoToken;
    fn from_str(text: &str) -> Result<Self, NoToken> {
        let passes = |char: char| char.is_ascii_alphanumeric() || "-._~".contains(char);
        let good = (16..=256).contains(&text.len()) && text.chars().all(passes);
        if good { Ok(Self(text.to_owned())) } else { Err(NoToken) }
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_random_token_is_one_and_like_no_other() {
        let (one, other) = (Token::random().expect("randomness"), Token::random().expect("randomness"));
        assert_eq!(one.reveal().len(), 32);
        assert_eq!(one.reveal().parse(), Ok(one.clone()));
        assert_ne!(one, other);
        assert!(one.is(one.reveal().as_bytes()) && !one.is(other.reveal().as_bytes()));
        assert!(!one.is(b"") && !one.is(&one.reveal().as_bytes()[..31]));
    }

    #[test]
    fn what_could_be_guessed_or_does_not_fit_into_a_header_is_no_token() {
        for wrong in ["", "fifteen-letters", "sixteen letters!", "sechzehn-zeichen-ä", "0123456789abcde\n"] {
            assert_eq!(wrong.parse::<Token>(), Err(NoToken), "{wrong:?}");
        }
        let token: Token = "0123456789ABCDEF-._~".parse().expect("good");
        assert_eq!(format!("{token:?}"), "Token(…)");
    }
}
