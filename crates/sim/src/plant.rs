//! The process under control: a transfer function with dead time, sampled exactly.

use crate::SimError;
use crate::error::require;
use crate::matrix::Matrix;

/// The highest order of a plant.
pub const MAX_ORDER: usize = 10;

/// Transfer function num(s)/den(s)·e^(−L·s), coefficients in descending powers of s.
///
/// Integrators are zeros at the end of `den`. The dead time L \[s\] is exact, not an approximation.
///
/// ```
/// use glapp_sim::Plant;
///
/// let tank = Plant::new(vec![2.0], vec![10.0, 1.0, 0.0], 0.5)?; // 2/(s·(10s + 1))·e^(−0.5s)
/// assert_eq!(tank.gain(), None);
/// assert_eq!(Plant::named("P2")?.gain(), Some(1.0));
/// # Ok::<(), glapp_sim::SimError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    /// Divided by the first coefficient of `den`, padded with zeros in front to the length of `den` less one.
    num: Vec<f64>,
    /// Divided by its first coefficient, which is left out.
    den: Vec<f64>,
    dead_time: f64,
}

/// A named process of the thesis' test batch: name, num, den, dead time \[s\].
pub type Named = (&'static str, &'static [f64], &'static [f64], f64);

/// The test batch (thesis 4.1).
pub const BATCH: [Named; 8] = [
    ("P1", &[1.0], &[0.8, 1.0, 0.0], 0.2),
    ("P2", &[1.0], &[1.0, 4.0, 6.0, 4.0, 1.0], 0.0),
    ("P3", &[9.0], &[1.0, 3.0, 11.0, 9.0], 0.0),
    ("P4", &[1.0], &[2.0, 1.0], 4.0),
    ("P5", &[1.0], &[1.0, 3.0, 3.0, 1.0], 0.0),
    ("P6", &[-0.5, 1.0], &[1.0, 3.0, 3.0, 1.0], 0.0),
    ("P7", &[1.0], &[1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0], 0.0),
    ("P8", &[1.0], &[0.0025, 0.1, 1.0], 1.0),
];

impl Plant {
    /// A plant: `num` of lower degree than `den`, `den` of degree 1 to [`MAX_ORDER`], `dead_time` ≥ 0 \[s\].
    pub fn new(num: Vec<f64>, den: Vec<f64>, dead_time: f64) -> Result<Self, SimError> {
        require("dead_time", dead_time, dead_time >= 0.0, "0 s or greater")?;
        if num.iter().chain(&den).any(|c| !c.is_finite()) {
            return Err(SimError::Plant("every coefficient must be a number"));
        }
        let significant = |c: Vec<f64>| c.into_iter().skip_while(|c| *c == 0.0).collect::<Vec<_>>();
        let (num, den) = (significant(num), significant(den));
        if num.is_empty() || den.is_empty() {
            return Err(SimError::Plant("num and den must each have a coefficient other than 0"));
        }
        let order = den.len() - 1;
        if num.len() > order {
            return Err(SimError::Improper { num: num.len() - 1, den: order });
        }
        if order > MAX_ORDER {
            return Err(SimError::Plant("den must be of degree 10 or lower"));
        }
        if num.last() == Some(&0.0) {
            return Err(SimError::Plant("num must not end in 0: no constant output could hold the process value"));
        }
        let mut padded = vec![0.0; order - num.len()];
        padded.extend(num.iter().map(|b| b / den[0]));
        Ok(Self { num: padded, den: den[1..].iter().map(|a| a / den[0]).collect(), dead_time })
    }

    /// A process of the test batch, `"P1"` to `"P8"`.
    pub fn named(name: &str) -> Result<Self, SimError> {
        let (_, num, den, dead_time) =
            BATCH.iter().find(|p| p.0 == name).ok_or_else(|| SimError::UnknownPlant(name.into()))?;
        Self::new(num.to_vec(), den.to_vec(), *dead_time)
    }

    /// Static gain Kp [process value per output]; none for an integrating process.
    pub fn gain(&self) -> Option<f64> {
        let n = self.order() - 1;
        (self.den[n] != 0.0).then(|| self.num[n] / self.den[n])
    }

    /// Dead time \[s\].
    pub fn dead_time(&self) -> f64 {
        self.dead_time
    }

    /// This plant with a dead time of at most `longest` \[s\].
    pub(crate) fn within(self, longest: f64) -> Self {
        Self { dead_time: self.dead_time.min(longest), ..self }
    }

    /// Number of poles.
    pub fn order(&self) -> usize {
        self.den.len()
    }

    /// Change of the process value by a constant input of 1 within `t` seconds, by the slowest part of the response.
    pub(crate) fn reach(&self, t: f64) -> f64 {
        let integrators = self.den.iter().rev().take_while(|a| **a == 0.0).count();
        let slowest = if integrators == self.order() { 1.0 } else { self.den[self.order() - 1 - integrators] };
        (self.num[self.order() - 1] / slowest).abs() * t.powi(integrators as i32)
    }

    /// The state equations ẋ = A·x + B·v, y = x₀ in observer form, as \[A B\], and the scale of the states.
    ///
    /// State i carries the factor σ^−i, σ being the greatest |aᵢ|^(1/i): then no entry exceeds σ, however far apart the
    /// coefficients lie. A power of two, so that scaling rounds nothing.
    fn state_equations(&self) -> (Matrix, f64) {
        let n = self.order();
        let sigma = (1..=n).map(|i| self.den[i - 1].abs().powf(1.0 / i as f64)).fold(0.0, f64::max);
        let sigma = if sigma > 0.0 { sigma.log2().round().exp2() } else { 1.0 };
        let mut ab = Matrix::zeros(n + 1);
        for i in 0..n {
            let scale = sigma.powi(i as i32);
            ab.set(i, 0, -self.den[i] / scale);
            ab.set(i, n, self.num[i] / scale);
        }
        for i in 1..n {
            ab.set(i - 1, i, sigma);
        }
        (ab, sigma)
    }
}

/// A dead time as whole steps of `h` and the rest.
pub(crate) fn delay(dead_time: f64, h: f64) -> (usize, f64) {
    let steps = dead_time / h;
    // A dead time meant as a multiple of h must not become a step less and a sliver.
    let whole = if (steps - steps.round()).abs() < 1e-9 { steps.round() } else { steps.floor() };
    (whole as usize, (dead_time - whole * h).max(0.0))
}

/// A [`Plant`] of order `N` between samples `h` apart, its input held from sample to sample (exact zero-order hold).
///
/// x(k+1) = Φ·x(k) + Γ₀·w(k) + Γ₁·w(k−1), y = x₀, w(k) = v(k−m) and dead time = m·h + f with 0 ≤ f < h: what entered f
/// seconds into the step acts only for the rest of it (Åström and Wittenmark, *Computer-Controlled Systems*, 3.2).
pub(crate) struct Sampled<const N: usize> {
    /// Φ by columns, so that a step is N additions of whole columns.
    phi: [[f64; N]; N],
    gamma0: [f64; N],
    gamma1: [f64; N],
    /// Whole steps of dead time m.
    delay: usize,
    /// aᵢ and bᵢ over the states' scale, for the state at rest.
    rest: [(f64, f64); N],
}

/// State of a [`Sampled`] plant.
#[derive(Clone)]
pub(crate) struct SampledState<const N: usize> {
    x: [f64; N],
    w_old: f64,
    /// The inputs of the last m steps, the oldest at `at`.
    ring: Vec<f64>,
    at: usize,
}

impl<const N: usize> Sampled<N> {
    pub(crate) fn new(plant: &Plant, h: f64) -> Result<Self, SimError> {
        require("h", h, h > 0.0, "greater than 0 s")?;
        let (ab, sigma) = plant.state_equations();
        let fastest = ab.spectral_radius();
        if h * fastest > std::f64::consts::PI {
            return Err(SimError::Coarse { h, bound: std::f64::consts::PI / fastest });
        }
        let (delay, f) = delay(plant.dead_time, h);
        let (rest_of_step, begin) = (ab.scaled(h - f).exp(), ab.scaled(f).exp());
        let column = |m: &Matrix, j: usize| std::array::from_fn(|i| m.get(i, j));
        let full = rest_of_step.times(&begin);
        let mut sliver = begin;
        for i in 0..=N {
            for j in 0..N {
                sliver.set(i, j, f64::from(u8::from(i == j)));
            }
        }
        sliver.set(N, N, 0.0);
        Ok(Self {
            phi: std::array::from_fn(|j| column(&full, j)),
            gamma0: column(&rest_of_step, N),
            gamma1: column(&rest_of_step.times(&sliver), N),
            delay,
            rest: std::array::from_fn(|i| {
                let scale = sigma.powi(i as i32 + 1);
                (plant.den[i] / scale, plant.num[i] / scale)
            }),
        })
    }

    /// Φ by columns, Γ₀ and Γ₁.
    pub(crate) fn matrices(&self) -> (&[[f64; N]; N], &[f64; N], &[f64; N]) {
        (&self.phi, &self.gamma0, &self.gamma1)
    }

    /// The state at rest with output `y` under the constant input `v`; `steps` are all that will be taken.
    pub(crate) fn at_rest(&self, y: f64, v: f64, steps: usize) -> SampledState<N> {
        let x = std::array::from_fn(|i| match i {
            0 => y,
            _ => self.rest[i - 1].0 * y - self.rest[i - 1].1 * v,
        });
        // An input after the end is never seen: a dead time longer than the run needs no longer memory than the run.
        SampledState { x, w_old: v, ring: vec![v; self.delay.min(steps)], at: 0 }
    }

    /// Takes the input held from this sample to the next, gives the output at the next.
    #[inline(always)]
    pub(crate) fn update(&self, state: &mut SampledState<N>, v: f64) -> f64 {
        let w = state.delayed(v);
        let mut next = [0.0; N];
        for (column, x) in self.phi.iter().zip(state.x) {
            for (sum, a) in next.iter_mut().zip(column) {
                *sum += a * x;
            }
        }
        for (sum, gamma1) in next.iter_mut().zip(&self.gamma1) {
            *sum += gamma1 * state.w_old;
        }
        // The newest input last: the loop waits for it.
        for (sum, gamma0) in next.iter_mut().zip(&self.gamma0) {
            *sum += gamma0 * w;
        }
        state.x = next;
        state.w_old = w;
        state.x[0]
    }
}

impl<const N: usize> SampledState<N> {
    /// State x.
    pub(crate) fn x(&self) -> &[f64; N] {
        &self.x
    }

    #[inline(always)]
    fn delayed(&mut self, v: f64) -> f64 {
        let Some(slot) = self.ring.get_mut(self.at) else { return v };
        let w = std::mem::replace(slot, v);
        self.at = if self.at + 1 == self.ring.len() { 0 } else { self.at + 1 };
        w
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest distance between the sampled step response and `exact`, over `t_end`.
    fn step_error<const N: usize>(plant: &Plant, h: f64, t_end: f64, exact: impl Fn(f64) -> f64) -> f64 {
        let sampled = Sampled::<N>::new(plant, h).unwrap();
        let mut state = sampled.at_rest(0.0, 0.0, usize::MAX);
        (1..(t_end / h) as usize)
            .map(|k| (sampled.update(&mut state, 1.0) - exact(k as f64 * h)).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn step_responses_known_in_closed_form() {
        let lags = |n: i32| {
            move |t: f64| {
                let mut term = 1.0;
                1.0 - (-t).exp()
                    * (0..n)
                        .map(|i| {
                            if i > 0 {
                                term *= t / f64::from(i);
                            }
                            term
                        })
                        .sum::<f64>()
            }
        };
        assert!(step_error::<4>(&Plant::named("P2").unwrap(), 0.05, 60.0, lags(4)) < 1e-12);
        assert!(step_error::<8>(&Plant::named("P7").unwrap(), 0.05, 60.0, lags(8)) < 1e-9);
        let late = |t: f64| if t > 4.0 { 1.0 - (-(t - 4.0) / 2.0).exp() } else { 0.0 };
        for h in [0.05, 0.3, 1.7, 5.0] {
            assert!(step_error::<1>(&Plant::named("P4").unwrap(), h, 60.0, late) < 1e-13, "h = {h}");
        }
        let ramp = |t: f64| if t > 0.2 { t - 0.2 - 0.8 * (1.0 - (-(t - 0.2) / 0.8).exp()) } else { 0.0 };
        for h in [0.05, 0.07, 0.2, 0.33] {
            assert!(step_error::<2>(&Plant::named("P1").unwrap(), h, 60.0, ramp) < 1e-11, "h = {h}");
        }
    }

    #[test]
    fn at_rest_nothing_moves() {
        for (name, ..) in BATCH {
            let plant = Plant::named(name).unwrap();
            let (y, v) = (3.0, plant.gain().map_or(0.0, |kp| 3.0 / kp));
            fn drift<const N: usize>(plant: &Plant, y: f64, v: f64) -> f64 {
                let sampled = Sampled::<N>::new(plant, 0.05).unwrap();
                let mut state = sampled.at_rest(y, v, 1000);
                (0..1000).map(|_| (sampled.update(&mut state, v) - y).abs()).fold(0.0, f64::max)
            }
            let moved = match plant.order() {
                1 => drift::<1>(&plant, y, v),
                2 => drift::<2>(&plant, y, v),
                3 => drift::<3>(&plant, y, v),
                4 => drift::<4>(&plant, y, v),
                _ => drift::<8>(&plant, y, v),
            };
            assert!(moved < 1e-9, "{name} moved by {moved}");
        }
    }

    #[test]
    fn wrong_plants_are_refused() {
        let plant = |num: &[f64], den: &[f64], dead_time| Plant::new(num.to_vec(), den.to_vec(), dead_time);
        assert_eq!(plant(&[1.0, 0.0, 2.0], &[1.0, 1.0], 0.0), Err(SimError::Improper { num: 2, den: 1 }));
        assert_eq!(plant(&[1.0], &[1.0], 0.0), Err(SimError::Improper { num: 0, den: 0 }));
        assert!(matches!(plant(&[1.0], &[1.0, 1.0], -1.0), Err(SimError::Parameter(e)) if e.name == "dead_time"));
        for (num, den) in
            [(&[f64::NAN][..], &[1.0, 1.0][..]), (&[], &[1.0, 1.0]), (&[1.0], &[0.0]), (&[0.0], &[1.0, 0.0])]
        {
            assert!(matches!(plant(num, den, 0.0), Err(SimError::Plant(_))));
        }
        assert!(matches!(plant(&[1.0, 0.0], &[1.0, 1.0, 0.0], 0.0), Err(SimError::Plant(_))));
        assert!(matches!(plant(&[1.0], &[1.0; 12], 0.0), Err(SimError::Plant(_))));
        assert!(matches!(Plant::named("P9"), Err(SimError::UnknownPlant(_))));
    }

    #[test]
    fn wrong_steps_are_refused() {
        let plant = Plant::named("P8").unwrap();
        assert!(matches!(Sampled::<2>::new(&plant, 0.0), Err(SimError::Parameter(e)) if e.name == "h"));
        let Err(SimError::Coarse { bound, .. }) = Sampled::<2>::new(&plant, 0.2) else { panic!("0.2 s accepted") };
        assert!((bound - std::f64::consts::PI / 20.0).abs() < 1e-3 * bound);
    }
}
