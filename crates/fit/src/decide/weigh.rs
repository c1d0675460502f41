//! Evidence weighed: a probability that the valve has a dead band, and what speaks for it and against it.
//!
//! The log-odds are a sum,
//!
//! ```text
//! ln p/(1−p) = ln π/(1−π) + B + Σ fᵢ(xᵢ)
//! ```
//!
//! π is the share of valves that have a dead band, known beforehand. B + Σ fᵢ is the logarithm of the Bayes factor. Each xᵢ is a quantity
//! of the [`Evidence`], each fᵢ a broken line that rises or falls all the way, as an engineer would expect, and stays constant beyond its
//! ends: a value outside of what was learned counts no more than the last one inside. `python -m bench.weigh` learns the lines from
//! simulated records of known truth and writes them into [`weights`](super::weights). The mean of each line over those records is 0, so
//! that fᵢ is what xᵢ says beyond what it says of a usual record.
//!
//! What the rules of the ladder say is one of the quantities, and the rungs follow from both ([`judge`](super::verdict::judge)). They stand on
//! the usual share π, so that another one moves no rung.

use crate::decide::evidence::{Evidence, rules};
use crate::decide::judgement::Confidence;
use crate::decide::segment_fit::SegmentFit;
use crate::decide::thresholds::{CYCLES_IF_CLEAR, LR_MIN, MAX_AUTOCORRELATION, RISE_OF_PROCESS};
use crate::decide::weights::{BASE, CURVES};
use serde::{Deserialize, Serialize};

/// Share of valves with a dead band where nobody said another: surveys of plants find a fifth to a third of valves worn.
pub const USUAL_PRIOR: f64 = 0.25;

/// No probability that is shown is nearer to 0 or to 1 than this.
pub const LEAST_DOUBT: f64 = 0.02;

/// Contribution of each kind of evidence to the log-odds of a dead band: above 0 it speaks for one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Terms {
    /// The gap's part of what OP explains of PV: a model that is off looks like a gap by a small part of it.
    pub likelihood: f64,
    /// Number of traversals of the width by OP.
    pub traversals: f64,
    /// The width against OP's range.
    pub width: f64,
    /// Nearness of the upper limit to the width.
    pub limit: f64,
    /// Effect of the gap on PV compared with PV's noise.
    pub noise: f64,
    /// Whether PV stands while OP goes through the gap.
    pub plateau: f64,
    /// Part of the valve's effect that a load undoes.
    pub process: f64,
    /// Judgement by the rules of the ladder.
    pub rules: f64,
}

/// The evidence of a record, or of several, weighed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weighed {
    /// Logarithm of the Bayes factor: how many times likelier the evidence is with a dead band than without.
    pub log_bayes_factor: f64,
    /// Contribution of each kind of evidence.
    pub terms: Terms,
    /// Widths [OP unit], and the probability that the dead band is wider, if there is one.
    pub wider: Vec<(f64, f64)>,
}

/// A quantity of the evidence.
pub(super) struct Quantity {
    /// Name in the table of weights.
    pub(super) name: &'static str,
    /// Whether a greater one speaks for a dead band.
    rises: bool,
    of: fn(&Evidence) -> f64,
    term: fn(&mut Terms) -> &mut f64,
}

macro_rules! quantities {
    ($($name:literal $way:literal $term:ident: $of:expr;)*) => {
        /// All of them, in the order of the table of weights.
        pub(super) const QUANTITIES: &[Quantity] =
            &[$(Quantity { name: $name, rises: $way, of: $of, term: |terms| &mut terms.$term }),*];
    };
}

quantities! {
    "share" true likelihood: share;
    "passes" true traversals: |e| (e.passes[0].min(e.passes[1]) as f64).ln_1p();
    "off_usual" false width: |e| ratio(e.d, USUAL_PART * e.range).ln().abs();
    "of_range" false width: |e| ratio(e.d, e.range);
    "high_of_d" false limit: |e| e.high.map_or(-LEAST.ln(), |high| ratio(high, e.d).ln());
    "of_noise" true noise: |e| if e.oscillates { 0.0 } else { ratio(e.d, e.noisy_below).ln() };
    "within" false plateau: within;
    "cancels" false process: |e| e.cancels.max(LEAST).ln();
    "rung" true rules: rung;
}

