//! From the spanned tree to the model, by serde. The crate `toml` can do this too, but its errors are text; these know
//! the key, the place and the cause, so that the message can say what to do. It knows nothing of the model.

use std::fmt;
use std::ops::Range;

use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeSeed, Error as _, Expected, IntoDeserializer, MapAccess, SeqAccess, Unexpected, Visitor,
};
use serde::{Deserialize, forward_to_deserialize_any};
use toml::Spanned;
use toml::de::{DeString, DeValue};

use crate::KeyPath;
use crate::document::Segment;
use crate::problem::Problem;

/// The first value that does not fit the model.
#[derive(Debug)]
pub(crate) struct Mismatch {
    pub(crate) key: KeyPath,
    pub(crate) span: Option<Range<usize>>,
    pub(crate) problem: Problem,
}

/// Reads a model from a tree.
pub(crate) fn deserialize<'de, T: Deserialize<'de>>(root: &Spanned<DeValue<'_>>) -> Result<T, Box<Mismatch>> {
    T::deserialize(Node(root)).map_err(|Boxed(mismatch)| mismatch)
}

/// serde wants an error type that is an error; results stay small when it is a pointer.
#[derive(Debug)]
struct Boxed(Box<Mismatch>);

impl Boxed {
    fn new(problem: Problem) -> Self {
        Self(Box::new(Mismatch { key: KeyPath::default(), span: None, problem }))
    }

    /// The innermost place is the right one, so the first to say it wins.
    fn at(mut self, span: Range<usize>) -> Self {
        self.0.span.get_or_insert(span);
        self
    }

    fn inside(mut self, outer: Segment) -> Self {
        self.0.key = std::mem::take(&mut self.0.key).inside(outer);
        self
    }
}

impl fmt::Display for Boxed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.problem.fmt(f)
    }
}

impl std::error::Error for Boxed {}

impl de::Error for Boxed {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(Problem::Refused { reason: message.to_string() })
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(Problem::WrongType { found: describe(&found), expected: in_words(&expected.to_string()) })
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(Problem::OutOfRange { found: describe(&found), expected: in_words(&expected.to_string()) })
    }

    fn unknown_variant(word: &str, expected: &'static [&'static str]) -> Self {
        Self::new(Problem::UnknownWord { word: word.to_owned(), expected })
    }

    fn unknown_field(key: &str, expected: &'static [&'static str]) -> Self {
        Self::new(Problem::UnknownKey { key: key.to_owned(), expected }).inside(Segment::Key(key.to_owned()))
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Problem::MissingKey { key }).inside(Segment::Key(key.to_owned()))
    }
}

/// What was found, in TOML's words.
fn describe(found: &Unexpected<'_>) -> String {
    match found {
        Unexpected::Str(text) => format!("the string {text:?}"),
        Unexpected::Signed(number) => number.to_string(),
        Unexpected::Unsigned(number) => number.to_string(),
        Unexpected::Float(number) => format!("{number:?}"),
        Unexpected::Bool(value) => value.to_string(),
        Unexpected::Map => "a table".to_owned(),
        Unexpected::Seq => "an array".to_owned(),
        other => other.to_string(),
    }
}

/// What serde expects, in the words of people who write TOML.
fn in_words(expected: &str) -> String {
    match expected {
        "u8" => "a whole number from 0 to 255".to_owned(),
        "u16" => "a whole number from 0 to 65 535".to_owned(),
        "u32" => "a whole number from 0 to 4 294 967 295".to_owned(),
        "i32" => "a whole number from -2 147 483 648 to 2 147 483 647".to_owned(),
        "f64" => "a number".to_owned(),
        "a sequence" => "an array of tables".to_owned(),
        shape if shape.starts_with("struct ") => "a table".to_owned(),
        shape if shape.starts_with("enum ") => "a word in quotes".to_owned(),
        other => other.to_owned(),
    }
}

