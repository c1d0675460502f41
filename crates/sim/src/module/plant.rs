//! An exact plant of any order.

use super::{BackwardSignals, Context, Inputs, Is, Kind, MOST_INPUTS, Module, Unknown, Work, open};
use crate::SimError;
use crate::engine::{Process, process_at_rest};
use glapp_core::{Backward, Forward};

pub(super) static KIND: Kind = Kind {
    inputs: &["in", "load"],
    optional: &["load"],
    is_delay: true,
    parameters: &[&[("h", Unknown), ("start", Is(0.0))]],
    beginnings: &["h", "start"],
    ..Kind::plain("Plant", |m, context| {
        let plant = m.plant.as_ref().ok_or(SimError::Plant("a Plant is made with its transfer function"))?;
        let (y, held, process) = process_at_rest(plant, m.own_h().unwrap_or(context.h), m.value("start"))?;
        Ok(Box::new(Plant { process, y, held }))
    })
};

struct Plant {
    process: Box<dyn Process>,
    /// Process value of the coming scan.
    y: f64,
    /// Input; a bad one leaves the last good one in effect.
    held: f64,
}

impl Work for Plant {
    fn output(&self) -> Forward<f64> {
        Forward::new(self.y, 0)
    }

    fn forward(&mut self, &[x, load, ..]: &Inputs, _h: f64) -> Forward<f64> {
        let now = self.output();
        if x.is_good() && load.is_good() {
            self.held = x.value + load.value;
        }
        self.y = self.process.update(self.held);
        now
    }

    fn backward(&mut self, _back: Option<Backward<f64>>) -> BackwardSignals {
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, _to: &Module, _context: Context) -> Result<(), SimError> {
        Ok(())
    }
}