/// Lower limit of a number before its logarithm, which stays finite.
const LEAST: f64 = 1e-3;

/// Part of OP's range that a dead band mostly is where it shows: of a narrower one a model that is off may be the cause, of a wider one a slow
/// load.
const USUAL_PART: f64 = 0.25;

/// One over the other, between [`LEAST`] and its inverse.
fn ratio(one: f64, other: f64) -> f64 {
    (one.max(0.0) / other.max(1e-300)).clamp(LEAST, 1.0 / LEAST)
}

/// The logarithm of the part of an answer's ratio that the gap's is, times Kp·sd(OP)/sd(PV): the more a load undoes of what the valve does, the
/// more OP explains, whether there is a gap or not. Behind an integrator that is not known, and taken as 1.
fn share(e: &Evidence) -> f64 {
    let undone = if e.cancels > 0.0 { ratio(e.cancels, 1.0) } else { 1.0 };
    e.lr_no_gap.max(0.0).ln_1p() - e.lr_no_answer.max(0.0).ln_1p() + undone.ln()
}

/// How far PV follows OP within the gap; half where OP seldom went through it slowly.
fn within(e: &Evidence) -> f64 {
    if e.plateau.ways.iter().all(|ways| *ways >= CYCLES_IF_CLEAR) { e.plateau.within } else { 0.5 }
}

/// What the rules say before the evidence is weighed, from none seen to found: they know of evidence that counts for nothing where something
/// else holds, which no sum can say.
fn rung(e: &Evidence) -> f64 {
    match rules(e).0 {
        Confidence::NoneSeen => 0.0,
        Confidence::CannotTell => 1.0,
        Confidence::Likely => 2.0,
        Confidence::Found => 3.0,
    }
}

