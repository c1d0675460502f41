//! Settling time of PV after a move.
//!
//! The answers to all clear moves are laid over each other. t₁ and t₂ are the times at which 1/e and 1/e² of the way is left; of a
//! single lag T they are T and 2T, and a tail of so many time constants t₂ − t₁ later the answer is over.

use super::LEAST_ROWS;
use super::holds::Node;
use crate::median;

/// Time constants of the tail that must pass before PV counts as settled: exp(−5), 0.7 % of the response, is left.
pub(super) const TAILS: f64 = 5.0;
/// Standard errors by which the ends of two holds must differ for the move between them to be clear, …
const CLEAR: f64 = 4.0;
/// … where one value of noise in so many rows is taken as independent.
const INDEPENDENT: f64 = 5.0;
/// Holds shorter than this part of the median one are left out: the shortest decides how long is looked.
const SHORT: f64 = 0.5;
/// The answer at a move must be so many standard deviations of PV's noise to be laid over the others.
const ABOVE_NOISE: f64 = 3.0;
/// Standard error of the laid-over answers, part of the whole, above which the bins are made wider.
const ERROR: f64 = 0.03;
/// Bins that the shortest hold is cut into, finest first.
const BINS: [usize; 4] = [100, 50, 25, 12];
/// Fraction of a bin below which no tail is given.
const OF_BIN: f64 = 0.3;

/// One signal's answer (PV's or the position's) to OP, in rows.
pub(super) struct TestSignals<'a> {
    pub(super) t: &'a [f64],
    pub(super) op: &'a [f64],
    pub(super) y: &'a [f64],
    /// Median step \[s\].
    pub(super) h: f64,
}

struct Move<'a> {
    before: &'a Node,
    after: &'a Node,
    old: f64,
    new: f64,
    noise: f64,
    length: f64,
}

impl TestSignals<'_> {
    /// Time after a move until its answer is over \[s\].
    pub(super) fn settling(&self, nodes: &[Node]) -> f64 {
        let least = LEAST_ROWS as f64 * self.h;
        let moves = long_enough(self.clear_moves(nodes));
        if moves.is_empty() {
            return least;
        }
        let shortest = moves.iter().map(|m| m.length).fold(f64::INFINITY, f64::min);
        let mut bins = (0.0, Vec::new(), 0.0);
        for n in BINS {
            let width = shortest / n as f64;
            let (left, size, variance) = self.laid_over(&moves, n, shortest);
            bins = (width, left, size);
            if size == 0.0 || variance.sqrt() < ERROR * size {
                break;
            }
        }
        let (width, left, size) = bins;
        if size == 0.0 {
            return least;
        }
        // All of the answer is left at the move itself; what lies in a bin is that of its middle.
        let n = left.len();
        let edge = |i: usize| if i == n { shortest } else { i as f64 * width };
        let mut times = vec![0.0];
        times.extend((0..n).map(|i| (edge(i + 1) + edge(i)) / 2.0));
        times.push(shortest);
        let mut share = vec![1.0];
        share.extend(left.iter().map(|left| left.abs() / size));
        share.push(0.0);
        let [t1, t2] = [1.0f64, 2.0].map(|k| last_crossing(&times, &share, (-k).exp()));
        (t1 + TAILS * (t2 - t1).max(OF_BIN * width)).max(least)
    }

    fn clear_moves<'a>(&self, nodes: &'a [Node]) -> Vec<Move<'a>> {
        let mut moves = Vec::new();
        for pair in nodes.windows(2) {
            let [before, after] = [&pair[0], &pair[1]];
            if before.stretch != after.stretch {
                continue;
            }
            let ends = [self.last_third(before), self.last_third(after)];
            let noise = scatter(&ends[0]).max(scatter(&ends[1]));
            let [old, new] = [mean(&ends[0]), mean(&ends[1])];
            let independent = (ends[0].len().min(ends[1].len()) as f64 / INDEPENDENT).max(1.0);
            if (new - old).abs() > CLEAR * noise / independent.sqrt() {
                let length = self.t[after.end - 1] - self.t[after.first];
                moves.push(Move { before, after, old, new, noise, length });
            }
        }
        moves
    }

    /// Residual of all responses in each bin, their size together, and the variance of their sum.
    fn laid_over(&self, moves: &[Move], n: usize, shortest: f64) -> (Vec<f64>, f64, f64) {
        let width = shortest / n as f64;
        let mut left = vec![0.0; n];
        let (mut size, mut variance) = (0.0, 0.0);
        for m in moves {
            let rows = m.after.first..m.after.end;
            let (mut count, mut total) = (vec![0usize; n], vec![0.0; n]);
            for k in rows {
                let since = self.t[k] - self.t[m.after.first];
                if !self.y[k].is_finite() || since >= shortest {
                    continue;
                }
                let bin = bin(since, width, n);
                count[bin] += 1;
                total[bin] += m.new - self.y[k];
            }
            if count.iter().all(|count| *count == 0) {
                continue;
            }
            let value = filled(&count, &total);
            // A step starts where the hold before ended; after a slow ramp most of the answer has already come.
            let at_once = self.t[m.after.first] - self.t[m.before.end - 1] <= 2.0 * self.h;
            let begin = if at_once { m.new - m.old } else { value[0] };
            if begin * (m.new - m.old) <= 0.0 || begin.abs() < ABOVE_NOISE * m.noise {
                continue;
            }
            let sign = if m.new > m.old { 1.0 } else { -1.0 };
            left.iter_mut().zip(&value).for_each(|(left, value)| *left += sign * value);
            size += begin.abs();
            let rows = count.iter().sum::<usize>() as f64 / n as f64;
            variance += m.noise * m.noise / rows.max(1.0);
        }
        (left, size, variance)
    }

    /// Good values of the last third of a hold.
    fn last_third(&self, node: &Node) -> Vec<f64> {
        let first = node.end - (node.end - node.first).div_ceil(3);
        let y: Vec<f64> = self.y[first..node.end].iter().copied().filter(|y| y.is_finite()).collect();
        if y.is_empty() { vec![0.0] } else { y }
    }
}

