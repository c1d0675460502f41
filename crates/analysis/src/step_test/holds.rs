//! Holds of OP.

use super::LEAST_ROWS;
use crate::median;
use std::ops::Range;

/// OP may stray from where it is held by so many standard deviations of its own noise, …
const NOISE: f64 = 8.0;
/// … or by this part of its range in the stretch, where it has none: a step of a test is a hundred times as large.
const OF_RANGE: f64 = 1e-3;
/// The two halves of a hold may differ by this part of that: a piece of a slow ramp wanders all through it.
const HALVES: f64 = 0.25;

/// Part of a mean that rounding may make of it.
const ROUNDING: f64 = 1e-12;

/// Median absolute deviation of normal noise to its standard deviation.
const MAD: f64 = 1.4826;

/// A hold in rows of the whole.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) first: usize,
    pub(super) end: usize,
    pub(super) stretch: usize,
    pub(super) op: f64,
    /// First settled row.
    pub(super) settled: Option<usize>,
    /// Side to which OP pressed the valve.
    pub(super) side: i8,
}

/// All holds with enough good values of `y`, and by how much OP may stray within one [OP unit].
pub(super) fn holds(op: &[f64], y: &[f64], stretches: &[Range<usize>]) -> (Vec<Node>, f64) {
    let mut nodes = Vec::new();
    let mut tolerance = 0.0f64;
    for (stretch, part) in stretches.iter().enumerate() {
        let (held, deviation) = held(&op[part.clone()]);
        tolerance = tolerance.max(deviation);
        for rows in held {
            let (first, end) = (rows.start + part.start, rows.end + part.start);
            if y[first..end].iter().filter(|y| y.is_finite()).count() >= LEAST_ROWS {
                let op = median(&mut op[first..end].to_vec());
                nodes.push(Node { first, end, stretch, op, settled: None, side: 0 });
            }
        }
    }
    (nodes, tolerance)
}

/// Rows in which OP stayed where it was, and by how much it may stray.
fn held(op: &[f64]) -> (Vec<Range<usize>>, f64) {
    // A ramp has no second difference; that of white noise has six times its variance.
    let mut second: Vec<f64> = op.windows(3).map(|w| (w[2] - w[1] - (w[1] - w[0])).abs()).collect();
    let noise = MAD * median(&mut second) / 6f64.sqrt();
    let range = super::range(op);
    let tolerance = (NOISE * noise).max(OF_RANGE * range);
    let mut found = Vec::new();
    let (mut first, mut low, mut high) = (0, op[0], op[0]);
    for (k, value) in op.iter().enumerate() {
        (low, high) = (low.min(*value), high.max(*value));
        if high - low > tolerance {
            found.push(first..k);
            (first, low, high) = (k, *value, *value);
        }
    }
    found.push(first..op.len());
    let mean = |rows: Range<usize>| op[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
    // Means of the same number are off by rounding.
    let rests = |rows: &Range<usize>| {
        let middle = usize::midpoint(rows.start, rows.end);
        let (first, second) = (mean(rows.start..middle), mean(middle..rows.end));
        (first - second).abs() <= HALVES * tolerance + ROUNDING * first.abs()
    };
    found.retain(|rows| rows.len() >= LEAST_ROWS && rests(rows));
    (found, tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lengths(op: &[f64]) -> Vec<usize> {
        held(op).0.into_iter().map(|rows| rows.len()).collect()
    }

    fn steps(parts: &[(usize, f64)]) -> Vec<f64> {
        parts.iter().flat_map(|(n, op)| vec![*op; *n]).collect()
    }

    #[test]
    fn a_hold_has_ten_rows_or_more() {
        assert_eq!(lengths(&steps(&[(10, 50.0), (9, 53.0), (14, 56.0)])), [10, 14]);
    }

    #[test]
    fn op_strays_by_a_thousandth_of_its_range_where_it_has_no_noise() {
        let stray = |by: f64| lengths(&steps(&[(20, 50.0), (20, 50.0 + by), (20, 60.0)]));
        assert_eq!(stray(0.012), [20, 20, 20], "beyond 0.001 of 10");
        assert_eq!(stray(0.008), [20], "within it, but the two halves differ");
        assert_eq!(stray(0.003), [20], "beyond a quarter of it");
        assert_eq!(stray(0.0024), [40, 20], "within");
    }

    #[test]
    fn op_strays_by_eight_times_its_noise() {
        // Triangular noise: its second differences tell its standard deviation.
        let noise = |k: usize| if k.is_multiple_of(2) { 0.02 } else { -0.02 };
        let mut op: Vec<f64> = (0..60).map(|k| 50.0 + noise(k)).collect();
        let (_, tolerance) = held(&op);
        assert!((tolerance - 8.0 * MAD * 0.08 / 6f64.sqrt()).abs() < 1e-12, "{tolerance}");
        op[30] += 0.9 * tolerance - 0.04;
        assert_eq!(lengths(&op), [60]);
        op[30] += 0.2 * tolerance;
        assert_eq!(lengths(&op), [30, 29]);
    }

    #[test]
    fn rounding_is_no_movement() {
        for n in 10..200 {
            assert_eq!(lengths(&vec![1.001; n]), [n]);
        }
    }

    #[test]
    fn a_slow_ramp_is_no_hold() {
        let ramp: Vec<f64> = (0..2000).map(|k| 0.001 * f64::from(k)).collect();
        assert_eq!(lengths(&ramp), [0; 0]);
    }
}
