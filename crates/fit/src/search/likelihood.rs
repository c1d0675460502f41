//! The likelihood of one family, with all that is linear in it at its best.
//!
//! A Kalman filter makes of PV its innovations ε_y, of the positions of the valve those of an answer with gain 1, ε_v. Both have the
//! variance S, in units of that of the white noise on PV, σ². With ε = ε_y − kp·ε_v,
//!
//! ```text
//! −2·ln L = Σ ln(2π·σ²·S) + Σ ε²/(σ²·S)
//! ```
//!
//! is least for kp = Σ(ε_y·ε_v/S)/Σ(ε_v²/S) and σ² = Σ(ε²/S)/n (concentrated likelihood). What is left is n·ln Σ r² and a constant, for
//! the residual r = ε/√S·exp(Σ ln S/2n).

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::{Cells, Positions, Strip};
use crate::decide::thresholds::PRICE_OF_CHANGE;
use glapp_model::kalman::{Sums, UNKNOWN, Whitened};
use glapp_model::lanes::{LANES, Lanes, Wide, Work, wide_enough};
use glapp_model::structure::{Load, Structure, Theta};
use pulp::Simd;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A point of the search: the family's parameters and what they are worth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) theta: Theta,
    /// −2·ln L but for a constant, the size of the noise and the gain at their best.
    pub(crate) cost: f64,
    /// Static gain (of an integrating process: velocity gain a cell) [PV unit / OP unit].
    pub(crate) kp: f64,
    pub(crate) lost: BacklashModel,
    /// Variance of the white noise on PV [PV unit²].
    pub(crate) noise: f64,
    /// Σ ε_y·ε_v/S and Σ ε_v²/S, of which the gain is the ratio.
    pub(crate) products: (f64, f64),
}

/// Innovations that the likelihood is made of: `residual` = innovation/√S·exp(Σ ln S/2n), whose sum of squares is to be
/// least.
#[derive(Clone, Debug, Default)]
pub(crate) struct Innovations {
    pub(crate) residual: Vec<Lanes>,
    pub(crate) kp: Lanes,
    pub(crate) sums: Sums,
    pub(crate) sum: Lanes,
    /// Sum of squares with gain 0: what the disturbance alone explains.
    pub(crate) sum_without: Lanes,
    /// exp(Σ ln S/2n).
    pub(crate) scale: Lanes,
    /// Σ Δᵢ·Δ for every lane i, where Δ is the residual of the first lane and what it is more in each other.
    pub(super) products: [Lanes; LANES],
}

impl Innovations {
    pub(crate) fn lane(&self, lane: usize) -> Vec<f64> {
        self.residual.iter().map(|r| r[lane]).collect()
    }
}

/// Purpose of a pass.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Wanted {
    /// The sums of the innovations of PV and of the answer.
    Sums,
    /// The sum of the squares of the residuals.
    Least,
    /// Every residual.
    Residuals,
    /// The products of the residuals.
    Products,
}

/// Cells in which a slope of the load may go through OP's range.
const LONG: f64 = 100.0;

/// One family on one record. `sign`: that of the gain where it is known, else 0.
#[derive(Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) record: &'a Cells,
    pub(crate) structure: Structure,
    pub(crate) sign: f64,
}

/// The gain that makes the least of Σ r², not of the other sign.
pub(super) fn gain(yv: f64, vv: f64, sign: f64) -> f64 {
    let kp = if vv > 1e-300 { yv / vv } else { 0.0 };
    if kp * sign < 0.0 { 0.0 } else { kp }
}

/// Σ r² of each lane, and the first rows of [`Innovations::products`].
#[inline(always)]
fn products<S: Simd, const R: usize, const ROWS: usize>(
    simd: S,
    residuals: impl Iterator<Item = Wide<S, R>>,
    sum: &mut Wide<S, R>,
    products: &mut [Lanes; LANES],
) {
    let mut rows = [Wide::all(simd, 0.0); ROWS];
    let first = Wide::load(simd, &Lanes::each(|l| if l == 0 { 0.0 } else { 1.0 }));
    for r in residuals {
        *sum += r * r;
        let more = r - first * Wide::all(simd, r.lanes()[0]);
        let each = more.lanes();
        for (row, of) in rows.iter_mut().zip(each.iter()) {
            *row += Wide::all(simd, *of) * more;
        }
    }
    products.iter_mut().zip(rows).for_each(|(product, row)| *product = row.lanes());
}

/// Residuals with the gain and the scale that are found, and their sums.
struct Residuals<'r> {
    white: &'r Whitened,
    /// Rows of the products: one for each parameter to move, and the residuals themselves.
    rows: usize,
    wanted: Wanted,
    found: &'r mut Innovations,
}

