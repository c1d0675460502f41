//! Verdict and interval from the best motions.

use crate::data::recorder::Recorder;
use crate::decide::judgement::Verdict;
use crate::decide::thresholds::{
    CYCLES_IF_CLEAR, LEAST_LOW, LR_IF_SELDOM, LR_JUMP, LR_MIN, POSITION_ALL_JUMP, POSITION_EXPLAINED, RISE,
    RISE_OF_STICKING, SOUND_BELOW,
};
use crate::position::track::{LANES, Motion, Track, Tried};
use crate::position::{AtValve, Shown};

/// Rows that are shown beside the model.
const SHOWN: usize = 8000;

impl Track {
    /// Information on d that is left, and how often the valve turned each way. What the model leaves may be alike as long as
    /// the valve goes one way: each such way counts as one observation, not each row.
    fn information_ratio(&self, best: &Tried) -> (f64, [usize; 2]) {
        let mut mean = 0.0;
        self.residuals(best, |_, _, state, _| mean += state.way);
        mean /= self.rows as f64;
        let (mut alone, mut together, mut sum, mut ways) = (0.0, 0.0, 0.0, 0);
        let mut last = (usize::MAX, 0.0);
        let mut turns = [0; 2];
        self.residuals(best, |i, _, state, r| {
            if last != (i, state.way) {
                if last.0 == i && last.1 != 0.0 {
                    turns[usize::from(state.way < 0.0)] += 1;
                }
                last = (i, state.way);
                together += sum * sum;
                sum = 0.0;
                ways += 1;
            }
            let slope = state.way - mean;
            sum += r * slope;
            alone += r * r * slope * slope;
        });
        together += sum * sum;
        let ways = ways as f64;
        // A row is never sure of more than the recorder's floor.
        let slack = self.floor * self.rows as f64;
        let few = ((ways - 2.0) / ways).max(0.1);
        ((few * (alone + slack) / (together + slack).max(1e-300)).min(1.0), turns)
    }

    pub(super) fn answer(mut self) -> AtValve {
        let mut found = self.search();
        let best = found.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("three");
        if self.without_outliers(&best) {
            found = self.search();
        }
        let [gap, none, stuck] = found;
        let (information_ratio, _) = self.information_ratio(&gap);
        let lr_no_jump = (gap.cost - stuck.cost).max(0.0) * information_ratio;
        let step = match self.recorder {
            Recorder::Plain => 0.0,
            Recorder::Rounded(step) | Recorder::Kept(step) => step,
        };
        let per_op = gap.b.abs().max(1e-300);
        let slips = lr_no_jump > LR_JUMP && stuck.motion.d * stuck.motion.share > 2.0 * step / per_op;
        let best = if slips { stuck } else { gap };
        let (information_ratio, traversals) = self.information_ratio(&best);
        let lr_no_gap = (none.cost - best.cost).max(0.0) * information_ratio;
        let (low, high) = self.interval(&gap, &stuck, slips, information_ratio);
        // A position that stands still is explained by nothing.
        let explained = if best.b == 0.0 { 0.0 } else { 1.0 - best.left * self.rows as f64 / self.zz };
        let lr_needed = if traversals.iter().min() >= Some(&CYCLES_IF_CLEAR) { LR_MIN } else { LR_IF_SELDOM };
        let copy = none.b != 0.0 && none.left.sqrt() <= 1e-7 * self.range * none.b.abs() && none.motion.lag == 0.0;
        let (verdict, reason) = if copy {
            (Verdict::CannotTell, "copy")
        } else if explained < POSITION_EXPLAINED {
            (Verdict::CannotTell, "no_answer")
        } else if lr_no_gap <= lr_needed || low <= 0.0 {
            match high {
                Some(high) if high < SOUND_BELOW * self.range => (Verdict::Sound, "no_gap"),
                _ => (Verdict::CannotTell, "may_be_a_gap"),
            }
        } else if low < LEAST_LOW * best.motion.d {
            (Verdict::CannotTell, "may_be_a_gap")
        } else if high.is_none() || traversals.iter().any(|n| *n < CYCLES_IF_CLEAR) {
            (Verdict::AtLeast, "not_traversed")
        } else if slips {
            if best.motion.share > POSITION_ALL_JUMP {
                (Verdict::Stiction, "jumps")
            } else {
                (Verdict::Both, "jumps_in_a_gap")
            }
        } else {
            (Verdict::Backlash, "gap")
        };
        AtValve {
            verdict,
            reason,
            d: best.motion.d,
            low: if verdict == Verdict::Sound { 0.0 } else { low },
            high,
            jump: best.motion.share * best.motion.d,
            lr_no_gap,
            lr_needed,
            lr_no_jump,
            information_ratio,
            rise: if slips { RISE_OF_STICKING } else { RISE },
            traversals,
            gain: best.b,
            delay: best.motion.delay,
            lag: best.motion.lag,
            sigma: best.left.sqrt(),
            explained,
            recorder: self.recorder,
            rows: self.rows,
            spikes: self.spikes,
            range: self.range,
            profile: self.profile(&best, &none, information_ratio),
            shown: self.shown(&best),
        }
    }

