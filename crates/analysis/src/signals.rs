//! Properties of a recorded signal: its steps, its noise, its still stretches.

use std::collections::HashSet;

/// Number of steps, identical to the bit in all signals, that show that the recording stood still and not the loop.
pub const FROZEN_STEPS: usize = 5;
/// Rows that are enough to know a signal's steps, noise and spectrum.
pub const SORTED_ROWS: usize = 200_000;

/// Fewest differences that tell the noise.
const FEWEST: usize = 20;

/// Keeps of a mask only the runs of at least so many.
pub fn in_runs(mask: &[bool], least: usize) -> Vec<bool> {
    let mut keep = vec![false; mask.len()];
    let mut begin = 0;
    for run in mask.chunk_by(|a, b| a == b) {
        if run[0] && run.len() >= least {
            keep[begin..begin + run.len()].fill(true);
        }
        begin += run.len();
    }
    keep
}

/// Median of numbers in any order, which it moves about; NaN where there are none.
pub fn median(x: &mut [f64]) -> f64 {
    let n = x.len();
    if n == 0 {
        return f64::NAN;
    }
    let (below, &mut upper, _) = x.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 {
        return upper;
    }
    let lower = below.iter().copied().max_by(f64::total_cmp).unwrap_or(upper);
    (lower + upper) / 2.0
}

/// Quantile of numbers in ascending order, between two of them by a straight line; NaN where there are none.
pub fn quantile(ascending: &[f64], share: f64) -> f64 {
    let Some(last) = ascending.len().checked_sub(1) else { return f64::NAN };
    let at = share * last as f64;
    let (below, part) = ((at.floor() as usize).min(last), at.fract());
    let (low, high) = (ascending[below], ascending[(below + 1).min(last)]);
    // Interpolated from the nearer end, so that it never leaves the two.
    if part < 0.5 { low + (high - low) * part } else { high - (high - low) * (1.0 - part) }
}

/// Step of a quantised signal and the number of steps in its range; none where it has no such grid.
pub fn resolution(x: &[f64]) -> Option<(f64, u64)> {
    let x = &x[..x.len().min(SORTED_ROWS)];
    let most = x.len() / 2;
    let mut different = HashSet::with_capacity(most + 1);
    for x in x.iter().filter(|x| x.is_finite()) {
        // −0 + 0 is 0: the two are one value.
        different.insert((x + 0.0).to_bits());
        if different.len() > most {
            return None;
        }
    }
    let mut values: Vec<f64> = different.into_iter().map(f64::from_bits).collect();
    if values.len() < 2 {
        return None;
    }
    values.sort_unstable_by(f64::total_cmp);
    let span = values[values.len() - 1] - values[0];
    let size = values[0].abs().max(values[values.len() - 1].abs());
    let least = 1e-9 * span + 1e-12 * size;
    let mut apart: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|apart| *apart > least).collect();
    if apart.is_empty() || !span.is_finite() {
        return None;
    }
    apart.sort_unstable_by(f64::total_cmp);
    // A few interpolated values between the steps must not hide the grid: its step is what most neighbours share.
    let widest = 1.5 * quantile(&apart, 0.1);
    let near = apart.partition_point(|apart| *apart <= widest);
    let step = median(&mut apart[..near]);
    let on_grid =
        apart.iter().filter(|apart| (**apart / step - (**apart / step).round_ties_even()).abs() < 0.02).count();
    (on_grid as f64 > 0.9 * apart.len() as f64).then(|| (step, (span / step).round_ties_even() as u64))
}

/// Marks long stretches in which no signal changes a bit though the error is not zero, with the step that ends each.
///
/// There a historian repeats its last row while the loop goes on; the jump at the end holds an error nobody recorded.
/// One mark a step from a row to the next.
pub fn frozen_steps(sp: Option<&[f64]>, pv: &[f64], op: Option<&[f64]>) -> Vec<bool> {
    let stays = |x: &[f64], k: usize| x[k + 1] == x[k];
    let still: Vec<bool> = (0..pv.len().saturating_sub(1))
        .map(|k| {
            stays(pv, k)
                && sp.is_none_or(|sp| stays(sp, k) && sp[k + 1] != pv[k + 1])
                && op.is_none_or(|op| stays(op, k))
        })
        .collect();
    let mut frozen = in_runs(&still, FROZEN_STEPS);
    let count = |marks: &[bool]| marks.iter().filter(|mark| **mark).count();
    let (all, long) = (count(&still), count(&frozen));
    // Coarse signals rest by themselves: only where values otherwise hardly ever repeat does a repetition mean anything.
    if long == 0 || (all - long) as f64 > 0.1 * (frozen.len() - long) as f64 || resolution(pv).is_some() {
        return vec![false; still.len()];
    }
    for k in (1..frozen.len()).rev() {
        frozen[k] |= frozen[k - 1];
    }
    frozen
}

