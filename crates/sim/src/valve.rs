//! A control valve as a mechanism: positioner and actuator, a stem with friction, a worn joint, a curve.

use crate::SimError;
use crate::error::require;
use glapp_core::{Backlash, BacklashState};

/// A control valve, all of it in the unit of the output; the actuator's spring has the rate 1.
///
/// ```text
///   op ──→ ○ ──→ positioner ──→ actuator ──→ stem ──┬──→ joint ──→ plug ──→ curve ──→ flow
///          │ −                     p          x     │      d
///          └────────────────────────────────────────┘
/// ```
///
/// - The positioner is proportional: it asks for p = op + g·(op − x). The actuator's pressure follows with the time
///   constant `lag`.
/// - Without a [`Stem`] x = p. With one, (1/w²)·ẍ = p − x − friction(ẋ).
/// - The plug follows the stem through a clearance of total width `d`.
/// - The curve gives the flow where the plug stands e beyond its point of rest: e/(1 − c·e/100). Its slope is 1 at rest,
///   c > 0 opens like an equal-percentage valve, c < 0 like a quick-opening one.
///
/// Coulomb friction alone is a dead band of 2·fc/(1 + g).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Valve {
    /// Time constant of the actuator ≥ 0 \[s\].
    pub lag: f64,
    /// Gain g of the positioner ≥ 0; 0 for none.
    pub positioner: f64,
    /// Mass and friction of the stem; `None`: it follows the pressure.
    pub stem: Option<Stem>,
    /// Total width of the clearance between stem and plug ≥ 0 [unit of the output].
    pub d: f64,
    /// Bend c of the curve, −1.8 to 1.8; 0 for a straight one.
    pub curve: f64,
}

/// A stem with mass and friction.
///
/// Friction that slides is g(v) = fc + (fs − fc)/(1 + |v|/v_s) against the movement, and `viscous`·v; it slips, in
/// jumps, where (fs − fc)/v_s exceeds `viscous`. Below
/// |force| ≤ fs the stem sticks:
/// - [`StemModel::Karnopp`] (Karnopp, *Computer simulation of stick-slip friction in mechanical dynamic systems*, J. Dyn.
///   Syst. Meas. Control 107, 1985): it stands still until the force exceeds fs.
/// - [`StemModel::LuGre`] (Canudas de Wit, Olsson, Åström and Lischinsky, *A new model for control of systems with
///   friction*, IEEE Trans. Automatic Control 40, 1995): bristles of 100 times the spring's rate bend first, by fs/100.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stem {
    /// Model of friction.
    pub model: StemModel,
    /// Static friction ≥ `fc` [unit of the output].
    pub fs: f64,
    /// Coulomb friction ≥ 0 [unit of the output].
    pub fc: f64,
    /// Stribeck speed v_s > 0 [unit of the output per s].
    pub stribeck: f64,
    /// Viscous friction ≥ 0 \[s\].
    pub viscous: f64,
    /// Natural frequency w of stem and spring > 0 \[rad/s\].
    pub w: f64,
}

/// Model of friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StemModel {
    /// Stands still.
    Karnopp,
    /// Bends before it breaks loose.
    LuGre,
}

/// Rate of the bristles, in rates of the actuator's spring.
const BRISTLES: f64 = 100.0;

/// A [`Valve`] that moves.
#[derive(Clone, Debug)]
pub(crate) struct Moving {
    valve: Valve,
    joint: Backlash<f64>,
    plug: BacklashState<f64>,
    /// Steps between two samples, and how long each is \[s\].
    steps: u32,
    dt: f64,
    /// Part of the way to its target that the pressure goes in a step.
    share: f64,
    rest: f64,
    p: f64,
    x: f64,
    v: f64,
    /// Bending of the bristles.
    z: f64,
}

