//! Many samples at once: the same law, the same bits, with nearly all samples passed over in a loop that stays in registers.

use super::{Conclusions, Detector, DetectorState, HalfPeriodResult, Signal};
use crate::status::{BAD, Status};
use crate::{Real, SecondOrderFilterState, Sum};

/// Samples in columns of equal length, for [`Detector::run`].
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a, R> {
    /// Time \[s\] since any fixed instant.
    pub t: &'a [f64],
    /// Setpoint [PV unit].
    pub sp: &'a [R],
    /// Process value [PV unit].
    pub pv: &'a [R],
    /// Controller output [OP unit], where it is known.
    pub op: Option<&'a [R]>,
    /// Flags as in [`Sample`](super::Sample), where there are any.
    pub flags: Option<&'a [u8]>,
}

impl<R> Columns<'_, R> {
    /// The number of samples: the length of the shortest column.
    pub fn rows(&self) -> usize {
        let mut n = self.t.len().min(self.sp.len()).min(self.pv.len());
        if let Some(op) = self.op {
            n = n.min(op.len());
        }
        if let Some(flags) = self.flags {
            n = n.min(flags.len());
        }
        n
    }

    /// The samples `from` to before `to`.
    pub fn part(&self, from: usize, to: usize) -> Self {
        Self {
            t: &self.t[from..to],
            sp: &self.sp[from..to],
            pv: &self.pv[from..to],
            op: self.op.map(|op| &op[from..to]),
            flags: self.flags.map(|flags| &flags[from..to]),
        }
    }
}

/// A row of [`Columns`].
#[derive(Clone, Copy)]
pub(super) struct Row<R> {
    pub(super) t: f64,
    pub(super) sp: R,
    pub(super) pv: R,
    pub(super) op: R,
    pub(super) flags: Status,
}

/// Start and end of a half-period: its first sample, and the sample that ended it or, at a gap, the last one
/// before it. In the time of [`Columns`]; NaN before the first time that is a number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// \[s\].
    pub start: f64,
    /// \[s\].
    pub end: f64,
}

impl<R: Real> Detector<R> {
    /// Takes many samples; hands every record to `ended`, and every sample's index and filtered PV to `seen`, which is
    /// none while the filter waits for a sample that can be used. The same bits as [`Detector::update`] sample by sample
    /// with h = t\[k\] − t\[k − 1\].
    pub fn run(
        &self,
        state: &mut DetectorState<R>,
        columns: Columns<'_, R>,
        mut ended: impl FnMut(Span, &HalfPeriodResult<R>),
        mut seen: impl FnMut(usize, Option<R>),
    ) {
        let (ended, seen) = (&mut ended, &mut seen);
        match (columns.op.is_some(), columns.flags.is_some()) {
            (true, true) => self.run_columns::<true, true>(state, columns, ended, seen),
            (true, false) => self.run_columns::<true, false>(state, columns, ended, seen),
            (false, true) => self.run_columns::<false, true>(state, columns, ended, seen),
            (false, false) => self.run_columns::<false, false>(state, columns, ended, seen),
        }
    }

    #[inline(always)]
    fn run_columns<const OP: bool, const FLAGS: bool>(
        &self,
        state: &mut DetectorState<R>,
        columns: Columns<'_, R>,
        ended: &mut impl FnMut(Span, &HalfPeriodResult<R>),
        seen: &mut impl FnMut(usize, Option<R>),
    ) {
        let n = columns.rows();
        let (t, sp, pv) = (&columns.t[..n], &columns.sp[..n], &columns.pv[..n]);
        let op = |k: usize| if OP { columns.op.map_or(R::ZERO, |op| op[k]) } else { R::ZERO };
        let flags = |k: usize| if FLAGS { columns.flags.map_or(0, |flags| flags[k].into()) } else { 0 };
        let (mut before, mut start) = state.t.unwrap_or((f64::NAN, f64::NAN));
        let mut signal = state.signal;
        let mut k = 0;
        while k < n {
            k = self.glide::<OP, FLAGS>(&mut signal, &mut before, k, n, &columns, seen);
            if k == n {
                break;
            }
            let row = Row { t: t[k], sp: sp[k], pv: pv[k], op: op(k), flags: flags(k) };
            if let Some((span, record)) =
                self.take_row::<OP>(&mut signal, &mut state.memory, &mut before, &mut start, row)
            {
                ended(span, &record);
            }
            seen(k, signal.pv.started.then_some(signal.pv.y2.value()));
            k += 1;
        }
        state.signal = signal;
        state.t = before.is_number().then_some((before, start));
    }

