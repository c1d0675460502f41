//! Change points of the load by a bank of Kalman filters, each with another history of changes.
//!
//! Where the changes are known the filter gives the likelihood of PV. With k cells there are 2ᵏ histories, of which a bank keeps the
//! likeliest (multiple models with pruning: Andersson 1985; Gustafsson, *Adaptive Filtering and Change Detection*, 2000, chapter 7). A
//! history with m changes costs
//!
//! ```text
//! −2·ln p = Σ ln S + (Σ ε_y² − kp·Σ ε_y·ε_v)/σ² + price(m),      kp = Σ ε_y·ε_v / Σ ε_v²
//! ```
//!
//! with the innovations divided by √S, the noise σ² of an earlier fit and the gain kp at its best in each filter. At each cell
//!
//! 1. the cheapest filter branches: one goes on without a change there, a new one with it;
//! 2. the new one takes the place of the dearest, but of none that is younger than [`Models::LIFE`]: a change costs its price at once, and
//!    pays for it by the samples behind it.
//!
//! A change of size s before the cell's end by b cells reaches the states as s·r(b), r being powers of b (`Models::reached`). Neither is
//! known: s has mean 0 and variance V, b is even over the cell. So the covariance grows by V·E[r·r'], whose elements are moments of b.

use super::{Gain, LINES, Models, START};
use crate::lanes::{LANES, Lanes, Wide};
use crate::structure::Theta;
use pulp::{Simd, WithSimd};
use std::array;
use std::f64::consts::{LN_2, SQRT_2};

/// Registers of filters.
const GROUPS: usize = 2;
const FILTERS: usize = GROUPS * LANES;

/// Cells at the beginning and at the end of a stretch in which no change is sought.
const FIRST: usize = 10;
const LAST: usize = 5;

/// Question to the bank: the changes of a stretch under one model.
pub struct Sought<'b> {
    /// The model.
    pub theta: &'b Theta,
    /// PV.
    pub y: &'b [f64],
    /// The positions, as late as they act.
    pub v: &'b [f64],
    /// Variance of a change [variance of the white noise on PV].
    pub variance: f64,
    /// Variance of the white noise on PV.
    pub noise: f64,
    /// Sign of the gain, 0 where it is not known.
    pub sign: f64,
    /// Σ ε_y², Σ ε_y·ε_v and Σ ε_v² that are known before the stretch.
    pub sums: [f64; 3],
    /// Price of 0, 1, 2 … changes [−2·ln p]: there are no more than these.
    pub prices: &'b [f64],
    /// Fewest cells between two changes.
    pub apart: usize,
}

/// The cheapest history of a stretch.
#[derive(Default)]
pub struct Found {
    /// Times of the changes [cells].
    pub changes: Vec<f64>,
    /// The sums of [`Sought::sums`] with this stretch.
    pub sums: [f64; 3],
}

/// Filters side by side.
#[derive(Clone, Copy)]
struct Filters<const N: usize> {
    /// The covariance, above its diagonal.
    p: [[Lanes; N]; N],
    /// The states of PV and of the answer.
    x: [[Lanes; N]; 2],
    /// Σ ε_y², Σ ε_y·ε_v and Σ ε_v².
    sums: [Lanes; 3],
    log_s: Lanes,
    price: Lanes,
    cost: Lanes,
}

/// One of them.
struct Filter<const N: usize> {
    p: [[f64; N]; N],
    x: [[f64; N]; 2],
    sums: [f64; 3],
    log_s: f64,
    cost: f64,
}

impl<const N: usize> Filters<N> {
    #[inline(always)]
    fn get(&self, l: usize) -> Filter<N> {
        Filter {
            p: self.p.each_ref().map(|row| row.each_ref().map(|x| x[l])),
            x: self.x.each_ref().map(|row| row.each_ref().map(|x| x[l])),
            sums: self.sums.each_ref().map(|x| x[l]),
            log_s: self.log_s[l],
            cost: self.cost[l],
        }
    }

    #[inline(always)]
    fn set(&mut self, l: usize, filter: &Filter<N>, price: f64) {
        for i in 0..N {
            for j in i..N {
                self.p[i][j][l] = filter.p[i][j];
            }
            (self.x[0][i][l], self.x[1][i][l]) = (filter.x[0][i], filter.x[1][i]);
        }
        for i in 0..3 {
            self.sums[i][l] = filter.sums[i];
        }
        self.log_s[l] = filter.log_s;
        self.price[l] = price;
        self.cost[l] = filter.cost;
    }
}

/// History of a filter: how many changes it has, the last of them in the list of all, and its cell, in which the filter branched off.
#[derive(Clone, Copy, Default)]
struct History {
    changes: usize,
    last: Option<usize>,
    changed: usize,
}