impl Valve {
    /// Steady state at the output `op`, for samples `h` apart.
    pub(crate) fn at_rest(&self, op: f64, h: f64) -> Result<Moving, SimError> {
        require("valve.lag", self.lag, self.lag >= 0.0, "0 s or greater")?;
        require("valve.positioner", self.positioner, self.positioner >= 0.0, "0 or greater")?;
        require("valve.curve", self.curve, self.curve.abs() <= 1.8, "between -1.8 and 1.8")?;
        let mut a_second = if self.lag > 0.0 { 10.0 * (1.0 + self.positioner) / self.lag } else { 0.0 };
        if let Some(stem) = &self.stem {
            require("valve.stem.fc", stem.fc, stem.fc >= 0.0, "0 or greater")?;
            require("valve.stem.fs", stem.fs, stem.fs >= stem.fc, "fc or greater")?;
            require("valve.stem.stribeck", stem.stribeck, stem.stribeck > 0.0, "greater than 0")?;
            require("valve.stem.viscous", stem.viscous, stem.viscous >= 0.0, "0 s or greater")?;
            require("valve.stem.w", stem.w, stem.w > 0.0, "greater than 0 rad/s")?;
            // The positioner, the bristles and the viscous friction make it faster than the spring alone.
            let own = match stem.model {
                StemModel::Karnopp => 20.0,
                StemModel::LuGre => 80.0,
            };
            a_second = a_second.max(stem.w * own).max(4.0 * stem.w * stem.w * stem.viscous);
        } else if self.lag == 0.0 && self.positioner > 0.0 {
            require("valve.lag", self.lag, false, "greater than 0 s with a positioner and no stem")?;
        }
        let steps = (h * a_second).ceil().clamp(1.0, 1e6);
        let dt = h / steps;
        Ok(Moving {
            valve: *self,
            joint: Backlash::new(self.d)?,
            plug: BacklashState::at(op),
            steps: steps as u32,
            dt,
            share: dt / (self.lag + dt),
            rest: op,
            p: op,
            x: op,
            v: 0.0,
            z: 0.0,
        })
    }

    /// Largest travel of the output after a turn before the plug moves; for the bounds of a loop that runs away.
    pub(crate) fn width(&self) -> f64 {
        self.d + self.stem.map_or(0.0, |stem| 2.0 * stem.fs)
    }

    /// Positions of the plug under each of the outputs, `h` \[s\] apart, from rest at the first.
    ///
    /// ```
    /// use glapp_sim::Valve;
    ///
    /// let worn = Valve { lag: 0.0, positioner: 0.0, stem: None, d: 2.0, curve: 0.0 };
    /// assert_eq!(worn.positions(&[50.0, 53.0, 52.0, 50.0], 1.0)?, [50.0, 52.0, 52.0, 51.0]);
    /// # Ok::<(), glapp_sim::SimError>(())
    /// ```
    pub fn positions(&self, op: &[f64], h: f64) -> Result<Vec<f64>, SimError> {
        require("h", h, h > 0.0, "greater than 0 s")?;
        let mut moving = self.at_rest(op.first().copied().unwrap_or(0.0), h)?;
        let position = |u: &f64| {
            moving.update(*u);
            moving.plug.output
        };
        Ok(op.iter().map(position).collect())
    }
}

impl Moving {
    /// Takes the output held to the next sample; gives the mean flow until then.
    pub(crate) fn update(&mut self, u: f64) -> f64 {
        let mut flow = 0.0;
        for _ in 0..self.steps {
            self.step(u);
            let plug = self.joint.update(&mut self.plug, self.x);
            flow += self.flow(plug);
        }
        flow / f64::from(self.steps)
    }

    /// Position of the plug.
    pub(crate) fn position(&self) -> f64 {
        self.plug.output
    }

    fn flow(&self, plug: f64) -> f64 {
        let e = plug - self.rest;
        // Far beyond the span there is no valve any more, and the curve must not turn.
        self.rest + e / (1.0 - self.valve.curve * e / 100.0).max(0.05)
    }

