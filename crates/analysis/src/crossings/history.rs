//! Crossings over a history that is longer than memory: it comes in pieces, and the state goes from one to the next.

use super::verdict::{SAMPLES, Verdict, Why, verdict_of};
use super::{Crossings, Ladder, SavedError};
use glapp_core::{Columns, DetectorSettings, ParameterError, Reason};
use glapp_lanes::Instructions;
use serde::Serialize;
use serde_json::{Value, json};

/// Format of a saved history.
const FORMAT: &str = "glapp history 1";

/// Accepted half-periods by their samples; the last place: as many as are enough, or more.
type Lengths = [u64; SAMPLES as usize + 1];

/// The detectors of a ladder over a history that comes in pieces. Their tables are let go of, so that it takes the same memory
/// however long the history is.
///
/// What it answers hangs on the samples alone, to the bit: not on where the pieces end, nor on whether it was saved and loaded
/// between them.
///
/// ```
/// use glapp_analysis::crossings::{History, Verdict};
/// use glapp_core::{Columns, DetectorSettings};
///
/// let settings = DetectorSettings { n: 3, tf: 0.001, kp: Some(2.0), ..DetectorSettings::new(0.5, 10.0, 0.0, 1.0) };
/// let t: Vec<f64> = (0..800).map(f64::from).collect();
/// let pv: Vec<f64> = (0..800).map(|k| if k / 100 % 2 == 0 { -1.0 } else { 1.0 }).collect();
/// let mut history = History::new(settings, true)?;
/// for piece in [0..350, 350..800] {
///     history.take(Columns { t: &t[piece.clone()], sp: &vec![0.0; piece.len()], pv: &pv[piece], op: None, flags: None });
///     history = History::load(&history.save()).unwrap();
/// }
/// assert_eq!(history.heard().crossings, Verdict::Estimate);
/// assert!((history.heard().d_hat.unwrap() - 4.5).abs() < 0.001);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct History {
    ladder: Ladder,
    lengths: Vec<Lengths>,
}

/// State of a loop's history so far.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Heard {
    /// Verdict.
    pub crossings: Verdict,
    /// Why no more.
    pub why: Option<Why>,
    /// The width, where it may be shown [OP unit].
    pub d_hat: Option<f64>,
    /// The noise limit [OP unit].
    pub noise_floor: Option<f64>,
    /// Accepted half-periods.
    pub detections: u64,
    /// All half-periods.
    pub half_periods: u64,
    /// Number of rejected half-periods by their first reason.
    pub reasons: Vec<(&'static str, u64)>,
    /// The filter time that is taken \[s\].
    pub tf: f64,
}

impl History {
    /// A history at its beginning, with the filter time of the settings where it is `given`, else with all of a ladder.
    ///
    /// # Errors
    ///
    /// Where a setting is out of its bounds.
    pub fn new(settings: DetectorSettings<f64>, given: bool) -> Result<Self, ParameterError> {
        let ladder = Ladder::new(settings, given)?;
        Ok(Self { lengths: vec![Lengths::default(); ladder.rungs().len()], ladder })
    }

    /// Takes the next samples.
    pub fn take(&mut self, columns: Columns<'_, f64>) {
        let rungs = self.ladder.rungs_mut();
        let alike = vec![columns; rungs.len()];
        Crossings::take_together(&mut rungs.iter_mut().collect::<Vec<_>>(), &alike, Instructions::widest());
        for (rung, lengths) in rungs.iter_mut().zip(&mut self.lengths) {
            for row in rung.drain().iter().filter(|row| row.record.mask == 0) {
                lengths[(row.record.half.n as usize).min(SAMPLES as usize)] += 1;
            }
        }
    }

    /// State of the detector with the best filter time ([`Ladder::choose`]).
    pub fn heard(&self) -> Heard {
        let chosen = self.ladder.choose();
        let rung = &self.ladder.rungs()[chosen];
        let (crossings, why) = verdict_of(rung, || middle(&self.lengths[chosen]));
        let has_width = matches!(crossings, Verdict::Estimate | Verdict::Provisional);
        let rejected = Reason::ALL.iter().zip(rung.reasons()).skip(1).filter(|(_, count)| **count > 0);
        Heard {
            crossings,
            why,
            d_hat: rung.state().estimate().filter(|_| has_width).map(|estimate| estimate.value),
            noise_floor: rung.state().noise_floor(),
            detections: rung.accepted(),
            half_periods: rung.reasons().iter().sum(),
            reasons: rejected.map(|(reason, count)| (reason.name(), *count)).collect(),
            tf: rung.settings().tf,
        }
    }

    /// Settings and state as JSON.
    pub fn save(&self) -> String {
        let rungs: Vec<Value> = self.ladder.rungs().iter().map(super::Crossings::saved).collect();
        json!({ "format": FORMAT, "rungs": rungs, "lengths": self.lengths }).to_string()
    }

    /// The history that [`Self::save`] saved.
    ///
    /// # Errors
    ///
    /// Where it is not one, or another release saved it.
    pub fn load(text: &str) -> Result<Self, SavedError> {
        let broken = |error: &dyn std::fmt::Display| SavedError::Broken(error.to_string());
        let mut saved: Value = serde_json::from_str(text).map_err(|e| broken(&e))?;
        if saved["format"] != FORMAT {
            return Err(SavedError::Format(saved["format"].as_str().unwrap_or("no format").into(), FORMAT));
        }
        let lengths: Vec<Lengths> = serde_json::from_value(saved["lengths"].take()).map_err(|e| broken(&e))?;
        let Value::Array(rungs) = saved["rungs"].take() else { return Err(broken(&"has no detectors")) };
        let ladder = Ladder::of(rungs.into_iter().map(super::Crossings::loaded).collect::<Result<_, _>>()?);
        if ladder.rungs().is_empty() || ladder.rungs().len() != lengths.len() {
            return Err(broken(&"has no detectors"));
        }
        Ok(Self { ladder, lengths })
    }
}

