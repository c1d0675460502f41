//! Rows of a recording as the analysis and the fit take them, and the windows of a long history.

use glapp_analysis::Inspected;
use glapp_fit::{Rows, Samples};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A `glapp.recording.Batch`; the arrays are not copied.
#[derive(FromPyObject)]
pub struct Batch<'py> {
    t: PyReadonlyArray1<'py, f64>,
    sp: Option<PyReadonlyArray1<'py, f64>>,
    pv: PyReadonlyArray1<'py, f64>,
    op: Option<PyReadonlyArray1<'py, f64>>,
    flags: Option<PyReadonlyArray1<'py, u8>>,
    position: Option<PyReadonlyArray1<'py, f64>>,
    marks: Option<PyReadonlyArray1<'py, u8>>,
}

/// The columns of batches, once they are seen to be contiguous and of one length.
pub(crate) fn columns<'a>(batches: &'a [Batch<'_>]) -> PyResult<Vec<glapp_fit::Batch<'a>>> {
    batches.iter().map(Batch::columns).collect()
}

impl Batch<'_> {
    fn columns(&self) -> PyResult<glapp_fit::Batch<'_>> {
        let (Inspected { t, sp, pv, op, flags }, position) = self.rows()?;
        Ok(glapp_fit::Batch { samples: Samples { t, sp, pv, op, flags }, position })
    }

    /// The columns, and the valve's position where it is recorded.
    pub(crate) fn rows(&self) -> PyResult<(Inspected<'_>, Option<&[f64]>)> {
        let rows = Inspected {
            t: self.t.as_slice()?,
            sp: self.sp.as_ref().map(|sp| sp.as_slice()).transpose()?,
            pv: self.pv.as_slice()?,
            op: self.op.as_ref().map(|op| op.as_slice()).transpose()?,
            flags: self.flags.as_ref().map(|flags| flags.as_slice()).transpose()?,
        };
        let position = self.position.as_ref().map(|position| position.as_slice()).transpose()?;
        let lengths = [Some(rows.pv), rows.sp, rows.op, position].map(|x| x.map(<[f64]>::len));
        let flags = rows.flags.map(<[u8]>::len);
        if lengths.into_iter().chain([flags]).flatten().any(|length| length != rows.t.len()) {
            return Err(PyValueError::new_err("t, sp, pv, op, flags and position must be of the same length"));
        }
        Ok((rows, position))
    }

    /// The sum of each row's marks, once they are seen to be as many as the rows.
    pub(crate) fn marks(&self) -> PyResult<Option<&[u8]>> {
        let marks = self.marks.as_ref().map(|marks| marks.as_slice()).transpose()?;
        if marks.is_some_and(|marks| marks.len() != self.t.len().unwrap_or_default()) {
            return Err(PyValueError::new_err("t and marks must be of the same length"));
        }
        Ok(marks)
    }
}

/// Cuts a history into windows of `length` rows and keeps the best one of each epoch, in bounded memory; `hole` is the time
/// between two rows [s] after which a new window begins.
///
/// An epoch is a number of windows in a row, one at first; before there would be more than twelve, neighbours are merged. So
/// the windows kept are spread over the whole length, whatever it is. The best is that in which OP turns most, times the
/// share of its rows that can be used: OP and PV are numbers, of good quality and not at a limit. In which mode the
/// controller was does not matter, since any move of OP tells.
#[pyclass(module = "glapp")]
pub struct Windows {
    windows: glapp_fit::Windows,
}

#[pymethods]
impl Windows {
    #[new]
    fn new(length: usize, hole: f64) -> PyResult<Self> {
        if length == 0 {
            return Err(PyValueError::new_err("length is 0, must be > 0"));
        }
        if hole.is_nan() || hole <= 0.0 {
            return Err(PyValueError::new_err(format!("hole is {hole}, must be > 0")));
        }
        Ok(Self { windows: glapp_fit::Windows::new(length, hole) })
    }

    /// Windows for a history that begins so, as long as one of a shorter recording would be; where nothing of the beginning can be
    /// fitted, a twelfth of it. `sign` is that of the process gain, 0 where it is not known.
    #[staticmethod]
    fn of_history(py: Python<'_>, beginning: Batch<'_>, sign: f64) -> PyResult<Self> {
        let batch = beginning.columns()?;
        Ok(Self { windows: py.detach(|| glapp_fit::Windows::of_history(&batch.samples, sign)) })
    }

    /// Takes the next rows of the history.
    fn add(&mut self, py: Python<'_>, batch: Batch<'_>) -> PyResult<()> {
        let batch = batch.columns()?;
        py.detach(|| self.windows.add(&batch));
        Ok(())
    }

    /// The best window of each epoch, in the order of time; those in which OP rests are left out. The window under way ends here.
    fn best<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let batch = py.import("glapp.recording")?.getattr("Batch")?;
        let array = |values: &Vec<f64>| PyArray1::from_slice(py, values);
        let of = |rows: &Rows| {
            let flags = rows.flags.as_ref().map(|flags| PyArray1::from_slice(py, flags));
            let [sp, op, position] = [&rows.sp, &rows.op, &rows.position].map(|column| column.as_ref().map(array));
            batch.call1((array(&rows.t), sp, array(&rows.pv), op, flags, position))
        };
        self.windows.best().map(of).collect()
    }

    /// Times of the first and the last row of these windows [s], and what each may tell: OP's travel in a coarse look times
    /// the share of rows that can be used [OP unit].
    fn scores(&mut self) -> Vec<(f64, f64, f64)> {
        let of = |(score, rows): &(f64, Rows)| (rows.t[0], rows.t[rows.t.len() - 1], *score);
        self.windows.scored().map(of).collect()
    }
}
