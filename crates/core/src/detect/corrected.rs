//! The width with the bias of (2.4) taken out, from many half-periods together.

use crate::{Real, Reason, Span, SwingParts};

/// Facts of a half-period that [`pairs`] needs.
#[derive(Clone, Copy, Debug)]
pub struct Half<R> {
    /// First and last time.
    pub span: Span,
    /// +1 PV below SP, −1 above.
    pub sign: i8,
    /// All conditions that failed; 0 = accepted.
    pub mask: u16,
    /// Δy (2.2) [PV unit].
    pub delta_y: R,
    /// Travel and plateau.
    pub swing: SwingParts<R>,
}

/// OP's travel between two turns, and PV's way from one plateau to the next, which the valve's own move made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pair<R> {
    /// [OP unit].
    pub travel: R,
    /// [PV unit].
    pub way: R,
}

/// The corrected width, and with which process gain.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Corrected<R> {
    /// Total width [OP unit].
    pub d: R,
    /// Smallest and largest width: of the pairs that agree where Kp is known, else with any one pair left out.
    /// Repeatability, not an interval of confidence.
    pub low: R,
    /// Largest width, see `low`.
    pub high: R,
    /// |Kp| [PV unit/OP unit], as known or as found together with d.
    pub kp: R,
    /// Smallest and largest |Kp| with any one pair left out; none where it was known.
    pub kp_range: Option<(R, R)>,
}

named! {
    /// Why there is no corrected width.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
    #[repr(u8)]
    pub enum Doubt {
        /// Fewer pairs than [`FEWEST`], or than one more of them where Kp is not known.
        TooFew = 1 => "too_few",
        /// Kp is not known, and PV's ways are too much alike to tell it from d.
        Alike = 2 => "alike",
        /// A longer way of PV goes with a shorter travel of OP.
        WrongSlope = 3 => "wrong_slope",
        /// The pairs do not lie on a line, or do not agree.
        Scattered = 4 => "scattered",
        /// The valve moved further than the gap is wide: the gap is a small difference of large numbers.
        Swamped = 5 => "swamped",
        /// On line: the width is less than what noise moves OP by.
        Noise = 6 => "noise",
        /// On line: the process integrates, and does not come to rest off SP.
        Integrating = 7 => "integrating",
        /// On line: there is no estimate to correct.
        NoEstimate = 8 => "no_estimate",
        /// On line: OP is not known.
        NoOp = 9 => "no_op",
    }
}

/// Pairs that a result needs where Kp is known; where it is not, one more.
pub const FEWEST: usize = 3;

/// Plateaus that lie further above Δy than this were not reached.
const STEEPEST: f64 = 1.4;

/// Relative distance from their median within which widths agree; their scatter is the only sign of a wandering load.
const AGREE: f64 = 0.1;

/// Pairs of the accepted half-periods among `halves`, which are in the order of time: those with a travel, between
/// neighbours that are whole, and with a plateau that PV reached here and in the half-period after.
pub fn pairs<R: Real>(halves: &[Half<R>]) -> impl Iterator<Item = Pair<R>> {
    const BROKEN: [Reason; 5] = [Reason::Gap, Reason::BadQuality, Reason::NotAuto, Reason::Saturated, Reason::SpMoved];
    let broken = |half: &Half<R>| BROKEN.iter().any(|reason| half.mask & reason.bit() != 0);
    halves.windows(3).filter_map(move |three| {
        let [before, here, after] = three else { return None };
        let whole = here.mask == 0 && !broken(before) && !broken(after) && after.mask & Reason::TooShort.bit() == 0;
        let follow = before.span.end == here.span.start && here.span.end == after.span.start;
        let way = here.swing.plateau + after.swing.plateau;
        let reached = way <= R::of(STEEPEST) * (here.delta_y + after.delta_y);
        if !(whole && follow && after.sign == -here.sign && reached) {
            return None;
        }
        here.swing.travel.map(|travel| Pair { travel, way })
    })
}

