//! Everything that can be wrong with a configuration, what it is called, and what to do about it.

use std::path::PathBuf;

use thiserror::Error;

use crate::{ProfileName, RampError};

/// What is wrong with one value. Where it stands is in the [`Fault`](crate::Fault) around it.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The file is not text.
    #[error("this is not UTF-8 text")]
    NotUtf8 {
        /// Whether it begins as UTF-16 text does.
        is_utf16: bool,
    },
    /// A character that no text has.
    #[error("this is not TOML: there is the control character U+{:04X}", u32::from(*character))]
    Control {
        /// The character.
        character: char,
    },
    /// The text is not TOML.
    #[error("this is not TOML: {reason}")]
    Syntax {
        /// What the parser says.
        reason: String,
    },
    /// A key that means nothing.
    #[error("there is no key `{key}` here")]
    UnknownKey {
        /// The key.
        key: String,
        /// Those that this table has.
        expected: &'static [&'static str],
    },
    /// A word that is not one of a list.
    #[error("{word:?} is not one of the words for this")]
    UnknownWord {
        /// The word.
        word: String,
        /// Those that are.
        expected: &'static [&'static str],
    },
    /// A key that has no default is absent.
    #[error("the key `{key}` is missing")]
    MissingKey {
        /// The key.
        key: &'static str,
    },
    /// A value of another type.
    #[error("{found} stands where {expected} is needed")]
    WrongType {
        /// What stands there.
        found: String,
        /// What belongs there.
        expected: String,
    },
    /// A number outside its type.
    #[error("{found} is not {expected}")]
    OutOfRange {
        /// What stands there.
        found: String,
        /// What belongs there.
        expected: String,
    },
    /// A number outside what its quantity allows.
    #[error("{reason}")]
    Refused {
        /// The quantity's own words.
        reason: String,
    },

    /// A set without axes.
    #[error("a set needs at least one axis")]
    NoAxis,
    /// More axes than there are addresses.
    #[error("{count} axes are too many, a set has 1 to 7")]
    TooManyAxes {
        /// How many there are.
        count: usize,
    },
    /// Two cards would answer to one address.
    #[error("address {address} is already that of `{owner}`")]
    AddressTaken {
        /// The address.
        address: u8,
        /// The name of the axis that has it.
        owner: String,
    },
    /// A name that cannot be told from a number, a word of the command line or another name.
    #[error("{name:?} cannot be a name")]
    BadName {
        /// The name.
        name: String,
    },
    /// Two things of one kind with one name.
    #[error("the name `{name}` is already taken")]
    NameTaken {
        /// The name.
        name: String,
    },
    /// A number that must not be 0.
    #[error("this must not be 0")]
    Zero,
    /// Two values in the wrong order.
    #[error("{value} is not more than `{below}`, which is {bound}")]
    NotAbove {
        /// The value.
        value: u32,
        /// The key of the value that it must exceed.
        below: &'static str,
        /// That value.
        bound: u32,
    },
    /// A rail that no command can cross.
    #[error("a rail of {length} steps is too long, positions go to 1 000 000")]
    RailTooLong {
        /// Steps.
        length: u32,
    },
    /// The carriage would stand beyond the end of its rail.
    #[error("{start} is beyond the end of the rail, {length}")]
    StartBeyondRail {
        /// Steps from the lower stop.
        start: u32,
        /// The last step of the rail.
        length: u32,
    },
    /// A permitted position in the lower limit zone.
    #[error("position {min} lies in the lower limit zone")]
    TravelBelowOrigin {
        /// Steps from the origin.
        min: i32,
    },
    /// No position is permitted.
    #[error("{max} is less than `min`, {min}")]
    TravelReversed {
        /// The lowest position.
        min: i32,
        /// The highest one.
        max: i32,
    },
    /// A permitted position in the upper limit zone or beyond it.
    #[error("position {max} lies in the upper limit zone or beyond, the last one before it is {last}")]
    TravelAboveRail {
        /// Steps from the origin.
        max: i32,
        /// The last position below the upper limit zone.
        last: i64,
    },
    /// The search for the origin would end at the lower stop, not at the limit switch.
    #[error(
        "from speed {speed} the carriage needs at least {needed} steps to stop, but the lower limit zone has {lower_zone}"
    )]
    OriginationTooFast {
        /// The index into the ramp table.
        speed: u8,
        /// Steps of the steepest ramp down from it, the emergency stop's.
        needed: u64,
        /// Steps.
        lower_zone: u32,
    },
    /// A key that another profile has.
    #[error("`{key}` belongs to the profile {}, and this ramp is `{}`", ProfileName::owners(key), profile.word())]
    OtherProfile {
        /// The key.
        key: String,
        /// Whose it is, or the first of those.
        owner: ProfileName,
        /// What the ramp is.
        profile: ProfileName,
    },
    /// A table in a file and in the text.
    #[error("`file` and `counts` both give the table")]
    TwoTables,
    /// A file that is beside nothing.
    #[error("this text comes from no file, beside which the table could be looked for")]
    NoFolder,
    /// A table that cannot be read.
    #[error("the table {} cannot be read: {reason}", path.display())]
    TableUnreadable {
        /// Its file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A line of a table that is no count.
    #[error("{found:?} is not a whole number from 0 to 65 535")]
    TableLine {
        /// What stands there.
        found: String,
    },
    /// A ramp that cannot be played.
    #[error("this ramp cannot be used: {0}")]
    Ramp(#[from] RampError),
    /// A card has sixteen lines.
    #[error("there is no line {bit}, a card has the lines 0 to 15")]
    NoSuchBit {
        /// The number.
        bit: u8,
    },
    /// Two names for one line.
    #[error("line {bit} is already `{owner}`")]
    BitTaken {
        /// The line.
        bit: u8,
        /// Its first name.
        owner: String,
    },
    /// An input follows nothing.
    #[error("there is no output `{name}`")]
    NoSuchOutput {
        /// The name.
        name: String,
        /// The names that there are.
        outputs: Vec<String>,
    },
    /// A delay with nothing to wait for.
    #[error("a delay of {delay_ms} ms has no effect without `follows`")]
    DelayWithoutCause {
        /// Milliseconds.
        delay_ms: u32,
    },
    /// A card would count as hung between two heartbeats.
    #[error("{silent_ms} ms of silence is not more than two heartbeats of {heartbeat_ms} ms")]
    SilenceTooShort {
        /// Milliseconds.
        silent_ms: u32,
        /// Milliseconds.
        heartbeat_ms: u32,
    },
}

impl Problem {
    /// What to do about it. `None` where only the meaning of the key helps.
    #[must_use]
    pub fn advice(&self) -> Option<String> {
        let fixed = match self {
            Self::UnknownKey { key, expected } => {
                return Some(choose(key, expected.iter().copied(), "the keys here are"));
            }
            Self::UnknownWord { word, expected } => {
                return Some(choose(word, expected.iter().copied(), "the words are"));
            }
            Self::NoSuchOutput { name, outputs } => {
                return Some(choose(name, outputs.iter().map(String::as_str), "the outputs are"));
            }
            Self::TravelAboveRail { last, .. } => {
                return Some(format!("set it to {last} or less, or lengthen the rail"));
            }
            Self::NotAbove { below, .. } => {
                return Some(format!(
                    "give a value above `{below}`; 0 < lower_zone < reference < upper_zone < length"
                ));
            }
            Self::OtherProfile { owner, profile, .. } => {
                let keys: Vec<_> = profile.keys().iter().map(|key| format!("`{key}`")).collect();
                let (keys, owner) = (keys.join(", "), owner.word());
                return Some(match profile {
                    ProfileName::Linear => format!(
                        "a linear ramp has {keys}, and its interval is t_a / 232; or write `profile = \"{owner}\"`"
                    ),
                    _ => format!("a {} ramp has {keys}; or write `profile = \"{owner}\"`", profile.word()),
                });
            }
            Self::MissingKey { key: "file" } => {
                return Some(
                    "name a `file` with the numbers N, one a line, or write them: `counts = [3076, …]`"
                        .to_owned(),
                );
            }
            Self::WrongType { expected, .. } if expected == "an array of tables" => {
                "write its header in double brackets, once for each, as [[axis]]"
            }
            Self::MissingKey { .. }
            | Self::WrongType { .. }
            | Self::OutOfRange { .. }
            | Self::Refused { .. } => return None,
            Self::NotUtf8 { is_utf16: true } => "it seems to be UTF-16; save the file as UTF-8",
            Self::NotUtf8 { is_utf16: false } => "name a text file, saved as UTF-8",
            Self::Control { .. } => "remove it; in a string, write it as an escape: \\uXXXX",
            Self::Syntax { reason } if reason.contains("duplicate key") => {
                "a key, or a table, is written once: join the two, or remove one; axes are [[axis]]"
            }
            Self::Syntax { .. } => {
                "write it as `key = value`, strings in quotes, tables as [name], axes as [[axis]]"
            }
            Self::NoAxis => {
                "add an [[axis]] table; `ccu config show` prints the built-in set, to be copied and changed"
            }
            Self::TooManyAxes { .. } => "remove the axes beyond the seventh: the addresses are 1 to 7",
            Self::AddressTaken { .. } => "give each axis an address of its own, 1 to 7",
            Self::BadName { .. } => {
                "use lower-case letters, digits and `_`, begin with a letter, and do not use `all`"
            }
            Self::NameTaken { .. } => "give each a name of its own",
            Self::Zero => "give 1 or more",
            Self::RailTooLong { .. } => "give 1000000 or less",
            Self::StartBeyondRail { .. } => "start between 0 and `length`",
            Self::TravelBelowOrigin { .. } => {
                "give 0 or more; 0 is the origin, the first step out of the lower limit zone"
            }
            Self::TravelReversed { .. } => "exchange `min` and `max`, or correct one of them",
            Self::OriginationTooFast { .. } => "lower `origination.speed`, or widen `rail.lower_zone`",
            Self::TwoTables => "remove one of them",
            Self::NoFolder => {
                "write the numbers themselves, `counts = [3076, …]`, or load the configuration as a file"
            }
            Self::TableUnreadable { .. } => {
                "`file` is looked for beside the configuration; name one that exists"
            }
            Self::TableLine { .. } => "write one number N a line; what follows a `#` is a comment",
            Self::Ramp(error) => advice_on_ramp(error),
            Self::NoSuchBit { .. } => "give 0 to 15",
            Self::BitTaken { .. } => "give each line a bit of its own, 0 to 15",
            Self::DelayWithoutCause { .. } => "name the output that it follows, or remove the delay",
            Self::SilenceTooShort { .. } => {
                "make `silent_ms` at least 2 · heartbeat_ms + 1, better four times as long"
            }
        };
        Some(fixed.to_owned())
    }

    /// What a second place in the text has to do with it.
    pub(crate) const fn about_the_other(&self) -> &'static str {
        match self {
            Self::AddressTaken { .. } | Self::NameTaken { .. } | Self::BitTaken { .. } => "first used here",
            Self::OtherProfile { .. } => "the profile",
            Self::TwoTables => "the other one",
            _ => "compared with this",
        }
    }
}

