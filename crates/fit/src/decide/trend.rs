//! How a width changes in time.

use crate::decide::combine::Reading;
use crate::decide::thresholds::{TREND_ERRORS, TREND_WIDTHS};

/// The line through the widths of the records that give one with two limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trend {
    /// Change of the width [OP unit/s].
    pub slope: f64,
    /// Its standard error [OP unit/s].
    pub error: f64,
    /// Widths that it stands on.
    pub widths: usize,
    /// Middle of the first and of the last of these records [s].
    pub t: (f64, f64),
    /// The line's width there [OP unit].
    pub d: (f64, f64),
}

impl Trend {
    /// Each width is worth the inverse square of its standard error (a quarter of the interval). Where they scatter about the line
    /// more than their intervals allow, the error of the slope is larger by as much (Birge's ratio); the scatter about their
    /// mean, which a change makes itself, does not count. The line is drawn through the plain mean of times and widths. None
    /// from fewer than three widths, or where all are of one time.
    pub(crate) fn of(readings: &[Reading]) -> Option<Self> {
        let sided: Vec<(f64, f64, f64)> =
            readings.iter().filter_map(|r| Some((r.t, r.d, r.standard_error()?))).collect();
        if sided.len() < 3 {
            return None;
        }
        let weighed = || sided.iter().map(|(t, d, s)| (*t, *d, 1.0 / (s * s)));
        let sum: f64 = weighed().map(|(_, _, i)| i).sum();
        let t = weighed().map(|(t, _, i)| t * i).sum::<f64>() / sum;
        let d = weighed().map(|(_, d, i)| d * i).sum::<f64>() / sum;
        let spread: f64 = weighed().map(|(at, _, i)| (at - t) * (at - t) * i).sum();
        if spread <= 0.0 {
            return None;
        }
        let slope = weighed().map(|(at, width, i)| (at - t) * (width - d) * i).sum::<f64>() / spread;
        let residual = |at: f64, width: f64| width - d - slope * (at - t);
        let q: f64 = weighed().map(|(at, width, i)| residual(at, width) * residual(at, width) * i).sum();
        let n = sided.len() as f64;
        let birge = (q / (n - 2.0)).max(1.0);
        let mean = |of: fn(&(f64, f64, f64)) -> f64| sided.iter().map(of).sum::<f64>() / n;
        let (middle, width) = (mean(|s| s.0), mean(|s| s.1));
        let (first, last) = (sided[0].0, sided[sided.len() - 1].0);
        let at = |t: f64| width + slope * (t - middle);
        let error = (birge / spread).sqrt();
        Some(Self { slope, error, widths: sided.len(), t: (first, last), d: (at(first), at(last)) })
    }

    /// Whether it is plain that the width changes. Then the newest width is today's: one for all of the time is the width of no
    /// day.
    pub fn changes(&self) -> bool {
        self.widths >= TREND_WIDTHS && self.slope.abs() > TREND_ERRORS * self.error
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decide::verdict::Verdict;

    fn reading(t: f64, d: f64) -> Reading {
        Reading { verdict: Verdict::Backlash, d, low: d - 0.05, high: Some(d + 0.05), lr_no_gap: 100.0, t }
    }

    #[test]
    fn a_growing_gap_shows_its_trend() {
        let error = 0.1 / 3.92;
        let grows: Vec<_> = (0..5).map(f64::from).map(|i| reading(i, 1.0 + 0.1 * i)).collect();
        let trend = Trend::of(&grows).unwrap();
        assert!((trend.slope - 0.1).abs() < 1e-9, "{trend:?}");
        // Each interval is 0.1 wide, and the line leaves nothing: the change is no scatter.
        assert!((trend.error - error / 10f64.sqrt()).abs() < 1e-9, "{trend:?}");
        assert!((trend.d.0 - 1.0).abs() < 1e-9 && (trend.d.1 - 1.4).abs() < 1e-9, "{trend:?}");
        assert_eq!((trend.widths, trend.t), (5, (0.0, 4.0)));
        assert!(trend.changes());
        assert!(!Trend::of(&grows[..4]).unwrap().changes(), "four widths are too few");
        assert_eq!(Trend::of(&grows[..2]), None);
        assert_eq!(Trend::of(&[grows[0]; 3]), None);
    }

    #[test]
    fn bounds_and_records_without_a_width_do_not_count() {
        let mut mixed: Vec<_> = (0..5).map(|i| reading(f64::from(i), 2.0)).collect();
        mixed.push(Reading { verdict: Verdict::Sound, d: 0.0, ..reading(5.0, 9.0) });
        mixed.push(Reading { high: None, ..reading(6.0, 9.0) });
        let trend = Trend::of(&mixed).unwrap();
        assert_eq!((trend.widths, trend.t.1, trend.d), (5, 4.0, (2.0, 2.0)));
        assert!(!trend.changes());
    }

    #[test]
    fn widths_that_scatter_about_their_line_make_its_slope_less_sure() {
        let error = |bumps: [f64; 5]| {
            let readings: Vec<_> = (0..5).map(|i| reading(i as f64, 1.0 + bumps[i])).collect();
            Trend::of(&readings).unwrap().error
        };
        let (calm, rough) = (error([0.0; 5]), error([0.3, -0.3, 0.0, 0.3, -0.3]));
        assert!(rough > 5.0 * calm, "{rough} {calm}");
    }
}
