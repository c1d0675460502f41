//! Random numbers from the 32-bit generator of the noise block, many at a time.

use glapp_core::NoiseState;

/// M = 2³¹ − 1, the generator's modulus.
const M: u64 = 2_147_483_647;
/// Numbers drawn at once.
const BLOCK: usize = 8;

/// Power 48271ⁿ mod M.
const fn power(n: usize) -> u64 {
    let (mut p, mut i) = (1, 0);
    while i < n {
        p = p * 48_271 % M;
        i += 1;
    }
    p
}

/// s·factor mod M for s, factor < M: 2³¹ ≡ 1, so the upper bits count as much as the lower ones.
#[inline(always)]
pub(crate) const fn times(s: u64, factor: u64) -> u64 {
    let p = s * factor;
    let folded = (p & M) + (p >> 31);
    if folded >= M { folded - M } else { folded }
}

/// The number of [`glapp_core::Noise`] between −1 and 1 that belongs to an integer, to the bit.
#[inline(always)]
pub(crate) fn centred(integer: u64) -> f64 {
    (integer as f64 / M as f64 - 0.5) * 2.0
}

/// The integers that the block [`glapp_core::Noise`] draws, in its order: eight runs side by side, each 48271⁸ times its last one, so that
/// none waits for the one before.
#[derive(Clone, Debug)]
pub(crate) struct Integers {
    block: [u64; BLOCK],
    used: usize,
}

impl Integers {
    pub(crate) fn seeded(seed: u64) -> Self {
        let first = NoiseState::seeded(seed).integer as u64;
        Self { block: std::array::from_fn(|i| times(first, power(i + 1))), used: 0 }
    }

    #[inline(always)]
    pub(crate) fn next(&mut self) -> u64 {
        if self.used == BLOCK {
            self.used = 0;
            for s in &mut self.block {
                *s = times(*s, const { power(BLOCK) });
            }
        }
        self.used += 1;
        self.block[self.used - 1]
    }

    /// The next number between −1 and 1: uniform, variance 1/3.
    #[inline(always)]
    pub(crate) fn uniform(&mut self) -> f64 {
        centred(self.next())
    }

    /// The next numbers of [`Self::uniform`], each times `amplitude`, added to `out`.
    pub(crate) fn add_uniform(&mut self, amplitude: f64, out: &mut [f64]) {
        let mut blocks = out.chunks_exact_mut(BLOCK);
        if self.used == BLOCK || self.used == 0 {
            let mut first = self.used == 0;
            for out in &mut blocks {
                for (s, out) in self.block.iter_mut().zip(out) {
                    *s = if first { *s } else { times(*s, const { power(BLOCK) }) };
                    *out += amplitude * centred(*s);
                }
                first = false;
                self.used = BLOCK;
            }
            for out in blocks.into_remainder() {
                *out += amplitude * self.uniform();
            }
        } else {
            for out in out {
                *out += amplitude * self.uniform();
            }
        }
    }

    /// The next number of a nearly normal distribution, mean 0, variance 1: the sum of twelve numbers between 0 and 1,
    /// less 6. Its tails end at ±6, its kurtosis is 2.9; the sum is one of integers, so that only its division rounds.
    pub(crate) fn gaussian(&mut self) -> f64 {
        let sum: u64 = (0..12).map(|_| self.next()).sum();
        sum as f64 / M as f64 - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::Noise;

    #[test]
    fn the_numbers_are_those_of_the_block() {
        for seed in [0, 1, 77, u64::MAX] {
            let (block, mut state) = (Noise::new(0.3).unwrap(), NoiseState::seeded(seed));
            let expected: Vec<f64> = (0..4001).map(|_| block.update(&mut state, 0.0)).collect();
            let mut one_by_one = Integers::seeded(seed);
            assert!(expected.iter().all(|x| *x == 0.3 * one_by_one.uniform()));
            for pieces in [vec![4001], vec![8, 3993], vec![3, 16, 3982]] {
                let mut integers = Integers::seeded(seed);
                let mut out = vec![0.0; 4001];
                let mut rest = &mut out[..];
                for n in pieces {
                    let (piece, after) = rest.split_at_mut(n);
                    integers.add_uniform(0.3, piece);
                    rest = after;
                }
                assert_eq!(out, expected);
            }
        }
    }

    #[test]
    fn products_at_the_ends_of_the_range() {
        for (a, b) in [(M - 1, M - 1), (1, M - 1), (1, 1), (48_271, M - 1), (2, M / 2 + 1)] {
            assert_eq!(times(a, b), (u128::from(a) * u128::from(b) % u128::from(M)) as u64);
        }
    }

    #[test]
    fn nearly_normal() {
        let (mut integers, n) = (Integers::seeded(5), 200_000);
        let x: Vec<f64> = (0..n).map(|_| integers.gaussian()).collect();
        let mean = |power: i32| x.iter().map(|x| x.powi(power)).sum::<f64>() / f64::from(n);
        assert!(mean(1).abs() < 0.01 && (mean(2) - 1.0).abs() < 0.01 && mean(3).abs() < 0.03);
        assert!((mean(4) - 2.9).abs() < 0.06);
        let within = x.iter().filter(|x| x.abs() < 1.0).count() as f64 / f64::from(n);
        assert!((within - 0.6827).abs() < 0.006, "{within} within one standard deviation");
    }
}
