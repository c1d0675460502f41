//! A segment of a recording at even steps, and its cut into windows.

use crate::decide::thresholds::LED;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// One unbroken stretch at even steps; NaN in PV is a sample that is missing, OP is without NaN.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Stretch<'a> {
    /// Start time [s].
    pub start: f64,
    /// Setpoint, as many as of `pv` or, where it was not recorded, none [PV unit].
    pub sp: Cow<'a, [f64]>,
    /// [PV unit]
    pub pv: Cow<'a, [f64]>,
    /// OP, one value for each of `pv` [OP unit].
    pub op: Cow<'a, [f64]>,
}

/// One recording, one window of a longer one, or one of several recordings of a valve.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Segment<'a> {
    /// Time between two steps [s].
    pub h: f64,
    /// Stretches in the order of time.
    pub stretches: Vec<Stretch<'a>>,
}

/// PV and OP of a stretch.
pub(crate) type OpAndPv<'a> = (&'a [f64], &'a [f64]);

impl Segment<'_> {
    /// PV and OP of each stretch.
    pub(crate) fn signals(&self) -> Vec<OpAndPv<'_>> {
        self.stretches.iter().map(|s| (&*s.pv, &*s.op)).collect()
    }

    pub(crate) fn steps(&self) -> usize {
        self.stretches.iter().map(|s| s.pv.len()).sum()
    }

    /// Whether the setpoint moves PV, and not a load alone.
    pub(crate) fn is_led(&self) -> bool {
        let sp = self.stretches.iter().flat_map(|s| s.sp.iter().copied());
        let pv = self.stretches.iter().flat_map(|s| s.pv.iter().copied());
        spread(sp) > LED * spread(pv)
    }

    /// Times of the first row and the last step [s].
    pub(crate) fn span(&self) -> (f64, f64) {
        let (first, last) = (&self.stretches[0], &self.stretches[self.stretches.len() - 1]);
        (first.start, last.start + self.h * (last.pv.len() - 1) as f64)
    }

    /// Start times of the stretches [s].
    pub(crate) fn starts(&self) -> Vec<f64> {
        self.stretches.iter().map(|s| s.start).collect()
    }

    /// The record with its signals lent.
    fn borrowed(&self) -> Segment<'_> {
        let stretches = self.stretches.iter();
        let of = stretches.map(|s| Stretch {
            start: s.start,
            sp: Cow::Borrowed(&*s.sp),
            pv: Cow::Borrowed(&*s.pv),
            op: Cow::Borrowed(&*s.op),
        });
        Segment { h: self.h, stretches: of.collect() }
    }

    /// The record with signals of its own.
    pub(crate) fn owned(self) -> Segment<'static> {
        let of = |s: Stretch| Stretch {
            start: s.start,
            sp: s.sp.into_owned().into(),
            pv: s.pv.into_owned().into(),
            op: s.op.into_owned().into(),
        };
        Segment { h: self.h, stretches: self.stretches.into_iter().map(of).collect() }
    }

    /// Windows of at most so many steps, or the whole of it where it is little longer; of many windows one of each epoch, that in
    /// which OP turns most.
    pub(crate) fn windows(&self, most: usize) -> Vec<Segment<'_>> {
        let all = self.steps();
        if all as f64 <= UNCUT * most as f64 {
            return vec![self.borrowed()];
        }
        let size = all.div_ceil(all.div_ceil(most));
        let pieces = self.stretches.iter().flat_map(|stretch| {
            stretch.pv.chunks(size).zip(stretch.op.chunks(size)).enumerate().map(move |(i, (pv, op))| Stretch {
                start: stretch.start + self.h * (i * size) as f64,
                sp: Cow::Borrowed(stretch.sp.chunks(size).nth(i).unwrap_or_default()),
                pv: Cow::Borrowed(pv),
                op: Cow::Borrowed(op),
            })
        });
        let mut windows: Vec<Segment> = Vec::new();
        for piece in pieces {
            match windows.last_mut() {
                Some(window) if window.steps() + piece.pv.len() <= size => window.stretches.push(piece),
                _ => windows.push(Segment { h: self.h, stretches: vec![piece] }),
            }
        }
        windows.retain(|window| 3 * window.steps() >= size);
        let count = windows.len();
        if count <= MOST_WINDOWS {
            return windows;
        }
        let turned = |window: &Segment| window.stretches.iter().map(|s| turns(&s.op)).sum::<f64>();
        let epoch = |e: usize| &windows[e * count / MOST_WINDOWS..(e + 1) * count / MOST_WINDOWS];
        let best = |e: usize| epoch(e).iter().max_by(|a, b| turned(a).total_cmp(&turned(b))).cloned();
        (0..MOST_WINDOWS).filter_map(best).collect()
    }
}

