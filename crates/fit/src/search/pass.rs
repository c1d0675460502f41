//! A pass over a record: eight sets of parameters at once, with room that is kept from one pass to the next.

use crate::data::cells::{Positions, Strip};
use crate::search::likelihood::{Innovations, Point, Search, Wanted, shift};
use glapp_model::kalman::{Delayed, LoadChange, Sums, Whitened};
use glapp_model::lanes::{LANES, Lanes};
use glapp_model::structure::{MOST, Noise, Structure, Theta};
use std::cell::RefCell;
use std::iter::once;
use std::sync::Arc;

/// Memory of one pass, kept from one to the next.
#[derive(Default)]
pub(super) struct Workspace {
    pub(super) delayed: Vec<Lanes>,
    pub(super) shifted: Vec<f64>,
    /// Jumps of each stretch.
    pub(super) changes: Vec<Vec<LoadChange>>,
    /// Results of passes at the beginning of a descent and at its present end: the next often begins at one of them.
    pub(super) kept: [Kept; 2],
    /// Index of the one that the last pass has left.
    pub(super) last: usize,
    pub(super) found: Innovations,
}

/// Results of a pass.
#[derive(Default)]
pub(super) struct Kept {
    white: Whitened,
    /// Models of its gains, where they are of the record's own changes.
    known: Option<Known>,
}

impl Workspace {
    pub(super) fn white(&self) -> &Whitened {
        &self.kept[self.last].white
    }

    /// Index of the kept gains of these models.
    pub(super) fn place_of(&self, search: &Search, thetas: &[Theta; LANES], lanes: usize) -> Option<usize> {
        self.kept.iter().position(|kept| kept.known.as_ref().is_some_and(|known| known.holds(search, thetas, lanes)))
    }
}

/// Index of the results of a pass without a predecessor.
pub(super) const BEGUN: usize = 0;
pub(super) const DESCENDED: usize = 1;

/// Inputs that the gains of a pass and the innovations of PV depend on: PV, the changes of the load, and the models but
/// for their dead time, which is the answer's alone.
struct Known {
    structure: Structure,
    thetas: [Theta; LANES],
    /// Number of lanes that count.
    lanes: usize,
    /// PV of each stretch, compared by identity, and its changes.
    stretches: Vec<(Arc<[f64]>, Vec<f64>)>,
}

impl Known {
    fn new(search: &Search, thetas: &[Theta; LANES], lanes: usize) -> Self {
        let stretches = search.record.stretches.iter().map(|s| (s.y.clone(), s.changes.clone())).collect();
        Self { structure: search.structure, thetas: *thetas, lanes, stretches }
    }

    /// Whether the first `lanes` models, their process and the record are those of the kept pass.
    fn holds(&self, search: &Search, thetas: &[Theta; LANES], lanes: usize) -> bool {
        let Search { record, structure, .. } = search;
        let dead = structure.dead_time_at();
        let alike = |(a, b): (&Theta, &Theta)| (0..MOST).all(|i| i == dead || a[i] == b[i]);
        let same = |((y, changes), s): (&(Arc<[f64]>, Vec<f64>), &Strip)| Arc::ptr_eq(y, &s.y) && *changes == s.changes;
        self.structure == *structure
            && self.lanes >= lanes
            && self.thetas.iter().zip(thetas).all(alike)
            && self.stretches.len() == record.stretches.len()
            && self.stretches.iter().zip(&record.stretches).all(same)
    }
}

thread_local! {
    static WORKSPACE: RefCell<Workspace> = RefCell::default();
}

