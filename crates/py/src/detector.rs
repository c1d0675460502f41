//! The detector: samples in, half-periods and the estimate out.

use crate::refused;
use glapp_core::{
    Columns, Corrected, Detector, DetectorSettings, DetectorState, Doubt, Estimate, Half, LONGEST_WINDOW, Pair, Reason,
    Record, Span, Swing, SwingParts, SwingState, corrected, pairs,
};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;
use std::cell::Cell;
use std::ops::Range;

use crate::columns::with_columns;

type EstimateParts = (f64, f64, f64, u8, u8);
type CorrectedParts = (f64, f64, f64, f64, Option<(f64, f64)>);

/// A half-period shorter than 5Ti is the most frequent thing that noise makes; so many of them are kept whole, the
/// others are counted.
const SHORT_KEPT: usize = 50_000;

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

/// How a saved detector is laid out. What is laid out otherwise has another number, and is refused by it.
const FORMAT: &str = "glapp detector 2";

/// One half-period: what the signals did, the width and the verdict. Attributes as the columns of the table.
#[pyclass(frozen, module = "glapp", name = "HalfPeriod")]
pub struct PyHalfPeriod {
    span: Span,
    record: Record<f64>,
    swing: Option<SwingParts<f64>>,
}

const DOUBTS: [(Doubt, &str); 5] = [
    (Doubt::TooFew, "too_few"),
    (Doubt::Alike, "alike"),
    (Doubt::WrongSlope, "wrong_slope"),
    (Doubt::Scattered, "scattered"),
    (Doubt::Swamped, "swamped"),
];

fn parts(e: Estimate<f64>) -> EstimateParts {
    (e.value, e.low, e.high, e.kept, e.count)
}

