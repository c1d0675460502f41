//! One answer from all lengths of the means.

use std::rc::Rc;

use super::band::{Band, Candidate, Shape, bands};
use super::filter::Filter;
use super::interval::{Found, Span};
use super::law::{Form, forms};
use super::parts::{Moves, SharedSignals};
use super::rows::WholeRows;
use super::{Identification, Interval, Note, R2_USABLE, Reason, Settings, Values, WIDEST, Weight};
use crate::signals::resolution;

/// Lengths of the means whose interval is at most so many times as wide as the narrowest are believed.
const AGREEING: f64 = 2.0;
/// Share of OP's moves that all laws must leave before OP is read a sample later or earlier.
const LEFT: f64 = 1e-3;
/// Widest interval of the setpoint weight that tells it.
const WEIGHT_WIDTH: f64 = 0.5;

/// The law behind the rows; `samples` steps of the recording could be used.
pub(super) fn judged(rows: &WholeRows, h: f64, samples: usize, given_b: Option<f64>) -> Identification {
    let grid = resolution(&rows.op).map(|(step, _)| step).filter(|step| *step < 1e100);
    let op_noise = grid.map_or(0.0, |step| step * step / 12.0);
    let read = [0, 1, -1].map(|lag| SharedSignals::new(rows, h, given_b, lag));
    let mut all = bands(&read[0]);
    if all.is_empty() {
        return Identification::nothing(Reason::Unshown, samples);
    }
    let mut forms = forms(h, all.len() as i32 - 3);
    let mut laws = candidates(&all, &forms);
    let mut least = unexplained(&mut all, &laws);
    // OP recorded a sample late or early: where that leaves a quarter as much unexplained as any law without.
    for other in if least > LEFT { &read[1..] } else { &[] } {
        let mut shifted = bands(other);
        let plain: Vec<_> = shifted.iter().map(|band| vec![band.plain.clone()]).collect();
        let rest = unexplained(&mut shifted, &plain);
        if rest < 0.25 * least {
            (all, least) = (shifted, rest);
            forms.retain(|form| !form.filter.lags());
            laws = candidates(&all, &forms);
        }
    }
    let mut found = Vec::new();
    for (band, candidates) in all.iter_mut().zip(&laws) {
        let laws = band.searched(candidates);
        found.extend(Found::new(band, laws, op_noise));
    }
    if found.iter().any(|one| one.span.k.low.is_finite()) {
        answer(&found, all[0].signals.lag, h, samples, given_b)
    } else {
        insane(&mut all, samples)
    }
}

