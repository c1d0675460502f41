//! Width of a valve's gap from OP and the valve's own recorded position.
//!
//! ```text
//! OP ──→ lost motion d, J ──→ delay, lag ──→ a + b·v ──→ (+) ──→ recorder ──→ POSITION
//!                                                         ↑
//!                                                       noise
//! ```
//!
//! Neither a process nor a load lies between, so that no filter is needed: for given d, J, delay and lag the rest is a straight
//! line, and its squares are summed in one pass, eight sets of parameters at once. What lies between instead is the recorder, which
//! can look like a gap by itself: a position that is kept until it has moved by a band lags behind on both ways as one in a gap does.
//! So the recorder is looked at first. Only rows in which a position kept so was written anew count, for there it is true;
//! spikes do not count; and what rounding, OP's own moves between two rows and the band may hide widens the interval.

mod answer;
mod search;
mod track;

use crate::data::recorder::Recorder;
use crate::data::samples::{Samples, Unfit};
use crate::data::segment::OpAndPv;
use crate::decide::combine::{Combined, Reading, combine};
use crate::decide::joint::{SegmentAnswer, newest};
use crate::decide::judgement::Verdict;
use crate::decide::trend::Trend;
use crate::position::track::{FEWEST, Track};
use crate::problem::records;

/// Result of the valve's position.
#[derive(Clone, Debug)]
pub struct AtValve {
    /// Verdict on the valve; never more than [`Verdict::AtLeast`] where the valve turned but once.
    pub verdict: Verdict,
    /// Why, a word that `glapp` turns into a sentence.
    pub reason: &'static str,
    /// Most likely total width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where the record gives none.
    pub high: Option<f64>,
    /// Slip jump J [OP unit], 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap against the best width, times `information_ratio`.
    pub lr_no_gap: f64,
    /// Likelihood ratio that a gap needs.
    pub lr_needed: f64,
    /// Likelihood ratio of J = 0 against the best J, times `information_ratio`.
    pub lr_no_jump: f64,
    /// Share of the likelihood's own information on d that remains where the residual is alike from row to row.
    pub information_ratio: f64,
    /// Allowed rise of −2·ln L within the interval.
    pub rise: f64,
    /// Times that the valve began to move up, and down.
    pub traversals: [usize; 2],
    /// Position per OP [position unit/OP unit].
    pub gain: f64,
    /// Rows by which the position is behind OP as a whole; negative where OP is the older.
    pub delay: isize,
    /// Lag of the actuator [rows].
    pub lag: f64,
    /// Standard deviation of the residual [position unit].
    pub sigma: f64,
    /// Share of the position's variance that the model explains.
    pub explained: f64,
    /// Recorder of the position.
    pub recorder: Recorder,
    /// Rows that count, and spikes that do not.
    pub rows: usize,
    /// See `rows`.
    pub spikes: usize,
    /// Widest move of OP [OP unit].
    pub range: f64,
    /// Width [OP unit] and −2·Δln L over the best, times `information_ratio`.
    pub profile: Vec<(f64, f64)>,
    /// Rows beside the model, 8000 or so of them.
    pub shown: Vec<Shown>,
}

/// A row beside the model.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Part of the record, in the order given.
    pub part: usize,
    /// Row within it.
    pub row: usize,
    /// Position as recorded [position unit].
    pub recorded: f64,
    /// The model's [position unit].
    pub predicted: f64,
    /// Position of the valve [OP unit].
    pub valve: f64,
}

/// Result of the positions of several records together.
#[derive(Clone, Debug)]
pub struct PositionAnswer {
    /// The verdict.
    pub verdict: Verdict,
    /// Width [OP unit].
    pub d: f64,
    /// Lower limit, 95 % [OP unit].
    pub low: f64,
    /// Upper limit, 95 % [OP unit]; None where there is none.
    pub high: Option<f64>,
    /// Change of the width, where three records or more give one. Where it is plain that the width changes, all the rest is what
    /// the newest record says that gives a width.
    pub trend: Option<Trend>,
    /// The records, in the order given.
    pub records: Vec<SegmentAnswer<AtValve>>,
    /// Place of the record that shows best what all say.
    pub shown: usize,
}

