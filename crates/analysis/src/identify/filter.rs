//! What PV passes through in the controller before the law.

/// A filter: `order` lags of `tf` [s] before everything, or one of `tfd` [s] before the D part alone.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// PV goes in as it was recorded.
    pub(super) fn none(scans: bool) -> Self {
        Self { scans, order: 0, tf: 0.0, tfd: 0.0 }
    }

    /// Whether there is a lag at all.
    pub(super) fn lags(&self) -> bool {
        self.tf > 0.0 || self.tfd > 0.0
    }
}

/// Passes x through one lag: yf += (x − yf) h/(Tf + h) once a sample, or that of a signal straight between samples.
pub(super) fn lagged(x: &[f64], tf: f64, h: f64, scans: bool) -> Vec<f64> {
    let (a, now, before) = if scans {
        (tf / (tf + h), h / (tf + h), 0.0)
    } else {
        let a = (-h / tf).exp();
        let mean = tf / h * (1.0 - a);
        (a, 1.0 - mean, mean - a)
    };
    let Some(&first) = x.first() else { return Vec::new() };
    let (mut last, mut y) = (first, first);
    x.iter()
        .map(|&x| {
            y = a * y + (now * x + before * last);
            last = x;
            y
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_a_sample_it_is_the_filter_of_the_controller() {
        let x: Vec<f64> = (0..200).map(|k| (f64::from(k) / 7.0).sin()).collect();
        let mut yf = x[0];
        for (x, y) in x.iter().zip(lagged(&x, 3.0, 0.5, true)) {
            yf += (x - yf) * 0.5 / 3.5;
            assert!((y - yf).abs() < 1e-14);
        }
    }

    #[test]
    fn between_the_samples_a_ramp_comes_out_late_by_the_time_constant() {
        let (tf, h) = (3.0, 0.5);
        let x: Vec<f64> = (0..400).map(|k| f64::from(k) * h).collect();
        let y = lagged(&x, tf, h, false);
        for (k, y) in y.iter().enumerate() {
            let t = k as f64 * h;
            let exact = t - tf + tf * (-t / tf).exp();
            assert!((y - exact).abs() < 1e-12, "{t} {y} {exact}");
        }
    }

    #[test]
    fn a_constant_stays_and_nothing_gives_nothing() {
        assert!(lagged(&[4.0; 50], 2.0, 1.0, false).iter().all(|y| (y - 4.0).abs() < 1e-14));
        assert!(lagged(&[], 2.0, 1.0, true).is_empty());
    }
}
