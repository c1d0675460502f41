//! Texts for a person: the words of `glapp_analysis::words` for JavaScript.

use glapp_analysis::words::{self, Headline, Reader, Value};
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;

/// A request for words.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Asked {
    /// A message.
    Text {
        /// Code of the message.
        code: String,
        /// Numbers of the message.
        #[serde(default)]
        numbers: BTreeMap<String, Value>,
        /// Reader of the texts.
        #[serde(default)]
        reader: Reader,
    },
    /// A number with so many significant digits.
    Number(Option<f64>, usize),
    /// A number with so many significant digits, and its unit.
    Quantity(Option<f64>, String, usize),
    /// A time span \[s\].
    Duration(f64),
    /// A moment, so many seconds after a local date and time [µs since 1970].
    Clock(Option<i64>, f64),
    /// A count with its noun.
    Count(i64, String),
    /// A reason as a sentence.
    Sentence(String),
    /// All loops in short.
    Overview(Vec<Headline>),
    /// Every code with its template.
    Catalogue,
}

pub(crate) fn texts_of(asked: Asked) -> Result<serde_json::Value, String> {
    Ok(json!(match asked {
        Asked::Text { code, numbers, reader } => words::text(&code, &numbers, &reader).map_err(|e| e.to_string())?,
        Asked::Number(value, digits) => words::number(value, digits),
        Asked::Quantity(value, unit, digits) => words::quantity(value, &unit, digits),
        Asked::Duration(seconds) => words::duration(seconds),
        Asked::Clock(t0, seconds) => words::clock(t0, seconds),
        Asked::Count(n, noun) => words::count(n, &noun),
        Asked::Sentence(text) => words::sentence(&text),
        Asked::Overview(run) => words::overview(&run, &Reader::default()).map_err(|e| e.to_string())?,
        Asked::Catalogue => return Ok(json!(words::catalogue().collect::<BTreeMap<_, _>>())),
    }))
}
