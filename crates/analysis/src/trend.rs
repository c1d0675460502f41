//! Trend of a width from day to day, the one for every interface. The rule is [`glapp_fit::Trend`]'s, which the fit
//! itself goes by.

use glapp_fit::{Trend, Width};
use serde::{Deserialize, Serialize};

/// \[s\].
pub(crate) const DAY: f64 = 86_400.0;

/// Kind of a trend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// The width grows.
    Grows,
    /// The width shrinks.
    Shrinks,
    /// No change is plain.
    Steady,
    /// Too few widths, or all of one time.
    TooFew,
}

/// The change of a width, with the numbers that decide it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WidthTrend {
    /// Kind of trend.
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
}
