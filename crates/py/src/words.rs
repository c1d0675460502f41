//! Texts for a person: messages, numbers and answers. The words stand in `crates/analysis/src/words`.

use crate::plain::plain;
use glapp_analysis::words::{self, AnswerFacts, Headline, Numbers, Reader, Value};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyList, PyString};

/// Numbers of a message as Python has them; those that its sentence does not name are not looked at.
struct OfDict<'py>(Option<Bound<'py, PyDict>>);

impl Numbers for OfDict<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        value(&self.0.as_ref()?.get_item(name).ok()??)
    }
}

fn value(of: &Bound<'_, PyAny>) -> Option<Value> {
    if of.is_none() {
        Some(Value::None)
    } else if let Ok(flag) = of.cast::<PyBool>() {
        Some(Value::Flag(flag.is_true()))
    } else if of.is_instance_of::<PyString>() {
        of.extract::<String>().ok().map(Value::from)
    } else if let Ok(count) = of.extract::<i64>() {
        Some(Value::Count(count))
    } else if let Ok(x) = of.extract::<f64>() {
        Some(Value::Number(x))
    } else if let Ok(message) = of.cast::<PyDict>() {
        let code = message.get_item("code").ok()??.extract().ok()?;
        let numbers = message.get_item("numbers").ok()?.and_then(|numbers| numbers.cast_into::<PyDict>().ok());
        let pairs = numbers.into_iter().flat_map(|numbers| numbers.iter().collect::<Vec<_>>());
        let numbers = pairs.filter_map(|(name, of)| Some((name.extract().ok()?, value(&of)?))).collect();
        Some(Value::Message(Box::new(words::Message { code, numbers })))
    } else {
        let list = of.cast::<PyList>().ok()?;
        list.iter().map(|one| value(&one)).collect::<Option<Vec<_>>>().map(Value::List)
    }
}

/// Units and calendar of the person who reads; `t0`: local date and time of t = 0 [µs since 1970].
fn reader(name: &str, pv_unit: Option<String>, op_unit: Option<String>, t0: Option<i64>, first_row: i64) -> Reader {
    let usual = Reader::default();
    Reader {
        name: name.into(),
        pv_unit: pv_unit.unwrap_or(usual.pv_unit),
        op_unit: op_unit.unwrap_or(usual.op_unit),
        t0,
        first_row,
    }
}

fn wrong(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The message of this code as a person reads it.
#[pyfunction]
#[pyo3(signature = (code, numbers=None, *, name="", pv_unit=None, op_unit=None, t0=None, first_row=2))]
pub fn to_text(
    code: &str,
    numbers: Option<Bound<'_, PyDict>>,
    name: &str,
    pv_unit: Option<String>,
    op_unit: Option<String>,
    t0: Option<i64>,
    first_row: i64,
) -> PyResult<String> {
    words::text(code, &OfDict(numbers), &reader(name, pv_unit, op_unit, t0, first_row)).map_err(wrong)
}

/// The three parts of an answer, from its document and what its sentences need beside it (JSON).
#[pyfunction]
#[pyo3(signature = (facts, *, name="", pv_unit=None, op_unit=None))]
pub fn texts_of<'py>(
    py: Python<'py>,
    facts: &str,
    name: &str,
    pv_unit: Option<String>,
    op_unit: Option<String>,
) -> PyResult<Bound<'py, PyAny>> {
    let facts: AnswerFacts = serde_json::from_str(facts).map_err(wrong)?;
    let texts = words::texts_of(&facts, &reader(name, pv_unit, op_unit, None, 2)).map_err(wrong)?;
    plain(py, &texts)
}

/// All loops of a run in short; of each its headline (JSON).
#[pyfunction]
pub fn overview(run: &str) -> PyResult<String> {
    let run: Vec<Headline> = serde_json::from_str(run).map_err(wrong)?;
    words::overview(&run, &Reader::default()).map_err(wrong)
}

/// Every code of the catalogue with its template.
#[pyfunction]
pub fn catalogue() -> Vec<(String, &'static str)> {
    words::catalogue().collect()
}

/// A number with so many significant digits; a dash where there is none.
#[pyfunction]
#[pyo3(signature = (value, digits=3))]
pub fn number(value: Option<f64>, digits: usize) -> String {
    words::number(value, digits)
}

/// A number with so many significant digits and its unit, as text.
#[pyfunction]
#[pyo3(signature = (value, unit, digits=3))]
pub fn quantity(value: Option<f64>, unit: &str, digits: usize) -> String {
    words::quantity(value, unit, digits)
}

/// A time span [s] in the two largest units that fit.
#[pyfunction]
pub fn duration(seconds: f64) -> String {
    words::duration(seconds)
}

/// A moment of a recording; `t0` as for `to_text`.
#[pyfunction]
pub fn clock(t0: Option<i64>, seconds: f64) -> String {
    words::clock(t0, seconds)
}

/// A count with its noun.
#[pyfunction]
pub fn count(n: i64, noun: &str) -> String {
    words::count(n, noun)
}

/// A reason as a sentence; none where there is none.
#[pyfunction]
pub fn sentence(text: Option<&str>) -> String {
    words::sentence(text.unwrap_or_default())
}
