//! A valve that sticks and slips.

use super::{Context, Inputs, Is, Kind, Module, Required, Unknown, Work};
use crate::valve::Moving;
use crate::{SimError, Stem, StemModel, Valve};
use glapp_core::status::BAD;
use glapp_core::{Forward, FrictionState, Model};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("s", Required), ("j", Required), ("model", Is(1.0)), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("Friction", |m, context| {
        let block = block(m)?;
        Ok(match model(m)? {
            Some(_) => Box::new(Friction { block, state: m.known("start").map(FrictionState::at) }),
            None => Box::new(Mechanism {
                valve: valve(m),
                h: context.h,
                moving: m.known("start").map(|start| valve(m).at_rest(start, context.h)).transpose()?,
            }),
        })
    })
};

/// Friction by a data-driven model, or by its parts.
struct Friction {
    block: glapp_core::Friction<f64>,
    /// None until its first input.
    state: Option<FrictionState<f64>>,
}

/// A stem with mass: static friction (s + j)/2 and Coulomb friction (s − j)/2 against a spring of rate 1.
struct Mechanism {
    valve: Valve,
    /// Time between scans \[s\].
    h: f64,
    moving: Option<Moving>,
}

/// None: by its parts.
fn model(m: &Module) -> Result<Option<Model>, SimError> {
    let all = [(1.0, Some(Model::Kano)), (2.0, Some(Model::He)), (3.0, None)];
    Ok(m.one_of("model", &all, "1 (Kano), 2 (He) or 3 (Karnopp)")?)
}

fn block(m: &Module) -> Result<glapp_core::Friction<f64>, SimError> {
    Ok(glapp_core::Friction::new(model(m)?.unwrap_or(Model::Kano), m.value("s"), m.value("j"))?)
}

fn valve(m: &Module) -> Valve {
    let (s, j) = (m.value("s"), m.value("j"));
    let (fs, fc) = (0.5 * (s + j), 0.5 * (s - j));
    let stem = Stem { model: StemModel::Karnopp, fs, fc, stribeck: 1.0, viscous: 0.3, w: 8.0 };
    Valve { lag: 0.0, positioner: 0.0, stem: Some(stem), d: 0.0, curve: 0.0 }
}

impl Work for Friction {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        match &mut self.state {
            Some(state) if !x.is_good() => Forward::new(state.position, x.flags | BAD),
            None if !x.is_good() => Forward::new(x.value, x.flags | BAD),
            state => {
                let state = state.get_or_insert(FrictionState::at(x.value));
                Forward::new(self.block.update(state, x.value), x.flags)
            }
        }
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}

impl Work for Mechanism {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        if !x.is_good() {
            let stands = self.moving.as_ref().map_or(x.value, Moving::position);
            return Forward::new(stands, x.flags | BAD);
        }
        if self.moving.is_none() {
            self.moving = self.valve.at_rest(x.value, self.h).ok();
        }
        Forward::new(self.moving.as_mut().map_or(x.value, |moving| moving.update(x.value)), x.flags)
    }

    /// A stem that moves comes to rest where it is.
    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError> {
        block(to)?;
        let valve = valve(to);
        let stands = self.moving.as_ref().map(Moving::position);
        self.moving = stands.map(|at| valve.at_rest(at, context.h)).transpose()?;
        self.valve = valve;
        Ok(())
    }
}
