//! The detector: samples in, half-periods and the estimate out.

use crate::refused;
use glapp_analysis::crossings::{Beside, Known, NotCorrected, Place, Row, Travel, Why, judge};
use glapp_analysis::quality::{Fault, Severity};
use glapp_analysis::{Crossings, Ladder};
use glapp_core::{Corrected, DetectorSettings, Doubt, Estimate, Reason, TravelSource};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::thread;

use crate::columns::with_columns;

type EstimateParts = (f64, f64, f64, u8, u8);
type CorrectedParts = (f64, f64, f64, f64, Option<(f64, f64)>);
/// A name and its numbers.
type Named = (&'static str, Vec<f64>);
type CorrectedFace = (usize, Option<CorrectedParts>, Option<Named>);

/// Settings of a detector as Python has them, in a dict; what is not there has its default.
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

/// One half-period: what the signals did, the width and the verdict. Attributes as the columns of the table.
#[pyclass(frozen, module = "glapp", name = "HalfPeriod")]
pub struct PyHalfPeriod {
    row: Row,
}

fn parts(e: Estimate<f64>) -> EstimateParts {
    (e.value, e.low, e.high, e.kept, e.count)
}

/// Names of the reasons, by their codes.
#[pyfunction]
pub fn reasons() -> Vec<&'static str> {
    Reason::ALL.iter().map(|reason| reason.name()).collect()
}

/// What may be said, and why not more: (name, its numbers). `place`: "primary", "split_range", "shared_valve" or None;
/// `findings`: (code, severity), gravest first; without a detector K and Ti are not known.
#[pyfunction]
pub fn verdict(
    place: Option<&str>,
    sp: bool,
    op: bool,
    findings: Vec<(String, String)>,
    detector: Option<&PyDetector>,
) -> PyResult<(&'static str, Option<Named>)> {
    let place = match place {
        None => None,
        Some("primary") => Some(Place::Primary),
        Some("split_range") => Some(Place::SplitRange),
        Some("shared_valve") => Some(Place::SharedValve),
        Some(other) => return Err(PyValueError::new_err(format!("place = {other}: there is no such place"))),
    };
    let findings = findings.iter().map(|(code, severity)| {
        let fault = Fault::ALL.iter().find(|fault| fault.name() == code);
        let known = [Severity::Info, Severity::Warning, Severity::Refuse];
        let severity = known.into_iter().find(|one| one.name() == severity);
        fault.copied().zip(severity).ok_or_else(|| PyValueError::new_err(format!("{code}: there is no such finding")))
    });
    let findings: Vec<_> = findings.collect::<PyResult<_>>()?;
    let known = Known { place, sp, op, findings: &findings };
    let (verdict, why) = judge(&known, detector.map(|detector| &detector.crossings));
    let why = why.map(|why| match why {
        Why::Place(Place::Primary) => ("primary", vec![]),
        Why::Place(Place::SplitRange) => ("split_range", vec![]),
        Why::Place(Place::SharedValve) => ("shared_valve", vec![]),
        Why::NoSp => ("no_sp", vec![]),
        Why::Finding(i) => ("finding", vec![i as f64]),
        Why::NoLaw => ("no_law", vec![]),
        Why::NotIdentified => ("not_identified", vec![]),
        Why::NothingAccepted => ("nothing_accepted", vec![]),
        Why::Disagree { kept, count } => ("disagree", vec![kept.into(), count.into()]),
        Why::GainTooLow => ("gain_too_low", vec![]),
        Why::Noise { d, floor } => ("noise", vec![d, floor]),
        Why::Few => ("few", vec![]),
    });
    Ok((verdict.name(), why))
}

/// Kp [PV unit/OP unit], and where it comes from; `spans` are the widths of those of PV and OP.
#[pyfunction]
pub fn process_gain(given: Option<f64>, spans: Option<(f64, f64)>, integrating: bool) -> (Option<f64>, &'static str) {
    let (kp, origin) = glapp_analysis::process_gain(given, spans, integrating);
    (kp, origin.name())
}

