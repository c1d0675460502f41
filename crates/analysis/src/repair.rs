//! Before and after a repair of the valve: whether the width has fallen, and the loop's gain in performance.
//!
//! The difference of two numbers with 95 % limits has, by Zou & Donner (Statistics in Medicine 27, 2008), the limits
//! d − √((a − a_low)² + (b_high − b)²) and d + √((a_high − a)² + (b − b_low)²), with d = a − b: the numbers are of different days
//! and count as independent.

use crate::performance::{Between, Performance, performance};
use crate::{FitVerdict, Inspected};
use glapp_fit::Width;
use serde::{Deserialize, Serialize};

/// OP has turned where it went back by so much of the width before, …
const TURN: f64 = 0.1;
/// … or where that is not known of OP's range.
const TURN_OF_RANGE: f64 = 0.001;

/// A fall of the width is told where it is so many standard errors, on either way of looking: of all widths before it and after it, …
const FALLS: f64 = 4.0;
/// … and of the two next to it; else it is a slow change.
const AT_ONCE: f64 = 3.0;
/// Part of the width before that must be left at most.
const LEFT: f64 = 0.7;
/// Standard errors to a 95 % limit.
const LIMIT: f64 = 1.96;
/// A standard error is at least this [OP unit]: limits that are one number have none.
const LEAST_ERROR: f64 = 1e-9;

/// Width by one recording, or one window of it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct OneWidth {
    /// Time of the recording \[s\].
    pub t: f64,
    /// Verdict.
    pub verdict: FitVerdict,
    /// Width [OP unit].
    pub d: Option<f64>,
    /// Lower 95 % limit.
    pub low: Option<f64>,
    /// Upper 95 % limit.
    pub high: Option<f64>,
}

impl OneWidth {
    /// The width with its 95 % limits: 0 up to the upper one of a sound valve, none where there are no two limits.
    fn between(&self) -> Option<Between> {
        match self.verdict {
            FitVerdict::Backlash | FitVerdict::Both | FitVerdict::Stiction => Some((self.d?, self.low?, self.high?)),
            FitVerdict::Sound => Some((0.0, 0.0, self.high?)),
            _ => None,
        }
    }

    /// The width with its standard error; none of a valve that only sticks, whose width is another thing than a gap's.
    fn width(&self) -> Option<Width> {
        let (d, ..) = self.between().filter(|_| self.verdict != FitVerdict::Stiction)?;
        let (low, high) = (self.low?, self.high?);
        Some(Width { t: self.t, d, error: Some(((high - low) / (2.0 * LIMIT)).max(LEAST_ERROR)) })
    }
}

/// A width that has fallen from one time to the next, as after a repair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fall {
    /// The last width before and the first after \[s\].
    pub t: (f64, f64),
    /// Mean width before, with its 95 % limits [OP unit].
    pub before: Between,
    /// Value after.
    pub after: Between,
}

/// Whether the width has fallen from one recording, or window, to the next; those that give no width with two limits do not count.
///
/// ```
/// use glapp_analysis::{FitVerdict, OneWidth, fall_of};
/// let one = |t, d| OneWidth { t, verdict: FitVerdict::Backlash, d: Some(d), low: Some(d - 0.2), high: Some(d + 0.2) };
/// let found = fall_of(&[one(0.0, 2.0), one(1.0, 2.1), one(2.0, 0.4), one(3.0, 0.3)]).unwrap();
/// assert_eq!(found.t, (1.0, 2.0));
/// assert!((found.before.0 - 2.05).abs() < 1e-12 && (found.after.0 - 0.35).abs() < 1e-12);
/// ```
pub fn fall_of(each: &[OneWidth]) -> Option<Fall> {
    let mut widths: Vec<Width> = each.iter().filter_map(OneWidth::width).collect();
    widths.sort_by(|a, b| a.t.total_cmp(&b.t));
    fall(&widths)
}

/// The plainest of all falls between widths in the order of time.
fn fall(widths: &[Width]) -> Option<Fall> {
    let known: Vec<(f64, f64, f64)> =
        widths.iter().filter_map(|width| Some((width.t, width.d, width.error.filter(|e| *e > 0.0)?))).collect();
    let mean = |part: &[(f64, f64, f64)]| {
        let weight: f64 = part.iter().map(|(.., error)| error.powi(-2)).sum();
        let d = part.iter().map(|(_, d, error)| d * error.powi(-2)).sum::<f64>() / weight;
        (d, weight.sqrt().recip())
    };
    let plainest = (1..known.len()).filter_map(|k| {
        let ((before, e0), (after, e1)) = (mean(&known[..k]), mean(&known[k..]));
        let ((t0, d0, s0), (t1, d1, s1)) = (known[k - 1], known[k]);
        let sure = (before - after) / e0.hypot(e1);
        let plain = sure > FALLS && after < LEFT * before && d0 - d1 > AT_ONCE * s0.hypot(s1);
        let limits = |d: f64, error: f64| (d, (d - LIMIT * error).max(0.0), d + LIMIT * error);
        plain.then_some((sure, Fall { t: (t0, t1), before: limits(before, e0), after: limits(after, e1) }))
    });
    plainest.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, fall)| fall)
}

