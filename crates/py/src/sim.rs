//! Closed loops (`crates/sim`).

use glapp_sim::{BATCH, ClosedLoop, Columns, Manual, Plant, Signal, SimError};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A setpoint or load as Python has it: a value a sample, or (time, value) steps.
#[derive(FromPyObject)]
pub enum PySignal<'py> {
    Samples(PyReadonlyArray1<'py, f64>),
    Steps(Vec<(f64, f64)>),
}

impl From<PySignal<'_>> for Signal {
    fn from(signal: PySignal<'_>) -> Self {
        match signal {
            PySignal::Samples(column) => Self::Samples(column.as_array().to_vec()),
            PySignal::Steps(steps) => Self::Steps(steps),
        }
    }
}

type Arrays<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u8>>,
);

fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The test batch (thesis 4.1): (name, num, den, dead time).
#[pyfunction]
pub fn batch() -> Vec<(&'static str, Vec<f64>, Vec<f64>, f64)> {
    BATCH.iter().map(|(name, num, den, dead_time)| (*name, num.to_vec(), den.to_vec(), *dead_time)).collect()
}

/// t, sp, pv, op, position, load and flags of a simulated loop.
#[pyfunction]
#[pyo3(signature = (*, plant, k, ti, td, b, tf, limits, d, noise, h, t_end, setpoint, load, manual, seed))]
#[allow(clippy::too_many_arguments)]
pub fn closed_loop<'py>(
    py: Python<'py>,
    plant: (Vec<f64>, Vec<f64>, f64),
    k: f64,
    ti: f64,
    td: f64,
    b: f64,
    tf: f64,
    limits: Option<(f64, f64)>,
    d: f64,
    noise: f64,
    h: f64,
    t_end: f64,
    setpoint: PySignal<'py>,
    load: PySignal<'py>,
    manual: Vec<(f64, f64, Option<f64>)>,
    seed: u64,
) -> PyResult<Arrays<'py>> {
    let (setpoint, load) = (setpoint.into(), load.into());
    let manual = manual.into_iter().map(|(from, to, op)| Manual { from, to, op }).collect();
    let run = || -> Result<Columns, SimError> {
        let plant = Plant::new(plant.0, plant.1, plant.2)?;
        ClosedLoop { plant, k, ti, td, b, tf, limits, d, noise, h, t_end, setpoint, load, manual, seed }.run()
    };
    let Columns { t, sp, pv, op, position, load, flags } = py.detach(run).map_err(value_error)?;
    Ok((
        t.into_pyarray(py),
        sp.into_pyarray(py),
        pv.into_pyarray(py),
        op.into_pyarray(py),
        position.into_pyarray(py),
        load.into_pyarray(py),
        flags.into_pyarray(py),
    ))
}

/// Random walk of n samples from 0.
#[pyfunction]
#[pyo3(signature = (n, h, rate, seed))]
pub fn random_walk(py: Python<'_>, n: usize, h: f64, rate: f64, seed: u64) -> PyResult<Bound<'_, PyArray1<f64>>> {
    Ok(py.detach(|| glapp_sim::random_walk(n, h, rate, seed)).map_err(value_error)?.into_pyarray(py))
}
