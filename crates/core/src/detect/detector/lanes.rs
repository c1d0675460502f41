//! Several loops at once, one in each lane of the processor's registers: the same law, the same bits.
//!
//! A row is one sample of each loop, a tile [`ROWS`] of them. The blocks' own functions take a row as they take a sample. Where a
//! half-period ends its lane begins the next, and what ended is put aside: it is judged after the tile, alone. A loop whose signal
//! breaks takes the tile alone.

use super::{Columns, Detector, DetectorState, HalfPeriodResult, Span};
use crate::detect::half_period::{integrate, widen};
use crate::signal::{HELD, LEAST_GAIN, VALUES, sections};
use crate::status::{BAD, Status};
use crate::{LANES, Lanes, NoiseLevel};

/// Samples of each loop between turning columns into rows: what stays in the nearest cache.
const ROWS: usize = 64;

/// Bounds within which no error, sum or slope can fail to be a measurement or a number; values beyond take the tile
/// alone.
const LEAST_STEP: f64 = 1e-9;
const LARGEST: f64 = 1e29;

/// Fewest loops under way that are run in lanes; with fewer all run alone, for so many rows.
const WORTHWHILE: usize = 3;
const ALONE: usize = 4 * ROWS;

type Lane = [f64; LANES];

/// Samples by rows.
#[repr(align(64))]
struct Rows {
    t: [Lane; ROWS],
    sp: [Lane; ROWS],
    pv: [Lane; ROWS],
    op: [Lane; ROWS],
}

/// Inputs of the detectors.
#[repr(align(64))]
struct Inputs {
    tf: Lane,
    /// A step is shorter than this.
    gap: Lane,
}

/// State that a sample changes.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Moving {
    t: Lane,
    y1: Lane,
    y2: Lane,
    u1: Lane,
    u2: Lane,
    /// +1 where PV is below SP, −1 above.
    towards: Lane,
    delta_t: Lane,
    integral: Lane,
    e_max: Lane,
    sp_low: Lane,
    sp_high: Lane,
    x: Lane,
    first: Lane,
    second: Lane,
    third: Lane,
    median: Lane,
    grid: Lane,
    repeats: Lane,
}

/// Half-periods that ended at a row.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Ended {
    row: usize,
    /// 1 in the lanes that ended one.
    lanes: Lane,
    delta_t: Lane,
    integral: Lane,
    e_max: Lane,
    sp_low: Lane,
    sp_high: Lane,
    /// SP, the change of the filtered PV, the filtered OP and the noise there.
    sp: Lane,
    moved: Lane,
    h: Lane,
    op: Lane,
    median: Lane,
    grid: Lane,
}