/// The cheapest filter of those that `may` branch, and the dearest of those that give way to the new one: all that branched off up to
/// the cell `old`, but the cheapest.
#[inline(always)]
fn branching(
    costs: &[f64; FILTERS],
    histories: &[History; FILTERS],
    old: usize,
    may: impl Fn(&History) -> bool,
) -> Option<(usize, usize)> {
    let (mut best, mut from) = (0, None);
    for i in 0..FILTERS {
        if costs[i] < costs[best] {
            best = i;
        }
        if costs[i] < from.map_or(f64::INFINITY, |from: usize| costs[from]) && may(&histories[i]) {
            from = Some(i);
        }
    }
    let from = from?;
    let mut to: Option<usize> = None;
    for i in 0..FILTERS {
        let gives_way = i != best && i != from && histories[i].changed <= old;
        if gives_way && to.is_none_or(|to| costs[i] > costs[to]) {
            to = Some(i);
        }
    }
    Some((from, to?))
}

/// A change of a history, and the one before it.
struct Change {
    cell: usize,
    before: Option<usize>,
}

/// [`Models::bank`], a function of its own.
struct Seeking<'m, 'b, S: Simd, const R: usize, const N: usize, const MORE: usize> {
    models: &'m Models<S, R, N, MORE>,
    sought: &'b Sought<'b>,
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> WithSimd for Seeking<'_, '_, S, R, N, MORE> {
    type Output = Found;

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> Found {
        self.models.sought(self.sought)
    }
}

impl<S: Simd, const R: usize, const N: usize, const MORE: usize> Models<S, R, N, MORE> {
    /// Cells from one branching to the next, and age that a filter reaches in any case [cells].
    const EVERY: usize = if MORE == LINES { 2 } else { 1 };
    const LIFE: usize = if MORE == LINES { 10 } else { 8 };

    /// The changes of a stretch in the cheapest history that a bank of filters finds, all with the first model's process.
    pub(crate) fn bank(&self, sought: &Sought) -> Found {
        Simd::vectorize(self.simd, Seeking { models: self, sought })
    }

    #[inline(always)]
    fn sought(&self, sought: &Sought) -> Found {
        let Sought { y, v, variance, prices, apart, .. } = *sought;
        let spread = self.spread().map(|row| row.map(|moment| variance * moment));
        let mut bank = self.begun(sought);
        let mut histories = [History::default(); FILTERS];
        let mut all: Vec<Change> = Vec::new();
        let mut seen = 0;
        for k in 0..y.len() {
            if k >= FIRST && k + LAST < y.len() && k % Self::EVERY == 0 {
                let costs: [f64; FILTERS] = array::from_fn(|i| bank[i / LANES].cost[i % LANES]);
                let may = |history: &History| {
                    history.changes + 1 < prices.len() && (history.last.is_none() || history.changed + apart <= k)
                };
                if let Some((from, to)) = branching(&costs, &histories, k - Self::LIFE.min(k), may) {
                    let History { changes, last, .. } = histories[from];
                    all.push(Change { cell: k, before: last });
                    let last = Some(all.len() - 1);
                    histories[to] = History { changes: changes + 1, last, changed: k };
                    let mut filter = bank[from / LANES].get(from % LANES);
                    for i in 0..N {
                        for j in i..N {
                            filter.p[i][j] += spread[i][j];
                        }
                    }
                    bank[to / LANES].set(to % LANES, &filter, prices[changes + 1]);
                }
            }
            for filters in &mut bank {
                self.filtered(filters, y[k], v[k], seen, sought);
            }
            seen += usize::from(!y[k].is_nan());
        }
        let cost = |i: &usize| bank[i / LANES].cost[i % LANES];
        let best = (0..FILTERS).min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("sixteen filters");
        let mut next = histories[best].last;
        let mut changes = Vec::new();
        while let Some(change) = next {
            changes.push(all[change].cell as f64 - 0.5 * Self::EVERY as f64);
            next = all[change].before;
        }
        changes.reverse();
        Found { changes, sums: bank[best / LANES].get(best % LANES).sums }
    }

    /// A bank of which one filter is under way.
    #[inline(always)]
    fn begun(&self, sought: &Sought) -> [Filters<N>; GROUPS] {
        let p = self.start().p.map(|row| row.map(Wide::lanes));
        let sums = sought.sums.map(Lanes::all);
        let none = Filters {
            p,
            x: [[Lanes::default(); N]; 2],
            sums,
            log_s: Lanes::default(),
            price: Lanes::all(f64::INFINITY),
            cost: Lanes::all(f64::INFINITY),
        };
        let mut bank = [none; GROUPS];
        (bank[0].price[0], bank[0].cost[0]) = (sought.prices[0], sought.prices[0]);
        bank
    }