/// The width from valve positions, each in the place of PV, and OP.
///
/// # Errors
///
/// Where the positions are OP once more, or nothing can be fitted.
pub fn fit_position(samples: &[Samples]) -> Result<PositionAnswer, Unfit> {
    if copied(samples) {
        return Err(Unfit::Copy);
    }
    let records: Vec<SegmentAnswer<AtValve>> = records(samples)?
        .iter()
        .filter_map(|record| Some(SegmentAnswer::of(record, at_valve(&record.signals())?)))
        .collect();
    let reading = |r: &SegmentAnswer<AtValve>| {
        let AtValve { verdict, d, low, high, lr_no_gap, .. } = r.answer;
        Reading { verdict, d, low, high, lr_no_gap, t: r.middle() }
    };
    let readings: Vec<Reading> = records.iter().map(reading).collect();
    let Combined { verdict, d, low, high } = combine(&readings).ok_or(Unfit::Few)?;
    let trend = Trend::of_readings(&readings);
    if let Some(shown) = newest(trend, &readings) {
        let Reading { verdict, d, low, high, .. } = readings[shown];
        return Ok(PositionAnswer { verdict, d, low, high, trend, records, shown });
    }
    let agree = (0..readings.len()).filter(|i| readings[*i].verdict == verdict).rev();
    let shown = agree.max_by(|a, b| readings[*a].lr_no_gap.total_cmp(&readings[*b].lr_no_gap)).unwrap_or(0);
    Ok(PositionAnswer { verdict, d, low, high, trend, records, shown })
}

/// Whether the recorded position is OP in every row that has both.
fn copied(samples: &[Samples]) -> bool {
    let mut compared = false;
    for Samples { pv, op, .. } in samples {
        let both = op.unwrap_or(&[]).iter().zip(*pv).filter(|(u, z)| u.is_finite() && z.is_finite());
        for (u, z) in both {
            if u != z {
                return false;
            }
            compared = true;
        }
    }
    compared
}

