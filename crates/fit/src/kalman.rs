//! The innovations of a record: what each sample of PV brings that the model did not foresee.

/// Models that are run side by side: the recurrence waits for itself, four of them fill the waiting.
pub(crate) const LANES: usize = 4;

/// One number for each of the models that run side by side.
pub(crate) type Lanes = [f64; LANES];

#[inline(always)]
pub(crate) fn lanes(of: impl FnMut(usize) -> f64) -> Lanes {
    std::array::from_fn(of)
}

/// Models of one sample step, `N` = order of the process + 2: the process, the load at its input (a random walk) and a
/// drift at its output (first order, its pole in the last place of `transition`).
///
/// ```text
/// x⁺ = A·x + b·(kp·v + w)      w⁺ = w + n₁, variance q_load
/// o⁺ = pole·o + n₂, variance q_drift
/// y  = x₀ + o + e, variance 1
/// ```
///
/// Variances are in units of the white noise on PV, whose own size drops out of the likelihood.
#[derive(Clone, Debug)]
pub(crate) struct Models<const N: usize> {
    /// The whole transition, load and drift included.
    pub(crate) transition: [[Lanes; N]; N],
    pub(crate) q_load: Lanes,
    pub(crate) q_drift: Lanes,
    /// Variance of the drift before the first sample.
    pub(crate) drift_at_start: Lanes,
}

/// Variance that stands for "not known at all", at the start and for the load where it jumps, in units of the white noise.
pub(crate) const UNKNOWN: f64 = 1e8;
/// Samples of PV at the beginning of a stretch that tell where the process and the load stand; they are worth nothing, so
/// that models with more states do not pay for a start that nobody asked about.
pub(crate) const START: usize = 6;

/// What a pass over a record leaves: innovations divided by their standard deviations, of PV and of the model's answer
/// with gain 1, and Σ ln S.
#[derive(Clone, Debug, Default)]
pub(crate) struct White {
    pub(crate) of_y: Vec<Lanes>,
    pub(crate) of_v: Vec<Lanes>,
    pub(crate) log_s: Lanes,
}

/// Variance of the next innovation and the Kalman gain, kept while they move and frozen once they stand still.
struct Gain<const N: usize> {
    p: [[Lanes; N]; N],
    k: [Lanes; N],
    s: Lanes,
    /// ln S and 1/√S.
    log_s: Lanes,
    scale: Lanes,
    still: u32,
}

impl<const N: usize> Models<N> {
    const LOAD: usize = N - 2;
    const DRIFT: usize = N - 1;

    /// Innovations of `y` and of the answer to the positions `v`, for each sample of `y` that is a number; Kalman
    /// filter from an unknown start (the first [`START`] count as 0), the load unknown again at each of the cells `jumps`.
    #[inline(always)]
    pub(crate) fn whiten(&self, y: &[f64], jumps: &[usize], v: &[Lanes], white: &mut White) {
        let mut gain = self.start();
        let (mut of_y, mut of_v) = ([[0.0; LANES]; N], [[0.0; LANES]; N]);
        let mut seen = 0;
        for (k, (&y, v)) in y.iter().zip(v).enumerate() {
            if y.is_nan() {
                gain.still = 0;
            } else {
                let e_y = lanes(|l| y - of_y[0][l] - of_y[Self::DRIFT][l]);
                let e_v = lanes(|l| -of_v[0][l] - of_v[Self::DRIFT][l]);
                let worth = if seen < START { 0.0 } else { 1.0 };
                seen += 1;
                white.of_y.push(lanes(|l| worth * e_y[l] * gain.scale[l]));
                // The model's own answer enters with the other sign: y − kp·answer.
                white.of_v.push(lanes(|l| -worth * e_v[l] * gain.scale[l]));
                for l in 0..LANES {
                    white.log_s[l] += worth * gain.log_s[l];
                }
                for i in 0..N {
                    for l in 0..LANES {
                        of_y[i][l] += gain.k[i][l] * e_y[l];
                        of_v[i][l] += gain.k[i][l] * e_v[l];
                    }
                }
            }
            self.step(&mut of_y);
            self.step(&mut of_v);
            // The load enters where the valve does: its column is the process' answer to the position.
            for i in 0..N - 2 {
                for l in 0..LANES {
                    of_v[i][l] += self.transition[i][Self::LOAD][l] * v[l];
                }
            }
            self.advance(&mut gain, y.is_nan(), jumps.contains(&(k + 1)));
        }
    }

