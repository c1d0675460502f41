//! A gap.

use super::{Context, Inputs, Kind, Module, Required, Unknown, Work};
use crate::SimError;
use glapp_core::{BacklashState, Forward};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("d", Required), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("Backlash", |m, _| {
        let state = m.known("start").map(BacklashState::at).unwrap_or_default();
        Ok(Box::new(Backlash { block: block(m)?, state }))
    })
};

struct Backlash {
    block: glapp_core::Backlash<f64>,
    state: BacklashState<f64>,
}

fn block(m: &Module) -> Result<glapp_core::Backlash<f64>, SimError> {
    Ok(glapp_core::Backlash::new(m.value("d"))?)
}

impl Work for Backlash {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, x)
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
