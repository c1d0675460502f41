//! Eight numbers side by side: in memory, and in the widest registers that the machine has.
//!
//! Left to itself the compiler lays the vectors of short loops across the wrong index; here each operation is one of whole
//! registers. Nothing is fused, so the bits are the same on every machine.

use pulp::{Arch, Scalar, Simd, WithSimd};
use std::array;
use std::ops::{Add, AddAssign, Deref, DerefMut, Div, Mul, MulAssign, Sub, SubAssign};

/// Models that are run side by side: the recurrence waits for itself, eight of them fill the waiting, and a point with all
/// its derivatives is one pass.
pub const LANES: usize = 8;

/// One number for each of the models that run side by side. Aligned to the widest registers: what lies across the border of
/// two lines of the cache waits for both.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub struct Lanes([f64; LANES]);

impl Lanes {
    /// The same number for all.
    pub fn all(x: f64) -> Self {
        Self([x; LANES])
    }

    /// The number of each, from its place.
    pub fn each(of: impl FnMut(usize) -> f64) -> Self {
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
pub struct Wide<S: Simd, const R: usize> {
    pub(crate) simd: S,
    registers: [S::f64s; R],
}

impl<S: Simd, const R: usize> Wide<S, R> {
    /// The same number in all lanes.
    #[inline(always)]
    pub fn all(simd: S, x: f64) -> Self {
        Self { simd, registers: [simd.splat_f64s(x); R] }
    }

    /// The first eight of these numbers.
    #[inline(always)]
    pub fn begin(simd: S, numbers: &[f64]) -> Self {
        let (registers, _) = S::as_simd_f64s(&numbers[..LANES]);
        Self { simd, registers: array::from_fn(|r| registers[r]) }
    }

    /// From memory.
    #[inline(always)]
    pub fn load(simd: S, lanes: &Lanes) -> Self {
        let (registers, _) = S::as_simd_f64s(&lanes.0);
        Self { simd, registers: array::from_fn(|r| registers[r]) }
    }

    /// To memory.
    #[inline(always)]
    pub fn lanes(self) -> Lanes {
        let mut lanes = Lanes::default();
        let (registers, _) = S::as_mut_simd_f64s(&mut lanes.0);
        registers.iter_mut().zip(self.registers).for_each(|(to, register)| *to = register);
        lanes
    }

    /// A function of every lane, one after another.
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
    ($($operator:ident $f:ident $of_registers:ident $(, $assign:ident $f_assign:ident)?;)*) => {$(
        impl<S: Simd, const R: usize> $operator for Wide<S, R> {
            type Output = Self;

            #[inline(always)]
            fn $f(mut self, other: Self) -> Self {
                // A plain loop: `array::from_fn` is six functions to be inlined, at each of some ten thousand operations.
                let mut r = 0;
                while r < R {
                    self.registers[r] = self.simd.$of_registers(self.registers[r], other.registers[r]);
                    r += 1;
                }
                self
            }
        }
        $(impl<S: Simd, const R: usize> $assign for Wide<S, R> {
            #[inline(always)]
            fn $f_assign(&mut self, other: Self) {
                *self = self.$f(other);
            }
        })?
    )*};
}

operators! {
    Add add add_f64s, AddAssign add_assign;
    Sub sub sub_f64s, SubAssign sub_assign;
    Mul mul mul_f64s, MulAssign mul_assign;
    Div div div_f64s;
}

/// Work on eight lanes, written for any registers.
pub trait Work {
    /// What it gives.
    type Output;

    /// Does it, the lanes in `R` registers.
    fn run<S: Simd, const R: usize>(self, simd: S) -> Self::Output;
}

/// Does the work with the widest registers of this machine.
///
/// Each instruction set is named with its number of registers. A choice by `S::F64_LANES` in generic code compiles all numbers of
/// registers for all sets, which takes the compiler several times as long.
pub fn widest<W: Work>(work: W) -> W::Output {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(simd) => Simd::vectorize(simd, InRegisters::<_, 1>(work)),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => Simd::vectorize(simd, InRegisters::<_, 2>(work)),
        #[cfg(target_arch = "aarch64")]
        Arch::Neon(simd) => Simd::vectorize(simd, InRegisters::<_, 4>(work)),
        #[cfg(target_arch = "wasm32")]
        Arch::Simd128(simd) => Simd::vectorize(simd, InRegisters::<_, 4>(work)),
        _ => Simd::vectorize(Scalar::new(), InRegisters::<_, LANES>(work)),
    }
}

/// Work where only the first so many `lanes` count: in no more registers than they fill, but for the narrowest.
pub fn wide_enough<W: Work>(lanes: usize, work: W) -> W::Output {
    match (Arch::new(), lanes) {
        #[cfg(target_arch = "x86_64")]
        (Arch::V3(simd), ..=4) => Simd::vectorize(simd, InRegisters::<_, 1>(work)),
        #[cfg(target_arch = "aarch64")]
        (Arch::Neon(simd), ..=4) => Simd::vectorize(simd, InRegisters::<_, 2>(work)),
        #[cfg(target_arch = "aarch64")]
        (Arch::Neon(simd), 5 | 6) => Simd::vectorize(simd, InRegisters::<_, 3>(work)),
        #[cfg(target_arch = "wasm32")]
        (Arch::Simd128(simd), ..=4) => Simd::vectorize(simd, InRegisters::<_, 2>(work)),
        #[cfg(target_arch = "wasm32")]
        (Arch::Simd128(simd), 5 | 6) => Simd::vectorize(simd, InRegisters::<_, 3>(work)),
        _ => widest(work),
    }
}

/// Work in `R` registers.
struct InRegisters<W, const R: usize>(W);

impl<W: Work, const R: usize> WithSimd for InRegisters<W, R> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> W::Output {
        self.0.run::<S, R>(simd)
    }
}
