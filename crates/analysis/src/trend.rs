//! How a width changes from day to day, as every face shows it. The rule is [`glapp_fit::Trend`]'s, which the fit itself goes by.

use glapp_fit::{Trend, Width};
use serde::{Deserialize, Serialize};

/// \[s\].
pub(crate) const DAY: f64 = 86_400.0;

/// What widths over time say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// It is plain that the width grows.
    Grows,
    /// It is plain that it shrinks.
    Shrinks,
    /// No change is plain.
    Steady,
    /// There are too few widths, or all are of one time.
    TooFew,
}

/// The change of a width, with the numbers that decide it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WidthTrend {
    /// What it says.
    pub code: Change,
    /// Widths that it rests on.
    pub widths: usize,
    /// Widths that a change must rest on.
    pub widths_needed: usize,
    /// Change of the width [OP unit/day]; none, as all that follows, of fewer than three widths or where all are of one time.
    pub per_day: Option<f64>,
    /// Lower limit of its 95 % interval [OP unit/day].
    pub low: Option<f64>,
    /// Upper limit [OP unit/day].
    pub high: Option<f64>,
    /// A change so fast would be plain [OP unit/day].
    pub least_plain: Option<f64>,
    /// First and last of the widths \[s\].
    pub t: Option<(f64, f64)>,
    /// The line's width there [OP unit].
    pub d: Option<(f64, f64)>,
}

/// The trend of widths in the order of time.
pub fn trend(widths: &[Width]) -> WidthTrend {
    of_found(Trend::of(widths), widths.len())
}

/// The trend by a line that was fitted already, through so many widths.
pub(crate) fn of_found(found: Option<Trend>, widths: usize) -> WidthTrend {
    let code = match found {
        Some(found) if found.changes() => {
            if found.slope > 0.0 {
                Change::Grows
            } else {
                Change::Shrinks
            }
        }
        Some(_) if widths >= Trend::FEWEST => Change::Steady,
        _ => Change::TooFew,
    };
    let daily = |value: fn(&Trend) -> f64| found.as_ref().map(|found| DAY * value(found));
    WidthTrend {
        code,
        widths,
        widths_needed: Trend::FEWEST,
        per_day: daily(|found| found.slope),
        low: daily(|found| found.slope - found.half_interval()),
        high: daily(|found| found.slope + found.half_interval()),
        least_plain: daily(Trend::least),
        t: found.map(|found| found.t),
        d: found.map(|found| found.d),
    }
}

/// A fall of the width is told where it is so many standard errors, on either way of looking: of all widths before it and after it, …
const FALLS: f64 = 4.0;
/// … and of the two next to it; else it is a slow change.
const AT_ONCE: f64 = 3.0;
/// Part of the width before that must be left at most.
const LEFT: f64 = 0.7;
/// Standard errors to a 95 % limit.
const LIMIT: f64 = 1.96;

/// A width that has fallen from one time to the next, as after a repair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fall {
    /// The last width before and the first after \[s\].
    pub t: (f64, f64),
    /// Mean width before, with its 95 % limits [OP unit].
    pub before: (f64, f64, f64),
    /// The same after.
    pub after: (f64, f64, f64),
}

/// Whether the width has fallen between two times: the plainest of all falls. Widths in the order of time; those without a standard
/// error do not count.
pub fn fall(widths: &[Width]) -> Option<Fall> {
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
        let is_fall = sure > FALLS && after < LEFT * before && d0 - d1 > AT_ONCE * s0.hypot(s1);
        let limits = |d: f64, error: f64| (d, (d - LIMIT * error).max(0.0), d + LIMIT * error);
        is_fall.then_some((sure, Fall { t: (t0, t1), before: limits(before, e0), after: limits(after, e1) }))
    });
    plainest.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, fall)| fall)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn days(n: usize, a_day: f64, error: Option<f64>) -> Vec<Width> {
        (0..n).map(|i| Width { t: DAY * i as f64, d: 2.0 + a_day * i as f64, error }).collect()
    }

    #[test]
    fn a_change_has_its_code_and_its_numbers_a_day() {
        let grows = trend(&days(10, 0.1, Some(0.05)));
        assert_eq!((grows.code, grows.widths, grows.widths_needed), (Change::Grows, 10, 5));
        let close = |x: Option<f64>, to: f64| (x.unwrap() / to - 1.0).abs() < 1e-9;
        let error = 0.05 / 82.5f64.sqrt();
        assert!(
            close(grows.per_day, 0.1) && close(grows.low, 0.1 - 1.96 * error) && close(grows.least_plain, 3.0 * error)
        );
        assert_eq!(grows.t, Some((0.0, 9.0 * DAY)));
        assert_eq!(trend(&days(10, -0.1, Some(0.05))).code, Change::Shrinks);
        assert_eq!(trend(&days(10, 0.01, Some(0.05))).code, Change::Steady);
        assert_eq!(trend(&days(4, 1.0, Some(0.05))).code, Change::TooFew);
        assert_eq!(trend(&[Width { t: 0.0, d: 1.0, error: None }; 9]).code, Change::TooFew);
        assert_eq!(trend(&[]).per_day, None);
    }

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
}
