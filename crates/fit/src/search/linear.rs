//! Sums of products, and small systems of linear equations.

use glapp_model::structure::{MOST, Theta};

/// Σ aᵢ·bᵢ.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums at once: the order is stated, so that every machine gets the same bits.
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Solves the symmetric, positive definite a·x = b of order `k` by Cholesky's factors; no move where it is not definite.
pub(crate) fn solve(mut a: [[f64; MOST]; MOST], mut b: Theta, k: usize) -> Theta {
    for j in 0..k {
        for i in j..k {
            let sum: f64 = (0..j).map(|m| a[i][m] * a[j][m]).sum();
            let rest = a[i][j] - sum;
            if i == j {
                if rest <= 0.0 {
                    return [0.0; MOST];
                }
                a[j][j] = rest.sqrt();
            } else {
                a[i][j] = rest / a[j][j];
            }
        }
    }
    for i in 0..k {
        let sum: f64 = (0..i).map(|m| a[i][m] * b[m]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    for i in (0..k).rev() {
        let sum: f64 = (i + 1..k).map(|m| a[m][i] * b[m]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    b
}
