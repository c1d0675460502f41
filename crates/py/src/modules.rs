//! Graphs of control modules (`crates/sim`).

use crate::refused;
use glapp_core::modules::{Gains, PidSettings};
use glapp_sim::{GraphError, Module, Plant};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

/// A module as Python has it.
#[derive(FromPyObject)]
pub struct PyModule {
    #[pyo3(attribute)]
    kind: String,
    #[pyo3(attribute)]
    parameters: Vec<(String, f64)>,
    #[pyo3(attribute)]
    plant: Option<(Vec<f64>, Vec<f64>, f64)>,
    #[pyo3(attribute)]
    schedule: Vec<[f64; 4]>,
}

impl PyModule {
    fn module(self) -> PyResult<Module> {
        let parameters: Vec<(&str, f64)> =
            self.parameters.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        if let Some((num, den, dead_time)) = self.plant {
            let plant = Plant::new(num, den, dead_time).map_err(refused)?;
            return Module::plant(plant, &parameters).map_err(refused);
        }
        let rows = gains(&self.schedule);
        if rows.is_empty() { Module::new(&self.kind, &parameters) } else { Module::scheduled(&parameters, &rows) }
            .map_err(refused)
    }
}

fn gains(rows: &[[f64; 4]]) -> Vec<Gains<f64>> {
    rows.iter().map(|&[at, k, ti, td]| Gains { at, k, ti, td }).collect()
}

/// A loop of modules.
#[pyclass(module = "glapp.modules")]
pub struct Graph {
    graph: glapp_sim::Graph,
}

#[pymethods]
impl Graph {
    #[new]
    fn new(h: f64, modules: Vec<(String, PyModule)>, wires: Vec<String>) -> PyResult<Self> {
        let mut named = Vec::with_capacity(modules.len());
        let names: Vec<String> = modules.iter().map(|(name, _)| name.clone()).collect();
        for (name, (_, module)) in names.iter().zip(modules) {
            named.push((name.as_str(), module.module()?));
        }
        let wires: Vec<&str> = wires.iter().map(String::as_str).collect();
        Ok(Self { graph: glapp_sim::Graph::new(h, named, &wires).map_err(refused)? })
    }

    #[getter]
    fn h(&self) -> f64 {
        self.graph.h()
    }

    #[getter]
    fn scans(&self) -> u64 {
        self.graph.scans()
    }

    fn scan(&mut self, h: f64) {
        self.graph.scan(h);
    }

    fn record<'py>(
        &mut self,
        py: Python<'py>,
        scans: usize,
        inputs: Vec<(String, PyReadonlyArray1<'py, f64>)>,
        recorded: Vec<String>,
    ) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let inputs: Vec<(String, Vec<f64>)> =
            inputs.into_iter().map(|(name, column)| (name, column.as_array().to_vec())).collect();
        let columns = py.detach(|| -> Result<_, GraphError> {
            let inputs: Vec<(&str, &[f64])> =
                inputs.iter().map(|(n, column)| (n.as_str(), column.as_slice())).collect();
            let recorded: Vec<&str> = recorded.iter().map(String::as_str).collect();
            self.graph.record(scans, &inputs, &recorded)
        });
        Ok(columns.map_err(refused)?.into_iter().map(|column| column.into_pyarray(py)).collect())
    }

    fn get(&self, path: &str) -> PyResult<Option<f64>> {
        self.graph.known(path).map_err(refused)
    }

    fn window(&self, module: &str) -> PyResult<Vec<f64>> {
        self.graph.window(module).map_err(refused)
    }

    #[pyo3(signature = (path, value))]
    fn set(&mut self, path: &str, value: Option<f64>) -> PyResult<()> {
        self.graph.set(path, value).map_err(refused)
    }

    fn schedule(&self, module: &str) -> PyResult<Vec<(f64, f64, f64, f64)>> {
        let rows = self.graph.schedule(module).map_err(refused)?;
        Ok(rows.iter().map(|row| (row.at, row.k, row.ti, row.td)).collect())
    }

    fn set_schedule(&mut self, module: &str, rows: Vec<[f64; 4]>) -> PyResult<()> {
        self.graph.set_schedule(module, &gains(&rows)).map_err(refused)
    }

    fn take_over(&mut self, module: &str) -> PyResult<()> {
        self.graph.take_over(module).map_err(refused)
    }

    fn reset_detection(&mut self, module: &str) -> PyResult<()> {
        self.graph.reset_detection(module).map_err(refused)
    }

    fn names(&self) -> Vec<String> {
        self.graph.names()
    }
}

/// K, Ti and Td in ideal form of a controller in series form.
#[pyfunction]
pub fn ideal_of_series(k: f64, ti: f64, td: f64) -> PyResult<(f64, f64, f64)> {
    PidSettings::series(k, ti, td).map(|s| (s.k, s.ti, s.td)).map_err(refused)
}

/// K, Ti and Td in ideal form of a controller in parallel form.
#[pyfunction]
pub fn ideal_of_parallel(kp: f64, ki: f64, kd: f64) -> PyResult<(f64, f64, f64)> {
    PidSettings::parallel(kp, ki, kd).map(|s| (s.k, s.ti, s.td)).map_err(refused)
}
