//! Warning of over-compensation: the valve is driven back and forth by what should carry it through its gap.

use crate::error::require;
use crate::{HalfPeriod, ParameterError, Real};

/// Half-periods that [`OverCompensation`] looks at.
const N: usize = 8;

/// Warning of [`OverCompensation`] after a half-period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OverWarning {
    /// Code block 7.1: the last four half-periods are equally long, to less than two samples.
    pub equal: bool,
    /// The last eight are alike, faster than before, and OP's own travel in them is no part of a gap: a relay drives the loop.
    pub relay: bool,
}

/// Two warnings of a compensation δ wider than the gap d (thesis 7.4).
///
/// Over-compensated, u_FF followed by the gap is a relay of ±(δ − d)/2, and the loop oscillates where −1/N(A) = −πA/(2(δ − d))
/// meets the process. Two ways to tell:
///
/// ```text
/// equal:  max(Δt₁ … Δt₄) − min(Δt₁ … Δt₄) < 2h                                   code block 7.1
///
/// relay:  eight half-periods are alike:  max Δt ≤ 1.5·min Δt + h,  max Δy ≤ 2·min Δy
///         and most of them have  δ/100 ≤ |K|/Ti·Δy·Δt ≤ δ
///         and before it was enabled they were not alike, or longer:  mean Δt ≤ 0.75·mean Δt before
/// ```
///
/// A gap in an integrating process makes equal half-periods too, with or without compensation, so that `equal` is wrong there.
/// What tells a relay from a gap:
///
/// - **Frequency.** −1/N of a gap lies where the phase of the loop is between −90° and −180°, that of a relay beside the controller
///   at −180° and beyond: a relay's cycle is faster than the gap's in the same loop, and the gap's is as fast with half a gap
///   as with a whole one. In a loop that had no cycle before, any is new.
/// - **OP's own travel**, by (7.5) |K|/Ti·Δy·Δt. What is left of a gap, d − δ, has to be gone through in every half-period; a
///   relay needs no travel at all, its jumps do the work: by −1/N(A) there is 4/π·|K·P(iω)|/(Ti·ω)·(δ − d), a small part of δ
///   in every loop that is tuned to be stable. Noise alone makes hardly any.
///
/// An oscillation that comes from outside, or from a valve that sticks, was there before and is as fast: no relay. Where nothing
/// is known of before, OP's own travel must be below δ/5.
///
/// Takes every completed half-period of the error, with the width in force: 0 while nothing is compensated. One with a flag,
/// or in which the setpoint moved by Δy or more, begins the row anew. A time between samples that is no number counts as 0.
///
/// Known blindness: noise larger than the relay's swing makes half-periods of all lengths. That is an over-compensation of which
/// PV shows nothing; OP's travel does, and has a budget.
///
/// ```
/// use glapp_core::{HalfPeriod, OverCompensation, OverCompensationState};
///
/// let warning = OverCompensation::new(0.5, 10.0)?;
/// let mut state = OverCompensationState::default();
/// let mut after = |delta_t, delta_y, size| {
///     let half = HalfPeriod { delta_t, delta_y, ..HalfPeriod::default() };
///     (0..8).map(|_| warning.update(&mut state, &half, 0.1, size)).last().unwrap()
/// };
/// after(30.0, 1.3, 0.0); // the cycle of a gap, nothing compensated
/// let half_compensated = after(30.0, 0.6, 2.0); // smaller, and as slow
/// assert!(half_compensated.equal && !half_compensated.relay);
/// let too_much = after(15.0, 0.4, 6.0);
/// assert!(too_much.equal && too_much.relay);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverCompensation<R> {
    k: R,
    ti: R,
}

/// State of an [`OverCompensation`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OverCompensationState<R> {
    /// Δt \[s\] and Δy [PV unit] of the last half-periods, in a ring.
    durations: [R; N],
    heights: [R; N],
    at: u8,
    count: u8,
    compensating: bool,
    /// Mean Δt before it was enabled, 0 where half-periods were not alike; `None`: not known.
    before: Option<R>,
}

