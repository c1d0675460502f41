//! Step test in manual: dead band and process gain off steps of OP.

use crate::plain::plain;
use crate::windows::Batch;
use glapp_analysis::{Manual, StepTestSettings};
use numpy::PyArray1;
use pyo3::prelude::*;

/// The rows in manual of a recording, and the step test in them. `manual`: True where all rows were made in manual, False where
/// the flags say which, None where nothing does.
#[pyclass(module = "glapp")]
pub struct ManualRows {
    rows: glapp_analysis::ManualRows,
}

#[pymethods]
impl ManualRows {
    #[new]
    fn new(manual: Option<bool>) -> Self {
        let manual = match manual {
            Some(true) => Manual::All,
            Some(false) => Manual::Flagged,
            None => Manual::Unknown,
        };
        Self { rows: glapp_analysis::ManualRows::new(manual) }
    }

    /// Takes the next rows of the recording.
    fn add(&mut self, py: Python<'_>, batch: Batch<'_>) -> PyResult<()> {
        let (rows, position) = batch.rows()?;
        py.detach(|| self.rows.take(&rows, position));
        Ok(())
    }

    /// The rows in manual as one `glapp.recording.Batch`; None where there are none.
    fn kept<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let kept = self.rows.kept();
        if kept.t.is_empty() {
            return Ok(None);
        }
        let batch = py.import("glapp.recording")?.getattr("Batch")?;
        let array = |values: &[f64]| PyArray1::from_slice(py, values);
        let position = kept.position.iter().any(|x| x.is_finite()).then(|| array(&kept.position));
        let none = py.None();
        batch.call1((array(&kept.t), &none, array(&kept.pv), array(&kept.op), &none, position)).map(Some)
    }

    /// Reads the step test: numbers and codes, without sentences.
    fn read<'py>(
        &self,
        py: Python<'py>,
        integrating: bool,
        op_span: Option<f64>,
        positioner_dead_band: Option<f64>,
        width: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let settings = StepTestSettings { integrating, op_span, positioner_dead_band, width };
        plain(py, &py.detach(|| self.rows.read(&settings)))
    }
}