impl Search<'_> {
    /// Innovations of eight sets of parameters at once, of which the first `lanes` count, all with the same positions;
    /// `then` takes what it needs of them.
    pub(super) fn innovations<T>(
        &self,
        thetas: &[Theta; LANES],
        lanes: usize,
        positions: &Positions,
        wanted: Wanted,
        then: impl FnOnce(&Innovations) -> T,
    ) -> T {
        self.pass(thetas, lanes, &|_, i| &positions[i], wanted, BEGUN, |workspace| then(&workspace.found))
    }

    /// Delay of the answer [cells]. PV's mean over a cell lies half a cell behind its first step, OP's mean acts from
    /// the first step on. OP never acts on the PV of its own step: it is the controller's answer to that PV, and would
    /// explain it all too well.
    pub(crate) fn delay(&self, theta: &Theta) -> f64 {
        let cell = self.record.cell as f64;
        theta[self.structure.dead_time_at()] - (cell - 1.0) / (2.0 * cell)
    }

    /// A pass over a record: eight sets of parameters at once, of which the first `lanes` count; `then` takes what it needs of the results.
    ///
    /// - `positions`: those for a lane in a stretch.
    /// - `place`: [`BEGUN`] or [`DESCENDED`].
    pub(super) fn pass<'s, T>(
        &'s self,
        thetas: &'s [Theta; LANES],
        lanes: usize,
        positions: &'s dyn Fn(usize, usize) -> &'s [f64],
        wanted: Wanted,
        place: usize,
        then: impl FnOnce(&Workspace) -> T,
    ) -> T {
        WORKSPACE.with_borrow_mut(|workspace| {
            self.fill(workspace, thetas, lanes, positions, wanted, place);
            then(workspace)
        })
    }

    /// Leaves the results of a [`Self::pass`] in the workspace.
    fn fill<'s>(
        &self,
        workspace: &mut Workspace,
        thetas: &[Theta; LANES],
        lanes: usize,
        positions: &'s dyn Fn(usize, usize) -> &'s [f64],
        wanted: Wanted,
        place: usize,
    ) {
        let Search { record, structure, .. } = self;
        let stretches = 0..record.stretches.len();
        let delay = Lanes::each(|l| self.delay(&thetas[l]));
        // Most lanes differ in something else.
        let same = |i: usize| (1..LANES).all(|l| std::ptr::eq(positions(l, i), positions(0, i)));
        let together = delay.iter().all(|d| d.floor() == delay[0].floor()) && stretches.clone().all(same);
        let part = Lanes::each(|l| delay[l] - delay[l].floor());
        workspace.delayed.clear();
        workspace.shifted.clear();
        for i in stretches.clone() {
            if together {
                shift(positions(0, i), delay[0], &mut workspace.shifted);
                continue;
            }
            let from = workspace.delayed.len();
            workspace.delayed.resize(from + positions(0, i).len(), Lanes::default());
            for l in 0..lanes {
                workspace.shifted.clear();
                shift(positions(l, i), delay[l], &mut workspace.shifted);
                let of_lane = workspace.shifted.windows(2).map(|two| (1.0 - part[l]) * two[1] + part[l] * two[0]);
                workspace.delayed[from..].iter_mut().zip(of_lane).for_each(|(delayed, v)| delayed[l] = v);
            }
        }
        let (mut each, mut shifted) = (workspace.delayed.as_slice(), workspace.shifted.as_slice());
        let delayed = stretches.clone().map(|i| {
            let cells = positions(0, i).len();
            if together {
                let (v, after) = shifted.split_at(cells + 1);
                shifted = after;
                Delayed::Same { shifted: v, part }
            } else {
                let (v, after) = each.split_at(cells);
                each = after;
                Delayed::Each(v)
            }
        });
        let held = workspace.place_of(self, thetas, lanes);
        workspace.last = held.unwrap_or(place);
        let Kept { white, known } = &mut workspace.kept[workspace.last];
        if held.is_some() {
            let mut inputs = delayed.zip(&record.stretches).map(|(v, s)| (s.y.len(), v));
            structure.answer(lanes, &mut inputs, white);
        } else {
            workspace.changes.clear();
            workspace.changes.extend(record.stretches.iter().map(|stretch| LoadChange::alike(&stretch.changes)));
            *known = None;
            let inputs = delayed.zip(&record.stretches).zip(&workspace.changes);
            let mut inputs = inputs.map(|((v, stretch), changes)| (&*stretch.y, changes.as_slice(), v));
            structure.whiten(lanes, thetas, &mut inputs, white);
            *known = Some(Known::new(self, thetas, lanes));
        }
        self.gain_and_residuals(lanes, white, &mut workspace.found, wanted);
    }

    /// Sums over the beginning of one stretch, each lane with its own positions.
    pub(super) fn beginnings(&self, point: &Point, stretch: usize, positions: &[Lanes]) -> Sums {
        // The gains with which the point was found, so that they do not depend on earlier passes.
        let (thetas, _) = self.perturbed(&point.theta);
        let held = || WORKSPACE.with_borrow(|workspace| workspace.place_of(self, &thetas, self.lanes()));
        let held = held().unwrap_or_else(|| {
            self.innovations(&thetas, self.lanes(), &self.record.positions(&point.lost), Wanted::Sums, |_| ());
            BEGUN
        });
        WORKSPACE.with_borrow_mut(|workspace| {
            let white = &mut workspace.kept[held].white;
            let v = Delayed::Late { positions, delay: self.delay(&point.theta) };
            self.structure.answers_of_first(stretch, positions.len(), v, white);
            white.sums
        })
    }

    /// Effect of a unit step of the load (of its slope, where that is what changes), with gain 1, on the innovations
    /// over the `cells` after it, once the filter has settled.
    pub(crate) fn answer(&self, theta: &Theta, cells: usize) -> Vec<f64> {
        let before = 400;
        let lines = matches!(self.structure.noise, Noise::Lines | Noise::Bends);
        let load = |k: usize| {
            if k < before {
                0.0
            } else if lines {
                (k - before) as f64
            } else {
                1.0
            }
        };
        let step: Vec<Lanes> = (0..before + cells).map(|k| Lanes::all(load(k))).collect();
        let (nothing, mut white) = (vec![0.0; step.len()], Whitened::default());
        let alone = (nothing.as_slice(), [].as_slice(), Delayed::Each(&step));
        self.structure.whiten(LANES, &[*theta; LANES], &mut once(alone), &mut white);
        white.of_v()[before..].iter().map(|v| v[0]).collect()
    }

    /// Whitened PV, and the whitened answer to each of the inputs with gain 1.
    pub(crate) fn answers(&self, theta: &Theta, inputs: &[&Positions]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (mut of_y, mut answers) = (Vec::new(), Vec::new());
        for eight in inputs.chunks(LANES) {
            let of = |l: usize, i: usize| eight[l.min(eight.len() - 1)][i].as_slice();
            self.pass(&[*theta; LANES], eight.len(), &of, Wanted::Sums, BEGUN, |workspace| {
                let white = workspace.white();
                of_y = white.of_y().iter().map(|y| y[0]).collect();
                answers.extend((0..eight.len()).map(|l| white.of_v().iter().map(|v| v[l]).collect::<Vec<f64>>()));
            });
        }
        (of_y, answers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::backlash_model::BacklashModel;
    use crate::data::cells::Cells;

    #[test]
    fn gains_that_are_kept_give_the_bits_of_a_new_pass() {
        let u: Vec<f64> = (0..300).map(|k| (f64::from(k) * 0.1).sin()).collect();
        let mut y: Vec<f64> = u.iter().zip(0..).map(|(u, k)| u + 0.01 * f64::from(k * 7919 % 13)).collect();
        y[70..75].fill(f64::NAN);
        let parts = [(&y[..180], &u[..180]), (&y[180..], &u[180..])];
        let record = Cells::new(&parts, 1).with_changes(vec![vec![120.3, 40.0], vec![60.5]]);
        for structure in [Noise::Still, Noise::Input, Noise::Both, Noise::Slope, Noise::Bends].map(of_two_lags) {
            let search = Search { record: &record, structure, sign: 1.0 };
            let (thetas, _) = search.perturbed(&structure.beginning(8.0, 2.4));
            let of = |d: f64, forget: bool| {
                if forget {
                    WORKSPACE.take();
                }
                let positions = record.positions(&BacklashModel::gap(d, 2));
                search.innovations(&thetas, search.lanes(), &positions, Wanted::Residuals, |found| {
                    let of_all = found.residual.iter().flat_map(|r| r.map(f64::to_bits));
                    of_all.chain(found.sums.yv.map(f64::to_bits)).collect::<Vec<u64>>()
                })
            };
            let anew = of(0.2, true);
            of(0.1, true);
            assert!(WORKSPACE.with_borrow(|workspace| workspace.place_of(&search, &thetas, search.lanes()).is_some()));
            assert!(of(0.2, false) == anew, "{structure:?}");
        }
    }

    #[test]
    fn kept_gains_are_of_one_record_and_one_process() {
        let (y, u) = ([1.0, 2.0, 1.5, 0.5].repeat(20), [0.0, 1.0, 1.0, 0.0].repeat(20));
        let record = Cells::new(&[(&y, &u)], 1);
        let structure = of_two_lags(Noise::Input);
        let theta = structure.beginning(8.0, 2.4);
        let (mut slower, mut later) = (theta, theta);
        slower[0] += 0.1;
        later[structure.dead_time_at()] += 1.0;
        let kept = Known::new(&Search { record: &record, structure, sign: 1.0 }, &[theta; LANES], 4);
        let so_many = |record: &Cells, theta: Theta, lanes: usize| {
            kept.holds(&Search { record, structure, sign: 1.0 }, &[theta; LANES], lanes)
        };
        let holds = |record: &Cells, theta: Theta| so_many(record, theta, 4);
        assert!(
            so_many(&record, theta, 1) && !so_many(&record, theta, 5),
            "of those that do not count nothing is kept"
        );
        assert!(holds(&record, theta) && holds(&record.clone(), later), "the dead time is the answer's alone");
        assert!(!holds(&record, slower));
        assert!(!holds(&record.with_changes(vec![vec![40.0]]), theta));
        assert!(!holds(&record.with(vec![y.clone()]), theta), "other PV, though its numbers are the same");
    }

    fn of_two_lags(noise: Noise) -> Structure {
        Structure { lags: 2, integrating: false, noise }
    }
}
