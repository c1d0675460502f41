//! The half-period: the signals between two zero crossings of the error.

use crate::status::{BAD, Status};
use crate::{Adding, Numbers, Real, Sum};

/// Signals between two zero crossings.
///
/// It holds the samples from the crossing up to, and without, the next crossing. Integrals are sums of h·|e|
/// (the rectangle rule, which a PLC scan gives by itself); against the exact integral they err by at most h·e_max.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HalfPeriod<R> {
    /// +1 where PV was below SP (e > 0), −1 above, 0 where no error other than zero was seen.
    pub sign: i8,
    /// Flags met in the half-period, see [`status`](crate::status).
    pub flags: Status,
    /// Number of samples.
    pub n: u32,
    /// Duration Δt \[s\], without the time of a gap.
    pub delta_t: R,
    /// Mean distance to the setpoint, Δy = ∫|e|dt / Δt (2.2) [PV unit]; 0 where Δt is 0.
    pub delta_y: R,
    /// Largest |e| [PV unit].
    pub e_max: R,
    /// Range of SP, the closing crossing included, Δysp of (5.5) [PV unit].
    pub delta_sp: R,
    /// SP at the closing crossing less SP at the opening one [PV unit].
    pub sp_change: R,
    /// Derivative of the filtered PV at the closing crossing less that at the opening one [PV unit/s].
    pub slope_change: R,
    /// Change of the filtered OP between the crossings [OP unit]; 0 where OP is not known.
    pub op_change: R,
}

/// The half-period under way.
// Sums stand apart from sums and extremes from extremes: the compiler would pack neighbours into one register, and the
// packing takes longer than what it saves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HalfPeriodState<R: Real> {
    pub(super) flags: Status,
    pub(super) n: u32,
    pub(super) delta_t: R::Sum,
    pub(super) sp_low: R,
    pub(super) integral: R::Sum,
    pub(super) sp_high: R,
    pub(super) sp_start: R,
    pub(super) e_max: R,
    pub(super) slope_start: R,
    pub(super) op_start: R,
}

impl<R: Real> HalfPeriodState<R> {
    /// Starts a half-period at a sample with setpoint `sp`, slope of the filtered PV and filtered OP. `flags` are
    /// those it is born with: 0 at a zero crossing, the reason of the break after a break.
    #[inline(always)]
    pub fn start(sp: R, slope: R, op: R, flags: Status) -> Self {
        Self {
            flags,
            sp_low: sp,
            sp_high: sp,
            sp_start: sp,
            slope_start: slope,
            op_start: op,
            n: 0,
            delta_t: R::ZERO.into(),
            integral: R::ZERO.into(),
            e_max: R::ZERO,
        }
    }

    /// Starts at the first usable sample after a break, in the stretch that the break began: its flags and its
    /// unusable samples stay.
    pub fn resume(&mut self, sp: R, slope: R, op: R, flags: Status) {
        *self = Self { n: self.n, ..Self::start(sp, slope, op, self.flags | flags) };
    }

    /// Takes one sample: error `e`, step `h` \[s\] and flags. Its setpoint goes to [`Self::widen`].
    #[inline(always)]
    pub fn add(&mut self, e: R, h: R, flags: Status) {
        self.count(1);
        self.integrate(e.magnitude(), h, flags);
    }

    /// Counts `n` samples, whose sizes go to [`Self::integrate`].
    #[inline(always)]
    pub(crate) fn count(&mut self, n: u32) {
        self.n = self.n.wrapping_add(n);
    }

    /// Takes the size of an error, step `h` \[s\] and flags of a sample that [`Self::count`] counts.
    #[inline(always)]
    pub(crate) fn integrate(&mut self, size: R, h: R, flags: Status) {
        integrate(&mut self.delta_t, &mut self.integral, &mut self.e_max, size, h);
        self.flags |= flags;
    }

    /// Takes the setpoint of a sample; one that is the same as the one before need not be told.
    #[inline(always)]
    pub fn widen(&mut self, sp: R) {
        widen(&mut self.sp_low, &mut self.sp_high, sp);
    }

    /// The lowest setpoint so far.
    #[inline(always)]
    pub(crate) fn sp_low(&self) -> R {
        self.sp_low
    }

    /// Takes a sample of which nothing but its presence can be used.
    #[inline(always)]
    pub fn add_unusable(&mut self, flags: Status) {
        self.n = self.n.wrapping_add(1);
        self.flags |= flags;
    }

    /// True until the first sample was taken.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Adds to the flags without taking a sample.
    #[inline(always)]
    pub fn mark(&mut self, flags: Status) {
        self.flags |= flags;
    }

    /// Ends the half-period at a crossing with setpoint `sp`, slope of the filtered PV and filtered OP there. Where a
    /// number has overflowed, all are 0 and it is [`BAD`].
    #[inline(always)]
    pub fn close(&self, sign: i8, sp: R, slope: R, op: R) -> HalfPeriod<R> {
        let delta_t = self.delta_t.value();
        let half = HalfPeriod {
            sign,
            flags: self.flags,
            n: self.n,
            delta_t,
            delta_y: if delta_t > R::ZERO { self.integral.value() / delta_t } else { R::ZERO },
            e_max: self.e_max,
            delta_sp: self.sp_high.greater(sp) - self.sp_low.lesser(sp),
            sp_change: sp - self.sp_start,
            slope_change: slope - self.slope_start,
            op_change: op - self.op_start,
        };
        let sum = half.delta_t + half.delta_y + half.delta_sp + half.sp_change + half.slope_change + half.op_change;
        if sum.is_number() {
            half
        } else {
            HalfPeriod { sign, flags: half.flags | BAD, n: half.n, ..HalfPeriod::default() }
        }
    }

    /// The half-period as if it ended now, with the slope of PV at its beginning.
    pub(crate) fn so_far(&self, sign: i8, sp: R, op: R) -> HalfPeriod<R> {
        self.close(sign, sp, self.slope_start, op)
    }

    /// Ends it where the signals broke off: what would be read at the closing crossing is not known and stays 0.
    pub fn break_off(&self, sign: i8, cause: Status) -> HalfPeriod<R> {
        let mut half = self.close(sign, self.sp_start, self.slope_start, self.op_start);
        half.flags |= cause;
        half
    }
}

/// Adds an error of magnitude `size` that lasts `h` seconds to ∫|e|dt, Δt and e_max.
#[inline(always)]
pub(super) fn integrate<N: Numbers, S: Adding<N>>(delta_t: &mut S, integral: &mut S, e_max: &mut N, size: N, h: N) {
    delta_t.add(h);
    integral.add(size * h);
    *e_max = e_max.greater(size);
}

/// Widens the range of the setpoint.
#[inline(always)]
pub(super) fn widen<N: Numbers>(low: &mut N, high: &mut N, sp: N) {
    *low = low.lesser(sp);
    *high = high.greater(sp);
}