/// Facts that the half-periods in the ring share.
struct Row<R> {
    equal: bool,
    alike: bool,
    /// Sum of Δt \[s\].
    duration: R,
}

impl<R: Real> OverCompensation<R> {
    /// The warnings for a controller with gain `k` ≠ 0 [OP unit per PV unit] and integral time `ti` > 0 \[s\].
    pub fn new(k: R, ti: R) -> Result<Self, ParameterError> {
        require("k", k, k != R::ZERO, "a number other than 0")?;
        Ok(Self { k: k.magnitude(), ti: require("ti", ti, ti > R::ZERO, "greater than 0 s")? })
    }

    /// Takes a completed half-period, the time between samples `h` \[s\], and the width in force during it [OP unit].
    #[inline(never)]
    pub fn update(&self, state: &mut OverCompensationState<R>, half: &HalfPeriod<R>, h: R, size: R) -> OverWarning {
        let h = if h.is_number() { h } else { R::ZERO };
        let compensating = size > R::ZERO;
        if compensating != state.compensating {
            if compensating && usize::from(state.count) >= N {
                let row = row(state, h);
                state.before = Some(if row.alike { row.duration / R::of(N as f64) } else { R::ZERO });
            }
            (state.compensating, state.count) = (compensating, 0);
        }
        if half.flags != 0 || half.delta_y <= R::ZERO || half.delta_sp >= half.delta_y {
            state.count = 0;
            return OverWarning::default();
        }
        let at = usize::from(state.at) % N;
        (state.durations[at], state.heights[at]) = (half.delta_t, half.delta_y);
        state.at = ((at + 1) % N) as u8;
        state.count = state.count.saturating_add(1).min(N as u8);
        if !compensating {
            return OverWarning::default();
        }
        let row = row(state, h);
        OverWarning { equal: row.equal, relay: row.alike && self.drives(state, &row, size) }
    }

    /// Whether half-periods that are alike come from a relay.
    fn drives(&self, state: &OverCompensationState<R>, row: &Row<R>, size: R) -> bool {
        let most = if state.before.is_none() { R::of(5.0) } else { R::ONE };
        let travels = |i: &usize| {
            let travel = self.k / self.ti * state.heights[*i] * state.durations[*i];
            travel * most <= size && travel * R::of(100.0) >= size
        };
        let faster = |before: R| before <= R::ZERO || row.duration <= R::of(0.75) * R::of(N as f64) * before;
        (0..N).filter(travels).count() > N / 2 && state.before.is_none_or(faster)
    }
}

