//! Width of a valve's gap from OP and the valve's own recorded position.
//!
//! ```text
//! OP ──→ lost motion d, J ──→ delay, lag ──→ a + b·v ──→ (+) ──→ recorder ──→ POSITION
//!                                                         ↑
//!                                                       noise
//! ```
//!
//! Neither a process nor a load lies between, so that no filter is needed: for given d, J, delay and lag the rest is a straight
//! line, and its squares are summed in one pass, eight sets of parameters at once. What lies between instead is the recorder, which
//! can feign a gap by itself: a position that is kept until it has moved by a band lags behind on both ways as one in a gap does.
//! So the recorder is looked at first. Only rows in which a position kept so was written anew count, for there it is true;
//! spikes do not count; and what rounding, OP's own moves between two rows and the band may hide widens the interval.

use crate::data::record::Signals;
use crate::data::recorder::{Moves, Recorder, only_new, quantile, span, spike_limit, spikes_in};
use crate::data::samples::{Samples, Unfit};
use crate::decide::combine::{Combined, Reading, combine};
use crate::decide::joint::{RecordAnswer, newest};
use crate::decide::thresholds::{
    CYCLES_IF_CLEAR, GAP, GAP_IF_SELDOM_AND_LOAD_UNKNOWN, JUMP, LEAST_LOW, POSITION_ALL_JUMP, POSITION_EXPLAINED, RISE,
    RISE_OF_STICKING, SOUND_BELOW,
};
use crate::decide::trend::Trend;
use crate::decide::verdict::Verdict;
use crate::problem::records;
use glapp_core::{Backlash, BacklashState};
use glapp_core::{Friction, FrictionState, Model};

/// Fewest rows with a position that count.
const FEWEST: usize = 50;
/// Fewest new values of a position that is kept until it has moved by a band.
const FEWEST_NEW: usize = 12;
/// Sets of parameters in one pass.
const LANES: usize = 8;
/// Rows of the first look.
const LOOK: usize = 20_000;
/// Rows that are shown beside the model.
const SHOWN: usize = 8000;
/// What the position says of the valve.
#[derive(Clone, Debug)]
pub struct AtValve {
    /// What it says; never more than [`Verdict::AtLeast`] where the valve turned but once.
    pub verdict: Verdict,
    /// Why, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
    /// Most likely total width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where the record gives none.
    pub high: Option<f64>,
    /// Slip jump J [OP unit], 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap against the best width, times `trust`.
    pub lr_no_gap: f64,
    /// What it must exceed.
    pub lr_needed: f64,
    /// Likelihood ratio of J = 0 against the best J, times `trust`.
    pub lr_no_jump: f64,
    /// Share of the likelihood's own information on d that is left where what the model leaves is alike from row to row.
    pub trust: f64,
    /// How far −2·ln L may rise within the interval.
    pub rise: f64,
    /// Times that the valve began to move up, and down.
    pub traversals: [usize; 2],
    /// Position per OP [position unit/OP unit].
    pub gain: f64,
    /// Rows by which the position is behind OP as a whole; negative where OP is the older.
    pub delay: isize,
    /// Lag of the actuator [rows].
    pub lag: f64,
    /// Standard deviation of what the model leaves [position unit].
    pub sigma: f64,
    /// Share of the position's variance that the model explains.
    pub explained: f64,
    /// How the position was recorded.
    pub recorder: Recorder,
    /// Rows that count, and spikes that do not.
    pub rows: usize,
    /// See `rows`.
    pub spikes: usize,
    /// Widest move of OP [OP unit].
    pub range: f64,
    /// Width [OP unit] and −2·Δln L over the best, times `trust`.
    pub profile: Vec<(f64, f64)>,
    /// Rows beside the model, 8000 or so of them.
    pub shown: Vec<Shown>,
}

/// A row beside the model.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Part of the record, in the order given.
    pub part: usize,
    /// Row within it.
    pub row: usize,
    /// Position as recorded [position unit].
    pub recorded: f64,
    /// The model's [position unit].
    pub foreseen: f64,
    /// Where the valve is [OP unit].
    pub valve: f64,
}

