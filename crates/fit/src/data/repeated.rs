//! Rows that stand in an earlier recording already: exports replay each other under other dates.

use crate::data::samples::Samples;
use crate::decide::thresholds::{REPEATED_LEVELS, REPEATED_ROWS};
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// One recording of a valve: its rows, or those of its windows.
#[derive(Clone, Debug)]
pub struct Recorded<'a> {
    /// Time 0 of the recording, on a clock that all recordings share [s]; NaN where that is not known.
    pub since: f64,
    /// Rows in one piece, or the windows that were kept of a long history.
    pub samples: Vec<Samples<'a>>,
}

/// Rows of a recording that count, each once.
pub(crate) struct Once {
    /// PV of each of its samples, NaN in rows that stand in an earlier recording.
    pub(crate) pv: Vec<Vec<f64>>,
    /// Share of its rows that do.
    pub(crate) repeated: f64,
}

/// The recordings, in the order of time, without the rows that repeat those before them.
///
/// Rows in a row are the same where PV and OP are, to the last digit, and PV takes some values among them: noise does not come
/// back so.
pub(crate) fn once(recordings: &[Recorded]) -> Vec<Once> {
    let mut known = HashSet::new();
    let mut all = Vec::with_capacity(recordings.len());
    for recording in recordings {
        let marks: Vec<Vec<Option<u64>>> = recording.samples.iter().map(marks).collect();
        let mut pv: Vec<Vec<f64>> = recording.samples.iter().map(|samples| samples.pv.to_vec()).collect();
        let (mut rows, mut repeated) = (0, 0);
        for (pv, marks) in pv.iter_mut().zip(&marks) {
            let mut until = 0;
            for k in 0..pv.len() {
                if marks.get(k).is_some_and(|mark| mark.is_some_and(|mark| known.contains(&mark))) {
                    until = k + REPEATED_ROWS;
                }
                if k < until {
                    pv[k] = f64::NAN;
                    repeated += 1;
                }
            }
            rows += pv.len();
        }
        known.extend(marks.into_iter().flatten().flatten());
        all.push(Once { pv, repeated: repeated as f64 / rows.max(1) as f64 });
    }
    all
}

/// Hash of the [`REPEATED_ROWS`] rows that begin at each row, to find rows that are the same; None where one is missing
/// or PV hardly moves.
fn marks(samples: &Samples) -> Vec<Option<u64>> {
    let Some(op) = samples.op else { return Vec::new() };
    let of = |(pv, op): (&[f64], &[f64])| {
        let mut levels: Vec<u64> = pv.iter().map(|y| y.to_bits()).collect();
        levels.sort_unstable();
        levels.dedup();
        let known = pv.iter().chain(op).all(|x| x.is_finite());
        (known && levels.len() >= REPEATED_LEVELS).then(|| {
            let mut hasher = DefaultHasher::new();
            pv.iter().chain(op).for_each(|x| x.to_bits().hash(&mut hasher));
            hasher.finish()
        })
    };
    samples.pv.windows(REPEATED_ROWS).zip(op.windows(REPEATED_ROWS)).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 60;

    fn recorded<'a>(pv: &'a [f64], op: &'a [f64], t: &'a [f64]) -> Recorded<'a> {
        Recorded { since: 0.0, samples: vec![Samples { t, sp: None, pv, op: Some(op), flags: None }] }
    }

    fn signal(seed: f64) -> Vec<f64> {
        (0..N).map(|k| (seed * (k + 1) as f64).sin()).collect()
    }

    #[test]
    fn rows_of_an_earlier_recording_count_once() {
        let (t, pv, op) = (signal(0.1), signal(1.3), signal(0.7));
        let (mut later, mut moved) = (signal(2.1), signal(0.4));
        later[20..40].copy_from_slice(&pv[5..25]);
        moved[20..40].copy_from_slice(&op[5..25]);
        let both = once(&[recorded(&pv, &op, &t), recorded(&later, &moved, &t)]);
        assert_eq!((both[0].repeated, &both[0].pv[0]), (0.0, &pv));
        assert_eq!(both[1].repeated, 20.0 / N as f64);
        let missing: Vec<usize> = (0..N).filter(|k| both[1].pv[0][*k].is_nan()).collect();
        assert_eq!(missing, (20..40).collect::<Vec<_>>());
        // A third that repeats the second repeats the first as well.
        let third = once(&[recorded(&pv, &op, &t), recorded(&later, &moved, &t), recorded(&later, &moved, &t)]);
        assert_eq!(third[2].repeated, 1.0);
    }

    #[test]
    fn what_only_looks_alike_counts() {
        let (t, op) = (signal(0.1), signal(0.7));
        // Seven rows are too few, and so are four values of PV.
        let (pv, mut later, mut moved) = (signal(1.3), signal(2.1), signal(0.4));
        later[20..27].copy_from_slice(&pv[5..12]);
        moved[20..27].copy_from_slice(&op[5..12]);
        let stands: Vec<f64> = (0..N).map(|k| (k % 4) as f64).collect();
        assert_eq!(once(&[recorded(&pv, &op, &t), recorded(&later, &moved, &t)])[1].repeated, 0.0);
        assert_eq!(once(&[recorded(&stands, &op, &t), recorded(&stands, &op, &t)])[1].repeated, 0.0);
        // PV alone is not enough, and a missing sample is like no other.
        assert_eq!(once(&[recorded(&pv, &op, &t), recorded(&pv, &moved, &t)])[1].repeated, 0.0);
        let mut torn = pv.clone();
        torn.iter_mut().step_by(5).for_each(|y| *y = f64::NAN);
        assert_eq!(once(&[recorded(&torn, &op, &t), recorded(&torn, &op, &t)])[1].repeated, 0.0);
    }
}
