//! Many loops side by side.

use super::{Crossings, Row};
use glapp_core::{Columns, Detector, DetectorState, HalfPeriodResult, LANES, Lanes, Span};
use glapp_lanes::{Instructions, Sided};
use std::array;

/// Fewer loops are faster one by one.
const WORTHWHILE: usize = 3;

impl Crossings {
    /// [`take`](Self::take) for many loops, side by side in the lanes of the processor as long as their columns are alike; the
    /// same bits. Loops with columns of about the same length stand best next to each other.
    ///
    /// # Panics
    ///
    /// Where there are not as many columns as loops.
    pub fn take_together(all: &mut [&mut Self], columns: &[Columns<'_, f64>], instructions: Instructions) {
        assert_eq!(all.len(), columns.len(), "columns of each loop");
        for (loops, columns) in all.chunks_mut(LANES).zip(columns.chunks(LANES)) {
            let worthwhile = loops.len() >= WORTHWHILE;
            // Lanes to spare repeat the last loop, and nobody listens.
            let of = |l: usize| l.min(columns.len() - 1);
            let mut states = array::from_fn(|l| loops[of(l)].state);
            let detectors = array::from_fn(|l| loops[of(l)].detector);
            let of_lanes = array::from_fn(|l| columns[of(l)]);
            let side = Side { detectors, states: &mut states, columns: of_lanes, loops: &mut *loops };
            if worthwhile && instructions.side_by_side(side) {
                loops.iter_mut().zip(states).for_each(|(one, state)| one.state = state);
            } else {
                loops.iter_mut().zip(columns).for_each(|(one, columns)| one.take(*columns));
            }
        }
    }

    #[inline(never)]
    fn end(&mut self, span: Span, record: &HalfPeriodResult<f64>) {
        self.short.keep(&mut self.rows, &mut self.reasons, Row { span, record: *record, swing: None, passed: 0.0 });
    }
}

struct Side<'a, 'b, 'c> {
    detectors: [Detector<f64>; LANES],
    states: &'a mut [DetectorState<f64>; LANES],
    columns: [Columns<'b, f64>; LANES],
    loops: &'a mut [&'c mut Crossings],
}

impl Sided for Side<'_, '_, '_> {
    #[inline(always)]
    fn with(self, like: impl Lanes) {
        let Self { detectors, states, columns, loops } = self;
        Detector::run_together(like, &detectors, states, &columns, |l, span, record| {
            if let Some(one) = loops.get_mut(l) {
                one.end(span, record);
            }
        });
    }
}
