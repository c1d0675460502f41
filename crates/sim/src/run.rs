//! A scenario, run: into columns, past a detector, or only checked.

use crate::SimError;
use crate::engine::{self, Run};
use crate::scenario::{Block, CHUNK, Columns, Scenario, Seen};
use glapp_core::{Detector, DetectorState};

impl Scenario {
    /// Runs the loop from t = 0 to `t_end`.
    ///
    /// A scenario gives the same bits every time.
    pub fn run(&self) -> Result<Columns, SimError> {
        let mut columns = Columns::of_length(self.samples()?, self);
        let n = self.run_into(&mut columns.block())?;
        columns.shorten(n);
        Ok(columns)
    }

    /// Samples between t = 0 and `t_end`, recorded or lost.
    pub fn samples(&self) -> Result<usize, SimError> {
        engine::samples(self.h, self.t_end)
    }

    /// [`Self::run`] into columns of [`Self::samples`] that are there already; gives how many of them are recorded.
    ///
    /// # Panics
    /// Where the columns are of another length.
    pub fn run_into(&self, block: &mut Block<'_>) -> Result<usize, SimError> {
        let mut run = Run::new(self, false)?;
        assert_eq!(block.t.len(), run.n, "as many rows as samples");
        for first in (0..run.n).step_by(CHUNK) {
            run.advance(&mut block.part(first..(first + CHUNK).min(run.n)), first)?;
        }
        Ok(engine::Recorder::new(self)?.record(block))
    }

    /// Runs the loop, shows it to `detector` and forgets it: the same as with the detector over [`Self::run`].
    pub fn watch(&self, detector: &Detector<f64>) -> Result<Seen, SimError> {
        let mut run = Run::new(self, false)?;
        let mut watcher = Watcher::new(self, detector)?;
        let mut columns = Columns::of_length(CHUNK.min(run.n), self);
        for first in (0..run.n).step_by(CHUNK) {
            let mut block = columns.block();
            let mut block = block.part(0..CHUNK.min(run.n - first));
            run.advance(&mut block, first)?;
            watcher.see(&mut block);
        }
        Ok(watcher.seen())
    }

    /// Checks everything that [`Self::run`] would refuse, short of an unstable loop.
    pub fn check(&self) -> Result<(), SimError> {
        Run::new(self, false)?;
        engine::Recorder::new(self)?;
        Ok(())
    }
}

/// A detector beside a run.
pub(crate) struct Watcher<'a> {
    detector: &'a Detector<f64>,
    state: DetectorState<f64>,
    recorder: engine::Recorder,
    half_periods: u32,
}

impl<'a> Watcher<'a> {
    pub(crate) fn new(scenario: &Scenario, detector: &'a Detector<f64>) -> Result<Self, SimError> {
        let recorder = engine::Recorder::new(scenario)?;
        Ok(Self { detector, state: DetectorState::default(), recorder, half_periods: 0 })
    }

    /// Takes the next samples.
    pub(crate) fn see(&mut self, block: &mut Block<'_>) {
        let n = self.recorder.record(block);
        let signals = glapp_core::Columns {
            t: &block.t[..n],
            sp: &block.sp[..n],
            pv: &block.pv[..n],
            op: Some(&block.op[..n]),
            flags: Some(&block.flags[..n]),
        };
        self.detector.run(&mut self.state, signals, |_, _| self.half_periods += 1, |_, _| {});
    }

    pub(crate) fn seen(&self) -> Seen {
        let (estimate, detections) = (self.state.estimate(), self.state.accepted());
        Seen { estimate, detections, half_periods: self.half_periods }
    }
}
