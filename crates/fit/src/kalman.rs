//! The innovations of a record: what each sample of PV brings that the model did not foresee.

/// Models that are run side by side: the recurrence waits for itself, eight of them fill the waiting, and a point with all
/// its derivatives is one pass.
pub(crate) const LANES: usize = 8;

/// One number for each of the models that run side by side.
pub(crate) type Lanes = [f64; LANES];

#[inline(always)]
pub(crate) fn lanes(of: impl FnMut(usize) -> f64) -> Lanes {
    std::array::from_fn(of)
}

/// Models of one sample step with `N` states: those of the process, the load at its input (a random walk), and with
/// `DRIFTS` = 1 a drift at its output (first order).
///
/// ```text
/// x⁺ = A·x + b·(kp·v + w)      w⁺ = w + n₁, variance q_load
/// o⁺ = pole·o + n₂, variance q_drift
/// y  = x₀ + o + e, variance 1
/// ```
///
/// Variances are in units of the white noise on PV, whose own size drops out of the likelihood.
#[derive(Clone, Debug)]
pub(crate) struct Models<const N: usize, const DRIFTS: usize> {
    /// The rows of the process; the load's column is b.
    pub(crate) transition: [[Lanes; N]; N],
    pub(crate) q_load: Lanes,
    pub(crate) q_drift: Lanes,
    pub(crate) pole: Lanes,
}

/// A cell before which the load may have jumped in some of the models.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jump {
    pub(crate) cell: usize,
    /// Variance of the jump in each of the models.
    pub(crate) variance: Lanes,
    /// How much earlier than the cell began [cells], below 1.
    pub(crate) before: Lanes,
}

impl Jump {
    /// The jumps of all the models, each given by its times [cells].
    pub(crate) fn gathered<'t>(times: impl Fn(usize) -> &'t [f64]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for l in 0..LANES {
            for time in times(l) {
                let cell = time.ceil() as usize;
                let at = all.iter().position(|jump| jump.cell == cell).unwrap_or_else(|| {
                    all.push(Self { cell, variance: [0.0; LANES], before: [0.0; LANES] });
                    all.len() - 1
                });
                all[at].variance[l] = UNKNOWN;
                all[at].before[l] = time.ceil() - time;
            }
        }
        all
    }
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

impl White {
    /// Empty again, its room kept.
    pub(crate) fn clear(&mut self) {
        self.of_y.clear();
        self.of_v.clear();
        self.log_s = [0.0; LANES];
    }
}

/// Variances of which the product is gathered before its logarithm is taken: none is below 1 or far above 10⁹.
const GATHERED: u32 = 16;

/// Variance of the next innovation and the Kalman gain, kept while they move and frozen once they stand still.
struct Gain<const N: usize> {
    /// Below its diagonal P is what it is above, and not kept there.
    p: [[Lanes; N]; N],
    k: [Lanes; N],
    s: Lanes,
    /// 1/√S.
    scale: Lanes,
    still: u32,
}

impl<const N: usize> Gain<N> {
    #[inline(always)]
    fn frozen(&self) -> bool {
        self.still > 3
    }

    #[inline(always)]
    fn p(&self, i: usize, j: usize) -> &Lanes {
        if i < j { &self.p[i][j] } else { &self.p[j][i] }
    }
}

impl<const N: usize, const DRIFTS: usize> Models<N, DRIFTS> {
    /// States of the process, behind which the load stands, and last the drift.
    const ORDER: usize = N - 1 - DRIFTS;
    /// States that the process' rows look at.
    const INNER: usize = N - DRIFTS;
    const LOAD: usize = Self::ORDER;
    const DRIFT: usize = N - 1;