/// Names of the reasons, by their codes.
#[pyfunction]
pub fn reasons() -> Vec<&'static str> {
    Reason::ALL.iter().map(|reason| reason.name()).collect()
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
                let Self { span, record, .. } = self;
                let (reason, d) = (record.reason().name(), record.parts.d);
                format!("<HalfPeriod {} s to {} s: {reason}, d = {d:.4}>", span.start, span.end)
            }

            $($(#[$doc])* #[getter]
            fn $name(&self) -> $type {
                let ($span, $record, $swing) = (&self.span, &self.record, &self.swing);
                $value
            })*
        }

        fn columns<'py>(py: Python<'py>, rows: &[PyHalfPeriod]) -> PyResult<Bound<'py, PyDict>> {
            let table = PyDict::new(py);
            $({
                let column = rows.iter().map(|PyHalfPeriod { span: $span, record: $record, swing: $swing }| {
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
#[pyclass(module = "glapp", name = "Detector", subclass)]
pub struct PyDetector {
    settings: DetectorSettings<f64>,
    detector: Detector<f64>,
    state: DetectorState<f64>,
    swing: Swing<f64>,
    swinging: Swinging,
    rows: Vec<PyHalfPeriod>,
    short_rows: usize,
    reasons: [u64; Reason::ALL.len()],
}

impl PyDetector {
    fn fresh(settings: DetectorSettings<f64>) -> PyResult<Self> {
        let DetectorSettings { k, ti, td, b, .. } = settings;
        Ok(Self {
            detector: Detector::of(&settings).map_err(refused)?,
            swing: Swing::new(k, ti, td, b).map_err(refused)?,
            swinging: Default::default(),
            settings,
            state: DetectorState::default(),
            rows: Vec::new(),
            short_rows: 0,
            reasons: [0; Reason::ALL.len()],
        })
    }

    /// Half-periods to the table, without their swing.
    fn take(&mut self, columns: Columns<'_, f64>) {
        let Self { detector, state, rows, short_rows, reasons, .. } = self;
        let ended = |span: Span, record: &Record<f64>| {
            reasons[record.reason() as usize] += 1;
            keep(rows, short_rows, PyHalfPeriod { span, record: *record, swing: None });
        };
        detector.run(state, columns, ended, |_, _| ());
    }

    /// The same with their swing; gives the filtered PV of each sample.
    fn take_closely(&mut self, columns: Columns<'_, f64>) -> Vec<f64> {
        let Self { detector, state, swing, swinging, rows, short_rows, reasons, .. } = self;
        let mut filtered = vec![f64::NAN; columns.t.len()];
        // The first sample of the half-period under way.
        let next = Cell::new(0);
        let mut ends = Vec::new();
        let seen = |k: usize, value: Option<f64>| {
            filtered[k] = value.unwrap_or(f64::NAN);
            next.set(k + 1);
        };
        detector.run(state, columns, |span, record| ends.push((next.get(), span, *record)), seen);
        let mut from = 0;
        for (to, span, record) in ends {
            swinging.add(swing, &columns, &filtered, from..to);
            let parts = swing.end(&mut swinging.state, record.half.sign, record.half.flags);
            reasons[record.reason() as usize] += 1;
            keep(rows, short_rows, PyHalfPeriod { span, record, swing: Some(parts) });
            from = to;
        }
        swinging.add(swing, &columns, &filtered, from..columns.t.len());
        filtered
    }
}

/// Adds a half-period to the table, if it is not one more of the short ones.
fn keep(rows: &mut Vec<PyHalfPeriod>, short_rows: &mut usize, half: PyHalfPeriod) {
    if half.record.mask & Reason::TooShort.bit() != 0 {
        if *short_rows >= SHORT_KEPT {
            return;
        }
        *short_rows += 1;
    }
    rows.push(half);
}

/// The swing under way, and the time of the last sample [s].
#[derive(Clone, Copy, Default)]
struct Swinging {
    state: SwingState<f64>,
    t: Option<f64>,
}

impl Swinging {
    /// Takes the samples of one half-period; a filtered PV that is not a number is passed over.
    fn add(&mut self, swing: &Swing<f64>, columns: &Columns<'_, f64>, filtered: &[f64], samples: Range<usize>) {
        let Self { mut state, mut t } = *self;
        for k in samples {
            let (now, op) = (columns.t[k], columns.op.map(|op| op[k]));
            let h = t.map_or(0.0, |before| now - before);
            swing.add(&mut state, h, columns.sp[k], filtered[k], op);
            t = if now.is_finite() { Some(now) } else { t };
        }
        *self = Self { state, t };
    }
}

#[pymethods]
impl PyDetector {
    #[new]
    fn new(settings: Settings) -> PyResult<Self> {
        Self::fresh(settings.0)
    }

    /// One sample; gives the half-period that it ended, or None.
    #[pyo3(signature = (t, sp, pv, op=None, flags=0))]
    fn update(&mut self, t: f64, sp: f64, pv: f64, op: Option<f64>, flags: u8) -> Option<PyHalfPeriod> {
        let columns = Columns {
            t: &[t],
            sp: &[sp],
            pv: &[pv],
            op: op.as_ref().map(std::slice::from_ref),
            flags: Some(std::slice::from_ref(&flags)),
        };
        let Self { detector, state, reasons, .. } = self;
        let mut result = None;
        detector.run(
            state,
            columns,
            |span, record| {
                reasons[record.reason() as usize] += 1;
                result = Some(PyHalfPeriod { span, record: *record, swing: None });
            },
            |_, _| (),
        );
        result
    }

    /// Many samples; the half-periods are added to the table. `closely`: with their swing and plateau, and gives the
    /// filtered PV of each sample.
    #[pyo3(signature = (t, sp, pv, op, flags, closely))]
    #[allow(clippy::too_many_arguments)]
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        sp: PyReadonlyArray1<'py, f64>,
        pv: PyReadonlyArray1<'py, f64>,
        op: Option<PyReadonlyArray1<'py, f64>>,
        flags: Option<PyReadonlyArray1<'py, u8>>,
        closely: bool,
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        with_columns(&t, &sp, &pv, op.as_ref(), flags.as_ref(), |columns| {
            if closely {
                Some(PyArray1::from_vec(py, py.detach(|| self.take_closely(columns))))
            } else {
                py.detach(|| self.take(columns));
                None
            }
        })
    }

    /// The half-periods of `run` as a dict of arrays: all of them, but of those shorter than 5Ti the first 50 000.
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, &self.rows)
    }

    /// How many half-periods ended with each first reason; index 0: accepted.
    #[getter]
    fn reasons(&self) -> Vec<u64> {
        self.reasons.to_vec()
    }

    /// (value, low, high, kept, count) of the median/mean filter; None before the first detection, and where noise can feign it.
    #[getter]
    fn estimate(&self) -> Option<EstimateParts> {
        self.state.shown().map(parts)
    }

    /// The same, whether noise can feign it or not.
    #[getter]
    fn median_mean(&self) -> Option<EstimateParts> {
        self.state.estimate().map(parts)
    }

    /// What noise can feign [OP unit], from the level of the noise at the last detection; None where it is not known.
    #[getter]
    fn noise_floor(&self) -> Option<f64> {
        self.state.noise_floor()
    }

    /// The width with the bias of (2.4) taken out, from what `run` looked at closely: how many pairs of half-periods there are, and (d, low,
    /// high, kp, range of kp or None), or why there is none: "too_few", "alike", "wrong_slope", "scattered", "swamped".
    /// `kp` is the process gain where it is known.
    fn corrected(&self, kp: Option<f64>) -> (usize, Option<CorrectedParts>, Option<&'static str>) {
        let half = |row: &PyHalfPeriod| {
            let (span, half) = (row.span, &row.record.half);
            let swing = row.swing.unwrap_or_default();
            Half { span, sign: half.sign, mask: row.record.mask, delta_y: half.delta_y, swing }
        };
        let halves: Vec<Half<f64>> = self.rows.iter().map(half).collect();
        let all: Vec<Pair<f64>> = pairs(&halves).collect();
        let mut pairs = all[all.len().saturating_sub(LONGEST_WINDOW)..].to_vec();
        match corrected(&mut pairs, kp) {
            Ok(Corrected { d, low, high, kp, kp_range }) => (pairs.len(), Some((d, low, high, kp, kp_range)), None),
            Err(doubt) => (pairs.len(), None, DOUBTS.iter().find(|(d, _)| *d == doubt).map(|(_, name)| *name)),
        }
    }

    /// "integral", "derivative" or "op": where Δu is taken from, given whether OP is recorded.
    fn travel_source(&self, op_known: bool) -> &'static str {
        match self.detector.width().source(op_known) {
            glapp_core::TravelSource::Integral => "integral",
            glapp_core::TravelSource::Derivative => "derivative",
            glapp_core::TravelSource::Op => "op",
        }
    }

    /// Settings, state and counts of reasons as JSON; the table is not part of it.
    fn to_json(&self) -> PyResult<String> {
        let saved = json!({
            "format": FORMAT,
            "settings": self.settings,
            "state": self.state,
            "reasons": self.reasons,
        });
        serde_json::to_string(&saved).map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// Takes over settings, state and counts that `to_json` gave.
    fn restore(&mut self, text: &str) -> PyResult<()> {
        let broken = |what: String| PyValueError::new_err(format!("saved detector: {what}"));
        let mut saved: serde_json::Value = serde_json::from_str(text).map_err(|e| broken(e.to_string()))?;
        if saved["format"] != FORMAT {
            let found = saved["format"].as_str().unwrap_or("no format");
            return Err(broken(format!("is '{found}', and '{FORMAT}' is what this release reads: begin anew")));
        }
        let mut take = |key: &str| saved[key].take();
        let settings = serde_json::from_value(take("settings")).map_err(|e| broken(e.to_string()))?;
        let mut restored = Self::fresh(settings)?;
        restored.state = serde_json::from_value(take("state")).map_err(|e| broken(e.to_string()))?;
        restored.reasons = serde_json::from_value(take("reasons")).map_err(|e| broken(e.to_string()))?;
        *self = restored;
        Ok(())
    }
}
