//! A load that repeats itself with the loop's own cycle, which a gap is easily taken for.
//!
//! Where a neighbour swings, OP swings against it, and PV stands beside SP for as long as the load rises: what a gap would do.
//! A load that walks explains that badly, so a gap would have it too easy. It has to beat a load of one period instead,
//! whatever its form: both get the harmonics of that period, and what the gap still brings is its own.

use crate::data::backlash_model::BacklashModel;
use crate::data::cells::{Cells, Positions};
use crate::search::likelihood::{Point, Search};
use crate::search::linear::dot;
use crate::search::screen::theta_for;
use glapp_model::structure::{Noise, Structure, Theta};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Harmonics of a cycle, and those by which its period is found.
const HARMONICS: usize = 20;
const FIRST: usize = 6;
/// Periods that are tried.
const PERIODS: usize = 3;
/// Parts of a line of the spectrum that two frequencies lie apart.
const FINE: f64 = 4.0;
/// Periods that a record must hold, and cells in a period.
const FEWEST: f64 = 2.5;
const SHORTEST: f64 = 8.0;
/// ln of the variance by which the load walks in a cell, in units of the noise, while its period is looked for.
const CALM: f64 = -5.0;
/// Turns of process and load.
const TURNS: usize = 8;

/// Likelihood ratio of a gap beside a load that repeats itself [−2·ln L]; none where such a load, each harmonic at the
/// price of its size and phase, explains the record no better than `without`, the least cost without a gap. `points`:
/// families whose process is a beginning.
pub(crate) fn lr_beside_cycle(
    record: &Cells,
    sign: f64,
    points: &[(Structure, &Point)],
    lost: &BacklashModel,
    without: f64,
) -> Option<f64> {
    let record = &record.unmarked();
    // The process is of the family that the gap was found in.
    let structure = Structure { noise: Noise::Input, ..points.first()?.0 };
    let search = Search { record, structure, sign };
    let alike = |of: &Structure| of.lags == structure.lags && of.integrating == structure.integrating;
    let seed = |(of, point): &(Structure, &Point)| match alike(of) {
        true => point.theta,
        false => theta_for(structure, &of.as_pilot(&point.theta)),
    };
    let seeds: Vec<Theta> = points.iter().map(seed).collect();
    let none = BacklashModel::gap(0.0, record.stretches.len());
    let frequency = frequency(&search, seeds.first()?, &none)?;
    let waves = waves(record, frequency, HARMONICS);
    let best = |lost: &BacklashModel| {
        let ends = seeds
            .par_iter()
            .map(|theta| alternate(&search, search.with_best_load_variance(*theta, lost), lost, &waves));
        ends.min_by(|a, b| a.cost.total_cmp(&b.cost))
    };
    let (no_gap, gap) = (best(&none)?, best(lost)?);
    let price = (record.count as f64).ln();
    let found = Columns::new(&search, &no_gap.theta, &none, &waves);
    let variance = dot(&found.left, &found.left) / record.count as f64;
    // A harmonic that is not worth its price would be left out.
    let harmonics: f64 = found.worth[1..].iter().map(|worth| (worth / variance).min(price)).sum();
    (no_gap.cost + harmonics + 2.0 * price < without).then_some(no_gap.cost - gap.cost)
}

/// Whitened PV explained by the valve and by more: what each of them brings, and what is left.
struct Columns {
    x: Vec<f64>,
    worth: Vec<f64>,
    left: Vec<f64>,
}

impl Columns {
    fn new(search: &Search, theta: &Theta, lost: &BacklashModel, more: &[Positions]) -> Self {
        let valve = search.record.positions(lost);
        let inputs: Vec<&Positions> = [&valve].into_iter().chain(more).collect();
        let (mut left, columns) = search.answers(theta, &inputs);
        let normal: Vec<Vec<f64>> = columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
        let by: Vec<f64> = columns.iter().map(|column| dot(column, &left)).collect();
        let inverse = inverse(&normal);
        let x: Vec<f64> = inverse.iter().map(|row| dot(row, &by)).collect();
        let worth = x.iter().zip(&inverse).enumerate().map(|(i, (x, row))| x * x / row[i].max(1e-300)).collect();
        for (column, x) in columns.iter().zip(&x) {
            left.iter_mut().zip(column).for_each(|(left, c)| *left -= x * c);
        }
        Self { x, worth, left }
    }
}

/// Cosine and sine of each harmonic in each cell.
fn waves(record: &Cells, frequency: f64, harmonics: usize) -> Vec<Positions> {
    let wave = |w: f64, of: fn(f64) -> f64| -> Positions {
        let stretch = |s: &crate::data::cells::Strip| (0..s.y.len()).map(|k| of(w * (s.since + k as f64))).collect();
        record.stretches.iter().map(stretch).collect()
    };
    let harmonics = (1..=harmonics).map(|k| k as f64 * frequency).filter(|w| *w < TAU / 3.0);
    harmonics.flat_map(|w| [wave(w, f64::cos), wave(w, f64::sin)]).collect()
}

