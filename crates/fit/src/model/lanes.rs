//! Eight numbers side by side: in memory, and in the widest registers that the machine has.
//!
//! Left to itself the compiler lays the vectors of short loops across the wrong index; here each operation is one of whole
//! registers. Nothing is fused, so the bits are the same on every machine.

use pulp::Simd;
use std::array;
use std::ops::{Add, AddAssign, Deref, DerefMut, Div, Mul, MulAssign, Sub, SubAssign};

/// Models that are run side by side: the recurrence waits for itself, eight of them fill the waiting, and a point with all
/// its derivatives is one pass.
pub(crate) const LANES: usize = 8;

/// One number for each of the models that run side by side. Aligned to the widest registers: what lies across the border of
/// two lines of the cache waits for both.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Lanes([f64; LANES]);

impl Lanes {
    pub(crate) fn all(x: f64) -> Self {
        Self([x; LANES])
    }

    pub(crate) fn each(of: impl FnMut(usize) -> f64) -> Self {
        Self(array::from_fn(of))
    }
}

impl Deref for Lanes {
    type Target = [f64; LANES];

    #[inline(always)]
    fn deref(&self) -> &[f64; LANES] {
        &self.0
    }
}

impl DerefMut for Lanes {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64; LANES] {
        &mut self.0
    }
}

/// [`Lanes`] in `R` registers of the instructions `S`; where these hold fewer numbers, the first of them, and 0 for the others.
#[derive(Clone, Copy)]
pub(crate) struct Wide<S: Simd, const R: usize> {
    pub(crate) simd: S,
    registers: [S::f64s; R],
}

impl<S: Simd, const R: usize> Wide<S, R> {
    #[inline(always)]
    pub(crate) fn all(simd: S, x: f64) -> Self {
        Self { simd, registers: [simd.splat_f64s(x); R] }
    }

    /// The first eight of these numbers.
    #[inline(always)]
    pub(crate) fn begin(simd: S, numbers: &[f64]) -> Self {
        let (registers, _) = S::as_simd_f64s(&numbers[..LANES]);
        Self { simd, registers: array::from_fn(|r| registers[r]) }
    }

    #[inline(always)]
    pub(crate) fn load(simd: S, lanes: &Lanes) -> Self {
        let (registers, _) = S::as_simd_f64s(&lanes.0);
        Self { simd, registers: array::from_fn(|r| registers[r]) }
    }

    #[inline(always)]
    pub(crate) fn lanes(self) -> Lanes {
        let mut lanes = Lanes::default();
        let (registers, _) = S::as_mut_simd_f64s(&mut lanes.0);
        registers.iter_mut().zip(self.registers).for_each(|(to, register)| *to = register);
        lanes
    }

    /// The same function of every lane, one after another.
    #[inline(always)]
    pub(crate) fn each(self, of: impl Fn(f64) -> f64) -> Self {
        let lanes = self.lanes();
        Self::load(self.simd, &Lanes::each(|l| of(lanes[l])))
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self { registers: self.registers.map(|x| self.simd.sqrt_f64s(x)), ..self }
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        Self { registers: self.registers.map(|x| self.simd.abs_f64s(x)), ..self }
    }

    /// The largest of them.
    #[inline(always)]
    pub(crate) fn max(self) -> f64 {
        self.registers.iter().map(|x| self.simd.reduce_max_f64s(*x)).fold(f64::MIN, f64::max)
    }
}

macro_rules! operators {
    ($($operator:ident $f:ident $of_registers:ident, $assign:ident $f_assign:ident;)*) => {$(
        impl<S: Simd, const R: usize> $operator for Wide<S, R> {
            type Output = Self;

            #[inline(always)]
            fn $f(self, other: Self) -> Self {
                let of = |r| self.simd.$of_registers(self.registers[r], other.registers[r]);
                Self { registers: array::from_fn(of), ..self }
            }
        }
        impl<S: Simd, const R: usize> $assign for Wide<S, R> {
            #[inline(always)]
            fn $f_assign(&mut self, other: Self) {
                *self = self.$f(other);
            }
        }
    )*};
}

operators! {
    Add add add_f64s, AddAssign add_assign;
    Sub sub sub_f64s, SubAssign sub_assign;
    Mul mul mul_f64s, MulAssign mul_assign;
}

impl<S: Simd, const R: usize> Div for Wide<S, R> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self { registers: array::from_fn(|r| self.simd.div_f64s(self.registers[r], other.registers[r])), ..self }
    }
}

/// Work on eight lanes, written for any registers.
pub(crate) trait Work {
    /// Does it, the lanes in `R` registers.
    fn run<S: Simd, const R: usize>(self, simd: S);
}

/// Does the work with the widest registers of this machine.
pub(crate) fn widest(work: impl Work) {
    pulp::Arch::new().dispatch(Widest(work));
}

/// The same, where only the first so many `lanes` count: in no more registers than they fill, but for the narrowest.
pub(crate) fn wide_enough(lanes: usize, work: impl Work) {
    pulp::Arch::new().dispatch(WideEnough { lanes, work });
}

struct Widest<W>(W);

impl<W: Work> pulp::WithSimd for Widest<W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F64_LANES {
            8 => self.0.run::<S, 1>(simd),
            4 => self.0.run::<S, 2>(simd),
            2 => self.0.run::<S, 4>(simd),
            _ => self.0.run::<S, 8>(simd),
        }
    }
}

struct WideEnough<W> {
    lanes: usize,
    work: W,
}

impl<W: Work> pulp::WithSimd for WideEnough<W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (S::F64_LANES, self.lanes) {
            (8, _) | (4, ..=4) => self.work.run::<S, 1>(simd),
            (4, _) | (2, ..=4) => self.work.run::<S, 2>(simd),
            (2, ..=6) => self.work.run::<S, 3>(simd),
            (2, _) => self.work.run::<S, 4>(simd),
            _ => self.work.run::<S, 8>(simd),
        }
    }
}
