//! Settled holds cut into blocks, with the drift and the random walk that they may share.

use super::holds::Node;
use nalgebra::DMatrix;

/// Means that a settled hold is cut into: enough to see drift, long enough to leave noise uncorrelated.
pub(super) const MEANS: usize = 16;
/// Slopes that a settled hold is cut into: fewer, since their certainty falls with the third power of a block's length.
pub(super) const SLOPES: usize = 4;
/// Fewest blocks of a hold: level, drift, and one that tells noise.
const FEWEST: usize = 3;
/// Fewest rows of a block, where the hold has more than [`FEWEST`] times as many.
const ROWS: usize = 4;
/// Blocks of all holds together, as far as [`FEWEST`] allows: the time to read them grows with the third power.
const ALL: usize = 300;

/// Means (or slopes) of pieces of settled holds.
#[derive(Clone, Debug, Default)]
pub(super) struct Blocks {
    pub(super) y: Vec<f64>,
    /// Weight: rows, of a slope the sum of squares of time, as part of the mean one.
    pub(super) rows: Vec<f64>,
    /// Middle in time \[s\].
    pub(super) middle: Vec<f64>,
    /// Length in time \[s\].
    pub(super) width: Vec<f64>,
    pub(super) hold: Vec<usize>,
    pub(super) stretch: Vec<usize>,
    /// Lag through which the load comes \[s\].
    pub(super) lag: f64,
}

impl Blocks {
    /// The settled rows of the holds, whose places here are those of the blocks' `hold`.
    pub(super) fn of(t: &[f64], y: &[f64], h: f64, nodes: &[Node], lag: f64, slopes: bool) -> Self {
        let mut blocks = Self { lag, ..Self::default() };
        let most = if slopes { SLOPES } else { MEANS };
        for (i, node) in nodes.iter().enumerate() {
            let first = node.settled.unwrap_or(node.end);
            let rows: Vec<usize> = (first..node.end).filter(|k| y[*k].is_finite()).collect();
            let parts = most.min(rows.len() / ROWS).min(ALL / nodes.len()).max(FEWEST);
            for part in split(&rows, parts) {
                let n = part.len() as f64;
                let middle = part.iter().map(|k| t[*k]).sum::<f64>() / n;
                let (value, weight) = if slopes {
                    let squares: f64 = part.iter().map(|k| (t[*k] - middle).powi(2)).sum();
                    (part.iter().map(|k| (t[*k] - middle) * y[*k]).sum::<f64>() / squares, squares)
                } else {
                    (part.iter().map(|k| y[*k]).sum::<f64>() / n, n)
                };
                blocks.y.push(value);
                blocks.rows.push(weight);
                blocks.middle.push(middle);
                blocks.width.push(t[part[part.len() - 1]] - t[part[0]] + h);
                blocks.hold.push(i);
                blocks.stretch.push(node.stretch);
            }
        }
        let mean = mean(&blocks.rows);
        blocks.rows.iter_mut().for_each(|rows| *rows /= mean);
        blocks
    }

    pub(super) fn len(&self) -> usize {
        self.y.len()
    }

    /// The blocks of some holds.
    pub(super) fn of_holds(&self, holds: &[usize]) -> Self {
        let keep: Vec<usize> = (0..self.len()).filter(|i| holds.contains(&self.hold[*i])).collect();
        let pick = |x: &[f64]| keep.iter().map(|i| x[*i]).collect();
        Self {
            y: pick(&self.y),
            rows: pick(&self.rows),
            middle: pick(&self.middle),
            width: pick(&self.width),
            hold: keep.iter().map(|i| self.hold[*i]).collect(),
            stretch: keep.iter().map(|i| self.stretch[*i]).collect(),
            lag: self.lag,
        }
    }

