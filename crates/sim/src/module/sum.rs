//! The sum of two signals.

use super::{BackwardSignals, Context, Inputs, Kind, Module, Work, open};
use crate::SimError;
use glapp_core::{Backward, Forward};

pub(super) static KIND: Kind =
    Kind { inputs: &["in", "plus"], ..Kind::plain("Sum", |_, _| Ok(Box::new(Sum { last: [0.0; 2] }))) };

struct Sum {
    last: [f64; 2],
}

impl Work for Sum {
    fn forward(&mut self, &[x, plus, ..]: &Inputs, _h: f64) -> Forward<f64> {
        self.last = [x.value, plus.value];
        Forward::new(x.value + plus.value, x.flags | plus.flags)
    }

    /// Each input gets the range that the other one leaves.
    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        let followers = back.unwrap_or_default();
        let beside = |other: f64| {
            let other = if other.is_finite() { other } else { 0.0 };
            let Backward { low, high, flags, tracking } = followers;
            Backward { low: low - other, high: high - other, flags, tracking: tracking - other }
        };
        [beside(self.last[1]), beside(self.last[0]), open(), open(), open()]
    }

    fn change(&mut self, _to: &Module, _context: Context) -> Result<(), SimError> {
        Ok(())
    }
}
