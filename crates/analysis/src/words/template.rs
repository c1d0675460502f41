//! Sentences with fields. A field is `{name}` or `{name:format}`; `{{` and `}}` are braces.
//!
//! | format | writes |
//! |---|---|
//! | none | a word as it is, a count, another message |
//! | `.3g` `.0f` `.2e` `.0%` | a number as Python does |
//! | `op` `pv` | a number with three digits and the unit |
//! | `about` | a number with two digits and the unit of OP |
//! | `of span` | a number in % of span |
//! | `number` | a number with three digits |
//! | `seconds` `duration` `time` | \[s\] as seconds, in the two largest units, as a moment of the recording |
//! | `share` | 0 to 1, in per cent |
//! | `size` | a number without its sign |
//! | `row` `rows` | a row, or several, as a person counts them |
//! | `times` | never, once, twice, 3 times |
//! | `count NOUN` | a count with its noun |
//! | `and` | a list in a word, its comma as "and" |
//! | `list` | several messages, "and" between; without it they follow each other |

use super::number::{self, dated, fixed, general, quantity, scientific};
use super::{Numbers, Reader, TextError, Value, text};

/// The sentence with its fields filled in.
pub(super) fn filled(code: &str, sentence: &str, numbers: &dyn Numbers, reader: &Reader) -> Result<String, TextError> {
    let mut filled = String::with_capacity(2 * sentence.len());
    for part in parts(sentence) {
        match part {
            Part::Text(text) => filled.push_str(text),
            Part::Field(name, format) => {
                let value = numbers.value(name).or_else(|| of_reader(name, reader));
                let value = value.ok_or_else(|| TextError::Number { code: code.into(), name: name.into() })?;
                let wrong = || TextError::Format { code: code.into(), name: name.into(), format: format.into() };
                filled.push_str(&written(&value, format, reader)?.ok_or_else(wrong)?);
            }
        }
    }
    Ok(filled)
}

pub(super) enum Part<'a> {
    Text(&'a str),
    /// Name and format.
    Field(&'a str, &'a str),
}

/// The literal parts and fields of a sentence.
pub(super) fn parts(sentence: &str) -> Vec<Part<'_>> {
    let mut parts = Vec::new();
    let mut rest = sentence;
    while let Some(at) = rest.find(['{', '}']) {
        let (before, from) = rest.split_at(at);
        parts.push(Part::Text(before));
        if from.starts_with("{{") || from.starts_with("}}") {
            parts.push(Part::Text(&from[..1]));
            rest = &from[2..];
            continue;
        }
        let Some(end) = from.find('}') else { break };
        let field = from[..end].trim_start_matches('{');
        let (name, format) = field.split_once(':').unwrap_or((field, ""));
        parts.push(Part::Field(name, format));
        rest = &from[end + 1..];
    }
    parts.push(Part::Text(rest));
    parts
}

/// A value that the reader gives: name, unit, moment.
fn of_reader(name: &str, reader: &Reader) -> Option<Value> {
    let of = match name {
        "name" => &reader.name,
        "pv_unit" => &reader.pv_unit,
        "op_unit" => &reader.op_unit,
        "unit" => reader.of_op(),
        _ => return None,
    };
    Some(Value::Word(of.to_string().into()))
}

/// None where the value is not of the kind that the format writes.
fn written(value: &Value, format: &str, reader: &Reader) -> Result<Option<String>, TextError> {
    Ok(match (format, value) {
        ("", Value::Message(message)) => Some(text(&message.code, &message.numbers, reader)?),
        ("" | "list", Value::List(all)) => {
            let each = all.iter().map(|one| written(one, "", reader)).collect::<Result<Option<Vec<_>>, _>>()?;
            each.map(|each| each.join(if format.is_empty() { "" } else { " and " }))
        }
        _ => simple(value, format, reader),
    })
}

/// A value without a unit as text; none where the format needs one.
fn simple(value: &Value, format: &str, reader: &Reader) -> Option<String> {
    let row = |row: i64| format!("row {}", row + reader.first_row);
    Some(match (format, value) {
        ("" | "time" | "list", Value::Word(word)) => word.to_string(),
        ("", Value::Count(count)) => count.to_string(),
        ("", Value::Number(x)) => format!("{x}"),
        ("and", Value::Word(word)) => word.replace(',', " and"),
        ("rows", Value::Word(rows)) => {
            rows.split_whitespace().map(|one| one.parse().map(row).ok()).collect::<Option<Vec<_>>>()?.join(", ")
        }
        ("steps", Value::None) => "does not step".into(),
        ("steps", _) if value.number()? == 0.0 => "does not step".into(),
        ("steps", _) => format!("steps by {}", general(value.number()?, 6)),
        ("row", _) => row(value.whole()?),
        ("d", _) => value.whole()?.to_string(),
        ("times", _) => match value.whole()? {
            0 => "never".into(),
            1 => "once".into(),
            2 => "twice".into(),
            n => format!("{n} times"),
        },
        // A number that is not there is a dash.
        (format, Value::None) if !format.is_empty() => "–".into(),
        _ => return measured(value.number()?, format, value, reader),
    })
}

/// A quantity with its unit as text.
fn measured(x: f64, format: &str, value: &Value, reader: &Reader) -> Option<String> {
    Some(match format {
        "seconds" => number::seconds(x),
        "duration" => number::duration(x),
        "time" => dated(reader.t0, x).unwrap_or_else(|| format!("{} s", general(x, 10))),
        "share" => number::share(x),
        "size" => general(x.abs(), 3),
        "number" => number::number(Some(x), 3),
        "op" => quantity(Some(x), reader.of_op(), 3),
        "about" => quantity(Some(x), &reader.op_unit, 2),
        "pv" => quantity(Some(x), &reader.pv_unit, 3),
        "of span" => quantity(Some(x), "% of span", 3),
        _ => {
            if let Some(noun) = format.strip_prefix("count ") {
                return Some(number::count(value.whole()?, noun));
            }
            let (places, kind) = places(format)?;
            match kind {
                'f' => fixed(x, places),
                'g' => general(x, places),
                'e' => scientific(x, places),
                '%' => format!("{}%", fixed(100.0 * x, places)),
                _ => return None,
            }
        }
    })
}

/// Places and kind of one of Python's formats: `.3g` is (3, 'g').
fn places(format: &str) -> Option<(usize, char)> {
    let kind = format.chars().next_back()?;
    let places = &format[..format.len() - kind.len_utf8()];
    Some((if places.is_empty() { 6 } else { places.strip_prefix('.')?.parse().ok()? }, kind))
}
