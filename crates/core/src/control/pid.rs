//! The PI/PID controller of the loops that are watched.

use crate::error::require;
use crate::{ParameterError, Real, Saturation, Sum};

/// PI or PID controller in ideal form with setpoint weight, limits and anti-windup.
///
/// ```text
/// u = K·(b·ysp − yf + (1/Ti)·∫(ysp − yf) dt − Td·dyf/dt)          (4.1), where b = 0
/// ```
///
/// `yf` is the filtered process value: the second-order filter stands outside, before the controller, because the
/// derivative takes a plain difference. One sample, in this order:
///
/// ```text
/// i := I + K·h/Ti·(ysp − yf)
/// v := K·(b·ysp − yf) + i − K·Td/h·(yf − yf_old)
/// u := v, kept within low … high
/// I := i + (u − v)·(h/(Ti + h))             anti-windup by tracking, time constant Ti
/// ```
///
/// Off the limits this is the velocity form Δu = K·(b·Δysp − Δyf) + K·h/Ti·(ysp − yf) − …, which is what an
/// identification of K and Ti from a recording looks for.
///
/// A sample that is no number, or a step h that is not above 0, repeats the last output and changes nothing.
///
/// ```
/// use glapp_core::{Saturation, Pid, PidState};
///
/// let pi = Pid::new(2.0, 10.0, 0.0, 1.0, Saturation::new(0.0, 100.0)?)?;
/// let mut state = PidState::default();
/// pi.track(&mut state, 50.0, 50.0, 40.0, 1.0); // in manual at 40 %
/// assert_eq!(pi.update(&mut state, 50.0, 50.0, 1.0), 40.0); // to auto without a bump
/// assert_eq!(pi.update(&mut state, 51.0, 50.0, 1.0), 40.0 + 2.0 * 1.0 + 2.0 / 10.0 * 1.0);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid<R> {
    k: R,
    ti: R,
    td: R,
    b: R,
    limits: Saturation<R>,
}

/// State of a [`Pid`] from sample to sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PidState<R: Real> {
    /// Integral part [unit of the output].
    pub integral: R::Sum,
    /// The last filtered process value [unit of the process value].
    pub y: R::Sum,
    /// The last output [unit of the output].
    pub output: R,
    /// False until the first sample, which therefore has no derivative.
    pub started: bool,
}

impl<R: Real> Pid<R> {
    /// A PID with gain `k` ≠ 0, negative for a direct-acting controller [output per process value], integral time `ti` > 0 \[s\],
    /// derivative time `td` ≥ 0 \[s\], setpoint weight `b` between 0 and 1.
    pub fn new(k: R, ti: R, td: R, b: R, limits: Saturation<R>) -> Result<Self, ParameterError> {
        Ok(Self {
            k: require("k", k, k != R::ZERO, "a number other than 0")?,
            ti: require("ti", ti, ti > R::ZERO, "greater than 0 s")?,
            td: require("td", td, td >= R::ZERO, "0 s or greater")?,
            b: require("b", b, b >= R::ZERO && b <= R::ONE, "between 0 and 1")?,
            limits,
        })
    }

    /// This law with other settings, for one sample of a controller whose gains and limits move.
    #[inline(always)]
    pub(crate) fn with(self, k: R, ti: R, td: R, limits: Saturation<R>) -> Self {
        Self { k, ti, td, b: self.b, limits }
    }

    /// Takes setpoint, filtered process value and the time since the last sample `h` \[s\]; gives the output in auto.
    #[inline(always)]
    pub fn update(&self, state: &mut PidState<R>, ysp: R, yf: R, h: R) -> R {
        self.control(state, ysp, yf.into(), h)
    }

    /// [`update`](Self::update) with what `yf` carries.
    #[inline(always)]
    pub(crate) fn control(&self, state: &mut PidState<R>, ysp: R, yf: R::Sum, h: R) -> R {
        let v_without_i = self.proportional(ysp, yf) - self.derivative(state, yf, h);
        let mut integral = state.integral;
        integral.add(self.k * h / self.ti * yf.to(ysp));
        let v = v_without_i + integral.value();
        if !v.is_number() || h <= R::ZERO {
            return state.output;
        }
        let u = self.limits.update(v);
        integral.add((u - v) * (h / (self.ti + h)));
        *state = PidState { integral, y: yf, output: u, started: true };
        u
    }

    /// Takes one sample in manual, with the output `u` set by someone else; gives `u` within the limits.
    ///
    /// The integral follows, so that the next [`update`](Self::update) continues from `u` without a bump.
    #[inline(always)]
    pub fn track(&self, state: &mut PidState<R>, ysp: R, yf: R, u: R, h: R) -> R {
        self.follow(state, ysp, yf.into(), u, h)
    }

    /// [`track`](Self::track) with what `yf` carries.
    #[inline(always)]
    pub(crate) fn follow(&self, state: &mut PidState<R>, ysp: R, yf: R::Sum, u: R, h: R) -> R {
        if !u.is_number() {
            return state.output;
        }
        let u = self.limits.update(u);
        let v_without_i = self.proportional(ysp, yf) - self.derivative(state, yf, h);
        if v_without_i.is_number() && h > R::ZERO {
            *state = PidState { integral: (u - v_without_i).into(), y: yf, output: u, started: true };
        } else {
            state.integral.add(u - state.output);
            state.output = u;
        }
        u
    }

