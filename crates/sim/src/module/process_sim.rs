//! Two lags and a dead time.

use super::{BackwardSignals, Context, Inputs, Is, Kind, MOST_INPUTS, Module, Required, Unknown, Work, open};
use crate::SimError;
use glapp_core::{Backward, Forward, modules};

/// Length of its memory.
const MEMORY: usize = 1024;

pub(super) static KIND: Kind = Kind {
    inputs: &["in", "load"],
    optional: &["load"],
    is_delay: true,
    parameters: &[&[
        ("gain", Required),
        ("t1", Required),
        ("t2", Is(0.0)),
        ("dead_time", Is(0.0)),
        ("h", Unknown),
        ("start", Is(0.0)),
    ]],
    beginnings: &["h", "start"],
    ..Kind::plain("ProcessSim", |m, context| {
        let block = block(m, context)?;
        let state = modules::ProcessSimState::at_rest(m.value("start") / m.value("gain"));
        Ok(Box::new(ProcessSim { block, state }))
    })
};

struct ProcessSim {
    block: modules::ProcessSim<f64, MEMORY>,
    state: modules::ProcessSimState<f64, MEMORY>,
}

fn block(m: &Module, context: Context) -> Result<modules::ProcessSim<f64, MEMORY>, SimError> {
    let h = m.own_h().unwrap_or(context.h);
    let value = |name| m.value(name);
    Ok(modules::ProcessSim::new(value("gain"), value("t1"), value("t2"), value("dead_time"), h)?)
}

impl Work for ProcessSim {
    fn output(&self) -> Forward<f64> {
        self.block.output(&self.state)
    }

    fn forward(&mut self, &[x, load, ..]: &Inputs, _h: f64) -> Forward<f64> {
        let now = self.output();
        self.block.forward(&mut self.state, x, load);
        now
    }

    fn backward(&mut self, _back: Option<Backward<f64>>) -> BackwardSignals {
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError> {
        self.block = block(to, context)?;
        Ok(())
    }
}
