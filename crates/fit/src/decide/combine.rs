//! One answer from the widths that a valve's position shows in several records.

use crate::decide::judgement::Verdict;

/// Facts of a record that the whole needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    /// Verdict of the record.
    pub(crate) verdict: Verdict,
    /// Most likely width [OP unit].
    pub(crate) d: f64,
    /// Lower limit, 95 % [OP unit].
    pub(crate) low: f64,
    /// Upper limit [OP unit]; None where there is none.
    pub(crate) high: Option<f64>,
    /// Likelihood ratio of no gap.
    pub(crate) lr_no_gap: f64,
    /// Middle of its time [s].
    pub(crate) t: f64,
}

impl Reading {
    /// Standard error of a width with two limits [OP unit]: a quarter of its interval.
    pub(crate) fn standard_error(&self) -> Option<f64> {
        let width = matches!(self.verdict, Verdict::Backlash | Verdict::Stiction | Verdict::Both);
        self.high.filter(|_| width).map(|high| ((high - self.low) / 3.92).max(1e-9 * self.d))
    }
}

/// Joint result of the records.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Combined {
    /// The verdict.
    pub(crate) verdict: Verdict,
    /// Width [OP unit].
    pub(crate) d: f64,
    /// Lower limit, 95 % [OP unit].
    pub(crate) low: f64,
    /// Upper limit, 95 % [OP unit]; None where there is none.
    pub(crate) high: Option<f64>,
}

/// The records' answers together; None of none.
///
/// Records that give a width with two limits are weighed by the inverse square of their standard error (a quarter of the
/// interval); where they scatter more than their intervals allow (Cochran's Q), the scatter between them is added
/// (DerSimonian and Laird 1986). Without such a record the strongest bound holds: *at least*, else *sound* with the
/// lowest upper limit, else *cannot tell*.
pub(crate) fn combine(records: &[Reading]) -> Option<Combined> {
    let sided: Vec<(&Reading, f64)> = records.iter().filter_map(|w| Some((w, w.standard_error()?))).collect();
    let strongest =
        |of: &mut dyn Iterator<Item = &Reading>| of.max_by(|a, b| a.lr_no_gap.total_cmp(&b.lr_no_gap)).copied();
    if let Some(Reading { verdict, .. }) = strongest(&mut sided.iter().map(|(w, _)| *w)) {
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
        let (low, high) = match sided.as_slice() {
            [(only, _)] => (only.low, only.high),
            _ => ((d - 1.96 * error).max(0.0), Some(d + 1.96 * error)),
        };
        return Some(Combined { verdict, d, low, high });
    }
    if let Some(best) = records.iter().filter(|w| w.verdict == Verdict::AtLeast).max_by(|a, b| a.low.total_cmp(&b.low))
    {
        return Some(Combined { verdict: Verdict::AtLeast, d: best.d, low: best.low, high: None });
    }
    let sound = records.iter().filter(|w| w.verdict == Verdict::Sound);
    if let Some(best) = sound.min_by(|a, b| a.high.unwrap_or(f64::MAX).total_cmp(&b.high.unwrap_or(f64::MAX))) {
        return Some(Combined { verdict: Verdict::Sound, d: best.d, low: 0.0, high: best.high });
    }
    let best = strongest(&mut records.iter())?;
    Some(Combined { verdict: Verdict::CannotTell, d: best.d, low: best.low, high: best.high })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(verdict: Verdict, d: f64, low: f64, high: f64, t: f64) -> Reading {
        Reading { verdict, d, low, high: Some(high), lr_no_gap: 100.0, t }
    }

    #[test]
    fn two_alike_make_a_narrower_interval() {
        let both = [window(Verdict::Backlash, 1.0, 0.9, 1.1, 0.0), window(Verdict::Backlash, 1.02, 0.92, 1.12, 1.0)];
        let whole = combine(&both).unwrap();
        assert!((whole.d - 1.01).abs() < 1e-12);
        let width = whole.high.unwrap() - whole.low;
        assert!((width - 0.2 / 2f64.sqrt()).abs() < 1e-9, "{width}");
    }

    #[test]
    fn windows_that_disagree_widen_it() {
        let apart = [window(Verdict::Backlash, 1.0, 0.9, 1.1, 0.0), window(Verdict::Backlash, 2.0, 1.9, 2.1, 1.0)];
        let whole = combine(&apart).unwrap();
        assert!(whole.low < 1.0 && whole.high.unwrap() > 2.0, "{whole:?}");
    }

    #[test]
    fn without_a_width_the_strongest_bound_holds() {
        let bounds = [window(Verdict::AtLeast, 1.0, 0.8, 2.0, 0.0), window(Verdict::AtLeast, 1.2, 1.1, 2.0, 1.0)];
        assert_eq!(combine(&bounds).map(|c| (c.verdict, c.low)).unwrap(), (Verdict::AtLeast, 1.1));
        let sound = [window(Verdict::Sound, 0.0, 0.0, 0.3, 0.0), window(Verdict::Sound, 0.0, 0.0, 0.2, 1.0)];
        assert_eq!(combine(&sound).map(|c| (c.verdict, c.high)).unwrap(), (Verdict::Sound, Some(0.2)));
    }
}
