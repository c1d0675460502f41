//! A detector over a recording, with the table of its half-periods.

use glapp_core::{
    Columns, Detector, DetectorSettings, DetectorState, ParameterError, Reason, Record, Span, Swing, SwingParts,
    SwingState,
};
use serde_json::{Value, json};
use std::cell::Cell;
use std::ops::Range;

/// A half-period shorter than 5Ti is the most frequent thing that noise makes; so many of them are kept whole, the
/// others are counted.
pub const SHORT_KEPT: usize = 50_000;

/// How a saved detector is laid out. What is laid out otherwise has another number, and is refused by it.
const FORMAT: &str = "glapp detector 2";

/// One half-period: when it was, what was concluded from it, and its swing where it was looked at closely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// From when to when.
    pub span: Span,
    /// What the signals did, the width and the verdict.
    pub record: Record<f64>,
    /// Travel of OP and plateau of PV.
    pub swing: Option<SwingParts<f64>>,
}

/// The detector with its state, its table of half-periods and the counts of their reasons.
///
/// ```
/// use glapp_analysis::Crossings;
/// use glapp_core::{Columns, DetectorSettings};
///
/// let settings = DetectorSettings { n: 3, tf: 0.001, kp: Some(2.0), ..DetectorSettings::new(0.5, 10.0, 0.0, 1.0) };
/// let t: Vec<f64> = (0..800).map(f64::from).collect();
/// let pv: Vec<f64> = (0..800).map(|k| if k / 100 % 2 == 0 { -1.0 } else { 1.0 }).collect();
/// let mut crossings = Crossings::new(settings)?;
/// crossings.take(Columns { t: &t, sp: &[0.0; 800], pv: &pv, op: None, flags: None });
/// assert_eq!(crossings.rows().len(), 7);
/// assert_eq!(crossings.accepted(), 5);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Crossings {
    settings: DetectorSettings<f64>,
    detector: Detector<f64>,
    state: DetectorState<f64>,
    swing: Swing<f64>,
    swinging: Swinging,
    rows: Vec<Row>,
    short_rows: usize,
    reasons: [u64; Reason::ALL.len()],
}

/// Why a saved detector cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SavedError {
    /// Not what was saved.
    #[error("saved detector: {0}")]
    Broken(String),
    /// Saved by another release.
    #[error("saved detector: is '{0}', and '{FORMAT}' is what this release reads: begin anew")]
    Format(String),
}

impl Crossings {
    /// A detector at the beginning of a recording.
    pub fn new(settings: DetectorSettings<f64>) -> Result<Self, ParameterError> {
        let DetectorSettings { k, ti, td, b, .. } = settings;
        Ok(Self {
            detector: Detector::of(&settings)?,
            swing: Swing::new(k, ti, td, b)?,
            swinging: Swinging::default(),
            settings,
            state: DetectorState::default(),
            rows: Vec::new(),
            short_rows: 0,
            reasons: [0; Reason::ALL.len()],
        })
    }

    /// Its settings.
    pub fn settings(&self) -> &DetectorSettings<f64> {
        &self.settings
    }

    /// The detector.
    pub fn detector(&self) -> &Detector<f64> {
        &self.detector
    }

    /// What the detector remembers: the estimate, and what noise can feign.
    pub fn state(&self) -> &DetectorState<f64> {
        &self.state
    }

    /// The table: all half-periods, but of those shorter than 5Ti the first [`SHORT_KEPT`].
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// How many half-periods ended with each first reason, by its code; 0: accepted.
    pub fn reasons(&self) -> &[u64] {
        &self.reasons
    }

    /// How many half-periods were accepted.
    pub fn accepted(&self) -> u64 {
        self.reasons[Reason::Accepted as usize]
    }

    /// Takes one sample at `t` \[s\]; gives the half-period that it ended, which is counted and not kept.
    pub fn update(&mut self, t: f64, sp: f64, pv: f64, op: Option<f64>, flags: u8) -> Option<Row> {
        let op = op.as_ref().map(std::slice::from_ref);
        let columns = Columns { t: &[t], sp: &[sp], pv: &[pv], op, flags: Some(&[flags]) };
        let Self { detector, state, reasons, .. } = self;
        let mut row = None;
        let ended = |span: Span, record: &Record<f64>| {
            reasons[record.reason() as usize] += 1;
            row = Some(Row { span, record: *record, swing: None });
        };
        detector.run(state, columns, ended, |_, _| ());
        row
    }

    /// Takes many samples; their half-periods go to the table, without their swing.
    pub fn take(&mut self, columns: Columns<'_, f64>) {
        let Self { detector, state, rows, short_rows, reasons, .. } = self;
        let ended = |span: Span, record: &Record<f64>| {
            reasons[record.reason() as usize] += 1;
            keep(rows, short_rows, Row { span, record: *record, swing: None });
        };
        detector.run(state, columns, ended, |_, _| ());
    }

    /// The same with their swing; gives the filtered PV of each sample, NaN where there is none.
    pub fn take_closely(&mut self, columns: Columns<'_, f64>) -> Vec<f64> {
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
            keep(rows, short_rows, Row { span, record, swing: Some(parts) });
            from = to;
        }
        swinging.add(swing, &columns, &filtered, from..columns.t.len());
        filtered
    }

    /// Settings, state and counts of reasons as JSON; the table is not part of it.
    pub fn save(&self) -> String {
        let Self { settings, state, reasons, .. } = self;
        json!({ "format": FORMAT, "settings": settings, "state": state, "reasons": reasons }).to_string()
    }

    /// The detector that [`Self::save`] saved: it goes on with the same bits as one never interrupted.
    pub fn load(text: &str) -> Result<Self, SavedError> {
        let broken = |error: &dyn std::fmt::Display| SavedError::Broken(error.to_string());
        let mut saved: Value = serde_json::from_str(text).map_err(|e| broken(&e))?;
        if saved["format"] != FORMAT {
            return Err(SavedError::Format(saved["format"].as_str().unwrap_or("no format").into()));
        }
        let settings = serde_json::from_value(saved["settings"].take()).map_err(|e| broken(&e))?;
        let mut loaded = Self::new(settings).map_err(|e| broken(&e))?;
        loaded.state = serde_json::from_value(saved["state"].take()).map_err(|e| broken(&e))?;
        loaded.reasons = serde_json::from_value(saved["reasons"].take()).map_err(|e| broken(&e))?;
        Ok(loaded)
    }
}

/// Adds a half-period to the table, if it is not one more of the short ones.
fn keep(rows: &mut Vec<Row>, short_rows: &mut usize, row: Row) {
    if row.record.mask & Reason::TooShort.bit() != 0 {
        if *short_rows >= SHORT_KEPT {
            return;
        }
        *short_rows += 1;
    }
    rows.push(row);
}

/// The swing under way, and the time of the last sample \[s\].
#[derive(Clone, Copy, Debug, Default)]
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
