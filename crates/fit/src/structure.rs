//! The families of models that are tried: lags, an integrator or none, and where the disturbance enters.

use crate::kalman::{LANES, Lanes, Models, White, lanes};
use glapp_sim::Matrix;

/// Where the disturbance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// A load that walks at the input of the process, and white noise on PV.
    Input,
    /// A drift of first order at the output, and white noise on PV.
    Output,
    /// Both.
    Both,
}

/// One family: `lags` first-order lags (two of them may oscillate), perhaps an integrator, dead time, disturbance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Structure {
    /// Lags: 2, 3, or 1 with an integrator.
    pub lags: usize,
    /// One integrator behind them.
    pub integrating: bool,
    /// Where the disturbance enters.
    pub noise: Noise,
}

/// Most parameters that a structure can have.
pub(crate) const MOST: usize = 7;

/// The parameters of a structure in the order in which the search moves them, all on scales where a step of 1 is large:
/// ln T, ln ζ (two lags or more), ln T₃ (three lags), dead time in cells, then of the noise ln q_load, ln q_drift,
/// logit of the drift's pole. T in cells; two lags are 1/(1 + 2ζTs + T²s²).
pub(crate) type Theta = [f64; MOST];

impl Structure {
    /// Process families: two lags hold one (the other goes to nothing), an integrator holds one with a lag.
    const PROCESSES: [(usize, bool); 3] = [(2, false), (3, false), (1, true)];

    /// The families that every record is tried with, for one kind of disturbance.
    pub(crate) fn with(noise: Noise) -> [Self; 3] {
        Self::PROCESSES.map(|(lags, integrating)| Self { lags, integrating, noise })
    }

    pub(crate) fn parameters(self) -> usize {
        self.lags + 1 + self.noise_parameters()
    }

    fn noise_parameters(self) -> usize {
        match self.noise {
            Noise::Input => 1,
            Noise::Output => 2,
            Noise::Both => 3,
        }
    }

    /// Place of the dead time in θ.
    pub(crate) fn dead_time_at(self) -> usize {
        self.lags
    }

    /// A beginning for the search: lags of `t` cells in all, dead time `dead` cells.
    pub(crate) fn beginning(self, t: f64, dead: f64) -> Theta {
        let mut theta = [0.0; MOST];
        match self.lags {
            1 => theta[0] = t.ln(),
            2 => (theta[0], theta[1]) = ((t / 2.0).ln(), 0.1),
            _ => (theta[0], theta[1], theta[2]) = ((t / 3.0).ln(), 0.1, (t / 3.0).ln()),
        }
        let d = self.lags;
        theta[d] = dead;
        match self.noise {
            Noise::Input => theta[d + 1] = -2.0,
            Noise::Output => (theta[d + 1], theta[d + 2]) = (-2.0, 2.0),
            Noise::Both => (theta[d + 1], theta[d + 2], theta[d + 3]) = (-3.0, -3.0, 2.0),
        }
        theta
    }

    /// The nearest θ within bounds, for a record of `n` cells.
    pub(crate) fn bounded(self, mut theta: Theta, n: f64) -> Theta {
        let long = (n / 4.0).ln();
        match self.lags {
            1 => theta[0] = theta[0].clamp(-3.0, long),
            _ => {
                theta[0] = theta[0].clamp(-3.0, long);
                theta[1] = theta[1].clamp(-2.3, 1.6);
            }
        }
        if self.lags == 3 {
            theta[2] = theta[2].clamp(-3.0, long);
        }
        let d = self.lags;
        theta[d] = theta[d].clamp(0.0, (n / 6.0).min(80.0));
        for i in d + 1..self.parameters() {
            theta[i] = theta[i].clamp(-10.0, 14.0);
        }
        if self.noise != Noise::Input {
            let pole = self.parameters() - 1;
            theta[pole] = theta[pole].clamp(-3.0, 10.0);
        }
        theta
    }

    /// Coefficients of 1, s, s² … [cellsᵏ], with the integrator if there is one.
    pub(crate) fn denominator(self, theta: &Theta) -> Vec<f64> {
        let mut den = match self.lags {
            1 => vec![1.0, theta[0].exp()],
            _ => {
                let t = theta[0].exp();
                vec![1.0, 2.0 * theta[1].exp() * t, t * t]
            }
        };
        if self.lags == 3 {
            let t = theta[2].exp();
            den.push(0.0);
            for i in (1..den.len()).rev() {
                den[i] += t * den[i - 1];
            }
        }
        if self.integrating {
            den.insert(0, 0.0);
        }
        den
    }