    /// Proportional part K·(b·ysp − yf).
    #[inline(always)]
    fn proportional(&self, ysp: R, yf: R::Sum) -> R {
        self.k * yf.to(self.b * ysp)
    }

    /// Derivative part −K·Td/h·Δyf.
    #[inline(always)]
    fn derivative(&self, state: &PidState<R>, yf: R::Sum, h: R) -> R {
        if state.started && self.td > R::ZERO && h > R::ZERO {
            self.k * self.td / h * yf.since(state.y)
        } else {
            R::ZERO
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pid(td: f64, b: f64) -> Pid<f64> {
        Pid::new(0.8, 5.0, td, b, Saturation::new(-1.0, 1.0).unwrap()).unwrap()
    }

    #[test]
    fn parameters_out_of_bounds_are_named() {
        let none = Saturation::none();
        for (k, ti, td, b, name) in [
            (0.0, 1.0, 0.0, 0.0, "k"),
            (f64::NAN, 1.0, 0.0, 0.0, "k"),
            (1.0, 0.0, 0.0, 0.0, "ti"),
            (1.0, 1.0, -1.0, 0.0, "td"),
            (1.0, 1.0, 0.0, 1.5, "b"),
        ] {
            assert_eq!(Pid::new(k, ti, td, b, none).unwrap_err().name, name);
        }
    }

    #[test]
    fn leaves_the_limit_when_the_error_turns() {
        let pi = pid(0.0, 1.0);
        let mut state = PidState::default();
        for _ in 0..10_000 {
            assert!(pi.update(&mut state, 10.0, 0.0, 0.1) <= 1.0);
        }
        // Without anti-windup the integral would be at 1600 and take minutes to come back.
        let back = (0..).take_while(|_| pi.update(&mut state, 0.0, 0.1, 0.1) >= 1.0).count();
        assert!(back < 5, "still at the limit after {back} samples");
    }

    #[test]
    fn bad_samples_repeat_the_output() {
        let controller = pid(1.0, 0.5);
        let mut state = PidState::default();
        let u = controller.update(&mut state, 0.3, 0.1, 0.1);
        let before = state;
        for (ysp, y, h) in [(f64::NAN, 0.1, 0.1), (0.3, f64::INFINITY, 0.1), (0.3, 0.2, 0.0), (0.3, 0.2, -1.0)] {
            assert_eq!(controller.update(&mut state, ysp, y, h), u);
            assert_eq!(state, before);
        }
        assert_eq!(controller.track(&mut state, 0.3, f64::NAN, 0.4, 0.1), 0.4);
        assert!((state.integral - before.integral - (0.4 - u)).abs() < 1e-15);
        assert_eq!(controller.track(&mut state, 0.3, 0.1, f64::NAN, 0.1), 0.4);
    }

    #[test]
    fn single_precision_follows() {
        let wide = pid(0.3, 0.5);
        let narrow = Pid::<f32>::new(0.8, 5.0, 0.3, 0.5, Saturation::new(-1.0, 1.0).unwrap()).unwrap();
        let (mut a, mut b) = (PidState::default(), PidState::default());
        for i in 0_u8..200 {
            let y = f32::from(i % 7) * 0.125; // exact in both
            let (u, v) = (wide.update(&mut a, 0.5, y.into(), 0.25), narrow.update(&mut b, 0.5, y, 0.25));
            assert!((u - f64::from(v)).abs() < 1e-5, "{u} and {v}");
        }
    }

    proptest! {
        #[test]
        fn never_beyond_the_limits_and_sign_symmetric(
            td in 0.0..3.0_f64, b in 0.0..1.0_f64,
            samples in prop::collection::vec((-2.0..2.0_f64, -2.0..2.0_f64, 0.01..1.0_f64), 1..60),
        ) {
            let controller = pid(td, b);
            let (mut s, mut mirrored) = (PidState::default(), PidState::default());
            for &(ysp, y, h) in &samples {
                let u = controller.update(&mut s, ysp, y, h);
                prop_assert!((-1.0..=1.0).contains(&u));
                prop_assert_eq!(u, -controller.update(&mut mirrored, -ysp, -y, h));
            }
        }

        #[test]
        fn manual_to_auto_without_a_bump(
            td in 0.0..3.0_f64, b in 0.0..1.0_f64, y in -2.0..2.0_f64, ysp in -2.0..2.0_f64, u in -1.0..1.0_f64,
        ) {
            let controller = pid(td, b);
            let h = 0.1;
            let mut state = PidState::default();
            for _ in 0..3 {
                controller.track(&mut state, ysp, y, u, h);
            }
            // All that the first sample in auto may add is its own integration.
            let expected = (u + 0.8 * h / 5.0 * (ysp - y)).clamp(-1.0, 1.0);
            prop_assert!((controller.update(&mut state, ysp, y, h) - expected).abs() < 1e-12);
        }
    }
}