/// Whether a fitted gain, with its interval, may stand for one that is not known.
#[pyfunction]
pub fn fitted_gain_serves(kp: f64, low: f64, high: f64) -> bool {
    glapp_analysis::fitted_gain_serves(kp, low, high)
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

        fn columns<'py>(py: Python<'py>, rows: &[Row]) -> PyResult<Bound<'py, PyDict>> {
            let table = PyDict::new(py);
            $({
                let column = rows.iter().map(|Row { span: $span, record: $record, swing: $swing }| {
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
    /// Estimate after this half-period [OP unit], NaN while there is none or noise can feign it.
    d_hat: f64 = |_span, record, _swing| record.shown().map_or(f64::NAN, |e| e.value);
    /// What the detections say, whether noise can feign it or not [OP unit], NaN while there are none.
    median_mean: f64 = |_span, record, _swing| record.estimate.map_or(f64::NAN, |e| e.value);
    /// What noise can feign [OP unit], NaN where it is not known.
    noise_floor: f64 = |_span, record, _swing| record.noise_floor.unwrap_or(f64::NAN);
    /// Detections in the window after this half-period.
    detections: u8 = |_span, record, _swing| record.estimate.map_or(0, |e| e.count);
}

/// The detector with its state and its table of half-periods.
#[pyclass(module = "glapp", name = "Detector")]
pub struct PyDetector {
    crossings: Crossings,
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
        with_columns(&t, &sp, &pv, op.as_ref(), flags.as_ref(), |columns| py.detach(|| self.crossings.take(columns)))
    }

    /// The half-periods of `run` as a dict of arrays: all of them, but of those shorter than 5Ti the first 50 000.
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, self.crossings.rows())
    }

    /// How many half-periods ended with each first reason; index 0: accepted.
    #[getter]
    fn reasons(&self) -> Vec<u64> {
        self.crossings.reasons().to_vec()
    }

    /// (value, low, high, kept, count) of the median/mean filter; None before the first detection, and where noise can feign it.
    #[getter]
    fn estimate(&self) -> Option<EstimateParts> {
        self.crossings.state().shown().map(parts)
    }

    /// The same, whether noise can feign it or not.
    #[getter]
    fn median_mean(&self) -> Option<EstimateParts> {
        self.crossings.state().estimate().map(parts)
    }

    /// What noise can feign [OP unit], from the level of the noise at the last detection; None where it is not known.
    #[getter]
    fn noise_floor(&self) -> Option<f64> {
        self.crossings.state().noise_floor()
    }

    /// "integral", "derivative" or "op": where Δu is taken from, given whether OP is recorded.
    fn travel_source(&self, op_known: bool) -> &'static str {
        match self.crossings.detector().width().source(op_known) {
            TravelSource::Integral => "integral",
            TravelSource::Derivative => "derivative",
            TravelSource::Op => "op",
        }
    }

    /// The width with the bias of (2.4) taken out, from what a ladder looked at closely: how many pairs of half-periods
    /// there are; (d, low, high, kp, range of kp or None) or None; and why not: (name, its numbers).
    /// `kp` is the process gain where it is known, `op_noise` the deviation of OP's fast noise.
    fn corrected(&self, kp: Option<f64>, op_known: bool, op_noise: Option<f64>, integrating: bool) -> CorrectedFace {
        let travel = if op_known { Travel::Op } else { Travel::Law };
        let (pairs, found) = self.crossings.corrected(&Beside { kp, travel, op_noise, integrating });
        match found {
            Ok(Corrected { d, low, high, kp, kp_range }) => (pairs, Some((d, low, high, kp, kp_range)), None),
            Err(why) => (pairs, None, Some(doubt(why))),
        }
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

fn doubt(why: NotCorrected) -> Named {
    match why {
        NotCorrected::Doubt(Doubt::TooFew) => ("too_few", vec![]),
        NotCorrected::Doubt(Doubt::Alike) => ("alike", vec![]),
        NotCorrected::Doubt(Doubt::WrongSlope) => ("wrong_slope", vec![]),
        NotCorrected::Doubt(Doubt::Scattered) => ("scattered", vec![]),
        NotCorrected::Doubt(Doubt::Swamped) => ("swamped", vec![]),
        NotCorrected::Noise { d, noise } => ("noise", vec![d, noise]),
        NotCorrected::Smooth { tf } => ("smooth", vec![tf]),
        NotCorrected::Integrating => ("integrating", vec![]),
    }
}

/// A detector for every filter time that is tried, side by side over one recording.
#[pyclass(module = "glapp", name = "Ladder")]
pub struct PyLadder {
    ladder: Ladder,
}

#[pymethods]
impl PyLadder {
    /// All filter times are tried where the settings give none.
    #[new]
    fn new(settings: Bound<'_, PyDict>) -> PyResult<Self> {
        let given = settings.contains("tf")?;
        let settings: Settings = settings.extract()?;
        Ok(Self { ladder: Ladder::new(settings.0, given).map_err(refused)? })
    }

    /// The filter times that are tried [s].
    #[getter]
    fn filter_times(&self) -> Vec<f64> {
        self.ladder.rungs().iter().map(|rung| rung.settings().tf).collect()
    }

    /// Many samples, looked at closely; gives the filtered PV of each, by filter time.
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
    ) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let filtered = with_columns(&t, &sp, &pv, op.as_ref(), flags.as_ref(), |columns| {
            py.detach(|| {
                thread::scope(|scope| {
                    let rungs = self.ladder.rungs_mut().iter_mut();
                    let hands: Vec<_> = rungs.map(|rung| scope.spawn(|| rung.take_closely(columns))).collect();
                    hands.into_iter().map(thread::ScopedJoinHandle::join).collect::<Result<Vec<_>, _>>()
                })
            })
        })?;
        let filtered = filtered.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok(filtered.into_iter().map(|column| PyArray1::from_vec(py, column)).collect())
    }

    /// Which of them is taken, and its detector: the smallest that leaves enough accepted half-periods, (N + 1)/2; where
    /// none does, the one with most.
    fn chosen(&self) -> (usize, PyDetector) {
        let chosen = self.ladder.choose();
        (chosen, PyDetector { crossings: self.ladder.rungs()[chosen].clone() })
    }
}