/// A value of the tree.
#[derive(Clone, Copy)]
struct Node<'a, 'i>(&'a Spanned<DeValue<'i>>);

impl Node<'_, '_> {
    fn visit<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Boxed> {
        match self.0.get_ref() {
            DeValue::String(text) => visitor.visit_str(text),
            DeValue::Boolean(value) => visitor.visit_bool(*value),
            DeValue::Integer(number) => match i64::from_str_radix(number.as_str(), number.radix()) {
                Ok(number) => visitor.visit_i64(number),
                Err(_) => Err(Boxed::new(Problem::OutOfRange {
                    found: number.to_string(),
                    expected: "a whole number of 64 bits".to_owned(),
                })),
            },
            DeValue::Float(number) => match number.as_str().parse() {
                Ok(number) => visitor.visit_f64(number),
                Err(_) => Err(de::Error::invalid_value(Unexpected::Other(number.as_str()), &visitor)),
            },
            DeValue::Datetime(_) => {
                Err(de::Error::invalid_type(Unexpected::Other("a date or time"), &visitor))
            }
            DeValue::Array(elements) => visitor.visit_seq(Elements(elements.iter().enumerate())),
            DeValue::Table(table) => visitor.visit_map(Entries { entries: table.iter(), value: None }),
        }
    }
}

impl<'de> de::Deserializer<'de> for Node<'_, '_> {
    type Error = Boxed;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Boxed> {
        self.visit(visitor).map_err(|error| error.at(self.0.span()))
    }

    /// TOML has no null: what is there is some.
    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Boxed> {
        visitor.visit_some(self).map_err(|error| error.at(self.0.span()))
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Boxed> {
        visitor.visit_newtype_struct(self).map_err(|error| error.at(self.0.span()))
    }

    /// A derived visitor would also take an array, whose values no one could tell apart.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Boxed> {
        match self.0.get_ref() {
            DeValue::Array(_) => Err(Boxed::invalid_type(Unexpected::Seq, &visitor).at(self.0.span())),
            _ => self.deserialize_any(visitor),
        }
    }

    /// The enums of the model are words.
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Boxed> {
        match self.0.get_ref() {
            DeValue::String(word) => {
                let word: StrDeserializer<'_, Boxed> = word.as_ref().into_deserializer();
                visitor.visit_enum(word).map_err(|error| error.at(self.0.span()))
            }
            _ => self.deserialize_any(visitor),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf
        unit unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

struct Elements<'a, 'i>(std::iter::Enumerate<std::slice::Iter<'a, Spanned<DeValue<'i>>>>);

impl<'de> SeqAccess<'de> for Elements<'_, '_> {
    type Error = Boxed;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Boxed> {
        let Some((index, element)) = self.0.next() else {
            return Ok(None);
        };
        let value = seed.deserialize(Node(element));
        value.map(Some).map_err(|error| error.at(element.span()).inside(Segment::Index(index)))
    }
}

struct Entries<'a, 'i, I> {
    entries: I,
    value: Option<(&'a Spanned<DeString<'i>>, &'a Spanned<DeValue<'i>>)>,
}

impl<'a, 'i: 'a, 'de, I> MapAccess<'de> for Entries<'a, 'i, I>
where
    I: Iterator<Item = (&'a Spanned<DeString<'i>>, &'a Spanned<DeValue<'i>>)>,
{
    type Error = Boxed;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Boxed> {
        let Some((key, value)) = self.entries.next() else {
            return Ok(None);
        };
        self.value = Some((key, value));
        let name: StrDeserializer<'_, Boxed> = key.get_ref().as_ref().into_deserializer();
        seed.deserialize(name).map(Some).map_err(|error| error.at(key.span()))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Boxed> {
        let Some((key, value)) = self.value.take() else {
            return Err(Boxed::custom("a value was asked for before its key"));
        };
        seed.deserialize(Node(value))
            .map_err(|error| error.at(value.span()).inside(Segment::Key(key.get_ref().to_string())))
    }
}
