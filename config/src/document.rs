//! The text as a tree that remembers where everything stands: key paths, spans, lines and columns.
//!
//! It knows TOML, but not what the keys mean.

use std::fmt;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where a value is in the configuration, as in `axis[2].rail.start`. Tables of an array count from 0.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct KeyPath(Vec<Segment>);

/// One step of a [`KeyPath`].
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Segment {
    /// Into a table.
    Key(String),
    /// Into an array.
    Index(usize),
}

impl KeyPath {
    /// The path that leads one table deeper.
    pub(crate) fn key(&self, key: &str) -> Self {
        let mut path = self.clone();
        path.0.push(Segment::Key(key.to_owned()));
        path
    }

    /// The path to an element.
    pub(crate) fn index(&self, index: usize) -> Self {
        let mut path = self.clone();
        path.0.push(Segment::Index(index));
        path
    }

    /// The same place, seen from one level further up.
    pub(crate) fn inside(mut self, outer: Segment) -> Self {
        self.0.insert(0, outer);
        self
    }

    pub(crate) fn segments(&self) -> &[Segment] {
        &self.0
    }

    /// Whether this is the path of the whole document.
    #[must_use]
    pub const fn is_root(&self) -> bool {
        self.0.is_empty()
    }
}

impl fmt::Display for KeyPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, segment) in self.0.iter().enumerate() {
            match segment {
                Segment::Index(index) => write!(f, "[{index}]")?,
                Segment::Key(key) => {
                    if place > 0 {
                        f.write_str(".")?;
                    }
                    if !key.is_empty()
                        && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-')
                    {
                        f.write_str(key)?;
                    } else {
                        write!(f, "{key:?}")?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// A syntax error: what the parser says, and which bytes it does not like.
pub(crate) struct SyntaxError {
    pub(crate) message: String,
    pub(crate) span: Range<usize>,
}

/// Parses a text into its spanned tree.
pub(crate) fn parse(text: &str) -> Result<Spanned<DeValue<'_>>, SyntaxError> {
    match DeTable::parse(text) {
        Ok(table) => Ok(Spanned::new(table.span(), DeValue::Table(table.into_inner()))),
        Err(error) => Err(SyntaxError {
            message: error.message().to_owned(),
            span: error.span().unwrap_or(text.len()..text.len()),
        }),
    }
}

/// The place of a value; `Err` with that of the nearest table around it when the text does not mention it.
pub(crate) fn locate(root: &Spanned<DeValue<'_>>, path: &KeyPath) -> Result<Range<usize>, Range<usize>> {
    let mut here = root;
    for segment in path.segments() {
        let next = match segment {
            Segment::Key(key) => here.get_ref().get(key),
            Segment::Index(index) => here.get_ref().get(index),
        };
        here = next.ok_or_else(|| here.span())?;
    }
    Ok(here.span())
}

/// Line and column, both from 1; the column counts characters, but not a byte-order mark, which nobody sees.
pub(crate) fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..floor_char_boundary(text, offset)];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().filter(|c| *c != '\u{feff}').count() + 1)
}

/// The nearest place at or before `offset` where a character begins.
pub(crate) fn floor_char_boundary(text: &str, offset: usize) -> usize {
    let mut offset = offset.min(text.len());
    while !text.is_char_boundary(offset) {
        offset -= 1;
    }
    offset
}

/// The key that a text that is not TOML seems to speak of at `offset`: what precedes the `=` on that line, inside the
/// last header above it. A guess for people, made from lines alone, since there is no tree.
pub(crate) fn key_near(text: &str, offset: usize) -> KeyPath {
    let offset = floor_char_boundary(text, offset);
    let line_end = text[offset..].find('\n').map_or(text.len(), |newline| offset + newline);
    let mut path = KeyPath::default();
    let mut elements: Vec<&str> = Vec::new();
    for line in text[..line_end].lines() {
        let Some(header) = line.trim_start().strip_prefix('[') else {
            continue;
        };
        let name = header.trim_start_matches('[').split([']', '#']).next().unwrap_or_default().trim();
        if header.starts_with('[') {
            elements.push(name);
        }
        path = KeyPath::default();
        let mut so_far = String::new();
        for key in name.split('.').map(str::trim).filter(|key| !key.is_empty()) {
            if !so_far.is_empty() {
                so_far.push('.');
            }
            so_far.push_str(key);
            path = path.key(key);
            if let Some(last) = elements.iter().filter(|element| **element == so_far).count().checked_sub(1) {
                path = path.index(last);
            }
        }
    }
    let line = text[..line_end].lines().next_back().unwrap_or_default().trim_start();
    let Some((key, _)) = line.split_once('=') else {
        return path;
    };
    let key = key.trim();
    if key.is_empty() || key.contains('#') || line.starts_with('[') {
        return path;
    }
    key.split('.').fold(path, |path, key| path.key(key.trim().trim_matches(['"', '\''])))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[ramp]\nomega = 4.5\n[[axis]]\nname = \"ä\"\nrail = { length = 5 }\n[[axis]]\n[axis.rail]\nlength = \n";

    #[test]
    fn columns_count_characters() {
        assert_eq!(line_and_column("a\näöb", 2), (2, 1));
        assert_eq!(line_and_column("a\näöb", 6), (2, 3));
        assert_eq!(line_and_column("a\näöb", 3), (2, 1), "inside a character");
        assert_eq!(line_and_column("a", 99), (1, 2));
    }

    #[test]
    fn values_are_found_by_their_path() {
        let text = TEXT.replace("length = \n", "length = 7\n");
        let Ok(root) = parse(&text) else { panic!("this is TOML") };
        let path = KeyPath::default().key("axis").index(1).key("rail").key("length");
        assert_eq!(locate(&root, &path).map(|span| &text[span]), Ok("7"));
        assert_eq!(path.to_string(), "axis[1].rail.length");
        let absent = KeyPath::default().key("axis").index(1).key("rail").key("start");
        assert_eq!(locate(&root, &absent).map_err(|span| &text[span]), Err("[axis.rail]"));
    }

    #[test]
    fn broken_text_still_has_a_nearest_key() {
        let near = |needle: &str| key_near(TEXT, TEXT.find(needle).expect("in the text")).to_string();
        assert_eq!(near("4.5"), "ramp.omega");
        assert_eq!(near("ä"), "axis[0].name");
        assert_eq!(near("axis.rail"), "axis[1].rail");
        assert_eq!(near("length = \n"), "axis[1].rail.length");
        assert_eq!(key_near("", 0).to_string(), "");
        assert_eq!(key_near("\"a b\" = ", 6).to_string(), "\"a b\"");
    }
}
