//! A relay experiment between controller and valve.

use super::{BackwardSignals, Context, Inputs, Is, Kind, Module, Required, Unknown, Work, open, switch};
use crate::SimError;
use glapp_core::auto_tuner::Found;
use glapp_core::modules::{self, AutoTunerState};
use glapp_core::{AutoTunerSettings, Backward, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    inputs: &["in", "pv"],
    parameters: &[&[
        ("amplitude", Required),
        ("wait", Required),
        ("longest", Required),
        ("pv_low", Required),
        ("pv_high", Required),
        ("op_low", Required),
        ("op_high", Required),
        ("relay_hysteresis", Unknown),
        ("d", Is(0.0)),
        ("max_h", Unknown),
    ]],
    commands: &["run"],
    variables: &[&["phase", "stop", "ku", "tu", "kp", "kappa"]],
    ..Kind::plain("AutoTuner", |m, context| {
        let max_h = max_h(m, context);
        Ok(Box::new(AutoTuner { block: block(m, context)?, max_h, state: AutoTunerState::default() }))
    })
};

struct AutoTuner {
    block: modules::AutoTuner<f64>,
    max_h: f64,
    state: AutoTunerState<f64>,
}

/// A longer time between scans ends it \[s\].
fn max_h(m: &Module, context: Context) -> f64 {
    m.known("max_h").unwrap_or(3.0 * context.h)
}

fn block(m: &Module, context: Context) -> Result<modules::AutoTuner<f64>, SimError> {
    let settings = AutoTunerSettings {
        amplitude: m.value("amplitude"),
        relay_hysteresis: m.known("relay_hysteresis"),
        d: m.value("d"),
        wait: m.value("wait"),
        longest: m.value("longest"),
        max_h: max_h(m, context),
        pv: (m.value("pv_low"), m.value("pv_high")),
        op: (m.value("op_low"), m.value("op_high")),
    };
    Ok(modules::AutoTuner::new(settings)?)
}

/// A command or variable.
pub(super) fn named(state: &AutoTunerState<f64>, name: &str) -> Option<f64> {
    let experiment = &state.experiment;
    let found =
        |number: fn(&Found<f64>) -> Option<f64>| Some(experiment.found.as_ref().and_then(number).unwrap_or(f64::NAN));
    match name {
        "run" => Some(u8::from(state.run).into()),
        "phase" => Some(f64::from(experiment.phase as u8)),
        "stop" => Some(f64::from(experiment.stop as u8)),
        "ku" => found(|found| Some(found.ku)),
        "tu" => found(|found| Some(found.tu)),
        "kp" => found(|found| found.kp),
        "kappa" => found(|found| found.kappa),
        _ => None,
    }
}

impl Work for AutoTuner {
    fn forward(&mut self, &[x, pv, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, x, pv, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        [self.block.backward(&mut self.state, back.unwrap_or_default()), open(), open(), open(), open()]
    }

    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError> {
        self.block = block(to, context)?;
        self.max_h = max_h(to, context);
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        if name == "max_h" { Some(self.max_h) } else { named(&self.state, name) }
    }

    fn command(&mut self, _run: &str, value: f64) -> Result<(), ParameterError> {
        self.state.run = switch("run", value, "0 (end it) or 1 (begin)")?;
        Ok(())
    }
}
