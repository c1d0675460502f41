//! Texts for a person: the one catalogue of messages and the one renderer.
//!
//! A message is a code with named, typed [`Numbers`]; [`text`] puts it into a sentence. Python, the page, the report and C all call
//! it, so that a sentence, a number's format and the choice between two wordings stand once. The catalogue has a file a subject;
//! a code is `subject.name`, as in `quality.gaps`.
//!
//! A sentence is a template: `{name}` is the number of that name, `{name:format}` the same in one of the [`template`]'s formats.
//! Where a message has several wordings, the numbers choose, and nothing else does.

/// Sentences by name; the parts of one are joined.
macro_rules! sentences {
    ($($name:literal: $($part:expr),+;)*) => {
        &[$(($name, concat!($($part),+))),*]
    };
}

mod answer;
mod correction;
mod crossings;
mod facts;
mod fit;
mod fleet;
mod half_period;
mod identification;
mod labels;
mod number;
mod of_answer;
mod of_fit;
mod position;
mod quality;
mod reader;
mod settings;
mod step_test;
mod template;
#[cfg(test)]
mod tests;
mod trend;
mod value;

pub use answer::{AnswerTexts, Headline, doing, overview, so, texts_of, why};
pub use facts::AnswerFacts;
pub use number::{clock, count, duration, number, quantity, sentence};
pub use of_answer::{of_correction, of_crossings, of_finding, of_fitted, of_identification};
pub use of_fit::{of_position, of_pv, of_trend, of_unfit};
pub use reader::Reader;
pub use value::{Message, Numbers, Value};

/// A subject of the catalogue.
struct Subject {
    /// The part of a code before the point.
    name: &'static str,
    /// Sentence by name and, where it has several wordings, variant: `name` or `name variant`.
    sentences: &'static [(&'static str, &'static str)],
    /// The variants that the numbers ask for, the first that has a sentence is taken; after them the plain one.
    variants: fn(&str, &dyn Numbers) -> Vec<String>,
}

const SUBJECTS: &[Subject] = &[
    answer::SUBJECT,
    correction::SUBJECT,
    crossings::SUBJECT,
    fit::SUBJECT,
    fit::LEFT_OUT,
    fit::UNFIT,
    fleet::HELP,
    fleet::HINDRANCE,
    fleet::SUBJECT,
    half_period::LABEL,
    half_period::MEANING,
    half_period::REMEDY,
    identification::SUBJECT,
    labels::EVIDENCE,
    labels::URGENCY,
    labels::VALVE,
    labels::TERM,
    labels::VERDICT,
    labels::MEANING,
    position::SUBJECT,
    quality::SUBJECT,
    settings::SUBJECT,
    step_test::SUBJECT,
    trend::SUBJECT,
];

/// The variants of a subject whose messages have one wording each: none.
fn plain(_: &str, _: &dyn Numbers) -> Vec<String> {
    Vec::new()
}

/// A message that has no text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// The code is unknown.
    #[error("there is no message '{0}'")]
    Code(String),
    /// The sentence needs a number that is not given.
    #[error("message '{code}' has no '{name}'")]
    Number {
        /// Code of the message.
        code: String,
        /// Name of the number.
        name: String,
    },
    /// A number is not of the kind that the sentence writes.
    #[error("message '{code}': '{name}' cannot be written as '{format}'")]
    Format {
        /// Code of the message.
        code: String,
        /// Name of the number.
        name: String,
        /// Format that was asked for.
        format: String,
    },
}

/// A message as a person reads it.
///
/// ```
/// use glapp_analysis::words::{Message, Reader, text};
/// let reader = Reader { op_unit: "%".into(), ..Reader::default() };
/// let resting = Message::new("quality.op_constant").with("op", 20.0);
/// let told = text(&resting.code, &resting.numbers, &reader).unwrap();
/// assert!(told.starts_with("OP stays at 20 % over the whole recording"));
/// assert!(text("quality.op_constant", &Message::new("").numbers, &reader).is_err());
/// ```
///
/// # Errors
/// Where there is no such message, or one of its numbers is missing or of another kind.
pub fn text(code: &str, numbers: &dyn Numbers, reader: &Reader) -> Result<String, TextError> {
    template::filled(code, sentence_of(code, numbers).ok_or_else(|| TextError::Code(code.into()))?, numbers, reader)
}

/// The sentence of a code, in the wording that the numbers ask for.
fn sentence_of(code: &str, numbers: &dyn Numbers) -> Option<&'static str> {
    let (subject, name) = code.split_once('.')?;
    let subject = SUBJECTS.iter().find(|one| one.name == subject)?;
    let known = |wanted: &str| subject.sentences.iter().find(|(name, _)| *name == wanted).map(|(_, text)| *text);
    let variants = (subject.variants)(name, numbers);
    variants.iter().find_map(|variant| known(&format!("{name} {variant}"))).or_else(|| known(name))
}

/// All codes with their templates, a variant behind a space; for lists and tests.
pub fn catalogue() -> impl Iterator<Item = (String, &'static str)> {
    SUBJECTS
        .iter()
        .flat_map(|subject| subject.sentences.iter().map(|(name, text)| (format!("{}.{name}", subject.name), *text)))
}
