//! Valves that stick and slip.

use crate::error::require;
use crate::{ParameterError, Real};

/// Stick-slip friction of a valve as data shows it: total dead band plus stick band `s`, slip jump `j`, 0 ≤ j ≤ s, both
/// in the unit of the output.
///
/// ```text
///   position
///     │          ╱ ╱        after a reversal the output moves by s before the stem does,
///     │        ╱ │╱         then the stem jumps by j
///     │      ╱  ╱j          and, moving, follows (s − j)/2 behind
///     │    ╱  ╱
///     └───┴──┴────── output
///          ← s →
/// ```
///
/// The stem, at rest at p, breaks loose where |u − p| > (s + j)/2. Both models lead it to u ∓ (s − j)/2 then; they differ
/// in what happens next:
/// - [`Model::Kano`] (Kano, Maruta, Kugemoto and Shimizu, *Practical model and detection algorithm for valve stiction*,
///   DYCOPS 2004): the stem goes on following until the output stands still or turns.
/// - [`Model::He`] (He, Wang, Pottmann and Qin, *A curve fitting method for detecting valve stiction in oscillating
///   control loops*, Ind. Eng. Chem. Res. 46, 2007): the stem sticks again at once, at every sample, with static
///   friction fs = (s + j)/2 against kinetic friction fd = (s − j)/2.
///
/// With j = 0 either is backlash of width s, He's to the bit or two.
///
/// An output that is no number leaves the stem where it is.
///
/// ```
/// use glapp_core::{Friction, FrictionState, Model};
///
/// let friction = Friction::new(Model::Kano, 3.0, 1.0)?;
/// let mut state = FrictionState::at(0.0); // in the middle of the band
/// let stem = [1.0, 2.0, 2.5, 3.0, 2.0, 0.0].map(|u| friction.update(&mut state, u));
/// assert_eq!(stem, [0.0, 0.0, 1.5, 2.0, 2.0, 2.0]);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction<R> {
    model: Model,
    s: R,
    j: R,
}

/// Data-driven model of friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Model {
    /// Moves until the output turns or stops.
    Kano,
    /// Sticks at every sample.
    He,
}

/// Stem of a valve with [`Friction`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FrictionState<R> {
    /// Position of the stem [unit of the output].
    pub position: R,
    u: R,
    /// Direction of movement, 0 at rest.
    direction: R,
}

impl<R: Real> FrictionState<R> {
    /// A valve at rest, the output `u` in the middle of the band.
    pub fn at(u: R) -> Self {
        Self { position: u, u, direction: R::ZERO }
    }
}

impl<R: Real> Friction<R> {
    /// Friction with stick band plus dead band `s` ≥ 0 and slip jump 0 ≤ `j` ≤ `s`.
    pub fn new(model: Model, s: R, j: R) -> Result<Self, ParameterError> {
        require("s", s, s >= R::ZERO, "0 or greater")?;
        require("j", j, j >= R::ZERO && j <= s, "0 or greater, at most s")?;
        Ok(Self { model, s, j })
    }

    /// Model, stick band plus dead band, slip jump.
    pub fn parameters(&self) -> (Model, R, R) {
        (self.model, self.s, self.j)
    }

    /// Takes the output, gives the position of the stem.
    pub fn update(&self, state: &mut FrictionState<R>, u: R) -> R {
        if !u.is_number() {
            return state.position;
        }
        let half = |sum: R| sum / R::of(2.0);
        let (loose, behind) = (half(self.s + self.j), half(self.s - self.j));
        let goes_on = self.model == Model::Kano && (u - state.u) * state.direction > R::ZERO;
        state.u = u;
        if !goes_on {
            let force = u - state.position;
            state.direction = match force {
                _ if force > loose => R::ONE,
                _ if force < -loose => -R::ONE,
                _ => R::ZERO,
            };
        }
        if state.direction != R::ZERO {
            state.position = u - state.direction * behind;
        }
        state.position
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Backlash, BacklashState};
    use std::vec::Vec;

    /// Slow triangle between ±5 in steps of 0.01.
    fn triangle() -> impl Iterator<Item = f64> {
        (0..6000).map(|k| {
            let phase = (k + 500) % 2000;
            f64::from(if phase < 1000 { phase } else { 2000 - phase }) * 0.01 - 5.0
        })
    }

    #[test]
    fn kano_shows_its_band_and_its_jump() {
        let friction = Friction::new(Model::Kano, 3.0, 1.0).unwrap();
        let mut state = FrictionState::at(0.0);
        let path: Vec<(f64, f64)> = triangle().map(|u| (u, friction.update(&mut state, u))).collect();
        // Only the last two sweeps: up from −5, and down from 5.
        let path = &path[3500..5500];
        let jumps: Vec<f64> = path.windows(2).map(|w| w[1].1 - w[0].1).filter(|step| step.abs() > 0.02).collect();
        assert_eq!(jumps.len(), 2, "one jump a sweep");
        assert!(jumps.iter().all(|jump| (jump.abs() - 1.0).abs() < 0.02), "{jumps:?}");
        let widest = |y: f64| {
            let u: Vec<f64> = path.iter().filter(|p| (p.1 - y).abs() < 0.02).map(|p| p.0).collect();
            u.iter().fold(f64::MIN, |a, b| a.max(*b)) - u.iter().fold(f64::MAX, |a, b| a.min(*b))
        };
        // At the turn the stem rests over the whole of s; in mid-travel the two ways lie s − j apart.
        assert!((widest(4.0) - 3.0).abs() < 0.05, "{}", widest(4.0));
        assert!((widest(0.0) - 2.0).abs() < 0.05, "{}", widest(0.0));
    }

    #[test]
    fn he_climbs_in_stairs() {
        let friction = Friction::new(Model::He, 3.0, 1.0).unwrap();
        let mut state = FrictionState::at(0.0);
        let path: Vec<f64> = triangle().map(|u| friction.update(&mut state, u)).collect();
        let steps: Vec<f64> = path.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|s| *s > 0.0).collect();
        assert!(steps.len() > 20 && steps.iter().all(|s| (s - 1.0).abs() < 0.02), "every movement is a slip of j");
    }

    #[test]
    fn without_a_jump_both_are_backlash() {
        let (gap, mut in_gap) = (Backlash::new(1.2).unwrap(), BacklashState::at(0.0));
        let models = [Model::Kano, Model::He].map(|model| Friction::new(model, 1.2, 0.0).unwrap());
        let mut states = [FrictionState::at(0.0); 2];
        for u in triangle() {
            let x = gap.update(&mut in_gap, u);
            for (model, state) in models.iter().zip(&mut states) {
                assert!((model.update(state, u) - x).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn wrong_bands_are_named() {
        for (s, j, name) in [(-1.0, 0.0, "s"), (1.0, 1.5, "j"), (1.0, -0.1, "j"), (f64::NAN, 0.0, "s")] {
            assert_eq!(Friction::new(Model::Kano, s, j).unwrap_err().name, name);
        }
    }
}
