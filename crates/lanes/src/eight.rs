//! Eight numbers side by side in the registers of a processor.

use crate::Sided;
use glapp_core::{Adding, LANES, Lanes, Numbers};
use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, Simd};
use pulp::{cast, f64x4, f64x8};
use std::array;
use std::ops::{Add, BitAnd, Div, Mul, Sub};

/// Eight numbers in `R` registers of the instructions `S`.
#[derive(Clone, Copy)]
pub(crate) struct Eight<S: Simd, const R: usize> {
    simd: S,
    registers: [S::f64s; R],
}

/// Result of a comparison of two [`Eight`].
#[derive(Clone, Copy)]
pub(crate) struct Truths<S: Simd, const R: usize> {
    simd: S,
    registers: [S::m64s; R],
}

/// Instructions that turn rows into columns.
pub(crate) trait Turn<const R: usize>: Simd {
    /// Transposes eight rows of eight numbers.
    fn turned(self, rows: [[Self::f64s; R]; LANES]) -> [[Self::f64s; R]; LANES];
}

impl<S: Simd, const R: usize> Eight<S, R> {
    /// Eight numbers, all 0.
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        Self { simd, registers: [simd.splat_f64s(0.0); R] }
    }

    /// The numbers combined with others, register by register.
    #[inline(always)]
    fn with(self, other: Self, of: impl Fn(S, S::f64s, S::f64s) -> S::f64s) -> Self {
        let of = |r| of(self.simd, self.registers[r], other.registers[r]);
        Self { simd: self.simd, registers: array::from_fn(of) }
    }
}

macro_rules! operators {
    ($($operator:ident $f:ident $of_registers:ident;)*) => {$(
        impl<S: Simd, const R: usize> $operator for Eight<S, R> {
            type Output = Self;

            #[inline(always)]
            fn $f(self, other: Self) -> Self {
                self.with(other, |simd, a, b| simd.$of_registers(a, b))
            }
        }
    )*};
}

operators! {
    Add add add_f64s;
    Sub sub sub_f64s;
    Mul mul mul_f64s;
    Div div div_f64s;
}

impl<S: Simd, const R: usize> BitAnd for Truths<S, R> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        let of = |r| self.simd.and_m64s(self.registers[r], other.registers[r]);
        Self { simd: self.simd, registers: array::from_fn(of) }
    }
}

impl<S: Simd, const R: usize> Numbers for Eight<S, R> {
    type Truth = Truths<S, R>;

    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self { registers: [self.simd.splat_f64s(x); R], ..self }
    }

    #[inline(always)]
    fn below(self, other: Self) -> Truths<S, R> {
        let of = |r| self.simd.less_than_f64s(self.registers[r], other.registers[r]);
        Truths { simd: self.simd, registers: array::from_fn(of) }
    }

    #[inline(always)]
    fn either(truth: Truths<S, R>, yes: Self, no: Self) -> Self {
        let of = |r| yes.simd.select_f64s(truth.registers[r], yes.registers[r], no.registers[r]);
        Self { registers: array::from_fn(of), ..yes }
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        Self { registers: self.registers.map(|x| self.simd.abs_f64s(x)), ..self }
    }

    // These instructions give the second of two that are alike, and so does [`glapp_core::Real`] its own.

    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        other.with(self, |simd, a, b| simd.min_f64s(a, b))
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        other.with(self, |simd, a, b| simd.max_f64s(a, b))
    }
}

impl<S: Simd, const R: usize> Adding<Self> for Eight<S, R> {
    #[inline(always)]
    fn add(&mut self, x: Self) {
        *self = *self + x;
    }

    #[inline(always)]
    fn to(self, x: Self) -> Self {
        x - self
    }

    #[inline(always)]
    fn since(self, other: Self) -> Self {
        self - other
    }
}

impl<S: Turn<R>, const R: usize> Lanes for Eight<S, R> {
    #[inline(always)]
    fn load(self, numbers: &[f64; LANES]) -> Self {
        let (registers, _) = S::as_simd_f64s(numbers);
        Self { registers: array::from_fn(|r| registers[r]), ..self }
    }