/// Every form at every length of the means; each filter runs once.
fn candidates(bands: &[Band<'_>], forms: &[Form]) -> Vec<Vec<Candidate>> {
    let mut filters: Vec<Filter> = Vec::new();
    for form in forms {
        if !filters.contains(&form.filter) {
            filters.push(form.filter);
        }
    }
    let mut moves = vec![Vec::new(); bands.len()];
    for filter in &filters {
        let sums = bands[0].signals.parts(filter);
        for (moves, band) in moves.iter_mut().zip(bands) {
            moves.push(Rc::new(band.stretches.moves(&sums)));
        }
    }
    let behind = |form: &Form| filters.iter().position(|filter| *filter == form.filter);
    let known: Vec<(Form, usize)> = forms.iter().filter_map(|form| Some((*form, behind(form)?))).collect();
    let of_band = |moves: Vec<Rc<Moves>>| -> Vec<Candidate> {
        known.iter().map(|(form, filter)| Candidate::given(*form, moves[*filter].clone())).collect()
    };
    moves.into_iter().map(of_band).collect()
}

/// Share of OP's moves between means of some samples that the best of the laws leaves.
fn unexplained(bands: &mut [Band<'_>], laws: &[Vec<Candidate>]) -> f64 {
    let at = bands.len().min(3);
    let Some((band, laws)) = bands.iter_mut().zip(laws).take(at).next_back() else { return f64::INFINITY };
    let plain = band.plain.clone();
    band.reweight(&plain, Shape::Huber, 8);
    band.sane(laws).first().map_or(f64::INFINITY, |best| 1.0 - band.r2(best, 0.0))
}

/// The reason where no law has values that a controller could have.
fn insane(bands: &mut [Band<'_>], samples: usize) -> Identification {
    let mut best: Option<(Values, [f64; 2], f64)> = None;
    for band in bands {
        let plain = band.plain.clone();
        band.reweight(&plain, Shape::Tukey, 15);
        let Some(law) = band.law(&plain) else { continue };
        let Some(scatter) = band.scatter(&law) else { continue };
        let r2 = band.r2(&law, 0.0);
        if best.as_ref().is_none_or(|(best, ..)| r2 > best.r2) {
            let error = [0, 1].map(|j| scatter[(j, j)].sqrt());
            best = Some((Values { k: law.k(), ti: law.ti(), r2 }, error, law.beta[1]));
        }
    }
    let Some((values, [k_error, ki_error], ki)) = best else {
        return Identification::nothing(Reason::Unshown, samples);
    };
    let reason = if values.r2 < R2_USABLE {
        Reason::LittleExplained
    } else if values.k.abs() <= k_error {
        Reason::NoGain { error: k_error }
    } else if ki.abs() <= ki_error {
        Reason::NoIntegral
    } else if values.ti < 0.0 {
        Reason::OppositeSigns
    } else {
        Reason::Contradictory
    };
    Identification { samples, values: Some(values), settings: None, reason: Some(reason) }
}

/// The identification at the best averaging length; its intervals cover every averaging length that fits the law.
fn answer(found: &[Found], lag: isize, h: f64, samples: usize, given_b: Option<f64>) -> Identification {
    let poor = |one: &Found| one.r2 < R2_USABLE;
    // A coarse OP hides the law in short means; a wrong law is not mended by longer ones.
    let order = |a: &&Found, b: &&Found| {
        let unknown = |one: &Found| !one.span.k.low.is_finite();
        (poor(a).cmp(&poor(b)))
            .then(a.width.total_cmp(&b.width))
            .then(unknown(a).cmp(&unknown(b)))
            .then(b.r2.total_cmp(&a.r2))
    };
    let weight_width = |one: &Found| one.span.b.high - one.span.b.low;
    let Some(best) = found.iter().min_by(order) else {
        return Identification::nothing(Reason::Unshown, samples);
    };
    let alike = |one: &&Found| agrees(one.width, best.width);
    let mut span = found.iter().filter(alike).map(|one| one.span).reduce(Span::hull).unwrap_or(best.span);
    // Lengths that contradict each other show that a law is missing: then neither is right alone.
    for one in found.iter().filter(|one| one.width.is_finite() && !poor(one)) {
        if one.span.contradicts(&span) {
            span = span.hull(one.span);
        }
    }
    // Where K is not determined (a coarse OP rests through most short means), b is the ratio of two roundings.
    let surer = |a: &&Found, b: &&Found| {
        a.width.is_infinite().cmp(&b.width.is_infinite()).then(weight_width(a).total_cmp(&weight_width(b)))
    };
    let surest = found.iter().min_by(surer).unwrap_or(best);
    let weight = tells(surest.span.b).then(|| Weight {
        fitted: surest.law.beta[surest.law.beta.len() - 1] / surest.law.k(),
        interval: surest.span.b,
    });
    let (law, Span { k, ti, td, .. }) = (&best.law, span);
    let reason = if poor(best) {
        Some(Reason::LittleExplained)
    } else if k.low <= 0.0 {
        Some(Reason::GainMayBeNone { size: law.k().abs(), k })
    } else if !ti.high.is_finite() {
        Some(Reason::NoIntegral)
    } else if too_wide(k, ti) {
        Some(Reason::Wide { k, ti, h })
    } else {
        None
    };
    let settings = Settings {
        td: law.td(),
        k_interval: if law.k() > 0.0 { k } else { Interval { low: -k.high, high: -k.low } },
        ti_interval: ti,
        td_interval: td,
        setpoint_weight: weight.map(|weight| weight.fitted.clamp(0.0, 1.0)).or(given_b),
        note: Note { m: best.m, h, derivative: law.form.derivative, filter: law.form.filter, lag, weight },
    };
    let values = Values { k: law.k(), ti: law.ti(), r2: best.r2 };
    Identification { samples, values: Some(values), settings: Some(settings), reason }
}

/// Whether a length of the means is believed beside the one of the narrowest interval; widths in logarithms.
fn agrees(width: f64, narrowest: f64) -> bool {
    narrowest.is_finite() && width <= AGREEING * narrowest
}

/// Whether the interval of the setpoint weight is narrow enough to give it.
fn tells(b: Interval) -> bool {
    b.high - b.low < WEIGHT_WIDTH
}

/// Whether the interval of K or Ti is too wide to be used.
fn too_wide(k: Interval, ti: Interval) -> bool {
    (k.high / k.low).max(ti.high / ti.low) > WIDEST
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_twice_as_wide_as_the_narrowest_is_believed() {
        assert!(agrees(0.2, 0.1) && !agrees(0.21, 0.1));
        assert!(!agrees(f64::INFINITY, f64::INFINITY), "none of them is known");
    }

    #[test]
    fn an_interval_of_half_tells_the_setpoint_weight() {
        let about = |width: f64| Interval { low: 0.3, high: 0.3 + width };
        assert!(tells(about(0.49)) && !tells(about(0.51)));
    }

    #[test]
    fn gain_and_integral_time_are_known_to_a_factor_of_four() {
        let (sure, four) = (Interval { low: 1.0, high: 1.1 }, Interval { low: 1.0, high: 4.0 });
        let wider = Interval { low: 1.0, high: 4.1 };
        assert!(!too_wide(four, sure) && !too_wide(sure, four));
        assert!(too_wide(wider, sure) && too_wide(sure, wider));
    }
}
