//! Whether a loop has become worse: what a compensation may not do.

use crate::Real;

/// Compares PV's mean distance from SP, and how often OP turns, since compensation is in force with before it was enabled.
///
/// ```text
/// mean += (x − mean)·h/(min(age, T) + h)          of |e|, and of the reversals of OP by more than `band` over h
///
/// worse:  since both were watched for T/2:  |e| > 1.1·|e| before,  or  reversals in T > 1.5·those before + 2
/// ```
///
/// A mean over all time up to T, and over about the last T from then on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Harm<R> {
    /// T \[s\].
    pub(crate) watch: R,
    /// [OP unit].
    pub(crate) band: R,
}

/// What [`Harm`] remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct HarmState<R> {
    before: Mean<R>,
    since: Mean<R>,
    /// OP's lowest and highest since it last turned, and which way it goes.
    low: R,
    high: R,
    direction: i8,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Mean<R> {
    /// Mean of |e| [PV unit].
    e: R,
    /// Reversals per second.
    reversals: R,
    /// Up to T \[s\].
    age: R,
}

impl<R: Real> Harm<R> {
    /// Takes the error, OP as it is sent and the time since the last sample, before it is enabled (`since` false) or while
    /// it is in force; tells whether it is worse.
    #[inline(always)]
    pub(crate) fn update(&self, state: &mut HarmState<R>, e: R, op: R, h: R, since: bool) -> bool {
        let turned = if self.turned(state, op) { R::ONE } else { R::ZERO };
        let mean = if since { &mut state.since } else { &mut state.before };
        let whole = mean.age + h;
        mean.e += (e.magnitude() - mean.e) * (h / whole);
        mean.reversals += (turned - mean.reversals * h) / whole;
        mean.age = whole.lesser(self.watch);
        if !since {
            state.since = Mean::default();
            return false;
        }
        let known = R::of(0.5) * self.watch;
        let (before, since) = (&state.before, &state.since);
        before.age >= known
            && since.age >= known
            && (since.e > R::of(1.1) * before.e
                || since.reversals * self.watch > R::of(1.5) * before.reversals * self.watch + R::of(2.0))
    }

    /// Begins anew with where OP goes, after samples that were not seen.
    pub(crate) fn forget(&self, state: &mut HarmState<R>) {
        state.direction = 0;
    }

    #[inline(always)]
    fn turned(&self, state: &mut HarmState<R>, op: R) -> bool {
        if state.direction == 0 {
            (state.low, state.high, state.direction) = (op, op, 1);
        }
        state.low = state.low.lesser(op);
        state.high = state.high.greater(op);
        let turned = if state.direction > 0 { state.high - op > self.band } else { op - state.low > self.band };
        if turned {
            (state.low, state.high, state.direction) = (op, op, -state.direction);
        }
        turned
    }
}
