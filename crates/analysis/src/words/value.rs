//! The numbers of a message.

use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// One number or word of a message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// No value.
    None,
    /// Yes or no.
    Flag(bool),
    /// A count, or a row counted from 0; −1 where there is none.
    Count(i64),
    /// A number; shares are 0 to 1, times in s.
    Number(f64),
    /// A name.
    Word(Cow<'static, str>),
    /// Another message, whose sentence is part of this one.
    Message(Box<Message>),
    /// Several of them.
    List(Vec<Self>),
}

impl Value {
    /// The value as a number; none of a word.
    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Self::Count(count) => Some(*count as f64),
            Self::Number(x) => Some(*x),
            _ => None,
        }
    }

    /// The value as a whole number.
    pub(super) fn whole(&self) -> Option<i64> {
        match self {
            Self::Count(count) => Some(*count),
            Self::Number(x) if x.fract() == 0.0 => Some(*x as i64),
            _ => None,
        }
    }
}

impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl From<Option<f64>> for Value {
    fn from(x: Option<f64>) -> Self {
        x.map_or(Self::None, Self::Number)
    }
}

impl From<u64> for Value {
    fn from(count: u64) -> Self {
        Self::Count(i64::try_from(count).unwrap_or(i64::MAX))
    }
}

impl From<usize> for Value {
    fn from(count: usize) -> Self {
        Self::from(count as u64)
    }
}

impl From<Option<u64>> for Value {
    fn from(row: Option<u64>) -> Self {
        row.map_or(Self::Count(-1), Self::from)
    }
}

impl From<&'static str> for Value {
    fn from(word: &'static str) -> Self {
        Self::Word(word.into())
    }
}

impl From<String> for Value {
    fn from(word: String) -> Self {
        Self::Word(word.into())
    }
}

impl From<Message> for Value {
    fn from(message: Message) -> Self {
        Self::Message(Box::new(message))
    }
}

/// A source of a message's numbers.
pub trait Numbers {
    /// The one of that name; none where it is not there.
    fn value(&self, name: &str) -> Option<Value>;
}

impl Numbers for BTreeMap<String, Value> {
    fn value(&self, name: &str) -> Option<Value> {
        self.get(name).cloned()
    }
}

impl Numbers for [(&'static str, Value)] {
    fn value(&self, name: &str) -> Option<Value> {
        self.iter().find(|(known, _)| *known == name).map(|(_, value)| value.clone())
    }
}

/// Numbers as the variants of a sentence ask for them.
impl dyn Numbers + '_ {
    pub(super) fn number(&self, name: &str) -> Option<f64> {
        self.value(name)?.number()
    }

    pub(super) fn word(&self, name: &str) -> String {
        match self.value(name) {
            Some(Value::Word(word)) => word.into_owned(),
            _ => String::new(),
        }
    }

    pub(super) fn flag(&self, name: &str) -> bool {
        self.value(name) == Some(Value::Flag(true))
    }

    /// Whether it is there and not null.
    pub(super) fn has(&self, name: &str) -> bool {
        !matches!(self.value(name), None | Some(Value::None))
    }
}

/// A code with its numbers: the stored and sent form of a sentence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// `subject.name`, as the catalogue has it.
    pub code: String,
    /// Numbers by name.
    #[serde(default)]
    pub numbers: BTreeMap<String, Value>,
}

impl Message {
    /// A message without numbers.
    pub fn new(code: impl Into<String>) -> Self {
        Self { code: code.into(), numbers: BTreeMap::new() }
    }

    /// Adds a number to the message.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.numbers.insert(name.into(), value.into());
        self
    }
}
