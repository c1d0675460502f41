//! The width of the gap from one half-period.

use crate::error::require;
use crate::{HalfPeriod, LONGEST_WINDOW, ParameterError, Real};

/// Source of Δu, the travel of the control signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum TravelSource {
    /// K/Ti·∫|e|dt (7.5): exact for PI.
    Integral,
    /// K/Ti·∫|e|dt with the derivative part (7.6): exact for PID whose derivative acts on the same filtered value.
    Derivative,
    /// The change of the recorded, filtered OP.
    Op,
}

/// Width of the gap by (2.4), d̂ = Δu − Δy/Kp.
///
/// Δu comes from K/Ti·∫|e|dt (7.5), and, where Td is known, with the derivative part of (7.6). The thesis drops that
/// part (7.5: "alternating", "less than 10 %"); it does neither: D opposes the integral part in every half-period, and
/// without it the width is overstated. Where OP is recorded and the controller is not known to be a PI, Δu is OP's own
/// travel: (7.6) is the same in theory, but takes the slope where noise chose the crossing. A setpoint that moved by
/// Δysp between the crossings adds (b − 1)·K·Δysp, since (4.1) has b = 0.
///
/// Only the sizes of K and Kp are used; the direction of the controller enters with OP's travel.
///
/// Known bias: low by what Kp overstates Δu_true (2.3) when the half-period is short against the process; low or high
/// by any load change within the half-period.
///
/// ```
/// use glapp_core::{HalfPeriod, Width};
/// let width = Width::new(0.5, 10.0, None, 1.0, Some(2.0))?;
/// let half = HalfPeriod { sign: 1, delta_t: 100.0, delta_y: 1.0, ..HalfPeriod::default() };
/// let w = width.of(&half, false);
/// assert_eq!((w.delta_u, w.kp_part, w.d), (5.0, 0.5, 4.5));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Width<R> {
    k: R,
    k_abs: R,
    ti: R,
    td: Option<R>,
    b: R,
    kp_abs: Option<R>,
}

/// The parts of one width; all in OP units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct WidthParts<R> {
    /// K/Ti·Δy·Δt (7.5).
    pub delta_u: R,
    /// The derivative part of (7.6), signed as it acts against or with the integral part; 0 where Td is not known.
    pub delta_u_d: R,
    /// The setpoint's part, (b − 1)·K·Δysp.
    pub delta_u_sp: R,
    /// OP's own travel in the direction of the integral action; 0 where OP is not known.
    pub op_travel: R,
    /// The Kp-free part of the width: the Δu that is used.
    pub free: R,
    /// Δy/Kp, or 0 where Kp is not known.
    pub kp_part: R,
    /// The width, `free − kp_part`.
    pub d: R,
}

impl<R: Real> WidthParts<R> {
    /// Whether all parts are finite, and so far from the largest number that a window of such widths can be added up.
    #[inline(always)]
    pub(crate) fn are_numbers(&self) -> bool {
        let sum = self.delta_u + self.delta_u_d + self.delta_u_sp + self.op_travel + self.free + self.kp_part;
        sum.is_number() && self.d.magnitude() <= R::LARGEST / R::of(2.0 * LONGEST_WINDOW as f64)
    }
}

impl<R: Real> Width<R> {
    /// The block for a controller: `k` [OP unit/PV unit] ≠ 0, negative for a direct-acting controller; `ti` \[s\] > 0; `td` \[s\] ≥ 0 where known;
    /// `b` setpoint weight, 0 to 1; `kp` process gain [PV unit/OP unit] ≠ 0 where known.
    pub fn new(k: R, ti: R, td: Option<R>, b: R, kp: Option<R>) -> Result<Self, ParameterError> {
        if let Some(td) = td {
            require("td", td, td >= R::ZERO, "0 s or greater")?;
        }
        let kp_abs = match kp {
            Some(kp) => Some(require("kp", kp, kp != R::ZERO, "other than 0")?.magnitude()),
            None => None,
        };
        Ok(Self {
            k: require("k", k, k != R::ZERO, "other than 0")?,
            k_abs: k.magnitude(),
            ti: require("ti", ti, ti > R::ZERO, "greater than 0 s")?,
            td,
            b: require("b", b, b >= R::ZERO && b <= R::ONE, "between 0 and 1")?,
            kp_abs,
        })
    }

    /// This block with another Kp, where one is given.
    #[inline(always)]
    pub(crate) fn with_kp(&self, kp: Option<R>) -> Self {
        Self { kp_abs: kp.map(R::magnitude).or(self.kp_abs), ..*self }
    }

    /// |K| [OP unit/PV unit].
    pub fn k_abs(&self) -> R {
        self.k_abs
    }

    /// Ti \[s\].
    pub fn ti(&self) -> R {
        self.ti
    }

    /// The noise limit for noise of standard deviation `sigma` in PV, 3σ/|Kp| \[OP unit\]; where Kp is not known 3σ·2|K|, since
    /// a well-tuned loop has 1/(K·Kp) below 2 (7.4).
    #[inline(always)]
    pub fn noise_floor(&self, sigma: R) -> R {
        let floor = R::of(3.0) * sigma;
        match self.kp_abs {
            Some(kp) => floor / kp,
            None => floor * (R::of(2.0) * self.k_abs),
        }
    }

    /// Source of Δu, given whether OP is recorded.
    #[inline(always)]
    pub fn source(&self, op_known: bool) -> TravelSource {
        match (self.td, op_known) {
            (Some(td), _) if td <= R::ZERO => TravelSource::Integral,
            (_, true) => TravelSource::Op,
            (Some(_), false) => TravelSource::Derivative,
            (None, false) => TravelSource::Integral,
        }
    }

    /// The width from one half-period.
    #[inline(always)]
    pub fn of(&self, half: &HalfPeriod<R>, op_known: bool) -> WidthParts<R> {
        // The integral part of u moves in the direction of sign(e)·sign(K); seen along that direction it is positive.
        let towards = if half.sign < 0 { -R::ONE } else { R::ONE };
        let op_towards = if self.k < R::ZERO { -towards } else { towards };
        let delta_u = self.k_abs * half.delta_y * half.delta_t / self.ti;
        let delta_u_sp = (self.b - R::ONE) * self.k_abs * half.sp_change * towards;
        let delta_u_d = match self.td {
            Some(td) => -(self.k_abs * td * half.slope_change * towards),
            None => R::ZERO,
        };
        let op_travel = if op_known { half.op_change * op_towards } else { R::ZERO };
        let free = match self.source(op_known) {
            TravelSource::Op => op_travel,
            _ => delta_u + delta_u_d + delta_u_sp,
        };
        let kp_part = self.kp_part(half);
        WidthParts { delta_u, delta_u_d, delta_u_sp, op_travel, free, kp_part, d: free - kp_part }
    }

    /// A width with this Kp, from the parts that another made of the half-period.
    pub(crate) fn again(&self, parts: &WidthParts<R>, half: &HalfPeriod<R>) -> WidthParts<R> {
        let kp_part = self.kp_part(half);
        WidthParts { kp_part, d: parts.free - kp_part, ..*parts }
    }

    /// Part of the width that needs Kp.
    #[inline(always)]
    fn kp_part(&self, half: &HalfPeriod<R>) -> R {
        match self.kp_abs {
            Some(kp) => half.delta_y / kp,
            None => R::ZERO,
        }
    }
}