    /// Innovations of `y` and of the answer to the positions `v`, for each sample of `y` that is a number; Kalman
    /// filter from an unknown start (the first [`START`] count as 0), the load unknown again at each of the `jumps`.
    #[inline(always)]
    pub(crate) fn whiten(&self, y: &[f64], jumps: &[Jump], v: &[Lanes], white: &mut White) {
        let mut gain = self.start();
        let (mut of_y, mut of_v) = ([[0.0; LANES]; N], [[0.0; LANES]; N]);
        let mut seen = 0;
        // Σ ln S: a product while S moves, a count once it stands still.
        let (mut product, mut gathered, mut frozen) = ([1.0; LANES], 0, 0);
        for (k, (&y, v)) in y.iter().zip(v).enumerate() {
            if y.is_nan() {
                gain.still = 0;
            } else {
                let e_y = self.unforeseen(&of_y, y);
                let e_v = self.unforeseen(&of_v, 0.0);
                let worth = if seen < START { 0.0 } else { 1.0 };
                seen += 1;
                white.of_y.push(lanes(|l| worth * e_y[l] * gain.scale[l]));
                // The model's own answer enters with the other sign: y − kp·answer.
                white.of_v.push(lanes(|l| -worth * e_v[l] * gain.scale[l]));
                if seen > START && gain.frozen() {
                    frozen += 1;
                } else if seen > START {
                    product = lanes(|l| product[l] * gain.s[l]);
                    gathered += 1;
                    if gathered == GATHERED {
                        white.log_s = lanes(|l| white.log_s[l] + product[l].ln());
                        (product, gathered) = ([1.0; LANES], 0);
                    }
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
            for i in 0..Self::ORDER {
                for l in 0..LANES {
                    of_v[i][l] += self.transition[i][Self::LOAD][l] * v[l];
                }
            }
            let jump = jumps.iter().find(|jump| jump.cell == k + 1);
            if frozen > 0 && (jump.is_some() || y.is_nan()) {
                white.log_s = lanes(|l| white.log_s[l] + f64::from(frozen) * gain.s[l].ln());
                frozen = 0;
            }
            self.advance(&mut gain, y.is_nan(), jump);
        }
        white.log_s = lanes(|l| white.log_s[l] + product[l].ln() + f64::from(frozen) * gain.s[l].ln());
    }

    /// A record that the first model itself could have made: `y` up to the sample at which the start is forgotten, from
    /// there on the model's foresight plus `draw()` standard deviations.
    pub(crate) fn invent(&self, y: &[f64], jumps: &[f64], kp_v: &[f64], draw: &mut impl FnMut() -> f64) -> Vec<f64> {
        let mut gain = self.start();
        let mut x = [[0.0; LANES]; N];
        let mut made = Vec::with_capacity(y.len());
        let mut seen = 0;
        // The load and the drift are told by as many samples as the process.
        let told = 2 * (Self::ORDER + 2);
        let all = Jump::gathered(|_| jumps);
        for (k, (&y, &v)) in y.iter().zip(kp_v).enumerate() {
            if y.is_nan() {
                made.push(y);
                gain.still = 0;
            } else {
                let foresight = -self.unforeseen(&x, 0.0)[0];
                // After a jump PV itself has to tell the load.
                let known =
                    seen >= told && !jumps.iter().any(|j| (j.ceil() as usize..j.ceil() as usize + told).contains(&k));
                let value = if !known { y } else { foresight + draw() / gain.scale[0] };
                seen += 1;
                made.push(value);
                for i in 0..N {
                    x[i][0] += gain.k[i][0] * (value - foresight);
                }
            }
            self.step(&mut x);
            for i in 0..Self::ORDER {
                x[i][0] += self.transition[i][Self::LOAD][0] * v;
            }
            self.advance(&mut gain, y.is_nan(), all.iter().find(|jump| jump.cell == k + 1));
        }
        made
    }

    /// What the states `x` did not foresee of `y`.
    #[inline(always)]
    fn unforeseen(&self, x: &[Lanes; N], y: f64) -> Lanes {
        if DRIFTS == 0 {
            return lanes(|l| y - x[0][l]);
        }
        lanes(|l| y - x[0][l] - x[Self::DRIFT][l])
    }

    /// The load stays where it is and the drift fades: only the process' rows are full.
    #[inline(always)]
    fn step(&self, x: &mut [Lanes; N]) {
        let before = *x;
        for i in 0..Self::ORDER {
            x[i] = self.row(i, |j| &before[j]);
        }
        if DRIFTS == 1 {
            x[Self::DRIFT] = lanes(|l| self.pole[l] * before[Self::DRIFT][l]);
        }
    }

    /// A row of the transition times a column.
    #[inline(always)]
    fn row<'a>(&self, i: usize, of: impl Fn(usize) -> &'a Lanes) -> Lanes {
        let mut sum = [0.0; LANES];
        for j in 0..Self::INNER {
            let of = of(j);
            for l in 0..LANES {
                sum[l] += self.transition[i][j][l] * of[l];
            }
        }
        sum
    }

    #[inline(always)]
    fn start(&self) -> Gain<N> {
        let nothing = [0.0; LANES];
        let mut p = [[nothing; N]; N];
        for (i, row) in p.iter_mut().enumerate() {
            row[i] = [UNKNOWN; LANES];
        }
        if DRIFTS == 1 {
            let at_start = lanes(|l| self.q_drift[l] / (1.0 - self.pole[l] * self.pole[l]));
            p[Self::DRIFT][Self::DRIFT] = lanes(|l| at_start[l].min(UNKNOWN));
        }
        let mut gain = Gain { p, k: [nothing; N], s: nothing, scale: nothing, still: 0 };
        Self::measure(&mut gain);
        gain
    }

    /// Variance of the next innovation and the gain, from P.
    #[inline(always)]
    fn measure(gain: &mut Gain<N>) {
        let d = Self::DRIFT;
        let mut seen: [Lanes; N] = std::array::from_fn(|i| *gain.p(i, 0));
        if DRIFTS == 1 {
            for i in 0..N {
                seen[i] = lanes(|l| seen[i][l] + gain.p(i, d)[l]);
            }
        }
        gain.s = lanes(|l| seen[0][l] + if DRIFTS == 1 { seen[d][l] } else { 0.0 } + 1.0);
        let part = lanes(|l| 1.0 / gain.s[l]);
        for i in 0..N {
            gain.k[i] = lanes(|l| seen[i][l] * part[l]);
        }
        gain.scale = lanes(|l| part[l].sqrt());
    }

    /// One step on. The gain of a stretch without holes settles; from then on it is not worked out again.
    #[inline(always)]
    fn advance(&self, gain: &mut Gain<N>, missing: bool, jump: Option<&Jump>) {
        if gain.frozen() && jump.is_none() {
            return;
        }
        if !missing {
            for i in 0..N {
                let by = lanes(|l| gain.k[i][l] * gain.s[l]);
                for j in i..N {
                    for l in 0..LANES {
                        gain.p[i][j][l] -= by[l] * gain.k[j][l];
                    }
                }
            }
        }
        // F·P, of which only the process' rows are new, then ·Fᵀ.
        let mut half = [[[0.0; LANES]; N]; N];
        for i in 0..Self::ORDER {
            for j in 0..N {
                half[i][j] = self.row(i, |m| gain.p(m, j));
            }
        }
        for i in 0..Self::ORDER {
            for j in i..Self::ORDER {
                gain.p[i][j] = self.row(j, |m| &half[i][m]);
            }
        }
        for i in 0..Self::ORDER {
            gain.p[i][Self::LOAD] = half[i][Self::LOAD];
        }
        for l in 0..LANES {
            gain.p[Self::LOAD][Self::LOAD][l] += self.q_load[l];
        }
        if let Some(jump) = jump {
            // What of it reaches the states within the cell; the last one follows at once, the others one after another.
            let mut reached = [[1.0; LANES]; N];
            for i in (0..Self::ORDER).rev() {
                let later = if i + 1 < Self::ORDER { reached[i + 1] } else { [1.0; LANES] };
                reached[i] = lanes(|l| jump.before[l] * later[l]);
            }
            for i in 0..Self::ORDER {
                reached[i] = lanes(|l| reached[i][l] * self.transition[i][Self::LOAD][l]);
            }
            for i in 0..=Self::LOAD {
                for j in i..=Self::LOAD {
                    for l in 0..LANES {
                        gain.p[i][j][l] += jump.variance[l] * reached[i][l] * reached[j][l];
                    }
                }
            }
        }
        if DRIFTS == 1 {
            let d = Self::DRIFT;
            for i in 0..Self::ORDER {
                gain.p[i][d] = lanes(|l| self.pole[l] * half[i][d][l]);
            }
            gain.p[Self::LOAD][d] = lanes(|l| self.pole[l] * gain.p[Self::LOAD][d][l]);
            gain.p[d][d] = lanes(|l| self.pole[l] * self.pole[l] * gain.p[d][d][l] + self.q_drift[l]);
        }
        let before = gain.s;
        Self::measure(gain);
        let mut stands = true;
        for l in 0..LANES {
            stands &= (gain.s[l] - before[l]).abs() < 1e-7 * before[l];
        }
        gain.still = if stands { gain.still + 1 } else { 0 };
    }
}