const fn advice_on_ramp(error: &RampError) -> &'static str {
    match error {
        RampError::NotFinite { .. } => "write a plain number",
        RampError::NoInterval => "the paper's 1.29 ms are 2580 ticks of 0.5 µs",
        RampError::NoTime { .. } => "give the seconds from `f_start` to `f_max`; the paper's ramp takes 0.3",
        RampError::IntervalTooLong { .. } => "make it shorter; the paper's ramp takes 0.3 s",
        RampError::Falls { .. } => "exchange the two, or correct one of them",
        RampError::Length { .. } => "give 2 to 233 numbers N; the last one holds to the end of the ramp",
        RampError::NoBrakeInterval | RampError::BrakeSlower { derived: false, .. } => {
            "give it 1 or more, but no more than `interval_ticks`; a third of that is usual"
        }
        RampError::BrakeSlower { derived: true, .. } => {
            "give it no more than t_a / 232 in ticks of 0.5 µs, or leave it out: then it is a third of that"
        }
        RampError::OffsetTooLong { .. } => "give 65535 or less; the paper keeps 10",
        RampError::Undividable { .. } => {
            "change the top speed (`amplitude`, `f_max`, the last N), or the lowest (`phase`, `f_start`, the first N)"
        }
        RampError::SpeedFalls { .. } => {
            "keep omega · 232 · interval_ticks · 0.5 µs + phase at or below π/2, the top of the curve; the N of a table \
             never rise"
        }
        RampError::TooSteep { .. } => {
            "write `differences = \"wide\"`, or begin faster (`phase`, `f_start`), or make the interval shorter"
        }
    }
}

