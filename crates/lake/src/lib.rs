//! From Parquet files to crossings: the rows of many loops stream, batch by batch, from their files into the lanes of the processor.
//!
//! ```text
//! files of a loop ──pages──→ columns of a batch ─┐
//! …                                              ├─→ Crossings::take_together ──→ Crossings of each loop
//! files of a loop ──pages──→ columns of a batch ─┘
//! ```
//!
//! As many loops as there are lanes are open at once for a thread. Of each of their columns a page and a batch are in memory, however
//! long the files are. Of their half-periods the counts and the estimate are kept, and no table.

mod error;
mod stream;

pub use error::LakeError;

use glapp_analysis::Crossings;
use glapp_core::{Columns, LANES};
use glapp_lanes::Instructions;
use std::num::NonZero;
use std::path::PathBuf;
use std::sync::Mutex;
use std::thread;
use stream::Stream;

/// Where the samples of a loop are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Its files; their rows, one file after the other, are in the order of time.
    pub files: Vec<PathBuf>,
    /// The column of times: timestamps, or numbers of seconds.
    pub time: String,
    /// From when on the seconds of timestamps are counted, else from the first row on \[µs since 1970\].
    pub since: Option<i64>,
    /// Of setpoints.
    pub sp: String,
    /// Of process values.
    pub pv: String,
    /// Of controller outputs, where they are recorded.
    pub op: Option<String>,
}

/// A loop whose files are to be read.
#[derive(Clone, Debug)]
pub struct Loop {
    /// Its detector, at the beginning of these files.
    pub crossings: Crossings,
    /// Its files.
    pub place: Place,
}

/// What came of a loop.
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
    let mut found: Vec<Option<Result<Read, LakeError>>> = loops.iter().map(|_| None).collect();
    let mut loops = loops.into_iter();
    let groups = found.chunks_mut(LANES).map(|places| (places.len(), places));
    let groups: Vec<_> = groups.map(|(n, places)| (loops.by_ref().take(n).collect::<Vec<_>>(), places)).collect();
    let groups = Mutex::new(groups.into_iter());
    let next = || groups.lock().ok().and_then(|mut groups| groups.next());
    let work = || {
        while let Some((loops, places)) = next() {
            places.iter_mut().zip(side_by_side(loops, instructions)).for_each(|(place, one)| *place = Some(one));
        }
    };
    thread::scope(|scope| (0..threads.get()).for_each(|_| _ = scope.spawn(work)));
    drop(groups);
    found.into_iter().map(|one| one.unwrap_or_else(|| Err(LakeError::abandoned()))).collect()
}

/// The same for as many loops as there are lanes, or fewer.
fn side_by_side(loops: Vec<Loop>, instructions: Instructions) -> Vec<Result<Read, LakeError>> {
    let mut all: Vec<(Crossings, Stream, Option<LakeError>)> =
        loops.into_iter().map(|one| (one.crossings, Stream::new(one.place), None)).collect();
    loop {
        let mut under_way = Vec::new();
        for (crossings, stream, fault) in &mut all {
            match stream.ready() {
                Ok(true) => under_way.push((crossings, stream)),
                Ok(false) => (),
                Err(error) => *fault = Some(error),
            }
        }
        let Some(n) = under_way.iter().map(|(_, stream)| stream.rows()).min() else { break };
        let (mut detectors, streams): (Vec<_>, Vec<_>) = under_way.into_iter().unzip();
        let columns: Vec<Columns<'_, f64>> = streams.iter().map(|stream| stream.columns(n)).collect();
        Crossings::take_together(&mut detectors, &columns, instructions);
        detectors.into_iter().for_each(|one| drop(one.drain()));
        streams.into_iter().for_each(|stream| stream.pass(n));
    }
    let read = |(crossings, stream, fault): (Crossings, Stream, Option<LakeError>)| match fault {
        None => Ok(Read { crossings, rows: stream.done() }),
        Some(error) => Err(error),
    };
    all.into_iter().map(read).collect()
}
