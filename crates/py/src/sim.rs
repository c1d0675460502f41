//! Closed loops (`crates/sim`).

use crate::refused;
use glapp_core::{Detector, Friction, Model};
use glapp_sim::{
    BATCH, Block, Compensated, Controller, Instructions, Manual, Outer, Piece, Plant, Scenario, Signal, SimError, Stem,
    StemModel, Valve, watch_together,
};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::compensation::settings;
use crate::detector::Settings;

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
    valve: Option<PyValve>,
    rate: Option<f64>,
    noise: Vec<PyPiece<'py>>,
    pv_resolution: f64,
    op_resolution: f64,
    setpoint: Vec<PyPiece<'py>>,
    load: Vec<PyPiece<'py>>,
    manual: Vec<(f64, f64, Option<f64>)>,
    bad: Vec<(f64, f64)>,
    compensation: Option<PyCompensated<'py>>,
    outer: Option<PyOuter<'py>>,
    jitter: f64,
    lost: f64,
    h: f64,
    t_end: f64,
    seed: u64,
}

/// (lag, positioner, stem, d, curve).
type PyValve = (f64, f64, Option<PyStem>, f64, f64);

/// (model, fs, fc, stribeck, viscous, w).
type PyStem = (String, f64, f64, f64, f64, f64);

fn valve((lag, positioner, stem, d, curve): PyValve) -> Valve {
    let stem = stem.map(|(model, fs, fc, stribeck, viscous, w)| {
        let model = if model == "lugre" { StemModel::LuGre } else { StemModel::Karnopp };
        Stem { model, fs, fc, stribeck, viscous, w }
    });
    Valve { lag, positioner, stem, d, curve }
}

/// Positions of a valve's plug under each of the outputs, `h` seconds apart.
#[pyfunction]
#[pyo3(name = "valve_positions")]
pub fn valve_positions<'py>(
    py: Python<'py>,
    given: PyValve,
    op: PyReadonlyArray1<'py, f64>,
    h: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let op: Vec<f64> = op.as_array().iter().copied().collect();
    let positions = py.detach(|| valve(given).positions(&op, h)).map_err(refused)?;
    Ok(positions.into_pyarray(py))
}

/// (k, ti, td, b, tf, limits).
type PyController = (f64, f64, f64, f64, f64, Option<(f64, f64)>);

/// Compensation as Python has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct PyCompensated<'py> {
    settings: Bound<'py, PyAny>,
    tf: f64,
    begin: f64,
    delay: Option<u32>,
    longest: Option<f64>,
}

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

fn compensated(given: PyCompensated<'_>) -> PyResult<Compensated> {
    let PyCompensated { tf, begin, delay, longest, .. } = given;
    Ok(Compensated { settings: settings(&given.settings)?, tf, begin, delay, longest })
}

impl TryFrom<PyScenario<'_>> for Scenario {
    type Error = PyErr;

    fn try_from(s: PyScenario<'_>) -> PyResult<Self> {
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
            plant: plant(s.plant).map_err(refused)?,
            controller: controller(s.controller),
            d: s.d,
            friction: s.friction.map(friction).transpose().map_err(refused)?,
            valve: s.valve.map(valve),
            rate: s.rate,
            noise: signal(s.noise),
            pv_resolution: s.pv_resolution,
            op_resolution: s.op_resolution,
            setpoint: signal(s.setpoint),
            load: signal(s.load),
            manual: s.manual.into_iter().map(|(from, to, op)| Manual { from, to, op }).collect(),
            bad: s.bad,
            compensation: s.compensation.map(compensated).transpose()?,
            outer: s.outer.map(outer).transpose().map_err(refused)?,
            jitter: s.jitter,
            lost: s.lost,
            h: s.h,
            t_end: s.t_end,
            seed: s.seed,
        };
        scenario.check().map_err(refused)?;
        Ok(scenario)
    }
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
        let detector = watch.map(|settings| Detector::of(&settings.0)).transpose().map_err(refused)?;
        Ok(Self { scenario: scenario.try_into()?, detector })
    }

    /// Samples, recorded or lost.
    #[getter]
    fn samples(&self) -> PyResult<usize> {
        self.scenario.samples().map_err(refused)
    }
}

/// Result of a watched scenario: d_hat, lowest, highest (NaN: none), detections, half-periods, or the error.
type PySeen = (f64, f64, f64, u32, u32, Option<String>);

