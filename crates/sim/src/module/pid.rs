//! The controller.

use super::{BackwardSignals, Context, Inputs, Is, Kind, Module, Parameter, Required, Unknown, Work, open};
use crate::SimError;
use glapp_core::modules::{self, Mode, PidSettings, PidState};
use glapp_core::{Backward, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    inputs: &["pv", "sp", "ff"],
    optional: &["sp", "ff"],
    is_controller: true,
    parameters: &[PARAMETERS],
    beginnings: BEGINNINGS,
    commands: &["mode", "sp", "manual"],
    variables: &[VARIABLES],
    ..Kind::plain("Pid", |m, context| {
        let block = modules::Pid::new(settings(m))?;
        let (start, mode) = (m.value("start"), mode(context));
        let mut state = m.known("start_pv").map_or(PidState::at(start), |y| block.at_rest(mode, y, start));
        state.mode = mode;
        Ok(Box::new(Pid { block, state }))
    })
};

/// Parameters common to all controllers.
pub(super) const PARAMETERS: &[Parameter] = &[
    ("k", Required),
    ("ti", Required),
    ("td", Is(0.0)),
    ("b", Is(1.0)),
    ("c", Is(0.0)),
    ("tf", Is(0.0)),
    ("low", Is(-f64::MAX)),
    ("high", Is(f64::MAX)),
    ("rate", Is(f64::MAX)),
    ("max_h", Unknown),
    ("start", Is(0.0)),
    ("start_pv", Unknown),
];
pub(super) const BEGINNINGS: &[&str] = &["start", "start_pv"];
pub(super) const VARIABLES: &[&str] = &["ysp", "yf", "error", "flags"];

struct Pid {
    block: modules::Pid<f64>,
    state: PidState<f64>,
}

/// The mode at the start: a connected setpoint is followed.
pub(super) fn mode(context: Context) -> Mode {
    if context.connected[1] { Mode::External } else { Mode::Auto }
}

pub(super) fn settings(m: &Module) -> PidSettings<f64> {
    let ideal = PidSettings::ideal(m.value("k"), m.value("ti"), m.value("td"));
    PidSettings {
        b: m.value("b"),
        c: m.value("c"),
        tf: m.value("tf"),
        low: m.value("low"),
        high: m.value("high"),
        rate: m.value("rate"),
        max_h: m.known("max_h").unwrap_or(ideal.max_h),
        ..ideal
    }
}

/// Value of a variable of the controller.
pub(super) fn named(state: &PidState<f64>, name: &str) -> Option<f64> {
    match name {
        "mode" => Some(f64::from(state.mode as u8)),
        "sp" => Some(state.sp),
        "manual" => Some(state.manual),
        "ysp" => Some(state.ysp),
        "yf" => Some(state.yf),
        "error" => Some(state.error.into()),
        "flags" => Some(state.flags.into()),
        _ => None,
    }
}

/// Sets mode, output or setpoint by an operator.
pub(super) fn commanded(state: &mut PidState<f64>, name: &str, value: f64) -> Result<(), ParameterError> {
    let number = |name| {
        if value.is_finite() { Ok(value) } else { Err(ParameterError { name, value, bound: "a number" }) }
    };
    match name {
        "sp" => state.sp = number("sp")?,
        "manual" => state.manual = number("manual")?,
        _ => {
            let bound = "0 (manual), 1 (auto) or 2 (external)";
            let found = Mode::ALL.into_iter().find(|mode| f64::from(*mode as u8) == value);
            state.mode = found.ok_or(ParameterError { name: "mode", value, bound })?;
        }
    }
    Ok(())
}

impl Work for Pid {
    fn forward(&mut self, &[pv, sp, ff, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, pv, sp, ff, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        let (sp, ff) = self.block.backward(&mut self.state, back.unwrap_or_default());
        [open(), sp, ff, open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = modules::Pid::new(settings(to))?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        match name {
            "max_h" => Some(self.block.settings().max_h),
            _ => named(&self.state, name),
        }
    }

    fn command(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        commanded(&mut self.state, name, value)
    }
}
