//! Recorder of a position: a recorder can look like a gap by itself.

use crate::data::segment::OpAndPv;

/// Kind of recorder of the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Recorder {
    /// Every row as it was.
    Plain,
    /// Rounded to steps of this size [position unit].
    Rounded(f64),
    /// Kept until it has moved by this band [position unit].
    Kept(f64),
}

/// Moves of a signal from row to row.
pub(crate) struct Moves {
    /// The least move, but for one in two hundred.
    pub(crate) least: f64,
    /// The band it must move by to be written, 0 where none shows.
    pub(crate) band: f64,
    pub(crate) median: f64,
    /// Whether it rests but for so few moves that none of them tells how it was kept.
    few: bool,
    /// The step of which all its values are multiples, 0 for none.
    step: f64,
}

/// Fewest new values of a signal that is kept until it has moved by a band.
pub(crate) const FEWEST_NEW: usize = 12;

/// Ratio of moves above an edge (up to twice the edge) to moves below it; without an edge there are as many.
const SHARP: f64 = 8.0;

impl Moves {
    pub(crate) fn of(signals: &[&[f64]]) -> Self {
        let mut moves = Vec::new();
        let mut pairs = 0;
        for signal in signals {
            let mut last = f64::NAN;
            for &x in signal.iter().filter(|x| !x.is_nan()) {
                if !last.is_nan() {
                    pairs += 1;
                    if x != last {
                        moves.push((x - last).abs());
                    }
                }
                last = x;
            }
        }
        let moved = moves.len();
        if moved == 0 {
            return Self { least: 0.0, band: 0.0, median: 0.0, few: false, step: 0.0 };
        }
        moves.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| moves[(moved as f64 * share) as usize];
        // Rows in which it rests are moves of nothing.
        let rests = pairs - moved;
        let median = if 2 * rests >= pairs { 0.0 } else { moves[pairs / 2 - rests] };
        // A signal kept until it has moved by a band rests at times and has no small moves, but a few where it is written for
        // another reason.
        let sharp = |share: &f64| {
            let edge = at(*share);
            let below = (moved as f64 * share).max(1.0);
            (moves.partition_point(|m| *m < 2.0 * edge) as f64 - below) > SHARP * below
        };
        let edge = [0.0, 0.001, 0.005, 0.02, 0.05].into_iter().find(sharp).map(at);
        let band = if rests * 50 > pairs { edge.unwrap_or(0.0) } else { 0.0 };
        // Rounded values are multiples of the step themselves; what is kept until it has moved by a band begins anywhere.
        let least = at(0.005);
        let whole = |x: f64| (x / least - (x / least).round()).abs() < 1e-3;
        let values = || signals.iter().flat_map(|s| s.iter().copied()).filter(|x| !x.is_nan());
        let on_steps = values().filter(|x| whole(*x)).count() as f64 > 0.98 * values().count() as f64;
        let few = moved < FEWEST_NEW && 10 * moved < pairs;
        Self { least, band, median, few, step: if on_steps { least } else { 0.0 } }
    }

    /// Recorder of the position; `by_op` is the least move that OP makes of it.
    pub(crate) fn recorder(&self, by_op: f64, span: f64) -> Recorder {
        if self.least < 1e-5 * span && self.band < 1e-5 * span {
            Recorder::Plain
        } else if self.step > 0.0 {
            Recorder::Rounded(self.step)
        } else if self.few || self.band > 2.0 * by_op {
            Recorder::Kept(self.band.max(self.least))
        } else {
            Recorder::Plain
        }
    }
}

/// Every row but those in which the position is new becomes none.
pub(crate) fn only_new(z: &mut [f64]) {
    let mut last = f64::NAN;
    for z in z {
        let new = !z.is_nan() && *z != last && !last.is_nan();
        if !z.is_nan() {
            last = *z;
        }
        if !new {
            *z = f64::NAN;
        }
    }
}

/// Distance of each row from the median of itself and its neighbours.
fn off_neighbours(z: &[f64]) -> impl Iterator<Item = (usize, f64)> + '_ {
    z.windows(3).enumerate().filter(|(_, w)| w.iter().all(|z| !z.is_nan())).map(|(k, w)| {
        let middle = w[0].max(w[1]).min(w[0].min(w[1]).max(w[2]));
        (k + 1, (w[1] - middle).abs())
    })
}

/// Distance from its neighbours from which a row is no value of the valve's.
pub(crate) fn spike_limit(parts: &[OpAndPv]) -> f64 {
    let mut off: Vec<f64> = parts.iter().flat_map(|(z, _)| off_neighbours(z).map(|(_, off)| off)).collect();
    let mut all: Vec<f64> = parts.iter().flat_map(|(z, _)| z.iter().copied()).filter(|z| !z.is_nan()).collect();
    if off.is_empty() || all.is_empty() {
        return f64::INFINITY;
    }
    let broad = quantile(&mut all, 0.99) - quantile(&mut all, 0.01);
    let noise = 8.0 * quantile(&mut off, 0.9);
    // A rounded position goes to and fro by a step.
    off.retain(|off| *off > 0.0);
    let step = if off.is_empty() { 0.0 } else { quantile(&mut off, 0.1) };
    noise.max(4.0 * step).max(0.02 * broad)
}

/// Rows farther than `limit` from their neighbours.
pub(crate) fn spikes_in(z: &[f64], limit: f64) -> Vec<usize> {
    off_neighbours(z).filter(|(_, off)| *off > limit).map(|(k, _)| k).collect()
}

/// The `share` quantile; the order of `x` is lost.
pub(crate) fn quantile(x: &mut [f64], share: f64) -> f64 {
    let at = ((x.len() as f64 * share) as usize).min(x.len() - 1);
    *x.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Largest less smallest value, NaN left out.
pub(crate) fn span(x: &[f64]) -> f64 {
    let numbers = || x.iter().copied().filter(|x| !x.is_nan());
    (numbers().fold(f64::MIN, f64::max) - numbers().fold(f64::MAX, f64::min)).max(0.0)
}
