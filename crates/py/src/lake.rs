//! Many loops at once: from arrays, and from Parquet files.

use crate::columns::{Signal, columns_of};
use crate::detector::PyDetector;
use crate::sim::chosen;
use glapp_analysis::Crossings;
use glapp_lake::{LakeError, Loop, LoopFiles, Read};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::num::NonZero;
use std::path::PathBuf;

/// t, SP, PV and OP of a loop.
type LakeColumns<'py> = (Signal<'py>, Signal<'py>, Signal<'py>, Option<Signal<'py>>);
/// Files, and the columns of time, SP, PV and OP.
type Asked = (Vec<PathBuf>, (String, String, String, Option<String>));
/// Number of rows read; or the file, its row, and the error.
type LoopOutcome = (u64, Option<(PathBuf, Option<u64>, String)>);

/// Runs many detectors side by side in the lanes of the processor, see `Detector.run`. `instructions` is one of
/// `instruction_sets`, the widest where it is not given.
#[pyfunction]
#[pyo3(signature = (detectors, signals, instructions=None))]
pub fn run_side_by_side(
    py: Python<'_>,
    detectors: Vec<Bound<'_, PyDetector>>,
    signals: Vec<LakeColumns<'_>>,
    instructions: Option<&str>,
) -> PyResult<()> {
    let instructions = chosen(instructions)?;
    if detectors.len() != signals.len() {
        return Err(PyValueError::new_err("signals: one entry a detector is needed"));
    }
    let columns = signals.iter().map(|(t, sp, pv, op)| columns_of(t, sp, pv, op.as_ref(), None));
    let columns = columns.collect::<PyResult<Vec<_>>>()?;
    let mut borrowed =
        detectors.iter().map(|one| one.try_borrow_mut().map_err(PyErr::from)).collect::<PyResult<Vec<_>>>()?;
    let mut crossings: Vec<&mut Crossings> = borrowed.iter_mut().map(|one| &mut one.crossings).collect();
    py.detach(|| Crossings::take_together(&mut crossings, &columns, instructions));
    Ok(())
}

/// Runs many detectors over rows of Parquet files, on so many threads. Seconds of timestamps are counted from `since` on
/// [µs since 1970], else from each loop's first row. A detector whose files cannot be read stays as it was.
#[pyfunction]
#[pyo3(signature = (detectors, places, threads, since=None, instructions=None))]
pub fn run_lake(
    py: Python<'_>,
    detectors: Vec<Bound<'_, PyDetector>>,
    places: Vec<Asked>,
    threads: NonZero<usize>,
    since: Option<i64>,
    instructions: Option<&str>,
) -> PyResult<Vec<LoopOutcome>> {
    let instructions = chosen(instructions)?;
    if detectors.len() != places.len() {
        return Err(PyValueError::new_err("places: one entry a detector is needed"));
    }
    let loops = detectors.iter().zip(places).map(|(detector, (files, (time, sp, pv, op)))| {
        let crossings = detector.try_borrow()?.crossings.clone();
        Ok(Loop { crossings, source: LoopFiles { files, time, since, sp, pv, op } })
    });
    let loops = loops.collect::<PyResult<Vec<_>>>()?;
    let read = py.detach(|| glapp_lake::crossings(loops, threads, instructions));
    let to_python = |(detector, one): (&Bound<'_, PyDetector>, Result<Read, LakeError>)| match one {
        Ok(Read { crossings, rows }) => {
            detector.try_borrow_mut()?.crossings = crossings;
            Ok((rows, None))
        }
        Err(LakeError { file, row, what }) => Ok((0, Some((file, row, what)))),
    };
    detectors.iter().zip(read).map(to_python).collect()
}
