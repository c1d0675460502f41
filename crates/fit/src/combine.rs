//! One answer from the windows of a long record.

use crate::verdict::Verdict;

/// What a window says, as much as the whole needs.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    /// Its verdict.
    pub verdict: Verdict,
    /// Most likely width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit [OP unit]; None where there is none.
    pub high: Option<f64>,
    /// Likelihood ratio of no gap.
    pub lr_no_gap: f64,
    /// Middle of the window [s].
    pub t: f64,
}

/// What the windows say together.
#[derive(Clone, Copy, Debug)]
pub struct Whole {
    /// The verdict.
    pub verdict: Verdict,
    /// Width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where there is none.
    pub high: Option<f64>,
    /// Change of the width [OP unit/s] and its standard error, where three windows or more give a width.
    pub trend: Option<(f64, f64)>,
}

/// The windows' answers together; at least one window.
///
/// Windows that found a width on both sides are weighed by the inverse square of their standard error (a quarter of the
/// interval); where they scatter more than their intervals allow (Cochran's Q), the scatter between them is added
/// (DerSimonian and Laird 1986). Without such a window the strongest bound holds: *at least*, else *sound* with the
/// lowest upper limit, else *cannot tell*.
pub fn combine(windows: &[Window]) -> Whole {
    let gap = |v: Verdict| matches!(v, Verdict::Backlash | Verdict::Stiction | Verdict::Both);
    let sided: Vec<(&Window, f64)> = windows
        .iter()
        .filter(|w| gap(w.verdict))
        .filter_map(|w| w.high.map(|high| (w, ((high - w.low) / 3.92).max(1e-9 * w.d))))
        .collect();
    let strongest = |windows: &mut dyn Iterator<Item = &Window>| {
        windows.max_by(|a, b| a.lr_no_gap.total_cmp(&b.lr_no_gap)).copied()
    };
    if !sided.is_empty() {
        let mean = |between: f64| {
            let weight = |s: f64| 1.0 / (s * s + between);
            let sum: f64 = sided.iter().map(|(_, s)| weight(*s)).sum();
            (sided.iter().map(|(w, s)| w.d * weight(*s)).sum::<f64>() / sum, sum.recip().sqrt())
        };
        let (fixed, _) = mean(0.0);
        let inverse: Vec<f64> = sided.iter().map(|(_, s)| 1.0 / (s * s)).collect();
        let q: f64 = sided.iter().zip(&inverse).map(|((w, _), i)| (w.d - fixed) * (w.d - fixed) * i).sum();
        let sum: f64 = inverse.iter().sum();
        let squares: f64 = inverse.iter().map(|i| i * i).sum();
        let free = sided.len() as f64 - 1.0;
        let between = if free > 0.0 { ((q - free) / (sum - squares / sum)).max(0.0) } else { 0.0 };
        let (d, error) = mean(between);
        let verdict = strongest(&mut sided.iter().map(|(w, _)| *w)).expect("not empty").verdict;
        let (low, high) = match sided.as_slice() {
            [(only, _)] => (only.low, only.high),
            _ => (d - 1.96 * error, Some(d + 1.96 * error)),
        };
        return Whole { verdict, d, low, high, trend: trend(&sided) };
    }
    if let Some(best) = windows.iter().filter(|w| w.verdict == Verdict::AtLeast).max_by(|a, b| a.low.total_cmp(&b.low))
    {
        return Whole { verdict: Verdict::AtLeast, d: best.d, low: best.low, high: None, trend: None };
    }
    let sound = windows.iter().filter(|w| w.verdict == Verdict::Sound);
    if let Some(best) = sound.min_by(|a, b| a.high.unwrap_or(f64::MAX).total_cmp(&b.high.unwrap_or(f64::MAX))) {
        return Whole { verdict: Verdict::Sound, d: best.d, low: 0.0, high: best.high, trend: None };
    }
    let best = strongest(&mut windows.iter()).expect("at least one window");
    Whole { verdict: Verdict::CannotTell, d: best.d, low: best.low, high: best.high, trend: None }
}

