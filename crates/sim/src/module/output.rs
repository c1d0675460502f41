//! A value to outside.

use super::{BACKWARD, BackwardSignals, Context, Inputs, Kind, Module, Work, backward_named, passed};
use crate::SimError;
use glapp_core::status::{AT_HIGH, AT_LOW, NOT_AUTO, Status};
use glapp_core::{Backward, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    may_end: true,
    commands: BACKWARD,
    variables: &[&["value"]],
    ..Kind::plain("Output", |_, _| Ok(Box::new(Output { value: f64::NAN, says: Backward::default() })))
};

struct Output {
    value: f64,
    says: Backward<f64>,
}

impl Work for Output {
    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        self.value = if x.is_good() { x.value } else { f64::NAN };
        x
    }

    fn backward(&mut self, _back: Option<Backward<f64>>) -> BackwardSignals {
        passed(Some(self.says))
    }

    fn change(&mut self, _to: &Module, _context: Context) -> Result<(), SimError> {
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        if name == "value" { Some(self.value) } else { backward_named(&self.says, name) }
    }

    fn command(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        // A plant may report anything: the controller must find out what makes no sense.
        match name {
            "low" => self.says.low = value,
            "high" => self.says.high = value,
            "tracking" => self.says.tracking = value,
            _ => {
                if value < 0.0 || value.fract() != 0.0 || value as Status & !(AT_LOW | AT_HIGH | NOT_AUTO) != 0 {
                    let bound = "a sum of 1 (not followed), 4 (at the lower limit), 8 (at the upper limit)";
                    return Err(ParameterError { name: "flags", value, bound });
                }
                self.says.flags = value as Status;
            }
        }
        Ok(())
    }
}
