//! Tuning rules in closed form.

use glapp_core::ParameterError;
use glapp_core::tuning::{self as rules, Gains, Kind, Table};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type PyGains = PyResult<(f64, f64, f64)>;

fn answer(gains: Result<Gains<f64>, ParameterError>) -> PyGains {
    gains.map(|g| (g.k, g.ti, g.td)).map_err(|error| PyValueError::new_err(error.to_string()))
}

fn kind(pid: bool) -> Kind {
    if pid { Kind::Pid } else { Kind::Pi }
}

fn table(original: bool) -> Table {
    if original { Table::Original } else { Table::Textbook }
}

#[pyfunction]
pub fn ziegler_nichols_step(a: f64, l: f64, pid: bool, original: bool) -> PyGains {
    answer(rules::ziegler_nichols_step(a, l, kind(pid), table(original)))
}

#[pyfunction]
pub fn ziegler_nichols_frequency(ku: f64, tu: f64, pid: bool, original: bool) -> PyGains {
    answer(rules::ziegler_nichols_frequency(ku, tu, kind(pid), table(original)))
}

/// Named `lam`, since `lambda` is a keyword of Python.
#[pyfunction]
pub fn lambda_tuning(kp: f64, t: f64, l: f64, lam: f64, pid: bool) -> PyGains {
    answer(rules::lambda(kp, t, l, lam, kind(pid)))
}

#[pyfunction]
pub fn lambda_integrating(kv: f64, l: f64, lam: f64) -> PyGains {
    answer(rules::lambda_integrating(kv, l, lam))
}

#[pyfunction]
pub fn amigo_step(kp: f64, t: f64, l: f64, pid: bool) -> PyGains {
    answer(rules::amigo_step(kp, t, l, kind(pid)))
}

#[pyfunction]
pub fn amigo_integrating(kv: f64, l: f64, pid: bool) -> PyGains {
    answer(rules::amigo_integrating(kv, l, kind(pid)))
}

#[pyfunction]
pub fn amigo_frequency(ku: f64, tu: f64, kappa: f64, pid: bool) -> PyGains {
    answer(rules::amigo_frequency(ku, tu, kappa, kind(pid)))
}

#[pyfunction]
pub fn point_placement(ku: f64, tu: f64) -> PyGains {
    answer(rules::point_placement(ku, tu))
}

#[pyfunction]
pub fn simc(kp: f64, t: f64, t2: f64, l: f64, tau_c: f64) -> PyGains {
    answer(rules::simc(kp, t, t2, l, tau_c))
}

#[pyfunction]
pub fn simc_integrating(kv: f64, t2: f64, l: f64, tau_c: f64) -> PyGains {
    answer(rules::simc_integrating(kv, t2, l, tau_c))
}
