//! The filter times that are tried where none is given.

use super::Crossings;
use glapp_core::{DetectorSettings, ParameterError};

/// Filter times tried where none is given, in Ti, after the shortest that serves (thesis 2.1, 8.2, 8.4).
pub const LADDER: [f64; 4] = [0.2, 0.5, 1.0, 2.0];

/// A detector for every filter time that is tried, side by side over one recording.
#[derive(Clone, Debug)]
pub struct Ladder {
    rungs: Vec<Crossings>,
}

impl Ladder {
    /// A ladder with the filter time of the settings where it is `given`; else with all: the shortest that serves
    /// ([`DetectorSettings::filter_time`]) and those of [`LADDER`] above it.
    pub fn new(settings: DetectorSettings<f64>, given: bool) -> Result<Self, ParameterError> {
        let DetectorSettings { ti, td, tf, .. } = settings;
        let mut times = vec![if given { tf } else { DetectorSettings::filter_time(ti, td.unwrap_or(0.0)) }];
        if !given {
            let first = times[0];
            times.extend(LADDER.iter().map(|share| share * ti).filter(|tf| *tf > first));
        }
        let rung = |tf: &f64| Crossings::new(DetectorSettings { tf: *tf, ..settings });
        Ok(Self { rungs: times.iter().map(rung).collect::<Result<_, _>>()? })
    }

    /// A ladder from the detectors of one that was saved.
    pub(super) fn of(rungs: Vec<Crossings>) -> Self {
        Self { rungs }
    }

    /// The detectors, in ascending filter times.
    pub fn rungs(&self) -> &[Crossings] {
        &self.rungs
    }

    /// The detectors, to give them samples.
    pub fn rungs_mut(&mut self) -> &mut [Crossings] {
        &mut self.rungs
    }

    /// A ladder whose half-periods are judged with another process gain, see [`Crossings::with_gain`].
    ///
    /// # Errors
    ///
    /// Where `kp` is out of its bounds.
    pub fn with_gain(&self, kp: Option<f64>) -> Result<Self, ParameterError> {
        Ok(Self { rungs: self.rungs.iter().map(|rung| rung.with_gain(kp)).collect::<Result<_, _>>()? })
    }

    /// Index of the filter time to use: the smallest that leaves enough accepted half-periods, (N + 1)/2; where none
    /// does, the one with most. A longer filter reads low.
    pub fn choose(&self) -> usize {
        let enough = |rung: &Crossings| rung.accepted() >= u64::from(rung.settings().n).div_ceil(2);
        let most = self.rungs.iter().map(Crossings::accepted).max().unwrap_or(0);
        let found = self.rungs.iter().position(enough);
        found.or_else(|| self.rungs.iter().position(|rung| rung.accepted() == most)).unwrap_or(0)
    }

    /// The index of the chosen filter time, and the crossings found with it.
    pub fn chosen(mut self) -> (usize, Crossings) {
        let chosen = self.choose();
        (chosen, self.rungs.swap_remove(chosen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::Columns;

    fn settings() -> DetectorSettings<f64> {
        DetectorSettings::new(0.5, 10.0, 0.0, 1.0)
    }

    #[test]
    fn a_given_filter_time_is_the_only_one() {
        let times = |ladder: &Ladder| ladder.rungs().iter().map(|rung| rung.settings().tf).collect::<Vec<_>>();
        assert_eq!(times(&Ladder::new(settings(), true).unwrap()), [settings().tf]);
        assert_eq!(times(&Ladder::new(settings(), false).unwrap()), [1.0, 2.0, 5.0, 10.0, 20.0]);
        let derivative = DetectorSettings::new(0.5, 10.0, 15.0, 1.0); // Td/5 = 3 s
        assert_eq!(times(&Ladder::new(derivative, false).unwrap()), [3.0, 5.0, 10.0, 20.0]);
    }

    #[test]
    fn noise_asks_for_a_longer_filter() {
        // A square wave under noise that crosses SP at every other sample until it is filtered.
        let t: Vec<f64> = (0..6000).map(f64::from).collect();
        let wave = |k: usize| if (k / 100).is_multiple_of(2) { -1.0 } else { 1.0 };
        let noise = |k: usize| if k.is_multiple_of(2) { 12.0 } else { -12.0 };
        let chosen = |pv: Vec<f64>| {
            let mut ladder = Ladder::new(settings(), false).unwrap();
            for rung in ladder.rungs_mut() {
                rung.take(Columns { t: &t, sp: &vec![0.0; t.len()], pv: &pv, op: None, flags: None });
            }
            ladder.choose()
        };
        assert_eq!(chosen((0..t.len()).map(wave).collect()), 0);
        assert!(chosen((0..t.len()).map(|k| wave(k) + noise(k)).collect()) > 0);
    }
}
