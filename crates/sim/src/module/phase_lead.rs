//! Phase-lead compensator.

use super::{BackwardSignals, Context, Inputs, Kind, Module, Required, Unknown, Work, open};
use crate::SimError;
use glapp_core::{Backward, Forward, PhaseLeadState};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("lead", Required), ("lag", Required), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("PhaseLead", |m, _| {
        let state = m.known("start").map(PhaseLeadState::at).unwrap_or_default();
        Ok(Box::new(PhaseLead { block: block(m)?, state }))
    })
};

struct PhaseLead {
    block: glapp_core::PhaseLead<f64>,
    state: PhaseLeadState<f64>,
}

fn block(m: &Module) -> Result<glapp_core::PhaseLead<f64>, SimError> {
    Ok(glapp_core::PhaseLead::new(m.value("lead"), m.value("lag"))?)
}

impl Work for PhaseLead {
    fn forward(&mut self, &[x, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, x, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        [self.block.backward(&mut self.state, back.unwrap_or_default()), open(), open(), open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