/// The height of a broken line of (x, y) in rising order of x; beyond its ends that of the end.
fn height(line: &[[f64; 2]], x: f64) -> f64 {
    let after = line.partition_point(|[at, _]| *at <= x);
    match (after.checked_sub(1).map(|i| line[i]), line.get(after)) {
        (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
        (Some([_, y]), None) | (None, Some(&[_, y])) => y,
        (None, None) => 0.0,
    }
}

impl Evidence {
    /// Name, value, whether a greater one speaks for a dead band, and log-odds of each quantity that is weighed.
    pub fn quantities(&self) -> impl Iterator<Item = (&'static str, f64, bool, f64)> {
        QUANTITIES.iter().zip(CURVES).map(|(quantity, (_, line))| {
            let x = (quantity.of)(self);
            (quantity.name, x, quantity.rises, height(line, x))
        })
    }

    /// Logarithm of the Bayes factor and what adds to it; None where no model of the loop explains PV, or PV does not answer OP.
    pub fn weighed(&self) -> Option<(f64, Terms)> {
        if self.autocorrelation.abs() > MAX_AUTOCORRELATION || self.lr_no_answer < LR_MIN {
            return None;
        }
        let mut terms = Terms::default();
        let mut sum = BASE;
        for (quantity, (.., worth)) in QUANTITIES.iter().zip(self.quantities()) {
            *(quantity.term)(&mut terms) += worth;
            sum += worth;
        }
        Some((sum, terms))
    }
}

/// The probability of a dead band by the logarithm of the Bayes factor, where a share `prior` of valves has one.
pub(super) fn probability(log_bayes_factor: f64, prior: f64) -> f64 {
    1.0 / (1.0 + (-(log_bayes_factor + (prior / (1.0 - prior)).ln())).exp())
}

impl Weighed {
    /// Of what all say, and the record that shows it best; None where that cannot be read.
    pub fn of(all: &Evidence, shown: &SegmentFit) -> Option<Self> {
        let (log_bayes_factor, terms) = all.weighed()?;
        let wider = match all.high {
            Some(high) if all.low > 0.0 && high > all.d => wider_by_limits(all.d, all.low, high),
            _ => wider_by_profile(shown),
        };
        Some(Self { log_bayes_factor, terms, wider })
    }

    /// The probability of a dead band where a share `prior` of valves has one.
    pub fn probability(&self, prior: f64) -> f64 {
        probability(self.log_bayes_factor, prior)
    }

    /// The probability of a dead band wider than `width`, where a share `prior` of valves has one.
    pub fn probability_beyond(&self, width: f64, prior: f64) -> f64 {
        self.probability(prior) * self.is_wider(width)
    }

    /// The probability that the dead band is wider than `width`, if there is one.
    pub fn is_wider(&self, width: f64) -> f64 {
        let line: Vec<[f64; 2]> = self.wider.iter().map(|(d, p)| [*d, *p]).collect();
        height(&line, width)
    }
}

/// Widths on either side of the most likely one, in standard deviations, that stand for all.
const PLACES: [f64; 9] = [-3.0, -2.0, -1.28, -0.67, 0.0, 0.67, 1.28, 2.0, 3.0];
/// Share of a normal distribution above each.
const ABOVE: [f64; 9] = [0.999, 0.977, 0.9, 0.75, 0.5, 0.25, 0.1, 0.023, 0.001];

/// A normal distribution on either side of the most likely width, the limits at 1.96 standard deviations.
fn wider_by_limits(d: f64, low: f64, high: f64) -> Vec<(f64, f64)> {
    let at = |place: f64| d + place / 1.96 * if place < 0.0 { d - low } else { high - d };
    PLACES.iter().zip(ABOVE).map(|(place, above)| (at(*place).max(0.0), above)).collect()
}

/// By the likelihood over the width of all families, each as likely as it explains PV; ln L is stretched as much as the limits are moved
/// out against those of a chi-square, and widths are as likely beforehand as their logarithms.
fn wider_by_profile(shown: &SegmentFit) -> Vec<(f64, f64)> {
    let stretch = RISE_OF_PROCESS / shown.rise.max(RISE_OF_PROCESS);
    let mut mass: Vec<(f64, f64)> = Vec::new();
    for candidate in &shown.candidates {
        for pair in candidate.profile.windows(2).filter(|pair| pair[0].0 > 0.0) {
            let [(from, one), (to, other)] = [pair[0], pair[1]];
            let density = |rise: f64| (-0.5 * stretch * (candidate.delta_deviance.max(0.0) + rise)).exp();
            mass.push(((from * to).sqrt(), 0.5 * (density(one) + density(other)) * (to / from).ln()));
        }
    }
    mass.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = mass.iter().map(|(_, of)| of).sum();
    let mut above = all;
    let mut wider = Vec::with_capacity(mass.len());
    for (d, of) in mass {
        above -= 0.5 * of;
        wider.push((d, (above / all.max(1e-300)).clamp(0.0, 1.0)));
        above -= 0.5 * of;
    }
    wider
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_goes_one_way_and_has_its_quantity() {
        assert_eq!(QUANTITIES.len(), CURVES.len());
        for (quantity, (name, line)) in QUANTITIES.iter().zip(CURVES) {
            assert_eq!(quantity.name, name);
            for pair in line.windows(2) {
                assert!(pair[0][0] < pair[1][0], "{name}");
                let rises = pair[1][1] - pair[0][1];
                assert!(if quantity.rises { rises >= 0.0 } else { rises <= 0.0 }, "{name}");
            }
        }
    }

    #[test]
    fn beyond_its_ends_a_line_is_level() {
        let line = [[0.0, -1.0], [2.0, 1.0], [3.0, 1.5]];
        let at = [-9.0, 0.0, 1.0, 2.0, 2.5, 3.0, 9.0].map(|x| height(&line, x));
        assert_eq!(at, [-1.0, -1.0, 0.0, 1.0, 1.25, 1.5, 1.5]);
        assert_eq!(height(&[], 1.0), 0.0);
    }

    #[test]
    fn the_prior_moves_the_odds_and_nothing_else() {
        let weighed = Weighed { log_bayes_factor: 3.0_f64.ln(), terms: Terms::default(), wider: Vec::new() };
        assert!((weighed.probability(0.5) - 0.75).abs() < 1e-12);
        assert!((weighed.probability(0.25) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_width_between_limits_is_wider_than_the_most_likely_one_in_half_of_cases() {
        let wider = wider_by_limits(2.0, 1.5, 3.0);
        let weighed = Weighed { log_bayes_factor: 0.0, terms: Terms::default(), wider };
        assert_eq!(weighed.is_wider(2.0), 0.5);
        assert!(weighed.is_wider(1.5) > 0.97 && weighed.is_wider(3.0) < 0.03);
        assert!((weighed.is_wider(9.0) - 0.001).abs() < 1e-12);
    }
}
