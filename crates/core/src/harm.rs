//! Whether a loop has become worse: what a compensation may not do.

use crate::Real;

/// Blocks in the time over which a loop is compared.
const BLOCKS: f64 = 150.0;
/// Blocks that must have been watched before anything is concluded.
const KNOWN: f64 = 10.0;

/// As many blocks in a row are no burst any more.
const BURST: u8 = 10;

/// How sure it must be, in standard errors: of PV's distance, of OP's reversals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Doubt {
    e: f64,
    reversals: f64,
}

impl Doubt {
    /// Enough to take less.
    pub(crate) const FIRST: Self = Self { e: 0.5, reversals: 0.0 };
    /// Enough to give it up.
    pub(crate) const LAST: Self = Self { e: 1.5, reversals: 0.5 };
}

/// Compares PV's distance from SP, and how often OP turns, since compensation is in force with before it was enabled.
///
/// ```text
/// of every block of T/150:  x = min(mean |e|, 3·x̄ before),   n = reversals of OP by more than `band`
///
/// x̄ += (x − x̄)/N,   σ² += ((x − x̄ old)·(x − x̄ new) − σ²)/N      N: blocks so far, up to 150;  n alike
///
/// worse:  x̄ − 1.1·x̄ before > z·σ before·√(1/N + 1/N before)     or
///         n̄ − 1.5·n̄ before > z·√max(σ², n̄) before·√(1/N + 1/N before)
/// ```
///
/// So much more than before is told after a few blocks, a little more after many; for counts, no scatter is taken to be less
/// than that of chance alone. What a step of setpoint or load adds is cut off at three times the mean: it would hide all else.
/// Where ten blocks in a row before were cut off, the loop is no longer what it was: before begins anew.
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
    before: Blocks<R>,
    since: Blocks<R>,
    /// Whether the block is one of those since it is in force.
    in_force: bool,
    /// Of the block: how long it is \[s\], its integral of |e|, its reversals.
    time: R,
    area: R,
    reversals: R,
    /// Blocks in a row that were cut off.
    burst: u8,
    /// OP's lowest and highest since it last turned, and which way it goes.
    low: R,
    high: R,
    direction: i8,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Blocks<R> {
    /// Up to [`BLOCKS`].
    count: R,
    e: Mean<R>,
    reversals: Mean<R>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Mean<R> {
    value: R,
    variance: R,
}

impl<R: Real> Mean<R> {
    fn learn(&mut self, x: R, count: R) {
        let off = x - self.value;
        self.value += off / count;
        self.variance += (off * (x - self.value) - self.variance) / count;
    }
}

impl<R: Real> Harm<R> {
    /// Takes the error, OP as it is sent and the time since the last sample, before it is enabled (`in_force` false) or while
    /// it is in force; tells whether it is worse beyond doubt.
    #[inline(always)]
    pub(crate) fn update(&self, state: &mut HarmState<R>, e: R, op: R, h: R, in_force: bool, doubt: Doubt) -> bool {
        if in_force != state.in_force {
            state.in_force = in_force;
            self.again(state);
        }
        if self.turned(state, op) {
            state.reversals += R::ONE;
        }
        state.time += h;
        state.area += e.magnitude() * h;
        state.time * R::of(BLOCKS) >= self.watch && self.conclude(state, doubt)
    }

    /// Ends a block.
    #[inline(never)]
    fn conclude(&self, state: &mut HarmState<R>, doubt: Doubt) -> bool {
        let (mut x, n) = (state.area / state.time, state.reversals);
        (state.time, state.area, state.reversals) = (R::ZERO, R::ZERO, R::ZERO);
        let before = state.before;
        if before.count >= R::of(5.0) {
            let most = R::of(3.0) * before.e.value;
            state.burst = if x > most && !state.in_force { state.burst + 1 } else { 0 };
            x = x.lesser(most);
        }
        if state.burst >= BURST {
            (state.before, state.burst) = (Blocks::default(), 0);
        }
        let blocks = if state.in_force { &mut state.since } else { &mut state.before };
        blocks.count = (blocks.count + R::ONE).lesser(R::of(BLOCKS));
        blocks.e.learn(x, blocks.count);
        blocks.reversals.learn(n, blocks.count);
        if !state.in_force || before.count < R::of(KNOWN) {
            return false;
        }
        let since = &state.since;
        let scatter = R::ONE / since.count + R::ONE / before.count;
        let beyond = |more: R, variance: R, z: f64| more > R::ZERO && more * more > R::of(z * z) * (variance * scatter);
        let chance = before.reversals.variance.greater(before.reversals.value);
        beyond(since.e.value - R::of(1.1) * before.e.value, before.e.variance, doubt.e)
            || beyond(since.reversals.value - R::of(1.5) * before.reversals.value, chance, doubt.reversals)
    }

    /// Begins anew with what is since it is in force.
    pub(crate) fn again(&self, state: &mut HarmState<R>) {
        (state.time, state.area, state.reversals) = (R::ZERO, R::ZERO, R::ZERO);
        state.since = Blocks::default();
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