/// Standard deviation of PV's fast noise [PV unit]; none where fewer than 20 differences are left.
///
/// The j-th difference of white noise of variance s² has variance s²·C(2j, j), and takes away any movement that is a
/// polynomial of degree j − 1 over j + 1 samples. From each of j = 0 to 4 comes one robust value (median absolute
/// deviation/0.6745); the least is given, since the loop's own movement can only add.
///
/// Bias: an upper bound where PV's own movement fills only a few samples; too low for noise that a filter or a historian
/// has smoothed. Of a quantised PV at least one step/√12. Samples that repeat the last value for long are left out.
///
/// ```
/// let noise = |k: u64| ((k * k * 7919) % 1009) as f64 / 1009.0; // uniform, between 0 and 1
/// let pv: Vec<f64> = (0..5000).map(|k| 10.0 * (k as f64 / 50.0).sin() + noise(k)).collect();
/// let sigma = glapp_analysis::noise_sigma(&pv).unwrap();
/// assert!((0.9..1.15).contains(&(sigma * f64::sqrt(12.0))), "{sigma}");
/// ```
pub fn noise_sigma(pv: &[f64]) -> Option<f64> {
    let mut pv = pv[..pv.len().min(SORTED_ROWS)].to_vec();
    let grid = resolution(&pv);
    // On a grid, rest is what slow movement looks like.
    if grid.is_none() {
        let still: Vec<bool> = pv.windows(2).map(|pair| pair[1] == pair[0]).collect();
        for (k, held) in in_runs(&still, FROZEN_STEPS).into_iter().enumerate() {
            if held {
                pv[k + 1] = f64::NAN;
            }
        }
    }
    let mut least = f64::INFINITY;
    let mut binomial = 1.0;
    for order in 0..5 {
        if order > 0 {
            pv = pv.windows(2).map(|pair| pair[1] - pair[0]).collect();
            binomial *= 2.0 * (2 * order - 1) as f64 / order as f64; // C(2j, j) of the one before
        }
        let mut numbers: Vec<f64> = pv.iter().copied().filter(|x| x.is_finite()).collect();
        if numbers.len() < FEWEST {
            return None;
        }
        let middle = median(&mut numbers);
        numbers.iter_mut().for_each(|x| *x = (*x - middle).abs());
        least = least.min(median(&mut numbers) / 0.6745 / f64::sqrt(binomial));
    }
    Some(least.max(grid.map_or(0.0, |(step, _)| step / f64::sqrt(12.0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_quantiles() {
        assert_eq!(in_runs(&[true, false, true, true, false, true], 2), [false, false, true, true, false, false]);
        let mask = [true, true, false, true, true, true, false, false, true];
        assert_eq!(in_runs(&mask, 3), [false, false, false, true, true, true, false, false, false]);
        assert_eq!(in_runs(&mask, 1), mask);
        assert_eq!(in_runs(&[], 2), [false; 0]);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&mut []).is_nan() && quantile(&[], 0.5).is_nan());
        assert_eq!(quantile(&[0.0, 1.0, 2.0, 3.0, 4.0], 0.1), 0.4);
        assert_eq!(quantile(&[7.0], 0.9), 7.0);
    }

    #[test]
    fn a_grid_is_seen_through_some_interpolated_values() {
        let mut x: Vec<f64> = (0..400).map(|k| 0.25 * f64::from((k * 37) % 40)).collect();
        assert_eq!(resolution(&x), Some((0.25, 39)));
        x[7] = 3.1;
        assert_eq!(resolution(&x).map(|grid| grid.0), Some(0.25));
        let smooth: Vec<f64> = (0..400).map(|k| f64::from(k).sin()).collect();
        assert_eq!(resolution(&smooth), None);
    }

    #[test]
    fn a_historian_that_repeats_its_last_row_is_seen() {
        let mut pv: Vec<f64> = (0..300).map(|k| (f64::from(k) / 9.0).sin()).collect();
        let sp = vec![2.0; 300];
        pv[100..120].fill(0.5);
        let frozen = frozen_steps(Some(&sp), &pv, None);
        assert_eq!(frozen.iter().filter(|frozen| **frozen).count(), 20);
        assert!(frozen[100] && frozen[119] && !frozen[99] && !frozen[120]);
        assert!(frozen_steps(Some(&[1.0]), &[1.0], None).is_empty());
        assert!(frozen_steps(None, &[], None).is_empty());
    }

    #[test]
    fn frozen_needs_an_error_and_all_signals() {
        let (flat, off, moving) = ([1.0; 10], [2.0; 10], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        let none = [false; 9];
        assert_eq!(frozen_steps(Some(&flat), &off, Some(&flat)), [true; 9]);
        assert_eq!(frozen_steps(Some(&flat), &flat, Some(&flat)), none);
        assert_eq!(frozen_steps(Some(&flat), &off, Some(&moving)), none);
    }

    #[test]
    fn too_few_samples_tell_no_noise() {
        assert_eq!(noise_sigma(&[1.0; 10]), None);
        assert_eq!(noise_sigma(&[f64::NAN; 100]), None);
    }
}
