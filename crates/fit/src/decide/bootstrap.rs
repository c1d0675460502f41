//! How large the likelihood ratio of no gap gets by chance.

use crate::model::backlash_model::BacklashModel;
use crate::model::structure::Theta;
use crate::search::likelihood::{Point, Search};
use crate::search::screen::FINE_TOLERANCE;
use rayon::prelude::*;

/// Where the numbers by chance begin: the same record gets the same answer, in any unit.
const SEED: u64 = 1;
/// Records that are invented at first, and at each further turn.
const INVENTED: usize = 100;

/// The threshold of the likelihood ratio from records that the best model without a gap invents: innovations drawn
/// from its own, OP as recorded. So many that chance does not decide on which side of it `ratio` lies, at most
/// `most`.
pub(crate) fn bootstrap_threshold(search: &Search, without: &Point, ratio: f64, most: usize) -> f64 {
    let here = search.at(&without.theta, &search.record.positions(&without.lost));
    // Innovations over √S: the record's own, in units of which S is told.
    let scale = 1.0 / here.scale[0];
    let innovations: Vec<f64> = here.lane(0).iter().map(|r| r * scale).collect();
    let mut ratios: Vec<f64> = Vec::new();
    loop {
        let turn = ratios.len()..(ratios.len() + INVENTED).min(most);
        let draw = |i: usize| simulated_lr(search, without, &innovations, Draws::new(SEED, i as u64));
        ratios.par_extend(turn.into_par_iter().map(draw));
        let (threshold, error) = upper_percentile(&mut ratios);
        if ratios.len() >= most || (ratio - threshold).abs() > 3.0 * error {
            return threshold;
        }
    }
}

/// The likelihood ratio of no gap in one record that the model without a gap invents.
fn simulated_lr(search: &Search, without: &Point, innovations: &[f64], mut draws: Draws) -> f64 {
    let positions = search.record.positions(&without.lost);
    let mut draw = || innovations[(draws.next() % innovations.len() as u64) as usize];
    let ys = search.record.stretches.iter().zip(&positions).map(|(s, v)| {
        let kp_v: Vec<f64> = v.iter().map(|v| v * without.kp).collect();
        search.structure.simulate(&without.theta, &s.y, &s.changes, &kp_v, &mut draw)
    });
    let record = search.record.with(ys.collect());
    let search = Search { record: &record, ..*search };
    let with = |theta: Theta, part: f64, unless: f64| {
        let lost = BacklashModel { d: part * record.range, ..without.lost.clone() };
        search.from(&[(theta, lost)], 6, FINE_TOLERANCE, unless)
    };
    // The model that made the record is near the best for each width, and most widths are soon plainly worse.
    let mut none = with(without.theta, 0.0, f64::INFINITY);
    loop {
        let mut best = none.clone();
        for part in [0.03, 0.08, 0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95] {
            let point = with(none.theta, part, best.cost);
            if point.cost < best.cost {
                best = point;
            }
        }
        if best.lost.d == 0.0 {
            return 0.0;
        }
        // A better process found with a gap may be the better without one, too.
        let again = with(best.theta, 0.0, none.cost);
        if again.cost > none.cost - FINE_TOLERANCE {
            return none.cost - best.cost;
        }
        none = again;
    }
}

/// What one in a hundred of `ratios` exceeds, and its standard error; their order is lost. Few lie so high: so the fifth
/// of them that is largest, or all above 0 where these are fewer, is taken for the beginning of an exponential tail, as that of a
/// chi-square is. Nor is it less than what a scaled half of a chi-square with the same mean has there.
fn upper_percentile(ratios: &mut [f64]) -> (f64, f64) {
    ratios.sort_by(|a, b| b.total_cmp(a));
    let n = ratios.len() as f64;
    let most = ratios.len() / 5;
    let tail = &ratios[..ratios[..most].iter().filter(|r| **r > 0.0).count()];
    if tail.is_empty() {
        return (0.0, 0.0);
    }
    let (count, from) = (tail.len() as f64, if tail.len() == most { ratios[most] } else { 0.0 });
    let excess = tail.iter().map(|r| r - from).sum::<f64>() / count;
    let quantile = from + excess * (100.0 * count / n).ln().max(0.0);
    // Half a chi-square with one degree of freedom has the mean 1/2 and exceeds 5.41 once in a hundred records.
    let mean = ratios.iter().sum::<f64>() / n;
    let threshold = quantile.max(5.41 * mean / 0.5);
    (threshold, threshold / count.sqrt())
}

/// Numbers by chance, another row of them for each record (SplitMix64: Steele, Lea and Flood 2014).
pub(crate) struct Draws(u64);

impl Draws {
    pub(crate) fn new(seed: u64, record: u64) -> Self {
        // Begun beside each other, two rows would be the same numbers moved by one: where one begins is drawn, too.
        let mut draws = Self(seed);
        let mut begin = Self(draws.next() ^ record);
        Self(begin.next())
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// One of a standard normal distribution, but for its ends: the sum of twelve uniform numbers, less 6.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| (self.next() >> 11) as f64 / (1u64 << 53) as f64).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invented_records_share_no_noise() {
        let row = |record| {
            let mut draws = Draws::new(1, record);
            (0..50).map(|_| draws.next()).collect::<Vec<_>>()
        };
        let first = row(0);
        // Each was the one before, moved by a cell.
        for record in 1..40 {
            assert!(row(record).iter().all(|z| !first.contains(z)), "record {record}");
        }
    }

    #[test]
    fn what_one_in_a_hundred_exceeds_is_found_from_two_hundred() {
        let thresholds: Vec<f64> = (0..30)
            .map(|seed| {
                let mut draws = Draws::new(seed, 0);
                let mut ratios: Vec<f64> = (0..200).map(|_| half_chi_square(&mut draws)).collect();
                upper_percentile(&mut ratios).0
            })
            .collect();
        let mean = thresholds.iter().sum::<f64>() / 30.0;
        let spread = thresholds.iter().map(|t| (t - mean).powi(2)).sum::<f64>().sqrt() / 29f64.sqrt();
        assert!((5.0..6.5).contains(&mean), "{mean}");
        assert!(spread < 0.2 * mean, "{spread}");
    }

    /// A draw of half a chi-square with one degree of freedom: the square of a normal one where that is above 0.
    fn half_chi_square(draws: &mut Draws) -> f64 {
        draws.normal().max(0.0).powi(2)
    }
}