    /// Processes one sample by the full rules. `before` gets its time, and `start` too where a half-period begins.
    #[inline(always)]
    pub(super) fn take_row<const OP: bool>(
        &self,
        signal: &mut Signal<R>,
        memory: &mut Conclusions<R>,
        before: &mut f64,
        start: &mut f64,
        Row { t, sp, pv, op, flags }: Row<R>,
    ) -> Option<(Span, HalfPeriodResult<R>)> {
        let h = R::of(t - *before);
        let mut end = t;
        let half;
        if let Some(next) = self.advance::<OP>(signal, h, sp, pv, op, flags) {
            half = self.observe_good::<OP>(signal, next, h, sp, op, flags, pv);
            *before = t;
        } else {
            (*signal, half) = self.observe_break::<OP>(*signal, h, sp, pv, op, flags, pv);
            end = if self.in_time(h) { end } else { *before };
            // A time that is not a number stands for the one before it.
            *before = if t.is_number() { t } else { *before };
            *start = if start.is_number() { *start } else { *before };
        }
        let half = half?;
        let found = (Span { start: *start, end }, self.judge(memory, half, OP, &signal.noise));
        *start = *before;
        Some(found)
    }

    /// Passes over samples that neither end a half-period nor break the signal, nearly all there are; gives the index
    /// of the first other one.
    #[inline(always)]
    fn glide<const OP: bool, const FLAGS: bool>(
        &self,
        signal: &mut Signal<R>,
        before: &mut f64,
        from: usize,
        to: usize,
        columns: &Columns<'_, R>,
        seen: &mut impl FnMut(usize, Option<R>),
    ) -> usize {
        // The step to the first sample is read from the column too, which spares the loop a register.
        if signal.broken != 0 || !signal.pv.started || from == 0 || *before != columns.t[from - 1] {
            return from;
        }
        match signal.crossing.sign {
            1 => self.glide_towards::<OP, FLAGS, true>(signal, before, from, to, columns, seen),
            -1 => self.glide_towards::<OP, FLAGS, false>(signal, before, from, to, columns, seen),
            _ => from,
        }
    }

    /// [`Self::glide`] for an error of one sign: PV below SP, or above it. A function of its own with copies on its stack, so that
    /// the loop stays in registers. It checks what [`Self::advance`] checks, and the sign of the error.
    #[inline(never)]
    fn glide_towards<const OP: bool, const FLAGS: bool, const BELOW: bool>(
        &self,
        signal: &mut Signal<R>,
        before: &mut f64,
        from: usize,
        to: usize,
        columns: &Columns<'_, R>,
        seen: &mut impl FnMut(usize, Option<R>),
    ) -> usize {
        // Cut to one length here, where the compiler sees that no index leaves them.
        let (t, sp, pv) = (&columns.t[..to], &columns.sp[..to], &columns.pv[..to]);
        let op = columns.op.map_or(&[] as &[R], |op| &op[..to]);
        let flags = columns.flags.map_or(&[] as &[u8], |flags| &flags[..to]);
        if (OP && op.len() != to) || (FLAGS && flags.len() != to) {
            return from;
        }
        let (filter, max_h) = (self.filter, self.max_h);
        let (op_low, op_high) = self.op_limits.map_or((-R::MOST, R::MOST), |(low, high)| {
            (low.greater(-R::MOST), high.lesser(R::MOST)) // within them nothing has to be asked
        });
        // Both filters have started: the compiler cannot see this from the state.
        let mut y = SecondOrderFilterState { started: true, ..signal.pv };
        let mut u = SecondOrderFilterState { started: OP, ..signal.op };
        let (mut half, mut noise) = (signal.half, signal.noise);
        let mut sp_before = half.sp_low();
        let mut k = from;
        while k < to {
            let h = R::of(t[k] - t[k - 1]);
            let mut flag = if FLAGS { flags[k].into() } else { 0 };
            if !(h > R::ZERO && h <= max_h) || flag & BAD != 0 {
                break;
            }
            if OP && !(op[k] > op_low && op[k] < op_high) {
                if !op[k].is_measurable() {
                    break;
                }
                flag = self.with_limits::<OP>(flag, op[k]);
            }
            let mut next = y;
            let yf = filter.update(&mut next, pv[k], h);
            let size = if BELOW { next.y2.to(sp[k]) } else { next.y2.since(sp[k].into()) };
            if !(size >= R::ZERO && size <= R::MOST) {
                break;
            }
            y = next;
            noise.update(pv[k]);
            if OP {
                filter.update(&mut u, op[k], h);
            }
            half.integrate(size, h, flag);
            // A setpoint that rests, as most do, costs one comparison.
            if sp[k] != sp_before {
                sp_before = sp[k];
                half.widen(sp_before);
            }
            seen(k, Some(yf));
            k += 1;
        }
        half.count((k - from) as u32);
        (signal.pv, signal.op, signal.half, signal.noise, *before) = (y, u, half, noise, t[k - 1]);
        k
    }
}