impl Work for Residuals<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, simd: S) {
        let Self { white, rows, wanted, found } = self;
        let load = |lanes: &Lanes| Wide::<S, R>::load(simd, lanes);
        let (kp, scale) = (load(&found.kp), load(&found.scale));
        let innovations = white.of_y().iter().zip(white.of_v());
        let residuals = innovations.map(|(y, v)| (load(y) - kp * load(v)) * scale);
        let mut sum = Wide::<S, R>::all(simd, 0.0);
        match wanted {
            Wanted::Sums | Wanted::Least => residuals.for_each(|r| sum += r * r),
            Wanted::Residuals => residuals.for_each(|r| {
                sum += r * r;
                found.residual.push(r.lanes());
            }),
            Wanted::Products => {
                macro_rules! of_rows {
                    ($($rows:literal)*) => {
                        match rows {
                            $($rows => products::<S, R, $rows>(simd, residuals, &mut sum, &mut found.products),)*
                            rows => unreachable!("{rows} rows"),
                        }
                    };
                }
                of_rows!(3 4 5 6 7 8);
            }
        }
        found.sum = sum.lanes();
    }
}

impl Search<'_> {
    /// Gain and residuals from what a pass of so many lanes left.
    pub(super) fn gain_and_residuals(&self, lanes: usize, white: &Whitened, found: &mut Innovations, wanted: Wanted) {
        found.sums = white.sums;
        found.residual.clear();
        if wanted == Wanted::Sums {
            return;
        }
        let sums = found.sums;
        found.kp = Lanes::each(|l| gain(sums.yv[l], sums.vv[l], self.sign));
        let freedom = self.record.freedom();
        // A change's size is free: it costs nothing here, and Search::price_of_changes what it is worth.
        let free = self.record.changes() as f64 * UNKNOWN.ln();
        found.scale = Lanes::each(|l| ((white.log_s[l] - free) / (2.0 * freedom)).exp());
        found.sum_without = Lanes::each(|l| sums.yy[l] * found.scale[l] * found.scale[l]);
        wide_enough(lanes, Residuals { white, rows: self.structure.parameters() + 1, wanted, found });
    }

    /// θ with the variance of its first disturbance that explains most: how restless a load is spans many powers of ten.
    pub(crate) fn with_best_load_variance(&self, theta: Theta, lost: &BacklashModel) -> Theta {
        let thetas: [Theta; LANES] = std::array::from_fn(|l| {
            let mut theta = theta;
            let [least, apart] = Load::of(self.structure).walks();
            theta[self.structure.lags + 1] = least + apart * l as f64;
            theta
        });
        let positions = self.record.positions(lost);
        let sums = self.innovations(&thetas, LANES, &positions, Wanted::Least, |found| found.sum);
        thetas[(0..LANES).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).expect("eight lanes")]
    }

    /// One set of parameters: the first lane tells.
    pub(crate) fn at(&self, theta: &Theta, positions: &Positions) -> Innovations {
        self.innovations(&[*theta; LANES], 1, positions, Wanted::Residuals, Innovations::clone)
    }

    /// −2·ln L with the size of the noise at its best.
    pub(crate) fn cost(&self, sum: f64) -> f64 {
        let freedom = self.record.freedom();
        freedom * ((sum.max(1e-300) / freedom).ln() + 1.0 + (2.0 * PI).ln())
    }

    /// Price of the marked changes of the load, where the gain is `kp` [−2·ln L]: each may lie at any cell, and be as large as
    /// OP's range or PV's, that of a slope as large as that in a hundred cells. Beside it each leaves one sample less to the noise.
    pub(crate) fn price_of_changes(&self, kp: f64) -> f64 {
        let changes = self.record.changes();
        let places: f64 = (0..changes).map(|known| self.price_of_place(known)).sum();
        changes as f64 * self.largest_change(kp).powi(2).ln() + places
    }

    /// Cost of this record at a point of another, with the price of its changes [−2·ln L].
    pub(crate) fn cost_at(&self, point: &Point, positions: &Positions) -> f64 {
        let sum = self.innovations(&[point.theta; LANES], 1, positions, Wanted::Least, |found| found.sum[0]);
        self.cost(sum) + self.price_of_changes(point.kp)
    }

    /// Variance of the white noise on PV in the first lane.
    pub(super) fn noise(&self, found: &Innovations) -> f64 {
        let scale = found.scale[0];
        found.sum[0] / (scale * scale) / self.record.freedom()
    }

    /// Largest change of the load that is thought of: the range of OP's possible effect, or of PV, since a process that hardly
    /// answers OP pays no less for its changes [PV unit, or PV unit/cell].
    pub(crate) fn largest_change(&self, kp: f64) -> f64 {
        // A load that makes PV's span in the whole record is the least that is thought of where PV is its integral.
        let seen =
            if self.structure.integrating { self.record.span / self.record.count as f64 } else { self.record.span };
        let largest = (kp * self.record.range).abs().max(seen);
        if Load::of(self.structure) == Load::Lines { largest / LONG } else { largest }
    }

    /// Price of one more change, and of its place [−2·ln L]: any order of them is possible, so all together cost the logarithm of the
    /// binomial coefficient.
    pub(crate) fn price_of_place(&self, known: usize) -> f64 {
        PRICE_OF_CHANGE + 2.0 * ((self.record.count - known) as f64 / (known + 1) as f64).ln()
    }

    /// PV as the process alone would make it from rest at the positions of a lost motion; none where the record has none.
    pub(crate) fn predicted(&self, point: &Point, positions: &Positions) -> Vec<Vec<f64>> {
        let delay = self.delay(&point.theta);
        let of = |(stretch, positions): (&Strip, &Vec<f64>)| {
            let v: Vec<f64> = delayed(positions, delay).iter().map(|v| v * point.kp).collect();
            let response = self.structure.response(&point.theta, &v);
            response.iter().zip(&*stretch.y).map(|(x, y)| if y.is_nan() { f64::NAN } else { *x }).collect()
        };
        self.record.stretches.iter().zip(positions).map(of).collect()
    }
}

