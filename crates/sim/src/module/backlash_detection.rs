//! The detector, beside a controller.

use super::{
    BackwardSignals, Context, Inputs, Is, Kind, MOST_INPUTS, Module, Required, Unknown, Work, compensation, open,
};
use crate::SimError;
use glapp_core::modules::{
    self, BacklashDetectionSettings, BacklashDetectionState, ForeignDetectionSettings, ForeignDetectionState, Read,
};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use glapp_core::{Backward, DETECTIONS, DetectorSettings, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    inputs: &["sp", "pv", "op", "flags", "u_ff"],
    optional: &["op", "flags", "u_ff"],
    may_end: true,
    parameters: &[
        &[
            ("k", Required),
            ("ti", Required),
            ("td", Is(0.0)),
            ("b", Is(1.0)),
            ("kp", Unknown),
            ("pv_span", Unknown),
            ("op_span", Unknown),
            ("integrating", Is(0.0)),
            ("tf", Unknown),
            ("n", Is(DETECTIONS as f64)),
            ("op_low", Unknown),
            ("op_high", Unknown),
            ("max_h", Unknown),
            ("ff_delay", Is(1.0)),
            ("ff_tolerance", Unknown),
            ("ff_longest", Unknown),
        ],
        compensation::PARAMETERS,
    ],
    commands: &["compensate"],
    variables: &[&["error"], compensation::VARIABLES, compensation::INNER],
    ..Kind::plain("BacklashDetection", |m, context| {
        Ok(if context.has(&KIND, "flags") {
            let block = modules::ForeignDetection::new(foreign(m, context)?)?;
            Box::new(Beside { block, context, state: ForeignDetectionState::default() })
        } else {
            let block = modules::BacklashDetection::new(settings(m, context)?)?;
            Box::new(BacklashDetection { block, state: BacklashDetectionState::default() })
        })
    })
};

/// Beside a controller of the graph.
struct BacklashDetection {
    block: modules::BacklashDetection<f64>,
    state: BacklashDetectionState<f64>,
}

/// Beside one that is not ours.
struct Beside {
    block: modules::ForeignDetection<f64>,
    context: Context,
    state: ForeignDetectionState<f64>,
}

fn settings(m: &Module, context: Context) -> Result<BacklashDetectionSettings<f64>, ParameterError> {
    let usual = DetectorSettings::new(m.value("k"), m.value("ti"), m.value("td"), context.h);
    let detector = DetectorSettings {
        b: m.value("b"),
        kp: m.known("kp"),
        pv_span: m.known("pv_span"),
        op_span: m.known("op_span"),
        integrating: m.yes("integrating")?,
        tf: m.known("tf").unwrap_or(usual.tf),
        n: m.whole("n")?,
        op_limits: m.known("op_low").zip(m.known("op_high")),
        max_h: m.known("max_h").unwrap_or(usual.max_h),
        ..usual
    };
    Ok(BacklashDetectionSettings { detector, compensation: compensation::settings(m)? })
}

/// Settings of the detection beside another maker's controller.
fn foreign(m: &Module, context: Context) -> Result<ForeignDetectionSettings<f64>, ParameterError> {
    let usual = ForeignDetectionSettings::new(settings(m, context)?);
    let delay = m.whole("ff_delay")?;
    Ok(ForeignDetectionSettings { delay, tolerance: m.known("ff_tolerance"), longest: m.known("ff_longest"), ..usual })
}

/// Value of a variable, or of the compensation's.
fn named(block: &modules::BacklashDetection<f64>, state: &BacklashDetectionState<f64>, name: &str) -> Option<f64> {
    match name {
        "error" => Some(state.error().into()),
        "tf" => Some(block.settings().detector.tf),
        "max_h" => Some(block.settings().detector.max_h),
        _ => compensation::read(block, state, name),
    }
}

impl Work for BacklashDetection {
    fn forward(&mut self, &[sp, pv, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, sp, pv, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        self.block.backward(&mut self.state, back);
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError> {
        compensation::not_taken_away(to, &self.state)?;
        self.block = modules::BacklashDetection::new(settings(to, context)?)?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        named(&self.block, &self.state, name)
    }

    fn command(&mut self, _compensate: &str, value: f64) -> Result<(), ParameterError> {
        compensation::compensate(&mut self.state, value)
    }

    fn window(&self) -> Option<Vec<f64>> {
        Some(self.state.detector.window().collect())
    }

    fn reset_detection(&mut self) -> bool {
        self.state.reset();
        true
    }
}

/// A sum of flags; what is none is a bad value.
fn status(told: Forward<f64>) -> Status {
    let flags = told.value as Status;
    let known = flags & !(NOT_AUTO | BAD | AT_LOW | AT_HIGH) == 0 && f64::from(flags) == told.value;
    if told.is_good() && known { flags } else { BAD }
}

impl Work for Beside {
    fn forward(&mut self, &[sp, pv, op, flags, u_ff]: &Inputs, h: f64) -> Forward<f64> {
        let connected = |input, value| self.context.has(&KIND, input).then_some(value);
        let read = Read { op: connected("op", op), flags: status(flags), u_ff: connected("u_ff", u_ff) };
        self.block.update(&mut self.state, sp, pv, &read, h)
    }

    fn backward(&mut self, _back: Option<Backward<f64>>) -> BackwardSignals {
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError> {
        self.block = modules::ForeignDetection::new(foreign(to, context)?)?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        named(self.block.detection(), &self.state.detection, name)
    }

    fn command(&mut self, _compensate: &str, value: f64) -> Result<(), ParameterError> {
        compensation::compensate(&mut self.state.detection, value)
    }

    fn reset_detection(&mut self) -> bool {
        self.state.detection.reset();
        true
    }
}
