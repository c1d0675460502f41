//! The gap, no gap and the valve that sticks that fit the rows best.

use crate::data::recorder::quantile;
use crate::position::track::{LANES, Motion, Track, Tried};
use glapp_core::Model;

impl Track {
    /// Descends from `from` to the best of its eight neighbours, as long as there is a better one, in steps that become
    /// smaller:
    /// `moved` gives the motion moved by so many steps of either of two parameters.
    pub(super) fn descend(&self, from: Tried, moved: impl Fn(Motion, f64, f64) -> Motion) -> Tried {
        const AROUND: [(f64, f64); LANES] =
            [(1., 0.), (-1., 0.), (0., 1.), (0., -1.), (1., 1.), (-1., -1.), (1., -1.), (-1., 1.)];
        let (mut here, mut size) = (from, self.stride);
        for _ in 0..80 {
            let around = self.weigh(&AROUND.map(|(i, j)| moved(here.motion, i * size, j * size)));
            let best = around.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("eight");
            if best.cost < here.cost {
                here = *best;
                size *= 1.5;
                continue;
            }
            // With all neighbours equally good, smaller steps tell no more.
            if around.iter().all(|t| t.cost < here.cost + 0.05) && size < 0.1 || size < 1e-7 {
                break;
            }
            size /= 4.0;
        }
        here
    }

    /// The best width and lag from there on.
    pub(super) fn widths(&self, from: Tried) -> Tried {
        let step = 0.1 * from.motion.d.max(0.01 * self.range);
        self.descend(from, |m, i, j| {
            let d = (m.d + i * step).clamp(0.0, self.range);
            Motion { d, lag: (m.lag + 0.5 * j).max(0.0), ..m }
        })
    }

    /// The best lag for a given width and delay.
    pub(super) fn lags(&self, from: Tried) -> Tried {
        self.descend(from, |m, i, j| Motion { lag: (m.lag + 0.7 * i + 0.1 * j).max(0.0), ..m })
    }

    /// The best width and share of slip jump.
    fn shares(&self, from: Tried) -> Tried {
        let step = 0.1 * from.motion.d.max(0.01 * self.range);
        self.descend(from, |m, i, j| {
            let d = (m.d + i * step).clamp(0.0, self.range);
            Motion { d, share: (m.share + 0.1 * j).clamp(0.02, 1.0), ..m }
        })
    }

    /// The best gaps of a coarse look, one for each delay and the best first; and the same for no gap.
    fn look(&self) -> (Vec<Tried>, Vec<Tried>) {
        const LAGS: [f64; LANES] = [0.0, 0.5, 1.0, 2.0, 3.5, 6.0, 10.0, 18.0];
        const DELAYS: [isize; 11] = [-1, 0, 1, 2, 3, 4, 6, 8, 11, 15, 20];
        const WIDTHS: [f64; 13] = [0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.26, 0.38, 0.54, 0.75, 1.0];
        let least = |tried: [Tried; LANES]| tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("eight");
        let at = |d: f64, delay: isize| least(self.weigh(&LAGS.map(|lag| Motion::gap(d, delay, lag))));
        let sorted = |mut tried: Vec<Tried>| {
            tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            tried
        };
        let none = sorted(DELAYS.iter().map(|&delay| at(0.0, delay)).collect());
        let gaps = DELAYS.iter().map(|&delay| {
            let widths = WIDTHS.iter().map(|part| at(part * self.range, delay));
            widths.min_by(|a, b| a.cost.total_cmp(&b.cost)).expect("widths")
        });
        (sorted(gaps.collect()), none)
    }

