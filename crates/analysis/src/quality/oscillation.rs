//! A linear oscillation: one clean frequency, half-periods too short for backlash under this Ti.

use std::f64::consts::PI;

use realfft::RealFftPlanner;

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::{Look, longest_run, span};
use crate::identify::R2_USABLE;
use crate::{SORTED_ROWS, median};

/// Fewer samples, or crossings of the mean, show no frequency.
const FEWEST: (usize, usize) = (64, 12);
/// Lines on either side that belong to the peak, as a share of its number and at least: its slow changes of frequency.
const LINE: (f64, usize) = (0.15, 2);
/// Stretches between crossings count as half-periods from this share of the peak's on: noise crosses many times about
/// one zero.
const CROSSING: f64 = 0.5;
/// One frequency: more than this share of the power in its line.
const SHARE: f64 = 0.9;
/// Regular: the half-periods scatter by less than this share of their mean.
const SPREAD: f64 = 0.25;
/// The cycle of a gap has half-periods longer than so many Ti: the safety net's `too_short`.
const TI_LONG: f64 = 5.0;
/// Peak to mean of a sinusoid is π/2 = 1.57; of a square 1, of a triangle 2.
const SHAPE: (f64, f64) = (1.35, 1.8);

/// Finding on a swing that is a sine and no gap's.
pub(super) fn sinusoid(look: &Look<'_>, found: &mut Vec<Finding>) {
    // Without Ti the cycle of a gap in an integrating loop looks the same.
    let Some(ti) = shortest_ti(look) else { return };
    let steps = longest_run(&look.step, |step| *step);
    if steps.is_empty() {
        return;
    }
    let e = &look.e[steps.start..=steps.end];
    let e = &e[..e.len().min(SORTED_ROWS)];
    if e.len() < FEWEST.0 || span(e.iter().copied()) == 0.0 {
        return;
    }
    let mean = e.iter().sum::<f64>() / e.len() as f64;
    let e: Vec<f64> = e.iter().map(|e| e - mean).collect();
    let crossings: Vec<usize> = (1..e.len()).filter(|k| (e[*k] > 0.0) != (e[k - 1] > 0.0)).collect();
    if crossings.len() < FEWEST.1 {
        return;
    }
    // Noise can cross many times around one zero: the half-period is that of the spectral peak, not of the crossings.
    let power = spectrum(&e);
    let peak = (1..power.len()).fold(1, |peak, k| if power[k] > power[peak] { k } else { peak });
    let width = ((LINE.0 * peak as f64).round_ties_even() as usize).max(LINE.1);
    let line = &power[peak.saturating_sub(width).max(1)..power.len().min(peak + width + 1)];
    let share = line.iter().sum::<f64>() / power[1..].iter().sum::<f64>();
    let half = 0.5 * e.len() as f64 * look.h / peak as f64;
    let (mut shapes, mut lengths) = (Vec::new(), Vec::new());
    for pair in crossings.windows(2) {
        let part = &e[pair[0]..pair[1]];
        let length = part.len() as f64 * look.h;
        if length > CROSSING * half {
            let top = part.iter().fold(0.0, |top: f64, e| top.max(e.abs()));
            shapes.push(top / (part.iter().map(|e| e.abs()).sum::<f64>() / part.len() as f64));
            lengths.push(length);
        }
    }
    let shape = median(&mut shapes);
    let spread = spread(&lengths);
    if share > SHARE && spread < SPREAD && half < TI_LONG * ti && shape > SHAPE.0 && shape < SHAPE.1 {
        found.push(
            Finding::new(Fault::Sinusoidal, Severity::Warning)
                .with("period_s", 2.0 * half)
                .with("spectral_share", share)
                .with("spread", spread)
                .with("peak_to_mean", shape)
                .telling("half_s", half)
                .telling("limit_s", TI_LONG * ti),
        );
    }
}

/// Ti, or the least that it can be: one frequency leaves Ti open by more than is usable, but that is enough here.
fn shortest_ti(look: &Look<'_>) -> Option<f64> {
    let seen = || look.known.law.filter(|law| law.r2.is_some_and(|r2| r2 >= R2_USABLE))?.ti.low;
    look.known.ti.or_else(|| seen().filter(|low| *low > 0.0 && low.is_finite()))
}

/// Power at each line, seen through a Hann window.
fn spectrum(x: &[f64]) -> Vec<f64> {
    let n = x.len();
    let plan = RealFftPlanner::new().plan_fft_forward(n);
    let middle = (n - 1) as f64;
    let window = |k: usize| 0.5 + 0.5 * (PI * (2.0 * k as f64 - middle) / middle).cos();
    let mut seen: Vec<f64> = x.iter().enumerate().map(|(k, x)| x * window(k)).collect();
    let mut lines = plan.make_output_vec();
    plan.process(&mut seen, &mut lines).expect("both are of the plan's length");
    lines.iter().map(|line| line.norm_sqr()).collect()
}

/// Standard deviation as a share of the mean; infinite where there is nothing.
fn spread(x: &[f64]) -> f64 {
    if x.is_empty() {
        return f64::INFINITY;
    }
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / x.len() as f64).sqrt() / mean
}