/// Runs watched scenarios and keeps only the detector's results. `instructions` is one of those of `instruction_sets`,
/// the widest where it is not given.
#[pyfunction]
#[pyo3(signature = (scenarios, instructions=None))]
pub fn watch(py: Python<'_>, scenarios: Vec<Py<PyChecked>>, instructions: Option<&str>) -> PyResult<Vec<PySeen>> {
    let instructions = chosen(instructions)?;
    let watched = |one: &'static str| PyValueError::new_err(one);
    let pairs = scenarios.iter().map(|one| {
        let one = one.get();
        Ok((&one.scenario, one.detector.as_ref().ok_or_else(|| watched("a scenario that is not watched"))?))
    });
    let pairs = pairs.collect::<PyResult<Vec<_>>>()?;
    let seen = py.detach(|| watch_together(&pairs, instructions));
    Ok(seen
        .into_iter()
        .map(|seen| match seen {
            Err(error) => (f64::NAN, f64::NAN, f64::NAN, 0, 0, Some(error.to_string())),
            Ok(seen) => {
                let (value, low, high) =
                    seen.estimate.map_or((f64::NAN, f64::NAN, f64::NAN), |e| (e.value, e.low, e.high));
                (value, low, high, seen.detections, seen.half_periods, None)
            }
        })
        .collect())
}

pub(crate) fn chosen(name: Option<&str>) -> PyResult<Instructions> {
    let available = Instructions::available();
    let found = available.iter().rev().find(|set| name.is_none_or(|name| set.name() == name));
    found.copied().ok_or_else(|| PyValueError::new_err("not an instruction set of this processor"))
}

/// Names of the instruction sets of this processor, the widest last.
#[pyfunction]
pub fn instruction_sets() -> Vec<&'static str> {
    Instructions::available().iter().map(Instructions::name).collect()
}

/// Runs scenarios into their arrays, as `Scenario.run` does each; gives how many samples are recorded, or the error.
#[pyfunction]
#[pyo3(signature = (scenarios, signals, flags, instructions=None))]
pub fn run_together(
    py: Python<'_>,
    scenarios: Vec<Py<PyChecked>>,
    mut signals: Vec<PyReadwriteArray2<'_, f64>>,
    mut flags: Vec<PyReadwriteArray1<'_, u8>>,
    instructions: Option<&str>,
) -> PyResult<Vec<(usize, Option<String>)>> {
    let instructions = chosen(instructions)?;
    let alone: Vec<&Scenario> = scenarios.iter().map(|one| &one.get().scenario).collect();
    let blocks = alone.iter().zip(&mut signals).zip(&mut flags);
    let blocks = blocks.map(|((s, signals), flags)| {
        Ok(block(s, s.samples().map_err(refused)?, signals.as_slice_mut()?, flags.as_slice_mut()?))
    });
    let mut blocks = blocks.collect::<PyResult<Vec<_>>>()?;
    let recorded = py.detach(|| glapp_sim::run_together(&alone, &mut blocks, instructions));
    let to_python = |recorded: Result<usize, SimError>| match recorded {
        Ok(n) => (n, None),
        Err(error) => (0, Some(error.to_string())),
    };
    Ok(recorded.into_iter().map(to_python).collect())
}

/// The rows of an array as the columns that a scenario has.
fn block<'a>(s: &Scenario, n: usize, signals: &'a mut [f64], flags: &'a mut [u8]) -> Block<'a> {
    let mut rows = signals.chunks_exact_mut(n);
    let mut row = |there: bool| if there { rows.next().unwrap_or_default() } else { &mut [] };
    let (outer, compensated) = (s.outer.is_some(), s.compensation.is_some());
    Block {
        t: row(true),
        sp: row(true),
        pv: row(true),
        op: row(true),
        position: row(true),
        load: row(true),
        outer_sp: row(outer),
        outer_pv: row(outer),
        u_ff: row(compensated),
        standing: row(compensated),
        over: row(compensated),
        error: row(compensated),
        flags,
    }
}

/// Indices of the scenarios that are best run together.
#[pyfunction]
pub fn groups(scenarios: Vec<Py<PyChecked>>) -> Vec<Vec<usize>> {
    let scenarios: Vec<&Scenario> = scenarios.iter().map(|one| &one.get().scenario).collect();
    glapp_sim::groups(&scenarios)
}

/// Random walk of n samples from 0.
#[pyfunction]
#[pyo3(signature = (n, h, rate, seed))]
pub fn random_walk(py: Python<'_>, n: usize, h: f64, rate: f64, seed: u64) -> PyResult<Bound<'_, PyArray1<f64>>> {
    Ok(py.detach(|| glapp_sim::random_walk(n, h, rate, seed)).map_err(refused)?.into_pyarray(py))
}