/// What to say to a name that is none of the right ones: "did you mean", and the whole list, as in
/// ``did you mean `left_x`? the axes are `left_x`, `left_y` ``.
#[must_use]
pub fn choose<'a>(wrong: &str, right: impl Iterator<Item = &'a str> + Clone, list_is: &str) -> String {
    let nearest = right
        .clone()
        .map(|candidate| (strsim::damerau_levenshtein(wrong, candidate), candidate))
        .min()
        // A third of the letters may be wrong, and one always.
        .filter(|(distance, candidate)| *distance <= (candidate.chars().count() / 3).max(1));
    let all: Vec<String> = right.map(|candidate| format!("`{candidate}`")).collect();
    let all = if all.is_empty() { "none".to_owned() } else { all.join(", ") };
    match nearest {
        Some((_, nearest)) => format!("did you mean `{nearest}`? {list_is} {all}"),
        None => format!("{list_is} {all}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_near_words_are_suggested() {
        let words = || ["length", "lower_zone", "start"].into_iter();
        assert_eq!(
            choose("lentgh", words(), "the keys are"),
            "did you mean `length`? the keys are `length`, `lower_zone`, `start`"
        );
        assert_eq!(choose("colour", words(), "the keys are"), "the keys are `length`, `lower_zone`, `start`");
        assert_eq!(choose("x", std::iter::empty(), "the outputs are"), "the outputs are none");
    }
}
