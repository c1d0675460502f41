//! Second-order low-pass filter.

use super::{Context, Inputs, Kind, Module, Required, Work};
use crate::SimError;
use glapp_core::{Forward, SecondOrderFilter, SecondOrderFilterState};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("tf", Required)]],
    ..Kind::plain("Filter2P", |m, _| {
        Ok(Box::new(Filter2P { block: block(m)?, state: SecondOrderFilterState::default() }))
    })
};

struct Filter2P {
    block: SecondOrderFilter<f64>,
    state: SecondOrderFilterState<f64>,
}

fn block(m: &Module) -> Result<SecondOrderFilter<f64>, SimError> {
    Ok(SecondOrderFilter::new(m.value("tf"))?)
}

impl Work for Filter2P {
    fn forward(&mut self, &[x, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, x, h)
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
