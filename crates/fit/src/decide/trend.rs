//! Trend of a width in time, and whether it is plain. Nothing else in glapp decides that.

use crate::decide::combine::Reading;
use crate::decide::thresholds::{TREND_ERRORS, TREND_WIDTHS};

/// Standard errors of a 95 % interval.
const INTERVAL: f64 = 1.96;

/// A width at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Width {
    /// Time \[s\].
    pub t: f64,
    /// Total width [OP unit].
    pub d: f64,
    /// Standard error of the width [OP unit], where it is known: a quarter of a 95 % interval.
    pub error: Option<f64>,
}

/// The line through widths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trend {
    /// Change of the width [OP unit/s].
    pub slope: f64,
    /// Standard error of the slope [OP unit/s].
    pub error: f64,
    /// Widths that it stands on.
    pub widths: usize,
    /// Time of the first and of the last of them [s].
    pub t: (f64, f64),
    /// The line's width there [OP unit].
    pub d: (f64, f64),
    /// Degrees of freedom of the error where it is that of the scatter alone; infinite where standard errors are known.
    pub freedom: f64,
}

impl Trend {
    /// Fewest widths that a change must rest on.
    pub const FEWEST: usize = TREND_WIDTHS;

    /// Each width is worth the inverse square of its standard error. Where they scatter about the line more than these allow,
    /// the error of the slope is larger by as much (Birge's ratio); the scatter about their mean, which a change makes
    /// itself, does not count. Where one has no standard error above 0 all are worth the same, and the scatter alone gives the error.
    /// The line is drawn through the plain mean of times and widths. None from fewer than three widths, or where all are of
    /// one time.
    pub fn of(widths: &[Width]) -> Option<Self> {
        if widths.len() < 3 {
            return None;
        }
        let known = widths.iter().all(|w| w.error.is_some_and(|error| error > 0.0));
        let worth = |w: &Width| w.error.filter(|_| known).map_or(1.0, |s| 1.0 / (s * s));
        let weighed = || widths.iter().map(|w| (w.t, w.d, worth(w)));
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
        let n = widths.len() as f64;
        let scatter = q / (n - 2.0);
        let (birge, freedom) = if known { (scatter.max(1.0), f64::INFINITY) } else { (scatter, n - 2.0) };
        let mean = |of: fn(&Width) -> f64| widths.iter().map(of).sum::<f64>() / n;
        let (middle, width) = (mean(|w| w.t), mean(|w| w.d));
        let (first, last) = (widths[0].t, widths[widths.len() - 1].t);
        let at = |t: f64| width + slope * (t - middle);
        let (t, d) = ((first, last), (at(first), at(last)));
        Some(Self { slope, error: (birge / spread).sqrt(), widths: widths.len(), t, d, freedom })
    }

    /// Trend through the readings that give a width with two limits.
    pub(crate) fn of_readings(readings: &[Reading]) -> Option<Self> {
        let sided = |r: &Reading| r.standard_error().map(|error| Width { t: r.t, d: r.d, error: Some(error) });
        Self::of(&readings.iter().filter_map(sided).collect::<Vec<_>>())
    }

    /// Whether it is plain that the width changes. Then the newest width is today's: one for all of the time is the width of no
    /// day.
    pub fn changes(&self) -> bool {
        self.widths >= Self::FEWEST && self.slope.abs() > self.least()
    }

    /// A change so fast would be plain [OP unit/s], where there are [`Trend::FEWEST`] widths.
    pub fn least(&self) -> f64 {
        self.errors(TREND_ERRORS) * self.error
    }

    /// Half of the slope's 95 % interval [OP unit/s].
    pub fn half_interval(&self) -> f64 {
        self.errors(INTERVAL) * self.error
    }