/// The moves without those that are held much shorter than the others.
fn long_enough(mut moves: Vec<Move>) -> Vec<Move> {
    let shortest = SHORT * median(&mut moves.iter().map(|m| m.length).collect::<Vec<_>>());
    moves.retain(|m| m.length >= shortest);
    moves
}

/// The bin of a time; its edges are at multiples of the width, to the bit.
fn bin(since: f64, width: f64, n: usize) -> usize {
    let mut at = ((since / width) as usize).min(n - 1);
    while at > 0 && since < at as f64 * width {
        at -= 1;
    }
    while at + 1 < n && since >= (at + 1) as f64 * width {
        at += 1;
    }
    at
}

/// Means of the bins; those of empty ones by a straight line between their neighbours.
fn filled(count: &[usize], total: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..count.len()).filter(|i| count[*i] > 0).collect();
    let value = |i: usize| total[i] / count[i] as f64;
    (0..count.len())
        .map(|i| {
            let after = known.partition_point(|k| *k < i);
            match (after.checked_sub(1).map(|k| known[k]), known.get(after).copied()) {
                (_, Some(at)) if at == i => value(i),
                (Some(a), Some(b)) => value(a) + (value(b) - value(a)) / (b - a) as f64 * (i - a) as f64,
                (Some(at), None) | (None, Some(at)) => value(at),
                (None, None) => f64::NAN,
            }
        })
        .collect()
}

/// Last crossing of the level by y, which starts above it and ends below it.
fn last_crossing(x: &[f64], y: &[f64], level: f64) -> f64 {
    let at = y.iter().rposition(|y| *y > level).unwrap_or(0);
    x[at] + (x[at + 1] - x[at]) * (y[at] - level) / (y[at] - y[at + 1])
}

fn mean(y: &[f64]) -> f64 {
    y.iter().sum::<f64>() / y.len() as f64
}

