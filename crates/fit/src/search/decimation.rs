//! Number of steps in a cell for which the process can be seen, and the beginning of a search.

use crate::data::cells::Cells;
use crate::data::segment::{OpAndPv, Segment, turns};
use crate::search::screen::{Pilot, pilot};
use glapp_model::structure::Theta;
use rayon::prelude::*;

/// Least cells for an answer.
pub(crate) const FEWEST: usize = 50;
/// Cells that one fit takes.
pub(crate) const MOST_CELLS: usize = 3000;
/// Cells of the first look.
const LOOK_CELLS: usize = 600;
/// Cells in the lags of a process.
const FINE: f64 = 12.0;
/// Lags of a process that are seen [cells].
const SEEN: f64 = 4.0;
/// Lags of a process that a first look can hold [cells], and the likelihood ratio that PV answers OP there.
const HOLDS: f64 = 40.0;
const ANSWERED: f64 = 30.0;
/// Pieces of the records that are looked at for how slow the process is.
const PIECES: usize = 3;

/// Longest window of a record in which cells are fine enough for the process \[steps\]; None where OP or PV hardly moves.
pub(crate) fn window(record: &Segment, sign: f64) -> Option<usize> {
    cell(&record.signals(), sign).map(|cell| cell * MOST_CELLS)
}

/// Good beginnings for a window, and the steps of the cells in which they were found: few, unless the process is not seen in
/// them.
pub(crate) fn look(parts: &[OpAndPv], sign: f64) -> Option<(Vec<Theta>, usize)> {
    let mut cell = steps(parts).div_ceil(LOOK_CELLS).max(1);
    loop {
        let record = Cells::new(parts, cell);
        if !moves(&record) {
            return None;
        }
        let Pilot { seeds, slow, .. } = pilot(&record, sign);
        if cell == 1 || slow > SEEN {
            return Some((seeds, cell));
        }
        cell = (cell / 4).max(1);
    }
}

/// Steps in a cell that is fine enough for the process. From the finest on: coarse cells take steps of the load for the
/// process.
pub(crate) fn cell(parts: &[OpAndPv], sign: f64) -> Option<usize> {
    let all = steps(parts);
    if all <= MOST_CELLS {
        return Some(1);
    }
    let mut cell = 1;
    loop {
        let last = LOOK_CELLS * cell >= all;
        let mut pieces: Vec<Vec<OpAndPv>> = vec![parts.to_vec()];
        if last {
            cell = all.div_ceil(LOOK_CELLS).max(1);
        } else {
            let chunk = LOOK_CELLS * cell;
            let chunks = parts.iter().flat_map(|(y, u)| y.chunks(chunk).zip(u.chunks(chunk)));
            let mut chunks: Vec<OpAndPv> = chunks.collect();
            chunks.sort_by(|a, b| turns(b.1).total_cmp(&turns(a.1)));
            pieces = chunks.into_iter().take(PIECES).map(|chunk| vec![chunk]).collect();
        }
        let records = pieces.iter().map(|piece| Cells::new(piece, cell)).filter(moves);
        let looked: Vec<Pilot> = records.collect::<Vec<_>>().par_iter().map(|record| pilot(record, sign)).collect();
        let mut slow: Vec<f64> = looked.iter().filter(|p| last || p.answers > ANSWERED).map(|p| p.slow).collect();
        slow.sort_by(f64::total_cmp);
        match slow.get(slow.len() / 2) {
            Some(slow) if last || *slow < HOLDS => return Some(((cell as f64 * slow / FINE) as usize).max(1)),
            None if last => return None,
            _ => cell *= 4,
        }
    }
}

fn steps(parts: &[OpAndPv]) -> usize {
    parts.iter().map(|(y, _)| y.len()).sum()
}

/// Whether there is something to fit.
fn moves(record: &Cells) -> bool {
    record.count >= FEWEST && record.range > 0.0
}