/// Process and a load of these waves in turns, from θ.
fn alternate(search: &Search, mut theta: Theta, lost: &BacklashModel, waves: &[Positions]) -> Point {
    let mut best: Option<Point> = None;
    for _ in 0..TURNS {
        let Columns { x, .. } = Columns::new(search, &theta, lost, waves);
        let mut load: Positions = search.record.stretches.iter().map(|s| vec![0.0; s.y.len()]).collect();
        for (wave, size) in waves.iter().zip(&x[1..]) {
            for (load, wave) in load.iter_mut().zip(wave) {
                load.iter_mut().zip(wave).for_each(|(load, wave)| *load += size / x[0] * wave);
            }
        }
        // A process that does not answer knows no load either.
        let record = search.record.with_load(if x[0] == 0.0 { Positions::new() } else { load });
        let point = Search { record: &record, ..*search }.descend(theta, lost, 6, 0.1, f64::INFINITY);
        theta = point.theta;
        let gained = best.as_ref().map_or(f64::INFINITY, |best| best.cost - point.cost);
        if gained > 0.0 {
            best = Some(point);
        }
        if gained < 0.5 {
            break;
        }
    }
    best.expect("a turn at least")
}

/// The frequency whose harmonics explain most of what the valve does not [rad/cell].
fn frequency(search: &Search, theta: &Theta, lost: &BacklashModel) -> Option<f64> {
    let record = search.record;
    let mut calm = *theta;
    calm[search.structure.lags + 1] = CALM;
    let left = record.by_stretch(&Columns::new(search, &calm, lost, &[]).left);
    let step = TAU / record.longest() as f64 / FINE;
    let count = (TAU / SHORTEST / step) as usize;
    let power: Vec<f64> = (0..count)
        .into_par_iter()
        .map(|line| {
            let w = line as f64 * step;
            let (turn, mut sum) = ((w.cos(), w.sin()), (0.0, 0.0));
            for (stretch, left) in record.stretches.iter().zip(&left) {
                let (mut c, mut s) = ((w * stretch.since).cos(), (w * stretch.since).sin());
                for r in left {
                    sum = (sum.0 + r * c, sum.1 + r * s);
                    (c, s) = (c * turn.0 - s * turn.1, s * turn.0 + c * turn.1);
                }
            }
            sum.0 * sum.0 + sum.1 * sum.1
        })
        .collect();
    let comb = |line: usize| (1..=FIRST).map(|k| power.get(line * k).copied().unwrap_or(0.0)).sum::<f64>();
    let mut lines: Vec<(f64, usize)> = ((FEWEST * FINE) as usize..count).map(|line| (comb(line), line)).collect();
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut tried: Vec<usize> = Vec::new();
    for (_, line) in lines {
        if tried.len() < PERIODS && tried.iter().all(|t| t.abs_diff(line) > FINE as usize) {
            tried.push(line);
        }
    }
    let unexplained = |w: f64| {
        let left = Columns::new(search, &calm, lost, &waves(record, w, FIRST)).left;
        dot(&left, &left)
    };
    let least = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0);
    let nearest = tried.into_par_iter().map(|line| {
        let mut best = (f64::INFINITY, line as f64 * step);
        for near in [0.5, 0.25, 0.12, 0.06, 0.03] {
            let tried = [-1.0, 0.0, 1.0].map(|side| best.1 + side * near * step);
            best = tried.map(|w| (unexplained(w), w)).into_iter().chain([best]).min_by(least).expect("three at least");
        }
        best
    });
    nearest.min_by(least).map(|(_, w)| w)
}

/// The inverse of a symmetric matrix, its diagonal a little enlarged.
fn inverse(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = a.len();
    let with_unit = |(i, row): (usize, &Vec<f64>)| {
        let mut row = row.clone();
        row[i] = row[i] * (1.0 + 1e-9) + 1e-300;
        row.extend((0..n).map(|j| if i == j { 1.0 } else { 0.0 }));
        row
    };
    let mut rows: Vec<Vec<f64>> = a.iter().enumerate().map(with_unit).collect();
    for i in 0..n {
        let pivot = rows[i][i].max(1e-300);
        rows[i].iter_mut().for_each(|x| *x /= pivot);
        let row = rows[i].clone();
        for (j, other) in rows.iter_mut().enumerate() {
            let by = other[i];
            if j != i {
                other.iter_mut().zip(&row).for_each(|(x, y)| *x -= by * y);
            }
        }
    }
    rows.into_iter().map(|row| row[n..].to_vec()).collect()
}
