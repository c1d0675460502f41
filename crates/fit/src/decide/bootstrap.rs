//! Distribution of the likelihood ratio of no gap by chance.

use crate::data::backlash_model::BacklashModel;
use crate::search::likelihood::{Point, Search};
use crate::search::linear::{dot, solve};
use glapp_model::structure::{MOST, Theta};
use rayon::prelude::*;

/// Seed of the random numbers: the same record gets the same answer, in any unit.
const SEED: u64 = 1;
/// Draws at first, and at each further turn.
const INVENTED: usize = 100;

/// Widths that are tried against none, parts of OP's range.
const WIDTHS: [f64; 9] = [0.03, 0.08, 0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95];
/// Steps by which the process at a width comes to that of the model without a gap.
const STEPS: usize = 4;

/// The threshold of the likelihood ratio when there is no gap: innovations drawn from those of the best model without one, OP as
/// recorded (parametric bootstrap). So many draws that chance does not decide on which side of it `ratio` lies, at most `most`.
///
/// No record is fitted again (score test). The model without a gap foresees a PV. A model with the width d_j, at the process θ_j
/// that comes nearest, misses it by D_j in whitened PV. Near θ_j its residual is linear in the process:
///
/// ```text
/// r = ε + D_j + J_j·δ        ε: innovations, J_j: slopes of the residual by gain, process and load, δ: their change
/// min r² = |ε + D_j|² − |P_j·(ε + D_j)|²        P_j: projection on the columns of J_j
/// ratio = n·ln(min r² without a gap / least min r² of all widths)
/// ```
///
/// The dead time is among the columns.
pub(crate) fn bootstrap_threshold(search: &Search, without: &Point, ratio: f64, most: usize) -> f64 {
    let (innovations, score) = Score::new(search, without);
    let lr = |mut draws: Draws| {
        let draw = |_| innovations[(draws.next() % innovations.len() as u64) as usize];
        score.lr(&(0..innovations.len()).map(draw).collect::<Vec<f64>>())
    };
    let mut ratios: Vec<f64> = Vec::new();
    loop {
        let turn = ratios.len()..(ratios.len() + INVENTED).min(most);
        ratios.par_extend(turn.into_par_iter().map(|i| lr(Draws::new(SEED, i as u64))));
        let (threshold, error) = upper_percentile(&mut ratios);
        if ratios.len() >= most || (ratio - threshold).abs() > 3.0 * error {
            return threshold;
        }
    }
}

/// The model without a gap and those with the widths that are tried.
struct Score {
    none: Tangent,
    some: Vec<Tangent>,
    freedom: f64,
}

impl Score {
    /// Drawn from the innovations of the record under the model `without` a gap.
    fn new(search: &Search, without: &Point) -> (Vec<f64>, Self) {
        let positions = search.record.positions(&without.lost);
        let (innovations, slopes) = search.slopes(&without.theta, &positions);
        let of_noise = &slopes[search.structure.dead_time_at() + 1..];
        let record = search.record.with(search.predicted(without, &positions));
        let made = Search { record: &record, ..*search };
        let tangent = |part: f64| Tangent::new(&made, without, part * record.range, of_noise);
        let some = WIDTHS.into_par_iter().map(tangent).collect();
        (innovations, Self { none: tangent(0.0), some, freedom: search.record.freedom() })
    }

    /// The likelihood ratio of no gap with these innovations.
    fn lr(&self, innovations: &[f64]) -> f64 {
        let squares = dot(innovations, innovations);
        let least = self.some.iter().map(|tangent| tangent.least(innovations, squares)).fold(f64::INFINITY, f64::min);
        self.freedom * (self.none.least(innovations, squares) / least).ln().max(0.0)
    }
}

/// A width beside the model without a gap: its residual, and an orthonormal basis of the part that another process can
/// explain.
struct Tangent {
    /// D less its part in the basis, and the sum of its squares.
    left: Vec<f64>,
    energy: f64,
    basis: Vec<Vec<f64>>,
}

