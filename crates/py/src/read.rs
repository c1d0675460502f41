//! Plain CSV, a block at a time.

use glapp_read::{Column, Kind, Layout};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;

/// How the lines of a plain CSV file are made; `kinds` of all the columns: "number", "time", "time utc", "word", or None
/// for one that is not wanted.
#[pyclass(frozen, module = "glapp", name = "PlainCsv")]
pub struct PyPlainCsv {
    layout: Layout,
}

#[pymethods]
impl PyPlainCsv {
    #[new]
    fn new(separator: u8, kinds: Vec<Option<String>>) -> PyResult<Self> {
        let kind = |name: String| match name.as_str() {
            "number" => Ok(Kind::Number),
            "time" => Ok(Kind::Time),
            "time utc" => Ok(Kind::TimeUtc),
            "word" => Ok(Kind::Word),
            other => Err(PyValueError::new_err(format!("{other}: no such kind of column"))),
        };
        let kinds = kinds.into_iter().map(|name| name.map(kind).transpose()).collect::<PyResult<_>>()?;
        Ok(Self { layout: Layout::new(separator, kinds) })
    }

    /// The wanted columns of a block of complete lines without its first `skip` lines, in the order of the file: an array
    /// of numbers or of nanoseconds, or (words, place of each row's word). None where the block is not plain.
    fn parse<'py>(&self, py: Python<'py>, block: &[u8], skip: usize) -> PyResult<Option<Bound<'py, PyList>>> {
        let Some(columns) = py.detach(|| self.layout.parse(block, skip)) else { return Ok(None) };
        let list = PyList::empty(py);
        for column in columns {
            match column {
                Column::Numbers(numbers) => list.append(PyArray1::from_vec(py, numbers))?,
                Column::Times(times) => list.append(PyArray1::from_vec(py, times))?,
                Column::Words(words, codes) => list.append((words, PyArray1::from_vec(py, codes)))?,
            }
        }
        Ok(Some(list))
    }
}
