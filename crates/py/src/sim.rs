//! Closed loops (`crates/sim`).

use glapp_core::Detector;
use glapp_sim::{BATCH, Block, Controller, Friction, Manual, Model, Outer, Piece, Plant, Scenario, Signal, SimError};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::detector::{Settings, detector};

/// A piece of a signal as Python has it: a dict of its kind and its numbers.
#[derive(FromPyObject)]
pub enum PyPiece<'py> {
    Steps {
        #[pyo3(item)]
        steps: Vec<(f64, f64)>,
    },
    Samples {
        #[pyo3(item)]
        samples: PyReadonlyArray1<'py, f64>,
    },
    Ramp {
        #[pyo3(item)]
        ramp: (f64, f64, f64),
    },
    Sine {
        #[pyo3(item)]
        sine: (f64, f64, f64),
    },
    Walk {
        #[pyo3(item)]
        walk: f64,
    },
    Uniform {
        #[pyo3(item)]
        uniform: f64,
    },
    Gaussian {
        #[pyo3(item)]
        gaussian: f64,
    },
    Coloured {
        #[pyo3(item)]
        coloured: (f64, f64),
    },
}

impl From<PyPiece<'_>> for Piece {
    fn from(piece: PyPiece<'_>) -> Self {
        match piece {
            PyPiece::Steps { steps } => Self::Steps(steps),
            PyPiece::Samples { samples } => Self::Samples(samples.as_array().iter().copied().collect()),
            PyPiece::Ramp { ramp: (t, by, over) } => Self::Ramp { t, by, over },
            PyPiece::Sine { sine: (amplitude, period, t) } => Self::Sine { amplitude, period, t },
            PyPiece::Walk { walk } => Self::Walk { rate: walk },
            PyPiece::Uniform { uniform } => Self::Uniform { amplitude: uniform },
            PyPiece::Gaussian { gaussian } => Self::Gaussian { sigma: gaussian },
            PyPiece::Coloured { coloured: (sigma, tau) } => Self::Coloured { sigma, tau },
        }
    }
}

/// A scenario as Python has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyScenario<'py> {
    plant: (Vec<f64>, Vec<f64>, f64),
    controller: PyController,
    d: f64,
    friction: Option<(String, f64, f64)>,
    rate: Option<f64>,
    noise: Vec<PyPiece<'py>>,
    pv_resolution: f64,
    op_resolution: f64,
    setpoint: Vec<PyPiece<'py>>,
    load: Vec<PyPiece<'py>>,
    manual: Vec<(f64, f64, Option<f64>)>,
    outer: Option<PyOuter<'py>>,
    jitter: f64,
    lost: f64,
    h: f64,
    t_end: f64,
    seed: u64,
}

/// (k, ti, td, b, tf, limits).
type PyController = (f64, f64, f64, f64, f64, Option<(f64, f64)>);

/// The outer loop of a cascade as Python has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct PyOuter<'py> {
    plant: (Vec<f64>, Vec<f64>, f64),
    controller: PyController,
    d: f64,
    noise: Vec<PyPiece<'py>>,
    load: Vec<PyPiece<'py>>,
}

fn plant((num, den, dead_time): (Vec<f64>, Vec<f64>, f64)) -> Result<Plant, SimError> {
    Plant::new(num, den, dead_time)
}

fn controller((k, ti, td, b, tf, limits): PyController) -> Controller {
    Controller { k, ti, td, b, tf, limits }
}

fn signal(pieces: Vec<PyPiece<'_>>) -> Signal {
    pieces.into_iter().map(Piece::from).collect()
}

impl TryFrom<PyScenario<'_>> for Scenario {
    type Error = SimError;

    fn try_from(s: PyScenario<'_>) -> Result<Self, SimError> {
        let friction = |(model, s, j): (String, f64, f64)| {
            Friction::new(if model == "he" { Model::He } else { Model::Kano }, s, j)
        };
        let outer = |outer: PyOuter<'_>| -> Result<Outer, SimError> {
            Ok(Outer {
                plant: plant(outer.plant)?,
                controller: controller(outer.controller),
                d: outer.d,
                noise: signal(outer.noise),
                load: signal(outer.load),
            })
        };
        let scenario = Self {
            plant: plant(s.plant)?,
            controller: controller(s.controller),
            d: s.d,
            friction: s.friction.map(friction).transpose()?,
            rate: s.rate,
            noise: signal(s.noise),
            pv_resolution: s.pv_resolution,
            op_resolution: s.op_resolution,
            setpoint: signal(s.setpoint),
            load: signal(s.load),
            manual: s.manual.into_iter().map(|(from, to, op)| Manual { from, to, op }).collect(),
            outer: s.outer.map(outer).transpose()?,
            jitter: s.jitter,
            lost: s.lost,
            h: s.h,
            t_end: s.t_end,
            seed: s.seed,
        };
        scenario.check()?;
        Ok(scenario)
    }
}

fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The test batch (thesis 4.1): (name, num, den, dead time).
#[pyfunction]
pub fn batch() -> Vec<(&'static str, Vec<f64>, Vec<f64>, f64)> {
    BATCH.iter().map(|(name, num, den, dead_time)| (*name, num.to_vec(), den.to_vec(), *dead_time)).collect()
}

/// A scenario, checked.
#[pyclass(frozen, module = "glapp._glapp", name = "Scenario")]
pub struct PyChecked {
    scenario: Scenario,
    detector: Option<Detector<f64>>,
}

#[pymethods]
impl PyChecked {
    /// `watch`: settings of the detector, where the loop is to be watched.
    #[new]
    #[pyo3(signature = (scenario, watch=None))]
    fn new(scenario: PyScenario<'_>, watch: Option<Settings>) -> PyResult<Self> {
        let detector = watch.map(|settings| detector(&settings)).transpose().map_err(value_error)?;
        Ok(Self { scenario: scenario.try_into().map_err(value_error)?, detector })
    }

    /// Samples, recorded or lost.
    #[getter]
    fn samples(&self) -> PyResult<usize> {
        self.scenario.samples().map_err(value_error)
    }

    /// Writes the signals into the rows of `signals` (t, sp, pv, op, position, load, and in a cascade outer_sp and
    /// outer_pv) and into `flags`; gives how many samples are recorded.
    fn run(
        &self,
        py: Python<'_>,
        mut signals: PyReadwriteArray2<'_, f64>,
        mut flags: PyReadwriteArray1<'_, u8>,
    ) -> PyResult<usize> {
        let (signals, flags) = (signals.as_slice_mut()?, flags.as_slice_mut()?);
        let n = self.samples()?;
        let mut rows = signals.chunks_exact_mut(n);
        let mut row = || rows.next().unwrap_or_default();
        let mut block = Block {
            t: row(),
            sp: row(),
            pv: row(),
            op: row(),
            position: row(),
            load: row(),
            outer_sp: row(),
            outer_pv: row(),
            flags,
        };
        py.detach(|| self.scenario.run_into(&mut block)).map_err(value_error)
    }
}

/// What was seen of a watched scenario: d_hat, lowest, highest (NaN: none), detections, half-periods, or the error.
type PySeen = (f64, f64, f64, u32, u32, Option<String>);

/// Runs watched scenarios and keeps only what the detector saw.
#[pyfunction]
pub fn watch(py: Python<'_>, scenarios: Vec<Py<PyChecked>>) -> Vec<PySeen> {
    let scenarios: Vec<&PyChecked> = scenarios.iter().map(Py::get).collect();
    py.detach(|| {
        let seen = |one: &&PyChecked| {
            let none = (f64::NAN, f64::NAN, f64::NAN, 0, 0);
            let Some(detector) = &one.detector else { return (none.0, none.1, none.2, none.3, none.4, None) };
            match one.scenario.watch(detector) {
                Ok(seen) => {
                    let (value, low, high) =
                        seen.estimate.map_or((none.0, none.1, none.2), |e| (e.value, e.low, e.high));
                    (value, low, high, seen.detections, seen.half_periods, None)
                }
                Err(error) => (none.0, none.1, none.2, none.3, none.4, Some(error.to_string())),
            }
        };
        scenarios.iter().map(seen).collect()
    })
}

/// Indices of the scenarios that are best run together.
#[pyfunction]
pub fn groups(scenarios: Vec<Py<PyChecked>>) -> Vec<Vec<usize>> {
    (0..scenarios.len()).map(|i| vec![i]).collect()
}

/// Random walk of n samples from 0.
#[pyfunction]
#[pyo3(signature = (n, h, rate, seed))]
pub fn random_walk(py: Python<'_>, n: usize, h: f64, rate: f64, seed: u64) -> PyResult<Bound<'_, PyArray1<f64>>> {
    Ok(py.detach(|| glapp_sim::random_walk(n, h, rate, seed)).map_err(value_error)?.into_pyarray(py))
}