/// The width from `parts` of (position, OP) at even steps, one for each unbroken stretch; NaN in the position is a row
/// without it, OP is without NaN. None where fewer than 50 rows have a position or OP does not move.
fn at_valve(parts: &[OpAndPv]) -> Option<AtValve> {
    let track = Track::new(parts);
    if track.count() < FEWEST || track.range <= 0.0 {
        return None;
    }
    Some(track.answer())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::{Friction, FrictionState, Model};

    /// An output that wanders between turns of many sizes, and noise, both by chance.
    fn output(n: usize, seed: u64) -> (Vec<f64>, impl FnMut() -> f64) {
        let mut state = seed;
        let mut uniform = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut slow = 0.0;
        let u = (0..n)
            .map(|k| {
                slow = 0.98 * slow + uniform();
                50.0 + 4.0 * (k as f64 * 0.021).sin() + 0.5 * slow
            })
            .collect();
        (u, uniform)
    }

    fn valve(u: &[f64], d: f64, jump: f64) -> Vec<f64> {
        let friction = Friction::new(Model::Kano, d, jump).unwrap();
        let mut state = FrictionState::at(u[0]);
        u.iter().map(|&u| friction.update(&mut state, u)).collect()
    }

    /// Written only once it has moved by more than `band`.
    fn kept(x: &[f64], band: f64) -> Vec<f64> {
        let mut last = x[0];
        let write = |x: &f64| {
            if (x - last).abs() > band {
                last = *x;
            }
            last
        };
        x.iter().map(write).collect()
    }

    fn asked(z: &[f64], u: &[f64]) -> AtValve {
        at_valve(&[(z, u)]).unwrap()
    }

    #[test]
    fn the_width_is_found_whatever_the_recorder_does() {
        for d in [0.3, 1.5] {
            let (u, mut noise) = output(3000, 7);
            // Another span, reverse acting.
            let z: Vec<f64> = valve(&u, d, 0.0).iter().map(|v| 90.0 - 0.7 * v).collect();
            let noisy: Vec<f64> = z.iter().map(|z| z + 0.1 * noise()).collect();
            let spiky: Vec<f64> = noisy.iter().map(|z| if noise() > 0.49 { z + 30.0 * noise() } else { *z }).collect();
            let rounded: Vec<f64> = z.iter().map(|z| (z / 0.1).round() * 0.1).collect();
            let missing: Vec<f64> = noisy.iter().map(|z| if noise() > 0.3 { f64::NAN } else { *z }).collect();
            let late: Vec<f64> = (0..z.len()).map(|k| z[k.saturating_sub(3)] + 0.05 * noise()).collect();
            for (name, z) in [
                ("plain", &z),
                ("noisy", &noisy),
                ("spiky", &spiky),
                ("rounded", &rounded),
                ("missing", &missing),
                ("late", &late),
            ] {
                let a = asked(z, &u);
                assert_eq!(a.verdict, Verdict::Backlash, "{name} {a:?}");
                let high = a.high.unwrap();
                assert!(a.low <= d && d <= high && high - a.low < 0.5, "{name} {d}: {} to {high}", a.low);
                assert!((a.gain + 0.7).abs() < 0.01, "{name}: {}", a.gain);
                assert_eq!(a.delay, if name == "late" { 3 } else { 0 }, "{name}");
            }
        }
    }

    #[test]
    fn a_position_kept_until_it_has_moved_by_a_band_shows_no_gap() {
        let (u, mut noise) = output(3000, 11);
        let z: Vec<f64> = u.iter().map(|u| u + 0.01 * noise()).collect();
        let a = asked(&kept(&z, 0.5), &u);
        assert_eq!(a.verdict, Verdict::Sound, "{a:?}");
        assert!(matches!(a.recorder, Recorder::Kept(band) if (band - 0.5).abs() < 0.05));
        // A width that the band may hide is not excluded.
        assert!(a.high.unwrap() >= 0.5);
        let worn = asked(&kept(&valve(&u, 1.5, 0.0), 0.5), &u);
        assert_eq!(worn.verdict, Verdict::Backlash, "{worn:?}");
        assert!(worn.low <= 1.5 && worn.high.unwrap() >= 1.5 && worn.low > 1.3, "{worn:?}");
    }

    #[test]
    fn a_position_that_was_written_anew_a_few_times_tells_nothing() {
        // Nine new values: how they were kept does not show, and all rows between them would look like a gap as wide as the band.
        let (u, mut noise) = output(3000, 11);
        let u: Vec<f64> = u[..800].iter().map(|u| 50.0 + 0.17 * (u - 50.0)).collect();
        let z: Vec<f64> = valve(&u, 0.2, 0.0).iter().map(|v| v + 0.001 * noise()).collect();
        let z = kept(&z, 0.5);
        let new = z.windows(2).filter(|w| w[0] != w[1]).count();
        assert!((5..12).contains(&new), "{new}");
        assert!(at_valve(&[(&z, &u)]).is_none(), "{:?}", at_valve(&[(&z, &u)]).map(|a| (a.verdict, a.d, a.low)));
    }

    #[test]
    fn without_a_gap_none_is_claimed() {
        for seed in 0..6 {
            let (u, mut noise) = output(1500, seed);
            let size = [0.02, 0.2, 1.0][seed as usize % 3];
            let z: Vec<f64> = u.iter().map(|u| u + size * noise()).collect();
            let a = asked(&z, &u);
            assert_eq!(a.verdict, Verdict::Sound, "{seed} {a:?}");
        }
    }

    #[test]
    fn a_slow_actuator_is_no_gap() {
        let (u, mut noise) = output(3000, 3);
        let mut at = u[0];
        let z: Vec<f64> = u
            .iter()
            .map(|u| {
                at += 0.3 * (u - at);
                at + 0.02 * noise()
            })
            .collect();
        let a = asked(&z, &u);
        assert_eq!(a.verdict, Verdict::Sound, "{a:?}");
        assert!((a.lag - 1.0 / (1.0f64 / 0.7).ln()).abs() < 0.2, "{}", a.lag);
    }

    #[test]
    fn a_slip_jump_is_told_from_a_gap() {
        let (u, mut noise) = output(3000, 5);
        let noisy =
            |z: Vec<f64>, noise: &mut dyn FnMut() -> f64| z.iter().map(|z| z + 0.05 * noise()).collect::<Vec<_>>();
        let both = asked(&noisy(valve(&u, 2.0, 0.8), &mut noise), &u);
        assert_eq!(both.verdict, Verdict::Both, "{both:?}");
        assert!((both.jump - 0.8).abs() < 0.15 && both.low <= 2.0 && both.high.unwrap() >= 2.0, "{both:?}");
        let gap = asked(&noisy(valve(&u, 2.0, 0.0), &mut noise), &u);
        assert_eq!((gap.verdict, gap.jump), (Verdict::Backlash, 0.0), "{gap:?}");
    }

    #[test]
    fn op_once_more_and_another_signal_tell_nothing() {
        let (u, mut noise) = output(1000, 1);
        let scaled: Vec<f64> = u.iter().map(|u| 3.0 * u + 1.0).collect();
        assert_eq!(asked(&scaled, &u).reason, "copy");
        let other: Vec<f64> = (0..u.len()).map(|_| noise()).collect();
        assert_eq!(asked(&other, &u).reason, "no_answer");
        assert_eq!(asked(&vec![20.0; u.len()], &u).reason, "no_answer");
        assert!(at_valve(&[(&u[..30], &u[..30])]).is_none());
        assert!(at_valve(&[(&other, &vec![50.0; u.len()])]).is_none());
    }

    #[test]
    fn many_rows_tell_the_same_as_few_and_more_exactly() {
        let (u, mut noise) = output(60_000, 9);
        let z: Vec<f64> = valve(&u, 1.0, 0.0).iter().map(|z| z + 0.5 * noise()).collect();
        let (few, many) = (asked(&z[..2000], &u[..2000]), asked(&z, &u));
        assert_eq!(many.verdict, Verdict::Backlash, "{many:?}");
        assert!(many.low <= 1.0 && many.high.unwrap() >= 1.0, "{} {:?}", many.low, many.high);
        assert!(many.high.unwrap() - many.low <= few.high.unwrap() - few.low);
    }
}
