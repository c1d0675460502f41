//! The number a block computes with: `f64` on computers, `f32` where a PLC's `REAL` is meant.

use crate::{Carried, Sum};
use core::fmt::{Debug, Display};
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A floating-point number with the operations that a PLC has too: + − × ÷ and comparisons.
///
/// Nothing here rounds twice, fuses, or calls a mathematics library, so that every implementation of a block can repeat
/// its bits.
pub trait Real:
    Copy
    + Debug
    + Default
    + Display
    + PartialOrd
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Send
    + Sync
    + 'static
{
    /// A sum over samples of such numbers.
    type Sum: Sum<Self>;

    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// The largest finite number; a comparison with it finds NaN and infinity alike.
    const LARGEST: Self;
    /// A number beyond which nothing is a measurement; below it the integrals of a half-period stay finite. Literals of this size
    /// can be written for every controller: some compilers read them in 32 bits.
    const MOST: Self;
    /// Part of a quotient of two times that counts as rounding.
    const SLIVER: Self;

    /// The nearest number to `x`.
    fn of(x: f64) -> Self;

    /// The number as `f64`, exactly.
    fn as_f64(self) -> f64;

    /// Absolute value |x|.
    fn magnitude(self) -> Self;

    /// The smaller of two numbers, neither of which is NaN.
    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        if other < self { other } else { self }
    }

    /// The larger of two numbers, neither of which is NaN.
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    /// True for every number but NaN and ±infinity.
    #[inline(always)]
    fn is_number(self) -> bool {
        self.magnitude() <= Self::LARGEST
    }

    /// True for every number within [`Self::MOST`].
    #[inline(always)]
    fn is_measurable(self) -> bool {
        self.magnitude() <= Self::MOST
    }
}

macro_rules! real {
    ($float:ty, $sum:ty, $most:expr, $sliver:expr) => {
        impl Real for $float {
            type Sum = $sum;
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const LARGEST: Self = <$float>::MAX;
            const MOST: Self = $most;
            const SLIVER: Self = $sliver;

            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $float
            }

            #[inline(always)]
            fn as_f64(self) -> f64 {
                f64::from(self)
            }

            #[inline(always)]
            fn magnitude(self) -> Self {
                self.abs()
            }
        }
    };
}

real!(f32, Carried, 1e12, 1e-5);
real!(f64, f64, 1e30, 1e-9);
