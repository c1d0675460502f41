//! A detector over a recording, with the table of its half-periods.

mod together;

use glapp_core::status::{BAD, DATA_GAP, NOT_AUTO};
use glapp_core::{
    Columns, Detector, DetectorSettings, DetectorState, HalfPeriodResult, ParameterError, Reason, Span, Swing,
    SwingParts, SwingState,
};
use serde_json::{Value, json};
use std::cell::Cell;
use std::ops::Range;

/// A half-period shorter than 5Ti is the most frequent thing that noise makes; so many of them are kept whole, the
/// others are counted.
pub const SHORT_KEPT: usize = 50_000;

/// Format of a saved detector. What is laid out otherwise has another number, and is refused by it.
const FORMAT: &str = "glapp detector 2";

/// One half-period: its time, its result, and its swing where that was kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// First and last time.
    pub span: Span,
    /// Signals, width and verdict of the half-period.
    pub record: HalfPeriodResult<f64>,
    /// Travel of OP and plateau of PV.
    pub swing: Option<SwingParts<f64>>,
    /// Time of the half-periods since the row before that the table does not keep \[s\], but those in a break or not in
    /// automatic.
    pub passed: f64,
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
    short: Short,
    reasons: [u64; Reason::ALL.len()],
}

/// Why a saved detector cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SavedError {
    /// The text is no saved detector.
    #[error("saved detector: {0}")]
    Broken(String),
    /// Saved by another release: as what, and what this one reads.
    #[error("saved detector: is '{0}', and '{1}' is what this release reads: begin anew")]
    Format(String, &'static str),
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
            short: Short::default(),
            reasons: [0; Reason::ALL.len()],
        })
    }

    /// Settings of the detector.
    pub fn settings(&self) -> &DetectorSettings<f64> {
        &self.settings
    }

    /// The detector of the crossings.
    pub fn detector(&self) -> &Detector<f64> {
        &self.detector
    }

    /// State of the detector: the estimate, and the noise limit.
    pub fn state(&self) -> &DetectorState<f64> {
        &self.state
    }

    /// The table: all half-periods, but of those shorter than 5Ti the first [`SHORT_KEPT`].
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The rows of the table, which is empty then.
    pub fn drain(&mut self) -> Vec<Row> {
        self.short = Short::default();
        std::mem::take(&mut self.rows)
    }

    /// Number of half-periods by the code of their first reason; code 0 is accepted.
    pub fn reasons(&self) -> &[u64] {
        &self.reasons
    }

    /// Number of accepted half-periods.
    pub fn accepted(&self) -> u64 {
        self.reasons[Reason::Accepted as usize]
    }

    /// Takes one sample at `t` \[s\]; gives the half-period that it ended, which is counted and not kept.
    pub fn update(&mut self, t: f64, sp: f64, pv: f64, op: Option<f64>, flags: u8) -> Option<Row> {
        let op = op.as_ref().map(std::slice::from_ref);
        let columns = Columns { t: &[t], sp: &[sp], pv: &[pv], op, flags: Some(&[flags]) };
        let Self { detector, state, reasons, .. } = self;
        let mut row = None;
        let ended = |span: Span, record: &HalfPeriodResult<f64>| {
            reasons[record.reason() as usize] += 1;
            row = Some(Row { span, record: *record, swing: None, passed: 0.0 });
        };
        detector.run(state, columns, ended, |_, _| ());
        row
    }

    /// Takes many samples; their half-periods go to the table, without their swing.
    pub fn take(&mut self, columns: Columns<'_, f64>) {
        let Self { detector, state, rows, short, reasons, .. } = self;
        let ended = |span: Span, record: &HalfPeriodResult<f64>| {
            short.keep(rows, reasons, Row { span, record: *record, swing: None, passed: 0.0 });
        };
        detector.run(state, columns, ended, |_, _| ());
    }

    /// Takes samples and keeps the swing of each half-period; gives the filtered PV of each sample, NaN where there is none.
    pub fn take_closely(&mut self, columns: Columns<'_, f64>) -> Vec<f64> {
        let Self { detector, state, swing, swinging, rows, short, reasons, .. } = self;
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
            short.keep(rows, reasons, Row { span, record, swing: Some(parts), passed: 0.0 });
            from = to;
        }
        swinging.add(swing, &columns, &filtered, from..columns.t.len());
        filtered
    }

    /// The half-periods judged with another process gain: the bits of a pass over the samples, except as [`Detector::judge_again`]
    /// says. It goes on from the same sample. What [`update`](Self::update) counted and did not keep stays as it was.
    ///
    /// # Errors
    ///
    /// Where `kp` is out of its bounds.
    pub fn with_gain(&self, kp: Option<f64>) -> Result<Self, ParameterError> {
        let settings = DetectorSettings { kp, ..self.settings };
        let detector = Detector::of(&settings)?;
        let (mut state, mut reasons) = (self.state.unjudged(), self.reasons);
        let judged = |row: &Row| {
            let record = detector.judge_again(&mut state, &row.record, row.passed);
            reasons[row.record.reason() as usize] -= 1;
            reasons[record.reason() as usize] += 1;
            Row { record, ..*row }
        };
        let rows = self.rows.iter().map(judged).collect();
        let &Self { swing, swinging, short, .. } = self;
        Ok(Self { settings, detector, state, swing, swinging, rows, short, reasons })
    }

    /// Settings, state and counts of reasons as JSON; the table is not part of it.
    pub fn save(&self) -> String {
        self.saved().to_string()
    }

    /// [`Self::save`] as a JSON value.
    pub(super) fn saved(&self) -> Value {
        let Self { settings, state, reasons, .. } = self;
        json!({ "format": FORMAT, "settings": settings, "state": state, "reasons": reasons })
    }

    /// The detector that [`Self::save`] saved: it goes on with the same bits as one never interrupted.
    pub fn load(text: &str) -> Result<Self, SavedError> {
        Self::loaded(serde_json::from_str(text).map_err(|e| SavedError::Broken(e.to_string()))?)
    }

    pub(super) fn loaded(mut saved: Value) -> Result<Self, SavedError> {
        let broken = |error: &dyn std::fmt::Display| SavedError::Broken(error.to_string());
        if saved["format"] != FORMAT {
            return Err(SavedError::Format(saved["format"].as_str().unwrap_or("no format").into(), FORMAT));
        }
        let settings = serde_json::from_value(saved["settings"].take()).map_err(|e| broken(&e))?;
        let mut loaded = Self::new(settings).map_err(|e| broken(&e))?;
        loaded.state = serde_json::from_value(saved["state"].take()).map_err(|e| broken(&e))?;
        loaded.reasons = serde_json::from_value(saved["reasons"].take()).map_err(|e| broken(&e))?;
        Ok(loaded)
    }
}

