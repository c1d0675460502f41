//! Fit of one segment, as it is handed over.

use crate::data::signal::Unit;
use crate::decide::evidence::Evidence;
use crate::decide::judgement::{Judgement, Verdict};
use glapp_model::structure::Structure;
use serde::{Deserialize, Serialize};

/// One family's view.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Candidate {
    /// The family.
    pub structure: Structure,
    /// −2·ln L over that of the best family.
    pub delta_deviance: f64,
    /// Best width [OP unit].
    pub d: f64,
    /// Likelihood ratio −2·Δln L of no gap against the best width.
    pub lr_no_gap: f64,
    /// The profile: width [OP unit] and −2·Δln L over this family's best.
    pub profile: Vec<(f64, f64)>,
}

/// A cell of PV beside the best model.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Prediction {
    /// Part of the record, in the order given.
    pub part: usize,
    /// First step of the cell within it.
    pub step: usize,
    /// Mean of PV [PV unit].
    pub pv: f64,
    /// The model's foresight of it, from all that was before [PV unit].
    pub predicted: f64,
    /// Position of the valve [OP unit].
    pub position: f64,
}

/// Fit of one segment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SegmentFit {
    /// Judgement on the record.
    pub judgement: Judgement,
    /// Verdict in one word, which claims only a found gap.
    pub verdict: Verdict,
    /// Most likely total width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where the record gives none.
    pub high: Option<f64>,
    /// Slip jump J [OP unit], 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap: the least over all families that predict PV nearly as well as the best, times `information_ratio`.
    pub lr_no_gap: f64,
    /// Ratio that `lr_no_gap` must exceed for a gap, 1 % of records without one do.
    pub lr_needed: f64,
    /// Likelihood ratio of J = 0 against the best J.
    pub lr_no_jump: f64,
    /// Likelihood ratio of a process that does not answer at all.
    pub lr_no_answer: f64,
    /// Share of the likelihood's own information on d that the innovations support, 0 to 1.
    pub information_ratio: f64,
    /// Allowed rise of −2·ln L within the interval.
    pub rise: f64,
    /// Times that OP goes through the whole width up and down.
    pub traversals: [usize; 2],
    /// Static gain [PV unit/OP unit]; velocity gain [PV unit/(OP unit·s)] of an integrating process.
    pub kp: f64,
    /// 95 % limits of Kp.
    pub kp_limits: (f64, f64),
    /// 95 % limits of Kp by the likelihood alone, as if the model were right.
    pub kp_near: (f64, f64),
    /// Dead time [s].
    pub dead_time: f64,
    /// 95 % limits of the dead time.
    pub dead_time_limits: (f64, f64),
    /// Lags together: the first-order coefficient of the denominator, behind an integrator if there is one [s].
    pub lag: f64,
    /// 95 % limits of the lag.
    pub lag_limits: (f64, f64),
    /// 95 % limits of the lag by the likelihood alone [s].
    pub lag_near: (f64, f64),
    /// Whether the process integrates.
    pub integrating: bool,
    /// Coefficients of 1, s, s², s³ in the denominator of the process [1, s, s², s³]; behind an integrator the first is 0, the
    /// second 1, and the units are [s⁻¹, 1, s, s²].
    pub denominator: [f64; 4],
    /// Settling time of PV after a move of OP: the lags; behind an integrator with the dead time [s].
    pub settles: f64,
    /// Standard deviation of the model's prediction error of PV, a cell ahead [PV unit].
    pub sigma: f64,
    /// Correlation of that with the same a cell before: far from 0 where the model is not of this record.
    pub autocorrelation: f64,
    /// Cells of PV that were used, and their length [s].
    pub cells: usize,
    /// Length of a cell [s].
    pub cell: f64,
    /// Widest move of OP within one stretch [OP unit].
    pub range: f64,
    /// Steps of the load that were found and taken out.
    pub load_steps: usize,
    /// The families, best first.
    pub candidates: Vec<Candidate>,
    /// Predictions of PV by the best model, for each cell.
    pub predictions: Vec<Prediction>,
    /// Evidence of the judgement.
    pub evidence: Evidence,
    /// Reason of the verdict, a word that `glapp` turns into a sentence; not handed over, for the evidence gives it.
    #[serde(skip)]
    pub reason: &'static str,
}

impl SegmentFit {
    /// Whether a model of this kind made the record, and PV answers OP in it.
    pub(crate) fn usable(&self) -> bool {
        !matches!(self.reason, "misfit" | "no_answer")
    }

    /// Converts to units where OP's and PV's units were `op` and `pv`, and their zeros lay elsewhere.
    pub(crate) fn in_units(&mut self, op: Unit, pv: Unit) {
        for width in [&mut self.d, &mut self.low, &mut self.jump, &mut self.range] {
            *width *= op.size;
        }
        self.high = self.high.map(|high| high * op.size);
        self.evidence.in_units(op);
        let gain = pv.size / op.size;
        self.kp *= gain;
        for limits in [&mut self.kp_limits, &mut self.kp_near] {
            *limits = (limits.0 * gain, limits.1 * gain);
        }
        self.sigma *= pv.size;
        for candidate in &mut self.candidates {
            candidate.d *= op.size;
            candidate.profile.iter_mut().for_each(|(d, _)| *d *= op.size);
        }
        for seen in &mut self.predictions {
            (seen.pv, seen.predicted) = (pv.zero + seen.pv * pv.size, pv.zero + seen.predicted * pv.size);
            seen.position = op.zero + seen.position * op.size;
        }
    }
}