/// Change of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Changed {
    /// All of the interval of the difference lies below 0.
    Less,
    /// All of it lies above 0.
    More,
    /// The interval of the change holds 0.
    Open,
}

/// The difference after − before, with its 95 % limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Kind of change.
    pub code: Changed,
    /// The difference and its limits, in the unit of the numbers.
    pub by: Between,
}

/// Difference of two numbers with 95 % limits.
fn difference(before: Between, after: Between) -> Difference {
    let ((b, b_low, b_high), (a, a_low, a_high)) = (before, after);
    let d = a - b;
    let by = (d, d - (a - a_low).hypot(b_high - b), d + (a_high - a).hypot(b - b_low));
    let code = if by.2 < 0.0 {
        Changed::Less
    } else if by.1 > 0.0 {
        Changed::More
    } else {
        Changed::Open
    };
    Difference { code, by }
}

/// A loop before and after a repair, and the differences; none where a value is not known on both sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BeforeAfter {
    /// Performance before; none where too few rows are in automatic.
    pub before: Option<Performance>,
    /// Performance after; none where too few rows are in automatic.
    pub after: Option<Performance>,
    /// Difference of the widths [OP unit].
    pub width: Option<Difference>,
    /// Difference of the standard deviations of PV about SP [PV unit].
    pub deviation: Option<Difference>,
    /// Difference of OP's travels in a day [OP unit].
    pub travel: Option<Difference>,
    /// Difference of OP's reversals in a day.
    pub reversals: Option<Difference>,
}