    /// Number of standard errors of this distribution for a number of a normal one: Student's distribution by Wallace's
    /// approximation, to 7 % of 3 with three degrees of freedom, 2 % with five, always the larger.
    fn errors(&self, normal: f64) -> f64 {
        if self.freedom.is_infinite() {
            return normal;
        }
        let n = self.freedom;
        let z = normal * (8.0 * n + 3.0) / (8.0 * n + 1.0);
        (n * (z * z / n).exp_m1()).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decide::judgement::Verdict;

    fn reading(t: f64, d: f64) -> Reading {
        Reading { verdict: Verdict::Backlash, d, low: d - 0.05, high: Some(d + 0.05), lr_no_gap: 100.0, t }
    }

    #[test]
    fn a_growing_gap_shows_its_trend() {
        let error = 0.1 / 3.92;
        let grows: Vec<_> = (0..5).map(f64::from).map(|i| reading(i, 1.0 + 0.1 * i)).collect();
        let trend = Trend::of_readings(&grows).unwrap();
        assert!((trend.slope - 0.1).abs() < 1e-9, "{trend:?}");
        // Each interval is 0.1 wide, and the line leaves nothing: the change is no scatter.
        assert!((trend.error - error / 10f64.sqrt()).abs() < 1e-9, "{trend:?}");
        assert!((trend.d.0 - 1.0).abs() < 1e-9 && (trend.d.1 - 1.4).abs() < 1e-9, "{trend:?}");
        assert_eq!((trend.widths, trend.t), (5, (0.0, 4.0)));
        assert!(trend.changes());
        assert!(!Trend::of_readings(&grows[..4]).unwrap().changes(), "four widths are too few");
        assert_eq!(Trend::of_readings(&grows[..2]), None);
        assert_eq!(Trend::of_readings(&[grows[0]; 3]), None);
    }

    #[test]
    fn bounds_and_records_without_a_width_do_not_count() {
        let mut mixed: Vec<_> = (0..5).map(|i| reading(f64::from(i), 2.0)).collect();
        mixed.push(Reading { verdict: Verdict::Sound, d: 0.0, ..reading(5.0, 9.0) });
        mixed.push(Reading { high: None, ..reading(6.0, 9.0) });
        let trend = Trend::of_readings(&mixed).unwrap();
        assert_eq!((trend.widths, trend.t.1, trend.d), (5, 4.0, (2.0, 2.0)));
        assert!(!trend.changes());
    }

    #[test]
    fn widths_that_scatter_about_their_line_make_its_slope_less_sure() {
        let error = |off: [f64; 5]| {
            let readings: Vec<_> = (0..5).map(|i| reading(i as f64, 1.0 + off[i])).collect();
            Trend::of_readings(&readings).unwrap().error
        };
        let (calm, rough) = (error([0.0; 5]), error([0.3, -0.3, 0.0, 0.3, -0.3]));
        assert!(rough > 5.0 * calm, "{rough} {calm}");
    }

    /// Five widths, each with the same standard error, that grow in steps of so many of the slope's errors.
    fn grows_by(errors: f64, n: usize) -> Trend {
        // The slope's error of n widths a second apart, each of error 1.
        let middle = (n - 1) as f64 / 2.0;
        let spread: f64 = (0..n).map(|i| (i as f64 - middle).powi(2)).sum();
        let width = |i: usize| Width { t: i as f64, d: 9.0 + errors / spread.sqrt() * i as f64, error: Some(1.0) };
        Trend::of(&(0..n).map(width).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_change_is_plain_beyond_three_errors_and_from_five_widths() {
        assert!(grows_by(3.1, 5).changes() && grows_by(-3.1, 7).changes());
        assert!(!grows_by(2.9, 5).changes() && !grows_by(9.0, 4).changes());
        assert!((grows_by(1.0, 6).least() / grows_by(1.0, 6).error - 3.0).abs() < 1e-12);
    }

    #[test]
    fn without_standard_errors_the_scatter_decides_by_students_distribution() {
        let of = |n: usize| Trend {
            slope: 1.0,
            error: 1.0,
            widths: n,
            t: (0.0, 1.0),
            d: (1.0, 1.0),
            freedom: n as f64 - 2.0,
        };
        // Two-sided probabilities of 0.27 % and 5 %.
        for (n, plain, interval) in [(7, 5.507, 2.571), (12, 3.957, 2.228), (32, 3.270, 2.042), (1002, 3.008, 1.962)] {
            assert!((of(n).least() / plain - 1.0).abs() < 0.02, "{n}: {}", of(n).least());
            assert!((of(n).half_interval() / interval - 1.0).abs() < 0.02, "{n}: {}", of(n).half_interval());
        }
        let width = |i: usize| Width { t: i as f64, d: [1.0, 1.3, 1.1, 1.4, 1.2][i], error: None };
        let found = Trend::of(&[0, 1, 2, 3, 4].map(width)).unwrap();
        assert!((found.slope - 0.05).abs() < 1e-12 && found.freedom == 3.0);
        // Residuals −0.1, 0.15, −0.1, 0.15, −0.1; their squares 0.075 over 3, over a spread of 10.
        assert!((found.error - (0.075f64 / 3.0 / 10.0).sqrt()).abs() < 1e-12, "{}", found.error);
    }

    /// Share of series without a change that are called changed: each width with a normal error of `scatter` times its
    /// stated one.
    fn false_alarms(n: usize, known: bool, scatter: f64) -> f64 {
        let mut state = n as u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let mut normal = || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        const TRIALS: usize = 20_000;
        let mut changes = || {
            let width = |i| Width { t: i as f64, d: 9.0 + scatter * normal(), error: known.then_some(1.0) };
            Trend::of(&(0..n).map(width).collect::<Vec<_>>()).is_some_and(|trend| trend.changes())
        };
        (0..TRIALS).filter(|_| changes()).count() as f64 / TRIALS as f64
    }

    #[test]
    fn of_a_thousand_steady_widths_three_are_said_to_change() {
        for n in [5, 7, 12, 30] {
            for known in [true, false] {
                let share = false_alarms(n, known, 1.0);
                assert!((0.001..0.0042).contains(&share), "{n} widths, errors known {known}: {share}");
            }
        }
        // False alarms that Birge's ratio leaves where intervals are half as wide as they should be.
        assert!(false_alarms(5, true, 2.0) < 0.045 && false_alarms(20, true, 2.0) < 0.013);
    }
}
