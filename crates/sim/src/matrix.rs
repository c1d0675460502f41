//! Small square matrices: as much as sampling a plant needs.

/// A square matrix.
#[derive(Clone, Debug)]
pub struct Matrix {
    n: usize,
    rows: Vec<f64>,
}

impl Matrix {
    /// All zeros, `n` rows.
    pub fn zeros(n: usize) -> Self {
        Self { n, rows: vec![0.0; n * n] }
    }

    fn identity(n: usize) -> Self {
        let mut m = Self::zeros(n);
        for i in 0..n {
            m.set(i, i, 1.0);
        }
        m
    }

    /// Row `i`, column `j`.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.rows[i * self.n + j]
    }

    /// Sets row `i`, column `j`.
    pub fn set(&mut self, i: usize, j: usize, value: f64) {
        self.rows[i * self.n + j] = value;
    }

    /// Every number times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { n: self.n, rows: self.rows.iter().map(|x| x * factor).collect() }
    }

    /// Product self·other.
    pub fn times(&self, other: &Self) -> Self {
        let mut product = Self::zeros(self.n);
        for i in 0..self.n {
            for j in 0..self.n {
                product.set(i, j, (0..self.n).map(|k| self.get(i, k) * other.get(k, j)).sum());
            }
        }
        product
    }

    /// Largest sum of magnitudes in a row.
    fn norm(&self) -> f64 {
        self.rows.chunks(self.n).map(|row| row.iter().map(|x| x.abs()).sum()).fold(0.0, f64::max)
    }

    /// e^self: the series for a 2^s-th of the matrix, small enough for 14 terms to be exact, then s squarings.
    pub fn exp(&self) -> Self {
        let mut squarings = 0;
        let mut small = self.clone();
        while small.norm() > 0.25 {
            small = small.scaled(0.5);
            squarings += 1;
        }
        // Horner: I + A(I + A/2(I + A/3(…)))
        let mut sum = Self::identity(self.n);
        for term in (1..=14).rev() {
            sum = small.times(&sum).scaled(1.0 / f64::from(term));
            for i in 0..self.n {
                sum.set(i, i, sum.get(i, i) + 1.0);
            }
        }
        (0..squarings).fold(sum, |e, _| e.times(&e))
    }

    /// Largest magnitude of an eigenvalue, to about four digits: lim ‖Mᵏ‖^(1/k) (Gelfand) by squaring twenty times.
    pub fn spectral_radius(&self) -> f64 {
        let mut power = self.clone();
        let (mut log, mut weight) = (0.0, 1.0);
        for _ in 0..20 {
            let norm = power.norm();
            if norm == 0.0 {
                return 0.0;
            }
            log += norm.ln() * weight;
            weight /= 2.0;
            power = power.scaled(1.0 / norm);
            power = power.times(&power);
        }
        log.exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_of_a_rotation() {
        let mut m = Matrix::zeros(2);
        m.set(0, 1, 7.0);
        m.set(1, 0, -7.0);
        let e = m.exp();
        assert!((e.get(0, 0) - 7f64.cos()).abs() < 1e-13 && (e.get(0, 1) - 7f64.sin()).abs() < 1e-13);
    }

    #[test]
    fn radius_of_a_matrix_far_from_normal() {
        let mut m = Matrix::zeros(3);
        for (i, j, x) in [(0, 0, -2.0), (0, 1, 1e4), (1, 1, 0.5), (1, 2, -1e3), (2, 2, 1.9)] {
            m.set(i, j, x);
        }
        assert!((m.spectral_radius() - 2.0).abs() < 1e-3);
        assert_eq!(Matrix::zeros(2).spectral_radius(), 0.0);
    }
}
