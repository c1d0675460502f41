//! Several loops at once, one in each lane of the processor's registers: the same law, the same bits.
//!
//! A row is one sample of each loop. Nearly all samples neither end a half-period nor break the signal; these go through the blocks'
//! own functions, loop by loop in a loop of fixed length over plain arrays, which the compiler turns into vector instructions of
//! whatever width it may use. Any other sample is taken by the law itself, alone.

use super::batch::Row;
use super::{Columns, Detector, DetectorState, Record, Span};
use crate::signal::{BEGINNING, VALUES};
use crate::status::{AT_HIGH, AT_LOW, BAD};
use crate::{HalfPeriodState, NoiseLevel, Real, SecondOrderFilter, SecondOrderFilterState, Status};

/// Loops that run side by side.
pub const LANES: usize = 8;
/// Samples of each loop between turning columns into rows: what stays in the nearest cache.
const ROWS: usize = 64;

/// After [`ROWS`] of which more are not ordinary in some lane, the loops go on alone, one after the other, for so many rows: a row that is
/// not ordinary takes as long as some ten that are.
const OFTEN: usize = ROWS / 8;
const ALONE: usize = 4096;

type Lane<T = f64> = [T; LANES];

/// Samples by rows.
#[repr(align(64))]
struct Rows {
    /// Step to the sample \[s\], no number where one of the two times is none.
    h: [Lane; ROWS],
    sp: [Lane; ROWS],
    pv: [Lane; ROWS],
    op: [Lane; ROWS],
    flags: [Lane<u64>; ROWS],
}

/// What the detectors are told.
#[repr(align(64))]
struct Told {
    filter: Lane<SecondOrderFilter<f64>>,
    max_h: Lane,
    low: Lane,
    high: Lane,
}

/// What an ordinary sample changes.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Moving {
    y1: Lane,
    y2: Lane,
    u1: Lane,
    u2: Lane,
    delta_t: Lane,
    integral: Lane,
    e_max: Lane,
    sp_low: Lane,
    sp_high: Lane,
    flags: Lane<u64>,
    x: Lane,
    first: Lane,
    second: Lane,
    third: Lane,
    median: Lane,
    gain: Lane,
    grid: Lane,
    repeats: Lane<u64>,
    /// Differences that the noise has counted.
    counted: Lane<u64>,
}

/// Loops under way.
struct Side {
    moving: Moving,
    /// +1 where PV was below SP, −1 above; no number where the loop runs alone for the rest of the rows.
    towards: Lane,
    /// The first row that is not counted in the half-period yet.
    since: Lane<usize>,
}

impl Side {
    /// Takes the state of a loop at row `k`, if it can go on in its lane.
    fn take<const OP: bool>(&mut self, l: usize, k: usize, state: &DetectorState<f64>) -> bool {
        let signal = &state.signal;
        let whole = signal.broken == 0 && signal.pv.started && signal.op.started == OP && signal.crossing.sign != 0;
        let able = whole && signal.noise.values == VALUES && signal.noise.count >= BEGINNING;
        self.towards[l] = if able { signal.crossing.sign.into() } else { f64::NAN };
        let (m, half, noise) = (&mut self.moving, &signal.half, &signal.noise);
        (m.y1[l], m.y2[l], m.u1[l], m.u2[l]) = (signal.pv.y1, signal.pv.y2, signal.op.y1, signal.op.y2);
        (m.delta_t[l], m.integral[l], m.e_max[l]) = (half.delta_t, half.integral, half.e_max);
        (m.sp_low[l], m.sp_high[l], m.flags[l]) = (half.sp_low, half.sp_high, half.flags.into());
        (m.x[l], m.first[l], m.second[l], m.third[l]) = (noise.x, noise.first, noise.second, noise.third);
        (m.median[l], m.gain[l], m.grid[l]) = (noise.median, noise.gain, noise.grid);
        (m.repeats[l], m.counted[l]) = (noise.repeats.into(), noise.count.into());
        self.since[l] = k;
        able
    }

