//! The detector, beside a controller.

use super::{Inputs, Is, Kind, MOST_INPUTS, Module, Place, Required, Told, Unknown, Work, compensation, open};
use crate::SimError;
use glapp_core::modules::{self, BacklashDetectionSettings, BacklashDetectionState};
use glapp_core::{Backward, DETECTIONS, DetectorSettings, Forward, ParameterError};

pub(super) static KIND: Kind = Kind {
    inputs: &["sp", "pv"],
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
        ],
        compensation::PARAMETERS,
    ],
    commands: &["compensate"],
    variables: &[&["error"], compensation::VARIABLES, compensation::INNER],
    ..Kind::plain("BacklashDetection", |m, place| {
        let block = modules::BacklashDetection::new(settings(m, place)?)?;
        Ok(Box::new(BacklashDetection { block, state: BacklashDetectionState::default() }))
    })
};

struct BacklashDetection {
    block: modules::BacklashDetection<f64>,
    state: BacklashDetectionState<f64>,
}

fn settings(m: &Module, place: Place) -> Result<BacklashDetectionSettings<f64>, ParameterError> {
    let usual = DetectorSettings::new(m.value("k"), m.value("ti"), m.value("td"), place.h);
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

impl Work for BacklashDetection {
    fn forward(&mut self, &[sp, pv, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, sp, pv, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> Told {
        self.block.backward(&mut self.state, back);
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, to: &Module, place: Place) -> Result<(), SimError> {
        compensation::not_taken_away(to, &self.state)?;
        self.block = modules::BacklashDetection::new(settings(to, place)?)?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        match name {
            "error" => Some(self.state.error().into()),
            "tf" => Some(self.block.settings().detector.tf),
            "max_h" => Some(self.block.settings().detector.max_h),
            _ => compensation::read(&self.block, &self.state, name),
        }
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
