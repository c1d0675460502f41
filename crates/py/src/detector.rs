//! The detector: samples in, half-periods and the estimate out.

use crate::refused;
use glapp_analysis::Crossings;
use glapp_analysis::crossings::Row;
use glapp_core::{DetectorSettings, Estimate, Reason};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::columns::columns_of;

type EstimateParts = (f64, f64, f64, u8, u8);

/// Settings of a detector in Python's form, in a dict; missing ones have their default.
pub struct Settings(pub DetectorSettings<f64>);

impl<'a, 'py> FromPyObject<'a, 'py> for Settings {
    type Error = PyErr;

    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let given = given.cast::<PyDict>()?;
        let number = |name: &str| -> PyResult<Option<f64>> { given.get_item(name)?.map_or(Ok(None), |x| x.extract()) };
        let must = |name: &str| -> PyResult<f64> {
            number(name)?.ok_or_else(|| PyValueError::new_err(format!("{name}: is missing")))
        };
        let (ti, td) = (must("ti")?, if given.contains("td")? { number("td")? } else { Some(0.0) });
        let mut settings =
            DetectorSettings { td, ..DetectorSettings::new(must("k")?, ti, td.unwrap_or(0.0), must("h")?) };
        settings.kp = number("kp")?;
        settings.op_span = number("op_span")?;
        settings.b = number("b")?.unwrap_or(settings.b);
        settings.tf = number("tf")?.unwrap_or(settings.tf);
        settings.max_h = number("max_h")?.unwrap_or(settings.max_h);
        if let Some(n) = given.get_item("n")? {
            settings.n = n.extract()?;
        }
        if let Some(limits) = given.get_item("op_limits")? {
            settings.op_limits = limits.extract()?;
        }
        if let Some(off) = given.get_item("off")? {
            for name in off.extract::<Vec<String>>()? {
                let unknown = || PyValueError::new_err(format!("off = {name}: there is no such condition"));
                *settings.conditions.switch(&name).ok_or_else(unknown)? = false;
            }
        }
        for name in given.keys() {
            let name: String = name.extract()?;
            if !KNOWN.contains(&name.as_str()) {
                return Err(PyValueError::new_err(format!("{name}: there is no such setting of a detector")));
            }
        }
        Ok(Self(settings))
    }
}

const KNOWN: [&str; 12] = ["k", "ti", "td", "b", "kp", "tf", "n", "h", "max_h", "op_limits", "op_span", "off"];

/// One half-period: its signals, width and verdict. Attributes as the columns of the table.
#[pyclass(frozen, module = "glapp", name = "HalfPeriod")]
pub struct PyHalfPeriod {
    row: Row,
}

/// Estimate, lowest, highest, kept and count.
fn parts(e: Estimate<f64>) -> EstimateParts {
    (e.value, e.low, e.high, e.kept, e.count)
}

/// Names of the reasons, by their codes.
#[pyfunction]
pub fn reasons() -> Vec<&'static str> {
    Reason::ALL.iter().map(|reason| reason.name()).collect()
}

/// Kp [PV unit/OP unit] as far as it is given or assumed; `spans` are the widths of those of PV and OP.
#[pyfunction]
pub fn process_gain(given: Option<f64>, spans: Option<(f64, f64)>, integrating: bool) -> Option<f64> {
    glapp_analysis::process_gain(given, spans, integrating).0
}

/// The shortest filter of PV that serves (2.1) [s], for Ti and Td [s].
#[pyfunction]
pub fn filter_time(ti: f64, td: f64) -> f64 {
    DetectorSettings::filter_time(ti, td)
}

