//! Marked changes of the load tried elsewhere, each by the cells around it.

use crate::data::cells::{Positions, Strip};
use crate::search::likelihood::{Search, delayed, gain};
use glapp_model::kalman::{Asked, Sides, Totals, UNKNOWN, union};
use glapp_model::lanes::Lanes;
use glapp_model::structure::Theta;
use std::ops::Range;

/// A record under one model whose changes are tried elsewhere, each by the cells around it.
pub(crate) struct Elsewhere<'s> {
    search: Search<'s>,
    theta: Theta,
    /// The changes of each stretch as they stand.
    changes: Vec<Vec<f64>>,
    sides: Vec<Sides>,
    /// Totals of each stretch with its present changes, where there are several.
    totals: Vec<Totals>,
}

impl<'s> Elsewhere<'s> {
    pub(crate) fn new(search: &Search<'s>, theta: &Theta, positions: &Positions) -> Self {
        let delay = search.delay(theta);
        let sides = |(stretch, positions): (&Strip, &Vec<f64>)| {
            Sides::new(stretch.y.clone(), delayed(positions, delay), &stretch.changes)
        };
        let sides: Vec<Sides> = search.record.stretches.iter().zip(positions).map(sides).collect();
        let changes = search.record.stretches.iter().map(|stretch| stretch.changes.clone()).collect();
        let mut all = Self { search: *search, theta: *theta, changes, sides, totals: Vec::new() };
        if all.sides.len() > 1 {
            all.totals = (0..all.sides.len()).map(|i| all.of_stretch(i, None)).collect();
        }
        all
    }

    /// Σ r² as the changes stand.
    pub(crate) fn as_it_stands(&mut self) -> f64 {
        let totals = self.of_stretch(0, None);
        self.squares(0, totals, self.changes[0].len())[0]
    }

    /// Σ r² with up to eight other sets of changes in one of the stretches, as many in each.
    pub(crate) fn with(&mut self, stretch: usize, tried: &[&[f64]]) -> Lanes {
        let totals = self.of_stretch(stretch, Some(tried));
        self.squares(stretch, totals, tried[0].len())
    }

    /// The changes of a stretch are these from now on.
    pub(crate) fn take(&mut self, stretch: usize, changes: &[f64]) {
        if let Some(cells) = differing(&self.changes[stretch], changes) {
            self.sides[stretch].change(changes, &cells);
        }
        self.changes[stretch] = changes.to_vec();
        if self.sides.len() > 1 {
            self.totals[stretch] = self.of_stretch(stretch, None);
        }
    }

    /// Cost with the present changes, or with those that are tried.
    fn of_stretch(&mut self, stretch: usize, tried: Option<&[&[f64]]>) -> Totals {
        let own = self.changes[stretch].as_slice();
        let as_it_stands = [own];
        let tried = tried.unwrap_or(&as_it_stands);
        let cells = tried.iter().filter_map(|tried| differing(own, tried));
        let cells = cells.reduce(|a, b| union(&a, &b)).unwrap_or(1..2);
        let asked = Asked { sides: &mut self.sides[stretch], theta: &self.theta, cells: &cells, tried };
        self.search.structure.elsewhere(asked)
    }

    /// Σ r² with these totals of one of the stretches, which has so many changes.
    fn squares(&self, stretch: usize, totals: Totals, changes: usize) -> Lanes {
        let others = || (0..self.sides.len()).filter(|i| *i != stretch);
        let record = self.search.record;
        let changes = (changes + others().map(|i| self.changes[i].len()).sum::<usize>()) as f64;
        let freedom = record.freedom() + record.changes() as f64 - changes;
        Lanes::each(|l| {
            let sum =
                |of: fn(&Totals) -> &Lanes| of(&totals)[l] + others().map(|i| of(&self.totals[i])[0]).sum::<f64>();
            let [yy, yv, vv] = [sum(|t| &t.sums.yy), sum(|t| &t.sums.yv), sum(|t| &t.sums.vv)];
            let kp = gain(yv, vv, self.search.sign);
            let log_s = sum(|t| &t.log_s) - changes * UNKNOWN.ln();
            (yy - 2.0 * kp * yv + kp * kp * vv) * (log_s / freedom).exp()
        })
    }
}