/// Comparison of a loop before and after a repair, by rows and widths of either side. What a turn of OP is must be the
/// same on both: a tenth of the width before, or a thousandth of OP's range where that is not known.
pub fn before_after(
    rows: (Option<&Inspected<'_>>, Option<&Inspected<'_>>),
    widths: (Option<OneWidth>, Option<OneWidth>),
) -> BeforeAfter {
    let sides = [rows.0, rows.1];
    let widths = (widths.0.and_then(|one| one.between()), widths.1.and_then(|one| one.between()));
    let turn = widths.0.map(|(d, ..)| TURN * d).filter(|turn| *turn > 0.0).unwrap_or_else(|| {
        let range = |rows: &Inspected<'_>| {
            let finite = rows.op.into_iter().flatten().filter(|op| op.is_finite());
            let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
            (high - low).max(0.0)
        };
        TURN_OF_RANGE * sides.into_iter().flatten().map(range).fold(0.0, f64::max)
    });
    let [before, after] = sides.map(|rows| rows.and_then(|rows| performance(rows, turn)));
    let of = |value: fn(&Performance) -> Option<Between>| {
        Some(difference(value(before.as_ref()?)?, value(after.as_ref()?)?))
    };
    BeforeAfter {
        before,
        after,
        width: widths.0.zip(widths.1).map(|(before, after)| difference(before, after)),
        deviation: of(|side| Some(side.deviation)),
        travel: of(|side| side.travel),
        reversals: of(|side| side.reversals),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: f64 = 86_400.0;

    #[test]
    fn a_fall_is_told_with_the_days_and_the_widths_around_it() {
        let of = |d: &[f64], error| {
            let width = |(i, d): (usize, &f64)| Width { t: DAY * i as f64, d: *d, error };
            fall(&d.iter().enumerate().map(width).collect::<Vec<_>>())
        };
        let repaired = of(&[2.0, 2.1, 1.9, 0.3, 0.2], Some(0.1)).unwrap();
        assert_eq!(repaired.t, (2.0 * DAY, 3.0 * DAY));
        assert!((repaired.before.0 - 2.0).abs() < 1e-9 && (repaired.after.0 - 0.25).abs() < 1e-9);
        assert!(repaired.after.2 < repaired.before.1);
        assert!(of(&[2.0, 0.3], Some(0.1)).is_some(), "two days are enough where both are sure");
        assert_eq!(of(&[2.0, 0.3], Some(0.5)), None);
        assert_eq!(of(&[2.0, 0.3], None), None, "nobody knows how sure these are");
        assert_eq!(of(&[2.0, 2.1, 1.6, 1.7], Some(0.05)), None, "too little to be a repair");
        let slow: Vec<f64> = (0..20).map(|i| 2.0 - 0.1 * f64::from(i)).collect();
        assert_eq!(of(&slow, Some(0.05)), None, "it wears in slowly");
        assert_eq!(of(&[0.3, 2.0], Some(0.1)), None);
    }

    #[test]
    fn what_gives_no_width_with_two_limits_does_not_count_and_a_sound_valve_has_none() {
        let one = |t: f64, verdict, d: f64, high| OneWidth { t, verdict, d: Some(d), low: Some(d - 0.2), high };
        let gap = |t, d: f64| one(t, FitVerdict::Backlash, d, Some(d + 0.2));
        let sound = one(3.0, FitVerdict::Sound, 0.15, Some(0.5));
        let found = fall_of(&[sound, gap(1.0, 2.0), gap(2.0, 2.0)]).unwrap();
        assert_eq!((found.t, found.after.0), ((2.0, 3.0), 0.0), "in the order of time");
        assert_eq!(fall_of(&[gap(1.0, 2.0), gap(2.0, 2.0), one(3.0, FitVerdict::AtLeast, 0.1, Some(0.3))]), None);
        assert_eq!(fall_of(&[gap(1.0, 2.0), one(3.0, FitVerdict::Backlash, 0.1, None)]), None);
        let exact = OneWidth { low: Some(0.1), high: Some(0.1), ..one(3.0, FitVerdict::Both, 0.1, None) };
        assert!(fall_of(&[gap(1.0, 2.0), exact]).is_some());
        assert_eq!(fall_of(&[]), None);
    }

    #[test]
    fn the_interval_of_a_difference_is_that_of_zou_and_donner() {
        let found = difference((5.0, 4.0, 8.0), (2.0, 1.0, 6.0));
        // 2 − 5 = −3; below it √(1² + 3²), above it √(4² + 1²).
        assert!((found.by.1 + 3.0 + 10f64.sqrt()).abs() < 1e-12 && (found.by.2 + 3.0 - 17f64.sqrt()).abs() < 1e-12);
        assert_eq!(found.code, Changed::Open);
        assert_eq!(difference((5.0, 4.9, 5.1), (2.0, 1.9, 2.1)).code, Changed::Less);
        assert_eq!(difference((2.0, 1.9, 2.1), (5.0, 4.9, 5.1)).code, Changed::More);
    }

    #[test]
    fn a_turn_of_op_is_the_same_before_and_after() {
        // OP swings by 2 before and by 0.3 after, in each case 64 times in 6400 s.
        let t: Vec<f64> = (0..6400).map(f64::from).collect();
        let op = |size: f64| -> Vec<f64> { t.iter().map(|t| size * (t / 100.0 % 1.0 - 0.5).abs() * 2.0).collect() };
        let (wide, narrow, pv) = (op(2.0), op(0.3), vec![1.0; 6400]);
        let side = |op| Inspected { t: &t, sp: None, pv: &pv, op: Some(op), flags: None };
        let (before, after) = (side(&wide), side(&narrow));
        let gap =
            |d| OneWidth { t: 0.0, verdict: FitVerdict::Backlash, d: Some(d), low: Some(d - 0.1), high: Some(d + 0.1) };
        let of = |widths| before_after((Some(&before), Some(&after)), widths);
        let by_range = of((None, None));
        assert_eq!((by_range.width, by_range.reversals.unwrap().code), (None, Changed::Open));
        let by_width = of((Some(gap(4.0)), Some(gap(0.2))));
        assert_eq!(by_width.after.unwrap().reversals.unwrap().0, 0.0, "0.3 is less than a tenth of 4");
        assert_eq!(by_width.width.unwrap().code, Changed::Less);
        assert_eq!(by_width.reversals.unwrap().code, Changed::Less);
        let sound = OneWidth { verdict: FitVerdict::Sound, d: Some(0.1), high: Some(0.4), ..gap(0.1) };
        let by = of((Some(gap(4.0)), Some(sound))).width.unwrap().by;
        assert!((by.0 + 4.0).abs() < 1e-12 && (by.2 + 4.0 - 0.4f64.hypot(0.1)).abs() < 1e-12, "{by:?}");
        let silent = OneWidth { verdict: FitVerdict::CannotTell, ..gap(0.1) };
        assert_eq!(of((Some(gap(4.0)), Some(silent))).width, None);
        let alone = before_after((Some(&before), None), (None, None));
        assert!(alone.before.is_some() && alone.after.is_none() && alone.travel.is_none());
    }
}
