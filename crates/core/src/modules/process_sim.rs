//! A process to test loops with: two lags and a dead time.

use crate::error::require;
use crate::modules::Forward;
use crate::{ParameterError, Real, Sum};

/// Process K/((1 + s·T1)(1 + s·T2))·e^(−L·s) at a fixed scan time (thesis 6.5, `ProcessSimCC`).
///
/// ```text
/// w := input + load, L seconds ago         between two scans in proportion
/// y1 := y1 + (w − y1)·h/(T1 + h)
/// y2 := y2 + (y1 − y2)·h/(T2 + h)
/// output of the next scan := gain·y2
/// ```
///
/// What it gives in a scan was made by the inputs of the scans before: it is the delay that a loop in a graph needs.
///
/// It is a plant, where flags end: a bad input leaves the last one in effect, and what comes out is a new measurement.
///
/// Known bias: the division-only lags, as in [`SecondOrderFilter`](crate::SecondOrderFilter), need no exponential
/// function and are stable for every h, but a lag of T acts like one of about T + h/2. For an exact plant of any order
/// take the simulator's.
///
/// `N` values are remembered: the dead time is at most N − 2 scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessSim<R, const N: usize> {
    gain: R,
    a1: R,
    a2: R,
    whole: usize,
    part: R,
}

/// State of [`ProcessSim`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessSimState<R: Real, const N: usize> {
    y1: R::Sum,
    y2: R::Sum,
    inputs: [R; N],
    at: usize,
}

impl<R: Real, const N: usize> ProcessSimState<R, N> {
    /// Steady state for the constant input `x`.
    pub fn at_rest(x: R) -> Self {
        Self { y1: x.into(), y2: x.into(), inputs: [x; N], at: 0 }
    }
}

impl<R: Real, const N: usize> ProcessSim<R, N> {
    /// A process with static `gain` ≠ 0 [output per input], lags `t1`, `t2` ≥ 0 \[s\], `dead_time` ≥ 0 \[s\], scan time `h` > 0 \[s\].
    pub fn new(gain: R, t1: R, t2: R, dead_time: R, h: R) -> Result<Self, ParameterError> {
        require("h", h, h > R::ZERO, "greater than 0 s")?;
        let steps = require("dead_time", dead_time, dead_time >= R::ZERO, "0 s or greater")? / h;
        let bound = "at most what the module remembers, N − 2 scans";
        require("dead_time", dead_time, steps <= R::of(N as f64 - 2.0), bound)?;
        // A dead time meant as a multiple of h must not become a scan less and a sliver.
        let whole = (steps + R::SLIVER).as_f64() as usize;
        let part = steps - R::of(whole as f64);
        let share = |name, t: R| Ok(h / (require(name, t, t >= R::ZERO, "0 s or greater")? + h));
        Ok(Self {
            gain: require("gain", gain, gain != R::ZERO, "a number other than 0")?,
            a1: share("t1", t1)?,
            a2: share("t2", t2)?,
            whole,
            part: if part > R::SLIVER { part } else { R::ZERO },
        })
    }

    /// Output in this scan.
    #[inline(always)]
    pub fn output(&self, state: &ProcessSimState<R, N>) -> Forward<R> {
        Forward::new(self.gain * state.y2.value(), 0)
    }

