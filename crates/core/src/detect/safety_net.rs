//! The safety net: which half-periods may become detections.

use crate::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO};
use crate::{HalfPeriod, ParameterError, Real, Width, WidthParts, error::require};

named! {
    /// Why a half-period was rejected, in the fixed order in which the first reason is named.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
    #[repr(u8)]
    pub enum Reason {
        /// Not rejected.
        #[default]
        Accepted = 0 => "accepted",
        /// Samples are missing before or within it.
        Gap = 1 => "gap",
        /// A value was bad or not a number.
        BadQuality = 2 => "bad_quality",
        /// The controller was not in automatic.
        NotAuto = 3 => "not_auto",
        /// Something in the loop was at a limit, or Δu exceeds the span of OP (7.1).
        Saturated = 4 => "saturated",
        /// Δt ≤ 5Ti (2.1).
        TooShort = 5 => "too_short",
        /// e_max ≥ 2Δy (5.2).
        NotSquare = 6 => "not_square",
        /// |Δy_previous/Δy| outside 0.5 to 1.5 (5.4), or no previous half-period to compare with.
        Uneven = 7 => "uneven",
        /// Δysp ≥ Δy (5.5).
        SpMoved = 8 => "sp_moved",
        /// Δt ≤ Ti·d̂/(2KΔy) (5.1).
        TooSmall = 9 => "too_small",
    }
}

impl Reason {
    /// The reason's bit in the mask; 0 for [`Reason::Accepted`].
    pub const fn bit(self) -> u16 {
        match self {
            Self::Accepted => 0,
            other => 1 << (other as u8 - 1),
        }
    }

    /// The reason of the lowest bit set in a mask; `Accepted` for an empty mask.
    #[inline(always)]
    pub const fn first(mask: u16) -> Self {
        let index = mask.trailing_zeros() as usize + 1;
        if index < Self::ALL.len() { Self::ALL[index] } else { Self::Accepted }
    }
}

/// The safety net (thesis chapter 5 and 7.1), each condition with its own switch.
///
/// | condition for acceptance | source | switch |
/// |---|---|---|
/// | no gap, no bad value, in automatic | | always on |
/// | nothing at a limit; Δu < span of OP | 7.1 | `limits`; `op_span` |
/// | Δt > 5Ti | 2.1 | `too_short` |
/// | e_max < 2Δy | (5.2) | `not_square` |
/// | Δy_previous < 1.5Δy | (5.3) | `decaying` |
/// | Δy_previous > 0.5Δy | (5.4) with (5.3) | `growing` |
/// | Δysp < Δy | (5.5) | `sp_moved` |
/// | Δt > Ti·d̂/(2KΔy) | (5.1) | `too_small` |
///
/// Quotients are compared as products, so nothing is divided by a Δy of 0. (5.1) is asked only when the caller hands
/// over an estimate; when to do so is the detector's business.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyNet<R> {
    /// Reject Δu ≥ this span [OP unit]; `None`: the span is not known.
    pub op_span: Option<R>,
    /// Other conditions that are checked.
    pub conditions: Conditions,
}

/// The conditions of a [`SafetyNet`] that have a switch, all on by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Conditions {
    /// Reject what met a limit flag, or OP at its limit.
    pub limits: bool,
    /// Reject Δt ≤ 5Ti.
    pub too_short: bool,
    /// Reject by (5.2).
    pub not_square: bool,
    /// Reject by (5.3), the upper limit of (5.4).
    pub decaying: bool,
    /// Reject by the lower limit of (5.4).
    pub growing: bool,
    /// Reject by (5.5).
    pub sp_moved: bool,
    /// Reject by (5.1).
    pub too_small: bool,
}

impl Default for Conditions {
    fn default() -> Self {
        Self {
            limits: true,
            too_short: true,
            not_square: true,
            decaying: true,
            growing: true,
            sp_moved: true,
            too_small: true,
        }
    }
}

impl Conditions {
    /// Names of the conditions, in order.
    pub const NAMES: [&str; 7] = ["limits", "too_short", "not_square", "decaying", "growing", "sp_moved", "too_small"];

    /// The switch of that name, where there is one.
    pub fn switch(&mut self, name: &str) -> Option<&mut bool> {
        let Self { limits, too_short, not_square, decaying, growing, sp_moved, too_small } = self;
        let all = [limits, too_short, not_square, decaying, growing, sp_moved, too_small];
        Self::NAMES.into_iter().zip(all).find(|(known, _)| *known == name).map(|(_, switch)| switch)
    }
}

impl<R: Real> SafetyNet<R> {
    /// A net with all conditions on; `op_span` \[OP unit\] > 0 where known.
    pub fn new(op_span: Option<R>) -> Result<Self, ParameterError> {
        if let Some(span) = op_span {
            require("op_span", span, span > R::ZERO, "greater than 0")?;
        }
        Ok(Self { op_span, conditions: Conditions::default() })
    }

    /// The mask of all conditions that a half-period fails; 0 = accepted.
    ///
    /// `previous` is Δy of the completed half-period before, if there is one; `d_hat` the estimate for (5.1), if it
    /// is to be asked.
    #[inline(always)]
    pub fn check(
        &self,
        half: &HalfPeriod<R>,
        parts: &WidthParts<R>,
        width: &Width<R>,
        previous: Option<R>,
        d_hat: Option<R>,
    ) -> u16 {
        let two = R::ONE + R::ONE;
        let dy = half.delta_y;
        let Conditions { limits, too_short, not_square, decaying, growing, sp_moved, too_small } = self.conditions;
        let mut mask = 0;
        let mut fail = |failed: bool, reason: Reason| mask |= if failed { reason.bit() } else { 0 };
        fail(half.flags & DATA_GAP != 0, Reason::Gap);
        fail(half.flags & BAD != 0, Reason::BadQuality);
        fail(half.flags & NOT_AUTO != 0, Reason::NotAuto);
        fail(limits && half.flags & (AT_LOW | AT_HIGH) != 0, Reason::Saturated);
        fail(self.op_span.is_some_and(|span| parts.free >= span), Reason::Saturated);
        fail(too_short && half.delta_t <= R::of(5.0) * width.ti(), Reason::TooShort);
        fail(not_square && half.e_max >= two * dy, Reason::NotSquare);
        match previous {
            Some(before) => {
                fail(decaying && before >= R::of(1.5) * dy, Reason::Uneven);
                fail(growing && before <= R::of(0.5) * dy, Reason::Uneven);
            }
            None => fail(decaying || growing, Reason::Uneven),
        }
        fail(sp_moved && half.delta_sp >= dy, Reason::SpMoved);
        if let Some(d_hat) = d_hat {
            let smaller = half.delta_t * two * width.k_abs() * dy <= width.ti() * d_hat;
            fail(too_small && smaller, Reason::TooSmall);
        }
        mask
    }
}