    /// The best valves that stick, of either model, near a gap's delay and lag.
    fn sticking(&self, near: &Tried) -> Vec<Tried> {
        const SHARES: [f64; LANES] = [0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0];
        let widths = [0.01, 0.03, 0.06, 0.1, 0.16, 0.25, 0.4, 0.6].map(|part| part * self.range);
        let own = [0.8, 0.95, 1.05, 1.3, 1.8].map(|part| part * near.motion.d);
        let mut found = Vec::new();
        for model in [Model::Kano, Model::He] {
            let lags = if near.motion.lag > 0.2 { vec![0.0, near.motion.lag] } else { vec![near.motion.lag] };
            let tried = widths.iter().chain(&own).flat_map(|&d| lags.iter().map(move |&lag| (d, lag)));
            let tried = tried
                .filter(|(d, _)| *d > 0.0 && *d <= self.range)
                .flat_map(|(d, lag)| self.weigh(&SHARES.map(|share| Motion { d, share, model, lag, ..near.motion })));
            found.extend(tried.min_by(|a, b| a.cost.total_cmp(&b.cost)));
        }
        found
    }

    /// The best width, share of slip jump and lag.
    fn jumps(&self, from: Tried) -> Tried {
        self.shares(self.widths(self.shares(from)))
    }

    /// The best of some beginnings, each with the delays beside it, on all rows.
    fn polished(&self, starts: &[Tried], polish: impl Fn(&Self, Tried) -> Tried) -> Tried {
        let mut ends: Vec<Tried> = starts.iter().map(|start| polish(self, self.at(start.motion))).collect();
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut best = ends[0];
        for by in [1, -1] {
            loop {
                let motion = Motion { delay: best.motion.delay + by, ..best.motion };
                if !(-2..=40).contains(&motion.delay) {
                    break;
                }
                let beside = polish(self, self.at(motion));
                if beside.cost >= best.cost {
                    break;
                }
                best = beside;
            }
        }
        best
    }

    /// Rows far off the best model no longer count, if they are few: spikes of more than a row.
    pub(super) fn without_outliers(&mut self, best: &Tried) -> bool {
        let mut sizes = Vec::with_capacity(self.rows);
        self.residuals(best, |_, _, _, r| sizes.push(r.abs()));
        let median = quantile(&mut sizes, 0.5);
        let limit = (8.0 * 1.4826 * median).max(3.0 * best.left.sqrt());
        let far = sizes.iter().filter(|r| **r > limit).count();
        if far == 0 || far * 20 > self.rows || limit * limit < 4.0 * self.floor {
            return false;
        }
        let mut gone: Vec<(usize, usize)> = Vec::new();
        self.residuals(best, |i, k, _, r| {
            if r.abs() > limit {
                gone.push((i, k));
            }
        });
        for (i, k) in gone {
            self.parts[i].z[k] = f64::NAN;
            self.spikes += 1;
        }
        self.sum();
        true
    }

    /// The gap, no gap and a valve that sticks, each at its best: sought where OP moves most, then on all rows.
    pub(super) fn search(&mut self) -> [Tried; 3] {
        let Some(mut look) = self.busiest() else { return self.search_here() };
        let [gap, none, stuck] = look.search_here();
        self.line = look.line;
        self.stride = 0.1;
        let gap = self.polished(&[gap], Self::widths);
        let none = self.polished(&[none], Self::lags);
        // A valve that plainly does not stick there is not looked at twice.
        let stuck = if stuck.cost < look.cost(look.at(gap.motion).left) - 2.0 {
            self.polished(&[stuck], Self::jumps)
        } else {
            self.at(stuck.motion)
        };
        [if none.cost < gap.cost { none } else { gap }, none, stuck]
    }

    /// Search on the rows that there are.
    fn search_here(&mut self) -> [Tried; 3] {
        let (gaps, none) = self.look();
        self.line = (gaps[0].a, gaps[0].b);
        let gap = self.polished(&gaps[..2], Self::widths);
        self.line = (gap.a, gap.b);
        let gap = self.widths(self.at(gap.motion));
        let beside = Tried { motion: Motion { d: 0.0, ..gap.motion }, ..gap };
        let none = self.polished(&[none[0], none[1], beside], Self::lags);
        let stuck = self.polished(&self.sticking(&gap), Self::jumps);
        [if none.cost < gap.cost { none } else { gap }, none, stuck]
    }
}