/// Median of the samples, where it is below what is enough.
fn middle(lengths: &Lengths) -> f64 {
    let count: u64 = lengths.iter().sum();
    let at = |rank: u64| {
        let mut below = 0;
        let found = lengths.iter().position(|n| {
            below += n;
            below > rank
        });
        found.map_or(SAMPLES, |n| n as f64)
    };
    if count == 0 { SAMPLES } else { 0.5 * (at((count - 1) / 2) + at(count / 2)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossings::{Known, judge};

    /// Waves of growing noise about an SP that is 0, with a break and a bad value now and then.
    fn recorded(n: usize, seed: u64, wave: usize) -> [Vec<f64>; 3] {
        let mut random = seed;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut now = 1_700_000_000.0;
        let mut columns = [Vec::new(), Vec::new(), Vec::new()];
        for k in 0..n {
            now += if next() < 0.0005 { 40.0 } else { 1.0 };
            let level = if (k / wave).is_multiple_of(2) { 1.0 } else { -1.0 };
            let noise = (k as f64 / n as f64) * (next() - 0.5);
            let pv = if next() < 0.0005 { f64::NAN } else { level + noise };
            for (column, x) in columns.iter_mut().zip([now, pv, 50.0 - 3.0 * level * (k % wave) as f64 / wave as f64]) {
                column.push(x);
            }
        }
        columns
    }

    fn settings() -> DetectorSettings<f64> {
        DetectorSettings { kp: Some(2.0), ..DetectorSettings::new(0.5, 8.0, 1.0, 1.0) }
    }

    fn columns<'a>([t, pv, op]: &'a [Vec<f64>; 3], sp: &'a [f64], of: std::ops::Range<usize>) -> Columns<'a, f64> {
        Columns { t: &t[of.clone()], sp: &sp[of.clone()], pv: &pv[of.clone()], op: Some(&op[of]), flags: None }
    }

    #[test]
    fn where_the_pieces_end_changes_no_bit() {
        let mut widths = 0;
        for seed in 0..4 {
            let recorded = recorded(30_000, seed, 120);
            let sp = vec![0.0; recorded[0].len()];
            let mut once = History::new(settings(), false).unwrap();
            once.take(columns(&recorded, &sp, 0..sp.len()));
            for step in [1777, 9000, 29_999] {
                let mut pieces = History::new(settings(), false).unwrap();
                for from in (0..sp.len()).step_by(step) {
                    pieces.take(columns(&recorded, &sp, from..sp.len().min(from + step)));
                    pieces = History::load(&pieces.save()).unwrap();
                }
                assert_eq!(pieces.save(), once.save());
                assert_eq!(pieces.heard(), once.heard());
            }
            widths += u32::from(once.heard().d_hat.is_some());
        }
        assert_eq!(widths, 4);
    }

    #[test]
    fn it_says_what_is_said_of_a_recording() {
        for (wave, seed) in [(120, 1), (41, 2), (9, 3)] {
            let recorded = recorded(6000, seed, wave);
            let sp = vec![0.0; recorded[0].len()];
            let mut ladder = Ladder::new(settings(), false).unwrap();
            let mut history = History::new(settings(), false).unwrap();
            for rung in ladder.rungs_mut() {
                rung.take(columns(&recorded, &sp, 0..sp.len()));
            }
            history.take(columns(&recorded, &sp, 0..sp.len()));
            let (_, crossings) = ladder.chosen();
            let known = Known { exclusion: None, sp: true, op: true, findings: &[] };
            let heard = history.heard();
            assert_eq!((heard.crossings, heard.why), judge(&known, Some(&crossings)));
            assert_eq!((heard.detections, heard.tf), (crossings.accepted(), crossings.settings().tf));
        }
    }

    #[test]
    fn half_periods_of_few_samples_are_counted_as_a_recording_counts_them() {
        let lengths = |of: &[usize]| {
            let mut lengths = Lengths::default();
            for n in of {
                lengths[(*n).min(SAMPLES as usize)] += 1;
            }
            middle(&lengths)
        };
        assert_eq!(lengths(&[3, 5, 900]), 5.0);
        assert_eq!(lengths(&[3, 5, 6, 900]), 5.5);
        assert_eq!(lengths(&[3, 50, 900]), SAMPLES);
        assert_eq!(lengths(&[]), SAMPLES);
    }

    #[test]
    fn what_is_no_history_is_refused() {
        let saved = History::new(settings(), true).unwrap().save();
        let other = saved.replace(FORMAT, "glapp history 0");
        assert!(matches!(History::load(&other), Err(SavedError::Format(..))));
        assert!(matches!(History::load("{"), Err(SavedError::Broken(_))));
        assert!(matches!(
            History::load(&saved.replace("\"lengths\":[[", "\"lengths\":[[0,0,0,0,0,0,0,0,0,0,0],[")),
            Err(SavedError::Broken(_))
        ));
    }
}
