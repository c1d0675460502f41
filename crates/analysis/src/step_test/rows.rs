//! The rows of a recording that were made in manual, and the stretches of them without a gap.

use super::asked::Asked;
use super::{LEAST_ROWS, Manual, Note, Reason, StepTest, StepTestSettings, verdict};
use crate::{Inspected, median};
use glapp_core::DATA_GAP_STEPS;
use glapp_core::status::NOT_AUTO;
use std::ops::Range;

/// Collects the rows in manual of a recording, batch by batch, and reads the step test in them.
///
/// ```
/// use glapp_analysis::step_test::{Manual, ManualRows, StepTestSettings};
/// use glapp_analysis::Inspected;
/// // A valve with a dead band of 2 and a process of gain 0.5 without lag; OP is stepped up, up and back.
/// let op: Vec<f64> = [50.0, 54.0, 58.0, 53.0].iter().flat_map(|op| [*op; 40]).collect();
/// let valve = [50.0, 53.0, 57.0, 54.0];
/// let noise = |k: usize| ((k * k * 7919) % 1009) as f64 / 1e4;
/// let pv: Vec<f64> = (0..160).map(|k| 0.5 * valve[k / 40] + noise(k)).collect();
/// let t: Vec<f64> = (0..160).map(f64::from).collect();
/// let mut rows = ManualRows::new(Manual::All);
/// rows.take(&Inspected { t: &t, sp: None, pv: &pv, op: Some(&op), flags: None }, None);
/// let test = rows.read(&StepTestSettings::default());
/// let (low, high) = (test.low.unwrap(), test.high.unwrap());
/// assert!(low < 2.0 && 2.0 < high && high - low < 0.5, "{test:?}");
/// ```
#[derive(Clone, Debug)]
pub struct ManualRows {
    manual: Manual,
    has_op: bool,
    seen: usize,
    kept: ManualStretch,
    number: Vec<usize>,
}

/// Rows in manual, a value a row.
#[derive(Clone, Debug, Default)]
pub struct ManualStretch {
    /// \[s\].
    pub t: Vec<f64>,
    /// [PV unit].
    pub pv: Vec<f64>,
    /// [OP unit].
    pub op: Vec<f64>,
    /// The valve's position \[%\]; NaN where it was not recorded.
    pub position: Vec<f64>,
}

impl ManualRows {
    /// A table without rows.
    pub fn new(manual: Manual) -> Self {
        Self { manual, has_op: false, seen: 0, kept: ManualStretch::default(), number: Vec::new() }
    }

    /// Takes the next rows of the recording, with the valve's position where it was recorded.
    pub fn take(&mut self, rows: &Inspected<'_>, position: Option<&[f64]>) {
        let first = self.seen;
        self.seen += rows.t.len();
        let Some(op) = rows.op else { return };
        self.has_op = true;
        let in_manual = |k: usize| match self.manual {
            Manual::Flagged => rows.flags.is_some_and(|flags| u16::from(flags[k]) & NOT_AUTO != 0),
            Manual::All => true,
            Manual::Unknown => false,
        };
        for k in (0..rows.t.len()).filter(|k| in_manual(*k)) {
            self.kept.t.push(rows.t[k]);
            self.kept.pv.push(rows.pv[k]);
            self.kept.op.push(op[k]);
            self.kept.position.push(position.map_or(f64::NAN, |position| position[k]));
            self.number.push(first + k);
        }
    }

    /// The rows in manual.
    pub fn kept(&self) -> &ManualStretch {
        &self.kept
    }

    /// Reads the step test in the rows taken so far: off PV, and off the valve's position where it was recorded.
    pub fn read(&self, settings: &StepTestSettings) -> StepTest {
        let (integrating, asked) = (settings.integrating, settings.width.map(Asked::open));
        let refused = |reason| StepTest { integrating, asked, ..StepTest::refused(reason) };
        if !self.has_op {
            return refused(Reason::NoOp);
        }
        if self.manual == Manual::Unknown {
            return refused(Reason::NoMode);
        }
        let ManualStretch { t, pv, op, position } = &self.kept;
        if t.is_empty() {
            return refused(Reason::NeverManual);
        }
        let stretches = self.stretches();
        if stretches.is_empty() {
            return refused(Reason::NoStretch { rows: LEAST_ROWS });
        }
        let mut found = verdict::read(t, op, pv, &stretches, settings.integrating, settings.width);
        if position.iter().any(|x| x.is_finite()) {
            found.travel = Some(Box::new(verdict::read(t, op, position, &stretches, false, settings.width)));
        }
        if let Some(d) = found.d {
            let percent = settings.op_span.map(|span| span / 100.0);
            found.d_percent_span = percent.map(|percent| d / percent);
            if let Some(own) = settings.positioner_dead_band {
                found.notes.push(match percent {
                    None => Note::Positioner { percent: own },
                    Some(percent) => Note::PositionerOfSpan { percent: own, width: own * percent },
                });
            }
        }
        found
    }

    /// Runs of rows with OP and without a gap in time: a move in a gap would not be seen.
    fn stretches(&self) -> Vec<Range<usize>> {
        let ManualStretch { t, op, .. } = &self.kept;
        let mut forward: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).filter(|dt| *dt > 0.0).collect();
        if forward.is_empty() {
            return Vec::new();
        }
        let longest = DATA_GAP_STEPS * median(&mut forward);
        let together = |k: usize| {
            let dt = t[k] - t[k - 1];
            let in_a_row = self.number[k] - self.number[k - 1] == 1;
            dt > 0.0 && dt <= longest && in_a_row && op[k].is_finite() && op[k - 1].is_finite()
        };
        let mut cuts: Vec<usize> = vec![0];
        cuts.extend((1..t.len()).filter(|k| !together(*k)));
        cuts.push(t.len());
        cuts.windows(2).map(|cut| cut[0]..cut[1]).filter(|part| part.len() >= LEAST_ROWS).collect()
    }
}
