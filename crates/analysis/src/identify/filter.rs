//! The controller's filter of PV before the law.

/// A filter: `order` lags of `tf` [s] before everything, or one of `tfd` [s] before the D part alone.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Filter {
    /// The controller runs once a recorded sample; else much faster.
    pub scans: bool,
    /// Equal lags before everything, at most two.
    pub order: u8,
    /// Time constant of each [s]; 0 where there is none.
    pub tf: f64,
    /// Time constant of the lag before the D part alone [s]; 0 where there is none.
    pub tfd: f64,
}

impl Filter {
    /// No filter: the controller sees PV as it was recorded.
    pub(super) fn none(scans: bool) -> Self {
        Self { scans, order: 0, tf: 0.0, tfd: 0.0 }
    }

    /// Whether there is a lag at all.
    pub(super) fn lags(&self) -> bool {
        self.tf > 0.0 || self.tfd > 0.0
    }
}

/// One lag: yf += (x − yf) h/(Tf + h) once a sample, or that of a signal straight between samples.
#[derive(Clone, Copy)]
pub(super) struct Lag {
    a: f64,
    now: f64,
    before: f64,
    x: f64,
    /// Output of the filter.
    pub y: f64,
}

impl Lag {
    /// Steady state for a constant input x.
    pub fn new(x: f64, tf: f64, h: f64, scans: bool) -> Self {
        let (a, now, before) = if scans {
            (tf / (tf + h), h / (tf + h), 0.0)
        } else {
            let a = (-h / tf).exp();
            let mean = tf / h * (1.0 - a);
            (a, 1.0 - mean, mean - a)
        };
        Self { a, now, before, x, y: x }
    }

    /// Filters one sample.
    pub fn update(&mut self, x: f64) -> f64 {
        self.y = self.a * self.y + (self.now * x + self.before * self.x);
        self.x = x;
        self.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_a_sample_it_is_the_filter_of_the_controller() {
        let x: Vec<f64> = (0..200).map(|k| (f64::from(k) / 7.0).sin()).collect();
        let mut yf = x[0];
        let mut lag = Lag::new(x[0], 3.0, 0.5, true);
        for x in x {
            yf += (x - yf) * 0.5 / 3.5;
            assert!((lag.update(x) - yf).abs() < 1e-14);
        }
    }

    #[test]
    fn between_the_samples_a_ramp_comes_out_late_by_the_time_constant() {
        let (tf, h) = (3.0, 0.5);
        let mut lag = Lag::new(0.0, tf, h, false);
        for k in 0..400 {
            let t = f64::from(k) * h;
            let exact = t - tf + tf * (-t / tf).exp();
            assert!((lag.update(t) - exact).abs() < 1e-12, "{t} {} {exact}", lag.y);
        }
    }

    #[test]
    fn a_constant_stays() {
        for scans in [true, false] {
            let mut lag = Lag::new(4.0, 2.0, 1.0, scans);
            assert!((0..50).all(|_| (lag.update(4.0) - 4.0).abs() < 1e-14));
        }
    }
}