    /// E[r·r'], above its diagonal, for a change at any time of the cells since the last branching.
    #[inline(always)]
    fn spread(&self) -> [[f64; N]; N] {
        // Effect c·bᵖ on each state.
        let effect = |i: usize| {
            if MORE == LINES {
                (f64::from(u8::from(i >= Self::LOAD)), usize::from(i == Self::LOAD))
            } else if i < Self::ORDER {
                (self.transition[i][Self::LOAD].lanes()[0], Self::ORDER - i)
            } else {
                (f64::from(u8::from(i == Self::LOAD)), 0)
            }
        };
        let moment = |i: usize, j: usize| {
            let ((a, p), (b, q)) = (effect(i), effect(j));
            let power = (0..p + q).fold(1.0, |power, _| power * Self::EVERY as f64);
            a * b * power / (p + q + 1) as f64
        };
        array::from_fn(|i| array::from_fn(|j| moment(i, j)))
    }

    /// Eight filters a cell further.
    #[inline(always)]
    fn filtered(&self, filters: &mut Filters<N>, y: f64, v: f64, seen: usize, sought: &Sought) {
        let all = |x| Wide::all(self.simd, x);
        let load = |lanes: &Lanes| Wide::load(self.simd, lanes);
        let [s, part, scale, before] = [all(0.0); 4];
        let p = filters.p.each_ref().map(|row| row.each_ref().map(load));
        let mut gain = Gain { p, l: [all(0.0); N], s, part, scale, before, since: 0, frozen: false };
        let [mut of_y, mut of_v] = filters.x.each_ref().map(|row| row.each_ref().map(load));
        self.measure(&mut gain);
        let missing = y.is_nan();
        self.predict(&mut gain, missing);
        if missing {
            self.pass(&mut of_y, None);
            self.pass(&mut of_v, Some(all(v)));
        } else {
            let (e_y, e_v) = (self.unforeseen(&of_y, y), self.unforeseen(&of_v, 0.0));
            if seen >= START {
                let [yy, yv, vv] = filters.sums.each_ref().map(load);
                // The answer enters with the other sign.
                let (yy, yv, vv) = (yy + gain.part * e_y * e_y, yv - gain.part * e_y * e_v, vv + gain.part * e_v * e_v);
                filters.sums = [yy, yv, vv].map(Wide::lanes);
                let log_s = load(&filters.log_s) + gain.s.each(ln);
                filters.log_s = log_s.lanes();
                // A gain of the other sign is none.
                let toward = yv * all(sought.sign);
                let toward = if sought.sign == 0.0 { yv } else { all(0.5) * (toward + toward.abs()) };
                let squares = yy - toward * toward / (vv + all(f64::MIN_POSITIVE));
                filters.cost = (log_s + squares / all(sought.noise) + load(&filters.price)).lanes();
            }
            self.step(&mut of_y, &gain.l, e_y, None);
            self.step(&mut of_v, &gain.l, e_v, Some(all(v)));
        }
        filters.p = gain.p.map(|row| row.map(Wide::lanes));
        filters.x = [of_y, of_v].map(|row| row.map(Wide::lanes));
    }
}

/// The natural logarithm of a normal x > 0, to 2 in a million: a bank takes sixteen a cell, and only compares them. By plain arithmetic,
/// the same everywhere: x = 2ᵉ·m, ln m by the series of artanh around √2.
#[inline(always)]
fn ln(x: f64) -> f64 {
    const MANTISSA: u64 = (1 << 52) - 1;
    let bits = x.to_bits();
    let exponent = f64::from((bits >> 52) as u32 as i32 - 1023);
    let m = f64::from_bits(bits & MANTISSA | 1.0_f64.to_bits());
    let t = (m - SQRT_2) / (m + SQRT_2);
    let t2 = t * t;
    (exponent + 0.5) * LN_2 + 2.0 * t * (1.0 + t2 * (1.0 / 3.0 + t2 * 0.2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Work;
    use crate::structure::{Bank, Noise, Structure};
    use pulp::Scalar;

    const STEPS: Structure = Structure { lags: 2, integrating: false, noise: Noise::Input };
    const BENDS: Structure = Structure { noise: Noise::Bends, ..STEPS };

    /// PV behind two lags of 2.5 cells each, its load 1 between two cells, else 0, noise of 0.01; positions that explain nothing.
    fn pulse(from: usize, to: usize) -> (Vec<f64>, Vec<f64>) {
        const PARTS: usize = 100;
        let (mut inner, mut level) = (0.0, 0.0);
        let y = (0..200).map(|k| {
            let before = level;
            for _ in 0..PARTS {
                let load = f64::from(u8::from((from..to).contains(&k)));
                (inner, level) =
                    (inner + (load - inner) / 2.5 / PARTS as f64, level + (inner - level) / 2.5 / PARTS as f64);
            }
            before + 0.01 * (f64::from(k as u32 * 7919 % 13) / 6.0 - 1.0)
        });
        (y.collect(), (0..200).map(|k| f64::from(k as u32 * 31 % 7)).collect())
    }

    /// Sums and changes of a bank over a pulse with a hole, in registers of the instructions `S`.
    fn found<S: Simd, const R: usize>(simd: S, structure: Structure, apart: usize) -> Found {
        let (mut y, v) = pulse(80, 120);
        y[150..155].fill(f64::NAN);
        let prices: Vec<f64> = (0..8).map(|m| 12.0 * f64::from(m)).collect();
        let mut theta = structure.beginning(5.0, 0.0);
        theta[1] = 0.0;
        theta[structure.lags + 1] = -8.0;
        let (noise, sums) = (4e-5, [1e-3, 1e-3, 1e-3]);
        let variance = 1e4;
        let sought = Sought { theta: &theta, y: &y, v: &v, variance, noise, sign: 1.0, sums, prices: &prices, apart };
        Bank { structure, sought: &sought }.run::<S, R>(simd)
    }

    #[test]
    fn a_bank_finds_where_the_load_steps_and_nothing_else() {
        let changes = found::<Scalar, LANES>(Scalar::new(), STEPS, 4).changes;
        assert_eq!(changes.len(), 2, "{changes:?}");
        for (found, truth) in changes.iter().zip([80.0, 120.0]) {
            assert!((found - truth).abs() <= 1.0, "{changes:?}");
        }
    }

    #[test]
    fn changes_are_as_far_apart_as_they_must_be() {
        let changes = found::<Scalar, LANES>(Scalar::new(), STEPS, 60).changes;
        assert!(changes.windows(2).all(|two| two[1] - two[0] >= 60.0), "{changes:?}");
    }

    #[test]
    fn a_bank_in_registers_of_every_width_has_the_same_bits() {
        let bits = |found: &Found| found.changes.iter().chain(&found.sums).map(|x| x.to_bits()).collect::<Vec<u64>>();
        for structure in
            [STEPS, BENDS, Structure { lags: 3, ..STEPS }, Structure { lags: 1, integrating: true, ..BENDS }]
        {
            let alone = bits(&found::<Scalar, LANES>(Scalar::new(), structure, 4));
            #[cfg(target_arch = "x86_64")]
            {
                use pulp::x86::{V3, V4};
                if let Some(simd) = V3::try_new() {
                    assert_eq!(bits(&found::<V3, 2>(simd, structure, 4)), alone, "{structure:?}");
                }
                if let Some(simd) = V4::try_new() {
                    assert_eq!(bits(&found::<V4, 1>(simd, structure, 4)), alone, "{structure:?}");
                }
            }
        }
    }

    #[test]
    fn a_change_anywhere_in_a_cell_has_the_mean_effect_of_all_places() {
        let (steps, bends) = (STEPS.beginning(5.0, 0.0), BENDS.beginning(5.0, 0.0));
        macro_rules! check {
            ($structure:expr, $theta:expr, $states:literal, $more:expr) => {
                let models = $structure.models::<Scalar, LANES, $states, { $more }>(Scalar::new(), &[$theta; LANES]);
                let every = Models::<Scalar, LANES, $states, { $more }>::EVERY as f64;
                let mut mean = [[0.0; $states]; $states];
                for place in 0..2000 {
                    let before = every * (f64::from(place) + 0.5) / 2000.0;
                    let reached = models.reached(Wide::all(Scalar::new(), before)).map(|r| r.lanes()[0]);
                    for i in 0..$states {
                        for j in 0..$states {
                            mean[i][j] += reached[i] * reached[j] / 2000.0;
                        }
                    }
                }
                for (spread, mean) in models.spread().iter().flatten().zip(mean.iter().flatten()) {
                    assert!((spread - mean).abs() < 1e-6, "{spread} for {mean}");
                }
            };
        }
        check!(STEPS, steps, 3, 0);
        check!(BENDS, bends, 4, LINES);
    }

    #[test]
    fn logarithms_are_right_to_a_few_in_a_million() {
        for power in -40..400 {
            let x = 1.17_f64.powi(power);
            assert!((ln(x) - x.ln()).abs() < 4e-6, "{x}");
        }
    }
}
