//! Speed of an actuator.

use super::{BackwardSignals, Context, Inputs, Is, Kind, Module, Required, Unknown, Work, open, passed, switch};
use crate::SimError;
use glapp_core::{Backward, Forward, RateLimitState};

pub(super) static KIND: Kind = Kind {
    parameters: &[&[("rate", Required), ("reports", Is(1.0)), ("start", Unknown)]],
    beginnings: &["start"],
    ..Kind::plain("RateLimit", |m, _| {
        let state = m.known("start").map(RateLimitState::at).unwrap_or_default();
        let (block, reports) = block(m)?;
        Ok(Box::new(RateLimit { block, reports, state, last: f64::NAN }))
    })
};

struct RateLimit {
    block: glapp_core::RateLimit<f64>,
    reports: bool,
    state: RateLimitState<f64>,
    last: f64,
}

fn block(m: &Module) -> Result<(glapp_core::RateLimit<f64>, bool), SimError> {
    let reports = switch("reports", m.value("reports"), "1 (reported to the modules before it) or 0 (not reported)")?;
    Ok((glapp_core::RateLimit::new(m.value("rate"))?, reports))
}

impl Work for RateLimit {
    fn forward(&mut self, &[x, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.last = x.value;
        self.block.forward(&mut self.state, x, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        if !self.reports {
            return passed(back);
        }
        [self.block.backward(&self.state, self.last, back.unwrap_or_default()), open(), open(), open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        (self.block, self.reports) = block(to)?;
        Ok(())
    }
}
