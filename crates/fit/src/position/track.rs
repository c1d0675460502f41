//! The rows that count, and the cost of a lost motion on them: eight motions in a pass.

use crate::data::recorder::{FEWEST_NEW, Moves, Recorder, only_new, span, spike_limit, spikes_in};
use crate::data::segment::OpAndPv;
use glapp_core::{Backlash, BacklashState, Friction, FrictionState, Model};

/// Fewest rows with a position that count.
pub(super) const FEWEST: usize = 50;
/// Sets of parameters in one pass.
pub(super) const LANES: usize = 8;
/// Rows of the first look.
const LOOK: usize = 20_000;

/// Candidate: a lost motion, and the relation of the valve to its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    pub(super) d: f64,
    pub(super) share: f64,
    pub(super) model: Model,
    pub(super) delay: isize,
    pub(super) lag: f64,
}

impl Motion {
    pub(super) fn gap(d: f64, delay: isize, lag: f64) -> Self {
        Self { d, share: 0.0, model: Model::Kano, delay, lag }
    }
}

/// A motion with its cost: −2·ln L but for a constant, and the line a + b·v.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tried {
    pub(super) motion: Motion,
    pub(super) cost: f64,
    pub(super) a: f64,
    pub(super) b: f64,
    /// Mean square of the residual [position unit²].
    pub(super) left: f64,
}

/// One stretch. `z` is NaN in every row that does not count.
pub(super) struct Part {
    pub(super) place: usize,
    pub(super) z: Vec<f64>,
    pub(super) u: Vec<f64>,
    /// First recorded position of the valve.
    pub(super) first: f64,
}

/// The record, and the facts on it that no motion changes.
pub(super) struct Track {
    pub(super) parts: Vec<Part>,
    pub(super) recorder: Recorder,
    /// Possible moves of OP between rows: its lower edge of moves where OP itself is kept, and its median move [OP
    /// unit].
    pub(super) op_band: f64,
    pub(super) op_move: f64,
    pub(super) range: f64,
    /// Squares of the position about its mean, its mean, and OP's.
    pub(super) zz: f64,
    pub(super) z_mean: f64,
    pub(super) u_mean: f64,
    pub(super) rows: usize,
    pub(super) spikes: usize,
    /// Variance that no model can do without: the recorder's rounding, and the computer's.
    pub(super) floor: f64,
    /// Last place of the line, which gives the start in the gap.
    pub(super) line: (f64, f64),
    /// First step of a descent: shorter where a good beginning is known.
    pub(super) stride: f64,
}

impl Track {
    pub(super) fn new(parts: &[OpAndPv]) -> Self {
        let mut spikes = 0;
        let mut kept: Vec<Part> = Vec::new();
        let limit = spike_limit(parts);
        for (place, (z, u)) in parts.iter().enumerate() {
            let mut z = z.to_vec();
            for k in spikes_in(&z, limit) {
                z[k] = f64::NAN;
                spikes += 1;
            }
            if let Some(first) = z.iter().copied().find(|z| !z.is_nan()) {
                kept.push(Part { place, z, u: u.to_vec(), first });
            }
        }
        let op: Vec<&[f64]> = kept.iter().map(|p| p.u.as_slice()).collect();
        let op_moves = Moves::of(&op);
        let z: Vec<&[f64]> = kept.iter().map(|p| p.z.as_slice()).collect();
        let z_moves = Moves::of(&z);
        let range = kept.iter().map(|p| span(&p.u)).fold(0.0, f64::max);
        let z_span = kept.iter().map(|p| span(&p.z)).fold(0.0, f64::max);
        // Approximate move of the position by a move of OP.
        let per_op = if range > 0.0 { z_span / range } else { 1.0 };
        let recorder = z_moves.recorder(op_moves.least * per_op, z_span);
        if let Recorder::Kept(_) = recorder {
            kept.iter_mut().for_each(|p| only_new(&mut p.z));
        }
        let floor = match recorder {
            Recorder::Rounded(step) => step * step / 12.0,
            _ => 0.0,
        } + (1e-6 * z_span).powi(2);
        let mut track = Self {
            parts: kept,
            recorder,
            op_band: op_moves.band,
            op_move: op_moves.median,
            range,
            zz: 0.0,
            z_mean: 0.0,
            u_mean: 0.0,
            rows: 0,
            spikes,
            floor,
            line: (0.0, 1.0),
            stride: 1.0,
        };
        track.sum();
        track
    }

    /// Number of rows that count.
    pub(super) fn count(&self) -> usize {
        match self.recorder {
            // Few new values, but every one of them is true.
            Recorder::Kept(_) if self.rows >= FEWEST_NEW => self.rows.max(FEWEST),
            _ => self.rows,
        }
    }

    /// Sums that do not depend on the motion.
    pub(super) fn sum(&mut self) {
        let z = || self.parts.iter().flat_map(|p| &p.z).copied().filter(|z| !z.is_nan());
        let u = || self.parts.iter().flat_map(|p| &p.u).copied();
        let rows = z().count();
        let z_mean = z().sum::<f64>() / rows.max(1) as f64;
        let u_mean = u().sum::<f64>() / u().count().max(1) as f64;
        let zz = z().map(|z| (z - z_mean) * (z - z_mean)).sum::<f64>();
        (self.rows, self.z_mean, self.u_mean, self.zz) = (rows, z_mean, u_mean, zz);
    }