    #[inline(always)]
    fn numbers(self) -> [f64; LANES] {
        let mut numbers = [0.0; LANES];
        S::as_mut_simd_f64s(&mut numbers).0.copy_from_slice(&self.registers);
        numbers
    }

    #[inline(always)]
    fn any(truth: Truths<S, R>) -> bool {
        let Truths { simd, registers } = truth;
        let all = registers.into_iter().reduce(|a, b| simd.or_m64s(a, b));
        all.is_some_and(|all| simd.first_true_m64s(all) < S::F64_LANES)
    }

    #[inline(always)]
    fn turned(rows: [Self; LANES]) -> [Self; LANES] {
        let simd = rows[0].simd;
        let mut registers = [rows[0].registers; LANES];
        for l in 0..LANES {
            registers[l] = rows[l].registers;
        }
        let (registers, mut turned) = (simd.turned(registers), rows);
        for l in 0..LANES {
            turned[l] = Self { simd, registers: registers[l] };
        }
        turned
    }
}

// Without closures: what is not inlined does not know the instructions.

impl Turn<1> for V4 {
    #[inline(always)]
    fn turned(self, rows: [[f64x8; 1]; LANES]) -> [[f64x8; 1]; LANES] {
        let f = self.avx512f;
        let mut turned = rows;
        // Pairs of neighbouring rows, then of pairs, then of halves: even columns first.
        for odd in 0..2 {
            let mut pairs = [cast(rows[0][0]); 4];
            for i in 0..4 {
                let (a, b) = (cast(rows[2 * i][0]), cast(rows[2 * i + 1][0]));
                pairs[i] = if odd == 0 { f._mm512_unpacklo_pd(a, b) } else { f._mm512_unpackhi_pd(a, b) };
            }
            let [a, b, c, d] = pairs;
            let (low, high) = (f._mm512_shuffle_f64x2::<0x88>(a, b), f._mm512_shuffle_f64x2::<0x88>(c, d));
            turned[odd] = [cast(f._mm512_shuffle_f64x2::<0x88>(low, high))];
            turned[odd + 4] = [cast(f._mm512_shuffle_f64x2::<0xdd>(low, high))];
            let (low, high) = (f._mm512_shuffle_f64x2::<0xdd>(a, b), f._mm512_shuffle_f64x2::<0xdd>(c, d));
            turned[odd + 2] = [cast(f._mm512_shuffle_f64x2::<0x88>(low, high))];
            turned[odd + 6] = [cast(f._mm512_shuffle_f64x2::<0xdd>(low, high))];
        }
        turned
    }
}

impl Turn<2> for V3 {
    #[inline(always)]
    fn turned(self, rows: [[f64x4; 2]; LANES]) -> [[f64x4; 2]; LANES] {
        let a = self.avx;
        let mut turned = rows;
        for i in 0..2 {
            for j in 0..2 {
                let (x, y) = (cast(rows[4 * i][j]), cast(rows[4 * i + 1][j]));
                let (z, w) = (cast(rows[4 * i + 2][j]), cast(rows[4 * i + 3][j]));
                let (even, odd) = (a._mm256_unpacklo_pd(x, y), a._mm256_unpackhi_pd(x, y));
                let (even_too, odd_too) = (a._mm256_unpacklo_pd(z, w), a._mm256_unpackhi_pd(z, w));
                turned[4 * j][i] = cast(a._mm256_permute2f128_pd::<0x20>(even, even_too));
                turned[4 * j + 1][i] = cast(a._mm256_permute2f128_pd::<0x20>(odd, odd_too));
                turned[4 * j + 2][i] = cast(a._mm256_permute2f128_pd::<0x31>(even, even_too));
                turned[4 * j + 3][i] = cast(a._mm256_permute2f128_pd::<0x31>(odd, odd_too));
            }
        }
        turned
    }
}

/// Work with its inputs.
pub(crate) struct With<W, N> {
    pub(crate) work: W,
    pub(crate) like: N,
}

impl<W: Sided, N: Lanes> NullaryFnOnce for With<W, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.work.with(self.like);
    }
}
