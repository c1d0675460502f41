//! Crossings over a history that comes in pieces.

use crate::columns::columns_of;
use crate::detector::Settings;
use crate::plain::plain;
use crate::refused;
use glapp_analysis::crossings;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

/// The detectors of a ladder over a history that comes in pieces, in bounded memory.
#[pyclass(module = "glapp")]
pub struct History {
    history: crossings::History,
}

#[pymethods]
impl History {
    /// A history with the filter time of the settings where it is `given`, else with all that are tried.
    #[new]
    fn new(settings: Settings, given: bool) -> PyResult<Self> {
        Ok(Self { history: crossings::History::new(settings.0, given).map_err(refused)? })
    }

    /// Takes the next samples.
    fn take<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<()> {
        let columns = columns_of(&t, &sp, &pv, op.as_ref(), flags.as_ref())?;
        py.detach(|| self.history.take(columns));
        Ok(())
    }

    /// State so far, in plain types.
    fn heard<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.history.heard())
    }

    /// Settings and state as JSON.
    fn save(&self) -> String {
        self.history.save()
    }

    /// The history that `save` saved.
    #[staticmethod]
    fn load(text: &str) -> PyResult<Self> {
        Ok(Self { history: crossings::History::load(text).map_err(refused)? })
    }
}