/// Appends `v`, late by the whole cells of `delay`, to `shifted`: one cell more than `v`, from the cell before its first
/// on. Before its beginning `v` is what it is there.
#[inline(always)]
pub(super) fn shift(v: &[f64], delay: f64, shifted: &mut Vec<f64>) {
    let (n, from) = (v.len() as isize, shifted.len());
    let whole = delay.floor() as isize;
    let unseen = (whole + 1).clamp(0, n + 1);
    let skipped = (-1 - whole).clamp(0, n);
    shifted.resize(from + unseen as usize, v[0]);
    shifted.extend(v[skipped as usize..].iter().take((n + 1 - unseen) as usize));
    shifted.resize(from + v.len() + 1, v[v.len() - 1]);
}

/// `v`, late by `delay` [cells].
pub(crate) fn delayed(v: &[f64], delay: f64) -> Vec<f64> {
    let (mut shifted, part) = (Vec::new(), delay - delay.floor());
    shift(v, delay, &mut shifted);
    shifted.windows(2).map(|two| (1.0 - part) * two[1] + part * two[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_model::kalman::Delayed;
    use glapp_model::structure::Noise;
    use pulp::Scalar;
    use std::iter::once;

    #[test]
    fn residuals_in_registers_of_every_width_have_the_same_bits() {
        let structure = Structure { lags: 2, integrating: false, noise: Noise::Input };
        let y: Vec<f64> = (0..90).map(|k| (f64::from(k) * 0.1).sin() + 0.01 * f64::from(k * 7919 % 13)).collect();
        let v: Vec<Lanes> = (0..90).map(|k| Lanes::each(|l| (f64::from(k) * 0.1 + 0.02 * l as f64).sin())).collect();
        let mut white = Whitened::default();
        let thetas = [structure.beginning(8.0, 2.4); LANES];
        structure.whiten(LANES, &thetas, &mut once((&*y, [].as_slice(), Delayed::Each(&v))), &mut white);
        let rows = structure.parameters() + 1;
        let of = |run: &dyn Fn(Residuals)| {
            let mut found = Innovations { kp: Lanes::all(1.1), scale: Lanes::all(0.9), ..Innovations::default() };
            run(Residuals { white: &white, rows, wanted: Wanted::Products, found: &mut found });
            let products = found.products[..rows].iter().flat_map(|row| row.iter().take(rows));
            found.sum.iter().take(rows).chain(products).map(|x| x.to_bits()).collect::<Vec<u64>>()
        };
        let alone = of(&|residuals| residuals.run::<_, LANES>(Scalar::new()));
        assert!(alone.iter().all(|bits| f64::from_bits(*bits) != 0.0));
        #[cfg(target_arch = "x86_64")]
        {
            use pulp::x86::{V3, V4};
            if let Some(simd) = V3::try_new() {
                assert_eq!(of(&|residuals| residuals.run::<_, 2>(simd)), alone);
            }
            if let Some(simd) = V4::try_new() {
                assert_eq!(of(&|residuals| residuals.run::<_, 1>(simd)), alone);
            }
        }
    }
}