    /// Takes the input of this scan and the load on it, moves on to the next scan.
    #[inline(always)]
    pub fn forward(&self, state: &mut ProcessSimState<R, N>, x: Forward<R>, load: Forward<R>) {
        let s = state;
        let input = if x.is_good() && load.is_good() { x.value + load.value } else { s.inputs[s.at] };
        s.at = if s.at + 1 < N { s.at + 1 } else { 0 };
        s.inputs[s.at] = input;
        let ago = |steps: usize| s.inputs[if steps <= s.at { s.at - steps } else { s.at + N - steps }];
        let late = ago(self.whole);
        let w = if self.part > R::ZERO { late + (ago(self.whole + 1) - late) * self.part } else { late };
        s.y1.add(s.y1.to(w) * self.a1);
        s.y2.add(s.y1.since(s.y2) * self.a2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::BAD;
    use std::vec::Vec;

    fn step_response(process: &ProcessSim<f64, 64>, n: usize) -> Vec<f64> {
        let mut state = ProcessSimState::at_rest(0.0);
        (0..n)
            .map(|_| {
                let y = process.output(&state).value;
                process.forward(&mut state, 1.0.into(), 0.0.into());
                y
            })
            .collect()
    }

    #[test]
    fn parameters_out_of_bounds_are_named() {
        let new = |gain, t1, t2, dead_time, h| ProcessSim::<f64, 64>::new(gain, t1, t2, dead_time, h);
        for (process, name) in [
            (new(0.0, 1.0, 1.0, 0.0, 0.1), "gain"),
            (new(1.0, -1.0, 1.0, 0.0, 0.1), "t1"),
            (new(1.0, 1.0, f64::NAN, 0.0, 0.1), "t2"),
            (new(1.0, 1.0, 1.0, -1.0, 0.1), "dead_time"),
            (new(1.0, 1.0, 1.0, 6.3, 0.1), "dead_time"),
            (new(1.0, 1.0, 1.0, 0.0, 0.0), "h"),
        ] {
            assert_eq!(process.unwrap_err().name, name);
        }
        assert!(new(1.0, 1.0, 1.0, 6.2, 0.1).is_ok());
    }

    #[test]
    fn follows_the_lags_in_closed_form() {
        let h = 0.01;
        let process = ProcessSim::<f64, 64>::new(2.0, 1.0, 3.0, 0.0, h).unwrap();
        for (k, y) in step_response(&process, 2000).into_iter().enumerate() {
            let t = k as f64 * h;
            let exact = 2.0 * (1.0 - (1.5 * (-t / 3.0).exp() - 0.5 * (-t).exp()));
            assert!((y - exact).abs() < 0.5 * h, "{y} instead of {exact} at {t} s");
        }
    }

    #[test]
    fn a_lag_acts_half_a_scan_longer() {
        let (h, lag) = (0.1, 2.0);
        let y = step_response(&ProcessSim::new(1.0, lag, 0.0, 0.0, h).unwrap(), 50);
        let decay = (1.0 - y[41]) / (1.0 - y[40]);
        assert!((decay - (-h / (lag + h / 2.0)).exp()).abs() < 1e-5);
        assert!((decay - (-h / lag).exp()).abs() > 1e-3);
    }

    #[test]
    fn dead_time_shifts_by_scans_and_parts_of_them() {
        let h = 0.1;
        let at = |dead_time: f64| step_response(&ProcessSim::new(1.0, 0.5, 0.0, dead_time, h).unwrap(), 200);
        let (none, whole, half) = (at(0.0), at(0.3), at(0.35));
        assert_eq!(none[..100], whole[3..103]);
        for k in 4..100 {
            let between = (none[k - 3] + none[k - 4]) / 2.0;
            assert!((half[k] - between).abs() < 1e-14);
        }
        // The longest dead time: the ring goes round.
        let long = at(6.2);
        assert_eq!(none[..100], long[62..162]);
    }

    /// Regression: in `f32` 0.7/0.1 is 6.9999995; it still counts seven scans.
    #[test]
    fn dead_time_in_single_precision_is_no_scan_less() {
        for scans in 0_u8..=62 {
            let dead_time = (f64::from(scans) * 0.1) as f32;
            let process = ProcessSim::<f32, 64>::new(1.0, 0.0, 0.0, dead_time, 0.1).unwrap();
            assert_eq!((process.whole, process.part), (scans.into(), 0.0));
        }
        assert!((ProcessSim::<f32, 64>::new(1.0, 0.0, 0.0, 0.25, 0.1).unwrap().part - 0.5).abs() < 1e-6);
    }

    #[test]
    fn bad_input_leaves_the_last_in_effect() {
        let process = ProcessSim::<f64, 8>::new(1.0, 1.0, 1.0, 0.0, 0.1).unwrap();
        let (mut a, mut b) = (ProcessSimState::at_rest(0.0), ProcessSimState::at_rest(0.0));
        process.forward(&mut a, 2.0.into(), 1.0.into());
        process.forward(&mut b, 2.0.into(), 1.0.into());
        for bad in [Forward::new(f64::NAN, 0), Forward::new(50.0, BAD)] {
            process.forward(&mut a, bad, 1.0.into());
            process.forward(&mut b, 2.0.into(), 1.0.into());
            assert_eq!(process.output(&a), process.output(&b));
            assert_eq!(process.output(&a).flags, 0);
        }
    }
}
