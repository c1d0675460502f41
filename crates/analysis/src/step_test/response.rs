//! Response of a signal from one settled level to the next: T86 and overshoot.

use super::blocks::mean;
use super::holds::Node;
use super::settling::TestSignals;

/// Part of the way that is gone at T86: 1 − e⁻², of a single lag T after 2T.
const T86: f64 = 0.865;
/// Noise of the settled signal, as a fraction of the way, above which no time is given.
const NOISY: f64 = 0.2;
/// Standard deviations of the noise that the signal must go beyond its new level to have overshot.
const BEYOND: f64 = 3.0;

/// Time from the step of OP until 86.5 % of the way is gone \[s\], and how far the signal went beyond its new level, part of the
/// way. None where OP was not stepped at once, or noise hides the way.
pub(super) fn response(
    signals: &TestSignals,
    before: &Node,
    after: &Node,
    levels: (f64, f64),
) -> (Option<f64>, Option<f64>) {
    let TestSignals { t, y, h, .. } = *signals;
    let way = levels.1 - levels.0;
    let (Some(settled), false) = (after.settled, way == 0.0) else { return (None, None) };
    if t[after.first] - t[before.end - 1] > 2.0 * h {
        return (None, None);
    }
    let rows: Vec<usize> = (after.first..after.end).filter(|k| y[*k].is_finite()).collect();
    let gone: Vec<f64> = rows.iter().map(|k| (y[*k] - levels.0) / way).collect();
    let rest: Vec<f64> = rows.iter().zip(&gone).filter(|(k, _)| **k >= settled).map(|(_, gone)| *gone).collect();
    let noise = deviation(&rest);
    if rest.len() < 2 || noise > NOISY {
        return (None, None);
    }
    let furthest = gone.windows(3).map(|w| middle(w[0], w[1], w[2])).fold(f64::NEG_INFINITY, f64::max) - 1.0;
    let overshoot = if furthest > BEYOND * noise { furthest } else { 0.0 };
    // The row that parts those below from those above with the fewest on the wrong side: noise moves it to neither.
    let mut wrong = gone.iter().filter(|gone| **gone < T86).count();
    let (mut fewest, mut at) = (wrong, 0);
    for (k, gone) in gone.iter().enumerate() {
        if *gone < T86 {
            wrong -= 1;
        } else {
            wrong += 1;
        }
        if wrong < fewest {
            (fewest, at) = (wrong, k + 1);
        }
    }
    if at == gone.len() {
        return (None, Some(overshoot));
    }
    let crossed = t[rows[at]] - t[after.first];
    let t86 = if at == 0 {
        crossed
    } else {
        let (below, above) = (gone[at - 1], gone[at]);
        let share = if below < T86 && above >= T86 { (above - T86) / (above - below) } else { 0.5 };
        crossed - share * (t[rows[at]] - t[rows[at - 1]])
    };
    (Some(t86), Some(overshoot))
}

fn deviation(of: &[f64]) -> f64 {
    let centre = mean(of);
    (of.iter().map(|x| (x - centre).powi(2)).sum::<f64>() / of.len().max(1) as f64).sqrt()
}

/// Median of three values.
fn middle(a: f64, b: f64, c: f64) -> f64 {
    a.max(b).min(a.min(b).max(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn responds(answer: impl Fn(f64) -> f64) -> (Option<f64>, Option<f64>) {
        let t: Vec<f64> = (0..200).map(f64::from).collect();
        let y: Vec<f64> = t.iter().map(|t| if *t < 50.0 { 10.0 } else { 10.0 - 4.0 * answer(t - 50.0) }).collect();
        let node = |first, end, settled| Node { first, end, stretch: 0, op: 0.0, settled: Some(settled), side: 0 };
        let signals = TestSignals { t: &t, op: &t, y: &y, h: 1.0 };
        response(&signals, &node(0, 50, 10), &node(50, 200, 150), (10.0, 6.0))
    }

    #[test]
    fn t86_of_a_lag_is_twice_its_time() {
        let (t86, overshoot) = responds(|t| 1.0 - (-t / 10.0).exp());
        assert!((t86.unwrap() - 20.0).abs() < 0.1, "{t86:?}");
        assert_eq!(overshoot, Some(0.0));
        let (late, _) = responds(|t| if t < 7.0 { 0.0 } else { 1.0 - (-(t - 7.0) / 10.0).exp() });
        assert!((late.unwrap() - 27.0).abs() < 0.1, "{late:?}");
    }

    #[test]
    fn noise_moves_t86_to_neither_side() {
        // An even share of rows is 0.1 too high and too low.
        let (t86, overshoot) = responds(|t| 1.0 - (-t / 10.0).exp() + if (t as i64) % 2 == 0 { 0.1 } else { -0.1 });
        assert!((t86.unwrap() - 20.0).abs() < 6.0, "{t86:?}");
        assert_eq!(overshoot, Some(0.0));
        assert_eq!(responds(|t| 1.0 + if (t as i64) % 2 == 0 { 0.25 } else { -0.25 }), (None, None));
    }

    #[test]
    fn overshoot_is_what_goes_beyond_the_new_level() {
        // Damping 0.4: exp(−π·0.4/√(1 − 0.16)) = 0.254.
        let swings = |t: f64| {
            let (zeta, w) = (0.4f64, 0.1);
            let root = (1.0 - zeta * zeta).sqrt();
            let angle = w * root * t;
            1.0 - (-zeta * w * t).exp() * (angle.cos() + zeta / root * angle.sin())
        };
        let (_, overshoot) = responds(swings);
        assert!((overshoot.unwrap() - 0.254).abs() < 0.005, "{overshoot:?}");
    }
}