/// Number of rows shorter than 5Ti, and the time of those since the last row that were not kept \[s\].
#[derive(Clone, Copy, Debug, Default)]
struct Short {
    rows: usize,
    passed: f64,
}

impl Short {
    /// Counts a half-period, and adds it to the table if it is not one more of the short ones.
    fn keep(&mut self, rows: &mut Vec<Row>, reasons: &mut [u64; Reason::ALL.len()], row: Row) {
        reasons[row.record.reason() as usize] += 1;
        if row.record.mask & Reason::TooShort.bit() != 0 {
            if self.rows >= SHORT_KEPT {
                let half = row.record.half;
                self.passed += if half.flags & (DATA_GAP | BAD | NOT_AUTO) == 0 { half.delta_t } else { 0.0 };
                return;
            }
            self.rows += 1;
        }
        rows.push(Row { passed: std::mem::take(&mut self.passed), ..row });
    }
}

/// The swing under way, and the time of the last sample \[s\].
#[derive(Clone, Copy, Debug, Default)]
struct Swinging {
    state: SwingState<f64>,
    t: Option<f64>,
}

impl Swinging {
    /// Adds the samples of one half-period to the swing.
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

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_lanes::Instructions;

    /// PV about an SP that is 0: waves of changing height and length, noise between them, now and then a gap, a bad value and
    /// a time in manual.
    fn recorded(n: usize, seed: u64) -> [Vec<f64>; 3] {
        let mut random = seed;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1u64 << 53) as f64
        };
        let (mut t, mut pv, mut op) = (Vec::new(), Vec::new(), Vec::new());
        let (mut now, mut level) = (0.0, 1.0);
        while t.len() < n {
            let (height, rows) = (0.5 + next(), if next() < 0.2 { 3.0 } else { 60.0 + 60.0 * next() });
            let calm = next() < 0.7;
            level = -level;
            now += if next() < 0.02 { 20.0 } else { 0.0 };
            for k in 0..rows as usize {
                now += 1.0;
                t.push(now);
                let noise = if calm { 0.1 } else { 3.0 } * (next() - 0.5);
                pv.push(if next() < 0.001 { f64::NAN } else { level * height + noise });
                op.push(50.0 - level * (height + k as f64 / 20.0) + noise);
            }
        }
        [t, pv, op]
    }

    fn crossings(kp: Option<f64>, td: f64, op: bool, [t, pv, values]: &[Vec<f64>; 3]) -> Crossings {
        let settings = DetectorSettings { kp, n: 5, ..DetectorSettings::new(0.5, 8.0, td, 1.0) };
        let mut crossings = Crossings::new(settings).unwrap();
        let flags: Vec<u8> = (0..t.len()).map(|k| u8::from(k % 5000 < 30)).collect();
        for rows in (0..t.len()).step_by(7000).map(|k| k..t.len().min(k + 7000)) {
            crossings.take_closely(Columns {
                t: &t[rows.clone()],
                sp: &vec![0.0; rows.len()],
                pv: &pv[rows.clone()],
                op: op.then(|| &values[rows.clone()]),
                flags: Some(&flags[rows]),
            });
        }
        crossings
    }

    #[test]
    fn side_by_side_as_alone_on_every_instruction_set() {
        let recordings: Vec<_> = (0..11).map(|seed| recorded(9000 + 500 * seed as usize, seed)).collect();
        let empty = |i: usize| {
            let settings = DetectorSettings { n: 5, ..DetectorSettings::new(0.5, 8.0, 0.0, 1.0 + 0.1 * i as f64) };
            Crossings::new(DetectorSettings { tf: 0.5 * i as f64, ..settings }).unwrap()
        };
        let zero = vec![0.0; 20_000];
        for op in [false, true] {
            let columns = |i: usize, from: usize, to: usize| {
                let [t, pv, values] = &recordings[i];
                let rows = from..to.min(t.len());
                let op = op.then(|| &values[rows.clone()]);
                Columns { t: &t[rows.clone()], sp: &zero[..rows.len()], pv: &pv[rows], op, flags: None }
            };
            let alone: Vec<_> = (0..11)
                .map(|i| {
                    let mut one = empty(i);
                    [(0, 5000), (5000, 99_999)].into_iter().for_each(|(from, to)| one.take(columns(i, from, to)));
                    one
                })
                .collect();
            assert!(alone.iter().all(|one| one.rows().len() > 20));
            for instructions in Instructions::available() {
                for n in [1, 4, 8, 11] {
                    let mut together: Vec<_> = (0..n).map(empty).collect();
                    for (from, to) in [(0, 5000), (5000, 99_999)] {
                        let columns: Vec<_> = (0..n).map(|i| columns(i, from, to)).collect();
                        Crossings::take_together(&mut together.iter_mut().collect::<Vec<_>>(), &columns, instructions);
                    }
                    for (one, alone) in together.iter().zip(&alone) {
                        assert_eq!(format!("{one:?}"), format!("{alone:?}"), "{}", instructions.name());
                    }
                }
            }
        }
    }

    #[test]
    fn judged_again_is_run_again() {
        let mut differ = 0;
        for seed in 0..3 {
            let recorded = recorded(15_000, seed);
            for (td, op) in [(0.0, false), (0.0, true), (2.0, false), (2.0, true)] {
                let once = crossings(None, td, op, &recorded);
                for kp in [Some(0.2), Some(-0.8), Some(40.0), None] {
                    let again = once.with_gain(kp).unwrap();
                    let anew = crossings(kp, td, op, &recorded);
                    assert_eq!(format!("{again:?}"), format!("{anew:?}"));
                    let back = again.with_gain(None).unwrap();
                    assert_eq!(format!("{back:?}"), format!("{once:?}"));
                    let others = again.rows().iter().zip(once.rows()).filter(|(a, b)| a.record.mask != b.record.mask);
                    differ += others.count();
                }
            }
        }
        assert!(differ > 100, "{differ} half-periods are judged otherwise with another gain");
    }

    #[test]
    fn what_the_table_does_not_keep_enters_as_one_time() {
        // Noise of more short half-periods than are kept, between waves.
        let wave = |k: usize| if (k / 50).is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut pv: Vec<f64> = (0..5000).map(wave).collect();
        pv.extend((0..3 * SHORT_KEPT).map(|k| if k.is_multiple_of(2) { 1.0 } else { -1.0 }));
        pv.extend((0..5000).map(|k| 0.3 * wave(k)));
        let run = |kp| {
            let settings = DetectorSettings { kp, n: 5, tf: 0.0, ..DetectorSettings::new(0.5, 8.0, 0.0, 1.0) };
            let mut crossings = Crossings::new(settings).unwrap();
            let t: Vec<f64> = (0..pv.len()).map(|k| k as f64).collect();
            crossings.take(Columns { t: &t, sp: &vec![0.0; t.len()], pv: &pv, op: None, flags: None });
            crossings
        };
        let once = run(None);
        assert!(once.reasons().iter().sum::<u64>() > once.rows().len() as u64);
        assert!(once.rows().iter().any(|row| row.passed > SHORT_KEPT as f64));
        let (again, anew) = (once.with_gain(Some(0.7)).unwrap(), run(Some(0.7)));
        assert_eq!(again.reasons(), anew.reasons());
        assert_eq!(again.rows(), anew.rows());
        assert_eq!(again.state().shown(), anew.state().shown());
    }

    #[test]
    fn a_gain_of_nothing_is_refused() {
        let crossings = crossings(None, 0.0, false, &recorded(100, 0));
        assert_eq!(crossings.with_gain(Some(0.0)).unwrap_err().name, "kp");
    }
}