/// Width by `travel = d + way/Kp`.
///
/// With a known `kp` each pair gives a width. Two thirds of them must lie within 90–110 % of their median; the mean of those
/// is d.
///
/// Without, d and Kp come together, from the line through the pairs. OP is what the controller put out and has no error;
/// the error is in PV's way (load, noise, a plateau not quite reached). So it is the way that is regressed on the travel,
/// which is the line of known errors (Deming's) with the ratio 0. Regressing the travel on the way would flatten the line
/// and overstate d. Where leaving out one pair moves d by more than a fifth, or the correlation is below √0.9, nothing is
/// said.
///
/// The order of `pairs` changes.
pub fn corrected<R: Real>(pairs: &mut [Pair<R>], kp: Option<R>) -> Result<Corrected<R>, Doubt> {
    let known = kp.map(R::magnitude).filter(|kp| *kp > R::ZERO && kp.is_number());
    match known {
        Some(kp) => with_gain(pairs, kp),
        None => together(pairs),
    }
}

/// Corrected width with a known Kp.
fn with_gain<R: Real>(pairs: &mut [Pair<R>], kp: R) -> Result<Corrected<R>, Doubt> {
    if pairs.len() < FEWEST {
        return Err(Doubt::TooFew);
    }
    let width = |pair: &Pair<R>| pair.travel - pair.way / kp;
    let middle = median(pairs, width);
    if middle <= R::ZERO || middle < median(pairs, |pair| pair.way / kp) {
        return Err(Doubt::Swamped);
    }
    let (mut sum, mut kept, mut low, mut high) = (R::ZERO, 0usize, middle, middle);
    for d in pairs.iter().map(width).filter(|d| (*d - middle).magnitude() <= R::of(AGREE) * middle) {
        sum += d;
        kept += 1;
        (low, high) = (low.lesser(d), high.greater(d));
    }
    if 3 * kept < 2 * pairs.len() {
        return Err(Doubt::Scattered);
    }
    Ok(Corrected { d: sum / R::of(kept as f64), low, high, kp, kp_range: None })
}

/// Corrected width and Kp together, by a line through the pairs.
fn together<R: Real>(pairs: &mut [Pair<R>]) -> Result<Corrected<R>, Doubt> {
    if pairs.len() <= FEWEST {
        return Err(Doubt::TooFew);
    }
    let middle = median(pairs, |pair| pair.way);
    let (shortest, longest) = (pairs[0].way, pairs[pairs.len() - 1].way);
    if longest < R::of(1.5) * shortest {
        return Err(Doubt::Alike);
    }
    let all = Sums::of(pairs);
    let (d, per_way) = all.line()?;
    if d <= R::ZERO || d < per_way * middle {
        return Err(Doubt::Swamped);
    }
    let (mut low, mut high) = (d, d);
    let (mut least, mut most) = (R::ONE / per_way, R::ONE / per_way);
    for pair in pairs.iter() {
        let (d, per_way) = all.without(pair).line().map_err(|_| Doubt::Scattered)?;
        (low, high) = (low.lesser(d), high.greater(d));
        (least, most) = (least.lesser(R::ONE / per_way), most.greater(R::ONE / per_way));
    }
    if low < R::of(0.8) * d || high > R::of(1.2) * d {
        return Err(Doubt::Scattered);
    }
    Ok(Corrected { d, low, high, kp: R::ONE / per_way, kp_range: Some((least, most)) })
}

/// Sorts the pairs by a quantity and gives its median. There are few: by insertion, since a sort for many is 28 kB more
/// code in a controller.
fn median<R: Real>(pairs: &mut [Pair<R>], of: impl Fn(&Pair<R>) -> R) -> R {
    for i in 1..pairs.len() {
        let (pair, mut at) = (pairs[i], i);
        while at > 0 && of(&pairs[at - 1]) > of(&pair) {
            pairs[at] = pairs[at - 1];
            at -= 1;
        }
        pairs[at] = pair;
    }
    let half = pairs.len() / 2;
    let upper = of(&pairs[half]);
    if pairs.len() % 2 == 1 { upper } else { (of(&pairs[half - 1]) + upper) / (R::ONE + R::ONE) }
}