    /// The `LOOK` rows or so in which OP moves most.
    pub(super) fn busiest(&self) -> Option<Self> {
        let total: usize = self.parts.iter().map(|p| p.u.len()).sum();
        if total <= 2 * LOOK {
            return None;
        }
        let pieces = self.parts.iter().flat_map(|p| p.z.chunks(LOOK).zip(p.u.chunks(LOOK)));
        let moved = |u: &[f64]| u.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>();
        let able = pieces.filter(|(z, _)| z.iter().filter(|z| !z.is_nan()).count() >= FEWEST.min(self.rows / 20));
        let (z, u) = able.max_by(|a, b| span(a.1).total_cmp(&span(b.1)).then(moved(a.1).total_cmp(&moved(b.1))))?;
        let first = z.iter().copied().find(|z| !z.is_nan())?;
        let parts = vec![Part { place: 0, z: z.to_vec(), u: u.to_vec(), first }];
        let mut look = Self { parts, ..*self };
        look.sum();
        Some(look)
    }

    /// −2·ln L but for a constant.
    pub(super) fn cost(&self, left: f64) -> f64 {
        self.rows as f64 * (left + self.floor).ln()
    }

    /// Position of the valve at the beginning of a part.
    pub(super) fn start(&self, part: &Part, d: f64) -> f64 {
        let (a, b) = self.line;
        let seen = if b == 0.0 { part.u[0] } else { (part.first - a) / b };
        seen.clamp(part.u[0] - d / 2.0, part.u[0] + d / 2.0)
    }

    /// Eight motions at once.
    pub(super) fn weigh(&self, motions: &[Motion; LANES]) -> [Tried; LANES] {
        let (mut v1, mut vv, mut vz) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let mut add = |z: f64, at: &[f64; LANES]| {
            let z = z - self.z_mean;
            for l in 0..LANES {
                let v = at[l] - self.u_mean;
                v1[l] += v;
                vv[l] += v * v;
                vz[l] += v * z;
            }
        };
        for part in &self.parts {
            walk(part, motions, &motions.map(|m| self.start(part, m.d)), |k, _, at| {
                if !part.z[k].is_nan() {
                    add(part.z[k], at);
                }
            });
        }
        let n = self.rows as f64;
        std::array::from_fn(|l| {
            let (vv, vz) = (vv[l] - v1[l] * v1[l] / n, vz[l]);
            let b = if vv > 1e-20 * self.range * self.range * n { vz / vv } else { 0.0 };
            let a = self.z_mean - b * (self.u_mean + v1[l] / n);
            let left = ((self.zz - b * vz) / n).max(0.0);
            Tried { motion: motions[l], cost: self.cost(left), a, b, left }
        })
    }

    /// Cost of a motion.
    pub(super) fn at(&self, motion: Motion) -> Tried {
        self.weigh(&[motion; LANES])[0]
    }

    /// Residuals of the model at each row that counts.
    pub(super) fn residuals(&self, of: &Tried, mut each: impl FnMut(usize, usize, &State, f64)) {
        for (i, part) in self.parts.iter().enumerate() {
            let motions = [of.motion; LANES];
            walk(part, &motions, &motions.map(|m| self.start(part, m.d)), |k, state, at| {
                if !part.z[k].is_nan() {
                    each(i, k, state, part.z[k] - of.a - of.b * at[0]);
                }
            });
        }
    }
}

/// The first lane in a row: where the valve is and which way it went last.
pub(super) struct State {
    pub(super) valve: f64,
    pub(super) way: f64,
}

/// Walks through a part with eight motions; `each` gets the row, the state of the first, and where each is seen.
#[inline(always)]
fn walk(
    part: &Part,
    motions: &[Motion; LANES],
    starts: &[f64; LANES],
    mut each: impl FnMut(usize, &State, &[f64; LANES]),
) {
    let n = part.u.len() as isize;
    let ease = motions.map(|m| if m.lag > 0.0 { 1.0 - (-1.0 / m.lag).exp() } else { 1.0 });
    let one_delay = motions.iter().all(|m| m.delay == motions[0].delay);
    let mut seen = *starts;
    let mut state = State { valve: starts[0], way: 0.0 };
    let at = |k: usize, delay: isize| part.u[(k as isize - delay).clamp(0, n - 1) as usize];
    let mut follow = |k: usize, valve: &[f64; LANES]| {
        for l in 0..LANES {
            seen[l] += ease[l] * (valve[l] - seen[l]);
        }
        if valve[0] != state.valve {
            state.way = if valve[0] > state.valve { 1.0 } else { -1.0 };
            state.valve = valve[0];
        }
        each(k, &state, &seen);
    };
    if motions.iter().all(|m| m.share == 0.0) {
        let gaps = motions.map(|m| Backlash::new(m.d).expect("d ≥ 0"));
        let mut states = starts.map(BacklashState::at);
        for k in 0..part.u.len() {
            let first = at(k, motions[0].delay);
            let valve = std::array::from_fn(|l| {
                let u = if one_delay { first } else { at(k, motions[l].delay) };
                gaps[l].update(&mut states[l], u)
            });
            follow(k, &valve);
        }
    } else {
        let frictions = motions.map(|m| Friction::new(m.model, m.d, m.share * m.d).expect("0 ≤ J ≤ d"));
        let mut states = starts.map(FrictionState::at);
        for k in 0..part.u.len() {
            let valve = std::array::from_fn(|l| frictions[l].update(&mut states[l], at(k, motions[l].delay)));
            follow(k, &valve);
        }
    }
}