    /// Lags together [cells]: the coefficient of s in the denominator, of s² behind an integrator.
    pub(crate) fn lag(self, theta: &Theta) -> f64 {
        self.denominator(theta)[1 + usize::from(self.integrating)]
    }

    /// Whether two sets of parameters are of one process: lags and dead time within a third of their sum.
    pub(crate) fn alike(self, a: &Theta, b: &Theta) -> bool {
        let (lags, dead) = ([self.lag(a), self.lag(b)], [a[self.dead_time_at()], b[self.dead_time_at()]]);
        let near = 0.5 + (lags[0] + dead[0]) / 3.0;
        (lags[0] - lags[1]).abs() < near && (dead[0] - dead[1]).abs() < near
    }

    /// The nearest parameters of two lags with a load that walks.
    pub(crate) fn as_pilot(self, theta: &Theta) -> Theta {
        let mut pilot = [0.0; MOST];
        if self.lags == 1 {
            (pilot[0], pilot[1]) = (theta[0].max(1.0), 0.5);
        } else {
            (pilot[0], pilot[1]) = (theta[0], theta[1]);
        }
        // The third lag becomes dead time.
        pilot[2] = theta[self.dead_time_at()] + if self.lags == 3 { theta[2].exp() } else { 0.0 };
        pilot[3] = if self.noise == Noise::Output { -2.0 } else { theta[self.lags + 1] };
        pilot
    }

    /// The process with gain 1, held input, one cell a step; its first state is its output.
    fn sampled<const N: usize>(self, theta: &Theta) -> [[f64; N]; N] {
        let den = self.denominator(theta);
        let n = den.len() - 1;
        let mut generator = Matrix::zeros(n + 1);
        for i in 0..n - 1 {
            generator.set(i, i + 1, 1.0);
        }
        for j in 0..n {
            generator.set(n - 1, j, -den[j] / den[n]);
        }
        generator.set(n - 1, n, 1.0 / den[n]);
        let step = generator.exp();
        let mut transition = [[0.0; N]; N];
        for i in 0..n {
            for j in 0..=n {
                transition[i][j] = step.get(i, j);
            }
        }
        transition[N - 2][N - 2] = 1.0;
        transition
    }

    fn models<const N: usize>(self, thetas: &[Theta; LANES]) -> Models<N> {
        let sampled = thetas.map(|theta| self.sampled::<N>(&theta));
        let mut transition: [[Lanes; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|j| lanes(|l| sampled[l][i][j])));
        let noise = |l: usize, place: usize| thetas[l][self.lags + 1 + place];
        let nothing = [0.0; LANES];
        let (q_load, q_drift, pole) = match self.noise {
            Noise::Input => (lanes(|l| noise(l, 0).exp()), nothing, nothing),
            Noise::Output => (nothing, lanes(|l| noise(l, 0).exp()), lanes(|l| logistic(noise(l, 1)))),
            Noise::Both => {
                (lanes(|l| noise(l, 0).exp()), lanes(|l| noise(l, 1).exp()), lanes(|l| logistic(noise(l, 2))))
            }
        };
        transition[N - 1][N - 1] = pole;
        let drift_at_start = lanes(|l| q_drift[l] / (1.0 - pole[l] * pole[l]));
        Models { transition, q_load, q_drift, drift_at_start }
    }

    /// States of the model: process, load, drift.
    fn states(self) -> usize {
        self.lags + usize::from(self.integrating) + 2
    }

    /// See [`Models::whiten`].
    pub(crate) fn whiten(self, thetas: &[Theta; LANES], y: &[f64], jumps: &[usize], v: &[Lanes], white: &mut White) {
        // The widest vectors that the machine has; nothing is fused, so the bits are the same with any.
        let arch = pulp::Arch::new();
        match self.states() {
            4 => {
                let models = self.models::<4>(thetas);
                arch.dispatch(|| models.whiten(y, jumps, v, white))
            }
            _ => {
                let models = self.models::<5>(thetas);
                arch.dispatch(|| models.whiten(y, jumps, v, white))
            }
        }
    }

    /// See [`Models::invent`].
    pub(crate) fn invent(
        self,
        theta: &Theta,
        y: &[f64],
        jumps: &[usize],
        kp_v: &[f64],
        draw: &mut impl FnMut() -> f64,
    ) -> Vec<f64> {
        match self.states() {
            4 => self.models::<4>(&[*theta; LANES]).invent(y, jumps, kp_v, draw),
            _ => self.models::<5>(&[*theta; LANES]).invent(y, jumps, kp_v, draw),
        }
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}