/// What the positions of several records say together.
#[derive(Clone, Debug)]
pub struct PositionAnswer {
    /// The verdict.
    pub verdict: Verdict,
    /// Width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where there is none.
    pub high: Option<f64>,
    /// Change of the width, where three records or more give one. Where it is plain that the width changes, all the rest is what
    /// the newest record says that gives a width.
    pub trend: Option<Trend>,
    /// The records, in the order given.
    pub records: Vec<RecordAnswer<AtValve>>,
    /// Place of the record that shows best what all say.
    pub shown: usize,
}

/// The width from valve positions, each in the place of PV, and OP.
///
/// # Errors
///
/// Where the positions are OP once more, or nothing can be fitted.
pub fn fit_position(samples: &[Samples]) -> Result<PositionAnswer, Unfit> {
    if copied(samples) {
        return Err(Unfit::Copy);
    }
    let records: Vec<RecordAnswer<AtValve>> = records(samples)?
        .iter()
        .filter_map(|record| Some(RecordAnswer::of(record, at_valve(&record.signals())?)))
        .collect();
    let reading = |r: &RecordAnswer<AtValve>| {
        let AtValve { verdict, d, low, high, lr_no_gap, .. } = r.answer;
        Reading { verdict, d, low, high, lr_no_gap, t: r.middle() }
    };
    let readings: Vec<Reading> = records.iter().map(reading).collect();
    let Combined { verdict, d, low, high } = combine(&readings).ok_or(Unfit::Few)?;
    let trend = Trend::of(&readings);
    if let Some(shown) = newest(trend, &readings) {
        let Reading { verdict, d, low, high, .. } = readings[shown];
        return Ok(PositionAnswer { verdict, d, low, high, trend, records, shown });
    }
    let agree = (0..readings.len()).filter(|i| readings[*i].verdict == verdict).rev();
    let shown = agree.max_by(|a, b| readings[*a].lr_no_gap.total_cmp(&readings[*b].lr_no_gap)).unwrap_or(0);
    Ok(PositionAnswer { verdict, d, low, high, trend, records, shown })
}

/// Whether what was recorded as the position is OP in every row that has both.
fn copied(samples: &[Samples]) -> bool {
    let mut compared = false;
    for Samples { pv, op, .. } in samples {
        let both = op.unwrap_or(&[]).iter().zip(*pv).filter(|(u, z)| u.is_finite() && z.is_finite());
        for (u, z) in both {
            if u != z {
                return false;
            }
            compared = true;
        }
    }
    compared
}

/// The width from `parts` of (position, OP) at even steps, one for each unbroken stretch; NaN in the position is a row
/// without it, OP is without NaN. None where fewer than 50 rows have a position or OP does not move.
fn at_valve(parts: &[Signals]) -> Option<AtValve> {
    let track = Track::new(parts);
    if track.count() < FEWEST || track.range <= 0.0 {
        return None;
    }
    Some(track.answer())
}

/// What is tried: a lost motion, and what lies between the valve and its position.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Motion {
    d: f64,
    share: f64,
    model: Model,
    delay: isize,
    lag: f64,
}

impl Motion {
    fn gap(d: f64, delay: isize, lag: f64) -> Self {
        Self { d, share: 0.0, model: Model::Kano, delay, lag }
    }
}

/// A motion with what it is worth: −2·ln L but for a constant, and the line a + b·v.
#[derive(Clone, Copy, Debug)]
struct Tried {
    motion: Motion,
    cost: f64,
    a: f64,
    b: f64,
    /// Mean square of what is left [position unit²].
    left: f64,
}

/// One stretch. `z` is NaN in every row that does not count.
struct Part {
    place: usize,
    z: Vec<f64>,
    u: Vec<f64>,
    /// Where the valve was recorded first.
    first: f64,
}

struct Track {
    parts: Vec<Part>,
    recorder: Recorder,
    /// What OP may have done besides: its lower edge of moves where OP itself is kept, and its median move [OP unit].
    op_band: f64,
    op_move: f64,
    range: f64,
    /// Squares of the position about its mean, its mean, and OP's.
    zz: f64,
    z_mean: f64,
    u_mean: f64,
    rows: usize,
    spikes: usize,
    /// Variance that no model can do without: the recorder's rounding, and the computer's.
    floor: f64,
    /// Where the line lay last, by which the start in the gap is told.
    line: (f64, f64),
    /// How far the first step of a descent goes: less where a good beginning is known.
    stride: f64,
}

