//! A value from outside.

use super::{BACKWARD, BackwardSignals, Context, Inputs, Is, Kind, MOST_INPUTS, Module, Work, backward_named, open};
use crate::SimError;
use glapp_core::{Backward, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    inputs: &[],
    parameters: &[&[("value", Is(0.0))]],
    beginnings: &["value"],
    commands: &["value"],
    variables: &[BACKWARD],
    ..Kind::plain("Input", |m, _| Ok(Box::new(Input { value: m.value("value"), seen: Backward::default() })))
};

struct Input {
    value: f64,
    seen: Backward<f64>,
}

impl Work for Input {
    fn forward(&mut self, _inputs: &Inputs, _h: f64) -> Forward<f64> {
        Forward::new(self.value, 0)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        self.seen = back.unwrap_or_default();
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, _to: &Module, _context: Context) -> Result<(), SimError> {
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        if name == "value" { Some(self.value) } else { backward_named(&self.seen, name) }
    }

    fn command(&mut self, _value: &str, value: f64) -> Result<(), ParameterError> {
        self.value = value;
        Ok(())
    }
}