/// The cells in which changes are others, as far as they are; none where they are the same.
fn differing(a: &[f64], b: &[f64]) -> Option<Range<usize>> {
    let first = a.iter().zip(b).take_while(|(a, b)| a == b).count();
    let (a, b) = (&a[first..], &b[first..]);
    let last = a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count();
    let rest = a[..a.len() - last].iter().chain(&b[..b.len() - last]).map(|time| time.ceil() as usize);
    let (least, most) = (rest.clone().min()?, rest.max()?);
    Some(least..most + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::backlash_model::BacklashModel;
    use crate::data::cells::Cells;
    use glapp_model::structure::{Noise, Structure};

    #[test]
    fn changes_elsewhere_are_judged_by_the_cells_around_them_as_by_a_pass() {
        let u: Vec<f64> = (0..400).map(|k| (f64::from(k) * 0.1).sin()).collect();
        let mut y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[2..5].fill(f64::NAN);
        y[110..117].fill(f64::NAN);
        let parts = [(&y[..250], &u[..250]), (&y[250..], &u[250..])];
        let marks = vec![vec![170.3, 40.5, 112.0], vec![60.5, 75.25]];
        let record = Cells::new(&parts, 1).with_changes(marks.clone());
        let families = [(2, false), (3, false), (1, true)];
        for noise in [Noise::Still, Noise::Input, Noise::Lines, Noise::Bends] {
            for (lags, integrating) in families {
                let structure = Structure { lags, integrating, noise };
                let search = Search { record: &record, structure, sign: 1.0 };
                let theta = structure.beginning(8.0, 2.4);
                let positions = record.positions(&BacklashModel::gap(0.2, 2));
                let of_pass = |marks: &[Vec<f64>]| {
                    let record = record.with_changes(marks.to_vec());
                    Search { record: &record, structure, sign: 1.0 }.at(&theta, &positions).sum[0]
                };
                // A slope that is not known at all costs either of them digits.
                let off = if matches!(noise, Noise::Lines | Noise::Bends) { 5e-5 } else { 2e-6 };
                let near = |told: f64, pass: f64| {
                    assert!((told - pass).abs() < off * pass, "{structure:?}: {told} for {pass}");
                };
                let mut marks = marks.clone();
                let mut elsewhere = Elsewhere::new(&search, &theta, &positions);
                near(elsewhere.as_it_stands(), of_pass(&marks));
                // For each stretch in turn: moved, moved nearer, left out; then the present one from other places.
                for (i, moved) in [
                    (0, [5.0, 5.5, 6.0, 12.0, 100.0, 117.5, 240.25, 244.9]),
                    (1, [5.0, 5.5, 60.0, 61.0, 76.0, 100.0, 140.0, 144.0]),
                ] {
                    for _ in 0..2 {
                        let tried = moved.map(|time| [&[time], &marks[i][1..]].concat());
                        let told = elsewhere.with(i, &tried.each_ref().map(Vec::as_slice));
                        for (tried, told) in tried.iter().zip(*told) {
                            let mut marks = marks.clone();
                            marks[i].clone_from(tried);
                            near(told, of_pass(&marks));
                        }
                        marks[i].clone_from(&tried[4]);
                        elsewhere.take(i, &tried[4]);
                        near(elsewhere.as_it_stands(), of_pass(&marks));
                    }
                    marks[i].remove(1);
                    elsewhere.take(i, &marks[i]);
                    near(elsewhere.as_it_stands(), of_pass(&marks));
                }
            }
        }
    }
}
