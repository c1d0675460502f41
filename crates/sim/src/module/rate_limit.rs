//! Speed of an actuator.

use super::{BackwardSignals, Context, Inputs, Is, Kind, Module, Required, Unknown, Work, open, passed, switch};
use crate::SimError;
use glapp_core::{Backward, Forward, RateLimitState};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("rate", Required), ("told", Is(1.0)), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("RateLimit", |m, _| {
        let state = m.known("start").map(RateLimitState::at).unwrap_or_default();
        let (block, told) = block(m)?;
        Ok(Box::new(RateLimit { block, told, state, last: f64::NAN }))
    })
};

struct RateLimit {
    block: glapp_core::RateLimit<f64>,
    told: bool,
    state: RateLimitState<f64>,
    last: f64,
}

fn block(m: &Module) -> Result<(glapp_core::RateLimit<f64>, bool), SimError> {
    let told = switch("told", m.value("told"), "1 (those before are told) or 0 (they are not)")?;
    Ok((glapp_core::RateLimit::new(m.value("rate"))?, told))
}

impl Work for RateLimit {
    fn forward(&mut self, &[x, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.last = x.value;
        self.block.forward(&mut self.state, x, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        if !self.told {
            return passed(back);
        }
        [self.block.backward(&self.state, self.last, back.unwrap_or_default()), open(), open(), open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        (self.block, self.told) = block(to)?;
        Ok(())
    }
}