    fn step(&mut self, u: f64) {
        let asked = u + self.valve.positioner * (u - self.x);
        self.p += (asked - self.p) * self.share;
        let Some(stem) = self.valve.stem else {
            self.x = self.p;
            return;
        };
        let (dt, w2) = (self.dt, stem.w * stem.w);
        let force = self.p - self.x;
        let slides = stem.fc + (stem.fs - stem.fc) / (1.0 + self.v.abs() / stem.stribeck);
        match stem.model {
            StemModel::Karnopp if self.v == 0.0 => {
                if force.abs() > stem.fs {
                    self.v = dt * w2 * (force - stem.fs.copysign(force));
                }
            }
            StemModel::Karnopp => {
                let before = self.v;
                let driven = before + dt * w2 * (force - slides.copysign(before));
                self.v = driven / (1.0 + dt * w2 * stem.viscous);
                if self.v * before <= 0.0 {
                    self.v = 0.0;
                }
            }
            StemModel::LuGre => {
                let bent = self.z;
                if slides > 0.0 {
                    self.z = (bent + self.v * dt) / (1.0 + BRISTLES * self.v.abs() * dt / slides);
                } else {
                    self.z = 0.0;
                }
                // The bristles are damped as much as makes them settle without a swing.
                let damping = 2.0 * BRISTLES.sqrt() / stem.w;
                let friction = BRISTLES * self.z + damping * (self.z - bent) / dt;
                self.v = (self.v + dt * w2 * (force - friction)) / (1.0 + dt * w2 * stem.viscous);
            }
        }
        self.x += dt * self.v;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Valve = Valve { lag: 0.5, positioner: 0.0, stem: None, d: 0.0, curve: 0.0 };
    const STEM: Stem = Stem { model: StemModel::Karnopp, fs: 1.0, fc: 1.0, stribeck: 0.5, viscous: 0.3, w: 8.0 };

    /// OP from 50 to 60, to 40 and back to 60, at 0.02 a second.
    fn sweep() -> Vec<f64> {
        let leg = |from: f64, to: f64| (0..1000).map(move |k| from + (to - from) * f64::from(k) / 1000.0);
        leg(50.0, 60.0).chain(leg(60.0, 40.0)).chain(leg(40.0, 60.0)).collect()
    }

    /// Travel of OP after its turns at rows 1000 and 2000 before the plug has moved by 0.05.
    fn widths(valve: Valve) -> [f64; 2] {
        let op = sweep();
        let x = valve.positions(&op, 1.0).unwrap();
        [1000, 2000].map(|turn| {
            let stood = x[turn + 3];
            let moved = (turn + 3..op.len()).find(|k| (x[*k] - stood).abs() > 0.05).unwrap();
            (op[moved] - op[turn]).abs()
        })
    }

    #[test]
    fn without_friction_it_follows() {
        let x = PLAIN.positions(&[50.0, 51.0, 51.0, 51.0, 51.0, 51.0], 1.0).unwrap();
        assert!((x[5] - 51.0).abs() < 0.01 && x[1] > 50.8 && x[1] < 50.9, "{x:?}");
    }

    #[test]
    fn coulomb_friction_is_a_dead_band_that_a_positioner_makes_smaller() {
        for model in [StemModel::Karnopp, StemModel::LuGre] {
            let stem = Some(Stem { model, ..STEM });
            for (positioner, expected) in [(0.0, 2.0), (3.0, 0.5)] {
                for width in widths(Valve { positioner, stem, ..PLAIN }) {
                    assert!((width - expected).abs() < 0.12, "{model:?} {positioner} {width}");
                }
            }
        }
    }

    #[test]
    fn clearance_adds_to_friction() {
        for width in widths(Valve { stem: Some(STEM), d: 1.5, ..PLAIN }) {
            assert!((width - 3.5).abs() < 0.12, "{width}");
        }
    }

    #[test]
    fn static_friction_makes_it_jump() {
        let op = sweep();
        for model in [StemModel::Karnopp, StemModel::LuGre] {
            let jump = |fs: f64| {
                let x = Valve { stem: Some(Stem { model, fs, ..STEM }), ..PLAIN }.positions(&op, 1.0).unwrap();
                x.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max)
            };
            assert!(jump(1.0) < 0.1, "{model:?} {}", jump(1.0));
            assert!(jump(2.0) > 0.4, "{model:?} {}", jump(2.0));
        }
    }

    #[test]
    fn the_curve_has_slope_one_at_rest() {
        let mut moving = Valve { curve: 1.0, lag: 0.0, ..PLAIN }.at_rest(50.0, 1.0).unwrap();
        let flow = [50.0, 50.01, 60.0, 40.0].map(|op| moving.update(op));
        assert_eq!(flow[0], 50.0);
        assert!((flow[1] - 50.01).abs() < 1e-5);
        assert!((flow[2] - 50.0 - 10.0 / 0.9).abs() < 1e-9 && (flow[3] - 50.0 + 10.0 / 1.1).abs() < 1e-9);
    }

    #[test]
    fn wrong_numbers_are_named() {
        let stem = |stem: Stem| Valve { stem: Some(stem), ..PLAIN };
        for (valve, part) in [
            (Valve { lag: -1.0, ..PLAIN }, "valve.lag = -1"),
            (Valve { positioner: f64::NAN, ..PLAIN }, "valve.positioner = NaN"),
            (Valve { curve: 2.0, ..PLAIN }, "valve.curve = 2"),
            (Valve { d: -0.1, ..PLAIN }, "d = -0.1"),
            (Valve { lag: 0.0, positioner: 1.0, ..PLAIN }, "valve.lag = 0"),
            (stem(Stem { fs: 0.5, ..STEM }), "valve.stem.fs = 0.5"),
            (stem(Stem { fc: -1.0, ..STEM }), "valve.stem.fc = -1"),
            (stem(Stem { stribeck: 0.0, ..STEM }), "valve.stem.stribeck = 0"),
            (stem(Stem { viscous: -1.0, ..STEM }), "valve.stem.viscous = -1"),
            (stem(Stem { w: 0.0, ..STEM }), "valve.stem.w = 0"),
        ] {
            let text = valve.positions(&[50.0], 1.0).unwrap_err().to_string();
            assert!(text.starts_with(part), "{text}");
        }
    }
}