    /// Gives it back before row `k`.
    fn give(&self, l: usize, k: usize, state: &mut DetectorState<f64>) {
        let (m, signal) = (&self.moving, &mut state.signal);
        (signal.pv.y1, signal.pv.y2, signal.op.y1, signal.op.y2) = (m.y1[l], m.y2[l], m.u1[l], m.u2[l]);
        let (half, noise) = (&mut signal.half, &mut signal.noise);
        (half.delta_t, half.integral, half.e_max) = (m.delta_t[l], m.integral[l], m.e_max[l]);
        (half.sp_low, half.sp_high, half.flags) = (m.sp_low[l], m.sp_high[l], m.flags[l] as Status);
        half.count((k - self.since[l]) as u32);
        (noise.x, noise.first, noise.second, noise.third) = (m.x[l], m.first[l], m.second[l], m.third[l]);
        (noise.median, noise.gain, noise.grid) = (m.median[l], m.gain[l], m.grid[l]);
        (noise.repeats, noise.count) = (narrowed(m.repeats[l]), narrowed(m.counted[l]));
    }
}

/// What a count that stays at its largest would be.
fn narrowed(count: u64) -> u8 {
    count.min(u8::MAX.into()) as u8
}

impl Detector<f64> {
    /// As [`Detector::run`] for each of these loops, with the number of the loop before what `ended` is handed. The half-periods of
    /// one loop come in their order. The same bits.
    ///
    /// To be inlined where the instruction set is chosen. As long as all columns are: from the end of the shortest on, and where some
    /// have OP and some have not, each loop runs alone.
    #[inline(always)]
    pub fn run_together(
        detectors: &[Self; LANES],
        states: &mut [DetectorState<f64>; LANES],
        columns: &[Columns<'_, f64>; LANES],
        mut ended: impl FnMut(usize, Span, &Record<f64>),
    ) {
        let with_op = columns.iter().filter(|columns| columns.op.is_some()).count();
        let n = columns.iter().map(Columns::rows).min().unwrap_or(0);
        let flags = columns.iter().any(|columns| columns.flags.is_some());
        let done = match (with_op, flags) {
            (0, false) => Self::run_rows::<false, false>(detectors, states, columns, n, &mut ended),
            (0, true) => Self::run_rows::<false, true>(detectors, states, columns, n, &mut ended),
            (LANES, false) => Self::run_rows::<true, false>(detectors, states, columns, n, &mut ended),
            (LANES, true) => Self::run_rows::<true, true>(detectors, states, columns, n, &mut ended),
            _ => 0,
        };
        for l in 0..LANES {
            let rest = columns[l].part(done, columns[l].rows());
            detectors[l].run(&mut states[l], rest, |span, record| ended(l, span, record), |_, _| ());
        }
    }

    #[inline(always)]
    fn run_rows<const OP: bool, const FLAGS: bool>(
        detectors: &[Self; LANES],
        states: &mut [DetectorState<f64>; LANES],
        columns: &[Columns<'_, f64>; LANES],
        n: usize,
        ended: &mut impl FnMut(usize, Span, &Record<f64>),
    ) -> usize {
        let limit = |l: usize, of: fn((f64, f64)) -> f64, none| detectors[l].op_limits.map_or(none, of);
        let told = Told {
            filter: core::array::from_fn(|l| detectors[l].filter),
            max_h: core::array::from_fn(|l| detectors[l].max_h),
            // Beyond what is measurable: never reached.
            low: core::array::from_fn(|l| limit(l, |limits| limits.0, -f64::MAX)),
            high: core::array::from_fn(|l| limit(l, |limits| limits.1, f64::MAX)),
        };
        let none = [[0.0; LANES]; ROWS];
        let mut rows = Rows { h: none, sp: none, pv: none, op: none, flags: [[0; LANES]; ROWS] };
        let mut side = Side { moving: Moving::default(), towards: [f64::NAN; LANES], since: [0; LANES] };
        let mut first = 0;
        while first < n {
            let length = ROWS.min(n - first);
            let block: [Columns<'_, f64>; LANES] = core::array::from_fn(|l| columns[l].part(first, first + length));
            let mut awake = [false; LANES];
            for l in 0..LANES {
                awake[l] = side.take::<OP>(l, 0, &states[l]);
                if !awake[l] {
                    detectors[l].run(&mut states[l], block[l], |span, record| ended(l, span, record), |_, _| ());
                }
            }
            rows.fill::<OP, FLAGS>(&block, states, length);
            let (mut k, mut stops) = (0, 0);
            while k < length {
                let stopped;
                (k, stopped) = glide::<OP, FLAGS>(&told, &mut side, &rows, k, length);
                stops += 1;
                for l in (0..LANES).filter(|l| stopped[*l]) {
                    side.give(l, k - 1, &mut states[l]);
                    let found = detectors[l].take_alone::<OP>(&mut states[l], &block[l], k - 1);
                    if let Some((span, record)) = &found {
                        ended(l, *span, record);
                    }
                    awake[l] = side.take::<OP>(l, k, &states[l]);
                    if !awake[l] {
                        let rest = block[l].part(k, length);
                        detectors[l].run(&mut states[l], rest, |span, record| ended(l, span, record), |_, _| ());
                    }
                }
            }
            for l in (0..LANES).filter(|l| awake[*l]) {
                side.give(l, length, &mut states[l]);
                states[l].pass_to(block[l].t[length - 1]);
            }
            first += length;
            if stops > OFTEN {
                let to = n.min(first + ALONE);
                for l in 0..LANES {
                    let rest = columns[l].part(first, to);
                    detectors[l].run(&mut states[l], rest, |span, record| ended(l, span, record), |_, _| ());
                }
                first = to;
            }
        }
        n
    }

    /// One sample of some, by the law.
    #[inline(never)]
    fn take_alone<const OP: bool>(
        &self,
        state: &mut DetectorState<f64>,
        columns: &Columns<'_, f64>,
        k: usize,
    ) -> Option<(Span, Record<f64>)> {
        if k > 0 {
            state.pass_to(columns.t[k - 1]);
        }
        let (mut before, mut start) = state.t.unwrap_or((f64::NAN, f64::NAN));
        let op = columns.op.map_or(0.0, |op| op[k]);
        let flags = columns.flags.map_or(0, |flags| flags[k].into());
        let row = Row { t: columns.t[k], sp: columns.sp[k], pv: columns.pv[k], op, flags };
        let found = self.take_row::<OP>(&mut state.signal, &mut state.memory, &mut before, &mut start, row);
        state.t = before.is_number().then_some((before, start));
        found
    }
}

impl DetectorState<f64> {
    /// Goes on to the time of a sample that the lanes took; one that is no number they did not take.
    fn pass_to(&mut self, t: f64) {
        if let Some((before, _)) = &mut self.t
            && t.is_number()
        {
            *before = t;
        }
    }
}

impl Rows {
    /// The samples of these columns, `length` of each.
    #[inline(always)]
    fn fill<const OP: bool, const FLAGS: bool>(
        &mut self,
        block: &[Columns<'_, f64>; LANES],
        states: &[DetectorState<f64>; LANES],
        length: usize,
    ) {
        turn(&mut self.h, |l| &block[l].t[..length], |t| t);
        for k in (1..length).rev() {
            for l in 0..LANES {
                self.h[k][l] -= self.h[k - 1][l];
            }
        }
        for (h, state) in self.h[0].iter_mut().zip(states) {
            *h -= state.t.map_or(f64::NAN, |(before, _)| before);
        }
        turn(&mut self.sp, |l| &block[l].sp[..length], |x| x);
        turn(&mut self.pv, |l| &block[l].pv[..length], |x| x);
        if OP {
            turn(&mut self.op, |l| block[l].op.map_or(&[] as &[f64], |op| &op[..length]), |x| x);
        }
        if FLAGS {
            let none = [0; ROWS];
            turn(&mut self.flags, |l| block[l].flags.map_or(&none[..length], |flags| &flags[..length]), u64::from);
        }
    }
}

/// Turns columns into rows, a line of the cache of each column at a time.
#[inline(always)]
fn turn<'a, T: Copy + 'a, U>(rows: &mut [Lane<U>; ROWS], column: impl Fn(usize) -> &'a [T], of: impl Fn(T) -> U) {
    for l in 0..LANES {
        for (rows, line) in rows.chunks_exact_mut(LANES).zip(column(l).chunks(LANES)) {
            rows.iter_mut().zip(line).for_each(|(row, x)| row[l] = of(*x));
        }
    }
}

/// Passes over rows of ordinary samples; gives the row behind the first that is not ordinary in every lane, which has been taken where
/// it is, and in which lanes it is not. It asks what [`Detector::advance`] asks, and the sign of the error.
#[inline(always)]
fn glide<const OP: bool, const FLAGS: bool>(
    told: &Told,
    side: &mut Side,
    rows: &Rows,
    from: usize,
    to: usize,
) -> (usize, Lane<bool>) {
    let (mut m, towards) = (side.moving, side.towards);
    let mut stopped = [false; LANES];
    let mut k = from;
    while k < to {
        let (h, sp, pv, op, flags) = (&rows.h[k], &rows.sp[k], &rows.pv[k], &rows.op[k], &rows.flags[k]);
        let mut next = m;
        let mut any = false;
        for l in 0..LANES {
            let mut y = SecondOrderFilterState { y1: m.y1[l], y2: m.y2[l], started: true };
            told.filter[l].update(&mut y, pv[l], h[l]);
            (next.y1[l], next.y2[l]) = (y.y1, y.y2);
            let e = sp[l] - y.y2;
            let mut flag = if FLAGS { flags[l] } else { 0 };
            let mut ordinary = (h[l] > 0.0)
                & (h[l] <= told.max_h[l])
                & (flag & u64::from(BAD) == 0)
                & e.is_measurable()
                & (e * towards[l] >= 0.0);
            if OP {
                let mut u = SecondOrderFilterState { y1: m.u1[l], y2: m.u2[l], started: true };
                told.filter[l].update(&mut u, op[l], h[l]);
                (next.u1[l], next.u2[l]) = (u.y1, u.y2);
                ordinary &= op[l].is_measurable();
                flag |= if op[l] <= told.low[l] { u64::from(AT_LOW) } else { 0 };
                flag |= if op[l] >= told.high[l] { u64::from(AT_HIGH) } else { 0 };
            }
            let mut half = HalfPeriodState {
                delta_t: m.delta_t[l],
                integral: m.integral[l],
                e_max: m.e_max[l],
                sp_low: m.sp_low[l],
                sp_high: m.sp_high[l],
                ..HalfPeriodState::default()
            };
            half.integrate(e.magnitude(), h[l], 0);
            half.widen(sp[l]);
            (next.delta_t[l], next.integral[l], next.e_max[l]) = (half.delta_t, half.integral, half.e_max);
            (next.sp_low[l], next.sp_high[l], next.flags[l]) = (half.sp_low, half.sp_high, m.flags[l] | flag);
            let mut noise = NoiseLevel {
                x: m.x[l],
                first: m.first[l],
                second: m.second[l],
                third: m.third[l],
                median: m.median[l],
                gain: m.gain[l],
                grid: m.grid[l],
                values: VALUES,
                repeats: m.repeats[l] as u8,
                count: BEGINNING,
            };
            noise.update(pv[l]);
            (next.x[l], next.first[l], next.second[l], next.third[l]) =
                (noise.x, noise.first, noise.second, noise.third);
            (next.median[l], next.gain[l], next.grid[l]) = (noise.median, noise.gain, noise.grid);
            next.repeats[l] = noise.repeats.into();
            next.counted[l] = m.counted[l] + u64::from(noise.count - BEGINNING);
            stopped[l] = !ordinary & !towards[l].is_nan();
            any |= stopped[l];
        }
        k += 1;
        if any {
            m.go_on(&next, &stopped);
            break;
        }
        m = next;
    }
    side.moving = m;
    (k, stopped)
}

impl Moving {
    /// Takes the lanes that are not stopped from the next row.
    #[inline(always)]
    fn go_on(&mut self, next: &Self, stopped: &Lane<bool>) {
        macro_rules! kept {
            ($($name:ident)*) => {$(
                for (l, stopped) in stopped.iter().enumerate() {
                    self.$name[l] = if *stopped { self.$name[l] } else { next.$name[l] };
                }
            )*};
        }
        kept!(y1 y2 u1 u2 delta_t integral e_max sp_low sp_high flags x first second third median gain grid repeats counted);
    }
}
