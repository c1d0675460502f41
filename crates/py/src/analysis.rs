//! The analysis of a recording: a task and its rows in, the answer out.

use crate::detector::columns;
use crate::fit::{of_position, of_pv, telling};
use crate::plain::plain;
use crate::refused;
use crate::windows::Batch;
use glapp_analysis::{Analysis, Done, HarmCells, Process, Summary, harm};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The analysis of a recording: made of a task (JSON) and the recording's beginning, handed all batches, then finished.
#[pyclass(module = "glapp", name = "Analysis")]
pub struct PyAnalysis {
    under_way: Option<Analysis>,
}

#[pymethods]
impl PyAnalysis {
    #[new]
    fn new(py: Python<'_>, task: &str, beginning: Batch<'_>) -> PyResult<Self> {
        let task = serde_json::from_str(task).map_err(|error| PyValueError::new_err(error.to_string()))?;
        let (rows, position) = beginning.rows()?;
        let analysis = py.detach(|| Analysis::new(task, &rows, position)).map_err(refused)?;
        Ok(Self { under_way: Some(analysis) })
    }

    /// Takes the next rows; gives the filtered PV of each filter time that is tried.
    fn take<'py>(&mut self, py: Python<'py>, batch: Batch<'py>) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let analysis = self.under_way.as_mut().ok_or_else(finished)?;
        let (rows, position) = batch.rows()?;
        let marks = batch.marks()?;
        let filtered = py.detach(|| analysis.take_marked(&rows, position, marks));
        Ok(filtered.into_iter().map(|column| PyArray1::from_vec(py, column)).collect())
    }

    /// The `answer` in plain types; the place of the filter time that was `chosen` and its `table` of half-periods, None where
    /// there is none; what was fitted, `pv` and `position`, in whole. `progress` is told the share of what is left.
    fn finish<'py>(&mut self, py: Python<'py>, progress: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyDict>> {
        let analysis = self.under_way.take().ok_or_else(finished)?;
        let Done { answer, crossings, fitted, op } = telling(py, progress, |tell| analysis.finish(tell))?;
        let out = PyDict::new(py);
        out.set_item("answer", plain(py, &answer)?)?;
        out.set_item("op", op)?;
        out.set_item("chosen", crossings.as_ref().map(|(place, _)| *place))?;
        out.set_item("table", crossings.map(|(_, crossings)| columns(py, crossings.rows())).transpose()?)?;
        let (pv, position) = fitted.map_or((None, None), |fitted| (fitted.pv, fitted.position));
        out.set_item("pv", pv.map(|pv| of_pv(py, pv)).transpose()?)?;
        out.set_item("position", position.map(|position| of_position(py, position)).transpose()?)?;
        Ok(out)
    }
}

/// The one answer of all that is known of a valve: facts as JSON in, plain types out.
#[pyfunction]
pub fn summary<'py>(py: Python<'py>, facts: &str) -> PyResult<Bound<'py, PyAny>> {
    let facts = serde_json::from_str(facts).map_err(|error| PyValueError::new_err(error.to_string()))?;
    plain(py, &Summary::of(&facts))
}

/// Harm of the gap that was fitted to cells (time [s], PV, position of the valve) of a batch of rows, under a controller with `law`
/// (K, Ti), through a process with Kp, dead time and lag: shares of PV's variance and of OP's travel.
#[pyfunction]
#[pyo3(name = "harm")]
pub fn harm_of<'py>(
    py: Python<'py>,
    cells: (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    batch: Batch<'py>,
    law: Option<(f64, f64)>,
    process: ((f64, f64, f64), bool),
) -> PyResult<Bound<'py, PyAny>> {
    let (t, pv, position) = (cells.0.as_slice()?, cells.1.as_slice()?, cells.2.as_slice()?);
    if t.len() != pv.len() || t.len() != position.len() {
        return Err(PyValueError::new_err("t, pv and position of the cells must be of the same length"));
    }
    let ((kp, dead_time, lag), integrating) = process;
    let alone = |value| (value, value, value);
    let process = Process { kp: alone(kp), dead_time: alone(dead_time), lag: alone(lag), integrating };
    let (rows, _) = batch.rows()?;
    plain(py, &harm(&HarmCells { t, pv, position }, &rows, law, &process))
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("the analysis is finished: begin another")
}