    /// Limits of the width, those of a valve that sticks among them where it is as likely, moved out by what the recorder hides; no upper
    /// limit where OP does not reach one.
    fn interval(&self, gap: &Tried, stuck: &Tried, slips: bool, information_ratio: f64) -> (f64, Option<f64>) {
        let best = if slips { stuck } else { gap };
        let rise = RISE / information_ratio;
        let (low, high) = if slips {
            self.limits(stuck, stuck.cost + RISE_OF_STICKING / information_ratio)
        } else {
            let (low, high) = self.limits(gap, gap.cost + rise);
            if stuck.cost < gap.cost + rise {
                let (lower, higher) = self.limits(stuck, gap.cost.min(stuck.cost) + rise);
                (low.min(lower), high.zip(higher).map(|(high, higher)| high.max(higher)))
            } else {
                (low, high)
            }
        };
        // At most the residual where rows do not fit.
        let per_op = gap.b.abs().max(1e-300);
        let seen = 4.0 * best.left.sqrt() / per_op;
        let (rounding, kept) = match self.recorder {
            Recorder::Plain => (0.0, 0.0),
            Recorder::Rounded(step) => (0.5 * step / per_op, 0.0),
            Recorder::Kept(band) => (0.0, band / per_op),
        };
        let least = 1e-4 * best.motion.d + 1e-6 * self.range;
        let op = (2.0 * self.op_band).min(seen) + rounding + least;
        let low = (low - op - (0.5 * self.op_move).min(seen)).max(0.0);
        let high = high.map(|high| high + op + (1.5 * self.op_move).min(seen) + kept);
        (low, high)
    }

    /// The best candidate with the width of `at`, and the lag (and share of jump) that is best from there on.
    fn beside(&self, best: &Tried, at: Tried) -> Tried {
        if best.motion.share > 0.0 {
            return self.descend(at, |m, i, j| Motion {
                share: (m.share + 0.1 * i).clamp(0.02, 1.0),
                lag: (m.lag + 0.5 * j).max(0.0),
                ..m
            });
        }
        let lags = self.lags(at);
        let by = |by| self.at(Motion { delay: best.motion.delay + by, ..lags.motion });
        [lags, by(1), by(-1)].into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("three")
    }

    /// The least and the greatest width at which the cost is below `limit`; None where there is no greatest.
    fn limits(&self, best: &Tried, limit: f64) -> (f64, Option<f64>) {
        (self.limit(best, limit, -1.0).unwrap_or(0.0), self.limit(best, limit, 1.0))
    }

    /// The first width below (`way` −1) or above (1) the best at which the cost is not below `limit`; None where there is none.
    fn limit(&self, best: &Tried, limit: f64, way: f64) -> Option<f64> {
        let d = best.motion.d;
        let end = if way < 0.0 { 0.0 } else { self.range };
        let mut by = 1e-3 * d.max(0.01 * self.range);
        let mut inner = best.motion;
        for _ in 0..60 {
            if inner.d == end {
                return None;
            }
            let at = |l: usize| (inner.d + way * by * f64::from(1u8 << l)).clamp(0.0, self.range);
            let tried = self.weigh(&std::array::from_fn(|l| Motion { d: at(l), ..inner }));
            let inside = tried.iter().take_while(|t| t.cost <= limit).count();
            if inside > 0 {
                inner = tried[inside - 1].motion;
            }
            if inside == LANES {
                by *= 16.0;
                continue;
            }
            // A width outside with this lag may be inside with another.
            let outer = self.beside(best, tried[inside]);
            if outer.cost <= limit {
                inner = outer.motion;
            } else if (outer.motion.d - inner.d).abs() <= (0.1 * (outer.motion.d - d).abs()).max(1e-6 * self.range) {
                return Some(outer.motion.d);
            } else {
                by = (outer.motion.d - inner.d).abs() / 16.0;
            }
        }
        Some(inner.d)
    }

    /// The likelihood over the width, from none to a few times the best, all but that of none with the lag of the best.
    fn profile(&self, best: &Tried, none: &Tried, information_ratio: f64) -> Vec<(f64, f64)> {
        let most = (3.0 * best.motion.d).max(0.1 * self.range).min(self.range);
        let mut points = vec![(0.0, none.cost), (best.motion.d, best.cost)];
        for turn in 0..4 {
            let d = |l: usize| most * (turn * LANES + l + 1) as f64 / (4 * LANES) as f64;
            let tried = self.weigh(&std::array::from_fn(|l| Motion { d: d(l), ..best.motion }));
            points.extend(tried.map(|t| (t.motion.d, t.cost)));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by_key(|point| point.0);
        points.into_iter().map(|(d, cost)| (d, ((cost - best.cost) * information_ratio).max(0.0))).collect()
    }

    /// Recorded and predicted positions of some rows, for display.
    fn shown(&self, best: &Tried) -> Vec<Shown> {
        let every = self.rows.div_ceil(SHOWN);
        let mut n = 0;
        let mut shown = Vec::new();
        self.residuals(best, |i, k, state, r| {
            if n % every == 0 {
                let recorded = self.parts[i].z[k];
                let part = self.parts[i].place;
                shown.push(Shown { part, row: k, recorded, predicted: recorded - r, valve: state.valve });
            }
            n += 1;
        });
        shown
    }
}
