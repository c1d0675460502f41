//! A valve that sticks and slips.

use super::{BackwardSignals, Inputs, Is, Kind, Module, Place, Required, Unknown, Work, passed};
use crate::SimError;
use glapp_core::status::BAD;
use glapp_core::{Backward, Forward, FrictionState, Model};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("s", Required), ("j", Required), ("model", Is(1.0)), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("Friction", |m, _| {
        Ok(Box::new(Friction { block: block(m)?, state: m.known("start").map(FrictionState::at) }))
    })
};

struct Friction {
    block: glapp_core::Friction<f64>,
    /// None until its first input.
    state: Option<FrictionState<f64>>,
}

fn block(m: &Module) -> Result<glapp_core::Friction<f64>, SimError> {
    let model = m.one_of("model", &[(1.0, Model::Kano), (2.0, Model::He)], "1 (Kano) or 2 (He)")?;
    Ok(glapp_core::Friction::new(model, m.value("s"), m.value("j"))?)
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

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        passed(back)
    }

    fn change(&mut self, to: &Module, _place: Place) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