impl Track {
    fn new(parts: &[Signals]) -> Self {
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
        // How much of OP's move reaches the position, roughly.
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

    fn count(&self) -> usize {
        match self.recorder {
            // Few new values, but every one of them is true.
            Recorder::Kept(_) if self.rows >= FEWEST_NEW => self.rows.max(FEWEST),
            _ => self.rows,
        }
    }

    /// What does not hang on the motion.
    fn sum(&mut self) {
        let z = || self.parts.iter().flat_map(|p| &p.z).copied().filter(|z| !z.is_nan());
        let u = || self.parts.iter().flat_map(|p| &p.u).copied();
        let rows = z().count();
        let z_mean = z().sum::<f64>() / rows.max(1) as f64;
        let u_mean = u().sum::<f64>() / u().count().max(1) as f64;
        let zz = z().map(|z| (z - z_mean) * (z - z_mean)).sum::<f64>();
        (self.rows, self.z_mean, self.u_mean, self.zz) = (rows, z_mean, u_mean, zz);
    }

    /// The same for the `LOOK` rows or so in which OP moves most.
    fn busiest(&self) -> Option<Self> {
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
    fn cost(&self, left: f64) -> f64 {
        self.rows as f64 * (left + self.floor).ln()
    }

    /// Where the valve stands at the beginning of a part.
    fn start(&self, part: &Part, d: f64) -> f64 {
        let (a, b) = self.line;
        let seen = if b == 0.0 { part.u[0] } else { (part.first - a) / b };
        seen.clamp(part.u[0] - d / 2.0, part.u[0] + d / 2.0)
    }

    /// Eight motions at once.
    fn weigh(&self, motions: &[Motion; LANES]) -> [Tried; LANES] {
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

    fn at(&self, motion: Motion) -> Tried {
        self.weigh(&[motion; LANES])[0]
    }

    /// From `from` to the best of its eight neighbours, as long as there is a better one, in steps that become smaller:
    /// `moved` gives the motion moved by so many steps of either of two parameters.
    fn descend(&self, from: Tried, moved: impl Fn(Motion, f64, f64) -> Motion) -> Tried {
        const AROUND: [(f64, f64); LANES] =
            [(1., 0.), (-1., 0.), (0., 1.), (0., -1.), (1., 1.), (-1., -1.), (1., -1.), (-1., 1.)];
        let (mut here, mut size) = (from, self.stride);
        for _ in 0..80 {
            let around = self.weigh(&AROUND.map(|(i, j)| moved(here.motion, i * size, j * size)));
            let best = around.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("eight");
            if best.cost < here.cost {
                here = *best;
                size *= 1.5;
                continue;
            }
            // Where all the neighbours are as good, smaller steps tell no more.
            if around.iter().all(|t| t.cost < here.cost + 0.05) && size < 0.1 || size < 1e-7 {
                break;
            }
            size /= 4.0;
        }
        here
    }

    /// The best width and lag from there on.
    fn widths(&self, from: Tried) -> Tried {
        let step = 0.1 * from.motion.d.max(0.01 * self.range);
        self.descend(from, |m, i, j| {
            let d = (m.d + i * step).clamp(0.0, self.range);
            Motion { d, lag: (m.lag + 0.5 * j).max(0.0), ..m }
        })
    }

    /// The best lag for a given width and delay.
    fn lags(&self, from: Tried) -> Tried {
        self.descend(from, |m, i, j| Motion { lag: (m.lag + 0.7 * i + 0.1 * j).max(0.0), ..m })
    }

    /// The best width and share of slip jump.
    fn shares(&self, from: Tried) -> Tried {
        let step = 0.1 * from.motion.d.max(0.01 * self.range);
        self.descend(from, |m, i, j| {
            let d = (m.d + i * step).clamp(0.0, self.range);
            Motion { d, share: (m.share + 0.1 * j).clamp(0.02, 1.0), ..m }
        })
    }

    /// The best gaps of a coarse look, one for each delay and the best first; and the same for no gap.
    fn look(&self) -> (Vec<Tried>, Vec<Tried>) {
        const LAGS: [f64; LANES] = [0.0, 0.5, 1.0, 2.0, 3.5, 6.0, 10.0, 18.0];
        const DELAYS: [isize; 11] = [-1, 0, 1, 2, 3, 4, 6, 8, 11, 15, 20];
        const WIDTHS: [f64; 13] = [0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.26, 0.38, 0.54, 0.75, 1.0];
        let least = |tried: [Tried; LANES]| tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("eight");
        let at = |d: f64, delay: isize| least(self.weigh(&LAGS.map(|lag| Motion::gap(d, delay, lag))));
        let sorted = |mut tried: Vec<Tried>| {
            tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            tried
        };
        let none = sorted(DELAYS.iter().map(|&delay| at(0.0, delay)).collect());
        let gaps = DELAYS.iter().map(|&delay| {
            let widths = WIDTHS.iter().map(|part| at(part * self.range, delay));
            widths.min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("widths")
        });
        (sorted(gaps.collect()), none)
    }

    /// The best valves that stick, of either model, near a gap's delay and lag.
    fn sticking(&self, near: &Tried) -> Vec<Tried> {
        const SHARES: [f64; LANES] = [0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0];
        let widths = [0.01, 0.03, 0.06, 0.1, 0.16, 0.25, 0.4, 0.6].map(|part| part * self.range);
        let own = [0.8, 0.95, 1.05, 1.3, 1.8].map(|part| part * near.motion.d);
        let mut found = Vec::new();
        for model in [Model::Kano, Model::He] {
            let lags = if near.motion.lag > 0.2 { vec![0.0, near.motion.lag] } else { vec![near.motion.lag] };
            let tried = widths.iter().chain(&own).flat_map(|&d| lags.iter().map(move |&lag| (d, lag)));
            let tried = tried
                .filter(|(d, _)| *d > 0.0 && *d <= self.range)
                .flat_map(|(d, lag)| self.weigh(&SHARES.map(|share| Motion { d, share, model, lag, ..near.motion })));
            found.extend(tried.min_by(|a, b| a.cost.total_cmp(&b.cost)));
        }
        found
    }

    /// The best width, share of slip jump and lag.
    fn jumps(&self, from: Tried) -> Tried {
        self.shares(self.widths(self.shares(from)))
    }

    /// The best of some beginnings, each with the delays beside it, on all rows.
    fn polished(&self, starts: &[Tried], polish: impl Fn(&Self, Tried) -> Tried) -> Tried {
        let mut ends: Vec<Tried> = starts.iter().map(|start| polish(self, self.at(start.motion))).collect();
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut best = ends[0];
        for by in [1, -1] {
            loop {
                let motion = Motion { delay: best.motion.delay + by, ..best.motion };
                if !(-2..=40).contains(&motion.delay) {
                    break;
                }
                let beside = polish(self, self.at(motion));
                if beside.cost >= best.cost {
                    break;
                }
                best = beside;
            }
        }
        best
    }

    /// What the model leaves of each row that counts.
    fn residuals(&self, of: &Tried, mut each: impl FnMut(usize, usize, &State, f64)) {
        for (i, part) in self.parts.iter().enumerate() {
            let motions = [of.motion; LANES];
            walk(part, &motions, &motions.map(|m| self.start(part, m.d)), |k, state, at| {
                if !part.z[k].is_nan() {
                    each(i, k, state, part.z[k] - of.a - of.b * at[0]);
                }
            });
        }
    }

    /// Rows far off the best model no longer count, if they are few: spikes of more than a row.
    fn without_outliers(&mut self, best: &Tried) -> bool {
        let mut sizes = Vec::with_capacity(self.rows);
        self.residuals(best, |_, _, _, r| sizes.push(r.abs()));
        let median = quantile(&mut sizes, 0.5);
        let limit = (8.0 * 1.4826 * median).max(3.0 * best.left.sqrt());
        let far = sizes.iter().filter(|r| **r > limit).count();
        if far == 0 || far * 20 > self.rows || limit * limit < 4.0 * self.floor {
            return false;
        }
        let mut gone: Vec<(usize, usize)> = Vec::new();
        self.residuals(best, |i, k, _, r| {
            if r.abs() > limit {
                gone.push((i, k));
            }
        });
        for (i, k) in gone {
            self.parts[i].z[k] = f64::NAN;
            self.spikes += 1;
        }
        self.sum();
        true
    }

    /// The gap, no gap and a valve that sticks, each at its best: sought where OP moves most, then on all rows.
    fn search(&mut self) -> [Tried; 3] {
        let Some(mut look) = self.busiest() else { return self.search_here() };
        let [gap, none, stuck] = look.search_here();
        self.line = look.line;
        self.stride = 0.1;
        let gap = self.polished(&[gap], Self::widths);
        let none = self.polished(&[none], Self::lags);
        // A valve that plainly does not stick there is not looked at twice.
        let stuck = if stuck.cost < look.cost(look.at(gap.motion).left) - 2.0 {
            self.polished(&[stuck], Self::jumps)
        } else {
            self.at(stuck.motion)
        };
        [if none.cost < gap.cost { none } else { gap }, none, stuck]
    }

    /// The same on the rows that there are.
    fn search_here(&mut self) -> [Tried; 3] {
        let (gaps, none) = self.look();
        self.line = (gaps[0].a, gaps[0].b);
        let gap = self.polished(&gaps[..2], Self::widths);
        self.line = (gap.a, gap.b);
        let gap = self.widths(self.at(gap.motion));
        let beside = Tried { motion: Motion { d: 0.0, ..gap.motion }, ..gap };
        let none = self.polished(&[none[0], none[1], beside], Self::lags);
        let stuck = self.polished(&self.sticking(&gap), Self::jumps);
        [if none.cost < gap.cost { none } else { gap }, none, stuck]
    }

    /// Information on d that is left, and how often the valve turned each way. What the model leaves may be alike as long as
    /// the valve goes one way: each such way counts as one observation, not each row.
    fn trust(&self, best: &Tried) -> (f64, [usize; 2]) {
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

    fn answer(mut self) -> AtValve {
        let mut found = self.search();
        let best = found.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("three");
        if self.without_outliers(&best) {
            found = self.search();
        }
        let [gap, none, stuck] = found;
        let (trust, _) = self.trust(&gap);
        let lr_no_jump = (gap.cost - stuck.cost).max(0.0) * trust;
        let step = match self.recorder {
            Recorder::Plain => 0.0,
            Recorder::Rounded(step) | Recorder::Kept(step) => step,
        };
        let per_op = gap.b.abs().max(1e-300);
        let slips = lr_no_jump > JUMP && stuck.motion.d * stuck.motion.share > 2.0 * step / per_op;
        let best = if slips { stuck } else { gap };
        let (trust, traversals) = self.trust(&best);
        let lr_no_gap = (none.cost - best.cost).max(0.0) * trust;
        let sigma = best.left.sqrt();
        let mut low = f64::INFINITY;
        let mut high = Some(0.0);
        let mut hold = |limits: (f64, Option<f64>)| {
            low = low.min(limits.0);
            high = high.and_then(|h: f64| limits.1.map(|l| h.max(l)));
        };
        let d = best.motion.d;
        if slips {
            hold(self.limits(&stuck, stuck.cost + RISE_OF_STICKING / trust));
        } else {
            hold(self.limits(&gap, gap.cost + RISE / trust));
            if stuck.cost < gap.cost + RISE / trust {
                hold(self.limits(&stuck, gap.cost.min(stuck.cost) + RISE / trust));
            }
        }
        // What the recorder hides, never more than what is left shows where rows do not fit.
        let seen = 4.0 * sigma / per_op;
        let rounding = match self.recorder {
            Recorder::Rounded(step) => 0.5 * step / per_op,
            _ => 0.0,
        };
        let least = 1e-4 * d + 1e-6 * self.range;
        let op = (2.0 * self.op_band).min(seen) + rounding + least;
        let low = (low - op - (0.5 * self.op_move).min(seen)).max(0.0);
        let kept = if let Recorder::Kept(band) = self.recorder { band / per_op } else { 0.0 };
        let high = high.map(|h| h + op + (1.5 * self.op_move).min(seen) + kept);
        // A position that stands still is explained by nothing.
        let explained = if best.b == 0.0 { 0.0 } else { 1.0 - best.left * self.rows as f64 / self.zz };
        let lr_needed =
            if traversals.iter().min() >= Some(&CYCLES_IF_CLEAR) { GAP } else { GAP_IF_SELDOM_AND_LOAD_UNKNOWN };
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
        } else if low < LEAST_LOW * d {
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
            d,
            low: if verdict == Verdict::Sound { 0.0 } else { low },
            high,
            jump: best.motion.share * d,
            lr_no_gap,
            lr_needed,
            lr_no_jump,
            trust,
            rise: if slips { RISE_OF_STICKING } else { RISE },
            traversals,
            gain: best.b,
            delay: best.motion.delay,
            lag: best.motion.lag,
            sigma,
            explained,
            recorder: self.recorder,
            rows: self.rows,
            spikes: self.spikes,
            range: self.range,
            profile: self.profile(&best, &none, trust),
            shown: self.shown(&best),
        }
    }

    /// At the width of `at`, with the lag (and share of jump) that is best from there on.
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
            // What is outside with this lag may be inside with another.
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
    fn profile(&self, best: &Tried, none: &Tried, trust: f64) -> Vec<(f64, f64)> {
        let most = (3.0 * best.motion.d).max(0.1 * self.range).min(self.range);
        let mut points = vec![(0.0, none.cost), (best.motion.d, best.cost)];
        for turn in 0..4 {
            let d = |l: usize| most * (turn * LANES + l + 1) as f64 / (4 * LANES) as f64;
            let tried = self.weigh(&std::array::from_fn(|l| Motion { d: d(l), ..best.motion }));
            points.extend(tried.map(|t| (t.motion.d, t.cost)));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by_key(|point| point.0);
        points.into_iter().map(|(d, cost)| (d, ((cost - best.cost) * trust).max(0.0))).collect()
    }

    fn shown(&self, best: &Tried) -> Vec<Shown> {
        let every = self.rows.div_ceil(SHOWN);
        let mut n = 0;
        let mut shown = Vec::new();
        self.residuals(best, |i, k, state, r| {
            if n % every == 0 {
                let recorded = self.parts[i].z[k];
                let part = self.parts[i].place;
                shown.push(Shown { part, row: k, recorded, foreseen: recorded - r, valve: state.valve });
            }
            n += 1;
        });
        shown
    }
}

/// The first lane in a row: where the valve is and which way it went last.
struct State {
    valve: f64,
    way: f64,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// An output that wanders between turns of many sizes, and noise, both by chance.
    fn output(n: usize, seed: u64) -> (Vec<f64>, impl FnMut() -> f64) {
        let mut state = seed;
        let mut uniform = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut slow = 0.0;
        let u = (0..n)
            .map(|k| {
                slow = 0.98 * slow + uniform();
                50.0 + 4.0 * (k as f64 * 0.021).sin() + 0.5 * slow
            })
            .collect();
        (u, uniform)
    }

    fn valve(u: &[f64], d: f64, jump: f64) -> Vec<f64> {
        let friction = Friction::new(Model::Kano, d, jump).unwrap();
        let mut state = FrictionState::at(u[0]);
        u.iter().map(|&u| friction.update(&mut state, u)).collect()
    }

    /// Written only once it has moved by more than `band`.
    fn kept(x: &[f64], band: f64) -> Vec<f64> {
        let mut last = x[0];
        let write = |x: &f64| {
            if (x - last).abs() > band {
                last = *x;
            }
            last
        };
        x.iter().map(write).collect()
    }

    fn asked(z: &[f64], u: &[f64]) -> AtValve {
        at_valve(&[(z, u)]).unwrap()
    }

    #[test]
    fn the_width_is_found_whatever_the_recorder_does() {
        for d in [0.3, 1.5] {
            let (u, mut noise) = output(3000, 7);
            // Another span, reverse acting.
            let z: Vec<f64> = valve(&u, d, 0.0).iter().map(|v| 90.0 - 0.7 * v).collect();
            let noisy: Vec<f64> = z.iter().map(|z| z + 0.1 * noise()).collect();
            let spiky: Vec<f64> = noisy.iter().map(|z| if noise() > 0.49 { z + 30.0 * noise() } else { *z }).collect();
            let rounded: Vec<f64> = z.iter().map(|z| (z / 0.1).round() * 0.1).collect();
            let missing: Vec<f64> = noisy.iter().map(|z| if noise() > 0.3 { f64::NAN } else { *z }).collect();
            let late: Vec<f64> = (0..z.len()).map(|k| z[k.saturating_sub(3)] + 0.05 * noise()).collect();
            for (name, z) in [
                ("plain", &z),
                ("noisy", &noisy),
                ("spiky", &spiky),
                ("rounded", &rounded),
                ("missing", &missing),
                ("late", &late),
            ] {
                let a = asked(z, &u);
                assert_eq!(a.verdict, Verdict::Backlash, "{name} {a:?}");
                let high = a.high.unwrap();
                assert!(a.low <= d && d <= high && high - a.low < 0.5, "{name} {d}: {} to {high}", a.low);
                assert!((a.gain + 0.7).abs() < 0.01, "{name}: {}", a.gain);
                assert_eq!(a.delay, if name == "late" { 3 } else { 0 }, "{name}");
            }
        }
    }

    #[test]
    fn a_position_kept_until_it_has_moved_by_a_band_feigns_no_gap() {
        let (u, mut noise) = output(3000, 11);
        let z: Vec<f64> = u.iter().map(|u| u + 0.01 * noise()).collect();
        let a = asked(&kept(&z, 0.5), &u);
        assert_eq!(a.verdict, Verdict::Sound, "{a:?}");
        assert!(matches!(a.recorder, Recorder::Kept(band) if (band - 0.5).abs() < 0.05));
        // What the band may hide is not excluded.
        assert!(a.high.unwrap() >= 0.5);
        let worn = asked(&kept(&valve(&u, 1.5, 0.0), 0.5), &u);
        assert_eq!(worn.verdict, Verdict::Backlash, "{worn:?}");
        assert!(worn.low <= 1.5 && worn.high.unwrap() >= 1.5 && worn.low > 1.3, "{worn:?}");
    }

    #[test]
    fn without_a_gap_none_is_claimed() {
        for seed in 0..6 {
            let (u, mut noise) = output(1500, seed);
            let size = [0.02, 0.2, 1.0][seed as usize % 3];
            let z: Vec<f64> = u.iter().map(|u| u + size * noise()).collect();
            let a = asked(&z, &u);
            assert_eq!(a.verdict, Verdict::Sound, "{seed} {a:?}");
        }
    }

    #[test]
    fn a_slow_actuator_is_no_gap() {
        let (u, mut noise) = output(3000, 3);
        let mut at = u[0];
        let z: Vec<f64> = u
            .iter()
            .map(|u| {
                at += 0.3 * (u - at);
                at + 0.02 * noise()
            })
            .collect();
        let a = asked(&z, &u);
        assert_eq!(a.verdict, Verdict::Sound, "{a:?}");
        assert!((a.lag - 1.0 / (1.0f64 / 0.7).ln()).abs() < 0.2, "{}", a.lag);
    }

    #[test]
    fn a_slip_jump_is_told_from_a_gap() {
        let (u, mut noise) = output(3000, 5);
        let noisy =
            |z: Vec<f64>, noise: &mut dyn FnMut() -> f64| z.iter().map(|z| z + 0.05 * noise()).collect::<Vec<_>>();
        let both = asked(&noisy(valve(&u, 2.0, 0.8), &mut noise), &u);
        assert_eq!(both.verdict, Verdict::Both, "{both:?}");
        assert!((both.jump - 0.8).abs() < 0.15 && both.low <= 2.0 && both.high.unwrap() >= 2.0, "{both:?}");
        let gap = asked(&noisy(valve(&u, 2.0, 0.0), &mut noise), &u);
        assert_eq!((gap.verdict, gap.jump), (Verdict::Backlash, 0.0), "{gap:?}");
    }

    #[test]
    fn op_once_more_and_another_signal_tell_nothing() {
        let (u, mut noise) = output(1000, 1);
        let scaled: Vec<f64> = u.iter().map(|u| 3.0 * u + 1.0).collect();
        assert_eq!(asked(&scaled, &u).reason, "copy");
        let other: Vec<f64> = (0..u.len()).map(|_| noise()).collect();
        assert_eq!(asked(&other, &u).reason, "no_answer");
        assert_eq!(asked(&vec![20.0; u.len()], &u).reason, "no_answer");
        assert!(at_valve(&[(&u[..30], &u[..30])]).is_none());
        assert!(at_valve(&[(&other, &vec![50.0; u.len()])]).is_none());
    }

    #[test]
    fn many_rows_tell_the_same_as_few_and_more_exactly() {
        let (u, mut noise) = output(60_000, 9);
        let z: Vec<f64> = valve(&u, 1.0, 0.0).iter().map(|z| z + 0.5 * noise()).collect();
        let (few, many) = (asked(&z[..2000], &u[..2000]), asked(&z, &u));
        assert_eq!(many.verdict, Verdict::Backlash, "{many:?}");
        assert!(many.low <= 1.0 && many.high.unwrap() >= 1.0, "{} {:?}", many.low, many.high);
        assert!(many.high.unwrap() - many.low <= few.high.unwrap() - few.low);
    }
}