/// Standard deviation of the residuals of a straight-line fit; 0 for fewer than four values.
fn scatter(y: &[f64]) -> f64 {
    let n = y.len();
    if n < 4 {
        return 0.0;
    }
    let (centre, middle) = (mean(y), (n - 1) as f64 / 2.0);
    let x = |k: usize| k as f64 - middle;
    let (mut xy, mut xx) = (0.0, 0.0);
    for (k, y) in y.iter().enumerate() {
        xy += x(k) * y;
        xx += x(k) * x(k);
    }
    let square = |(k, y): (usize, &f64)| (y - centre - x(k) * xy / xx).powi(2);
    (y.iter().enumerate().map(square).sum::<f64>() / n as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers of one lag to a move each 100 s, and the holds.
    fn answered(lag: f64, noise: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<Node>) {
        let levels = [50.0, 54.0, 58.0, 53.0];
        let (mut y, mut op) = (Vec::new(), Vec::new());
        let mut now = levels[0];
        for (i, level) in levels.iter().enumerate() {
            for k in 0..100 {
                let to = *level;
                now = if i == 0 { to } else { to + (levels[i - 1] - to) * (-f64::from(k) / lag).exp() };
                let random = f64::from((k * k * 7919 + 31 * k) % 1009) / 1009.0 - 0.5;
                y.push(now + noise * random);
                op.push(to);
            }
        }
        let _ = now;
        let node =
            |i: usize| Node { first: 100 * i, end: 100 * (i + 1), stretch: 0, op: levels[i], settled: None, side: 0 };
        ((0..400).map(f64::from).collect(), op, y, (0..4).map(node).collect())
    }

    #[test]
    fn one_lag_settles_six_time_constants_after_a_move() {
        for lag in [4.0, 8.0] {
            let (t, op, y, nodes) = answered(lag, 0.0);
            let found = TestSignals { t: &t, op: &op, y: &y, h: 1.0 }.settling(&nodes);
            assert!((found / lag - 6.0).abs() < 0.1, "{found} for {lag}");
        }
    }

    #[test]
    fn nothing_that_answers_settles_within_ten_rows() {
        let (t, op, _, nodes) = answered(4.0, 0.0);
        let flat = vec![7.0; 400];
        assert_eq!(TestSignals { t: &t, op: &op, y: &flat, h: 1.0 }.settling(&nodes), 10.0);
    }

    #[test]
    fn values_fall_into_the_bin_whose_edge_they_reach() {
        let width = 99.0 / 25.0;
        for i in 0..25 {
            assert_eq!(bin(i as f64 * width, width, 25), i);
        }
        assert_eq!(filled(&[0, 1, 0, 0, 2, 0], &[0.0, 1.0, 0.0, 0.0, 8.0, 0.0]), [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
        assert_eq!(last_crossing(&[0.0, 1.0, 2.0, 3.0], &[1.0, 0.2, 0.6, 0.0], 0.3), 2.5);
    }

    /// Two holds of 90 rows, the second higher by `step`, about both of which PV goes by ±1.
    fn step_in_noise(step: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<Node>) {
        let level = |k: usize| if k < 90 { 0.0 } else { step };
        let y = (0..180).map(|k| level(k) + if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let node =
            |i: usize| Node { first: 90 * i, end: 90 * (i + 1), stretch: 0, op: i as f64, settled: None, side: 0 };
        let op = (0..180).map(|k| (k / 90) as f64).collect();
        ((0..180).map(|k| k as f64).collect(), op, y, vec![node(0), node(1)])
    }

    #[test]
    fn a_move_is_clear_beyond_four_standard_errors_and_laid_over_the_others_beyond_three_of_noise() {
        // 4/√(30/5) = 1.63: a third of a hold is 30 rows, every fifth of which counts.
        for (step, clear, laid_over) in [(1.5, 0, false), (1.8, 1, false), (2.8, 1, false), (3.2, 1, true)] {
            let (t, op, y, nodes) = step_in_noise(step);
            let signals = TestSignals { t: &t, op: &op, y: &y, h: 1.0 };
            let moves = signals.clear_moves(&nodes);
            assert_eq!(moves.len(), clear, "{step}");
            assert_eq!(signals.laid_over(&moves, 25, 89.0).1 > 0.0, laid_over, "{step}");
        }
    }

    #[test]
    fn a_hold_shorter_than_half_the_median_one_is_left_out() {
        let (_, _, _, nodes) = step_in_noise(3.0);
        let of = |length| Move { before: &nodes[0], after: &nodes[1], old: 0.0, new: 1.0, noise: 0.0, length };
        let kept = |shortest: f64| long_enough([100.0, 100.0, shortest].map(of).into()).len();
        assert_eq!([kept(55.0), kept(45.0)], [3, 2]);
    }

    #[test]
    fn a_process_without_lag_has_the_tail_of_a_part_of_a_bin() {
        // One step, held for 1001 rows: a bin is 10 s. All is left at 0, nothing at the middle of the first bin.
        let y: Vec<f64> = (0..2002).map(|k| if k < 1001 { 0.0 } else { 1.0 }).collect();
        let t: Vec<f64> = (0..2002).map(f64::from).collect();
        let node =
            |i: usize| Node { first: 1001 * i, end: 1001 * (i + 1), stretch: 0, op: i as f64, settled: None, side: 0 };
        let found = TestSignals { t: &t, op: &y, y: &y, h: 1.0 }.settling(&[node(0), node(1)]);
        let expected = 5.0 * (1.0 - (-1f64).exp()) + 5.0 * 0.3 * 10.0;
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn the_noisier_pv_is_the_wider_are_the_bins() {
        // Standard deviations of 0.27, 0.38 and 0.6 beside moves of 4, 4 and −5: 50, 25 and 12 bins. As the code has it.
        for (noise, expected) in [(0.935, 35.1797730885), (1.316, 35.6162750984), (2.08, 29.3321698151)] {
            let (t, op, y, nodes) = answered(6.0, noise);
            let found = TestSignals { t: &t, op: &op, y: &y, h: 1.0 }.settling(&nodes);
            assert!((found - expected).abs() < 1e-9, "{found} for {noise}");
        }
    }
}