impl Tangent {
    /// `made`: PV that the model `without` a gap foresees.
    fn new(made: &Search, without: &Point, d: f64, of_noise: &[Vec<f64>]) -> Self {
        let lost = BacklashModel { d, ..without.lost.clone() };
        let positions = made.record.positions(&lost);
        let process = made.structure.dead_time_at() + 1;
        let (mut theta, mut best) = (without.theta, None::<(f64, Theta, Vec<f64>, Vec<Vec<f64>>)>);
        for _ in 0..STEPS {
            let (left, mut slopes) = made.slopes(&theta, &positions);
            slopes.truncate(process);
            let sum = dot(&left, &left);
            if best.as_ref().is_some_and(|(least, ..)| sum > 0.99 * least) {
                break;
            }
            let mut normal = [[0.0; MOST]; MOST];
            let mut by = [0.0; MOST];
            for i in 0..process {
                for j in 0..process {
                    normal[i][j] = dot(&slopes[i], &slopes[j]);
                }
                normal[i][i] = normal[i][i] * 1.001 + 1e-300;
                by[i] = -dot(&slopes[i], &left);
            }
            let step = solve(normal, by, process);
            best = Some((sum, theta, left, slopes));
            for i in 0..process {
                theta[i] += step[i].clamp(-1.0, 1.0);
            }
            theta = made.structure.bounded(theta, made.record.count as f64);
        }
        let (_, theta, left, slopes) = best.expect("a step at least");
        let (_, gain) = made.answers(&theta, &[&positions]);
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for mut column in gain.into_iter().chain(slopes).chain(of_noise.iter().cloned()) {
            let before = dot(&column, &column);
            project(&mut column, &basis);
            let size = dot(&column, &column);
            if size > 1e-10 * before && size > 1e-300 {
                column.iter_mut().for_each(|c| *c /= size.sqrt());
                basis.push(column);
            }
        }
        let mut left = left;
        project(&mut left, &basis);
        Self { energy: dot(&left, &left), left, basis }
    }

    /// The least sum of squares beside innovations of so many squares.
    fn least(&self, innovations: &[f64], squares: f64) -> f64 {
        let explained: f64 = self.basis.iter().map(|column| dot(column, innovations).powi(2)).sum();
        self.energy + 2.0 * dot(&self.left, innovations) + squares - explained
    }
}

/// Takes out of a column what those of an orthonormal basis hold of it.
fn project(column: &mut [f64], basis: &[Vec<f64>]) {
    // Twice: once loses digits where columns are nearly alike.
    for other in basis.iter().chain(basis) {
        let part = dot(column, other);
        column.iter_mut().zip(other).for_each(|(c, o)| *c -= part * o);
    }
}

/// Ratio that one in a hundred of `ratios` exceeds, and its standard error; their order is lost. Few lie so high: so
/// the fifth of them that is largest, or all above 0 where these are fewer, is taken for the beginning of an
/// exponential tail, as that of a chi-square is. Nor is it less than what a scaled half of a chi-square with the same
/// mean has there.
fn upper_percentile(ratios: &mut [f64]) -> (f64, f64) {
    ratios.sort_by(|a, b| b.total_cmp(a));
    let n = ratios.len() as f64;
    let most = ratios.len() / 5;
    let tail = &ratios[..ratios[..most].iter().filter(|r| **r > 0.0).count()];
    if tail.is_empty() {
        return (0.0, 0.0);
    }
    let (count, from) = (tail.len() as f64, if tail.len() == most { ratios[most] } else { 0.0 });
    let excess = tail.iter().map(|r| r - from).sum::<f64>() / count;
    let quantile = from + excess * (100.0 * count / n).ln().max(0.0);
    // Half a chi-square with one degree of freedom has the mean 1/2 and exceeds 5.41 once in a hundred records.
    let mean = ratios.iter().sum::<f64>() / n;
    let threshold = quantile.max(5.41 * mean / 0.5);
    (threshold, threshold / count.sqrt())
}

