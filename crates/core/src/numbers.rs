//! Operations common to one number and several side by side.

use crate::{Real, Sum};
use core::ops::{Add, BitAnd, Div, Mul, Sub};

/// A number, or several side by side on each of which an operation does the same: what of the blocks' law runs in the lanes of a
/// processor is written for both.
pub trait Numbers: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    /// Result of a comparison.
    type Truth: Copy + BitAnd<Output = Self::Truth>;

    /// `x` in each of as many numbers as these.
    fn like(self, x: f64) -> Self;

    /// Whether it is less than another.
    fn below(self, other: Self) -> Self::Truth;

    /// One of two numbers.
    fn either(truth: Self::Truth, yes: Self, no: Self) -> Self;

    /// Absolute value, see [`Real::magnitude`].
    fn magnitude(self) -> Self;

    /// The lesser of two, see [`Real::lesser`].
    fn lesser(self, other: Self) -> Self;

    /// The greater of two, see [`Real::greater`].
    fn greater(self, other: Self) -> Self;
}

impl<R: Real> Numbers for R {
    type Truth = bool;

    #[inline(always)]
    fn like(self, x: f64) -> Self {
        R::of(x)
    }

    #[inline(always)]
    fn below(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn either(truth: bool, yes: Self, no: Self) -> Self {
        if truth { yes } else { no }
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        Real::magnitude(self)
    }

    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        Real::lesser(self, other)
    }

    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        Real::greater(self, other)
    }
}

/// A sum of [`Numbers`]: that of [`Sum`], or one in each lane.
pub trait Adding<N>: Copy {
    /// Adds a number, see [`Sum::add`].
    fn add(&mut self, x: N);

    /// `x` less the sum, see [`Sum::to`].
    fn to(self, x: N) -> N;

    /// The sum less another, see [`Sum::since`].
    fn since(self, other: Self) -> N;
}

impl<R: Real, S: Sum<R>> Adding<R> for S {
    #[inline(always)]
    fn add(&mut self, x: R) {
        Sum::add(self, x);
    }

    #[inline(always)]
    fn to(self, x: R) -> R {
        Sum::to(self, x)
    }

    #[inline(always)]
    fn since(self, other: Self) -> R {
        Sum::since(self, other)
    }
}

/// Loops that run side by side.
pub const LANES: usize = 8;

/// [`LANES`] numbers in the registers of a processor.
pub trait Lanes: Numbers + Adding<Self> {
    /// The numbers of an array.
    fn load(self, numbers: &[f64; LANES]) -> Self;

    /// The numbers as an array.
    fn numbers(self) -> [f64; LANES];

    /// Whether something holds in one lane or more.
    fn any(truth: Self::Truth) -> bool;

    /// Rows of a square of numbers to its columns.
    fn turned(rows: [Self; LANES]) -> [Self; LANES];
}
