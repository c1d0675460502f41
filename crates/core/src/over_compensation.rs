//! Warning of over-compensation: the valve is driven back and forth by what should carry it through its gap.

use crate::error::require;
use crate::{HalfPeriod, ParameterError, Real};

/// Half-periods that [`OverCompensation`] looks at.
const N: usize = 8;

/// What [`OverCompensation`] says after a half-period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OverWarning {
    /// Code block 7.1: the last four half-periods are equally long, to less than two samples.
    pub even: bool,
    /// The last eight are alike, and OP's own travel in them is no part of a gap: a relay drives the loop.
    pub relay: bool,
}

/// Two warnings of a compensation δ wider than the gap d (thesis 7.4).
///
/// Over-compensated, u_FF followed by the gap is a relay of ±(δ − d)/2, and the loop oscillates where −1/N(A) = −πA/(2(δ − d))
/// meets the process. Two ways to tell:
///
/// ```text
/// even:   max(Δt₁ … Δt₄) − min(Δt₁ … Δt₄) < 2h                                   code block 7.1
/// relay:  max(Δt₁ … Δt₈) ≤ 2·min(Δt₁ … Δt₈)  and  median |K|/Ti·Δy·Δt ≤ δ/5
/// ```
///
/// A gap in an integrating process makes equal half-periods as well, with or without compensation, so that `even` is wrong
/// there. But where the rest of a gap has to be gone through, OP must travel d − δ on its own in every half-period, by
/// (7.5) |K|/Ti·Δy·Δt; a relay needs no travel of OP at all, since its jumps do the work. With A from −1/N(A), that travel
/// is 4/π·|K·P(iω)|/(Ti·ω)·(δ − d), a small part of δ for every loop that is tuned to be stable.
///
/// Takes each completed half-period of the error while compensation is in force; one with a flag, or in which the setpoint
/// moved by Δy or more, begins the row anew, and so does a size of 0.
///
/// Known blindness: between δ = d and 1.2d the rest of the loop decides, and the relay is as small as the noise; noise
/// larger than the relay's swing makes half-periods of all lengths, and no row of eight.
///
/// ```
/// use glapp_core::{HalfPeriod, OverCompensation, OverCompensationState};
///
/// let warning = OverCompensation::new(0.5, 10.0)?;
/// let mut state = OverCompensationState::default();
/// let half = |delta_t, delta_y| HalfPeriod { delta_t, delta_y, ..HalfPeriod::default() };
/// let mut after = |half: HalfPeriod<f64>| (0..8).map(|_| warning.update(&mut state, &half, 0.1, 2.0)).last().unwrap();
/// let gap = after(half(30.0, 1.0)); // OP's own travel: 0.5/10·1·30 = 1.5
/// assert!(gap.even && !gap.relay);
/// let relay = after(half(6.0, 0.4)); // 0.12, where 2.0 are compensated
/// assert!(relay.even && relay.relay);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverCompensation<R> {
    k: R,
    ti: R,
}

/// What an [`OverCompensation`] remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OverCompensationState<R> {
    /// Δt \[s\] and OP's own travel of the last half-periods, in a ring.
    durations: [R; N],
    travels: [R; N],
    at: u8,
    count: u8,
}

impl<R: Real> OverCompensation<R> {
    /// Gain `k` ≠ 0 [OP unit per PV unit] and integral time `ti` > 0 \[s\] of the controller.
    pub fn new(k: R, ti: R) -> Result<Self, ParameterError> {
        require("k", k, k != R::ZERO, "a number other than 0")?;
        Ok(Self { k: k.magnitude(), ti: require("ti", ti, ti > R::ZERO, "greater than 0 s")? })
    }

    /// Takes a completed half-period, the time between samples `h` \[s\], and the width in force during it [OP unit].
    #[inline(never)]
    pub fn update(&self, state: &mut OverCompensationState<R>, half: &HalfPeriod<R>, h: R, size: R) -> OverWarning {
        let usable = half.flags == 0 && half.delta_y > R::ZERO && half.delta_sp < half.delta_y && size > R::ZERO;
        if !usable {
            state.count = 0;
            return OverWarning::default();
        }
        let at = usize::from(state.at) % N;
        state.durations[at] = half.delta_t;
        state.travels[at] = self.k / self.ti * half.delta_y * half.delta_t;
        state.at = ((at + 1) % N) as u8;
        state.count = state.count.saturating_add(1).min(N as u8);
        let (mut shortest, mut longest) = (half.delta_t, half.delta_t);
        let mut even = false;
        let mut small = 0;
        for i in 0..usize::from(state.count) {
            let j = (at + N - i) % N;
            shortest = shortest.lesser(state.durations[j]);
            longest = longest.greater(state.durations[j]);
            if i == 3 {
                even = longest - shortest < h + h;
            }
            small += usize::from(R::of(5.0) * state.travels[j] <= size);
        }
        let alike = usize::from(state.count) == N && longest <= shortest + shortest;
        OverWarning { even, relay: alike && small > N / 2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half(delta_t: f64, delta_y: f64) -> HalfPeriod<f64> {
        HalfPeriod { delta_t, delta_y, ..HalfPeriod::default() }
    }

    #[test]
    fn parameters_out_of_bounds_are_named() {
        assert_eq!(OverCompensation::new(0.0, 1.0).unwrap_err().name, "k");
        assert_eq!(OverCompensation::new(1.0, 0.0).unwrap_err().name, "ti");
    }

    #[test]
    fn even_looks_at_four_and_relay_at_eight() {
        let block = OverCompensation::new(-1.0, 10.0).unwrap();
        let mut state = OverCompensationState::default();
        let found: std::vec::Vec<OverWarning> =
            (0..9).map(|_| block.update(&mut state, &half(2.0, 0.5), 0.1, 1.0)).collect();
        assert_eq!(found.iter().position(|w| w.even), Some(3));
        assert_eq!(found.iter().position(|w| w.relay), Some(7));
    }

    #[test]
    fn a_break_begins_the_row_anew() {
        let breaks = [
            (HalfPeriod { flags: 1, ..half(2.0, 0.5) }, 1.0),
            (HalfPeriod { delta_sp: 0.5, ..half(2.0, 0.5) }, 1.0),
            (half(2.0, 0.0), 1.0),
            (half(2.0, 0.5), 0.0),
        ];
        for (other, size) in breaks {
            let block = OverCompensation::new(1.0, 10.0).unwrap();
            let mut state = OverCompensationState::default();
            for _ in 0..8 {
                block.update(&mut state, &half(2.0, 0.5), 0.1, 1.0);
            }
            assert_eq!(block.update(&mut state, &other, 0.1, size), OverWarning::default());
            assert!(!block.update(&mut state, &half(2.0, 0.5), 0.1, 1.0).even);
        }
    }

    #[test]
    fn a_state_from_outside_is_safe() {
        let block = OverCompensation::new(1.0, 10.0).unwrap();
        let mut state = OverCompensationState { at: 255, count: 255, ..OverCompensationState::default() };
        block.update(&mut state, &half(2.0, 0.5), 0.1, 1.0);
        assert_eq!(usize::from(state.count), N);
    }
}
