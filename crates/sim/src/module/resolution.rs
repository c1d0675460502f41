//! The steps of a converter.

use super::{Context, Inputs, Kind, Module, Required, Work};
use crate::SimError;
use crate::error::require;
use glapp_core::Forward;

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("step", Required)]],
    ..Kind::plain("Resolution", |m, _| Ok(Box::new(Resolution { step: step(m)? })))
};

struct Resolution {
    step: f64,
}

/// Size of a step, checked to be above 0.
fn step(m: &Module) -> Result<f64, SimError> {
    let step = m.value("step");
    Ok(require("step", step, step >= 0.0, "0 or greater")?)
}

/// The nearest multiple of `step`, halves upwards; `x` itself where that is 0.
#[inline(always)]
pub(crate) fn rounded(x: f64, step: f64) -> f64 {
    if step > 0.0 { (x / step + 0.5).floor() * step } else { x }
}

impl Work for Resolution {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        Forward::new(rounded(x.value, self.step), x.flags)
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.step = step(to)?;
        Ok(())
    }
}