    /// A record that the first model itself could have made: `y` up to the sample at which the start is forgotten, from
    /// there on the model's foresight plus `draw()` standard deviations.
    pub(crate) fn invent(&self, y: &[f64], jumps: &[usize], kp_v: &[f64], draw: &mut impl FnMut() -> f64) -> Vec<f64> {
        let mut gain = self.start();
        let mut x = [[0.0; LANES]; N];
        let mut made = Vec::with_capacity(y.len());
        let mut seen = 0;
        for (k, (&y, &v)) in y.iter().zip(kp_v).enumerate() {
            if y.is_nan() {
                made.push(y);
                gain.still = 0;
            } else {
                let foresight = x[0][0] + x[Self::DRIFT][0];
                // After a jump PV itself has to tell the load.
                let known = seen >= 2 * N && !jumps.iter().any(|j| (*j..*j + 2 * N).contains(&k));
                let value = if !known { y } else { foresight + draw() / gain.scale[0] };
                seen += 1;
                made.push(value);
                for i in 0..N {
                    x[i][0] += gain.k[i][0] * (value - foresight);
                }
            }
            self.step(&mut x);
            for i in 0..N - 2 {
                x[i][0] += self.transition[i][Self::LOAD][0] * v;
            }
            self.advance(&mut gain, y.is_nan(), jumps.contains(&(k + 1)));
        }
        made
    }

    /// The load stays where it is and the drift fades: only the process' rows are full.
    #[inline(always)]
    fn step(&self, x: &mut [Lanes; N]) {
        let mut next = [[0.0; LANES]; N];
        for i in 0..N - 2 {
            for j in 0..N - 1 {
                for l in 0..LANES {
                    next[i][l] += self.transition[i][j][l] * x[j][l];
                }
            }
        }
        x[..N - 2].copy_from_slice(&next[..N - 2]);
        for l in 0..LANES {
            x[Self::DRIFT][l] *= self.transition[Self::DRIFT][Self::DRIFT][l];
        }
    }

    #[inline(always)]
    fn start(&self) -> Gain<N> {
        let mut p = [[[0.0; LANES]; N]; N];
        for (i, row) in p.iter_mut().enumerate() {
            row[i] = [UNKNOWN; LANES];
        }
        p[Self::DRIFT][Self::DRIFT] = self.drift_at_start.map(|v| v.min(UNKNOWN));
        let nothing = [0.0; LANES];
        let mut gain = Gain { p, k: [nothing; N], s: nothing, log_s: nothing, scale: nothing, still: 0 };
        Self::measure(&mut gain);
        gain
    }

    /// Variance of the next innovation and the gain, from P.
    #[inline(always)]
    fn measure(gain: &mut Gain<N>) {
        let d = Self::DRIFT;
        let p = &gain.p;
        gain.s = lanes(|l| p[0][0][l] + 2.0 * p[0][d][l] + p[d][d][l] + 1.0);
        for i in 0..N {
            gain.k[i] = lanes(|l| (p[i][0][l] + p[i][d][l]) / gain.s[l]);
        }
        gain.log_s = gain.s.map(f64::ln);
        gain.scale = gain.s.map(|s| 1.0 / s.sqrt());
    }

    /// One step on. The gain of a stretch without holes settles; from then on it is not worked out again.
    #[inline(always)]
    fn advance(&self, gain: &mut Gain<N>, missing: bool, jump: bool) {
        if gain.still > 3 && !jump {
            return;
        }
        if !missing {
            for i in 0..N {
                let by = lanes(|l| gain.k[i][l] * gain.s[l]);
                for j in 0..N {
                    for l in 0..LANES {
                        gain.p[i][j][l] -= by[l] * gain.k[j][l];
                    }
                }
            }
        }
        // F·P·Fᵀ: the same step for the columns, then for the rows; P is its own transpose.
        for column in &mut gain.p {
            self.step(column);
        }
        for i in 0..N {
            for j in 0..i {
                let lower = gain.p[i][j];
                gain.p[i][j] = gain.p[j][i];
                gain.p[j][i] = lower;
            }
        }
        for row in &mut gain.p {
            self.step(row);
        }
        for l in 0..LANES {
            gain.p[Self::LOAD][Self::LOAD][l] += self.q_load[l] + if jump { UNKNOWN } else { 0.0 };
            gain.p[Self::DRIFT][Self::DRIFT][l] += self.q_drift[l];
        }
        let before = gain.s;
        Self::measure(gain);
        let stands = (0..LANES).all(|l| (gain.s[l] - before[l]).abs() < 1e-7 * before[l]);
        gain.still = if stands { gain.still + 1 } else { 0 };
    }
}
