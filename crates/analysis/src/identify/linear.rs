//! Sums over long columns, and symmetric matrices of at most five rows.

use nalgebra::{DMatrix, SymmetricEigen};

/// The residual of a fit and its columns are at most five.
pub(super) type Matrix = DMatrix<f64>;

/// Most rounds of the search for eigenvalues; it takes a handful.
const ROUNDS: usize = 1000;

/// Σ w a b, in eight sums side by side.
pub(super) fn weighted(w: &[f64], a: &[f64], b: &[f64]) -> f64 {
    let ((w, w_rest), (a, a_rest), (b, b_rest)) = (w.as_chunks::<8>(), a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut lanes = [0.0; 8];
    for ((w, a), b) in w.iter().zip(a).zip(b) {
        for (k, lane) in lanes.iter_mut().enumerate() {
            *lane += w[k] * a[k] * b[k];
        }
    }
    let rest = w_rest.iter().zip(a_rest).zip(b_rest).map(|((w, a), b)| w * a * b);
    lanes.iter().sum::<f64>() + rest.sum::<f64>()
}

/// Weighted moments of columns, Σ w a b of every two.
pub(super) fn moments<C: AsRef<[f64]>>(w: &[f64], columns: &[C]) -> Matrix {
    let mut moments = Matrix::zeros(columns.len(), columns.len());
    for (i, a) in columns.iter().enumerate() {
        for (j, b) in columns.iter().enumerate().skip(i) {
            moments[(i, j)] = weighted(w, a.as_ref(), b.as_ref());
            moments[(j, i)] = moments[(i, j)];
        }
    }
    moments
}

/// A symmetric matrix without its first row and column, after elimination.
pub(super) fn without_first(a: &Matrix) -> Matrix {
    a.view((1, 1), (a.nrows() - 1, a.ncols() - 1)).into_owned()
}

/// Ratio of the largest to the smallest singular value of a symmetric matrix; infinite where it cannot be computed.
pub(super) fn condition(a: &Matrix) -> f64 {
    if !a.iter().all(|x| x.is_finite()) {
        return f64::INFINITY;
    }
    let Some(eigen) = SymmetricEigen::try_new(a.clone(), f64::EPSILON, ROUNDS) else { return f64::INFINITY };
    let sizes = eigen.eigenvalues.abs();
    if sizes.min() > 0.0 { sizes.max() / sizes.min() } else { f64::INFINITY }
}

/// Inverse of a symmetric matrix; none where its condition is worse.
pub(super) fn inverse(a: &Matrix, worst: f64) -> Option<Matrix> {
    if condition(a) > worst { None } else { a.clone().lu().try_inverse() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_any_length() {
        for n in [0, 1, 7, 8, 9, 30] {
            let x: Vec<f64> = (0..n).map(f64::from).collect();
            let plain: f64 = x.iter().map(|x| x * (x + 1.0) * 2.0).sum();
            let (one_more, twos): (Vec<f64>, Vec<f64>) = x.iter().map(|x| (x + 1.0, 2.0)).unzip();
            assert_eq!(weighted(&x, &one_more, &twos), plain);
        }
    }

    #[test]
    fn condition_is_that_of_the_singular_values() {
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        close(condition(&Matrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0])), 3.0);
        close(condition(&Matrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0])), 3.0); // eigenvalues 3 and -1
        close(condition(&Matrix::from_row_slice(2, 2, &[1e200, 0.0, 0.0, 1e190])), 1e10);
        assert!(condition(&Matrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0])) > 1e15);
        assert_eq!(condition(&Matrix::from_row_slice(2, 2, &[1.0, f64::NAN, f64::NAN, 1.0])), f64::INFINITY);
    }

    #[test]
    fn inverse_unless_too_near_to_singular() {
        let a = Matrix::from_row_slice(2, 2, &[1.0, 1.0 - 1e-7, 1.0 - 1e-7, 1.0]);
        assert_eq!(inverse(&a, 1e6), None);
        let identity = inverse(&a, 1e8).unwrap() * a;
        assert!((identity - Matrix::identity(2, 2)).abs().max() < 1e-8);
    }
}