/// Looks through the ring, from the last half-period back.
fn row<R: Real>(state: &OverCompensationState<R>, h: R) -> Row<R> {
    let last = (usize::from(state.at) + N - 1) % N;
    let (mut shortest, mut longest) = (state.durations[last], state.durations[last]);
    let (mut lowest, mut highest) = (state.heights[last], state.heights[last]);
    let mut row = Row { equal: false, alike: false, duration: R::ZERO };
    for i in 0..usize::from(state.count).min(N) {
        let j = (last + N - i) % N;
        (shortest, longest) = (shortest.lesser(state.durations[j]), longest.greater(state.durations[j]));
        (lowest, highest) = (lowest.lesser(state.heights[j]), highest.greater(state.heights[j]));
        row.duration += state.durations[j];
        if i == 3 {
            row.equal = longest - shortest < h + h;
        }
    }
    let full = usize::from(state.count) >= N;
    row.alike = full && longest <= R::of(1.5) * shortest + h && highest <= lowest + lowest;
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half(delta_t: f64, delta_y: f64) -> HalfPeriod<f64> {
        HalfPeriod { delta_t, delta_y, ..HalfPeriod::default() }
    }

    /// The last warning after `n` half-periods.
    fn after(state: &mut OverCompensationState<f64>, n: usize, half: &HalfPeriod<f64>, size: f64) -> OverWarning {
        let block = OverCompensation::new(-1.0, 10.0).unwrap();
        (0..n).map(|_| block.update(state, half, 0.1, size)).last().unwrap()
    }

    #[test]
    fn parameters_out_of_bounds_are_named() {
        assert_eq!(OverCompensation::new(0.0, 1.0).unwrap_err().name, "k");
        assert_eq!(OverCompensation::new(1.0, 0.0).unwrap_err().name, "ti");
    }

    #[test]
    fn even_looks_at_four_and_relay_at_eight() {
        for (n, equal, relay) in [(3, false, false), (4, true, false), (7, true, false), (8, true, true)] {
            let mut state = OverCompensationState::default();
            assert_eq!(after(&mut state, n, &half(2.0, 0.5), 1.0), OverWarning { equal, relay });
        }
    }

    #[test]
    fn nothing_is_warned_of_while_nothing_is_compensated() {
        let mut state = OverCompensationState::default();
        assert_eq!(after(&mut state, 20, &half(2.0, 0.5), 0.0), OverWarning::default());
    }

    #[test]
    fn before_decides() {
        for (cycle_before, relay) in [(Some(2.0), false), (Some(2.8), true), (None, true)] {
            let mut state = OverCompensationState::default();
            for i in 0..8 {
                let duration = cycle_before.unwrap_or(f64::from(i) + 1.0);
                after(&mut state, 1, &half(duration, 0.5), 0.0);
            }
            // OP's own travel is 0.2, a third of what is compensated.
            assert_eq!(after(&mut state, 8, &half(2.0, 1.0), 0.6).relay, relay, "{cycle_before:?}");
            // Off and on again, too short to learn anew.
            after(&mut state, 3, &half(9.0, 0.5), 0.0);
            assert_eq!(after(&mut state, 8, &half(2.0, 1.0), 0.6).relay, relay, "{cycle_before:?}");
        }
        let mut unknown = OverCompensationState::default();
        assert!(!after(&mut unknown, 8, &half(2.0, 1.0), 0.6).relay);
    }

    #[test]
    fn a_ringing_that_dies_out_is_no_cycle() {
        let mut state = OverCompensationState::default();
        for i in 0..8 {
            after(&mut state, 1, &half(2.0, 0.6_f64.powi(i)), 0.0);
        }
        assert!(after(&mut state, 8, &half(2.0, 0.5), 1.0).relay, "the same period before, but not kept up");
    }

    #[test]
    fn a_time_between_samples_that_is_no_number_is_none() {
        let block = OverCompensation::new(1.0, 10.0).unwrap();
        for h in [f64::NAN, f64::INFINITY] {
            let mut state = OverCompensationState::default();
            let longer = (0..8).map(|i| half(2.0 + 0.1 * f64::from(i), 0.5));
            assert!(!longer.map(|half| block.update(&mut state, &half, h, 1.0)).any(|warning| warning.equal), "{h}");
        }
    }

    #[test]
    fn a_break_begins_the_row_anew() {
        let breaks =
            [HalfPeriod { flags: 1, ..half(2.0, 0.5) }, HalfPeriod { delta_sp: 0.5, ..half(2.0, 0.5) }, half(2.0, 0.0)];
        for other in breaks {
            let mut state = OverCompensationState::default();
            after(&mut state, 8, &half(2.0, 0.5), 1.0);
            assert_eq!(after(&mut state, 1, &other, 1.0), OverWarning::default());
            assert!(!after(&mut state, 3, &half(2.0, 0.5), 1.0).equal);
        }
    }

    #[test]
    fn a_state_from_outside_is_safe() {
        let mut state = OverCompensationState { at: 255, count: 255, ..OverCompensationState::default() };
        after(&mut state, 1, &half(2.0, 0.5), 1.0);
        assert!(usize::from(state.count) <= N);
    }
}