/// Weighted line through the windows' widths: slope and its standard error. Where they scatter about the line more than
/// their intervals allow, the error is larger by as much (Birge's ratio). The scatter about their mean, which a change
/// makes itself, does not count.
fn trend(sided: &[(&Window, f64)]) -> Option<(f64, f64)> {
    if sided.len() < 3 {
        return None;
    }
    let weighed = || sided.iter().map(|(w, s)| (w.t, w.d, 1.0 / (s * s)));
    let sum: f64 = weighed().map(|(_, _, i)| i).sum();
    let t = weighed().map(|(t, _, i)| t * i).sum::<f64>() / sum;
    let d = weighed().map(|(_, d, i)| d * i).sum::<f64>() / sum;
    let spread: f64 = weighed().map(|(at, _, i)| (at - t) * (at - t) * i).sum();
    let slope = weighed().map(|(at, width, i)| (at - t) * (width - d) * i).sum::<f64>() / spread;
    let residual = |at: f64, width: f64| width - d - slope * (at - t);
    let q: f64 = weighed().map(|(at, width, i)| residual(at, width) * residual(at, width) * i).sum();
    let birge = (q / (sided.len() as f64 - 2.0)).max(1.0);
    (spread > 0.0).then(|| (slope, (birge / spread).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(verdict: Verdict, d: f64, low: f64, high: f64, t: f64) -> Window {
        Window { verdict, d, low, high: Some(high), lr_no_gap: 100.0, t }
    }

    #[test]
    fn two_alike_make_a_narrower_interval() {
        let both = [window(Verdict::Backlash, 1.0, 0.9, 1.1, 0.0), window(Verdict::Backlash, 1.02, 0.92, 1.12, 1.0)];
        let whole = combine(&both);
        assert!((whole.d - 1.01).abs() < 1e-12);
        let width = whole.high.unwrap() - whole.low;
        assert!((width - 0.2 / 2f64.sqrt()).abs() < 1e-9, "{width}");
    }

    #[test]
    fn windows_that_disagree_widen_it() {
        let apart = [window(Verdict::Backlash, 1.0, 0.9, 1.1, 0.0), window(Verdict::Backlash, 2.0, 1.9, 2.1, 1.0)];
        let whole = combine(&apart);
        assert!(whole.low < 1.0 && whole.high.unwrap() > 2.0, "{whole:?}");
    }

    #[test]
    fn a_growing_gap_shows_its_trend() {
        let grows: Vec<Window> =
            (0..5).map(f64::from).map(|i| window(Verdict::Backlash, 1.0 + 0.1 * i, 0.95, 1.05, i)).collect();
        let (slope, error) = combine(&grows).trend.unwrap();
        assert!((slope - 0.1).abs() < 1e-9, "{slope}");
        // Each window's interval is 0.1 wide, and the line leaves nothing: the change is no scatter.
        assert!((error - 0.1 / 3.92 / 10f64.sqrt()).abs() < 1e-9, "{error}");
    }

    #[test]
    fn widths_that_scatter_about_their_line_make_its_slope_less_sure() {
        let at = |bumps: [f64; 5]| {
            let windows: Vec<Window> =
                (0..5).map(|i| window(Verdict::Backlash, 1.0 + bumps[i], 0.95, 1.05, i as f64)).collect();
            combine(&windows).trend.unwrap()
        };
        let ((_, calm), (_, rough)) = (at([0.0; 5]), at([0.3, -0.3, 0.0, 0.3, -0.3]));
        assert!(rough > 5.0 * calm, "{rough} {calm}");
    }

    #[test]
    fn without_a_width_the_strongest_bound_holds() {
        let bounds = [window(Verdict::AtLeast, 1.0, 0.8, 2.0, 0.0), window(Verdict::AtLeast, 1.2, 1.1, 2.0, 1.0)];
        assert_eq!((combine(&bounds).verdict, combine(&bounds).low), (Verdict::AtLeast, 1.1));
        let sound = [window(Verdict::Sound, 0.0, 0.0, 0.3, 0.0), window(Verdict::Sound, 0.0, 0.0, 0.2, 1.0)];
        assert_eq!((combine(&sound).verdict, combine(&sound).high), (Verdict::Sound, Some(0.2)));
    }
}