/// Numbers by chance, another row of them for each record (SplitMix64: Steele, Lea and Flood 2014).
pub(crate) struct Draws(u64);

impl Draws {
    pub(crate) fn new(seed: u64, record: u64) -> Self {
        // Begun beside each other, two rows would be the same numbers moved by one: where one begins is drawn, too.
        let mut draws = Self(seed);
        let mut begin = Self(draws.next() ^ record);
        Self(begin.next())
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// One of a standard normal distribution, but for its ends: the sum of twelve uniform numbers, less 6.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| (self.next() >> 11) as f64 / (1u64 << 53) as f64).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::cells::Cells;
    use glapp_model::structure::{Noise, Structure};

    #[test]
    fn the_score_gives_the_ratio_that_fits_give() {
        let (mut draws, mut op) = (Draws::new(3, 0), 0.0);
        let u: Vec<f64> = (0..600)
            .map(|k| {
                op += 0.2 * draws.normal() - 0.02 * op;
                op + (0.05 * f64::from(k)).sin()
            })
            .collect();
        let structure = Structure { lags: 2, integrating: false, noise: Noise::Still };
        let silent = Cells::new(&[(&u, &u)], 1);
        let theta = structure.beginning(8.0, 2.0);
        let made = Search { record: &silent, structure, sign: 1.0 };
        let lost = BacklashModel::gap(0.0, 1);
        let mut truth = made.descend(theta, &lost, 0, 0.1, f64::INFINITY);
        (truth.theta, truth.kp) = (theta, 1.0);
        let predicted = made.predicted(&truth, &silent.positions(&lost));
        let mut off = Vec::new();
        for _ in 0..6 {
            let y: Vec<f64> = predicted[0].iter().map(|y| y + 0.3 * draws.normal()).collect();
            let record = silent.with(vec![y]);
            let search = Search { record: &record, structure, sign: 1.0 };
            let at = |part: f64| BacklashModel::gap(part * record.range, 1);
            let without = search.from(&[(theta, at(0.0))], 20, 1e-4, f64::INFINITY);
            let fitted = |part: f64| search.from(&[(without.theta, at(part))], 20, 1e-4, f64::INFINITY).cost;
            let best = WIDTHS.map(fitted).into_iter().fold(f64::INFINITY, f64::min);
            let (innovations, score) = Score::new(&search, &without);
            off.push(score.lr(&innovations) - (without.cost - best).max(0.0));
        }
        assert!(off.iter().all(|off| off.abs() < 1.0), "{off:?}");
    }

    #[test]
    fn invented_records_share_no_noise() {
        let row = |record| {
            let mut draws = Draws::new(1, record);
            (0..50).map(|_| draws.next()).collect::<Vec<_>>()
        };
        let first = row(0);
        // Each was the one before, moved by a cell.
        for record in 1..40 {
            assert!(row(record).iter().all(|z| !first.contains(z)), "record {record}");
        }
    }

    #[test]
    fn what_one_in_a_hundred_exceeds_is_found_from_two_hundred() {
        let thresholds: Vec<f64> = (0..30)
            .map(|seed| {
                let mut draws = Draws::new(seed, 0);
                let mut ratios: Vec<f64> = (0..200).map(|_| half_chi_square(&mut draws)).collect();
                upper_percentile(&mut ratios).0
            })
            .collect();
        let mean = thresholds.iter().sum::<f64>() / 30.0;
        let spread = thresholds.iter().map(|t| (t - mean).powi(2)).sum::<f64>().sqrt() / 29f64.sqrt();
        assert!((5.0..6.5).contains(&mean), "{mean}");
        assert!(spread < 0.2 * mean, "{spread}");
    }

    /// A draw of half a chi-square with one degree of freedom: the square of a normal one where that is above 0.
    fn half_chi_square(draws: &mut Draws) -> f64 {
        draws.normal().max(0.0).powi(2)
    }
}