macro_rules! attributes {
    ($($(#[$doc:meta])* $name:ident: $type:ty = |$span:ident, $record:ident, $swing:ident| $value:expr;)*) => {
        #[pymethods]
        impl PyHalfPeriod {
            fn __repr__(&self) -> String {
                let Row { span, record, .. } = &self.row;
                let (reason, d) = (record.reason().name(), record.parts.d);
                format!("<HalfPeriod {} s to {} s: {reason}, d = {d:.4}>", span.start, span.end)
            }

            $($(#[$doc])* #[getter]
            fn $name(&self) -> $type {
                let ($span, $record, $swing) = (&self.row.span, &self.row.record, &self.row.swing);
                $value
            })*
        }

        pub(crate) fn columns<'py>(py: Python<'py>, rows: &[Row]) -> PyResult<Bound<'py, PyDict>> {
            let table = PyDict::new(py);
            $({
                let column = rows.iter().map(|Row { span: $span, record: $record, swing: $swing, .. }| {
                    let _ = ($span, $swing);
                    $value
                });
                table.set_item(stringify!($name), PyArray1::from_iter(py, column))?;
            })*
            Ok(table)
        }
    };
}

attributes! {
    /// Time of the first sample [s].
    t_start: f64 = |span, _record, _swing| span.start;
    /// Time of the sample that ended it, or of the last one before a gap [s].
    t_end: f64 = |span, _record, _swing| span.end;
    /// +1: PV below SP, −1: above, 0: neither was seen.
    sign: i8 = |_span, record, _swing| record.half.sign;
    /// Number of samples.
    samples: u32 = |_span, record, _swing| record.half.n;
    /// Duration Δt [s].
    delta_t: f64 = |_span, record, _swing| record.half.delta_t;
    /// Mean distance to the setpoint Δy (2.2) [PV unit].
    delta_y: f64 = |_span, record, _swing| record.half.delta_y;
    /// Largest |e| [PV unit].
    e_max: f64 = |_span, record, _swing| record.half.e_max;
    /// Range of SP (5.5) [PV unit].
    delta_sp: f64 = |_span, record, _swing| record.half.delta_sp;
    /// K/Ti·Δy·Δt (7.5) [OP unit].
    delta_u: f64 = |_span, record, _swing| record.parts.delta_u;
    /// Derivative part of (7.6) [OP unit].
    delta_u_d: f64 = |_span, record, _swing| record.parts.delta_u_d;
    /// Setpoint part (b − 1)·K·Δysp [OP unit].
    delta_u_sp: f64 = |_span, record, _swing| record.parts.delta_u_sp;
    /// OP's own travel in the direction of the integral action [OP unit]; 0 where OP is not known.
    op_travel: f64 = |_span, record, _swing| record.parts.op_travel;
    /// OP's travel from its furthest point in the half-period before to that in this one [OP unit]; NaN where there is
    /// none to count from, and where `run` did not look closely.
    swing: f64 = |_span, _record, swing| swing.and_then(|swing| swing.travel).unwrap_or(f64::NAN);
    /// Height of PV's plateau [PV unit]; NaN where `run` did not look closely.
    plateau: f64 = |_span, _record, swing| swing.map_or(f64::NAN, |swing| swing.plateau);
    /// Kp-free part of the width [OP unit].
    free: f64 = |_span, record, _swing| record.parts.free;
    /// Kp part of the width [OP unit].
    kp_part: f64 = |_span, record, _swing| record.parts.kp_part;
    /// Width (2.4) [OP unit].
    d: f64 = |_span, record, _swing| record.parts.d;
    /// Δy of the half-period before [PV unit], NaN where there is none to compare with.
    previous_delta_y: f64 = |_span, record, _swing| record.previous_delta_y.unwrap_or(f64::NAN);
    /// Estimate compared in (5.1) [OP unit], NaN where it was not asked.
    d_hat_before: f64 = |_span, record, _swing| record.d_hat_before.unwrap_or(f64::NAN);
    /// All conditions that failed, one bit a reason.
    mask: u16 = |_span, record, _swing| record.mask;
    /// First reason of rejection, 0 = accepted.
    reason: u8 = |_span, record, _swing| record.reason() as u8;
    /// Estimate after this half-period [OP unit], NaN while there is none or it is below the noise limit.
    d_hat: f64 = |_span, record, _swing| record.shown().map_or(f64::NAN, |e| e.value);
    /// Estimate by the detections, above the noise limit or not [OP unit], NaN while there are none.
    median_mean: f64 = |_span, record, _swing| record.estimate.map_or(f64::NAN, |e| e.value);
    /// The noise limit [OP unit], NaN where it is not known.
    noise_floor: f64 = |_span, record, _swing| record.noise_floor.unwrap_or(f64::NAN);
    /// Detections in the window after this half-period.
    detections: u8 = |_span, record, _swing| record.estimate.map_or(0, |e| e.count);
}

/// The detector with its state and its table of half-periods.
#[pyclass(module = "glapp", name = "Detector")]
pub struct PyDetector {
    pub(crate) crossings: Crossings,
}

#[pymethods]
impl PyDetector {
    #[new]
    fn new(settings: Settings) -> PyResult<Self> {
        Ok(Self { crossings: Crossings::new(settings.0).map_err(refused)? })
    }

    /// One sample; gives the half-period that it ended, or None.
    #[pyo3(signature = (t, sp, pv, op=None, flags=0))]
    fn update(&mut self, t: f64, sp: f64, pv: f64, op: Option<f64>, flags: u8) -> Option<PyHalfPeriod> {
        self.crossings.update(t, sp, pv, op, flags).map(|row| PyHalfPeriod { row })
    }

    /// Many samples; the half-periods are added to the table, without their swing.
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<()> {
        let columns = columns_of(&t, &sp, &pv, op.as_ref(), flags.as_ref())?;
        py.detach(|| self.crossings.take(columns));
        Ok(())
    }

    /// Takes samples and keeps the swing of each half-period; gives the filtered PV of each sample.
    fn run_closely<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let columns = columns_of(&t, &sp, &pv, op.as_ref(), flags.as_ref())?;
        Ok(PyArray1::from_vec(py, py.detach(|| self.crossings.take_closely(columns))))
    }

    /// The half-periods as a dict of arrays: all of them, but of those shorter than 5Ti the first 50 000.
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, self.crossings.rows())
    }

    /// Number of half-periods by their first reason; index 0: accepted.
    #[getter]
    fn reasons(&self) -> Vec<u64> {
        self.crossings.reasons().to_vec()
    }

    /// (value, low, high, kept, count) of the median/mean filter; None before the first detection, and where it is below the noise limit.
    #[getter]
    fn estimate(&self) -> Option<EstimateParts> {
        self.crossings.state().shown().map(parts)
    }

    /// The estimate, whether above the noise limit or not.
    #[getter]
    fn median_mean(&self) -> Option<EstimateParts> {
        self.crossings.state().estimate().map(parts)
    }

    /// The noise limit [OP unit], from the level of the noise at the last detection; None where it is not known.
    #[getter]
    fn noise_floor(&self) -> Option<f64> {
        self.crossings.state().noise_floor()
    }

    /// Settings, state and counts of reasons as JSON; the table is not part of it.
    fn save(&self) -> String {
        self.crossings.save()
    }

    /// The detector that `save` saved.
    #[staticmethod]
    fn load(text: &str) -> PyResult<Self> {
        let crossings = Crossings::load(text).map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { crossings })
    }
}