/// Standard deviation of the values that are numbers, 0 of none.
pub(crate) fn spread(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let values = values.filter(|x| x.is_finite());
    let n = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|x| (x - mean) * (x - mean)).sum::<f64>() / n).sqrt()
}

/// Length up to which a record is still fitted as one, in lengths of a window.
const UNCUT: f64 = 1.5;
/// Windows of one record that are fitted.
const MOST_WINDOWS: usize = 6;
/// Steps in which a window's OP is looked at for how far it turns.
pub(crate) const COARSE_STEPS: usize = 60;

/// Total travel of OP up and down, counted in steps that are large for it [OP unit].
pub(crate) fn turns(op: &[f64]) -> f64 {
    travel(op.iter().copied(), op.len().div_ceil(COARSE_STEPS).max(1))
}

/// Total travel of a signal up and down, sampled once in `every` samples.
pub(crate) fn travel(signal: impl Iterator<Item = f64>, every: usize) -> f64 {
    let mut last = f64::NAN;
    let moves = signal.step_by(every).filter_map(|x| {
        let before = std::mem::replace(&mut last, x);
        (!before.is_nan()).then(|| (x - before).abs())
    });
    moves.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An OP that rests but for one turn in each window of `of` steps, larger in some.
    fn record(windows: usize, of: usize) -> Segment<'static> {
        let turn = |k: usize| if k % of < of / 2 { 1.0 + (k / of * 7 % 5) as f64 } else { 0.0 };
        let op: Vec<f64> = (0..windows * of).map(turn).collect();
        Segment {
            h: 2.0,
            stretches: vec![Stretch { start: 10.0, sp: [].as_slice().into(), pv: op.clone().into(), op: op.into() }],
        }
    }

    #[test]
    fn a_record_little_longer_than_a_window_is_one() {
        let whole = record(3, 100);
        assert_eq!(whole.windows(200).len(), 1);
        assert_eq!(whole.windows(199).len(), 2);
    }

    #[test]
    fn of_many_windows_the_one_in_which_op_turns_most_is_kept_of_each_epoch() {
        let whole = record(24, 100);
        let windows = whole.windows(100);
        assert_eq!(windows.len(), MOST_WINDOWS);
        for (epoch, window) in windows.iter().enumerate() {
            let place = ((window.span().0 - 10.0) / 200.0) as usize;
            assert!((4 * epoch..4 * epoch + 4).contains(&place), "{epoch}: {place}");
            let most = (4 * epoch..4 * epoch + 4).map(|k| k * 7 % 5).max();
            assert_eq!(Some(place * 7 % 5), most);
        }
    }

    #[test]
    fn the_setpoint_leads_where_it_moves_as_pv_does() {
        let wave = |size: f64| (0..100).map(|k| size * (0.3 * f64::from(k)).sin()).collect::<Vec<_>>();
        let led = |sp: Vec<f64>| {
            let stretch = Stretch { start: 0.0, sp: sp.into(), pv: wave(1.0).into(), op: wave(2.0).into() };
            Segment { h: 1.0, stretches: vec![stretch] }.is_led()
        };
        assert!(led(wave(0.3)) && !led(wave(0.2)));
        assert!(!led(Vec::new()) && !led(vec![50.0; 100]) && !led(vec![f64::NAN; 100]));
    }

    #[test]
    fn windows_hold_short_stretches_together_and_say_when_they_are() {
        let piece = |start: f64| Stretch {
            start,
            sp: [].as_slice().into(),
            pv: vec![0.0; 40].into(),
            op: vec![0.0; 40].into(),
        };
        let whole = Segment { h: 1.0, stretches: (0..4).map(|i| piece(1000.0 * f64::from(i))).collect() };
        let windows = whole.windows(80);
        let spans: Vec<(f64, f64)> = windows.iter().map(Segment::span).collect();
        assert_eq!(spans, [(0.0, 1039.0), (2000.0, 3039.0)]);
    }
}
