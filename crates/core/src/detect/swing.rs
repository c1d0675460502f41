//! The swing of a half-period: how far OP travelled from one turn to the next, and how far off PV stood meanwhile.

use crate::status::{BAD, DATA_GAP, NOT_AUTO, Status};
use crate::{Derivative, ParameterError, Real, Sum, error::require};

/// OP's travel from its furthest point in the half-period before to its furthest point in this one, and the height of
/// PV's plateau: what [`corrected`](crate::corrected) makes a width of.
///
/// Between zero crossings OP travels d and *a part* of what PV's swing asks, which (2.4) takes to be Δy/Kp. Between its
/// turns it travels d and *all* of it, because the valve rests from one turn until the gap is closed:
///
/// ```text
/// travel = d + (plateau here + plateau of the half-period after)/Kp
/// ```
///
/// OP is the recorded one. Where it is not recorded it is what (4.1) makes of SP and yf, all three parts of it, with the
/// setpoint weight b:
///
/// ```text
/// u/K ← u/K + b·Δysp − Δyf + e·(h/Ti) − Td·Δẏf
/// ```
///
/// PV comes to its plateau y∞ like y∞·(1 − e^(−t/τ)). Then Δy = ∫|e|dt/Δt = y∞·(1 − τ/Δt) lies below it, while
/// ∫e²dt/∫|e|dt lies only half as far below, so that, to first order in τ/Δt,
///
/// ```text
/// plateau = 2·∫e²dt/∫|e|dt − Δy
/// ```
///
/// Known bias: the travel is low where OP is recorded more coarsely than the controller works, since its turns are lost;
/// from (4.1) also where yf is smoothed more than the controller's own PV. The plateau is high by σ²/Δy, σ the noise of e.
///
/// ```
/// use glapp_core::{Swing, SwingState};
/// let swing = Swing::new(1.0, 10.0, None, 0.0)?;
/// let mut state = SwingState::default();
/// for op in [0.0, 3.0, 2.5] {
///     swing.add(&mut state, 1.0, 0.0, -1.0, Some(op)); // PV below SP, OP rises, and turns
/// }
/// assert_eq!(swing.end(&mut state, 1, 0).travel, None); // nothing to count from yet
/// for op in [2.0, -2.0, -1.5] {
///     swing.add(&mut state, 1.0, 0.0, 2.0, Some(op));
/// }
/// let parts = swing.end(&mut state, -1, 0);
/// assert_eq!((parts.travel, parts.plateau), (Some(5.0), 2.0));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing<R> {
    k: R,
    ti: R,
    td: R,
    b: R,
}

/// The half-period under way, and the turn before it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SwingState<R: Real> {
    n: u32,
    time: R::Sum,
    area: R::Sum,
    square: R::Sum,
    op: R::Sum,
    lowest: R,
    highest: R,
    sp: R,
    yf: R,
    slope: R,
    derivative: Derivative<R>,
    sign: i8,
    turn: R,
    recorded: bool,
    switched: bool,
}

/// Parts of the swing in one half-period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SwingParts<R> {
    /// OP's travel between its furthest points [OP unit]; none where there is no turn to count from: after a break, or
    /// where the half-period before was on the same side.
    pub travel: Option<R>,
    /// Height of PV's plateau [PV unit]; 0 where no time went by.
    pub plateau: R,
}

impl<R: Real> Swing<R> {
    /// The block for a controller: `k` [OP unit/PV unit] ≠ 0; `ti` \[s\] > 0; `td` \[s\] ≥ 0, 0 where not known; `b` setpoint weight, 0 to 1.
    pub fn new(k: R, ti: R, td: Option<R>, b: R) -> Result<Self, ParameterError> {
        let td = td.unwrap_or(R::ZERO);
        Ok(Self {
            k: require("k", k, k != R::ZERO, "other than 0")?,
            ti: require("ti", ti, ti > R::ZERO, "greater than 0 s")?,
            td: require("td", td, td >= R::ZERO, "0 s or greater")?,
            b: require("b", b, b >= R::ZERO && b <= R::ONE, "between 0 and 1")?,
        })
    }

    /// Takes a sample of the half-period: the time `h` before it \[s\], setpoint, filtered PV, and OP where it is
    /// recorded. A step that is not positive is passed over; where OP begins or ceases to be recorded the half-period
    /// gives no travel.
    #[inline(always)]
    pub fn add(&self, s: &mut SwingState<R>, h: R, sp: R, yf: R, op: Option<R>) {
        let e = sp - yf;
        if !(h > R::ZERO && e.magnitude() <= R::MOST) {
            return;
        }
        let slope = if self.td > R::ZERO { s.derivative.update(yf, h) } else { R::ZERO };
        if let Some(op) = op {
            s.op = op.into();
        } else {
            let moved = self.b * (sp - s.sp) - (yf - s.yf);
            s.op.add(moved + e * (h / self.ti) - self.td * (slope - s.slope));
        }
        s.switched |= s.recorded != op.is_some() && (s.n > 0 || s.sign != 0);
        s.recorded = op.is_some();
        (s.sp, s.yf, s.slope) = (sp, yf, slope);
        let op = s.op.value();
        if s.n == 0 {
            (s.lowest, s.highest) = (op, op);
        }
        s.lowest = s.lowest.lesser(op);
        s.highest = s.highest.greater(op);
        let size = e.magnitude();
        s.time.add(h);
        s.area.add(size * h);
        s.square.add(size * size * h);
        s.n = s.n.saturating_add(1);
    }

    /// Ends the half-period: its `sign` and `flags` as in [`HalfPeriod`](crate::HalfPeriod). The sample that ends it is
    /// the first of the next.
    #[inline(never)]
    pub fn end(&self, s: &mut SwingState<R>, sign: i8, flags: Status) -> SwingParts<R> {
        // By (4.1) `op` is u/K and rises with the integral; a recorded OP falls with it where K is negative.
        let rises = (sign > 0) == (!s.recorded || self.k > R::ZERO);
        let turn = if rises { s.highest } else { s.lowest };
        let two = R::ONE + R::ONE;
        let mut parts = SwingParts::default();
        let (time, area, square) = (s.time.value(), s.area.value(), s.square.value());
        if area > R::ZERO && time > R::ZERO {
            parts.plateau = two * (square / area) - area / time;
        }
        let broken = s.n == 0 || s.switched || sign == 0 || flags & (DATA_GAP | BAD | NOT_AUTO) != 0;
        if !broken && s.sign == -sign {
            let travel = (turn - s.turn).magnitude();
            parts.travel = Some(if s.recorded { travel } else { self.k.magnitude() * travel });
        }
        if !(parts.plateau.is_number() && parts.travel.is_none_or(R::is_number)) {
            parts = SwingParts::default();
        }
        s.sign = if broken { 0 } else { sign };
        s.turn = turn;
        if !s.recorded {
            // Counted from the turn, so that no sum grows with the length of the recording.
            s.op = if broken { R::ZERO } else { s.op.since(turn.into()) }.into();
            s.turn = R::ZERO;
        }
        let none = R::Sum::default();
        (s.n, s.switched, s.time, s.area, s.square) = (0, false, none, none, none);
        parts
    }
}
