//! Uniform noise.

use super::{Context, Inputs, Is, Kind, Module, Required, Work};
use crate::SimError;
use glapp_core::{Forward, NoiseState};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("amplitude", Required), ("seed", Is(1.0))]],
    beginnings: &["seed"],
    ..Kind::plain("Noise", |m, _| {
        let state = NoiseState::seeded(m.whole("seed")?.into());
        Ok(Box::new(Noise { block: block(m)?, state }))
    })
};

struct Noise {
    block: glapp_core::Noise<f64>,
    state: NoiseState,
}

fn block(m: &Module) -> Result<glapp_core::Noise<f64>, SimError> {
    Ok(glapp_core::Noise::new(m.value("amplitude"))?)
}

impl Work for Noise {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, x)
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
