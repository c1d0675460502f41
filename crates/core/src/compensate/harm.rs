//! Check that a loop has not become worse, as no compensation may make it.

use crate::{Real, Sum};

/// Blocks in the time over which a loop is compared.
const BLOCKS: f64 = 150.0;
/// Blocks that must have been watched before anything is concluded.
const KNOWN: f64 = 10.0;
/// Blocks after which it is judged, and after which it has stood the trial.
const TRIAL: (f64, f64) = (60.0, 100.0);
/// Greatest block, in means of before: a larger one is a step of setpoint or load, and not how the loop swings.
const STEP: f64 = 4.0;
/// Most blocks in a row that count as one step.
const BURST: u8 = 10;

/// Compares PV's distance from SP, and how often OP turns, since compensation is in force with before it was enabled.
///
/// ```text
/// of every block of T/150:  x = mean |e|,   n = reversals of OP by more than `band`
///
/// x̄ += (x − x̄)/N,   σ² += ((x − x̄ old)·(x − x̄ new) − σ²)/N      N: blocks so far, up to 150;  n alike
///
/// worse:  x̄ − 1.1·x̄ before > z·σ before·√(1/N + 1/N before)     or
///         n̄ − 1.5·n̄ before > z·√max(σ², n̄) before·√(1/N + 1/N before)
///
///                    x      n
///   10 ≤ N < 60     60/N   60/N     much worse is told early
///   60 ≤ N < 100     0     −0.8     the trial: it must not seem worse, and OP must be seen to turn no more often
///   100 ≤ N          1      1       it has stood the trial: only what is beyond doubt
/// ```
///
/// For counts, no scatter is taken to be less than that of chance alone. A step of setpoint or load makes blocks above 4·x̄
/// before; up to ten of them in a row are left out, before and since alike. More in a row are how the loop swings now: since
/// it is in force they count as 4·x̄ before each, and before it was enabled everything begins anew with them.
///
/// An interruption ends the block, not the trial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Harm<R> {
    /// T \[s\].
    pub(crate) watch: R,
    /// [OP unit].
    pub(crate) band: R,
}

/// State of [`Harm`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct HarmState<R: Real> {
    before: Blocks<R>,
    since: Blocks<R>,
    /// Whether the block is one of those since it is in force.
    in_force: bool,
    /// Running sums of the block: duration \[s\], integral of |e|, reversals.
    time: R::Sum,
    area: R::Sum,
    reversals: R,
    /// Blocks in a row above [`STEP`].
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

impl<R: Real> Blocks<R> {
    fn learn(&mut self, e: R, reversals: R) {
        self.count = (self.count + R::ONE).lesser(R::of(BLOCKS));
        self.e.learn(e, self.count);
        self.reversals.learn(reversals, self.count);
    }
}

impl<R: Real> Mean<R> {
    fn learn(&mut self, x: R, count: R) {
        let off = x - self.value;
        self.value += off / count;
        self.variance += (off * (x - self.value) - self.variance) / count;
    }
}

/// Whether `more` > z·√variance.
fn beyond<R: Real>(more: R, z: R, variance: R) -> bool {
    let reach = z * z * variance;
    if z < R::ZERO { more > R::ZERO || more * more < reach } else { more > R::ZERO && more * more > reach }
}

impl<R: Real> Harm<R> {
    /// Takes the error, OP as it is sent and the time since the last sample, before it is enabled (`in_force` false) or while
    /// it is in force; tells whether it is worse.
    #[inline(always)]
    pub(crate) fn update(&self, state: &mut HarmState<R>, e: R, op: R, h: R, in_force: bool) -> bool {
        if in_force != state.in_force {
            self.begin(state, in_force);
        }
        if self.turned(state, op) {
            state.reversals += R::ONE;
        }
        state.time.add(h);
        state.area.add(e.magnitude() * h);
        state.time.value() * R::of(BLOCKS) >= self.watch && self.conclude(state)
    }

    /// Ends a block of the watch and judges.
    #[inline(never)]
    fn conclude(&self, state: &mut HarmState<R>) -> bool {
        let (x, n) = (state.area.value() / state.time.value(), state.reversals);
        (state.time, state.area, state.reversals) = (R::Sum::default(), R::Sum::default(), R::ZERO);
        let before = state.before;
        let most = R::of(STEP) * before.e.value;
        let stepped = before.count >= R::of(5.0) && x > most;
        state.burst = if stepped { state.burst.saturating_add(1) } else { 0 };
        if stepped && state.burst <= BURST {
            return false;
        }
        if !state.in_force {
            if stepped {
                (state.before, state.burst) = (Blocks::default(), 0);
            }
            state.before.learn(x, n);
            return false;
        }
        state.since.learn(if stepped { most } else { x }, n);
        let since = &state.since;
        if since.count < R::of(KNOWN) || before.count < R::of(KNOWN) {
            return false;
        }
        let (of_e, of_n) = if since.count < R::of(TRIAL.0) {
            (R::of(TRIAL.0) / since.count, R::of(TRIAL.0) / since.count)
        } else if since.count < R::of(TRIAL.1) {
            (R::ZERO, R::of(-0.8))
        } else {
            (R::ONE, R::ONE)
        };
        let scatter = R::ONE / since.count + R::ONE / before.count;
        let chance = before.reversals.variance.greater(before.reversals.value);
        beyond(since.e.value - R::of(1.1) * before.e.value, of_e, before.e.variance * scatter)
            || beyond(since.reversals.value - R::of(1.5) * before.reversals.value, of_n, chance * scatter)
    }

    /// Discards the values under compensation, as it comes into force or goes out of it.
    pub(crate) fn begin(&self, state: &mut HarmState<R>, in_force: bool) {
        (state.in_force, state.burst, state.since) = (in_force, 0, Blocks::default());
        self.interrupt(state);
    }

    /// Discards the block under way and the direction of OP, after samples that were not seen.
    pub(crate) fn interrupt(&self, state: &mut HarmState<R>) {
        (state.time, state.area) = (R::Sum::default(), R::Sum::default());
        (state.reversals, state.direction) = (R::ZERO, 0);
    }

    /// Whether OP has reversed by more than the band.
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
