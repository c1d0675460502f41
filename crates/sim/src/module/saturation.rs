//! End positions of an actuator.

use super::{BackwardSignals, Context, Inputs, Kind, Module, Required, Work, open};
use crate::SimError;
use glapp_core::{Backward, Forward};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("low", Required), ("high", Required)]],
    ..Kind::plain("Saturation", |m, _| Ok(Box::new(Saturation { block: block(m)?, last: f64::NAN })))
};

struct Saturation {
    block: glapp_core::Saturation<f64>,
    last: f64,
}

fn block(m: &Module) -> Result<glapp_core::Saturation<f64>, SimError> {
    Ok(glapp_core::Saturation::new(m.value("low"), m.value("high"))?)
}

impl Work for Saturation {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        self.last = x.value;
        self.block.forward(x)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        [self.block.backward(self.last, back.unwrap_or_default()), open(), open(), open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }
}
