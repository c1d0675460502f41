//! Sums over samples.

use crate::Real;
use core::fmt::Debug;

/// A sum over samples: `f64` is its own, a plain number; [`Carried`] is that of `f32`.
///
/// `f32` has seven digits, and a sum of a million samples, or an integral that grows by a millionth of itself in every
/// scan, needs more: what a plain sum rounds off is lost, and always the same way. So the sum of `f32` carries it.
pub trait Sum<R>: Copy + Debug + Default + PartialEq + From<R> + Saved + Send + Sync + 'static {
    /// Adds `x`.
    fn add(&mut self, x: R);

    /// The sum, rounded to one number.
    fn value(self) -> R;

    /// `x` less the sum. What both have in common is taken off before anything is rounded.
    fn to(self, x: R) -> R;

    /// The sum less another.
    fn since(self, other: Self) -> R;

    /// A sum at another number, with what this one has not added yet.
    fn moved_to(self, x: R) -> Self;

    /// Goes to `x`, by at most `step`.
    #[inline(always)]
    fn approach(&mut self, x: R, step: R)
    where
        R: Real,
    {
        let (mut up, mut down) = (*self, *self);
        up.add(step);
        down.add(-step);
        *self = if x > up.value() {
            up
        } else if x < down.value() {
            down
        } else {
            x.into()
        };
    }
}

/// A state that can be saved and restored, with the feature `serde`.
#[cfg(feature = "serde")]
pub trait Saved: serde::Serialize + for<'de> serde::Deserialize<'de> {}
#[cfg(feature = "serde")]
impl<T: serde::Serialize + for<'de> serde::Deserialize<'de>> Saved for T {}

/// A state that can be saved and restored, with the feature `serde`.
#[cfg(not(feature = "serde"))]
pub trait Saved {}
#[cfg(not(feature = "serde"))]
impl<T> Saved for T {}

impl Sum<f64> for f64 {
    #[inline(always)]
    fn add(&mut self, x: f64) {
        *self += x;
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn to(self, x: f64) -> f64 {
        x - self
    }

    #[inline(always)]
    fn since(self, other: f64) -> f64 {
        self - other
    }

    #[inline(always)]
    fn moved_to(self, x: f64) -> f64 {
        x
    }
}

/// The sum of `f32`, which carries what rounding took off it (Knuth's two-sum):
///
/// ```text
/// x := x + rest
/// s := value + x
/// z := s − value
/// rest := (value − (s − z)) + (x − z)        exactly what value + x loses in s
/// value := s
/// ```
///
/// Every operation is rounded once and in this order; a compiler that reorders or fuses them undoes it.
///
/// ```
/// use glapp_core::{Carried, Sum};
/// let (mut plain, mut sum) = (50.0_f32, Carried::from(50.0));
/// for _ in 0..1_000_000 {
///     plain += 1e-6;
///     sum.add(1e-6);
/// }
/// assert_eq!((plain, sum.value()), (50.0, 51.0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Carried {
    value: f32,
    /// Rest, at most half of the last digit of `value`.
    rest: f32,
}

impl From<f32> for Carried {
    #[inline(always)]
    fn from(value: f32) -> Self {
        Self { value, rest: 0.0 }
    }
}

impl Sum<f32> for Carried {
    #[inline(always)]
    fn add(&mut self, x: f32) {
        let x = x + self.rest;
        let s = self.value + x;
        let z = s - self.value;
        *self = Self { value: s, rest: (self.value - (s - z)) + (x - z) };
    }

    #[inline(always)]
    fn value(self) -> f32 {
        self.value
    }

    #[inline(always)]
    fn to(self, x: f32) -> f32 {
        (x - self.value) - self.rest
    }

    #[inline(always)]
    fn since(self, other: Self) -> f32 {
        (self.value - other.value) + (self.rest - other.rest)
    }

    #[inline(always)]
    fn moved_to(self, x: f32) -> Self {
        Self { value: x, rest: self.rest }
    }
}