    /// Covariance of the means of a random walk of unit variance per second behind the process, up to a constant.
    ///
    /// Through a lag T it is −|r|/2 − T/2·exp(−|r|/T) over a distance r in time. Each mean is taken at three points, those of
    /// Gauss and Legendre. Each stretch has a level of its own, so a constant does not matter; it keeps the matrix positive.
    pub(super) fn walk(&self) -> DMatrix<f64> {
        const SHARE: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
        let n = self.len();
        let lag = self.lag.max(1e-9 * mean(&self.width));
        let reach = 0.15f64.sqrt();
        let at: Vec<[f64; 3]> =
            (0..n).map(|i| [-1.0, 0.0, 1.0].map(|side| self.middle[i] + self.width[i] * side * reach)).collect();
        let ends = at.iter().flatten();
        let (first, last) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)));
        let constant = last - first + lag;
        let kernel = |i: usize, j: usize| {
            let mut sum = 0.0;
            for (a, u) in at[i].iter().zip(SHARE) {
                for (b, v) in at[j].iter().zip(SHARE) {
                    let apart = (a - b).abs();
                    sum += u * v * (-apart / 2.0 - lag / 2.0 * (-apart / lag).exp());
                }
            }
            sum + constant
        };
        let mut walk = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in (0..=i).filter(|j| self.stretch[*j] == self.stretch[i]) {
                walk[(i, j)] = kernel(i, j);
                walk[(j, i)] = walk[(i, j)];
            }
        }
        walk
    }

    /// Columns of the regression that each stretch has of its own: a level, where that is asked for, and a drift.
    pub(super) fn drift(&self, levels: bool) -> Vec<Vec<f64>> {
        let mut columns = Vec::new();
        for stretch in distinct(&self.stretch) {
            let inside: Vec<f64> = self.stretch.iter().map(|s| f64::from(u8::from(*s == stretch))).collect();
            let middles: Vec<f64> =
                self.middle.iter().zip(&inside).filter(|(_, inside)| **inside > 0.0).map(|(t, _)| *t).collect();
            let (centre, length) = (mean(&middles), super::range(&middles).max(1e-300));
            let slope = self.middle.iter().zip(&inside).map(|(t, inside)| inside * (t - centre) / length).collect();
            if levels {
                columns.push(inside);
            }
            columns.push(slope);
        }
        columns
    }

    /// A column for each hold, 1 in its blocks.
    pub(super) fn levels(&self) -> Vec<Vec<f64>> {
        let one = |hold: usize| self.hold.iter().map(|h| f64::from(u8::from(*h == hold))).collect();
        distinct(&self.hold).into_iter().map(one).collect()
    }
}

/// Columns side by side.
pub(super) fn matrix(columns: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(columns[0].len(), columns.len(), |i, j| columns[j][i])
}

/// The values that there are, in ascending order.
fn distinct(of: &[usize]) -> Vec<usize> {
    let mut all = of.to_vec();
    all.sort_unstable();
    all.dedup();
    all
}

pub(super) fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Splits rows into parts whose lengths differ by one at most, the longer ones first.
fn split(rows: &[usize], parts: usize) -> impl Iterator<Item = &[usize]> {
    let (least, longer) = (rows.len() / parts, rows.len() % parts);
    let start = move |i: usize| i * least + i.min(longer);
    (0..parts).map(move |i| &rows[start(i)..start(i + 1)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(rows: usize, holds: usize, slopes: bool) -> Blocks {
        let n = rows * holds;
        let t: Vec<f64> = (0..n).map(|k| k as f64).collect();
        let y: Vec<f64> = t.iter().map(|t| 3.0 + 0.5 * t).collect();
        let node = |i: usize| Node {
            first: i * rows,
            end: (i + 1) * rows,
            stretch: 0,
            op: i as f64,
            settled: Some(i * rows),
            side: 0,
        };
        Blocks::of(&t, &y, 1.0, &(0..holds).map(node).collect::<Vec<_>>(), 0.0, slopes)
    }

    #[test]
    fn a_hold_is_cut_into_16_means_or_4_slopes_fewer_where_it_is_short_or_there_are_many() {
        let count = |rows, holds, slopes| blocks(rows, holds, slopes).len() / holds;
        assert_eq!([count(200, 3, false), count(200, 3, true)], [16, 4]);
        assert_eq!([count(23, 3, false), count(10, 3, false), count(13, 3, true)], [5, 3, 3]);
        assert_eq!([count(100, 40, false), count(100, 60, false)], [7, 5]);
        let slopes = blocks(50, 3, true);
        assert!(slopes.y.iter().all(|y| (y - 0.5).abs() < 1e-12));
        assert!((mean(&slopes.rows) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_walk_grows_apart_by_its_variance_per_second() {
        let mut blocks = blocks(160, 2, false);
        // E (w_i − w_j)² = |t_i − t_j| far apart, less a third of a block's width for taking means.
        let walk = blocks.walk();
        let apart = |walk: &DMatrix<f64>, i, j| walk[(i, i)] + walk[(j, j)] - 2.0 * walk[(i, j)];
        let expected = blocks.middle[20] - blocks.middle[0] - blocks.width[0] / 3.0;
        assert!((apart(&walk, 0, 20) / expected - 1.0).abs() < 0.01, "{}", apart(&walk, 0, 20));
        blocks.lag = 5.0;
        let lagging = blocks.walk();
        let left = apart(&lagging, 0, 1) / apart(&walk, 0, 1);
        assert!((left - 0.69).abs() < 0.05, "{left}");
    }
}
