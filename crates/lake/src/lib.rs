//! From Parquet files to crossings: the rows of many loops stream, batch by batch, from their files into the lanes of
//! the processor.
//!
//! ```text
//! files of a loop ──pages──→ columns of a batch ─┐
//! …                                              ├─→ Crossings::take_together ──→ Crossings of each loop
//! files of a loop ──pages──→ columns of a batch ─┘
//! ```
//!
//! Each thread has as many loops open at once as there are lanes. Of each of their columns a page and a batch are in memory,
//! however long the files are. Of their half-periods the counts and the estimate are kept, and no table.

mod error;
mod stream;

pub use error::LakeError;

use glapp_analysis::Crossings;
use glapp_core::LANES;
use glapp_lanes::Instructions;
use std::mem;
use std::num::NonZero;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::thread;
use stream::Stream;

/// The files and columns in which the samples of a loop lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoopFiles {
    /// Files; their rows, one file after the other, are in the order of time.
    pub files: Vec<PathBuf>,
    /// The column of times: timestamps, or numbers of seconds.
    pub time: String,
    /// Origin of the seconds of timestamps, else the first row \[µs since 1970\].
    pub since: Option<i64>,
    /// Column of setpoints.
    pub sp: String,
    /// Column of process values.
    pub pv: String,
    /// Column of controller outputs, where they are recorded.
    pub op: Option<String>,
}

/// A loop whose files are to be read.
#[derive(Clone, Debug)]
pub struct Loop {
    /// Detector at the beginning of these files.
    pub crossings: Crossings,
    /// Files of the loop.
    pub source: LoopFiles,
}

/// Result of a loop.
#[derive(Clone, Debug)]
pub struct Read {
    /// The detector behind the last row.
    pub crossings: Crossings,
    /// Rows that were read.
    pub rows: u64,
}

/// Reads the loops' files and finds their crossings, on so many threads; the same bits as [`Crossings::take`] over all rows, but that
/// their tables are empty. What cannot be read costs the others nothing.
pub fn crossings(
    loops: Vec<Loop>,
    threads: NonZero<usize>,
    instructions: Instructions,
) -> Vec<Result<Read, LakeError>> {
    let lanes = LANES.min(loops.len().div_ceil(threads.get()));
    let found: Mutex<Vec<Option<Result<Read, LakeError>>>> = Mutex::new(loops.iter().map(|_| None).collect());
    let waiting = Mutex::new(loops.into_iter().enumerate());
    let next = || waiting.lock().ok().and_then(|mut waiting| waiting.next());
    let ended = |i: usize, one| {
        if let Ok(mut found) = found.lock() {
            found[i] = Some(one);
        }
    };
    thread::scope(|scope| {
        (0..threads.get()).for_each(|_| _ = scope.spawn(|| side_by_side(lanes, next, ended, instructions)));
    });
    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.into_iter().map(|one| one.unwrap_or_else(|| Err(LakeError::abandoned()))).collect()
}

/// A loop under way.
struct Lane {
    i: usize,
    crossings: Crossings,
    stream: Stream,
}

/// The loops that `next` gives, in so many lanes. Where one has ended the next takes its lane: lanes are full
/// however long the loops' files are.
fn side_by_side(
    lanes: usize,
    next: impl Fn() -> Option<(usize, Loop)>,
    ended: impl Fn(usize, Result<Read, LakeError>),
    instructions: Instructions,
) {
    let begin = || {
        next().map(|(i, Loop { crossings, source })| Lane { i, crossings, stream: Stream::new(source, instructions) })
    };
    let mut all: Vec<Lane> = Vec::with_capacity(lanes);
    loop {
        let mut l = 0;
        while l < lanes {
            if l == all.len() {
                let Some(one) = begin() else { break };
                all.push(one);
            }
            match all[l].stream.ready() {
                Ok(true) => l += 1,
                end => {
                    let Lane { i, crossings, stream } = match begin() {
                        Some(one) => mem::replace(&mut all[l], one),
                        None => all.swap_remove(l),
                    };
                    ended(i, end.map(|_| Read { crossings, rows: stream.done() }));
                }
            }
        }
        let Some(n) = all.iter().map(|lane| lane.stream.rows()).min() else { break };
        let (mut detectors, columns): (Vec<_>, Vec<_>) =
            all.iter_mut().map(|lane| (&mut lane.crossings, lane.stream.columns(n))).unzip();
        Crossings::take_together(&mut detectors, &columns, instructions);
        for lane in &mut all {
            drop(lane.crossings.drain());
            lane.stream.pass(n);
        }
    }
}