impl Detector<f64> {
    /// Runs many loops at once, with the bits of [`Detector::run`] on each. `ended` gets the number of the loop first; the
    /// half-periods of one loop come in their order.
    ///
    /// To be inlined where the instruction set is chosen. As long as all columns are: from the end of the shortest on, and where some
    /// have OP and some have not, each loop runs alone.
    #[inline(always)]
    pub fn run_together<N: Lanes>(
        like: N,
        detectors: &[Self; LANES],
        states: &mut [DetectorState<f64>; LANES],
        columns: &[Columns<'_, f64>; LANES],
        mut ended: impl FnMut(usize, Span, &HalfPeriodResult<f64>),
    ) {
        let with_op = columns.iter().filter(|columns| columns.op.is_some()).count();
        let n = columns.iter().map(Columns::rows).min().unwrap_or(0);
        let done = match with_op {
            0 => Self::run_rows::<false, N>(like, detectors, states, columns, n, &mut ended),
            LANES => Self::run_rows::<true, N>(like, detectors, states, columns, n, &mut ended),
            _ => 0,
        };
        for l in 0..LANES {
            let rest = columns[l].part(done, columns[l].rows());
            detectors[l].run(&mut states[l], rest, |span, record| ended(l, span, record), |_, _| ());
        }
    }

    #[inline(always)]
    fn run_rows<const OP: bool, N: Lanes>(
        like: N,
        detectors: &[Self; LANES],
        states: &mut [DetectorState<f64>; LANES],
        columns: &[Columns<'_, f64>; LANES],
        n: usize,
        ended: &mut impl FnMut(usize, Span, &HalfPeriodResult<f64>),
    ) -> usize {
        let inputs = Inputs {
            tf: core::array::from_fn(|l| detectors[l].filter.tf()),
            gap: core::array::from_fn(|l| detectors[l].max_h.next_up()),
        };
        let none = [[0.0; LANES]; ROWS];
        let mut rows = Rows { t: none, sp: none, pv: none, op: none };
        let mut out = [Ended::default(); ROWS];
        let mut now = Moving::default();
        let mut inside = [false; LANES];
        let mut from = 0;
        while from + ROWS <= n {
            for l in 0..LANES {
                inside[l] = inside[l] || now.take::<OP>(l, &states[l]);
            }
            if inside.iter().filter(|inside| **inside).count() < WORTHWHILE {
                let to = n.min(from + ALONE);
                for l in 0..LANES {
                    if inside[l] {
                        now.give(l, &mut states[l]);
                        inside[l] = false;
                    }
                    let alone = columns[l].part(from, to);
                    detectors[l].run(&mut states[l], alone, |span, record| ended(l, span, record), |_, _| ());
                }
                from = to;
                continue;
            }
            let to = from + ROWS;
            rows.fill::<OP, N>(like, columns, from);
            let mut next = now;
            let (count, ordinary) = pass::<OP, N>(like, &inputs, &mut next, &rows, &mut out);
            for l in 0..LANES {
                let (detector, state, columns) = (&detectors[l], &mut states[l], columns[l].part(from, to));
                if inside[l] && !(ordinary[l] == 1.0 && detector.marks::<OP>(&columns, 0, ROWS) & BAD == 0) {
                    now.give(l, state);
                    inside[l] = false;
                }
                if !inside[l] {
                    detector.run(state, columns, |span, record| ended(l, span, record), |_, _| ());
                    continue;
                }
                let mut since = 0;
                for one in out[..count].iter().filter(|one| one.lanes[l] != 0.0) {
                    detector.count::<OP>(state, &columns, since, one.row);
                    since = one.row;
                    let (span, record) = detector.turn::<OP>(state, one, l, columns.t[one.row]);
                    ended(l, span, &record);
                }
                detector.count::<OP>(state, &columns, since, ROWS);
            }
            now = next;
            from = to;
        }
        for l in (0..LANES).filter(|l| inside[*l]) {
            now.give(l, &mut states[l]);
        }
        from
    }

    /// The flags of these rows, those that OP at its limits adds among them.
    #[inline(always)]
    fn marks<const OP: bool>(&self, columns: &Columns<'_, f64>, from: usize, to: usize) -> Status {
        let flags = columns.flags.map_or(0, |flags| flags[from..to].iter().fold(0, |all, flag| all | flag));
        match columns.op {
            Some(op) if OP && self.op_limits.is_some() => {
                op[from..to].iter().fold(flags.into(), |all, op| self.with_limits::<OP>(all, *op))
            }
            _ => flags.into(),
        }
    }

    /// Counts these rows in the half-period under way.
    #[inline(always)]
    fn count<const OP: bool>(
        &self,
        state: &mut DetectorState<f64>,
        columns: &Columns<'_, f64>,
        from: usize,
        to: usize,
    ) {
        state.signal.half.count((to - from) as u32);
        state.signal.half.mark(self.marks::<OP>(columns, from, to));
    }

    /// Judges the half-period that ended in a lane at `t`, by the law.
    #[inline(never)]
    fn turn<const OP: bool>(
        &self,
        state: &mut DetectorState<f64>,
        ended: &Ended,
        l: usize,
        t: f64,
    ) -> (Span, HalfPeriodResult<f64>) {
        let signal = &mut state.signal;
        let half = &mut signal.half;
        (half.delta_t, half.integral, half.e_max) = (ended.delta_t[l], ended.integral[l], ended.e_max[l]);
        (half.sp_low, half.sp_high) = (ended.sp_low[l], ended.sp_high[l]);
        (signal.noise.median, signal.noise.grid) = (ended.median[l], ended.grid[l]);
        let sign = signal.crossing.sign;
        signal.crossing.sign = -sign;
        let opf = if OP { ended.op[l] } else { signal.op.y2 };
        let half = signal.turn(sign, ended.sp[l], ended.moved[l] / ended.h[l], opf);
        let start = state.t.map_or(t, |(_, start)| start);
        state.t = Some((t, t));
        (Span { start, end: t }, self.judge(&mut state.memory, half, OP, &signal.noise))
    }
}

impl Moving {
    /// Takes the state of a loop, if it can go on in its lane.
    fn take<const OP: bool>(&mut self, l: usize, state: &DetectorState<f64>) -> bool {
        let Some((t, _)) = state.t else { return false };
        let signal = &state.signal;
        let (half, noise) = (&signal.half, &signal.noise);
        (self.t[l], self.towards[l]) = (t, signal.crossing.sign.into());
        (self.y1[l], self.y2[l], self.u1[l], self.u2[l]) = (signal.pv.y1, signal.pv.y2, signal.op.y1, signal.op.y2);
        (self.delta_t[l], self.integral[l], self.e_max[l]) = (half.delta_t, half.integral, half.e_max);
        (self.sp_low[l], self.sp_high[l]) = (half.sp_low, half.sp_high);
        (self.x[l], self.first[l], self.second[l], self.third[l]) = (noise.x, noise.first, noise.second, noise.third);
        (self.median[l], self.grid[l], self.repeats[l]) = (noise.median, noise.grid, noise.repeats.into());
        let whole = signal.broken == 0 && signal.pv.started && signal.op.started == OP && signal.crossing.sign != 0;
        // The number of differences and the gain no longer change.
        let settled = noise.values == VALUES && noise.count == u8::MAX && noise.gain == LEAST_GAIN;
        whole && settled && self.y1[l].abs() <= LARGEST && self.y2[l].abs() <= LARGEST
    }

    /// Gives it back.
    fn give(&self, l: usize, state: &mut DetectorState<f64>) {
        let signal = &mut state.signal;
        let (half, noise) = (&mut signal.half, &mut signal.noise);
        (signal.pv.y1, signal.pv.y2, signal.op.y1, signal.op.y2) = (self.y1[l], self.y2[l], self.u1[l], self.u2[l]);
        (half.delta_t, half.integral, half.e_max) = (self.delta_t[l], self.integral[l], self.e_max[l]);
        (half.sp_low, half.sp_high) = (self.sp_low[l], self.sp_high[l]);
        (noise.x, noise.first, noise.second, noise.third) = (self.x[l], self.first[l], self.second[l], self.third[l]);
        (noise.median, noise.grid) = (self.median[l], self.grid[l]);
        noise.repeats = self.repeats[l].min(u8::MAX.into()) as u8;
        if let Some((before, _)) = &mut state.t {
            *before = self.t[l];
        }
    }
}

impl Rows {
    /// The samples of these columns from a row on.
    #[inline(always)]
    fn fill<const OP: bool, N: Lanes>(&mut self, like: N, columns: &[Columns<'_, f64>; LANES], from: usize) {
        fill(like, &mut self.t, |l| columns[l].t, from);
        fill(like, &mut self.sp, |l| columns[l].sp, from);
        fill(like, &mut self.pv, |l| columns[l].pv, from);
        if OP {
            fill(like, &mut self.op, |l| columns[l].op.unwrap_or_default(), from);
        }
    }
}

#[inline(always)]
fn fill<'a, N: Lanes>(like: N, rows: &mut [Lane; ROWS], column: impl Fn(usize) -> &'a [f64], from: usize) {
    let mut columns = [&[][..]; LANES];
    for (l, rows) in columns.iter_mut().enumerate() {
        *rows = column(l)[from..from + ROWS].as_chunks::<LANES>().0;
    }
    for (k, rows) in rows.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut square = [like; LANES];
        for l in 0..LANES {
            square[l] = like.load(&columns[l][k]);
        }
        let turned = N::turned(square);
        for l in 0..LANES {
            rows[l] = turned[l].numbers();
        }
    }
}

/// Passes over a tile of rows. Gives the number of rows at which half-periods ended, and 1 in each lane whose signal went on.
/// A lane stops at conditions that [`Detector::advance`] would accept as well, except for flags.
#[inline(always)]
fn pass<const OP: bool, N: Lanes>(
    like: N,
    inputs: &Inputs,
    m: &mut Moving,
    rows: &Rows,
    out: &mut [Ended; ROWS],
) -> (usize, Lane) {
    let (none, one, held) = (like.like(0.0), like.like(1.0), like.like((HELD - 1).into()));
    let (least, tf, gap) = (like.like(LEAST_STEP), like.load(&inputs.tf), like.load(&inputs.gap));
    let (mut t, mut towards) = (like.load(&m.t), like.load(&m.towards));
    let (mut y1, mut y2) = (like.load(&m.y1), like.load(&m.y2));
    let (mut u1, mut u2) = (like.load(&m.u1), like.load(&m.u2));
    let (mut delta_t, mut integral, mut e_max) = (like.load(&m.delta_t), like.load(&m.integral), like.load(&m.e_max));
    let (mut sp_low, mut sp_high) = (like.load(&m.sp_low), like.load(&m.sp_high));
    let mut noise = NoiseLevel {
        x: like.load(&m.x),
        first: like.load(&m.first),
        second: like.load(&m.second),
        third: like.load(&m.third),
        median: like.load(&m.median),
        gain: like.like(LEAST_GAIN),
        grid: like.load(&m.grid),
        values: VALUES,
        repeats: 0,
        count: u8::MAX,
    };
    let mut repeats = like.load(&m.repeats);
    let (mut in_time, mut size) = (none.below(one), none);
    let mut count = 0;
    for k in 0..ROWS {
        let (now, sp, pv) = (like.load(&rows.t[k]), like.load(&rows.sp[k]), like.load(&rows.pv[k]));
        let h = now - t;
        t = now;
        in_time = in_time & least.below(h) & h.below(gap);
        size = size + (sp.magnitude() + pv.magnitude());
        let before = y2;
        sections(tf, &mut y1, &mut y2, pv, h);
        if OP {
            let op = like.load(&rows.op[k]);
            size = size + op.magnitude();
            sections(tf, &mut u1, &mut u2, op, h);
        }

        let mut next = noise;
        let fourth = next.differ(pv);
        next.weigh(fourth);
        let moved = none.below(next.first.magnitude());
        repeats = N::either(moved, none, repeats + one);
        let rests = held.below(repeats);
        macro_rules! kept {
            ($($name:ident)*) => {$(noise.$name = N::either(rests, noise.$name, next.$name);)*};
        }
        kept!(x first second third median grid);

        let e = sp - y2;
        let crossed = (e * towards).below(none);
        if N::any(crossed) {
            out[count] = Ended {
                row: k,
                lanes: N::either(crossed, one, none).numbers(),
                delta_t: delta_t.numbers(),
                integral: integral.numbers(),
                e_max: e_max.numbers(),
                sp_low: sp_low.numbers(),
                sp_high: sp_high.numbers(),
                sp: sp.numbers(),
                moved: (y2 - before).numbers(),
                h: h.numbers(),
                op: u2.numbers(),
                median: noise.median.numbers(),
                grid: noise.grid.numbers(),
            };
            count += 1;
            towards = N::either(crossed, none - towards, towards);
            delta_t = N::either(crossed, none, delta_t);
            integral = N::either(crossed, none, integral);
            e_max = N::either(crossed, none, e_max);
            sp_low = N::either(crossed, sp, sp_low);
            sp_high = N::either(crossed, sp, sp_high);
        }
        integrate(&mut delta_t, &mut integral, &mut e_max, e.magnitude(), h);
        widen(&mut sp_low, &mut sp_high, sp);
    }
    (m.t, m.towards) = (t.numbers(), towards.numbers());
    (m.y1, m.y2, m.u1, m.u2) = (y1.numbers(), y2.numbers(), u1.numbers(), u2.numbers());
    (m.delta_t, m.integral, m.e_max) = (delta_t.numbers(), integral.numbers(), e_max.numbers());
    (m.sp_low, m.sp_high) = (sp_low.numbers(), sp_high.numbers());
    (m.x, m.first, m.second) = (noise.x.numbers(), noise.first.numbers(), noise.second.numbers());
    (m.third, m.median, m.grid) = (noise.third.numbers(), noise.median.numbers(), noise.grid.numbers());
    m.repeats = repeats.numbers();
    let bounded = size.below(like.like(LARGEST));
    (count, N::either(in_time & bounded, one, none).numbers())
}