/// Sums over pairs, taken from one of them so that none is a small difference of large ones.
struct Sums<R> {
    origin: Pair<R>,
    n: R,
    travel: R,
    way: R,
    travel_travel: R,
    way_way: R,
    travel_way: R,
}

impl<R: Real> Sums<R> {
    fn of(pairs: &[Pair<R>]) -> Self {
        let zero = R::ZERO;
        let origin = pairs[pairs.len() / 2];
        let none =
            Self { origin, n: zero, travel: zero, way: zero, travel_travel: zero, way_way: zero, travel_way: zero };
        pairs.iter().fold(none, |sums, pair| sums.plus(pair, R::ONE))
    }

    fn plus(&self, pair: &Pair<R>, weight: R) -> Self {
        let (travel, way) = (pair.travel - self.origin.travel, pair.way - self.origin.way);
        Self {
            origin: self.origin,
            n: self.n + weight,
            travel: self.travel + weight * travel,
            way: self.way + weight * way,
            travel_travel: self.travel_travel + weight * travel * travel,
            way_way: self.way_way + weight * way * way,
            travel_way: self.travel_way + weight * travel * way,
        }
    }

    fn without(&self, pair: &Pair<R>) -> Self {
        self.plus(pair, -R::ONE)
    }

    /// Travel where the way is 0, and travel per way.
    fn line(&self) -> Result<(R, R), Doubt> {
        let travel_travel = self.travel_travel - self.travel * self.travel / self.n;
        let way_way = self.way_way - self.way * self.way / self.n;
        let travel_way = self.travel_way - self.travel * self.way / self.n;
        if travel_way <= R::ZERO {
            return Err(Doubt::WrongSlope);
        }
        let square = travel_way * travel_way;
        if !square.is_number() || square < R::of(0.9) * travel_travel * way_way {
            return Err(Doubt::Scattered);
        }
        let per_way = travel_travel / travel_way;
        let travel = self.origin.travel + self.travel / self.n;
        let way = self.origin.way + self.way / self.n;
        Ok((travel - per_way * way, per_way))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Travels of 1 + way/2, with errors in the way that the fixed sequence gives.
    fn made(n: usize, error: f64) -> Vec<Pair<f64>> {
        (0..n)
            .map(|i| {
                let way = 0.2 + 1.3 * (i as f64 * 0.618_034).fract();
                let noise = (i as f64 * 0.754_877_67 + 0.3).fract() - 0.5;
                Pair { travel: 1.0 + way / 2.0, way: way + error * noise }
            })
            .collect()
    }

    #[test]
    fn exact_pairs_give_d_and_kp() {
        let found = corrected(&mut made(12, 0.0), None).unwrap();
        assert!((found.d - 1.0).abs() < 1e-12 && (found.kp - 2.0).abs() < 1e-12, "{found:?}");
        let known = corrected(&mut made(12, 0.0), Some(-2.0)).unwrap();
        assert!((known.d - 1.0).abs() < 1e-12 && known.kp == 2.0, "{known:?}");
        assert_eq!(known.kp_range, None);
    }

    #[test]
    fn errors_in_the_way_do_not_bias_it_as_they_bias_ordinary_least_squares() {
        let mut pairs = made(2000, 0.4);
        let sums = Sums::of(&pairs);
        let slope = (sums.travel_way - sums.travel * sums.way / sums.n) / (sums.way_way - sums.way * sums.way / sums.n);
        let ordinary = sums.origin.travel + sums.travel / sums.n - slope * (sums.origin.way + sums.way / sums.n);
        let found = corrected(&mut pairs, None).unwrap();
        assert!((found.d - 1.0).abs() < 0.01, "{found:?}");
        assert!((found.kp - 2.0).abs() < 0.05, "{found:?}");
        assert!(ordinary > 1.025, "{ordinary}: the line of ordinary least squares is flat and its d too high");
        assert!(found.low <= found.d && found.d <= found.high);
    }

    #[test]
    fn what_cannot_be_told_is_refused_with_its_reason() {
        let refused = |mut pairs: Vec<Pair<f64>>, kp| corrected(&mut pairs, kp).unwrap_err();
        assert_eq!(refused(made(2, 0.0), Some(2.0)), Doubt::TooFew);
        assert_eq!(refused(made(3, 0.0), None), Doubt::TooFew);
        let alike = (0..9).map(|i| Pair { travel: 1.1 + 0.001 * f64::from(i), way: 0.2 + 0.002 * f64::from(i) });
        assert_eq!(refused(alike.collect(), None), Doubt::Alike);
        let falling = made(9, 0.0).iter().map(|p| Pair { travel: 2.0 - p.way / 2.0, way: p.way }).collect();
        assert_eq!(refused(falling, None), Doubt::WrongSlope);
        assert_eq!(refused(made(30, 3.0), None), Doubt::Scattered);
        let swamped = |p: &Pair<f64>| Pair { travel: p.travel + 5.0, way: p.way + 10.0 };
        assert_eq!(refused(made(9, 0.0).iter().map(swamped).collect(), Some(2.0)), Doubt::Swamped);
        let apart = (0..9).map(|i| Pair { travel: 1.0 + 0.3 * f64::from(i % 3), way: 0.1 });
        assert_eq!(refused(apart.collect(), Some(2.0)), Doubt::Scattered);
    }

    #[test]
    fn a_line_of_numbers_too_large_is_refused() {
        let of = |pair: &Pair<f64>| Pair { travel: 1e10 * pair.travel as f32, way: 1e10 * pair.way as f32 };
        assert_eq!(corrected(&mut made(9, 0.0).iter().map(of).collect::<Vec<_>>(), None), Err(Doubt::Scattered));
    }

    #[test]
    fn one_pair_that_makes_the_line_is_not_believed() {
        let mut pairs: Vec<Pair<f64>> =
            (0..6).map(|i| Pair { travel: 1.0, way: 0.30 + 0.001 * f64::from(i) }).collect();
        pairs.push(Pair { travel: 1.15, way: 0.60 });
        assert_eq!(corrected(&mut pairs, None), Err(Doubt::Scattered));
    }

    #[test]
    fn it_scales_with_its_units() {
        let scaled = |p: &Pair<f64>| Pair { travel: 8.0 * p.travel, way: 4.0 * p.way };
        let found = corrected(&mut made(40, 0.1), None).unwrap();
        let other = corrected(&mut made(40, 0.1).iter().map(scaled).collect::<Vec<_>>(), None).unwrap();
        assert!((other.d - 8.0 * found.d).abs() < 1e-12 && (other.kp - found.kp / 2.0).abs() < 1e-12);
    }

    fn half(sign: i8, mask: u16, at: f64) -> Half<f64> {
        let swing = SwingParts { travel: Some(2.0), plateau: 1.1 };
        Half { span: Span { start: at, end: at + 1.0 }, sign, mask, delta_y: 1.0, swing }
    }

    #[test]
    fn only_whole_neighbours_make_a_pair() {
        let three = |masks: [u16; 3]| [half(1, masks[0], 0.0), half(-1, masks[1], 1.0), half(1, masks[2], 2.0)];
        let count = |halves: &[Half<f64>]| pairs(halves).count();
        let one = pairs(&three([0; 3])).next().unwrap();
        assert_eq!((one.travel, one.way), (2.0, 2.2));
        let uneven = Reason::Uneven.bit();
        assert_eq!(count(&three([uneven, 0, uneven])), 1);
        for reason in [Reason::Gap, Reason::BadQuality, Reason::NotAuto, Reason::Saturated, Reason::SpMoved] {
            assert_eq!(count(&three([reason.bit(), 0, 0])), 0);
            assert_eq!(count(&three([0, 0, reason.bit()])), 0);
        }
        assert_eq!(count(&three([Reason::TooShort.bit(), 0, 0])), 1);
        assert_eq!(count(&three([0, 0, Reason::TooShort.bit()])), 0);
        assert_eq!(count(&three([0, uneven, 0])), 0);
        let mut apart = three([0; 3]);
        apart[2].span = Span { start: 5.0, end: 6.0 };
        assert_eq!(count(&apart), 0);
        let mut steep = three([0; 3]);
        steep[2].swing.plateau = 1.71;
        assert_eq!(count(&steep), 0);
    }
}
